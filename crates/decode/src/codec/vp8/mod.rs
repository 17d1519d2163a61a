//! VP8 (RFC 6386), its version 0: six-tap filters.

mod bools;
mod header;
mod inter;
mod intra;
mod loop_filter;
mod modes;
mod numbers;
mod plane;
mod residual;

use std::sync::Arc;

use self::bools::Bools;
use self::header::{PersistentState, ReferenceUpdate, Tag, Vp8Header};
use self::loop_filter::Strength;
use self::modes::{Luma, Macroblock, Neighbours, Reach};
use self::plane::{Vp8Picture as Planes8, Vp8Plane};
use self::residual::{EdgeCoefficients, Residual};
use super::{Decode, StreamFacts, check_same};
use crate::error::{DecodeError, Result};
use crate::picture::{Chroma, DecodedPicture, PlaneSamples, SamplePlane, Yuv};

/// A decoder with the frames and the settings that later frames refer to.
#[derive(Default)]
pub(super) struct Vp8 {
    lasting: PersistentState,
    size: Option<(u32, u32)>,
    /// The last, the golden and the alternate frame.
    references: Option<[Arc<Planes8>; 3]>,
    /// Of each macroblock, in row order.
    segments: Vec<u8>,
}

impl Vp8 {
    pub(super) fn new() -> Self {
        Vp8::default()
    }

    /// Decodes a frame; none if it is not shown.
    fn frame(&mut self, packet: &[u8]) -> Result<Option<Yuv>> {
        let tag = Tag::read(packet)?;
        if tag.version > 0 {
            return Err(DecodeError::unsupported(format!("VP8 of version {}", tag.version)));
        }
        if let Some(size) = tag.size {
            check_same(&mut self.size, size)?;
        }
        let (Some((width, height)), true) = (self.size, tag.is_key || self.references.is_some()) else {
            return Err(DecodeError::corrupt("VP8: it does not begin with a key frame"));
        };
        let cut = || DecodeError::corrupt("VP8: a frame is cut off");
        let (first, rest) = packet[tag.length..].split_at_checked(tag.first_partition).ok_or_else(cut)?;
        let mut bools = Bools::new(first);
        let header = self.lasting.read(&mut bools, tag.is_key);
        let partitions = partitions(rest, header.partitions).ok_or_else(cut)?;
        let (columns, rows) = (width.div_ceil(16) as usize, height.div_ceil(16) as usize);
        let mut frame = Vp8Frame::new(columns, rows);
        self.segments.resize(columns * rows, 0);
        frame.decode(
            (&tag, &header, &self.lasting),
            &mut bools,
            partitions,
            self.references.as_ref(),
            &mut self.segments,
        );
        frame.filter(&self.lasting, tag.is_key);
        let picture = Arc::new(frame.picture);
        self.update(&header, &picture);
        if let Some(saved) = self.lasting.saved.take() {
            self.lasting.probabilities = saved;
        }
        Ok(tag.is_shown.then(|| yuv(&picture, (width as usize, height as usize))))
    }

    fn update(&mut self, header: &Vp8Header, current: &Arc<Planes8>) {
        let [last, golden, alternate] =
            self.references.clone().unwrap_or_else(|| std::array::from_fn(|_| current.clone()));
        let chosen = |update: ReferenceUpdate, own: &Arc<Planes8>, other: &Arc<Planes8>| match update {
            ReferenceUpdate::Keep => own.clone(),
            ReferenceUpdate::Current => current.clone(),
            ReferenceUpdate::Last => last.clone(),
            ReferenceUpdate::Other => other.clone(),
        };
        let new = [chosen(header.golden, &golden, &alternate), chosen(header.alternate, &alternate, &golden)];
        let [golden, alternate] = new;
        self.references = Some([if header.is_last { current.clone() } else { last.clone() }, golden, alternate]);
    }
}

/// The partitions of coefficients: their sizes, but the last, come first.
fn partitions(rest: &[u8], count: usize) -> Option<Vec<&[u8]>> {
    let (sizes, mut rest) = rest.split_at_checked(3 * (count - 1))?;
    let mut partitions = Vec::with_capacity(count);
    for size in sizes.chunks_exact(3) {
        let size = usize::from(size[0]) | usize::from(size[1]) << 8 | usize::from(size[2]) << 16;
        let (partition, after) = rest.split_at_checked(size)?;
        partitions.push(partition);
        rest = after;
    }
    partitions.push(rest);
    Some(partitions)
}

/// A frame that is being decoded.
struct Vp8Frame {
    columns: usize,
    rows: usize,
    picture: Planes8,
    macroblocks: Vec<Macroblock>,
}

impl Vp8Frame {
    fn new(columns: usize, rows: usize) -> Self {
        let plane = |side: usize| Vp8Plane::new(side * columns, side * rows);
        let macroblocks = vec![Macroblock::OUTSIDE; columns * rows];
        Vp8Frame { columns, rows, picture: [plane(16), plane(8), plane(8)], macroblocks }
    }

