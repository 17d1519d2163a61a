//! Runs the stress suite and writes its report. See `paig stress --help`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use crate::sweep_display::SweepDisplay;
use anyhow::{Context, Result, ensure};
use clap::Args;
use paig::generators::generate;
use paig::support::storage;
use paig_experiments::stress::{self, Outcome, Scene, StressList, outcome};
use paig_experiments::sweep;
use paig_terminal::arguments::parse_seeds;
use paig_terminal::ending::begin_work;
use paig_terminal::generate_display::Display;
use paig_terminal::interrupt;
use paig_terminal::say;

/// Learns scenes unlike the paper's with the plain recipe, and writes a matrix of what became of them.
///
/// Each scene is filmed once for each data seed and learned from that. Given again, the same command skips what has
/// finished and goes on with what was cut off; the report is made of all runs with these data seeds that are there.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  paig stress --jobs 2\n  paig stress --scene spring_noise_10 --data-seeds 1 --report-only"
)]
pub struct Arguments {
    /// List of the scenes; their files lie in a folder of its name beside it
    #[arg(long, default_value = "configs/stress.toml")]
    list: PathBuf,
    /// A scene of the list; may be repeated [default: all]
    #[arg(long)]
    scene: Vec<String>,
    /// Seeds of the datasets. What is filmed with seed N is learned with seed N, of scenes that the list marks `nine` also
    /// with N + 100 and N + 200
    #[arg(long, default_value = "1-3")]
    data_seeds: String,
    /// Folder of the datasets
    #[arg(long, default_value = "data/stress")]
    data: PathBuf,
    /// Folder of the runs
    #[arg(long, default_value = "runs/stress")]
    runs: PathBuf,
    /// Folder of the report
    #[arg(long, default_value = "runs/stress/report")]
    out: PathBuf,
    /// The results.json of the suite's runs on another machine, by the same version of the program; may be repeated. Of what
    /// was run here, too, its rows are left out
    #[arg(long)]
    add: Vec<PathBuf>,
    /// Runs at a time, one thread each
    #[arg(long, default_value_t = 1)]
    jobs: usize,
    /// Only write the report of the runs that are there
    #[arg(long)]
    report_only: bool,
    /// Draw no pictures: a report that is small enough to be kept in a repository
    #[arg(long)]
    no_pictures: bool,
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    ensure!(arguments.jobs > 0, "--jobs must be at least 1");
    let list = StressList::read(&arguments.list)?;
    let chosen = list.of_names(&arguments.scene)?;
    let data_seeds = parse_seeds(&arguments.data_seeds)?;
    let code = if arguments.report_only { ExitCode::SUCCESS } else { learn(arguments, &chosen, &data_seeds)? };
    report(arguments, &list, &data_seeds)?;
    Ok(code)
}

/// Films and learns what is not there yet, one data seed after the other.
fn learn(arguments: &Arguments, scenes: &[&Scene], data_seeds: &[u64]) -> Result<ExitCode> {
    let program = sweep::training_program()?;
    interrupt::catch()?;
    begin_work();
    let mut failed = false;
    for &data_seed in data_seeds {
        let mut jobs = Vec::new();
        for scene in scenes {
            let display = Display::default();
            generate(&scene.dataset(&arguments.data, data_seed)?, &|event| display.show(event))?;
            jobs.extend(scene.plan(&arguments.data, &arguments.runs, data_seed, 1).jobs()?);
        }
        let mut display = SweepDisplay::new(jobs.len());
        let ended = sweep::run(&program, &jobs, arguments.jobs, &interrupt::asked, &mut |event| display.show(&event))?;
        display.close();
        failed |= !ended.failed.is_empty();
        if ended.stopped > 0 {
            say!("stopped; the same command goes on");
            return Ok(interrupt::exit_code());
        }
    }
    Ok(if failed { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// Writes the report of the runs of all scenes.
fn report(arguments: &Arguments, list: &StressList, data_seeds: &[u64]) -> Result<()> {
    let mut outcomes = Vec::new();
    let mut pictured = BTreeMap::new();
    for scene in &list.scenes {
        for &data_seed in data_seeds {
            for (seed, run) in scene.runs(&arguments.data, &arguments.runs, data_seed)? {
                outcomes.push(outcome(scene, data_seed, seed, &run)?);
                match run {
                    Ok(run) if run.summary.is_some() => _ = pictured.entry(scene.name.clone()).or_insert(run),
                    Ok(run) => say!("{}: not finished", run.folder.display()),
                    Err(error) => say!("{}, data {data_seed}, seed {seed}: {error:#}", scene.name),
                }
            }
        }
    }
    for file in &arguments.add {
        add(&mut outcomes, file)?;
    }
    let place = |outcome: &Outcome| list.scenes.iter().position(|scene| scene.name == outcome.scene);
    outcomes.sort_by_key(|outcome| (place(outcome), outcome.data_seed, outcome.seed));
    ensure!(!outcomes.is_empty(), "{} holds no run of the suite", arguments.runs.display());
    let succeeded = outcomes.iter().filter(|outcome| outcome.succeeded).count();
    stress::write(&arguments.out, list, &outcomes, (!arguments.no_pictures).then_some(&pictured))?;
    say!("{succeeded} of {} runs succeeded; {}", outcomes.len(), arguments.out.join("report.md").display());
    Ok(())
}

/// Adds those outcomes of a file whose run is not among them, or has not finished.
fn add(outcomes: &mut Vec<Outcome>, file: &Path) -> Result<()> {
    let read = || Ok::<Vec<Outcome>, anyhow::Error>(serde_json::from_slice(&storage::read(file)?)?);
    let run = |outcome: &Outcome| (outcome.scene.clone(), outcome.data_seed, outcome.seed);
    let others = read().with_context(|| format!("results of another machine, {}", file.display()))?;
    let there: BTreeSet<_> = others.iter().map(run).collect();
    outcomes.retain(|outcome| outcome.finished || !there.contains(&run(outcome)));
    let here: BTreeSet<_> = outcomes.iter().map(run).collect();
    outcomes.extend(others.into_iter().filter(|other| !here.contains(&run(other))));
    Ok(())
}
