//! What was seen in an episode so far, and the state now: also where frames are missing or the objects were hidden.

use anyhow::Result;
use tch::Tensor;

use super::model::PlanningModel;
use super::state::ControlState;
use super::vision::{ObservedPositions, Vision};

/// Frames in a row without a sight of the objects after which nothing is foretold any more.
const MOST_BLIND: usize = 10;

/// Where the state of a moment comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum StateSource {
    Seen(ControlState),
    /// Not seen: foretold from the last sight, so many steps ago.
    Foretold(ControlState, usize),
    Lost,
}

/// A memory of one episode.
#[derive(Debug)]
pub struct Eyes<'a> {
    pub vision: Vision<'a>,
    /// Of each frame: where the objects were seen, or foretold to be; none where neither is known.
    places: Vec<Option<ObservedPositions>>,
    /// Whether they were seen in it.
    seen: Vec<bool>,
    /// The last state that was estimated, and in which frame.
    last: Option<(usize, ControlState)>,
}

impl<'a> Eyes<'a> {
    pub fn new(vision: Vision<'a>) -> Self {
        Eyes { vision, places: Vec::new(), seen: Vec::new(), last: None }
    }

    /// Forgets the last episode.
    pub fn begin(&mut self) {
        self.places.clear();
        self.seen.clear();
        self.last = None;
    }

    /// The state at the last of all frames of the episode so far, after these actions between them. Only frames that are
    /// new are looked at; `model` foretells what they do not show.
    pub fn look(&mut self, frames: &[Option<Tensor>], actions: &[f64], model: &mut dyn PlanningModel) -> StateSource {
        self.see(frames);
        let Some(now) = self.places.len().checked_sub(1) else { return StateSource::Lost };
        let foretold = self.foretell(now, actions, model).unwrap_or_default();
        let window = self.window(now);
        let places: Vec<_> = self.places[window.clone()].iter().flatten().collect();
        let acted = || &actions[window.start..now];
        let sight = if self.seen[now] {
            self.vision.state(&places, acted()).map_or(StateSource::Lost, StateSource::Seen)
        } else {
            // What was seen and what acted before a missing frame is known all the same.
            let remembering = |state| ControlState { before: self.vision.before(&places, acted()), ..state };
            foretold.map(remembering).map_or(StateSource::Lost, |state| StateSource::Foretold(state, self.blind(now)))
        };
        match &sight {
            StateSource::Seen(state) | StateSource::Foretold(state, _) => self.last = Some((now, state.clone())),
            StateSource::Lost => {}
        }
        sight
    }

    /// Looks at the frames that are new, all in one pass.
    pub fn see(&mut self, frames: &[Option<Tensor>]) {
        let new = &frames[self.places.len()..];
        let there: Vec<&Tensor> = new.iter().flatten().collect();
        let mut found =
            if there.is_empty() { Vec::new() } else { self.vision.places(&Tensor::stack(&there, 0)) }.into_iter();
        for frame in new {
            let places = frame.as_ref().and_then(|_| found.next().flatten());
            self.seen.push(places.is_some());
            self.places.push(places);
        }
    }

    /// Fills what was not seen since the last estimate with what the model foretells, as far as that is not too long after the
    /// last sight; returns the state that it foretells for now, unless nothing has been seen for too long.
    fn foretell(&mut self, now: usize, actions: &[f64], model: &mut dyn PlanningModel) -> Result<Option<ControlState>> {
        let Some((from, state)) = self.last.as_ref().filter(|_| self.blind(now) <= MOST_BLIND) else { return Ok(None) };
        if self.seen[from + 1..].iter().all(|seen| *seen) {
            return Ok(None);
        }
        let actions: Vec<f32> = actions[*from..now].iter().map(|action| *action as f32).collect();
        let ahead = model.follow(state, &actions)?;
        let (from, last) = (*from, ahead.last().cloned().filter(ControlState::is_finite));
        for (frame, state) in (from + 1..).zip(&ahead).filter(|(_, state)| state.is_finite()) {
            if self.places[frame].is_none() && self.blind(frame) <= MOST_BLIND {
                self.places[frame] = Some(self.vision.places_of(state));
            }
        }
        Ok(last)
    }

    /// Frames since the last sight before or in this one.
    fn blind(&self, frame: usize) -> usize {
        self.seen[..=frame].iter().rev().take_while(|seen| !**seen).count()
    }

    /// The last frames, at most L, in which it is known where the objects were.
    fn window(&self, now: usize) -> std::ops::Range<usize> {
        let known = self.places[..=now].iter().rev().take_while(|places| places.is_some()).count();
        now + 1 - known.min(self.vision.input_frames())..now + 1
    }

