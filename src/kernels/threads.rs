//! Threads of the kernels: as many as libtorch computes with.

use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Sums over frames are made in at most so many parts, whatever the number of threads: their order, and with it their
/// rounding, does not depend on it.
pub const PARTS: usize = 16;

/// The threads of the last call, kept for the next.
static POOL: Mutex<Option<Arc<ThreadPool>>> = Mutex::new(None);

fn pool(threads: usize) -> Arc<ThreadPool> {
    let mut kept = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    match &*kept {
        Some(pool) if pool.current_num_threads() == threads => Arc::clone(pool),
        _ => {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
            Arc::clone(kept.insert(Arc::new(pool)))
        }
    }
}

/// Workers that each of `items` things done in parallel may have, so that no thread is idle.
pub fn workers_each(items: usize) -> usize {
    (tch::get_num_threads() as usize / items.max(1)).max(1)
}

/// `work` of each of `items`, each with a workspace of its own.
///
/// # Panics
/// Fewer workspaces than items.
pub fn side_by_side<W: Send, T: Send>(workspaces: &mut [W], items: Vec<T>, work: impl Fn(&mut W, T) + Sync + Send) {
    assert!(items.len() <= workspaces.len(), "a workspace for each");
    in_parallel(workspaces.iter_mut().zip(items).collect(), |(workspace, item)| work(workspace, item));
}

/// `work` of each of `items`, in their order, on libtorch's number of threads.
pub fn in_parallel<T: Send, R: Send>(items: Vec<T>, work: impl Fn(T) -> R + Sync + Send) -> Vec<R> {
    let threads = (tch::get_num_threads() as usize).clamp(1, items.len().max(1));
    if threads == 1 {
        return items.into_iter().map(work).collect();
    }
    on_all_threads(|_| items.into_par_iter().map(work).collect())
}

/// `work` that divides itself with rayon, on libtorch's number of threads, which it is given.
pub fn on_all_threads<R: Send>(work: impl FnOnce(usize) -> R + Send) -> R {
    match tch::get_num_threads().max(1) as usize {
        1 => work(1),
        threads => pool(threads).install(|| work(threads)),
    }
}
