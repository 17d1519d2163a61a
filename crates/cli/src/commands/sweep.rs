//! Runs tasks x seeds, a few at a time. See `paig sweep --help`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::Args;
use paig::support::device;
use paig::support::guard::ensure_no_run;
use paig::tasks;
use paig_experiments::sweep::{self, JobState, RunStatus, SweepPlan, SweepRequest, parse_seeds};
use paig_terminal::{interrupt, say};

use crate::sweep_display::{SweepDisplay, conclude};

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
pub struct SweepArguments {
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

pub fn run(arguments: SweepArguments) -> Result<ExitCode> {
    ensure!(arguments.jobs > 0, "--jobs must be at least 1");
    let cores = device::cores();
    let request = SweepRequest {
        plan: SweepPlan {
            tasks: arguments.task,
            seeds: parse_seeds(&arguments.seeds)?,
            recipe: arguments.recipe,
            name: arguments.name,
            config: arguments.config,
            set: arguments.set,
            data: arguments.data,
            device: arguments.device,
            threads: arguments.threads_per_run.unwrap_or((cores / arguments.jobs).max(1)),
            out: arguments.out,
        },
        grid: arguments.grid,
        variants: arguments.variant,
    };
    let plans = request.plans()?;
    let jobs = sweep::jobs(&plans)?;
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
    ensure_no_run(&plans[0].out)?;
    let program = sweep::training_program()?;
    interrupt::catch()?;
    let mut display = SweepDisplay::new(jobs.len());
    let summary = sweep::run(&program, &jobs, arguments.jobs, &interrupt::asked, &mut |event| display.show(&event))?;
    display.close();
    Ok(conclude(&summary))
}

/// A line for each run.
fn print_status(runs: &[RunStatus]) {
    say!("{:<11}{:>9}  {:>8}{:>10}  {:<10}run", "state", "phase", "steps", "seconds", "verdict");
    for RunStatus { folder, state, phase, steps, seconds, found } in runs {
        let verdict = found.map_or("-", |found| if found { "found" } else { "not found" });
        let (word, phase) = (state.word(), phase.as_deref().unwrap_or("-"));
        say!("{word:<11}{phase:>9}  {steps:>8}{seconds:>10.0}  {verdict:<10}{}", folder.display());
        if let JobState::Unreadable(why) = state {
            say!("    {why}");
        }
    }
}
