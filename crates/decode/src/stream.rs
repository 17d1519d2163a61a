//! Decoding ahead on a second thread.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};

use crate::error::Result;
use crate::fields::{self, Parity};
use crate::frame::Frame;
use crate::guard::guarded;
use crate::limits::AHEAD_BYTES;

/// Most frames decoded ahead, however small they are.
const MOST_AHEAD: usize = 16;

/// The frames of a video in display order. Ends after the last one or the first error.
pub struct Frames {
    frames: FieldSplitting,
}

/// Frames as they are decoded, or each split into its two fields.
enum FieldSplitting {
    Whole(Ahead),
    Fields(Box<fields::SplitFields<Ahead>>),
}

/// Frames decoded ahead on a thread.
struct Ahead {
    received: Option<Receiver<Result<Frame>>>,
    worker: Option<JoinHandle<()>>,
}

/// Where a decoding thread puts its frames.
pub(crate) struct Sink(SyncSender<Result<Frame>>);

impl Sink {
    /// Hands a frame over; waits while enough are ahead. False once nobody wants more.
    pub(crate) fn send(&self, frame: Frame) -> bool {
        self.0.send(Ok(frame)).is_ok()
    }
}

impl Frames {
    /// Runs a decoder on a thread of its own. Frames have so many bytes.
    ///
    /// # Errors
    /// No thread can be started.
    pub(crate) fn decode(
        frame_bytes: usize,
        decode: impl FnOnce(&Sink) -> Result<()> + Send + 'static,
    ) -> Result<Self> {
        let ahead = (AHEAD_BYTES / frame_bytes.max(1)).clamp(1, MOST_AHEAD);
        let (sender, received) = sync_channel(ahead);
        let work = move || {
            let sink = Sink(sender);
            // Without this a panic would end the frames like the last one does.
            if let Err(error) = guarded("the decoder", || decode(&sink)) {
                // Nobody may be there to hear it.
                let _ = sink.0.send(Err(error));
            }
        };
        let worker = Builder::new().name("decoder".into()).spawn(work)?;
        Ok(Frames { frames: FieldSplitting::Whole(Ahead { received: Some(received), worker: Some(worker) }) })
    }

    /// The two fields of each frame, from a field's number on. Times are those of the fields.
    pub(crate) fn in_fields(self, order: [Parity; 2], times: Option<Vec<f64>>, next: usize) -> Self {
        match self.frames {
            FieldSplitting::Whole(frames) => {
                let split = fields::SplitFields { frames, order, times, next, frame: None };
                Frames { frames: FieldSplitting::Fields(Box::new(split)) }
            }
            FieldSplitting::Fields(_) => self,
        }
    }
}

impl Iterator for Frames {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        match &mut self.frames {
            FieldSplitting::Whole(frames) => frames.next(),
            FieldSplitting::Fields(fields) => fields.next(),
        }
    }
}

impl Iterator for Ahead {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        let next = self.received.as_ref()?.recv().ok();
        if !matches!(next, Some(Ok(_))) {
            self.received = None;
        }
        next
    }
}

impl Drop for Ahead {
    /// The decoder ends with the frame that it has begun.
    fn drop(&mut self) {
        self.received = None;
        if let Some(worker) = self.worker.take() {
            // Its panics are errors already.
            let _ = worker.join();
        }
    }
}
