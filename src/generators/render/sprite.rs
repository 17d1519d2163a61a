//! What is laid over a background: a small opaque picture on a canvas that is several times as fine as the frame.

use super::balls::fill_disc;
use crate::generators::resize::Resize;
use crate::generators::source_images::DIGIT_SIDE;
use crate::tasks::looks::Half;
use crate::tasks::scene::DIGIT_RADIUS;

/// Where a sprite lies on the canvas.
#[derive(Debug, Clone, Copy)]
enum Anchor {
    /// A disc's middle is the canvas pixel in which its position lies.
    Middle,
    /// A digit's corner is rounded to a canvas pixel, as in the original.
    Corner,
}

/// A square picture with opacities, in canvas pixels.
#[derive(Debug, Clone)]
pub struct Sprite {
    pub(super) side: usize,
    /// Canvas pixels in a pixel of the frame.
    scale: usize,
    /// 0..1, row by row.
    pub(super) opacity: Vec<f64>,
    /// 0..1, channel by channel, row by row.
    pub(super) ink: Vec<Vec<f64>>,
    anchor: Anchor,
}

/// How one ball looks.
#[derive(Debug, Clone)]
pub struct Disc<'a> {
    /// Pixels of the frame.
    pub radius: f64,
    /// 0..1 in each channel.
    pub colour: &'a [f64],
    /// How much darker it is at its lower right edge than at its upper left one, 0..1.
    pub shading: f64,
    pub half: Option<&'a Half>,
}

impl Sprite {
    /// A filled disc.
    pub fn disc(disc: &Disc, scale: usize) -> Self {
        let radius = disc.radius * scale as f64;
        let reach = radius.ceil() as usize;
        let side = 2 * reach + 1;
        let mut opacity = vec![0.0; side * side];
        fill_disc(&mut opacity, side, reach as isize, reach as isize, radius, 1.0);
        // From the middle, in radii.
        let along = |pixel: usize| (pixel as f64 - reach as f64) / radius;
        let level = |channel: usize, x: f64, y: f64| {
            let on_half =
                |half: &&Half| x * half.towards.to_radians().cos() + y * half.towards.to_radians().sin() > 0.0;
            let colour = disc.half.filter(on_half).map_or(disc.colour, |half| &half.colour);
            let away_from_light = (x + y) * std::f64::consts::FRAC_1_SQRT_2;
            colour[channel] * (1.0 - disc.shading * (1.0 + away_from_light) / 2.0).clamp(0.0, 1.0)
        };
        let plane = |channel| (0..side * side).map(|at| level(channel, along(at % side), along(at / side))).collect();
        let ink = (0..disc.colour.len()).map(plane).collect();
        Self { side, scale, opacity, ink, anchor: Anchor::Middle }
    }

    /// An MNIST digit, `[28, 28]` of 0..1, that shines in one of three channels; its border is cut off.
    pub fn digit(pixels: &[f64], channel: usize, scale: usize) -> Self {
        let kept = 2 * DIGIT_RADIUS as usize;
        let border = (DIGIT_SIDE - kept) / 2;
        let rows = pixels.chunks_exact(DIGIT_SIDE).skip(border).take(kept);
        let middle: Vec<f64> = rows.flat_map(|row| &row[border..border + kept]).copied().collect();
        let side = kept * scale;
        let opacity = Resize::enlarge(kept, side).apply(&middle);
        let ink = (0..3).map(|other| vec![f64::from(other == channel); side * side]).collect();
        Self { side, scale, opacity, ink, anchor: Anchor::Corner }
    }

    /// First canvas row or column at a position in the frame; negative where the sprite hangs over the border.
    pub(super) fn start(&self, position: f64) -> isize {
        let scale = self.scale as f64;
        match self.anchor {
            Anchor::Middle => (position * scale) as isize - (self.side / 2) as isize,
            Anchor::Corner => ((position - DIGIT_RADIUS) * scale).round_ties_even() as isize,
        }
    }
}
