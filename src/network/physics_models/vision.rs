//! What a model sees: from frames to the positions of its objects, under their names.

use tch::{Kind, Tensor};

use super::{Encoding, PhysicsNet, alignment, coordinates, naming, second_look};
use crate::network::cells::Coordinates;

/// What the vision part makes of clips.
#[derive(Debug)]
pub struct EncodedClips {
    pub encoding: Encoding,
    /// As the encoder says, in its own order of the objects, `[batch, time, coordinates * objects]`.
    pub encoded: Tensor,
    /// From which the state is estimated: aligned on the input frames, in the order of the names; the same shape.
    pub positions: Tensor,
}

impl PhysicsNet {
    /// Positions of frames `[batch, time, channels, S, S]` in the equation's coordinates, `[batch, time, coordinates *
    /// objects]`, with the encoder's masks.
    pub fn encode(&self, frames: &Tensor) -> (Encoding, Tensor) {
        let (batch, time) = (frames.size()[0], frames.size()[1]);
        let encoding = self.look(&frames.flatten(0, 1));
        let positions = self.clip_coordinates(&encoding.positions.reshape([batch, time, -1]));
        (encoding, positions)
    }

    /// What the encoder makes of single frames `[frames, channels, S, S]`; where no gradients are wanted and the options say so,
    /// after a second look.
    pub fn look(&self, frames: &Tensor) -> Encoding {
        let given = self.given(frames);
        let encoding = self.encoder.forward(&given);
        if encoding.positions.requires_grad() || !self.looks_twice() {
            return encoding;
        }
        second_look::better_drawn(&self.encoder, &self.decoder, [frames, &given], encoding)
    }

    /// What the encoder makes of single frames `[frames, channels, S, S]` at first.
    pub fn first_look(&self, frames: &Tensor) -> Encoding {
        self.encoder.forward(&self.given(frames))
    }

    /// The same, and the positions (`[frames, 2 * objects]`, pixels) once more without a way back to the masks.
    pub(crate) fn first_look_twice(&self, frames: &Tensor) -> (Encoding, Tensor) {
        self.encoder.forward_twice(&self.given(frames))
    }

    /// What the encoder is given of frames, all `[frames, channels, S, S]`: see [`super::ModelOptions::subtract_background`].
    pub fn given(&self, frames: &Tensor) -> Tensor {
        match self.options.subtract_background.then(|| self.decoder.background()).flatten() {
            Some(background) => frames - background.detach(),
            None => frames.shallow_clone(),
        }
    }

    fn looks_twice(&self) -> bool {
        let plane = self.system.cell.coordinates == Coordinates::Position;
        self.options.second_look && plane && self.decoder.has_twins()
    }

    /// Which of these frames, `[frames, channels, S, S]`, are encoded as the encoder saw them first: their places, int64
    /// `[at most frames]`, in ascending order.
    pub fn at_first_look(&self, frames: &Tensor) -> Tensor {
        let all = Tensor::arange(frames.size()[0], (Kind::Int64, frames.device()));
        if !self.looks_twice() {
            return all;
        }
        let _guard = tch::no_grad_guard();
        let given = self.given(frames);
        let first = self.encoder.forward(&given);
        let positions = first.positions.shallow_clone();
        let chosen = second_look::better_drawn(&self.encoder, &self.decoder, [frames, &given], first);
        let changed = (chosen.positions - positions).abs();
        all.masked_select(&changed.amax([1], false).eq(0.0))
    }

    /// Positions in the frames of clips, `[batch, time, 2 * objects]` (pixels), in the equation's coordinates, `[batch, time,
    /// coordinates * objects]`.
    pub fn clip_coordinates(&self, positions: &Tensor) -> Tensor {
        let (kind, size) = (self.system.cell.coordinates, positions.size());
        let single = coordinates::of(kind, &positions.flatten(0, 1), self.system.side);
        coordinates::continuous(kind, single.reshape([size[0], size[1], -1]))
    }

    /// Positions of single frames in the equation's coordinates, `[frames, coordinates * objects]`.
    pub fn coordinates(&self, encoding: &Encoding) -> Tensor {
        coordinates::of(self.system.cell.coordinates, &encoding.positions, self.system.side)
    }

    /// What is seen in clips `[batch, time, channels, S, S]`: as [`PhysicsNet::encode`], and the positions of the first `input`
    /// frames improved on the picture, all in the order of their names.
    pub fn see(&self, clips: &Tensor, input: usize) -> EncodedClips {
        let seen = self.see_unnamed(clips, self.look(&clips.flatten(0, 1)), input);
        EncodedClips { positions: self.named(&seen.positions, input), ..seen }
    }

    /// The same in the encoder's order, by what the encoder made of the frames.
    pub(super) fn see_unnamed(&self, clips: &Tensor, encoding: Encoding, input: usize) -> EncodedClips {
        let (batch, time, count) = (clips.size()[0], clips.size()[1], input as i64);
        let encoded = self.clip_coordinates(&encoding.positions.reshape([batch, time, -1]));
        let places = encoding.positions.reshape([batch, time, -1]);
        let of_input = |x: &Tensor| x.narrow(1, 0, count).flatten(0, 1);
        let aligned = self.aligned_places(&of_input(clips), &of_input(&places)).reshape([batch, count, -1]);
        let places = Tensor::cat(&[aligned, places.narrow(1, count, time - count)], 1);
        let positions = self.clip_coordinates(&places);
        EncodedClips { encoding, encoded, positions }
    }

    /// Which of the encoder's objects bears each name in clips `[batch, L + T_pred, channels, S, S]`, `[batch, L + T_pred,
    /// objects]`, as a step of training has it; none where names do not change.
    pub fn order(&self, clips: &Tensor) -> Option<Tensor> {
        let _guard = tch::no_grad_guard();
        let (unlike, input) = (self.unlike()?, self.system.input_steps);
        let seen = self.see_unnamed(clips, self.first_look(&clips.flatten(0, 1)), input);
        Some(naming::follow(&seen.positions, &unlike, input).order)
    }

    /// Encoded places `[frames, 2 * objects]` (pixels) in single frames `[frames, channels, S, S]`, improved on the picture if
    /// the options say so. What is drawn turned by an angle is turned about the middle of the frame.
    pub fn aligned_places(&self, frames: &Tensor, encoded: &Tensor) -> Tensor {
        let (kind, steps) = (self.system.cell.coordinates, self.options.alignment_steps);
        let positions = coordinates::of(kind, encoded, self.system.side);
        let aligned = alignment::align(&self.decoder, kind, frames, &positions, steps);
        match kind {
            Coordinates::Position => aligned,
            Coordinates::Angle => coordinates::turned(encoded, &(aligned - positions), self.system.side),
        }
    }

    /// Encoded positions `[batch, time, coordinates * objects]` in the order of their names: within a clip a name stays with
    /// its object. The names in the first `input` frames do not depend on what comes after.
    pub fn named(&self, positions: &Tensor, input: usize) -> Tensor {
        match self.unlike() {
            Some(unlike) => naming::renamed(positions, &naming::follow(positions, &unlike, input).order),
            None => positions.shallow_clone(),
        }
    }

    /// How unlike the objects look, where names follow them.
    fn unlike(&self) -> Option<Vec<Vec<f64>>> {
        let one = self.system.objects == 1 || self.system.cell.coordinates == Coordinates::Angle;
        if one || !self.options.names_by_continuity { None } else { self.decoder.unlike() }
    }
}
