//! Parts of recordings to measure: those of free motion together, the longest of them, the whole videos; and takes.

use std::path::Path;
use std::time::Instant;

use anyhow::Result;

use super::finished::Finished;
use super::motion::TrackMotion;
use super::of_video::{EquationChoice, MeasuredParts, TrackedPart};
use super::other_parts::OtherPart;
use super::recording::{Observation, RecordedSystem};
use super::results::Outcome;
use super::{ComparedEquation, MeasureRequest, Subject, VideoRequest, cut_to_free_motion, make_folder};

/// Videos with their objects tracked, to be measured.
pub(super) struct Attempts<'a> {
    pub videos: &'a VideoRequest,
    pub films: &'a [TrackedPart],
    pub request: &'a MeasureRequest,
    pub begun: Instant,
}

/// Error of the held-out frames, as a share of the amplitude, up to which another part or mover is worth a measurement.
const PROMISING: f64 = 0.3;
/// Most movers that are measured after the first.
const MOST_OTHERS: usize = 2;

impl Attempts<'_> {
    /// The likeliest mover of the videos. Where nothing is found, the longest part of a video by itself; then, if nobody pointed at the
    /// object, the next movers: a tree in the wind or a person may be larger than what obeys the equation.
    pub(super) fn best(&self) -> Result<Finished> {
        let mut best = self.best_part();
        let [film] = self.films else { return best };
        if is_found(&best) {
            return best;
        }
        let others = || if self.videos.hints.is_empty() { film.others() } else { Vec::new() };
        let again = film.longest_alone().into_iter().chain(std::iter::once_with(others).flatten().take(MOST_OTHERS));
        for attempt in again.filter_map(|(film, note)| self.again(film, note)) {
            if outcome(&attempt) < outcome(&best) {
                best = attempt;
            }
            if is_found(&best) {
                break;
            }
        }
        best
    }

    /// A part or a mover that is tried after another one; none where a first fit shows that the equation does not explain it.
    fn again(&self, film: TrackedPart, note: String) -> Option<Result<Finished>> {
        let (mut subject, equation) = self.videos.subject(&[film], MeasuredParts::Free).ok()?;
        subject.notes.push(note);
        let promises = |subject: &Subject| match &equation {
            EquationChoice::Given(own) => subject.promises(own),
            EquationChoice::OneOf(_) => true,
        };
        let longest = subject.longest();
        let promising = std::iter::once(subject).chain(longest).find(promises)?;
        Some(self.measured(&promising, &equation))
    }

    /// The parts of free motion together; where that finds nothing, the longest of them; where that does not either, the whole
    /// videos. The best of the three.
    fn best_part(&self) -> Result<Finished> {
        let (subject, equation) = self.videos.subject(self.films, MeasuredParts::Free)?;
        let mut best = self.measured(&subject, &equation);
        if let Some(longest) = subject.longest().filter(|_| !is_found(&best)) {
            best = better(best, self.measured(&longest, &equation));
        }
        if !is_found(&best) && self.films.iter().any(TrackedPart::has_parts) {
            let (whole, equation) = self.videos.subject(self.films, MeasuredParts::Whole)?;
            best = better(best, self.measured(&whole, &equation));
        }
        best
    }

    /// Each recording alone, into folders of their own, then all together with the scatter between them in the intervals.
    pub(super) fn takes(&self, out: &Path) -> Result<Finished> {
        let (mut subject, equation) = self.videos.subject(self.films, MeasuredParts::Free)?;
        for place in 0..subject.scene.recordings.len() {
            let alone = subject.alone(place);
            let folder = out.join(format!("take-{}", place + 1));
            make_folder(&folder)?;
            match self.measured(&alone, &equation).and_then(|finished| finished.write(&folder)) {
                Ok(measurement) => subject.takes.push(measurement),
                Err(error) => subject.notes.push(format!("{} alone: {error:#}", alone.task)),
            }
        }
        self.measured(&subject, &equation)
    }

    fn measured(&self, subject: &Subject, equation: &EquationChoice) -> Result<Finished> {
        match equation {
            EquationChoice::Given(own) => subject.measured(own.clone(), Vec::new(), self.request, self.begun),
            EquationChoice::OneOf(candidates) => subject.clone().by_the_best(candidates, self.request, self.begun),
        }
    }
}

