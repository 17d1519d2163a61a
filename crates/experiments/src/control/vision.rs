//! Where the objects of a frame are, by the trained model's encoder, and whether they are there at all.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use tch::{Kind, Tensor};

use super::environment::FrameFormat;
use super::state::{ControlState, PastFrame};
use paig::network::cells::{Actions, Coordinates, State};
use paig::network::physics_models::{Encoding, PhysicsNet, refinement};
use paig::support::picture_file;

/// An object that is seen nearer than this to the point that it turns about, pixels, is lost: its direction says nothing.
const NEAREST: f64 = 1.0;
/// Pictures that the model draws of itself, along each of two axes or of a turn, to learn how much of a frame its masks
/// usually hold.
const OWN_PICTURES: usize = 4;
/// An object whose mask holds less of the frame than this share of the usual, or more than its inverse, is lost.
const LEAST_SHARE: f64 = 0.4;

/// Where each object is seen, `(x0, y0, x1, y1, ..)`, pixels.
pub type ObservedPositions = Vec<f32>;

/// A trained model that sees.
#[derive(Debug)]
pub struct Vision<'a> {
    pub model: &'a PhysicsNet,
    /// The sum of each object's mask over a frame, as it usually is, pixels.
    usual_masses: Vec<f64>,
}

impl<'a> Vision<'a> {
    /// # Errors
    /// A model of a system on which nothing acts, of other frames than the environment's, or with positions in the original's
    /// unit.
    pub fn new(model: &'a PhysicsNet, format: FrameFormat) -> Result<Self> {
        let system = &model.system;
        ensure!(
            system.cell.can_be_driven(),
            "nothing acts on what equation {} moves; control needs a run of a task with actions (pendulum)",
            system.cell.name
        );
        ensure!(
            system.cell.coordinates == Coordinates::Angle || model.options.exact_shift,
            "the model has the original's unit of length (model.exact_shift=false), goals are in pixels; train it with \
             --set model.exact_shift=true"
        );
        format.check(system)?;
        let mut vision = Vision { model, usual_masses: Vec::new() };
        vision.usual_masses = vision.masses_of_own_pictures();
        Ok(vision)
    }

    /// Frames that a state is estimated from, at most.
    pub fn input_frames(&self) -> usize {
        self.model.system.input_steps
    }

    /// The model's own drawing of some states, `[states, channels, S, S]`.
    pub fn drawn(&self, states: &[&ControlState]) -> Tensor {
        let _guard = tch::no_grad_guard();
        let numbers: Vec<f32> = states.iter().flat_map(|state| &state.positions).map(|x| *x as f32).collect();
        let positions = Tensor::from_slice(&numbers).reshape([states.len() as i64, -1]);
        self.model.decoder.forward(&positions.to_device(self.model.variables.device())).frames
    }

    /// How much of a frame each object's mask holds where the model looks at what it draws itself: the median over places
    /// all over the frame.
    fn masses_of_own_pictures(&self) -> Vec<f64> {
        let _guard = tch::no_grad_guard();
        let system = &self.model.system;
        let count = OWN_PICTURES * OWN_PICTURES;
        let at = |picture: usize| match system.cell.coordinates {
            Coordinates::Angle => vec![std::f64::consts::TAU * picture as f64 / count as f64; system.objects],
            // Several objects are at different places.
            Coordinates::Position => (0..system.objects)
                .flat_map(|object| {
                    let place = (picture + object * (OWN_PICTURES + 1)) % count;
                    [place % OWN_PICTURES, place / OWN_PICTURES]
                })
                .map(|cell| system.side as f64 * (cell as f64 + 1.0) / (OWN_PICTURES as f64 + 1.0))
                .collect(),
        };
        let states: Vec<_> = (0..count).map(|picture| ControlState::new(at(picture), Vec::new())).collect();
        let encoding = self.model.first_look(&self.drawn(&states.iter().collect::<Vec<_>>()));
        Vec::try_from(self.masses(&encoding).median_dim(0, false).0).expect("a number for each object")
    }

    /// `[frames, objects]`, float64.
    fn masses(&self, encoding: &Encoding) -> Tensor {
        let objects = encoding.masks.narrow(1, 0, self.model.system.objects as i64);
        objects.sum_dim_intlist([2i64, 3].as_slice(), false, Kind::Double)
    }

    /// Where the objects are in frames `[n, channels, S, S]`; none for a frame in which one of them is lost.
    pub fn places(&self, frames: &Tensor) -> Vec<Option<ObservedPositions>> {
        let _guard = tch::no_grad_guard();
        let system = &self.model.system;
        let frames = frames.to_device(self.model.variables.device());
        let encoding = self.model.first_look(&frames);
        let numbers = |x: Tensor| -> Vec<f64> { Vec::try_from(x.flatten(0, 1)).expect("numbers") };
        let places = numbers(self.model.aligned_places(&frames, &encoding.positions).to_kind(Kind::Double));
        let masses = numbers(self.masses(&encoding));
        let middle = system.side as f64 / 2.0;
        let turns = system.cell.coordinates == Coordinates::Angle;
        // All false, too, for what is no number.
        let seen = |(place, (mass, usual)): (&[f64; 2], (&f64, &f64))| {
            let share = mass / usual;
            let directed = (place[0] - middle).hypot(place[1] - middle) >= NEAREST;
            (LEAST_SHARE..=1.0 / LEAST_SHARE).contains(&share)
                && place.iter().all(|x| x.is_finite())
                && (directed || !turns)
        };
        let objects = system.objects;
        let frames = places.chunks_exact(2 * objects).zip(masses.chunks_exact(objects));
        frames
            .map(|(places, masses)| {
                let (points, _) = places.as_chunks();
                let all = points.iter().zip(masses.iter().zip(&self.usual_masses)).all(seen);
                all.then(|| places.iter().map(|x| *x as f32).collect())
            })
            .collect()
    }

