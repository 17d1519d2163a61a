//! Runs tasks x seeds, a few at a time. See `paig sweep --help`.

use std::path::PathBuf;
use std::process::ExitCode;

use crate::sweep_display::SweepDisplay;
use anyhow::{Context, Result, ensure};
use clap::Args;
use paig::support::device;
use paig::tasks;
use paig_experiments::sweep::{self, RunState, RunStatus, SweepPlan, SweepSummary};
use paig_terminal::arguments::{MOST_RUNS, parse_seeds};
use paig_terminal::ending::begin_work;
use paig_terminal::interrupt;
use paig_terminal::say;

/// Trains tasks x seeds as processes of `paig train`, a few at a time.
///
/// A run goes to OUT/TASK/RECIPE/seed=N (or OUT/TASK/RECIPE-NAME/seed=N), what it prints to output.log there. Given
/// again, the same command skips what has finished (a file DONE marks it) and goes on with what was cut off. A run
/// that fails stops no other one; the exit code is 1 then, and 130 if the sweep was stopped (Ctrl-C: the runs save).
#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:\n  paig sweep --task spring_color --task 3bp_color --seeds 0-9 --jobs 2\n  \
                  sweep --task spring_color --seeds 0-4 --grid model.exact_shift=true,false\n  \
                  sweep --task spring_color --seeds 0-9 --dry-run > commands.txt && parallel < commands.txt"
)]
pub struct Arguments {
    #[arg(long, required = true)]
    #[arg(help = format!("System to learn: a task file (.toml), or one of {}; may be repeated", tasks::names()))]
    task: Vec<String>,
    /// Seeds, such as 0-9 or 1,4,7-8
    #[arg(long, default_value = "0")]
    seeds: String,
    /// Recipe: fast or paper
    #[arg(long, default_value = "fast")]
    recipe: String,
    /// A config (TOML) with what differs from the recipe
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Set one key of the config, for example --set join.batch=50; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Try each of these values of a key, with those of every other --grid; may be repeated. The values name the folders
    #[arg(long, value_name = "KEY=V1,V2,..")]
    grid: Vec<String>,
    /// Beside the recipe as it is, try it with these changes alone; may be repeated, as in an ablation. The changes name
    /// the folders
    #[arg(long, value_name = "KEY=VALUE ..", conflicts_with = "grid")]
    variant: Vec<String>,
    /// Name of a changed recipe, for the run folders; --set and --config need one
    #[arg(long)]
    name: Option<String>,
    /// Runs at a time
    #[arg(long, default_value_t = 1)]
    jobs: usize,
    /// Threads of each run [default: cores / jobs]
    #[arg(long, value_name = "N")]
    threads_per_run: Option<usize>,
    /// Folder of the runs
    #[arg(long, default_value = "runs")]
    out: PathBuf,
    /// Folder of the datasets [default: data/datasets; the folder of a task's file where its data.folder is "."]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// cpu, cuda or cuda:n [default: cpu]
    #[arg(long)]
    device: Option<String>,
    /// Run nothing: print how far each run is
    #[arg(long, conflicts_with = "dry_run")]
    status: bool,
    /// Run nothing: print a command for each run, one a line, for GNU parallel, a Slurm array or HyperQueue; to be run
    /// from this folder where --out, --data or --config are relative
    #[arg(long)]
    dry_run: bool,
}

pub fn run(arguments: Arguments) -> Result<ExitCode> {
    ensure!(arguments.jobs > 0, "--jobs must be at least 1");
    let cores = device::cores();
    let plan = SweepPlan {
        tasks: unique(arguments.task),
        seeds: parse_seeds(&arguments.seeds)?,
        recipe: arguments.recipe,
        name: arguments.name,
        config: arguments.config,
        set: arguments.set,
        data: arguments.data,
        device: arguments.device,
        threads: arguments.threads_per_run.unwrap_or((cores / arguments.jobs).max(1)),
        out: arguments.out,
    };
    ensure!(plan.threads > 0, "--threads-per-run must be at least 1");
    ensure!(
        plan.tasks.len().saturating_mul(plan.seeds.len()) <= MOST_RUNS,
        "more than {MOST_RUNS} runs; give a part of them"
    );
    device::threads(plan.threads).context("--threads-per-run")?;
    let plans = match &arguments.variant[..] {
        [] => grid(plan, &arguments.grid)?,
        variants => one_change_each(plan, variants)?,
    };
    ensure!(
        plans.iter().map(|plan| plan.tasks.len() * plan.seeds.len()).sum::<usize>() <= MOST_RUNS,
        "more than {MOST_RUNS} runs"
    );
    let mut jobs = Vec::new();
    for plan in &plans {
        jobs.extend(plan.jobs()?);
        ensure!(
            plan.name.is_none() || plan.config.is_some() || !plan.set.is_empty(),
            "--name is for a changed recipe; say what is changed with --set or --config, or leave it out"
        );
    }
    let jobs = sweep::each_once(jobs)?;
    if arguments.status {
        print_status(&sweep::status(&jobs));
        return Ok(ExitCode::SUCCESS);
    }
    if arguments.dry_run {
        let this = std::env::current_exe().context("cannot find this program's own place")?;
        for plan in &plans {
            plan.commands(&this, arguments.threads_per_run)?.iter().for_each(|command| say!("{command}"));
        }
        return Ok(ExitCode::SUCCESS);
    }
    let program = sweep::training_program()?;
    interrupt::catch()?;
    begin_work();
    let mut display = SweepDisplay::new(jobs.len());
    let summary = sweep::run(&program, &jobs, arguments.jobs, &interrupt::asked, &mut |event| display.show(&event))?;
    display.close();
    Ok(conclude(&summary))
}