fn is_found(attempt: &Result<Finished>) -> bool {
    outcome(attempt) == Outcome::Found
}

fn outcome(attempt: &Result<Finished>) -> Outcome {
    attempt.as_ref().map_or(Outcome::NotFound, Finished::outcome)
}

/// The one with the better verdict; of two alike the one that predicts the held-out frames better.
fn better(first: Result<Finished>, second: Result<Finished>) -> Result<Finished> {
    let rank = |it: &Finished| {
        let error = it.measurement.held_out.percent_of_amplitude;
        (it.outcome(), if error.is_nan() { f64::INFINITY } else { error })
    };
    match (first, second) {
        (Ok(first), Ok(second)) => {
            let ((one, its), (other, others)) = (rank(&first), rank(&second));
            let second_is_better = other < one || other == one && others < its;
            Ok(if second_is_better { second } else { first })
        }
        (first, second) => first.or_else(|error| second.map_err(|_| error)),
    }
}

impl From<Subject> for OtherPart {
    fn from(mut subject: Subject) -> Self {
        OtherPart { observation: subject.observations.swap_remove(0), scene: subject.scene }
    }
}

impl Subject {
    /// Whether an equation predicts what is held out, to a share of the amplitude. No part is left out but by an equation with walls,
    /// of which one impact that it does not explain would spoil all that comes after.
    fn promises(&self, equation: &ComparedEquation) -> bool {
        let predicts = |scene: &RecordedSystem, observations: &[Observation]| {
            scene.fits(&equation.cell, &observations[..1], &self.known).is_ok_and(|fits| {
                let motion = TrackMotion::of(&fits.tracks[0], fits.judged.dynamics.coordinates());
                fits.judged.errors.held_out < PROMISING * motion.amplitude
            })
        };
        if predicts(&self.scene, &self.observations) {
            return true;
        }
        let has_walls = self.scene.dynamics(&equation.cell).is_ok_and(|dynamics| dynamics.has_walls());
        if !has_walls || self.scene.recordings.len() > 1 {
            return false;
        }
        let (mut scene, mut observations) = (self.scene.clone(), self.observations.clone());
        cut_to_free_motion(&mut scene, &mut observations, &equation.cell).is_ok_and(|note| note.is_some())
            && predicts(&scene, &observations)
    }

    /// The longest of several recordings alone.
    fn longest(&self) -> Option<Subject> {
        let count = self.scene.recordings.len();
        let frames = |place: &usize| self.scene.recordings[*place].times.len();
        let longest = (0..count).filter(|_| count > 1).max_by_key(frames)?;
        let mut alone = self.alone(longest);
        let others = (0..count).filter(|place| *place != longest).map(|place| self.alone(place));
        alone.other_parts = others.map(OtherPart::from).collect();
        let note = format!("{count} parts do not follow one equation together: {} alone is measured", alone.task);
        alone.notes.push(note);
        Some(alone)
    }

    /// The same with one of its recordings.
    fn alone(&self, place: usize) -> Subject {
        let mut alone = self.clone();
        alone.scene.record.sources = vec![alone.scene.record.sources.swap_remove(place)];
        alone.scene.recordings = vec![alone.scene.recordings.swap_remove(place)];
        alone.pictures = vec![alone.pictures.swap_remove(place)];
        alone.task.clone_from(&alone.scene.recordings[0].name);
        for Observation { recordings, .. } in &mut alone.observations {
            *recordings = vec![recordings.swap_remove(place)];
        }
        alone
    }
}
