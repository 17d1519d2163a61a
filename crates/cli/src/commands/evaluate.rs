//! Scores a run on a dataset file. See `paig evaluate --help`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Result, ensure};
use clap::Args;
use paig::Error;
use paig::evaluation::{self, ScoredClips};
use paig::network::physics_models::losses::MeanLosses;
use paig::runs::scores::{FrameSpread, ScoresFile};
use paig::support::output::{FileKind, check_apart};
use paig::viz;
use paig_terminal::arguments::{ClipsOfRun, ScoredRun};
use paig_terminal::say;
use paig_terminal::table::print_frames_and_states;

/// Scores the last checkpoint of a run on any dataset file of its task.
///
/// Prints L_rec, L_pred and L_extrap, squared error and SSIM of every predicted frame, and, where the true states lie
/// beside the file, the errors of positions and velocities.
#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Example:\n  paig evaluate runs/spring_color/fast/seed=0 --json scores.json"
)]
pub struct EvaluateArguments {
    #[command(flatten)]
    run: ScoredRun,
    /// Write the numbers to this file, too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Plot SSIM and squared error over the predicted frames to this PNG
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
}

pub fn run(arguments: &EvaluateArguments) -> Result<ExitCode> {
    let places = Places::check(arguments)?;
    let opened = arguments.run.open()?;
    let clips = arguments.run.read_clips(&opened)?;
    score(&arguments.run.run, &places, opened, &clips).map_err(Error::of_work)?;
    Ok(ExitCode::SUCCESS)
}

fn score(run: &Path, places: &Places, opened: ClipsOfRun, clips: &ScoredClips) -> Result<()> {
    let ClipsOfRun { config, model, file, split, .. } = opened;
    let scores = evaluation::evaluate(&model, clips)?;
    say!("{} on the {} clips of {} ({})", run.display(), scores.clips, file.display(), split.name());
    say!();
    clips.notes.iter().for_each(|note| say!("note: {note}"));
    print_losses(&scores.losses);
    print_frames_and_states(&model.system, &scores);
    if let Some(path) = &places.picture {
        let frames = FrameSpread::of([&scores.predicted_frames[..]]);
        viz::write_frame_scores(path, &config.task, &frames)?;
    }
    if let Some(path) = &places.json {
        ScoresFile {
            format: ScoresFile::FORMAT,
            task: config.task.name.clone(),
            run: run.into(),
            file,
            split: split.name().into(),
            parameters: model.parameter_values().into_iter().map(|(name, value)| (name.into(), value)).collect(),
            scores,
        }
        .write(path)?;
    }
    Ok(())
}

/// Files to write. They are checked first: one that cannot be written must not cost the scoring.
struct Places {
    json: Option<PathBuf>,
    picture: Option<PathBuf>,
}

impl Places {
    fn check(arguments: &EvaluateArguments) -> Result<Self> {
        let inputs: Vec<&Path> = arguments.run.file.as_deref().into_iter().collect();
        let place =
            |kind: FileKind, path: &Option<PathBuf>| path.as_ref().map(|path| kind.check(path, &inputs)).transpose();
        let (json, picture) =
            (place(ScoresFile::KIND, &arguments.json)?, place(viz::FRAME_SCORES, &arguments.picture)?);
        check_apart(&[&json, &picture].into_iter().flatten().map(PathBuf::as_path).collect::<Vec<_>>())?;
        if let Some(picture) = &arguments.picture {
            let png = picture.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
            ensure!(png, "--picture {}: a PNG is written, its name must end in .png", picture.display());
        }
        Ok(Places { json, picture })
    }
}

fn print_losses(losses: &MeanLosses) {
    say!("L_rec {:.4}   L_pred {:.4}", losses.recons_loss, losses.pred_loss);
    if let Some(loss) = losses.extrap_loss {
        say!("L_extrap {loss:.4}");
    }
    say!();
}
