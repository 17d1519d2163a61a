//! The course of a training, as its metrics.jsonl tells it.

use std::path::Path;

use anyhow::Result;

use super::metrics::{self, Record, RecordKind};
use crate::support::run_names::METRICS;

/// All records of a run, in their order.
#[derive(Debug, Clone)]
pub struct Course {
    records: Vec<Record>,
}

impl Course {
    /// Reads the course of the run in a folder.
    ///
    /// # Errors
    /// A missing file, or the number of a damaged line.
    pub fn read(folder: &Path) -> Result<Self> {
        Ok(Course { records: metrics::read(&folder.join(METRICS))? })
    }

    /// The same up to the best validation of its last phase: the course of the weights that a phase with `end_at_best` ends
    /// with.
    pub(crate) fn to_best(&self) -> Self {
        let phase = self.phase();
        let valid = |record: &Record| record.kind == RecordKind::Valid && Some(record.phase.as_str()) == phase;
        let scores = self.records.iter().enumerate().filter(|(_, record)| valid(record));
        let best = scores.filter_map(|(place, record)| Some((place, record.score?))).min_by(|a, b| a.1.total_cmp(&b.1));
        let kept = best.map_or(self.records.len(), |(place, _)| place + 1);
        Course { records: self.records[..kept].to_vec() }
    }

    /// Steps taken until the last record.
    pub fn steps(&self) -> u64 {
        self.records.last().map_or(0, |record| record.step)
    }

    /// The phase of the last record.
    pub fn phase(&self) -> Option<&str> {
        self.records.last().map(|record| record.phase.as_str())
    }

    /// Seconds of training until the last record that states them.
    pub fn seconds(&self) -> Option<f64> {
        self.records.iter().rev().find_map(|record| record.value("seconds"))
    }

    /// Seconds of training from which on a parameter stays within so many per cent of its truth; none if it ends outside.
    pub fn seconds_within(&self, parameter: &str, truth: f64, percent: f64) -> Option<f64> {
        let known = self.records.iter().filter_map(|record| Some((record.value("seconds")?, record.value(parameter)?)));
        let mut since = None;
        for (seconds, value) in known {
            let near = (value - truth).abs() <= percent / 100.0 * truth.abs();
            since = if near { since.or(Some(seconds)) } else { None };
        }
        since
    }

    /// The first value of this name, the one half-way to the last step, and the last one.
    pub fn start_middle_end(&self, name: &str) -> Option<[f64; 3]> {
        let points = self.points(None, name);
        let half = self.steps() as f64 / 2.0;
        let middle = points.iter().rfind(|(step, _)| *step <= half).or(points.first())?;
        Some([points.first()?.1, middle.1, points.last()?.1])
    }

    /// The last validation's value of this name.
    pub fn last_validation(&self, name: &str) -> Option<f64> {
        self.points(Some(RecordKind::Valid), name).last().map(|(_, value)| *value)
    }

    /// (step, value) of the records of a kind (of any, if none is given) that hold a value.
    pub fn points(&self, kind: Option<RecordKind>, name: &str) -> Vec<(f64, f64)> {
        metrics::points(&self.records, kind, name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_last_phase_gave_up_is_left_out() {
        let record = |(kind, phase, step, score): (RecordKind, &str, u64, Option<f64>)| Record {
            score,
            pred_loss: score,
            ..Record::new(kind, phase, step)
        };
        let (valid, train) = (RecordKind::Valid, RecordKind::Train);
        let before = [(valid, "discover", 5, Some(0.1)), (valid, "join", 5, Some(3.0)), (train, "join", 6, None)];
        let course = |after: &[(RecordKind, &str, u64, Option<f64>)]| Course {
            records: before.iter().chain(after).copied().map(record).collect(),
        };
        let last = |course: &Course| (course.to_best().steps(), course.to_best().last_validation("pred_loss"));
        // Of equal ones the first is kept, as in a training; a score that is not a number is none.
        let worse =
            course(&[(valid, "join", 10, Some(2.0)), (valid, "join", 15, Some(2.0)), (valid, "join", 20, None)]);
        assert_eq!(last(&worse), (10, Some(2.0)));
        assert_eq!(last(&course(&[(valid, "join", 10, Some(4.0))])), (5, Some(3.0)));
        assert_eq!(last(&course(&[(valid, "join", 10, Some(2.5))])), (10, Some(2.5)));
        let unfinished = Course { records: vec![record((train, "join", 6, None))] };
        assert_eq!(unfinished.to_best().steps(), 6);
    }

    #[test]
    fn an_answer_counts_from_where_it_stays() {
        // Right by chance, wrong again, right to the end; a record without a time says nothing.
        let record = |(seconds, k): (Option<f64>, f64)| Record {
            seconds,
            parameters: [("k".into(), k)].into(),
            ..Record::new(RecordKind::Valid, "join", 0)
        };
        let values = [(Some(1.0), 4.0), (Some(2.0), 5.0), (Some(3.0), 4.07), (None, 9.0), (Some(5.0), 3.99)];
        let course = Course { records: values.map(record).into() };
        assert_eq!(course.seconds_within("k", 4.0, 2.0), Some(3.0));
        assert_eq!(course.seconds_within("k", 4.0, 0.5), Some(5.0));
        assert_eq!(course.seconds_within("k", 4.0, 0.1), None);
        assert_eq!(course.seconds_within("l", 4.0, 2.0), None);
    }
}
