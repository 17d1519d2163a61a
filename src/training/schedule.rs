//! When the learning rates fall and a phase ends: by a criterion on validation scores, at the latest by a count.
//!
//! The original divides its rate by 5 at 75 % of the epochs; with `plateau` 0 that is all that happens.

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};

use super::guide_clock::GuideClock;

/// The keys of a schedule, the same in every phase that descends a loss.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LrSchedule {
    /// Steps from one validation to the next.
    pub validate_every: u64,
    /// Share of the steps after which the rates are divided by `anneal_factor`, at the latest.
    pub anneal_at: f64,
    pub anneal_factor: f64,
    /// Whether the rates fall to that little by little, to the end of the phase; otherwise at once, as in the original.
    #[serde(default)]
    pub anneal_gradually: bool,
    /// They are divided earlier once the best validation score fell by less than this share over `patience` validations,
    /// and the phase ends as much earlier; 0 switches that off.
    pub plateau: f64,
    pub patience: usize,
    /// Whether the phase ends at once, without steps at the divided rates, where the validations so far are all worse than
    /// the first one that counts.
    #[serde(default)]
    pub end_without_gain: bool,
}

impl LrSchedule {
    /// # Errors
    /// A value out of range.
    pub(crate) fn check(&self) -> Result<()> {
        let LrSchedule { validate_every, anneal_at, anneal_factor, plateau, patience, .. } = *self;
        ensure!(validate_every > 0, "validate_every must be at least 1");
        ensure!((0.0..=1.0).contains(&anneal_at), "anneal_at = {anneal_at}: must lie between 0 and 1 (1: never)");
        ensure!(
            anneal_factor.is_finite() && anneal_factor > 0.0,
            "anneal_factor = {anneal_factor}: must be a positive number"
        );
        ensure!((0.0..1.0).contains(&plateau), "plateau = {plateau}: must be at least 0 and below 1");
        ensure!(plateau == 0.0 || patience > 0, "patience must be at least 1 where plateau is above 0");
        Ok(())
    }
}

/// A schedule laid out over a number of steps.
#[derive(Debug)]
pub struct Timetable {
    schedule: LrSchedule,
    max_steps: u64,
    /// The step from which the rates are divided at the latest.
    anneal_from: u64,
    /// Validations under guides do not count.
    guides: GuideClock,
    /// Scores above this one are not good enough to stop at, however slowly they fall.
    good_enough: f64,
    /// A score as good as this one is, however fast they fall.
    good: f64,
}

impl Timetable {
    /// Over `units` of `steps_per_unit` steps (the original counts epochs, and anneals at the start of a whole one).
    pub fn new(schedule: LrSchedule, units: u64, steps_per_unit: u64) -> Self {
        let anneal_from = (schedule.anneal_at * units as f64) as u64 * steps_per_unit;
        let (good_enough, good) = (f64::INFINITY, f64::NEG_INFINITY);
        let guides = GuideClock::NONE;
        Timetable { schedule, max_steps: units * steps_per_unit, anneal_from, guides, good_enough, good }
    }

    /// The same, in which the rates are divided from this step on at the latest.
    pub fn annealed_from(self, step: u64) -> Self {
        Timetable { anneal_from: step, ..self }
    }

    /// The same with guides.
    pub(crate) fn with_guides(self, guides: GuideClock) -> Self {
        Timetable { guides, ..self }
    }

    /// From which of these validations on scores can be compared: the first without guides, or the first of all while none
    /// was made without them.
    pub(crate) fn first_counted(&self, validations: &[f64]) -> usize {
        let guided = self.guides.guided(validations);
        if guided < validations.len() { guided } else { 0 }
    }

    /// The guides' weight at a step.
    pub(crate) fn guides_weight(&self, step: u64, validations: &[f64]) -> f64 {
        self.guides.weight(step, validations)
    }

    /// The same, in which the rates do not fall early before a score is `good_enough`, and fall as soon as one is `good`.
    pub fn until(self, good_enough: f64, good: f64) -> Self {
        Timetable { good_enough, good, ..self }
    }

    pub fn max_steps(&self) -> u64 {
        self.max_steps
    }

    pub fn validate_every(&self) -> u64 {
        self.schedule.validate_every
    }

    /// The step from which the rates are divided, as far as the scores so far tell.
    fn anneal_start(&self, validations: &[f64]) -> u64 {
        let LrSchedule { plateau, patience, validate_every, .. } = self.schedule;
        if plateau == 0.0 {
            return self.anneal_from;
        }
        let guided = self.guides.guided(validations);
        let counted = &validations[guided..];
        let standing = plateau_at(counted, patience, plateau, self.good_enough);
        let good = counted.iter().position(|score| *score <= self.good);
        let first = standing.into_iter().chain(good).min();
        first.map_or(self.anneal_from, |place| self.anneal_from.min((place + guided) as u64 * validate_every))
    }

    /// Steps from where the rates begin to fall to the end.
    fn anneal_steps(&self) -> u64 {
        self.max_steps - self.anneal_from
    }

    /// What a learning rate is multiplied by at a step.
    pub fn factor(&self, step: u64, validations: &[f64]) -> f64 {
        let (from, least) = (self.anneal_start(validations), 1.0 / self.schedule.anneal_factor);
        if step < from {
            1.0
        } else if self.schedule.anneal_gradually {
            let share = (step - from) as f64 / self.anneal_steps() as f64;
            1.0 - (1.0 - least) * share
        } else {
            least
        }
    }

