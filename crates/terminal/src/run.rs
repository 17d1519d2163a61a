//! A run from the command line: its options, and the programs of single tasks.
//!
//! Original: `run_physics.py`. The runners in `runners/` hold only a task's name and a call.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::{Args, Parser};
use paig::generators::{DatasetJob, generate};
use paig::run::{Ending, Mode, Program, Request, Run};
use paig::training::config::Config;
use paig::training::layers::Overrides;

use crate::ending::exit_code;
use crate::generate_display::GenerateDisplay;
use crate::progress::write_text;
use crate::screen::Screen;
use crate::{interrupt, say, usage};

/// Options of a run.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// A config (TOML) with what differs from the recipe
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// The recipe to start from: fast (default) or paper
    #[arg(long)]
    recipe: Option<String>,
    /// Set one key of the config, for example --set join.batch=50; may be repeated. --print-config shows all keys, the
    /// recipes in configs/ say what they mean
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Run folder [default: runs/TASK/RECIPE/seed=N]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Folder of the datasets [default: data/datasets; the folder of the task's file where its data.folder is "."]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Seed of initial values and of the order of the data [default: 0]
    #[arg(long)]
    seed: Option<u64>,
    /// cpu, cuda or cuda:n [default: cpu]
    #[arg(long)]
    device: Option<String>,
    /// Threads to compute with; 0 for one a core [default: 0]
    #[arg(long)]
    threads: Option<usize>,
    /// Go on with the run in --out, to the same result as if it had never stopped (to the bit with as many threads). Of
    /// the other options only --device, --threads and --data may differ from the run's own
    #[arg(long)]
    resume: bool,
    /// Do not train: score the last checkpoint of the run in --out on the test file
    #[arg(long)]
    test_mode: bool,
    /// Generate the task's plain dataset first (5000 + 500 + 500 clips, seed 0) if it is not there
    #[arg(long)]
    generate: bool,
    /// Print the complete config and stop
    #[arg(long)]
    print_config: bool,
}

impl RunArgs {
    /// Opens the run, and generates its dataset where that was asked for.
    ///
    /// # Errors
    /// A config that cannot be read, a folder that is not free, a dataset that cannot be generated.
    pub fn open(&self, task: Option<&str>) -> Result<Run> {
        let run = self.request(task).open()?;
        let Config { task, data, .. } = &run.config;
        if self.generate && !data.train_path().exists() {
            let display = GenerateDisplay::default();
            let job = DatasetJob::plain(task, PathBuf::from(&data.folder))?;
            generate(&job, &|event| display.show(event))?;
        }
        Ok(run)
    }

    /// Prints the config of the run if that is all that was asked for.
    ///
    /// # Errors
    /// A config that cannot be read.
    pub fn printed_config(&self, task: Option<&str>) -> Result<bool> {
        if self.print_config {
            write_text(&format!("{}\n", self.request(task).config()?.to_toml().trim_end()));
        }
        Ok(self.print_config)
    }

    /// The run of these options.
    fn request(&self, task: Option<&str>) -> Request {
        Request {
            config: self.config.clone(),
            overrides: Overrides {
                task: task.map(String::from),
                recipe: self.recipe.clone(),
                seed: self.seed,
                device: self.device.clone(),
                threads: self.threads,
                data: self.data.clone(),
                set: self.set.clone(),
            },
            out: self.out.clone(),
            mode: match (self.test_mode, self.resume) {
                (true, _) => Mode::Score,
                (false, true) => Mode::Resume,
                (false, false) => Mode::Begin,
            },
        }
    }
}

/// The program of a single task.
#[derive(Debug, Parser)]
#[command(
    version,
    allow_negative_numbers = true,
    about = "Trains PAIG on one task; `paig train --task` does the same for any"
)]
struct OneTask {
    #[command(flatten)]
    run: RunArgs,
}

/// Entry of a task's own program.
pub fn one_task(task: &str, program: Program) -> ExitCode {
    exit_code(|| {
        let OneTask { run } = match usage::parsed() {
            Ok(parsed) => parsed,
            Err(code) => return Ok(code),
        };
        if run.printed_config(Some(task))? {
            return Ok(ExitCode::SUCCESS);
        }
        let mut screen = Screen::new(program);
        let run = run.open(Some(task))?.prepare(&mut screen)?;
        interrupt::catch()?;
        match run.execute(program, &mut screen, &interrupt::asked)? {
            Ending::Finished(summary) => {
                summary.verdict.iter().for_each(|verdict| write_text(&format!("{verdict}\n")));
                Ok(ExitCode::SUCCESS)
            }
            Ending::Scored => Ok(ExitCode::SUCCESS),
            Ending::Interrupted { steps } => Ok(interrupted(steps, &run)),
        }
    })
}

/// Says how a run that was stopped goes on; the exit code.
pub fn interrupted(steps: u64, run: &paig::run::Prepared) -> ExitCode {
    say!("stopped after step {steps}; go on with --resume --out {}", run.folder.path().display());
    interrupt::exit_code()
}
