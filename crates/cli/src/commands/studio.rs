//! A browser page for one's own video. See `paig studio --help`.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Context, Result};
use clap::Args;
use paig::support::guard::ensure_no_run;
use paig_studio::{ServerOptions, Studio, prepare, train};
use paig_terminal::{interrupt, say};

use crate::PROGRAM;

const MEGABYTE: u64 = 1_000_000;
/// Opens a link with the user's browser.
const OPENER: &str = "xdg-open";

/// Opens a page in the browser on which a video of one's own is measured by pointing: what moves, a known length, an equation.
///
/// The page is served on this machine alone and asks no other one for anything. Everything it does is a command, which it shows.
/// Videos and results are kept in a folder for each project; work that is under way goes on when the page or the server closes.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  paig studio\n  paig studio throw.mp4\n  \
                        paig studio --folder lessons/week-3 --port 8080 --no-open")]
pub struct StudioArguments {
    /// Video to begin with, or a folder of pictures
    video: Option<PathBuf>,
    /// Folder of the projects
    #[arg(long, value_name = "DIR", default_value = "studio")]
    folder: PathBuf,
    /// Port on 127.0.0.1 [default: one that is free]
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    port: u16,
    /// Largest video that can be uploaded, megabytes
    #[arg(long, value_name = "MB", default_value_t = 2000)]
    upload_limit: u64,
    /// Only print the link
    #[arg(long)]
    no_open: bool,
    /// Make the pictures and proposals of a project; the server calls this
    #[arg(long, value_name = "DIR", hide = true, exclusive = true)]
    prepare: Option<PathBuf>,
    /// Train in the folder of a training, or go on; the server calls this
    #[arg(long, value_name = "DIR", hide = true, exclusive = true)]
    train: Option<PathBuf>,
}

pub fn run(arguments: &StudioArguments) -> Result<()> {
    if let Some(project) = &arguments.prepare {
        return prepare(project);
    }
    interrupt::catch()?;
    if let Some(training) = &arguments.train {
        return train(training, PROGRAM, &interrupt::asked);
    }
    ensure_no_run(&arguments.folder)?;
    let studio = Studio::bind(ServerOptions {
        workspace: arguments.folder.clone(),
        port: arguments.port,
        upload_limit: arguments.upload_limit.saturating_mul(MEGABYTE),
        program: std::env::current_exe().context("cannot find this program's own place")?,
    })?;
    let project = arguments.video.as_deref().map(|video| studio.add(video)).transpose()?;
    let link = studio.link(project.as_deref());
    say!("{link}");
    say!("Ctrl-C stops the server; projects are in {}", arguments.folder.display());
    if !arguments.no_open {
        open(&link);
    }
    studio.serve(interrupt::asked)
}

/// Where there is no browser, the printed link is all.
fn open(link: &str) {
    let opener =
        Command::new(OPENER).arg(link).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    if let Ok(mut opener) = opener {
        std::thread::spawn(move || opener.wait());
    }
}
