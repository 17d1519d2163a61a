//! The report: results.json, search.json, a page and its figures. It shows what was run and nothing else.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use anyhow::{Context, Result};

use super::figures::OfTask;
use super::list::{BaselineEntry, Comparison};
use super::results::{BaselineRow, FRAMES, RESULTS, SEARCH, Searched};
use paig::support::output::FileSet;
use paig::support::statistics::Spread;
use paig::support::storage::storage;
use paig::support::{atomic, json_lines};
use paig::tasks::Task;

/// The page and its pictures, beside the [results](super::results).
const PAGE: &str = "report.md";
const PICTURES: &str = "pictures";
const TITLE: &str = "# The paper's comparison";
/// The files of the report. The page comes last: it shows whose the others are.
pub const FILES: FileSet = FileSet {
    name: "the comparison's report",
    files: &[PICTURES, FRAMES, RESULTS, SEARCH, PAGE],
    recognizes: |page| page.starts_with(TITLE.as_bytes()),
};
/// A frame that is less similar to the truth than this is lost.
const SIMILAR: f64 = 0.9;

/// All that is reported.
#[derive(Debug)]
pub struct Report<'a> {
    pub list: &'a Comparison,
    /// That count: the list's, and others that were asked for.
    pub seeds: &'a [u64],
    pub rows: Vec<BaselineRow>,
    pub searched: Vec<Searched>,
    /// Training clips of the comparison; other rows count for the data efficiency.
    pub clips: usize,
    /// Whether figures are drawn and shown.
    pub pictures: bool,
}