    /// Whether as many steps have been taken at the divided rates as there are at the end of the whole timetable, or none are
    /// worth it.
    pub fn finished(&self, step: u64, validations: &[f64]) -> bool {
        let from = self.anneal_start(validations);
        let counted = &validations[self.guides.guided(validations)..];
        let gained = counted
            .split_first()
            .is_none_or(|(first, later)| later.is_empty() || later.iter().any(|score| score < first));
        let divided_steps = if self.schedule.end_without_gain && !gained { 0 } else { self.anneal_steps() };
        step >= from + divided_steps
    }
}

/// The first validation (as an index) at which the best of the last `patience` scores is less than a share of `plateau`
/// below the best before them, and good enough.
fn plateau_at(validations: &[f64], patience: usize, plateau: f64, good_enough: f64) -> Option<usize> {
    let least = |values: &[f64]| values.iter().copied().fold(f64::INFINITY, f64::min);
    (patience + 1..=validations.len()).map(|seen| &validations[..seen]).find_map(|seen| {
        let (before, recent) = seen.split_at(seen.len() - patience);
        let stands = least(recent) > (1.0 - plateau) * least(before);
        (stands && least(seen) <= good_enough).then_some(seen.len() - 1)
    })
}

#[cfg(test)]
mod tests {
    use super::{GuideClock, LrSchedule, Timetable, plateau_at};

    const ANY: f64 = f64::INFINITY;
    /// The guides are off before the second validation, at step 10.
    const FIRST_GUIDED: GuideClock = GuideClock { zero_from: 5, validate_every: 10, ..GuideClock::NONE };

    fn schedule(validate_every: u64, anneal_at: f64, plateau: f64, patience: usize) -> LrSchedule {
        LrSchedule {
            validate_every,
            anneal_at,
            anneal_factor: 5.0,
            anneal_gradually: false,
            plateau,
            patience,
            end_without_gain: false,
        }
    }

    #[test]
    fn a_plateau_is_where_the_recent_scores_stopped_falling() {
        let falling = [8.0, 4.0, 2.0, 1.0, 0.5];
        assert_eq!(plateau_at(&falling, 2, 0.1, ANY), None);
        let standing = [8.0, 4.0, 2.0, 1.95, 1.9, 1.0];
        // At index 4 the best of two, 1.9, is within 10 % of the best before, 2.0.
        assert_eq!(plateau_at(&standing, 2, 0.1, ANY), Some(4));
        assert_eq!(plateau_at(&standing, 2, 0.01, ANY), None);
        assert_eq!(plateau_at(&[1.0, 1.0], 2, 0.1, ANY), None);
    }

    #[test]
    fn a_plateau_that_is_not_good_enough_does_not_count() {
        let scores = [8.0, 8.0, 8.0, 8.0, 1.0, 1.0, 1.0];
        assert_eq!(plateau_at(&scores, 2, 0.1, 9.0), Some(2));
        assert_eq!(plateau_at(&scores, 2, 0.1, 2.0), Some(6));
        assert_eq!(plateau_at(&scores, 2, 0.1, 0.5), None);
    }

    #[test]
    fn steps_that_gain_nothing_are_not_followed_by_smaller_ones() {
        let schedule = LrSchedule { end_without_gain: true, ..schedule(10, 0.8, 0.2, 1) };
        let timetable = Timetable::new(schedule, 100, 1);
        assert!(!timetable.finished(0, &[2.0]) && !timetable.finished(9, &[2.0]));
        // The plateau is seen at step 10.
        assert_eq!([2.1, 2.0, 1.9].map(|score| timetable.finished(10, &[2.0, score])), [true, true, false]);
        assert_eq!([29, 30].map(|step| timetable.finished(step, &[2.0, 1.9, 1.8])), [false, true]);
    }

    #[test]
    fn the_original_anneals_at_epoch_three_quarters() {
        let schedule = schedule(250, 0.75, 0.0, 0);
        let timetable = Timetable::new(schedule, 10, 50);
        // int(0.75 * 10) = 7 epochs of 50 steps.
        assert_eq!([349, 350].map(|step| timetable.factor(step, &[1.0; 9])), [1.0, 0.2]);
        assert_eq!([499, 500].map(|step| timetable.finished(step, &[1.0; 9])), [false, true]);
    }

    #[test]
    fn a_plateau_brings_annealing_and_end_forward() {
        let timetable = Timetable::new(schedule(10, 0.5, 0.1, 2), 200, 1).with_guides(FIRST_GUIDED);
        // The first score does not count; the plateau of the rest is seen at their index 2, validation 3, step 30.
        let scores = [0.1, 4.0, 4.0, 4.0];
        assert_eq!([29, 30].map(|step| timetable.factor(step, &scores)), [1.0, 0.2]);
        assert_eq!([129, 130].map(|step| timetable.finished(step, &scores)), [false, true]);
    }

    #[test]
    fn rates_fall_little_by_little_from_the_first_good_score_on() {
        let schedule = LrSchedule { anneal_gradually: true, ..schedule(10, 0.5, 0.1, 2) };
        let timetable = Timetable::new(schedule, 200, 1).with_guides(FIRST_GUIDED).until(3.0, 1.0);
        let falling = [0.5, 4.0, 2.0, 0.9, 0.4];
        // The first score does not count; the fourth, of step 30, is the first that is good. 100 steps to the end.
        for (step, expected) in [(30, 1.0), (80, 0.6), (130, 0.2)] {
            // To the rounding of a share.
            assert!((timetable.factor(step, &falling) - expected).abs() < 1e-12, "{step}");
        }
        assert_eq!([129, 130].map(|step| timetable.finished(step, &falling)), [false, true]);
    }
}
