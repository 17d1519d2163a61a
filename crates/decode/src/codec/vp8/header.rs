//! The header of a frame (RFC 6386, sections 9 and 19.2).

use super::bools::Bools;
use super::numbers::{
    AC_STEPS, CHROMA_MODES, DC_STEPS, LUMA_MODES, TOKEN_UPDATES, TOKENS, TokenProbabilities, VECTOR_UPDATES, VECTORS,
    VectorProbabilities,
};
use crate::error::{DecodeError, Result};
use crate::limits::check_size;

/// The first bytes of a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tag {
    pub is_key: bool,
    pub version: u8,
    pub is_shown: bool,
    /// Bytes of the first partition.
    pub first_partition: usize,
    /// Size of a key frame, pixels.
    pub size: Option<(u32, u32)>,
    /// Bytes of the tag.
    pub length: usize,
}

impl Tag {
    pub(super) fn read(packet: &[u8]) -> Result<Self> {
        let short = || DecodeError::corrupt("VP8: a frame ends within its header");
        let [a, b, c] = *packet.first_chunk().ok_or_else(short)?;
        let bits = u32::from(a) | u32::from(b) << 8 | u32::from(c) << 16;
        let mut tag = Tag {
            is_key: bits & 1 == 0,
            version: (bits >> 1 & 7) as u8,
            is_shown: bits >> 4 & 1 == 1,
            first_partition: (bits >> 5) as usize,
            size: None,
            length: 3,
        };
        if tag.is_key {
            let [_, _, _, start @ .., w0, w1, h0, h1]: [u8; 10] = *packet.first_chunk().ok_or_else(short)?;
            if start != [0x9d, 0x01, 0x2a] {
                return Err(DecodeError::corrupt("VP8: a key frame has no start code"));
            }
            // The two highest bits scale the picture where it is shown.
            let side = |low: u8, high: u8| u32::from(u16::from_le_bytes([low, high]) & 0x3fff);
            let size = (side(w0, w1), side(h0, h1));
            check_size(size.0, size.1)?;
            (tag.size, tag.length) = (Some(size), 10);
        }
        Ok(tag)
    }
}

/// Probabilities that stay from frame to frame.
#[derive(Debug, Clone)]
pub(super) struct Probabilities {
    pub tokens: TokenProbabilities,
    pub luma_modes: [u8; 4],
    pub chroma_modes: [u8; 3],
    pub vectors: VectorProbabilities,
}

impl Default for Probabilities {
    fn default() -> Self {
        Probabilities { tokens: TOKENS, luma_modes: LUMA_MODES, chroma_modes: CHROMA_MODES, vectors: VECTORS }
    }
}

/// Values by segment that stay from frame to frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Segments {
    pub are_enabled: bool,
    /// Whether the values replace the frame's or are added to them.
    are_absolute: bool,
    quantizers: [i32; 4],
    filter_levels: [i32; 4],
    /// Probabilities of the map, if this frame has one.
    pub map: Option<[u8; 3]>,
}

impl Segments {
    fn read(&mut self, bools: &mut Bools) {
        self.map = None;
        self.are_enabled = bools.flag();
        if !self.are_enabled {
            return;
        }
        let (has_map, has_values) = (bools.flag(), bools.flag());
        if has_values {
            self.are_absolute = bools.flag();
            self.quantizers = std::array::from_fn(|_| bools.delta(7));
            self.filter_levels = std::array::from_fn(|_| bools.delta(6));
        }
        if has_map {
            let mut probability = || if bools.flag() { bools.number(8) as u8 } else { 255 };
            self.map = Some([probability(), probability(), probability()]);
        }
    }

    fn value(&self, of_frame: i32, values: &[i32; 4], segment: u8) -> i32 {
        let value = values[usize::from(segment)];
        match (self.are_enabled, self.are_absolute) {
            (false, _) => of_frame,
            (true, true) => value,
            (true, false) => of_frame + value,
        }
    }
}

/// Settings of the loop filter.
#[derive(Debug, Clone, Default)]
pub(super) struct FilterSettings {
    pub is_simple: bool,
    pub level: i32,
    pub sharpness: i32,
    deltas_are_enabled: bool,
    /// Added by reference frame and by kind of prediction; they stay from frame to frame.
    by_reference: [i32; 4],
    by_kind: [i32; 4],
}

impl FilterSettings {
    fn read(&mut self, bools: &mut Bools) {
        self.is_simple = bools.flag();
        self.level = bools.number(6);
        self.sharpness = bools.number(3);
        self.deltas_are_enabled = bools.flag();
        if self.deltas_are_enabled && bools.flag() {
            for delta in self.by_reference.iter_mut().chain(&mut self.by_kind) {
                *delta = bools.optional(6).unwrap_or(*delta);
            }
        }
    }

    /// The level of a macroblock: `kind` is the place of its delta, none where there is none.
    pub(super) fn level(&self, segments: &Segments, segment: u8, reference: usize, kind: Option<usize>) -> i32 {
        let level = segments.value(self.level, &segments.filter_levels, segment).clamp(0, 63);
        if !self.deltas_are_enabled {
            return level;
        }
        (level + self.by_reference[reference] + kind.map_or(0, |kind| self.by_kind[kind])).clamp(0, 63)
    }
}

