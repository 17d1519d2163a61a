//! How each macroblock is predicted (RFC 6386, sections 10, 11, 16 and 17).

use super::bools::Bools;
use super::header::{PersistentState, Vp8Header};
use super::numbers::{
    BLOCK_MODES, DIVISIONS, KEY_BLOCK_MODES, KEY_CHROMA_MODES, KEY_LUMA_MODES, MOTION_KINDS, PART_KINDS,
    VectorProbabilities,
};

/// A motion vector, quarter pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Vector {
    pub x: i32,
    pub y: i32,
}

/// Prediction of a macroblock of luma or chroma from its edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum PredictionMode {
    #[default]
    Mean,
    Vertical,
    Horizontal,
    /// Above and left less the corner ("TrueMotion").
    Gradient,
}

/// Prediction of luma.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Luma {
    /// From the edges, as a whole.
    Whole(PredictionMode),
    /// From the edges, each block of 4 x 4 by its own mode.
    Blocks,
    /// From a reference, with one vector; whether it is stated to be zero.
    Moved { is_zero: bool },
    /// From a reference, each block with its own vector.
    Divided,
}

/// A macroblock.
#[derive(Debug, Clone, Copy)]
pub(super) struct Macroblock {
    pub luma: Luma,
    pub chroma: PredictionMode,
    /// Modes of the blocks, 0 to 9; those of a whole macroblock stand for its mode.
    pub block_modes: [u8; 16],
    /// Vectors of the blocks, zero where it is predicted from its own frame.
    pub vectors: [Vector; 16],
    /// 0 for its own frame, 1 for the last, 2 for the golden, 3 for the alternate one.
    pub reference: usize,
    pub segment: u8,
    /// Whether it has no coefficients.
    pub is_skipped: bool,
}

impl Macroblock {
    /// What lies beyond the frame.
    pub(super) const OUTSIDE: Macroblock = Macroblock {
        luma: Luma::Whole(PredictionMode::Mean),
        chroma: PredictionMode::Mean,
        block_modes: [0; 16],
        vectors: [Vector { x: 0, y: 0 }; 16],
        reference: 0,
        segment: 0,
        is_skipped: false,
    };

    /// Whether the first coefficients of its blocks are transformed once more.
    pub(super) fn has_second(&self) -> bool {
        matches!(self.luma, Luma::Whole(_) | Luma::Moved { .. })
    }

    fn vector(&self) -> Vector {
        self.vectors[15]
    }
}

/// A macroblock's neighbours: above, left, above on the left.
pub(super) struct Neighbours<'a>(pub [&'a Macroblock; 3]);

/// Range of a macroblock's vectors, quarter pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach {
    least: Vector,
    most: Vector,
}

impl Reach {
    /// One macroblock beyond the frame, from a macroblock at a column and row.
    pub(super) fn of(column: usize, row: usize, columns: usize, rows: usize) -> Self {
        let quarter = |macroblocks: usize| 64 * macroblocks as i32;
        Reach {
            least: Vector { x: -quarter(column + 1), y: -quarter(row + 1) },
            most: Vector { x: quarter(columns - column), y: quarter(rows - row) },
        }
    }

    fn clamp(&self, vector: Vector) -> Vector {
        Vector { x: vector.x.clamp(self.least.x, self.most.x), y: vector.y.clamp(self.least.y, self.most.y) }
    }
}

/// Reads the macroblock after those that are its neighbours; `segment` is that of the frame before.
pub(super) fn read(
    bools: &mut Bools,
    (header, lasting, is_key): (&Vp8Header, &PersistentState, bool),
    neighbours: &Neighbours,
    reach: Reach,
    segment: u8,
) -> Macroblock {
    let mut it = Macroblock { segment, ..Macroblock::OUTSIDE };
    if let Some([first, low, high]) = lasting.segments.map {
        it.segment = if bools.bool(first) { 2 + u8::from(bools.bool(high)) } else { u8::from(bools.bool(low)) };
    }
    it.is_skipped = header.skipping.is_some_and(|probability| bools.bool(probability));
    let modes = &lasting.probabilities;
    if is_key {
        key_modes(bools, &mut it, neighbours);
    } else if bools.bool(header.references[0]) {
        it.reference = 1;
        if bools.bool(header.references[1]) {
            it.reference = 2 + usize::from(bools.bool(header.references[2]));
        }
        motion(bools, &mut it, (header, &modes.vectors), neighbours, reach);
    } else {
        it.luma = match modes.luma_modes {
            [first, ..] if !bools.bool(first) => Luma::Whole(PredictionMode::Mean),
            [_, second, third, _] if !bools.bool(second) => {
                Luma::Whole(if bools.bool(third) { PredictionMode::Horizontal } else { PredictionMode::Vertical })
            }
            [.., last] if bools.bool(last) => Luma::Blocks,
            _ => Luma::Whole(PredictionMode::Gradient),
        };
        if it.luma == Luma::Blocks {
            it.block_modes = std::array::from_fn(|_| block_mode(bools, &BLOCK_MODES));
        }
        it.chroma = chroma_mode(bools, modes.chroma_modes);
    }
    it
}

