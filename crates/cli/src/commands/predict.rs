//! Rolls a learned system out from one clip. See `paig predict --help`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, ensure};
use clap::Args;
use paig::Error;
use paig::evaluation::ScoredClips;
use paig::evaluation::rollout::{self, MOST_FRAMES};
use paig::viz;
use paig_terminal::arguments::{ClipsOfRun, ScoredRun};
use paig_terminal::progress::PhaseProgress;
use paig_terminal::say;

/// Predicts frames, positions and velocities from the first frames of a clip, as far as asked.
///
/// Writes frames.png and animation.gif (clip above model), states.csv and rollout.npz.
#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Example:\n  paig predict runs/spring_color/fast/seed=0 --clip 3 --frames 60 --out prediction"
)]
pub struct PredictArguments {
    #[command(flatten)]
    run: ScoredRun,
    /// The clip, counted from 0
    #[arg(long, default_value_t = 0)]
    clip: usize,
    /// Frames to predict [default: as many as the clip has after its input]; beyond the clip nothing acts from outside
    #[arg(long)]
    frames: Option<usize>,
    /// Folder for the results; files of an earlier prediction are replaced
    #[arg(long, default_value = "prediction")]
    out: PathBuf,
}

/// Frames from which on drawing takes minutes.
const MANY_FRAMES: usize = 1000;

pub fn run(arguments: &PredictArguments) -> Result<ExitCode> {
    viz::check_rollout_folder(&arguments.out)?;
    ensure!(
        arguments.frames.is_none_or(|frames| frames <= MOST_FRAMES),
        "--frames: at most {MOST_FRAMES} are predicted at once"
    );
    let opened = arguments.run.open()?;
    let ScoredClips { clips, notes, .. } = arguments.run.read_clips(&opened)?;
    let ClipsOfRun { model, file, split, .. } = opened;
    notes.iter().for_each(|note| say!("note: {note}"));
    ensure!(
        arguments.clip < clips.len(),
        "there is no clip {}; {} of {} holds {} clips, counted from 0",
        arguments.clip,
        split.name(),
        file.display(),
        clips.len()
    );
    let clip = clips.batch(&[arguments.clip as i64], clips.time()).squeeze_dim(0);
    let frames = arguments.frames.unwrap_or(clips.time() - model.system.input_steps);
    if frames > MANY_FRAMES {
        say!("predicts and draws {frames} frames, which takes some minutes");
    }
    let waiting = PhaseProgress::busy("predicting");
    let prediction = rollout::roll_out(&model, &clip, &clips.actions(&[arguments.clip as i64]), frames)?;
    let written = viz::write_rollout(&arguments.out, &model.system, &prediction).map_err(Error::of_work);
    waiting.finish();
    written?;
    let frames = if frames == 1 { "1 frame".into() } else { format!("{frames} frames") };
    say!("{frames} after the input of clip {}: {}", arguments.clip, arguments.out.display());
    Ok(ExitCode::SUCCESS)
}
