//! Work on a thread of its own, while the caller's thread shows its events and answers Ctrl-C.
//!
//! The thread computes as the programs do ([`guarded`]), so the results have the same bits; the caller's own thread keeps
//! its treatment of subnormal numbers.

use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use anyhow::anyhow;
use paig::{Error, ErrorKind};
use paig_terminal::ending::guarded;
use pyo3::prelude::*;
use serde::Serialize;
use serde_json::Value;

use crate::errors;

/// From one look at the signals to the next.
const POLL: Duration = Duration::from_millis(50);

/// What the work is given: where its events go, and whether it is asked to stop.
pub struct Reporter {
    /// Threads of the work share it.
    events: Mutex<Sender<Value>>,
    stop: AtomicBool,
}

impl Reporter {
    pub fn tell(&self, event: impl Serialize) {
        let event = serde_json::to_value(event).expect("an event is plain data");
        // Nobody listens any more once the caller has its error.
        let _ = self.events.lock().unwrap_or_else(PoisonError::into_inner).send(event);
    }

    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::SeqCst)
    }

    /// Ends work that cannot return early: its files are written whole or not at all.
    pub fn leave_if_stopped(&self) {
        if self.stopped() {
            let stopped = Error::new(ErrorKind::Interrupted, anyhow!("stopped"));
            resume_unwind(Box::new(anyhow::Error::from(stopped)));
        }
    }
}

/// Does the work with the GIL released. `listener` is called with each event as JSON, in the caller's thread. Ctrl-C, or an
/// exception of the listener, asks the work to stop; it is raised once the work has ended.
///
/// # Errors
/// The work's own, as exceptions of `paig.errors`.
pub fn attended<T: Send>(
    py: Python,
    listener: Option<&Bound<PyAny>>,
    work: impl FnOnce(&Reporter) -> anyhow::Result<T> + Send,
) -> PyResult<T> {
    let (sender, events) = channel();
    let reporter = Reporter { events: Mutex::new(sender), stop: AtomicBool::new(false) };
    let asked = &reporter.stop;
    thread::scope(|scope| {
        let reporter = &reporter;
        let (done, ended) = channel::<()>();
        let worker = scope.spawn(move || {
            let _done = done;
            guarded(|| work(reporter))
        });
        let raised = show(py, listener, &Mutex::new((events, ended)), asked);
        let result = py.detach(|| worker.join().expect("panics are errors"));
        match raised {
            Some(error) => Err(error),
            None => result.map_err(|error| errors::raised(py, error)),
        }
    })
}

/// Shows events until the work has ended. Returns what was raised meanwhile.
fn show(
    py: Python,
    listener: Option<&Bound<PyAny>>,
    channels: &Mutex<(Receiver<Value>, Receiver<()>)>,
    stop: &AtomicBool,
) -> Option<PyErr> {
    let mut raised = None;
    let mut listens = listener;
    loop {
        let (event, over) = py.detach(|| {
            let channels = channels.lock().unwrap_or_else(PoisonError::into_inner);
            let event = channels.0.recv_timeout(POLL).ok();
            (event, channels.1.try_recv() == Err(TryRecvError::Disconnected))
        });
        let over = over && event.is_none();
        if let (Some(event), Some(listener)) = (event, listens)
            && let Err(error) = listener.call1((event.to_string(),))
        {
            listens = None;
            raised.get_or_insert(error);
        }
        if let Err(error) = py.check_signals() {
            raised.get_or_insert(error);
        }
        if raised.is_some() {
            stop.store(true, Ordering::SeqCst);
        }
        if over {
            return raised;
        }
    }
}