fn key_modes(bools: &mut Bools, it: &mut Macroblock, neighbours: &Neighbours) {
    let [blocks, second, upper, lower] = KEY_LUMA_MODES;
    if !bools.bool(blocks) {
        it.luma = Luma::Blocks;
        let [above, left, _] = neighbours.0;
        for block in 0..16 {
            let above = if block < 4 { above.block_modes[block + 12] } else { it.block_modes[block - 4] };
            let left = if block % 4 == 0 { left.block_modes[block + 3] } else { it.block_modes[block - 1] };
            it.block_modes[block] = block_mode(bools, &KEY_BLOCK_MODES[usize::from(above)][usize::from(left)]);
        }
    } else {
        let mode = match bools.bool(second) {
            false if bools.bool(upper) => PredictionMode::Vertical,
            false => PredictionMode::Mean,
            true if bools.bool(lower) => PredictionMode::Gradient,
            true => PredictionMode::Horizontal,
        };
        it.luma = Luma::Whole(mode);
        // Mean, gradient, vertical, horizontal are the first modes of blocks.
        it.block_modes = [[0, 2, 3, 1][mode as usize]; 16];
    }
    it.chroma = chroma_mode(bools, KEY_CHROMA_MODES);
}

fn chroma_mode(bools: &mut Bools, [first, second, third]: [u8; 3]) -> PredictionMode {
    match () {
        () if !bools.bool(first) => PredictionMode::Mean,
        () if !bools.bool(second) => PredictionMode::Vertical,
        () if !bools.bool(third) => PredictionMode::Horizontal,
        () => PredictionMode::Gradient,
    }
}

/// The mode of a block: mean, gradient, vertical, horizontal, left-down, right-down, vertical-right, vertical-left,
/// horizontal-down, horizontal-up.
fn block_mode(bools: &mut Bools, probabilities: &[u8; 9]) -> u8 {
    let mut is = |node: usize| bools.bool(probabilities[node]);
    match () {
        () if !is(0) => 0,
        () if !is(1) => 1,
        () if !is(2) => 2,
        () if !is(3) => match () {
            () if !is(4) => 3,
            () if !is(5) => 5,
            () => 6,
        },
        () if !is(6) => 4,
        () if !is(7) => 7,
        () if !is(8) => 8,
        () => 9,
    }
}

/// Votes of the neighbours for vectors: for zero, the nearest, the near one, a third.
struct Votes {
    vectors: [Vector; 4],
    counts: [usize; 4],
}

impl Votes {
    fn of(neighbours: &Neighbours, reference: usize, signs: [bool; 2]) -> Self {
        let points_back = |reference: usize| reference >= 2 && signs[reference - 2];
        let mut votes = Votes { vectors: [Vector::default(); 4], counts: [0; 4] };
        let mut last = 0;
        for (neighbour, weight) in neighbours.0.into_iter().zip([2, 2, 1]).filter(|it| it.0.reference > 0) {
            let mut vector = neighbour.vector();
            if vector == Vector::default() {
                votes.counts[0] += weight;
                continue;
            }
            if points_back(neighbour.reference) != points_back(reference) {
                vector = Vector { x: -vector.x, y: -vector.y };
            }
            if last == 0 || vector != votes.vectors[last] {
                last += 1;
                votes.vectors[last] = vector;
            }
            votes.counts[last] += weight;
        }
        // The third may be the first again.
        if votes.counts[3] > 0 && votes.vectors[3] == votes.vectors[1] {
            votes.counts[1] += 1;
        }
        let [above, left, corner] = neighbours.0.map(|it| usize::from(it.luma == Luma::Divided));
        votes.counts[3] = 2 * (above + left) + corner;
        if votes.counts[2] > votes.counts[1] {
            votes.counts.swap(1, 2);
            votes.vectors.swap(1, 2);
        }
        votes
    }
}