    /// Where the objects were in the first frames, `[1, frames, coordinates]` of the equation, and 1 for each coordinate that
    /// was seen, 0 for one that was foretold, `[1, frames * coordinates]`. None where neither is known of a frame.
    pub fn first(&self, frames: usize) -> Option<(Tensor, Tensor)> {
        let places: Vec<&ObservedPositions> =
            self.places.get(..frames)?.iter().map(Option::as_ref).collect::<Option<_>>()?;
        let positions = self.vision.coordinates(&places);
        let coordinates = positions.size()[2] as usize;
        let seen: Vec<f64> =
            self.seen[..frames].iter().flat_map(|seen| vec![f64::from(u8::from(*seen)); coordinates]).collect();
        Some((positions, Tensor::from_slice(&seen).unsqueeze(0)))
    }
}

#[cfg(test)]
mod tests {
    use tch::Device;

    use super::*;
    use crate::control::learned;
    use crate::control::pendulum::FORMAT;
    use crate::control::plans::{Plans, Trajectories};
    use paig::network::dynamics::DynamicsKind;
    use paig::network::physics_models::{ModelOptions, PhysicsNet};
    use paig::tasks;

    /// Foretells that nothing moves.
    struct Still;

    impl PlanningModel for Still {
        fn roll_out(&mut self, _: &ControlState, _: &Plans, _: &mut Trajectories) -> Result<()> {
            unreachable!("one sequence of actions is followed")
        }

        fn follow(&mut self, start: &ControlState, actions: &[f32]) -> Result<Vec<ControlState>> {
            Ok(vec![start.clone(); actions.len()])
        }
    }

    #[test]
    fn a_long_gap_is_not_filled_to_its_end() {
        let options = ModelOptions { exact_shift: true, ..ModelOptions::original() };
        let net = PhysicsNet::new(&tasks::builtin("pendulum").unwrap().system, &options, Device::Cpu, 1).unwrap();
        let mut eyes = Eyes::new(Vision::new(&net, FORMAT).unwrap());
        let state = ControlState::new(vec![0.3], vec![0.0]);
        let place = eyes.vision.places_of(&state);
        // Seen in frames 0 to 3 and in 19.
        eyes.seen = (0..20).map(|frame| frame < 4 || frame == 19).collect();
        eyes.places = eyes.seen.iter().map(|seen| seen.then(|| place.clone())).collect();
        eyes.last = Some((3, state));
        eyes.foretell(19, &[0.0; 19], &mut Still).unwrap();
        let known: Vec<usize> = (0..20).filter(|frame| eyes.places[*frame].is_some()).collect();
        assert_eq!(known, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 19]);
        assert_eq!(eyes.window(19), 19..20);
    }

    /// A black box foretells a frame that is missing, and goes on from what was seen before it and from what acted.
    #[test]
    fn what_came_before_a_missing_frame_is_known() {
        let options = ModelOptions { dynamics: DynamicsKind::Mlp, exact_shift: true, ..ModelOptions::original() };
        let net = PhysicsNet::new(&tasks::builtin("pendulum").unwrap().system, &options, Device::Cpu, 1).unwrap();
        let mut eyes = Eyes::new(Vision::new(&net, FORMAT).unwrap());
        let (angles, actions) = ([0.5, 0.4, 0.2, -0.1], [1.0, -2.0, 0.5, 1.5]);
        let place = |angle: f64| eyes.vision.places_of(&ControlState::new(vec![angle], Vec::new()));
        let places = angles.map(place);
        let seen = eyes.vision.state(&places.each_ref(), &actions[..3]).unwrap();
        (eyes.seen, eyes.places) = (vec![true; 4], places.map(Some).to_vec());
        eyes.last = Some((3, seen));
        let frames: [Option<Tensor>; 5] = Default::default();
        let sight = eyes.look(&frames, &actions, learned::of_net(&net).as_mut());
        let StateSource::Foretold(state, 1) = &sight else { panic!("{sight:?}") };
        assert_eq!(state.before.iter().map(|moment| moment.action).collect::<Vec<_>>(), actions[1..]);
        for (moment, angle) in state.before.iter().zip(&angles[1..]) {
            // Places are pixels in float32, and angles of them.
            assert!((moment.positions[0] - angle).abs() < 1e-4, "{moment:?} instead of {angle}");
        }
        assert_eq!(eyes.last.map(|(frame, state)| (frame, state.before.len())), Some((4, 3)));
    }
}
