//! Coordinate-consistent decoder: each object's learned sprite is moved to its position by a spatial transformer, and
//! the sprites are composed over a learned background.
//!
//! Original: `conv_st_decoder`; paper: section 3.3 and figure 4.

use tch::nn::Path;
use tch::{Kind, Tensor};

use super::super::{BACKGROUND_LOGIT, ModelOptions};
use super::{Rendering, Sprites};
use crate::network::System;
use crate::network::blocks::{Layers, VariableFromNetwork};
use crate::network::cells::Coordinates;
use crate::network::stn;
use paig_kernels::{Kernels, SceneSizes, compose, draw, sample_separable};

/// Of what the fainter of two objects draws, the share below which a difference between them is none.
const TWINS: f64 = 0.1;

/// Added to a template before it is moved and taken off again after, so that outside its window it is -5.
const OUTSIDE: f64 = 5.0;

/// Kept from 0 and 1 under the logit by colours and masks that sprites begin at.
const LEAST_SHARE: f64 = 0.005;

/// Learned sprites and the way they are drawn.
#[derive(Debug)]
pub struct CoordinateConsistent {
    log_sigma: Tensor,
    template: VariableFromNetwork,
    contents: VariableFromNetwork,
    background: VariableFromNetwork,
    coordinates: Coordinates,
    /// Of the frames that are drawn.
    side: usize,
    /// The middle of the frame on an axis, in the unit of positions.
    middle: f64,
    objects: i64,
    channels: usize,
    /// Distance, in that unit, by which a sprite is moved by half the frame that is drawn; see
    /// [`super::super::ModelOptions::exact_shift`].
    half_span: f64,
    kernels: Kernels,
}

impl Sprites {
    /// What is moved, `[objects, 1 + channels, S/2, S/2]`: mask logits, raised so that 0 is outside, and colours.
    fn layers(&self) -> Tensor {
        Tensor::cat(&[&self.template + OUTSIDE, self.contents.sigmoid()], 1)
    }
}

impl CoordinateConsistent {
    pub fn new(scope: Path, system: &System, options: &ModelOptions) -> Self {
        let (objects, channels, side) = (system.objects as i64, system.channels as i64, system.given_side() as i64);
        let window = side / 2;
        let log_sigma = scope.zeros("logsigma", &[]);
        let mut layers = Layers::new(scope);
        CoordinateConsistent {
            log_sigma,
            // Channels last, as the original stores them.
            template: VariableFromNetwork::new(&mut layers, &[objects, window, window, 1]),
            contents: VariableFromNetwork::new(&mut layers, &[objects, window, window, channels]),
            background: VariableFromNetwork::new(&mut layers, &[1, side, side, channels]),
            coordinates: system.cell.coordinates,
            side: system.given_side(),
            middle: system.side as f64 / 2.0,
            objects,
            channels: system.channels,
            half_span: system.given_pixel() * (side - 1) as f64 / 2.0 / options.pixels_per_unit(system),
            kernels: options.kernels,
        }
    }

    /// The same decoder as a constant: gradients pass through it to the positions, not to what it has learned.
    pub(crate) fn detached(&self) -> Self {
        CoordinateConsistent {
            log_sigma: self.log_sigma.detach(),
            template: self.template.detached(),
            contents: self.contents.detached(),
            background: self.background.detached(),
            ..*self
        }
    }

    /// The learned sprites and background.
    pub fn sprites(&self) -> Sprites {
        Sprites {
            template: channels_first(&self.template.value()),
            contents: channels_first(&self.contents.value()),
            background: self.background(),
        }
    }

    /// The learned background, `[1, channels, S, S]`.
    pub fn background(&self) -> Tensor {
        channels_first(&self.background.value()).sigmoid()
    }

    /// How unlike the objects look: the squared error, summed over a frame, of drawing each in the place of each other before
    /// the background's mean colour.
    pub fn unlike(&self) -> Vec<Vec<f64>> {
        let (drawn, area) = self.looks();
        let error = |a: i64, b: i64| squared_norm(&(drawn.get(a) - drawn.get(b))) * area;
        (0..self.objects).map(|a| (0..self.objects).map(|b| error(a, b)).collect()).collect()
    }

    /// For each object the first that looks like it, itself where it is the first: in each other's place they are an error
    /// that is small beside drawing neither.
    pub(crate) fn twins(&self) -> Vec<usize> {
        let (drawn, _) = self.looks();
        let alike = |a: usize, b: usize| {
            let drawn = [a, b].map(|object| drawn.get(object as i64));
            let least = drawn.each_ref().map(squared_norm).into_iter().fold(f64::INFINITY, f64::min);
            squared_norm(&(&drawn[0] - &drawn[1])) < TWINS * least
        };
        (0..self.objects as usize).map(|b| (0..b).find(|&a| alike(a, b)).unwrap_or(b)).collect()
    }

