//! A plane of whole macroblocks.

/// Samples in row order.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Vp8Plane {
    pub width: usize,
    pub height: usize,
    pub levels: Vec<u8>,
}

impl Vp8Plane {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Vp8Plane { width, height, levels: vec![0; width * height] }
    }

    pub(super) fn at(&self, x: usize, y: usize) -> u8 {
        self.levels[y * self.width + x]
    }

    /// A level within the plane or the nearest one to a place beyond it.
    pub(super) fn nearest(&self, x: i32, y: i32) -> u8 {
        let inside = |place: i32, side: usize| place.clamp(0, side as i32 - 1) as usize;
        self.at(inside(x, self.width), inside(y, self.height))
    }

    /// Writes a square from a place on.
    pub(super) fn put(&mut self, (x, y): (usize, usize), side: usize, levels: &[u8]) {
        for (row, levels) in levels.chunks_exact(side).enumerate() {
            let place = (y + row) * self.width + x;
            self.levels[place..place + side].copy_from_slice(levels);
        }
    }

    /// Adds the differences of a block of 4 x 4.
    pub(super) fn add(&mut self, (x, y): (usize, usize), differences: &[i32; 16]) {
        for (row, differences) in differences.chunks_exact(4).enumerate() {
            let place = (y + row) * self.width + x;
            for (level, difference) in self.levels[place..place + 4].iter_mut().zip(differences) {
                *level = (i32::from(*level) + difference).clamp(0, 255) as u8;
            }
        }
    }
}

/// Luma and both chroma planes.
pub(super) type Vp8Picture = [Vp8Plane; 3];