/// Steps of the quantizers: of first and other coefficients.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Steps {
    pub luma: [i32; 2],
    /// Of the first coefficients of luma, transformed once more.
    pub second: [i32; 2],
    pub chroma: [i32; 2],
}

/// Which frame replaces a reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ReferenceUpdate {
    Keep,
    Current,
    Last,
    /// The golden frame for the alternate one, and the other way round.
    Other,
}

/// What a frame's header states, beyond what stays from frame to frame.
#[derive(Debug)]
pub(super) struct Vp8Header {
    /// By segment.
    pub steps: [Steps; 4],
    pub partitions: usize,
    pub golden: ReferenceUpdate,
    pub alternate: ReferenceUpdate,
    pub is_last: bool,
    /// Whether vectors to the golden and to the alternate frame point the other way in time.
    pub signs: [bool; 2],
    /// Probability that a macroblock has coefficients, where that is stated for each.
    pub skipping: Option<u8>,
    /// Probabilities that a macroblock is predicted from its own frame, the last, the golden one.
    pub references: [u8; 3],
}

/// What stays from frame to frame.
#[derive(Debug, Clone, Default)]
pub(super) struct PersistentState {
    pub probabilities: Probabilities,
    /// Those to return to after a frame whose own do not stay.
    pub saved: Option<Probabilities>,
    pub segments: Segments,
    pub filter: FilterSettings,
    signs: [bool; 2],
}

impl PersistentState {
    /// Reads the header of a frame from the first partition.
    pub(super) fn read(&mut self, bools: &mut Bools, is_key: bool) -> Vp8Header {
        if is_key {
            *self = PersistentState::default();
            // Colour space and clamping: levels are clamped in any case.
            bools.number(2);
        }
        self.segments.read(bools);
        self.filter.read(bools);
        let partitions = 1 << bools.number(2);
        let steps = self.steps(bools);
        let (mut golden, mut alternate) = (ReferenceUpdate::Current, ReferenceUpdate::Current);
        if !is_key {
            let update = |code: i32| {
                [ReferenceUpdate::Keep, ReferenceUpdate::Last, ReferenceUpdate::Other, ReferenceUpdate::Keep]
                    [code as usize]
            };
            let (golden_is_current, alternate_is_current) = (bools.flag(), bools.flag());
            if !golden_is_current {
                golden = update(bools.number(2));
            }
            if !alternate_is_current {
                alternate = update(bools.number(2));
            }
            self.signs = [bools.flag(), bools.flag()];
        }
        self.saved = (!bools.flag()).then(|| self.probabilities.clone());
        let is_last = is_key || bools.flag();
        self.update_tokens(bools);
        let skipping = bools.flag().then(|| bools.number(8) as u8);
        let references = if is_key { [0; 3] } else { self.update_modes(bools) };
        let signs = self.signs;
        Vp8Header { steps, partitions, golden, alternate, is_last, signs, skipping, references }
    }

    fn steps(&self, bools: &mut Bools) -> [Steps; 4] {
        let index = bools.number(7);
        let deltas: [i32; 5] = std::array::from_fn(|_| bools.delta(4));
        std::array::from_fn(|segment| {
            let index = self.segments.value(index, &self.segments.quantizers, segment as u8).clamp(0, 127);
            let step = |steps: &[i32; 128], delta: i32| steps[(index + delta).clamp(0, 127) as usize];
            Steps {
                luma: [step(&DC_STEPS, deltas[0]), step(&AC_STEPS, 0)],
                second: [2 * step(&DC_STEPS, deltas[1]), (step(&AC_STEPS, deltas[2]) * 155 / 100).max(8)],
                chroma: [step(&DC_STEPS, deltas[3]).min(132), step(&AC_STEPS, deltas[4])],
            }
        })
    }

    fn update_tokens(&mut self, bools: &mut Bools) {
        let flat = |it: &TokenProbabilities| it.as_flattened().as_flattened().as_flattened().to_vec();
        let places = self.probabilities.tokens.as_flattened_mut().as_flattened_mut().as_flattened_mut();
        for (place, update) in places.iter_mut().zip(flat(&TOKEN_UPDATES)) {
            if bools.bool(update) {
                *place = bools.number(8) as u8;
            }
        }
    }

    fn update_modes(&mut self, bools: &mut Bools) -> [u8; 3] {
        let mut probability = || bools.number(8) as u8;
        let references = [probability(), probability(), probability()];
        if bools.flag() {
            self.probabilities.luma_modes = std::array::from_fn(|_| bools.number(8) as u8);
        }
        if bools.flag() {
            self.probabilities.chroma_modes = std::array::from_fn(|_| bools.number(8) as u8);
        }
        let places = self.probabilities.vectors.as_flattened_mut().iter_mut();
        for (place, update) in places.zip(VECTOR_UPDATES.as_flattened()) {
            if bools.bool(*update) {
                let number = bools.number(7) as u8;
                *place = if number == 0 { 1 } else { number << 1 };
            }
        }
        references
    }
}