    /// Where a state is seen.
    pub fn places_of(&self, state: &ControlState) -> ObservedPositions {
        let system = &self.model.system;
        let middle = system.side as f64 / 2.0;
        let places: Vec<f64> = match system.cell.coordinates {
            Coordinates::Position => state.positions.clone(),
            // Any distance will do: only the direction counts.
            Coordinates::Angle => {
                let around = |angle: &f64| [middle + 0.5 * middle * angle.sin(), middle - 0.5 * middle * angle.cos()];
                state.positions.iter().flat_map(around).collect()
            }
        };
        places.into_iter().map(|x| x as f32).collect()
    }

    /// Coordinates of the equation at consecutive frames, `[1, frames, coordinates]`.
    pub fn coordinates(&self, places: &[&ObservedPositions]) -> Tensor {
        let numbers: Vec<f32> = places.iter().flat_map(|places| places.iter().copied()).collect();
        let places = Tensor::from_slice(&numbers).reshape([1, places.len() as i64, -1]);
        let coordinates = self.model.clip_coordinates(&places);
        self.model.named(&coordinates, coordinates.size()[1] as usize)
    }

    /// The state at the last of at most L consecutive frames; `actions` (one fewer) acted from each frame to the next. As
    /// the model estimates and refines it from L frames; from fewer by the last difference, refined; from one at rest. For a
    /// black box as it is seen, with the frames before. None if it is no finite number.
    pub fn state(&self, places: &[&ObservedPositions], actions: &[f64]) -> Option<ControlState> {
        let _guard = tch::no_grad_guard();
        let model = self.model;
        let positions = self.coordinates(places);
        let acted: Vec<f32> = actions.iter().map(|action| *action as f32).collect();
        let acted = Actions::new((!acted.is_empty()).then(|| Tensor::from_slice(&acted).unsqueeze(0)));
        let count = positions.size()[1];
        let black_box = model.black_box.is_some();
        let state = if count as usize == self.input_frames() && !black_box {
            model.initial_state(&positions, &acted)
        } else {
            let last = positions.select(1, count - 1);
            let before = positions.select(1, (count - 2).max(0));
            let estimate = State { vel: (&last - before) / model.system.dt, pos: last };
            let steps = if black_box { 0 } else { model.options.refinement_steps };
            refinement::refine(model.cell.as_ref(), model.system.dt, &positions, &acted, estimate, steps)
        };
        let mut state = ControlState::new(flat(&state.pos), flat(&state.vel));
        state.before = self.before(places, actions);
        state.is_finite().then_some(state)
    }

    /// What is known of the frames before the last of some consecutive ones; `actions` (one fewer) acted from each to the next.
    /// Nothing for an equation, which asks for none.
    pub fn before(&self, places: &[&ObservedPositions], actions: &[f64]) -> Vec<PastFrame> {
        let _guard = tch::no_grad_guard();
        if self.model.black_box.is_none() {
            return Vec::new();
        }
        let positions = self.coordinates(places);
        let moment =
            |(frame, action): (i64, &f64)| PastFrame { positions: flat(&positions.select(1, frame)), action: *action };
        (0..).zip(actions).map(moment).collect()
    }

    /// The coordinates at which a picture shows the objects, radians or pixels.
    ///
    /// # Errors
    /// A file that is no picture or of another size than the frames, or in which an object is not found.
    pub fn goal(&self, file: &Path) -> Result<Vec<f64>> {
        let _guard = tch::no_grad_guard();
        let picture = picture_file::read(file)?;
        let system = &self.model.system;
        let (width, height) = (picture.width(), picture.height());
        ensure!(
            (width as usize, height as usize) == (system.side, system.side),
            "{} has {width} x {height} pixels; a goal must be a frame of {1} x {1}",
            file.display(),
            system.side
        );
        let pixels = if system.channels == 1 { picture.to_luma8().into_raw() } else { picture.to_rgb8().into_raw() };
        let side = system.side as i64;
        let pixels = Tensor::from_slice(&pixels).reshape([1, side, side, system.channels as i64]);
        let frame = pixels.permute([0, 3, 1, 2]).to_kind(Kind::Float) / 255.0;
        let lost = || format!("the model does not find what it knows in {}", file.display());
        let places = self.places(&frame).remove(0).with_context(lost)?;
        Ok(Vec::try_from(self.coordinates(&[&places]).to_kind(Kind::Double).flatten(0, 2))?)
    }
}

/// The numbers of a state's part, `[1, coordinates]`.
fn flat(part: &Tensor) -> Vec<f64> {
    Vec::try_from(part.to_kind(Kind::Double).flatten(0, 1)).expect("numbers")
}