/// A plan for each combination of the values, named after them.
fn grid(plan: SweepPlan, axes: &[String]) -> Result<Vec<SweepPlan>> {
    let mut plans = vec![plan];
    for axis in axes {
        let wrong = || format!("--grid {axis:?}: expected key=value,value, for example model.exact_shift=true,false");
        let (key, values) = axis.split_once('=').with_context(wrong)?;
        let values: Vec<_> = values.split(',').map(str::trim).collect();
        ensure!(!key.is_empty() && values.iter().all(|value| !value.is_empty()), wrong());
        ensure!(plans.len().saturating_mul(values.len()) <= MOST_RUNS, "--grid: more than {MOST_RUNS} combinations");
        let with = |plan: &SweepPlan, value: &&str| changed(plan, vec![format!("{key}={value}")]);
        plans = plans.iter().flat_map(|plan| values.iter().map(move |value| with(plan, value))).collect();
    }
    Ok(plans)
}

/// The plan as it is, and one for each variant.
fn one_change_each(plan: SweepPlan, variants: &[String]) -> Result<Vec<SweepPlan>> {
    let with = |variant: &String| {
        let sets: Vec<_> = variant.split_whitespace().map(String::from).collect();
        ensure!(!sets.is_empty(), "--variant {variant:?}: expected key=value, for example discover.guide.tie=0");
        Ok(changed(&plan, sets))
    };
    let variants = variants.iter().map(with).collect::<Result<Vec<_>>>()?;
    Ok([vec![plan], variants].concat())
}

/// The plan with more changes, named after them.
fn changed(plan: &SweepPlan, sets: Vec<String>) -> SweepPlan {
    let name = plan.name.iter().chain(&sets).cloned().collect::<Vec<_>>().join("-");
    SweepPlan { name: Some(name), set: [plan.set.clone(), sets].concat(), ..plan.clone() }
}

/// A line for each run.
fn print_status(runs: &[RunStatus]) {
    say!("{:<11}{:>9}  {:>8}{:>10}  {:<10}run", "state", "phase", "steps", "seconds", "verdict");
    for RunStatus { folder, state, phase, steps, seconds, found } in runs {
        let verdict = found.map_or("-", |found| if found { "found" } else { "not found" });
        let (word, phase) = (state.word(), phase.as_deref().unwrap_or("-"));
        say!("{word:<11}{phase:>9}  {steps:>8}{seconds:>10.0}  {verdict:<10}{}", folder.display());
        if let RunState::Unreadable(why) = state {
            say!("    {why}");
        }
    }
}

/// Prints how the sweep ended; returns the exit code.
fn conclude(summary: &SweepSummary) -> ExitCode {
    let SweepSummary { finished, skipped, stopped, in_use, failed } = summary;
    let in_use = if *in_use > 0 { format!(", {in_use} under way elsewhere") } else { String::new() };
    say!("{finished} finished, {skipped} skipped, {stopped} stopped, {} failed{in_use}", failed.len());
    for output in failed {
        say!("failed: see {}", output.display());
    }
    match (failed.is_empty(), stopped) {
        (false, _) => ExitCode::FAILURE,
        (true, 0) => ExitCode::SUCCESS,
        (true, _) => interrupt::exit_code(),
    }
}

/// Without the repetitions, in the order given: a run folder takes one run.
fn unique<T: PartialEq>(values: Vec<T>) -> Vec<T> {
    let mut kept = Vec::new();
    for value in values {
        if !kept.contains(&value) {
            kept.push(value);
        }
    }
    kept
}
