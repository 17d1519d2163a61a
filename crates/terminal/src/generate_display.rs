//! Shows how a dataset is made: a bar on a terminal, a line now and then elsewhere.

use std::io::IsTerminal;
use std::sync::{Mutex, PoisonError};

use crate::progress::PhaseProgress;
use crate::say;
use paig::generators::{Counts, GeneratorEvent};

/// Lines about a file's clips where there is no terminal.
const PLAIN_LINES: usize = 4;

/// What is shown of the file at hand.
#[derive(Debug, Default)]
pub struct GenerateDisplay {
    progress: Mutex<Option<PhaseProgress>>,
}

impl GenerateDisplay {
    /// Shows an event, from whatever thread.
    pub fn show(&self, event: GeneratorEvent) {
        let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            GeneratorEvent::Begins { frames, total } => {
                *progress = Some(PhaseProgress::new(&format!("{frames} frames"), total as u64, 0));
            }
            GeneratorEvent::Ready { clips, total } => {
                let Some(progress) = &*progress else { return };
                progress.step(|| "clips".to_owned());
                let lines = |clips: usize| clips * PLAIN_LINES / total;
                if !std::io::stderr().is_terminal() && lines(clips) > lines(clips - 1) {
                    progress.line(&format!("{clips} of {total} clips"));
                }
            }
            GeneratorEvent::Wrote { path, clips: Counts { train, valid, test }, frames, seconds } => {
                progress.take().iter().for_each(PhaseProgress::finish);
                let path = path.display();
                say!("wrote {path} ({train} + {valid} + {test} clips of {frames} frames, {seconds:.1} s)");
            }
            GeneratorEvent::Kept { path, ours: true } => {
                say!("kept {}: it is there with the same settings; --force makes it again", path.display());
            }
            GeneratorEvent::Kept { path, ours: false } => {
                say!("kept {}: it is there and was not made by generate; --force replaces it", path.display());
            }
        }
    }
}