    fn decode(
        &mut self,
        (tag, header, lasting): (&Tag, &Vp8Header, &PersistentState),
        bools: &mut Bools,
        partitions: Vec<&[u8]>,
        references: Option<&[Arc<Planes8>; 3]>,
        segments: &mut [u8],
    ) {
        let mut partitions: Vec<_> = partitions.into_iter().map(Bools::new).collect();
        let mut above: Vec<EdgeCoefficients> = vec![[false; 9]; self.columns];
        for row in 0..self.rows {
            let mut left: EdgeCoefficients = [false; 9];
            for (column, above) in above.iter_mut().enumerate() {
                let place = row * self.columns + column;
                let neighbour = |is_there: bool, back: usize| match is_there {
                    true => &self.macroblocks[place - back],
                    false => &Macroblock::OUTSIDE,
                };
                let neighbours = Neighbours([
                    neighbour(row > 0, self.columns),
                    neighbour(column > 0, 1),
                    neighbour(row > 0 && column > 0, self.columns + 1),
                ]);
                let reach = Reach::of(column, row, self.columns, self.rows);
                let mut it = modes::read(bools, (header, lasting, tag.is_key), &neighbours, reach, segments[place]);
                segments[place] = it.segment;
                let edges = (above, &mut left);
                let count = partitions.len();
                let residual = residual(&mut partitions[row % count], (header, lasting), &mut it, edges);
                match references.filter(|_| it.reference > 0) {
                    Some(references) => {
                        inter::predict(&mut self.picture, &references[it.reference - 1], (column, row), &it);
                        self.add_luma(&residual, (column, row));
                    }
                    None => self.predict(&it, &residual, (column, row)),
                }
                self.add_chroma(&residual, (column, row));
                self.macroblocks[place] = it;
            }
        }
    }

    /// Predicts from the frame itself; blocks refer to those before with their differences added.
    fn predict(&mut self, it: &Macroblock, residual: &Residual, (column, row): (usize, usize)) {
        let [luma, chroma @ ..] = &mut self.picture;
        let (x, y) = (16 * column, 16 * row);
        for plane in chroma {
            intra::whole(plane, (x / 2, y / 2), 8, it.chroma);
        }
        if let Luma::Whole(mode) = it.luma {
            intra::whole(luma, (x, y), 16, mode);
            self.add_luma(residual, (column, row));
            return;
        }
        let beyond = intra::beyond(luma, (x, y));
        for (block, mode) in it.block_modes.into_iter().enumerate() {
            let place = (x + 4 * (block % 4), y + 4 * (block / 4));
            let beyond = match (block % 4, place.1.checked_sub(1)) {
                (3, _) => beyond,
                (_, Some(above)) => std::array::from_fn(|step| luma.at(place.0 + 4 + step, above)),
                (_, None) => beyond,
            };
            intra::block(luma, place, mode, beyond);
            luma.add(place, &residual.blocks[block]);
        }
    }

    fn add_luma(&mut self, residual: &Residual, (column, row): (usize, usize)) {
        for (block, differences) in residual.blocks[..16].iter().enumerate().filter(|_| !residual.is_empty) {
            self.picture[0].add((16 * column + 4 * (block % 4), 16 * row + 4 * (block / 4)), differences);
        }
    }

    fn add_chroma(&mut self, residual: &Residual, (column, row): (usize, usize)) {
        for (block, differences) in residual.blocks[16..].iter().enumerate().filter(|_| !residual.is_empty) {
            let place = (8 * column + 4 * (block % 2), 8 * row + 4 * (block / 2 % 2));
            self.picture[1 + block / 4].add(place, differences);
        }
    }

    fn filter(&mut self, lasting: &PersistentState, is_key: bool) {
        let settings = &lasting.filter;
        if settings.level == 0 {
            return;
        }
        for (place, it) in self.macroblocks.iter().enumerate() {
            let kind = match it.luma {
                Luma::Blocks => Some(0),
                Luma::Moved { is_zero: true } => Some(1),
                Luma::Moved { is_zero: false } => Some(2),
                Luma::Divided => Some(3),
                Luma::Whole(_) => None,
            };
            let level = settings.level(&lasting.segments, it.segment, it.reference, kind);
            if level == 0 {
                continue;
            }
            let inner = !it.is_skipped || !it.has_second();
            let strength = Strength::new(level, settings.sharpness, is_key, inner);
            let filter = if settings.is_simple { loop_filter::simple } else { loop_filter::normal };
            filter(&mut self.picture, (place % self.columns, place / self.columns), &strength);
        }
    }
}

/// Reads the coefficients of a macroblock, which is skipped from then on if it has none.
fn residual(
    bools: &mut Bools,
    (header, lasting): (&Vp8Header, &PersistentState),
    it: &mut Macroblock,
    (above, left): (&mut EdgeCoefficients, &mut EdgeCoefficients),
) -> Residual {
    if it.is_skipped {
        for edge in [above, left] {
            let second = edge[8];
            *edge = [false; 9];
            // Without a second transform its context stays.
            edge[8] = second && !it.has_second();
        }
        return Residual::EMPTY;
    }
    let steps = &header.steps[usize::from(it.segment)];
    let residual = Residual::read(bools, &lasting.probabilities.tokens, steps, it.has_second(), (above, left));
    it.is_skipped = residual.is_empty;
    residual
}

impl Decode for Vp8 {
    fn push(&mut self, packet: &[u8], ready: &mut Vec<DecodedPicture>) -> Result<()> {
        let frame = self.frame(packet)?;
        ready.extend(frame.map(DecodedPicture::Yuv));
        Ok(())
    }

    fn finish(&mut self, _: &mut Vec<DecodedPicture>) -> Result<()> {
        Ok(())
    }

    fn facts(&self) -> StreamFacts {
        StreamFacts { depth: 8, ..StreamFacts::default() }
    }
}

fn yuv(picture: &Planes8, size: (usize, usize)) -> Yuv {
    let plane = |it: &Vp8Plane| SamplePlane { samples: it.levels.clone(), stride: it.width };
    let [luma, u, v] = picture;
    let planes = PlaneSamples::Bytes([plane(luma), plane(u), plane(v)]);
    Yuv { size, origin: (0, 0), depth: 8, chroma: Chroma::Subsampled(1, 1), planes }
}