impl Report<'_> {
    /// Writes the report into a folder.
    ///
    /// # Errors
    /// A folder that cannot be written, a damaged run.
    pub fn write(&self, out: &Path) -> Result<()> {
        FILES.replace(out, |out| {
            for folder in [PICTURES, FRAMES] {
                let folder = out.join(folder);
                storage().create_folder(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
            }
            let json = |name: &str, write: &dyn Fn(&mut atomic::FileWriter) -> serde_json::Result<()>| {
                atomic::write_file(&out.join(name), |file| Ok(write(file)?))
            };
            json(RESULTS, &|file| json_lines::write(file, &self.rows, 1))?;
            json(SEARCH, &|file| json_lines::write(file, &self.searched, 1))?;
            let page = self.page(out)?;
            atomic::write_file(&out.join(PAGE), |file| Ok(file.write_all(page.as_bytes())?))
        })
    }

    fn page(&self, out: &Path) -> Result<String> {
        let mut page = String::new();
        let (models, tasks) = (self.list.models.len(), self.list.tasks.len());
        let seeds = self.seeds.len();
        let whole: Vec<&BaselineRow> = self.rows.iter().filter(|row| row.training_clips == self.clips).collect();
        let _ = writeln!(
            page,
            "{TITLE}\n\nMade by `make baselines` ([models and method](../../docs/baselines.md)). The whole comparison has {models} \
             models x {tasks} tasks x {seeds} seeds; **{} of these {} trainings are finished** on {} training clips of their \
             task. Unfinished ones are not shown. Sizes of the other models are ours. In figures the number in brackets counts \
             a model's seeds; lines are medians, bands reach from the smallest to the largest seed. Steps and minutes are those \
             of a model's own training, without the run that finds the objects for all models of a task, seed and number of \
             clips.\n",
            whole.len(),
            models * tasks * seeds,
            self.clips
        );
        if !self.pictures {
            page.push_str(
                "This page has no figures: `paig baselines --report-only --add` with this folder draws them.\n\n",
            );
        }
        self.sizes(&mut page);
        self.search(&mut page);
        for task in self.list.all_tasks()? {
            self.task(&mut page, &task, out)?;
        }
        self.efficiency(&mut page);
        Ok(page)
    }

    /// Weights of each model on each task: all of them, by how much they differ from the first model's, and those of what
    /// carries positions on.
    fn sizes(&self, page: &mut String) {
        let (tasks, models) = (&self.list.tasks, &self.list.models);
        let _ = writeln!(
            page,
            "## Sizes\n\nAll weights, relative to {}; in brackets the weights of the dynamics.\n\n\
             | model | {} |\n|---|{}",
            models.first().map_or("-", |entry| &entry.label),
            tasks.join(" | "),
            "---|".repeat(tasks.len())
        );
        let row = |entry: &BaselineEntry, task: &String| {
            self.rows.iter().find(|row| row.model == entry.name && row.task == *task)
        };
        let size = |entry: &BaselineEntry, task: &String| {
            let Some(of_model) = row(entry, task) else { return "-".into() };
            let first = models.first().and_then(|first| row(first, task));
            let times = first
                .map_or(String::new(), |first| format!(" = {:.2} x", of_model.weights as f64 / first.weights as f64));
            let carries = of_model.dynamics_weights.map_or(String::new(), |count| format!(" ({count})"));
            format!("{}{times}{carries}", of_model.weights)
        };
        for entry in models.iter().filter(|entry| tasks.iter().any(|task| row(entry, task).is_some())) {
            let sizes: Vec<String> = tasks.iter().map(|task| size(entry, task)).collect();
            let _ = writeln!(page, "| {} | {} |", entry.label, sizes.join(" | "));
        }
    }

    fn search(&self, page: &mut String) {
        let mut tried: Vec<f64> =
            self.searched.iter().flat_map(|search| search.rates.iter().map(|(rate, _)| *rate)).collect();
        tried.sort_by(f64::total_cmp);
        tried.dedup();
        let _ = writeln!(
            page,
            "\n## Search of the learning rates\n\nL_pred on the validation clips of `{}` at the end of a training with \
             seed {}, for each rate; end-to-end baselines: the error of all frames after the input. All tasks use the best \
             rate. A rate at which training failed ranks last; a model without a finished search uses its recipe's rate.\n\n| model | key | {} | taken |\n|---|---|{}---|",
            self.list.search.task,
            self.list.search.seed,
            tried.iter().map(|rate| format!("{rate:e}")).collect::<Vec<_>>().join(" | "),
            "---|".repeat(tried.len())
        );
        for Searched { model, key, rates, failed, chosen, .. } in &self.searched {
            let score = |rate: &f64| match rates.iter().find(|(known, _)| known == rate) {
                Some((_, Some(score))) => format!("{score:.3}"),
                Some((_, None)) if failed.contains(rate) => "failed".into(),
                Some((_, None)) => "not run".into(),
                None => "-".into(),
            };
            let scores = tried.iter().map(score);
            let taken = chosen.map_or("-".into(), |rate| format!("{rate:e}"));
            let _ = writeln!(
                page,
                "| {} | {key} | {} | {taken} |",
                self.label(model),
                scores.collect::<Vec<_>>().join(" | ")
            );
        }
    }

    fn label<'a>(&'a self, model: &'a str) -> &'a str {
        self.list.model(model).map_or(model, |entry| &entry.label)
    }

    fn task(&self, page: &mut String, task: &Task, out: &Path) -> Result<()> {
        let of_task = |row: &&BaselineRow| row.task == task.name && row.training_clips == self.clips;
        let rows: Vec<BaselineRow> = self.rows.iter().filter(of_task).cloned().collect();
        let _ = writeln!(page, "\n## {}\n", task.name);
        if rows.is_empty() {
            page.push_str("Not run.\n");
            return Ok(());
        }
        self.table(page, task, &rows, |_| true);
        let ablation = |entry: &BaselineEntry| entry.ablation || entry.name == "physics";
        if rows.iter().any(|row| self.list.model(&row.model).is_ok_and(|entry| entry.ablation)) {
            page.push_str("\nThe ablation alone:\n\n");
            self.table(page, task, &rows, ablation);
        }
        let figures = OfTask { list: self.list, task, rows: &rows };
        // Also without figures: a later report draws them of these.
        let gallery = figures.gallery_rows(&out.join(FRAMES))?;
        if !self.pictures {
            return Ok(());
        }
        type DrawFigure<'a> = &'a dyn Fn(&Path) -> Result<bool>;
        let drawn: [(&str, &str, DrawFigure); 5] = [
            ("frames", "SSIM and squared error of each predicted frame", &|path| figures.frame_scores(path)),
            ("gallery", "future frames of the first test clip", &|path| figures.gallery(path, &gallery)),
            (
                "parameters",
                "the physical parameters over the steps; kept are the weights of the best validation, which need not be the \
                 last",
                &|path| figures.parameters(path),
            ),
            ("black-boxes", "L_pred of the black boxes on validation clips", &|path| figures.black_boxes(path)),
            ("whole", "validation error of the end-to-end baselines", &|path| figures.end_to_end(path)),
        ];
        for (name, caption, draw) in drawn {
            let file = format!("{}-{name}.png", task.name);
            if draw(&out.join(PICTURES).join(&file))? {
                let _ = writeln!(page, "\n![{}: {caption}]({PICTURES}/{file})", task.name);
            }
        }
        Ok(())
    }

    /// A line for each of these models.
    fn table(&self, page: &mut String, task: &Task, rows: &[BaselineRow], shown: impl Fn(&BaselineEntry) -> bool) {
        let _ = writeln!(
            page,
            "| model | seeds | parameters | L_rec | L_pred | L_extrap | SSIM, end of T_pred | SSIM, last frame | SSIM < {SIMILAR} from \
             frame | steps | minutes |\n|---|---|---|---|---|---|---|---|---|---|---|"
        );
        let (input, pred) = (task.system.input_steps, task.system.pred_steps);
        for entry in self.list.models.iter().filter(|entry| shown(entry)) {
            let of_model: Vec<&BaselineRow> = rows.iter().filter(|row| row.model == entry.name).collect();
            if of_model.is_empty() {
                let _ = writeln!(page, "| {} | 0 | | | | | | | | | |", entry.label);
                continue;
            }
            let spread = |digits: usize, number: &dyn Fn(&BaselineRow) -> Option<f64>| {
                Spread::of(of_model.iter().filter_map(|row| number(row)))
                    .map_or("-".into(), |spread| spread.text(|value| format!("{value:.digits$}")))
            };
            let lost: Vec<String> = of_model
                .iter()
                .map(|row| row.falls_below(SIMILAR, input).map_or("never".into(), |frame| frame.to_string()))
                .collect();
            let seeds: Vec<String> = of_model.iter().map(|row| row.seed.to_string()).collect();
            let _ = writeln!(
                page,
                "| {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
                entry.label,
                seeds.join(", "),
                parameters(&of_model),
                spread(3, &|row| row.recons_loss),
                spread(3, &|row| Some(row.pred_loss)),
                spread(2, &|row| row.extrap_loss),
                spread(3, &|row| row.ssim.get(pred - 1).copied()),
                spread(3, &|row| row.ssim.last().copied()),
                lost.join(", "),
                spread(0, &|row| Some(row.steps as f64)),
                spread(1, &|row| Some(row.seconds / 60.0)),
            );
        }
        let counts: BTreeSet<(usize, usize)> = rows.iter().map(|row| (row.training_clips, row.test_clips)).collect();
        for (training, test) in counts {
            let _ = writeln!(page, "\nTrained on {training} clips, scored on {test}.");
        }
    }

    /// Scores over the number of training clips.
    fn efficiency(&self, page: &mut String) {
        let efficiency = &self.list.efficiency;
        let _ = writeln!(
            page,
            "\n## Fewer training clips\n\n`{}`, the models of the comparison that were also trained on fewer clips.\n\n\
             | model | training clips | seeds | L_pred | L_extrap | parameters |\n|---|---|---|---|---|---|",
            efficiency.task
        );
        let mut counts: Vec<usize> = efficiency.train.iter().copied().chain([self.clips]).collect();
        counts.sort_unstable_by(|a, b| b.cmp(a));
        counts.dedup();
        for name in &efficiency.models {
            for &clips in &counts {
                let of = |row: &&BaselineRow| {
                    row.model == *name && row.task == efficiency.task && row.training_clips == clips
                };
                let rows: Vec<&BaselineRow> = self.rows.iter().filter(of).collect();
                let spread = |number: &dyn Fn(&BaselineRow) -> Option<f64>| {
                    Spread::of(rows.iter().filter_map(|row| number(row)))
                        .map_or("not run".into(), |spread| spread.text(|value| format!("{value:.2}")))
                };
                let _ = writeln!(
                    page,
                    "| {} | {clips} | {} | {} | {} | {} |",
                    self.label(name),
                    rows.len(),
                    spread(&|row| Some(row.pred_loss)),
                    spread(&|row| row.extrap_loss),
                    parameters(&rows)
                );
            }
        }
    }
}

/// Each parameter that was learned, with its error.
fn parameters(rows: &[&BaselineRow]) -> String {
    let names: BTreeSet<&String> = rows.iter().flat_map(|row| row.parameters.keys()).collect();
    let of_name = |name: &String| {
        let known = || rows.iter().filter_map(|row| row.parameters.get(name));
        let values = Spread::of(known().map(|parameter| parameter.learned))?.text(|value| format!("{value:.3}"));
        let errors = Spread::of(known().filter_map(|parameter| Some(parameter.error_percent()?.abs())));
        let error = errors.map_or(String::new(), |errors| format!(" (off by at most {:.2} %)", errors.max));
        Some(format!("{name} {values}{error}"))
    };
    let texts: Vec<String> = names.into_iter().filter_map(of_name).collect();
    if texts.is_empty() { "-".into() } else { texts.join(", ") }
}
