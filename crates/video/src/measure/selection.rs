//! Choice of the equation where none is given: every equation that comes with the program is fitted to the same positions.
//!
//! Ranked first are those that predict the held-out part about as well as the best, by the Bayesian criterion with the effective
//! number of residuals: residuals below the systematic error of the positions are alike, and the equation with fewer parameters is
//! taken. Then come the others by their held-out error. Where none explains the whole recording, the part is taken that one of them
//! explains (see [`free_motion`]).

use std::ops::Range;

use anyhow::{Result, ensure};
use rayon::prelude::*;

use super::candidates::EquationCandidate;
use super::explain::{Explained, explain};
use super::fit::{Observations, Start};
use super::fits::{explains, frames_in_one_of_best};
use super::free_motion::{cut, free_motion};
use super::motion::TrackMotion;
use super::recording::{Observation, RecordedSystem, learned_from, whole};
use super::starts::starts;

/// A held-out error of at most so many times the least, or so many times the noise, is as good.
const AS_GOOD: f64 = 1.5;
const NOISE: f64 = 3.0;
/// Difference of the Bayesian criterion from which on one equation is better than another.
const CLEARLY_BETTER: f64 = 10.0;
/// Of parts that are explained, those of at least this share of the longest's frames count as long.
const LONG: f64 = 0.75;

/// An equation with its fit to the part that is learned from.
#[derive(Debug, Clone)]
pub(super) struct Ranked {
    pub candidate: EquationCandidate,
    pub explained: Explained,
    bic: f64,
}

/// All that could be fitted, the best first.
#[derive(Debug)]
pub(super) struct Selection {
    pub ranked: Vec<Ranked>,
    /// The frames of the recording that were taken; none if it was taken as a whole.
    pub part: Option<Range<usize>>,
    /// Whether the best one explains what was taken.
    pub explained: bool,
}

impl Selection {
    /// Fits all candidates to the first observation; cuts the only recording to a part of it where none explains the whole.
    ///
    /// # Errors
    /// No candidate that can be fitted.
    pub fn of(
        scene: &mut RecordedSystem,
        observations: &mut [Observation],
        candidates: &[EquationCandidate],
    ) -> Result<Self> {
        let on_whole = rank(scene, &scene.tracks(&observations[0]), candidates)?;
        let explained = on_whole[0].explains(scene, &observations[0]);
        if explained || scene.recordings.len() > 1 {
            return Ok(Selection { ranked: on_whole, part: None, explained });
        }
        let track = whole(&scene.tracks(&observations[0])).remove(0);
        let all = track.times.len();
        let Some(part) = explained_part(scene, &track, candidates).filter(|part| part.len() < all) else {
            return Ok(Selection { ranked: on_whole, part: None, explained });
        };
        observations.iter_mut().for_each(|observation| observation.cut(&part, all));
        scene.cut(part.clone());
        let ranked = rank(scene, &scene.tracks(&observations[0]), candidates)?;
        let explained = ranked[0].explains(scene, &observations[0]);
        Ok(Selection { ranked, part: Some(part), explained })
    }

    /// What a person should know of the choice.
    pub fn notes(&self) -> Vec<String> {
        let best = &self.ranked[0];
        let mut notes = vec![format!(
            "equation chosen of {}: {} ({}); --equation NAME measures by another",
            self.ranked.len(),
            best.candidate.name,
            best.candidate.summary
        )];
        let close: Vec<&str> = self.ranked[1..]
            .iter()
            .take_while(|other| other.bic - best.bic < CLEARLY_BETTER && other.as_good_as(best))
            .map(|other| &*other.candidate.name)
            .collect();
        if !close.is_empty() {
            notes.push(format!(
                "explained as well by {}: a longer video, or one that begins faster or further away, tells them apart",
                close.join(", ")
            ));
        }
        notes
    }

