//! Balls on black. Within 1 grey level of the original's skimage.

use crate::generators::film::quantise;
use crate::generators::resize::Resize;
use crate::tasks::scene;

/// The canvas is this many times as large as the frame.
pub(super) const BALL_SCALE: usize = 10;

/// Filled discs on black, of the colours [`scene::colour`]: each of the first three has a
/// channel to itself, as in the original.
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
                fill_disc(&mut canvas, patch_side * BALL_SCALE, y, x, radius, 1.0);
                patch_shrink.apply(&canvas)
            })
            .collect();
        Self { side, channels, radius, shrink: Resize::shrink(side, BALL_SCALE), half, patches }
    }

    /// Draws the discs, at most as many as there are colours.
    pub fn draw(&self, positions: &[[f64; 2]], frame: &mut [u8]) {
        quantise(&self.levels(positions), self.channels, frame);
    }

    /// The same before the levels become grey levels: channel by channel.
    pub fn levels(&self, positions: &[[f64; 2]]) -> Vec<f64> {
        let mut levels = vec![0.0; self.channels * self.side * self.side];
        for (channel, centres) in self.centres_by_channel(positions) {
            let plane = &mut levels[channel * self.side * self.side..][..self.side * self.side];
            // Shrinking is linear: images of discs that do not touch add up.
            if !self.apart(&centres) || !centres.iter().all(|&[x, y]| self.inside(x) && self.inside(y)) {
                plane.copy_from_slice(&self.whole_canvas(&centres));
                continue;
            }
            let last = (self.side * BALL_SCALE) as isize - 1;
            for [x, y] in centres {
                for row in [y, -y, 2 * last - y] {
                    for column in [x, -x, 2 * last - x] {
                        self.stamp(row, column, plane);
                    }
                }
            }
        }
        levels
    }

    /// The same as [`Self::draw`] by drawing and shrinking the whole canvas: slow; what tests compare it with.
    pub fn draw_whole(&self, positions: &[[f64; 2]], frame: &mut [u8]) {
        let mut levels = vec![0.0; self.channels * self.side * self.side];
        for (channel, centres) in self.centres_by_channel(positions) {
            levels[channel * self.side * self.side..][..self.side * self.side]
                .copy_from_slice(&self.whole_canvas(&centres));
        }
        quantise(&levels, self.channels, frame);
    }

    /// The channels in which something shines, with the canvas pixels of the centres of the discs that do.
    fn centres_by_channel(&self, positions: &[[f64; 2]]) -> Vec<(usize, Vec<[isize; 2]>)> {
        let colours: Vec<_> = (0..positions.len()).map_while(|ball| scene::colour(ball, self.channels)).collect();
        let shining = |channel: usize| {
            let discs = positions.iter().zip(&colours).filter(move |(_, colour)| colour[channel] > 0.0);
            discs.map(|(position, _)| position.map(canvas_pixel)).collect::<Vec<_>>()
        };
        let channels = (0..self.channels).map(|channel| (channel, shining(channel)));
        channels.filter(|(_, centres)| !centres.is_empty()).collect()
    }

    /// Whether no two discs touch on the canvas.
    fn apart(&self, centres: &[[isize; 2]]) -> bool {
        let reach = 2 * (self.radius.ceil() as isize + 1);
        let far = |a: &[isize; 2], b: &[isize; 2]| (a[0] - b[0]).abs() > reach || (a[1] - b[1]).abs() > reach;
        centres.iter().enumerate().all(|(place, a)| centres[place + 1..].iter().all(|b| far(a, b)))
    }

    fn whole_canvas(&self, centres: &[[isize; 2]]) -> Vec<f64> {
        let side = self.side * BALL_SCALE;
        let mut canvas = vec![0.0; side * side];
        centres.iter().for_each(|&[x, y]| fill_disc(&mut canvas, side, y, x, self.radius, 1.0));
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

/// Sets the pixels nearer than `radius` to the centre to this value.
pub(super) fn fill_disc(canvas: &mut [f64], side: usize, y: isize, x: isize, radius: f64, value: f64) {
    let reach = radius.ceil() as isize;
    let clip = |centre: isize| (centre - reach).max(0)..(centre + reach + 1).min(side as isize);
    for row in clip(y) {
        for column in clip(x) {
            let (dy, dx) = ((row - y) as f64, (column - x) as f64);
            if dy * dy + dx * dx < radius * radius {
                canvas[row as usize * side + column as usize] = value;
            }
        }
    }
}
