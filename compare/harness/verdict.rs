//! The rows of a file with their verdicts: uninformative rows are held by the single steps of the same tensor.

use std::path::Path;

use crate::harness::row::{ParityRow, RowVerdict};

/// A row, and what it says beside the other rows of its file.
#[derive(Debug)]
pub struct JudgedRow {
    pub row: ParityRow,
    pub verdict: RowVerdict,
    /// What holds the tensor of a row that is uninformative by itself.
    pub held: Option<UninformativeCheck>,
}

/// What holds a tensor whose row is uninformative by itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum UninformativeCheck {
    /// The row of this title, which compares the tensor one step at a time. If that row fails, so does this.
    BySingleStep(String),
    /// Nothing: a file's gradients, say, cannot be followed one step at a time.
    NotAtAll,
}

/// Judges all rows of a file.
pub fn judge(rows: Vec<ParityRow>) -> Vec<JudgedRow> {
    let verdicts: Vec<_> = rows.iter().map(|row| verdict(row, &rows)).collect();
    rows.into_iter().zip(verdicts).map(|(row, (verdict, held))| JudgedRow { row, verdict, held }).collect()
}

fn verdict(row: &ParityRow, rows: &[ParityRow]) -> (RowVerdict, Option<UninformativeCheck>) {
    let alone = row.verdict();
    if alone != RowVerdict::Uninformative {
        return (alone, None);
    }
    match rows.iter().find(|step| step.single_step_of.as_deref() == Some(&row.title)) {
        None => (RowVerdict::Uninformative, Some(UninformativeCheck::NotAtAll)),
        Some(step) => {
            let held = if step.verdict() == RowVerdict::Pass { RowVerdict::Uninformative } else { RowVerdict::Fail };
            (held, Some(UninformativeCheck::BySingleStep(step.title.clone())))
        }
    }
}

impl JudgedRow {
    /// The verdict in words, with the reason where there is more to say.
    pub fn words(&self) -> String {
        let JudgedRow { row, verdict, held } = self;
        match (verdict, held, row.beyond()) {
            (RowVerdict::Pass, _, 0) => "pass".into(),
            (RowVerdict::Pass, _, beyond) => format!("pass ({beyond} within their own rounding)"),
            (RowVerdict::Fail, Some(UninformativeCheck::BySingleStep(step)), _) => {
                format!("FAIL (uninformative, and {step:?} fails)")
            }
            (RowVerdict::Fail, _, beyond) => format!("FAIL ({beyond} beyond)"),
            (RowVerdict::Uninformative, held, _) => {
                let held = match held {
                    Some(UninformativeCheck::BySingleStep(step)) => format!("held by {step:?}"),
                    _ => "not held by a single step".into(),
                };
                format!("uninformative (rounding moves it by {:.1e} of its scale; {held})", row.movement())
            }
        }
    }

    /// For `--rows`; a NaN becomes null.
    pub fn json(&self, path: &Path) -> serde_json::Value {
        let JudgedRow { row, verdict, held } = self;
        serde_json::json!({
            "file": path.file_stem().unwrap_or_default().to_string_lossy(),
            "tensor": row.title,
            "absolute": row.absolute,
            "relative": row.relative,
            "tolerance": row.tolerance.relative,
            "beyond": row.beyond(),
            // Measured where a tolerance is missed.
            "movement": (!row.within_tolerance()).then(|| row.movement()),
            "verdict": match verdict {
                RowVerdict::Pass => "pass",
                RowVerdict::Fail => "fail",
                RowVerdict::Uninformative => "uninformative",
            },
            "held_by": match held {
                Some(UninformativeCheck::BySingleStep(step)) => Some(step),
                _ => None,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use tch::Tensor;

    use super::*;
    use crate::tolerances::FORWARD;

    /// A row of a tensor of scale 1 that is off by `off` and that rounding moves by half of its scale.
    fn chaotic(title: &str, off: f64) -> ParityRow {
        let of = |value: f64| ParityRow::new(title, &Tensor::from(1.0), &Tensor::from(value), &FORWARD);
        let mut row = of(1.0 + off);
        row.allow_for(&of(1.5 + off), 1.0);
        row
    }

    fn single_step(tensor: &str, off: f64) -> ParityRow {
        ParityRow::single_step(tensor, "step by step", &Tensor::from(1.0), &Tensor::from(1.0 + off))
    }

    fn verdicts(rows: Vec<ParityRow>) -> Vec<(RowVerdict, Option<UninformativeCheck>)> {
        judge(rows).into_iter().map(|judged| (judged.verdict, judged.held)).collect()
    }

    #[test]
    fn uninformative_row_is_held_by_its_own_single_step() {
        let held = UninformativeCheck::BySingleStep("out/pos, step by step".into());
        let others = |step| vec![chaotic("out/pos", 3.0), single_step("out/vel", 1.0), single_step("out/pos", step)];
        let [whole, _, step] = &verdicts(others(1e-6))[..] else { panic!() };
        assert_eq!(*whole, (RowVerdict::Uninformative, Some(held.clone())));
        assert_eq!(*step, (RowVerdict::Pass, None));
        let [whole, _, step] = &verdicts(others(0.01))[..] else { panic!() };
        assert_eq!(*whole, (RowVerdict::Fail, Some(held)));
        assert_eq!(*step, (RowVerdict::Fail, None));
    }

    #[test]
    fn uninformative_row_without_a_single_step_says_so() {
        let judged = judge(vec![chaotic("grad/pos", 3.0), single_step("out/pos", 0.0)]);
        assert_eq!(judged[0].held, Some(UninformativeCheck::NotAtAll));
        let words = judged[0].words();
        assert_eq!(words, "uninformative (rounding moves it by 5.0e-1 of its scale; not held by a single step)");
        let json = judged[0].json(Path::new("some/file.npz"));
        assert_eq!((&json["verdict"], &json["held_by"]), (&"uninformative".into(), &serde_json::Value::Null));
    }
}
