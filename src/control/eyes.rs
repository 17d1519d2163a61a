//! What was seen in an episode so far, and the state now: also where frames are missing or the objects were hidden.

use anyhow::Result;
use tch::Tensor;

use super::model::Model;
use super::state::ControlState;
use super::vision::{Places, Vision};

/// Frames in a row without a sight of the objects after which nothing is foretold any more.
const MOST_BLIND: usize = 10;

/// Where the state of a moment comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Sight {
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
    places: Vec<Option<Places>>,
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
    pub fn look(&mut self, frames: &[Option<Tensor>], actions: &[f64], model: &mut dyn Model) -> Sight {
        self.see(frames);
        let Some(now) = self.places.len().checked_sub(1) else { return Sight::Lost };
        let foretold = self.foretell(now, actions, model).unwrap_or_default();
        let window = self.window(now);
        let sight = if self.seen[now] {
            let places: Vec<_> = self.places[window.clone()].iter().flatten().collect();
            self.vision.state(&places, &actions[window.start..now]).map_or(Sight::Lost, Sight::Seen)
        } else {
            let ago = self.seen.iter().rev().take_while(|seen| !**seen).count();
            foretold.map_or(Sight::Lost, |state| Sight::Foretold(state, ago))
        };
        match &sight {
            Sight::Seen(state) | Sight::Foretold(state, _) => self.last = Some((now, state.clone())),
            Sight::Lost => {}
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

    /// Fills what was not seen since the last estimate with what the model foretells; returns the state that it foretells
    /// for now, unless nothing has been seen for too long.
    fn foretell(&mut self, now: usize, actions: &[f64], model: &mut dyn Model) -> Result<Option<ControlState>> {
        let blind = self.seen.iter().rev().take_while(|seen| !**seen).count();
        let Some((from, state)) = self.last.as_ref().filter(|_| blind <= MOST_BLIND) else { return Ok(None) };
        if self.seen[from + 1..].iter().all(|seen| *seen) {
            return Ok(None);
        }
        let actions: Vec<f32> = actions[*from..now].iter().map(|action| *action as f32).collect();
        let ahead = model.follow(state, &actions)?;
        let (from, last) = (*from, ahead.last().cloned().filter(ControlState::is_finite));
        for (frame, state) in (from + 1..).zip(&ahead).filter(|(_, state)| state.is_finite()) {
            if self.places[frame].is_none() {
                self.places[frame] = Some(self.vision.places_of(state));
            }
        }
        Ok(last)
    }

    /// The last frames, at most L, in which it is known where the objects were.
    fn window(&self, now: usize) -> std::ops::Range<usize> {
        let known = self.places[..=now].iter().rev().take_while(|places| places.is_some()).count();
        now + 1 - known.min(self.vision.input_frames())..now + 1
    }

    /// Where the objects were in the first frames, `[1, frames, coordinates]` of the equation, and 1 for each coordinate that
    /// was seen, 0 for one that was foretold, `[1, frames * coordinates]`. None where neither is known of a frame.
    pub fn first(&self, frames: usize) -> Option<(Tensor, Tensor)> {
        let places: Vec<&Places> = self.places.get(..frames)?.iter().map(Option::as_ref).collect::<Option<_>>()?;
        let positions = self.vision.coordinates(&places);
        let coordinates = positions.size()[2] as usize;
        let seen: Vec<f64> =
            self.seen[..frames].iter().flat_map(|seen| vec![f64::from(u8::from(*seen)); coordinates]).collect();
        Some((positions, Tensor::from_slice(&seen).unsqueeze(0)))
    }
}
