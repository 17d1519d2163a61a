//! Pictures of a block of frames: `[channel][y][x][frame]`, with a border of one pixel of zeros around each channel.
//!
//! The frames of a block stand side by side, one in each lane of a vector, so that every operation on pictures is an
//! operation on whole vectors at any resolution, and the border is a convolution's zero padding.

use super::simd::{Instructions, Lanes};

/// A cache line: what planes are aligned to.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct CacheLine([f32; 16]);

/// Planes that own their memory. The border stays zero: nothing writes there.
#[derive(Debug)]
pub struct OwnedPlanes {
    lines: Vec<CacheLine>,
    pub channels: usize,
    pub side: usize,
    /// Floats of one channel.
    plane: usize,
}

impl OwnedPlanes {
    pub fn zeros(instructions: Instructions, channels: usize, side: usize) -> Self {
        let plane = (side + 2) * (side + 2) * instructions.lanes();
        OwnedPlanes { lines: vec![CacheLine([0.0; 16]); (channels * plane).div_ceil(16)], channels, side, plane }
    }

    pub fn all(&self) -> Planes<'_> {
        // SAFETY: a `CacheLine` is 16 floats without padding.
        let floats = unsafe { std::slice::from_raw_parts(self.lines.as_ptr().cast(), self.lines.len() * 16) };
        Planes { data: &floats[..self.channels * self.plane], channels: self.channels, side: self.side }
    }

    pub fn all_mut(&mut self) -> PlanesMut<'_> {
        self.part_mut(0, self.channels)
    }

    /// Some of the channels.
    pub fn part(&self, first: usize, channels: usize) -> Planes<'_> {
        self.all().part(first, channels)
    }

    pub fn part_mut(&mut self, first: usize, channels: usize) -> PlanesMut<'_> {
        // SAFETY: as above.
        let floats = unsafe { std::slice::from_raw_parts_mut(self.lines.as_mut_ptr().cast(), self.lines.len() * 16) };
        PlanesMut { data: &mut floats[first * self.plane..(first + channels) * self.plane], channels, side: self.side }
    }
}

/// Memory for what an operation does not keep, aligned as planes are. It grows when it must, and is not cleared.
#[derive(Debug, Default)]
pub struct Workspace(Vec<CacheLine>);

impl Workspace {
    /// Parts of so many floats.
    pub fn parts<const N: usize>(&mut self, floats: [usize; N]) -> [&mut [f32]; N] {
        let whole = floats.map(|count| count.next_multiple_of(16));
        let mut rest = self.floats(whole.iter().sum());
        whole.map(|count| rest.split_off_mut(..count).expect("as many floats as were asked for"))
    }

    fn floats(&mut self, count: usize) -> &mut [f32] {
        let lines = count.div_ceil(16);
        if self.0.len() < lines {
            self.0.resize(lines, CacheLine([0.0; 16]));
        }
        // SAFETY: a `CacheLine` is 16 floats without padding.
        unsafe { std::slice::from_raw_parts_mut(self.0.as_mut_ptr().cast(), count) }
    }
}

/// Channels of a block of frames.
#[derive(Debug, Clone, Copy)]
pub struct Planes<'a> {
    pub data: &'a [f32],
    pub channels: usize,
    pub side: usize,
}

#[derive(Debug)]
pub struct PlanesMut<'a> {
    pub data: &'a mut [f32],
    pub channels: usize,
    pub side: usize,
}

impl<'a> Planes<'a> {
    /// Some of the channels.
    pub fn part(&self, first: usize, channels: usize) -> Self {
        let plane = self.data.len() / self.channels;
        Planes { data: &self.data[first * plane..(first + channels) * plane], channels, side: self.side }
    }
}

impl Planes<'_> {
    /// Floats from one row to the next.
    #[inline(always)]
    pub fn row<L: Lanes>(&self) -> usize {
        (self.side + 2) * L::LANES
    }

    /// Floats from one channel to the next.
    #[inline(always)]
    pub fn plane<L: Lanes>(&self) -> usize {
        (self.side + 2) * self.row::<L>()
    }

    /// The number of a pixel's first float.
    #[inline(always)]
    pub fn place<L: Lanes>(&self, channel: usize, y: usize, x: usize) -> usize {
        channel * self.plane::<L>() + (y + 1) * self.row::<L>() + (x + 1) * L::LANES
    }

    /// Where a pixel of a channel stands.
    ///
    /// # Safety
    /// A pixel that is there, of planes made for these lanes.
    #[inline(always)]
    pub unsafe fn at<L: Lanes>(&self, channel: usize, y: usize, x: usize) -> *const f32 {
        unsafe { self.data.as_ptr().add(self.place::<L>(channel, y, x)) }
    }

    /// # Panics
    /// Planes that were made for other instructions.
    #[inline(always)]
    pub fn check<L: Lanes>(&self) {
        assert_eq!(self.data.len(), self.channels * self.plane::<L>(), "planes for other lanes");
    }
}

/// The numbers of all pixels' first floats, `[channel][y][x]`, without end.
#[derive(Debug)]
pub struct PixelPlaces {
    side: usize,
    lanes: usize,
    y: usize,
    x: usize,
    place: usize,
}

impl PixelPlaces {
    #[inline(always)]
    pub fn new<L: Lanes>(side: usize) -> Self {
        PixelPlaces { side, lanes: L::LANES, y: 0, x: 0, place: (side + 3) * L::LANES }
    }

    /// The number of this pixel's first float; goes on to the next pixel.
    #[inline(always)]
    pub fn advance(&mut self) -> usize {
        let place = self.place;
        self.place += self.lanes;
        self.x += 1;
        if self.x == self.side {
            // Over the border to the right and that to the left.
            self.place += 2 * self.lanes;
            (self.x, self.y) = (0, self.y + 1);
        }
        if self.y == self.side {
            // And over that below and that above.
            self.place += 2 * (self.side + 2) * self.lanes;
            self.y = 0;
        }
        place
    }
}

impl PlanesMut<'_> {
    #[inline(always)]
    pub fn check<L: Lanes>(&self) {
        self.as_ref().check::<L>();
    }

    /// Where a pixel of a channel stands.
    ///
    /// # Safety
    /// A pixel that is there, of planes made for these lanes.
    #[inline(always)]
    pub unsafe fn at_mut<L: Lanes>(&mut self, channel: usize, y: usize, x: usize) -> *mut f32 {
        let (row, plane) = (self.as_ref().row::<L>(), self.as_ref().plane::<L>());
        unsafe { self.data.as_mut_ptr().add(channel * plane + (y + 1) * row + (x + 1) * L::LANES) }
    }

    #[inline(always)]
    pub fn as_ref(&self) -> Planes<'_> {
        Planes { data: self.data, channels: self.channels, side: self.side }
    }
}