    /// What each object adds to the background's mean colour, `[objects, channels, S/2, S/2]`, and how many pixels of a frame
    /// one of a template covers.
    fn looks(&self) -> (Tensor, f64) {
        let _guard = tch::no_grad_guard();
        let sprites = self.sprites();
        let visible = (sprites.template - BACKGROUND_LOGIT).sigmoid();
        let behind = sprites.background.mean_dim([2i64, 3].as_slice(), true, None);
        let drawn = &visible * (sprites.contents.sigmoid() - behind);
        (drawn, (2.0 / self.log_sigma.double_value(&[]).exp()).powi(2))
    }

    /// Begins the background at these logits, `[channels, S, S]`, its network's kernel scaled by `kernel`.
    pub fn start_background(&self, logits: &Tensor, kernel: f64) {
        self.background.start_at(&logits.permute([1, 2, 0]), kernel);
    }

    /// Begins every template as a Gaussian bump from `-height` at the window's edge to `height` at its centre; `width` is
    /// its standard deviation in half windows.
    pub fn start_templates(&self, height: f64, width: f64) {
        let window = self.side as i64 / 2;
        let line = Tensor::linspace(-1.0, 1.0, window, (self.log_sigma.kind(), self.log_sigma.device()));
        let squared = line.square().unsqueeze(0) + line.square().unsqueeze(1);
        let bump = ((squared / (-2.0 * width * width)).exp() * 2.0 - 1.0) * height;
        self.template.start_at(&bump.repeat([self.objects, 1, 1]), 1.0);
    }

    /// Begins the sprites at masks `visible` (`[objects, S/2, S/2]`) and `colours` (`[objects, channels, S/2, S/2]`), both in
    /// \[0, 1\], on windows that reach `reach` pixels of the frame to each side; the networks' kernels are scaled by `kernel`.
    pub fn start_sprites(&self, visible: &Tensor, colours: &Tensor, reach: f64, kernel: f64) {
        let _guard = tch::no_grad_guard();
        let logit = |x: &Tensor| x.clamp(LEAST_SHARE, 1.0 - LEAST_SHARE).logit(None::<f64>);
        self.template.start_at(&(logit(visible) + BACKGROUND_LOGIT), kernel);
        self.contents.start_at(&logit(colours).permute([0, 2, 3, 1]), kernel);
        // A window at scale 1 reaches all over the frame.
        let _ = self.log_sigma.shallow_clone().fill_((self.half_span / reach).ln());
    }

    /// Begins the sprites as those of a decoder of halved frames.
    pub fn begin_as(&self, coarse: &Self) {
        let _guard = tch::no_grad_guard();
        let window = self.side as i64 / 2;
        let doubled = |values: &Tensor| {
            // [objects, row, column, layer, column of the kernel]
            let layers = values.flatten(3, 4).permute([0, 3, 1, 2]);
            let enlarged = layers.upsample_bilinear2d([window, window], true, None, None).permute([0, 2, 3, 1]);
            enlarged.reshape([self.objects, window, window, values.size()[3], -1])
        };
        self.template.begin_as(&coarse.template, doubled);
        self.contents.begin_as(&coarse.contents, doubled);
        // A window reaches as far in the frame.
        let reaches = (self.half_span / coarse.half_span).ln();
        self.log_sigma.shallow_clone().copy_(&(&coarse.log_sigma + reaches));
    }

    /// Shifts each object's sprite in its window by `offsets` (`[2 * objects]`, pixels of the frame), so that it is drawn
    /// where it was when its position loses as much.
    pub(crate) fn shift_sprites(&self, offsets: &Tensor) {
        let _guard = tch::no_grad_guard();
        let window = self.side as i64 / 2;
        // Pixels of the window for one unit of position: the slope of the spatial transformer's map.
        let scale = self.log_sigma.exp() * (stn::pixel_scale(window) / self.half_span);
        let shifts = (offsets * scale).reshape([self.objects, 2]);
        let columns = stn::shift_matrices(&shifts.select(1, 0), window);
        let rows = stn::shift_matrices(&shifts.select(1, 1), window);
        let shift = |values: &Tensor| {
            // [objects, row, column, rest]
            let by_row = rows.bmm(&values.flatten(2, -1)).reshape(values.size());
            let turned = by_row.transpose(1, 2);
            columns.bmm(&turned.flatten(2, -1)).reshape(turned.size()).transpose(1, 2)
        };
        self.template.map(shift);
        self.contents.map(shift);
    }

    /// Gives the sprites another order: the one that was `order[i]` (`[objects]`) is i from now on.
    pub fn reorder(&self, order: &Tensor) {
        self.template.map(|values| values.index_select(0, order));
        self.contents.map(|values| values.index_select(0, order));
    }

    /// Draws the objects at `positions`, `[frames, coordinates * objects]`.
    pub fn forward(&self, positions: &Tensor) -> Rendering {
        let sprites = self.sprites();
        self.compose(&self.moved(&sprites.layers(), positions), &sprites.background)
    }

