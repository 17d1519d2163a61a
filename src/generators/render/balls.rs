//! Balls on black. Within 1 grey level of the original's skimage.

use super::quantise;
use crate::generators::resize::Resize;

/// The canvas is this many times as large as the frame.
pub(super) const BALL_SCALE: usize = 10;

/// Filled discs on black; disc j has channel 2 - j to itself. With one channel there is one disc, white.
///
/// Shrinking is linear and the same everywhere off the border, so a disc's image depends only on where its centre lies
/// within its pixel: one small image for each of those places is kept. The mirroring border is a second,
/// reflected disc.
#[derive(Debug, Clone)]
pub struct Balls {
    side: usize,
    channels: usize,
    /// Radius on the canvas, canvas pixels.
    radius: f64,
    shrink: Resize,
    /// Pixels from a disc's own pixel to the patch's border.
    half: usize,
    /// The shrunk disc for each (row, column) of the centre within its pixel, `[2 half + 1, 2 half + 1]`.
    patches: Vec<Vec<f64>>,
}

impl Balls {
    /// Discs of `radius` pixels in frames of `side` pixels.
    pub fn new(side: usize, radius: f64, channels: usize) -> Self {
        let radius = radius * BALL_SCALE as f64;
        let blur = 4.0 * (BALL_SCALE as f64 - 1.0) / 2.0;
        let half = ((radius + blur) / BALL_SCALE as f64).ceil() as usize + 1;
        let patch_side = 2 * half + 1;
        let patch_shrink = Resize::shrink(patch_side, BALL_SCALE);
        let patches = (0..BALL_SCALE * BALL_SCALE)
            .map(|place| {
                let mut canvas = vec![0.0; (patch_side * BALL_SCALE).pow(2)];
                let centre = |offset: usize| (half * BALL_SCALE + offset) as isize;
                let (y, x) = (centre(place / BALL_SCALE), centre(place % BALL_SCALE));
                fill_disc(&mut canvas, patch_side * BALL_SCALE, y, x, radius);
                patch_shrink.apply(&canvas)
            })
            .collect();
        Self { side, channels, radius, shrink: Resize::shrink(side, BALL_SCALE), half, patches }
    }

    /// Draws at most as many discs as there are channels.
    pub fn draw(&self, positions: &[[f64; 2]], frame: &mut [u8]) {
        for (channel, centre) in self.channels_and_centres(positions, frame) {
            let [x, y] = centre;
            if !(self.inside(x) && self.inside(y)) {
                quantise(&self.whole_canvas(x, y), channel, self.channels, frame);
                continue;
            }
            let mut plane = vec![0.0; self.side * self.side];
            let last = (self.side * BALL_SCALE) as isize - 1;
            for row in [y, -y, 2 * last - y] {
                for column in [x, -x, 2 * last - x] {
                    self.stamp(row, column, &mut plane);
                }
            }
            quantise(&plane, channel, self.channels, frame);
        }
    }

    /// The same by drawing and shrinking the whole canvas: slow; what tests compare [`Self::draw`] with.
    pub fn draw_whole(&self, positions: &[[f64; 2]], frame: &mut [u8]) {
        for (channel, [x, y]) in self.channels_and_centres(positions, frame) {
            quantise(&self.whole_canvas(x, y), channel, self.channels, frame);
        }
    }

    /// Makes the frame black. Each disc's channel and the canvas pixel of its centre.
    fn channels_and_centres(&self, positions: &[[f64; 2]], frame: &mut [u8]) -> Vec<(usize, [isize; 2])> {
        frame.fill(0);
        let channels = (0..self.channels).rev();
        channels.zip(positions).map(|(channel, position)| (channel, position.map(canvas_pixel))).collect()
    }

    fn whole_canvas(&self, x: isize, y: isize) -> Vec<f64> {
        let side = self.side * BALL_SCALE;
        let mut canvas = vec![0.0; side * side];
        fill_disc(&mut canvas, side, y, x, self.radius);
        self.shrink.apply(&canvas)
    }

    /// Whether a disc at this coordinate stays off the border pixels. There, the disc and its mirror image overlap and
    /// do not add up. A frame smaller than a patch would need mirror images of mirror images.
    fn inside(&self, centre: isize) -> bool {
        let reach = self.radius.ceil() as isize;
        let last = (self.side * BALL_SCALE) as isize - 1;
        self.side > 2 * self.half && centre >= reach && centre + reach <= last
    }

    /// Adds the image of a disc centred at this canvas pixel, which may lie outside.
    fn stamp(&self, row: isize, column: isize, plane: &mut [f64]) {
        let scale = BALL_SCALE as isize;
        let (half, side) = (self.half as isize, self.side as isize);
        let patch_side = 2 * self.half + 1;
        let (top, left) = (row.div_euclid(scale) - half, column.div_euclid(scale) - half);
        let place = row.rem_euclid(scale) * scale + column.rem_euclid(scale);
        let patch = &self.patches[place as usize];
        let rows = top.max(0)..(top + patch_side as isize).min(side);
        let columns = left.max(0)..(left + patch_side as isize).min(side);
        if columns.is_empty() {
            return;
        }
        for y in rows {
            let from = (y - top) as usize * patch_side + (columns.start - left) as usize;
            let to = (y * side + columns.start) as usize;
            let width = (columns.end - columns.start) as usize;
            for (sum, value) in plane[to..to + width].iter_mut().zip(&patch[from..from + width]) {
                *sum += value;
            }
        }
    }
}

/// Canvas pixel of a ball's centre.
pub(super) fn canvas_pixel(position: f64) -> isize {
    (position * BALL_SCALE as f64) as isize
}

/// Sets the pixels nearer than `radius` to the centre.
pub(super) fn fill_disc(canvas: &mut [f64], side: usize, y: isize, x: isize, radius: f64) {
    let reach = radius.ceil() as isize;
    let clip = |centre: isize| (centre - reach).max(0)..(centre + reach + 1).min(side as isize);
    for row in clip(y) {
        for column in clip(x) {
            let (dy, dx) = ((row - y) as f64, (column - x) as f64);
            if dy * dy + dx * dx < radius * radius {
                canvas[row as usize * side + column as usize] = 1.0;
            }
        }
    }
}