fn motion(
    bools: &mut Bools,
    it: &mut Macroblock,
    (header, probabilities): (&Vp8Header, &VectorProbabilities),
    neighbours: &Neighbours,
    reach: Reach,
) {
    let Votes { vectors: [_, nearest, near, _], counts } = Votes::of(neighbours, it.reference, header.signs);
    let best = reach.clamp(if counts[1] >= counts[0] { nearest } else { Vector::default() });
    let mut is = |kind: usize| bools.bool(MOTION_KINDS[counts[kind]][kind]);
    it.luma = Luma::Moved { is_zero: false };
    let vector = match () {
        () if !is(0) => {
            it.luma = Luma::Moved { is_zero: true };
            Vector::default()
        }
        () if !is(1) => reach.clamp(nearest),
        () if !is(2) => reach.clamp(near),
        () if !is(3) => moved(bools, best, probabilities),
        () => {
            it.luma = Luma::Divided;
            divided(bools, it, probabilities, neighbours, best);
            return;
        }
    };
    it.vectors = [vector; 16];
}

fn moved(bools: &mut Bools, from: Vector, probabilities: &VectorProbabilities) -> Vector {
    let y = from.y + component(bools, &probabilities[0]);
    Vector { x: from.x + component(bools, &probabilities[1]), y }
}

/// Probabilities of a component: long, negative, seven of short ones, ten of the bits of long ones.
fn component(bools: &mut Bools, probabilities: &[u8; 19]) -> i32 {
    let [is_long, is_negative, rest @ ..] = probabilities;
    let (short, bits) = rest.split_at(7);
    let size = if bools.bool(*is_long) {
        let mut size = 0;
        for bit in [0, 1, 2, 9, 8, 7, 6, 5, 4] {
            size += i32::from(bools.bool(bits[bit])) << bit;
        }
        // A long one without higher bits has this one.
        if size & 0xfff0 == 0 || bools.bool(bits[3]) { size + 8 } else { size }
    } else {
        let high = usize::from(bools.bool(short[0]));
        let middle = usize::from(bools.bool(short[1 + 3 * high]));
        let low = usize::from(bools.bool(short[2 + 3 * high + middle]));
        (4 * high + 2 * middle + low) as i32
    };
    if size != 0 && bools.bool(*is_negative) { -size } else { size }
}

/// Part of each block, by division: halves one above the other, halves side by side, quarters, blocks.
fn part(division: usize, block: usize) -> usize {
    let (x, y) = (block % 4, block / 4);
    [y / 2, x / 2, y / 2 * 2 + x / 2, block][division]
}

fn divided(
    bools: &mut Bools,
    it: &mut Macroblock,
    probabilities: &VectorProbabilities,
    neighbours: &Neighbours,
    best: Vector,
) {
    let division = match () {
        () if !bools.bool(DIVISIONS[0]) => 3,
        () if !bools.bool(DIVISIONS[1]) => 2,
        () => usize::from(bools.bool(DIVISIONS[2])),
    };
    let parts = [2, 2, 4, 16][division];
    let [above, left, _] = neighbours.0;
    for number in 0..parts {
        let first = (0..16).find(|&block| part(division, block) == number).unwrap_or(0);
        let above = if first < 4 { above.vectors[first + 12] } else { it.vectors[first - 4] };
        let left = if first % 4 == 0 { left.vectors[first + 3] } else { it.vectors[first - 1] };
        let zero = Vector::default();
        let context = match () {
            () if left == above && above == zero => 4,
            () if left == above => 3,
            () if above == zero => 2,
            () if left == zero => 1,
            () => 0,
        };
        let [of_left, of_above, of_zero] = PART_KINDS[context];
        let vector = match () {
            () if !bools.bool(of_left) => left,
            () if !bools.bool(of_above) => above,
            () if !bools.bool(of_zero) => zero,
            () => moved(bools, best, probabilities),
        };
        (0..16).filter(|&block| part(division, block) == number).for_each(|block| it.vectors[block] = vector);
    }
}