    /// See [`super::Decoder::with_derivative`]: differences of the moved sprites, composed by the derivative of the softmax.
    pub(crate) fn with_derivative(&self, positions: &Tensor, probe: f64) -> (Tensor, Tensor) {
        let _guard = tch::no_grad_guard();
        let sprites = self.sprites();
        let layers = sprites.layers();
        let drawn = self.compose(&self.moved(&layers, positions), &sprites.background);
        let visible = drawn.masks.narrow(0, 0, self.objects).unsqueeze(2);
        let stands_out = &drawn.contents - drawn.frames.unsqueeze(0);
        let axes = positions.size()[1] / self.objects;
        let along = |axis: i64| {
            let one = Tensor::arange(positions.size()[1], (Kind::Int64, positions.device())).remainder(axes).eq(axis);
            let probe_of_axis = one.to_kind(positions.kind()) * probe;
            let ends = [positions + &probe_of_axis, positions - &probe_of_axis].map(|end| self.moved(&layers, &end));
            let slope = (&ends[0] - &ends[1]) / (2.0 * probe);
            // Of the softmax over masks, and of what the object shows.
            &visible * (&stands_out * slope.narrow(2, 0, 1) + slope.narrow(2, 1, slope.size()[2] - 1))
        };
        let by_axis = Tensor::stack(&(0..axes).map(along).collect::<Vec<_>>(), 1);
        (drawn.frames, by_axis.flatten(0, 1).transpose(0, 1))
    }

    /// Layers at `positions`, `[frames, coordinates * objects]`: `[objects, frames, C, S, S]`.
    fn moved(&self, layers: &Tensor, positions: &Tensor) -> Tensor {
        match self.coordinates {
            Coordinates::Position => self.shifted(layers, positions),
            Coordinates::Angle => self.rotated(layers, positions),
        }
    }

    /// Moved layers, `[objects, frames, 1 + channels, S, S]`, over the background.
    fn compose(&self, moved: &Tensor, background: &Tensor) -> Rendering {
        compose(moved, background, OUTSIDE, BACKGROUND_LOGIT)
    }

    /// See [`super::Decoder::draw`].
    pub fn draw<const LISTS: usize>(&self, positions: [&Tensor; LISTS]) -> [Tensor; LISTS] {
        if self.coordinates != Coordinates::Position {
            return positions.map(|positions| self.forward(positions).frames);
        }
        let scene = SceneSizes {
            objects: self.objects as usize,
            channels: self.channels,
            window: self.side / 2,
            side: self.side,
            outside: OUTSIDE as f32,
            background: BACKGROUND_LOGIT as f32,
        };
        let layers = || {
            let sprites = self.sprites();
            [sprites.layers(), sprites.background]
        };
        draw(self.kernels, scene, layers, positions.map(|positions| self.places(positions)))
    }

    /// The source pixels of each row and column of the frames at positions `[frames, 2 * objects]`, `[objects, frames, S]`
    /// each.
    fn places(&self, positions: &Tensor) -> [Tensor; 2] {
        let (scale, shift) = self.shift(positions);
        stn::separable_pixels(&scale, &shift, self.side as i64, self.side as i64 / 2)
    }

    /// The transformer's scale, and its shift `[objects, frames, 2]` at positions `[frames, 2 * objects]` in pixels.
    fn shift(&self, positions: &Tensor) -> (Tensor, Tensor) {
        // theta = [sigma, 0, (S/2 - x) / t * sigma, 0, sigma, (S/2 - y) / t * sigma]
        let sigma = self.log_sigma.exp();
        let shift = (self.middle - positions) * (&sigma / self.half_span);
        let shift = shift.reshape([-1, self.objects, 2]).transpose(0, 1);
        (sigma, shift)
    }

    /// Layers `[objects, C, S/2, S/2]` at positions `[frames, 2 * objects]` in pixels: `[objects, frames, C, S, S]`.
    fn shifted(&self, layers: &Tensor, positions: &Tensor) -> Tensor {
        let [rows, columns] = self.places(positions);
        sample_separable(layers, &rows, &columns)
    }

    /// Layers `[objects, C, S/2, S/2]` turned about the frame's middle by angles `[frames, objects]`:
    /// `[objects, frames, C, S, S]`.
    fn rotated(&self, layers: &Tensor, angles: &Tensor) -> Tensor {
        // A point of the frame is turned back into the template: theta = sigma [cos, sin, 0, -sin, cos, 0].
        let sigma = self.log_sigma.exp();
        let angles = angles.transpose(0, 1);
        let (cos, sin) = (angles.cos() * &sigma, angles.sin() * &sigma);
        let none = cos.zeros_like();
        let theta = Tensor::stack(&[&cos, &sin, &none, &-&sin, &cos, &none], 2);
        let frames = angles.size()[1];
        let [channels, window, side] = [layers.size()[1], layers.size()[2], self.side as i64];
        let templates = layers.unsqueeze(1).expand([-1, frames, -1, -1, -1], false);
        stn::transform(&templates.reshape([-1, channels, window, window]), &theta.flatten(0, 1), side).reshape([
            self.objects,
            frames,
            channels,
            side,
            side,
        ])
    }
}

/// `[n, height, width, channels]`, as the original's networks give it, with the channels before height and width.
fn channels_first(x: &Tensor) -> Tensor {
    x.permute([0, 3, 1, 2])
}

fn squared_norm(x: &Tensor) -> f64 {
    x.square().sum(Kind::Double).double_value(&[])
}