    /// Why no number should be believed; none where the best one explains the motion.
    pub fn doubt(&self) -> Option<String> {
        (!self.explained).then(|| {
            format!(
                "none of the {} equations that come with the program explains the motion (the best is {}); give the one that does \
                 with --equation FILE",
                self.ranked.len(),
                self.ranked[0].candidate.name
            )
        })
    }
}

impl Ranked {
    fn explains(&self, scene: &RecordedSystem, observation: &Observation) -> bool {
        explains(&self.explained, &self.explained, &scene.tracks(observation)[0])
    }

    fn as_good_as(&self, best: &Ranked) -> bool {
        self.explained.errors.held_out <= AS_GOOD * best.explained.errors.held_out
    }
}

/// The candidates that can be fitted, the best first.
fn rank(scene: &RecordedSystem, tracks: &[Observations], candidates: &[EquationCandidate]) -> Result<Vec<Ranked>> {
    let fitted = |candidate: &EquationCandidate| {
        let dynamics = scene.dynamics(&candidate.cell).ok()?;
        let starts = starts(&dynamics, tracks, scene.piece, (&[], true), None);
        Some((candidate.clone(), explain(&dynamics, tracks, &starts).ok()?))
    };
    let fitted: Vec<(EquationCandidate, Explained)> = candidates.par_iter().filter_map(fitted).collect();
    ensure!(!fitted.is_empty(), "no equation that comes with the program can be fitted to these positions");
    let frames_in_one = frames_in_one_of_best(fitted.iter().map(|(_, explained)| explained));
    let ranked = fitted.into_iter().map(|(candidate, explained)| Ranked {
        bic: explained.criteria(frames_in_one, scene.systematic_error()).bic,
        candidate,
        explained,
    });
    let mut ranked: Vec<Ranked> = ranked.collect();
    let noise = TrackMotion::of(&tracks[0], ranked[0].explained.dynamics.coordinates()).noise;
    let held_out = |of: &Ranked| of.explained.errors.held_out;
    let least = ranked.iter().map(held_out).fold(f64::INFINITY, f64::min);
    let good = (AS_GOOD * least).max(NOISE * noise);
    ranked.sort_by(|a, b| {
        let by_criterion = (held_out(a) <= good, held_out(b) <= good);
        match by_criterion {
            (true, true) => a.bic.total_cmp(&b.bic),
            (false, false) => held_out(a).total_cmp(&held_out(b)),
            (a_good, b_good) => b_good.cmp(&a_good),
        }
    });
    Ok(ranked)
}

/// The part of a track that an equation explains and whose last quarter it predicts: of the long ones that of the equation with the
/// fewest parameters.
fn explained_part(
    scene: &RecordedSystem,
    track: &Observations,
    candidates: &[EquationCandidate],
) -> Option<Range<usize>> {
    let part = |candidate: &EquationCandidate| {
        let dynamics = scene.dynamics(&candidate.cell).ok()?;
        let found = free_motion(&dynamics, track)?;
        let own = cut(track, found.frames.clone(), dynamics.coordinates());
        let own = Observations { trained: learned_from(found.frames.len()), ..own };
        let learned = candidate.cell.parameters.iter().map(|kind| kind.fixed.is_none()).collect();
        let start = Start { unconstrained: found.fitted.unconstrained, learned, piece: scene.piece };
        let judged = explain(&dynamics, std::slice::from_ref(&own), &[start]).ok()?;
        explains(&judged, &judged, &own).then_some((candidate.cell.parameters.len(), found.frames))
    };
    let parts: Vec<(usize, Range<usize>)> = candidates.par_iter().filter_map(part).collect();
    let longest = parts.iter().map(|(_, frames)| frames.len()).max()?;
    let long = parts.into_iter().filter(|(_, frames)| frames.len() as f64 >= LONG * longest as f64);
    long.min_by_key(|(parameters, frames)| (*parameters, std::cmp::Reverse(frames.len()))).map(|(_, frames)| frames)
}
