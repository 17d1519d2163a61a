//! Threads of the kernels.
//!
//! A step asks for help a dozen times, for less than a millisecond each. So the thread that asks works itself, and its helpers
//! look out for more for a moment before they sleep: to wake one takes as long as many a piece of work.

use std::any::Any;
use std::cell::Cell;
use std::hint;
use std::marker::PhantomData;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;

use super::subnormals::Control;

/// Sums over frames are made in at most so many parts, whatever the number of threads: their order, and with it their
/// rounding, does not depend on it.
const PARTS: usize = 16;

/// Items in each part but the last.
pub fn part_of(items: usize) -> usize {
    items.div_ceil(PARTS).max(1)
}

thread_local! {
    /// Threads of the kernels where libtorch has fewer; 0 where it has as many.
    static WIDER: Cell<usize> = const { Cell::new(0) };
}

/// Threads that the kernels compute with when this thread asks.
pub fn threads() -> usize {
    match WIDER.get() {
        // It cannot call libtorch.
        0 if cfg!(miri) => 1,
        0 => tch::get_num_threads().max(1) as usize,
        wider => wider,
    }
}

/// While it lives, what this thread asks of libtorch is computed by one thread, and the kernels keep theirs: on the small
/// tensors between them more threads of libtorch only wait for each other. Threads of the program that begin meanwhile find
/// libtorch with one thread, too.
#[derive(Debug)]
#[must_use = "libtorch has its threads again as soon as this is dropped"]
pub struct KernelsAlone {
    /// `WIDER` before.
    wider: usize,
    /// Threads that libtorch gets back.
    of_libtorch: i32,
    /// It belongs to the thread that began it.
    _stays: PhantomData<*const ()>,
}

/// How many of them live, and the threads of libtorch before the first.
static ALONE: Mutex<(usize, i32)> = Mutex::new((0, 0));

impl KernelsAlone {
    /// The kernels have as many threads from now on as libtorch had.
    pub fn begin() -> Self {
        let mut alone = locked(&ALONE);
        let (living, before) = *alone;
        // A thread that is new to libtorch is told of one thread where another has begun to be alone.
        let of_libtorch = tch::get_num_threads().max(if living > 0 { before } else { 1 });
        *alone = (living + 1, if living > 0 { before } else { of_libtorch });
        let wider = WIDER.get();
        WIDER.set(if wider > 0 { wider } else { of_libtorch as usize });
        tch::set_num_threads(1);
        KernelsAlone { wider, of_libtorch, _stays: PhantomData }
    }
}

impl Drop for KernelsAlone {
    fn drop(&mut self) {
        locked(&ALONE).0 -= 1;
        // One within another leaves libtorch as the other has it.
        if self.wider == 0 {
            tch::set_num_threads(self.of_libtorch);
        }
        WIDER.set(self.wider);
    }
}

/// Workers that each of `items` things done in parallel may have.
pub fn workers_each(items: usize) -> usize {
    (threads() / items.max(1)).max(1)
}

/// `work` of each of `items`, each with a workspace of its own.
///
/// # Panics
/// Fewer workspaces than items.
pub fn side_by_side<W: Send, T: Send>(workspaces: &mut [W], items: Vec<T>, work: impl Fn(&mut W, T) + Sync + Send) {
    assert!(items.len() <= workspaces.len(), "a workspace for each");
    in_parallel(workspaces.iter_mut().zip(items).collect(), |(workspace, item)| work(workspace, item));
}

/// `work` of each of `items`, in their order. A panic within `work` is passed on once all others are done. Helpers compute with
/// numbers, not with tensors: they know nothing of what this thread has told libtorch (`no_grad`, its number of threads).
pub fn in_parallel<T: Send, R: Send>(items: Vec<T>, work: impl Fn(T) -> R + Sync + Send) -> Vec<R> {
    let helpers = threads().min(items.len()).saturating_sub(1);
    if helpers == 0 {
        return items.into_iter().map(work).collect();
    }
    let items: Vec<_> = items.into_iter().map(|item| Mutex::new((Some(item), None))).collect();
    share_out(helpers, items.len(), &|number| {
        let item = locked(&items[number]).0.take().expect("each is taken once");
        let result = work(item);
        locked(&items[number]).1 = Some(result);
    });
    let result = |item: Mutex<(Option<T>, Option<R>)>| item.into_inner().unwrap_or_else(PoisonError::into_inner).1;
    items.into_iter().map(|item| result(item).expect("all were done")).collect()
}

/// Also where a panic left it: what the kernels lock is whole between any two statements.
pub fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Work that is shared out: `item` of each number below `count`.
struct SharedWork {
    item: *const (dyn Fn(usize) + Sync),
    count: usize,
    /// The first number that nobody has taken.
    next: AtomicUsize,
    /// Helpers that may still come, and those that have come and not gone.
    wanted: AtomicUsize,
    inside: AtomicUsize,
    /// How the one who asks computes, and on how many threads: so does a helper, who may ask for help in turn.
    control: Control,
    threads: usize,
    panic: Mutex<Option<Box<dyn Any + Send>>>,
}

// SAFETY: `item` may be called by several threads at once, and the one who asks waits until no helper is inside.
unsafe impl Send for SharedWork {}
// SAFETY: as above.
unsafe impl Sync for SharedWork {}

impl SharedWork {
    fn work(&self) {
        loop {
            let number = self.next.fetch_add(1, Ordering::Relaxed);
            if number >= self.count {
                return;
            }
            // SAFETY: it lives as long as somebody is inside.
            let item = unsafe { &*self.item };
            if let Err(panic) = catch_unwind(AssertUnwindSafe(|| item(number))) {
                locked(&self.panic).get_or_insert(panic);
            }
        }
    }
}

/// Jobs that want helpers, and the helpers.
struct Crew {
    jobs: Mutex<Vec<Arc<SharedWork>>>,
    news: Condvar,
    /// How many jobs there were.
    posted: AtomicUsize,
    helpers: AtomicUsize,
}

static CREW: Crew = Crew {
    jobs: Mutex::new(Vec::new()),
    news: Condvar::new(),
    posted: AtomicUsize::new(0),
    helpers: AtomicUsize::new(0),
};

/// How often a helper looks for more work before it sleeps: some tens of microseconds.
const LOOKS: usize = 1500;

/// Does all items, with so many helpers at most, and waits for them.
fn share_out(helpers: usize, count: usize, item: &(dyn Fn(usize) + Sync)) {
    // Enough for work within this work, too. One that cannot be begun is missed by nobody.
    let crew = threads() - 1;
    let there = CREW.helpers.fetch_max(crew, Ordering::Relaxed);
    (there..crew).for_each(|_| drop(thread::Builder::new().name("kernels".into()).spawn(help)));
    // SAFETY: the lifetime is forgotten; below, this waits until nobody can call it any more.
    let item = unsafe { std::mem::transmute::<&(dyn Fn(usize) + Sync), &'static (dyn Fn(usize) + Sync)>(item) };
    let job = Arc::new(SharedWork {
        item,
        count,
        next: AtomicUsize::new(0),
        wanted: AtomicUsize::new(helpers),
        inside: AtomicUsize::new(0),
        control: Control::of_this_thread(),
        threads: threads(),
        panic: Mutex::new(None),
    });
    {
        let mut jobs = locked(&CREW.jobs);
        jobs.push(Arc::clone(&job));
        CREW.posted.fetch_add(1, Ordering::Release);
    }
    (0..helpers).for_each(|_| CREW.news.notify_one());
    job.work();
    // From here on nobody comes.
    locked(&CREW.jobs).retain(|other| !Arc::ptr_eq(other, &job));
    let mut looks = 0;
    while job.inside.load(Ordering::Acquire) > 0 {
        looks += 1;
        if looks < LOOKS { hint::spin_loop() } else { thread::yield_now() }
    }
    if let Some(panic) = locked(&job.panic).take() {
        resume_unwind(panic);
    }
}

/// What a helper does all its life.
fn help() {
    loop {
        let posted = CREW.posted.load(Ordering::Acquire);
        let Some(job) = join_some(&locked(&CREW.jobs)) else {
            let more = (0..LOOKS).any(|_| {
                hint::spin_loop();
                CREW.posted.load(Ordering::Acquire) != posted
            });
            let jobs = locked(&CREW.jobs);
            if !more && CREW.posted.load(Ordering::Acquire) == posted {
                drop(CREW.news.wait(jobs).unwrap_or_else(PoisonError::into_inner));
            }
            continue;
        };
        job.control.take_over();
        WIDER.set(job.threads);
        job.work();
        job.inside.fetch_sub(1, Ordering::Release);
    }
}

/// A job that still wants a helper, who is inside from now on. The jobs are locked: none of them can be taken back.
fn join_some(jobs: &[Arc<SharedWork>]) -> Option<Arc<SharedWork>> {
    let open =
        |job: &&Arc<SharedWork>| job.next.load(Ordering::Relaxed) < job.count && job.wanted.load(Ordering::Relaxed) > 0;
    let job = jobs.iter().find(open)?;
    job.wanted.fetch_sub(1, Ordering::Relaxed);
    job.inside.fetch_add(1, Ordering::Relaxed);
    Some(Arc::clone(job))
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::{Condvar, Mutex};
    use std::thread;
    use std::time::Duration;

    use super::{WIDER, in_parallel, threads};

    /// In a thread of its own, so that other tests compute with as many threads as ever.
    fn on_threads<R: Send + 'static>(count: usize, work: impl FnOnce() -> R + Send + 'static) -> R {
        thread::spawn(move || {
            WIDER.set(count);
            work()
        })
        .join()
        .expect("a test that does not fail")
    }

    #[test]
    fn results_stand_in_the_order_of_the_items_also_where_work_is_shared_out_within_work() {
        on_threads(4, || {
            for count in [0, 1, 2, 7, 100] {
                let squares = |to: usize| in_parallel((0..to).collect(), |n: usize| n * n);
                let sums = in_parallel((0..count).collect(), |n: usize| {
                    assert_eq!(threads(), 4);
                    squares(n).iter().sum::<usize>()
                });
                let exact: Vec<usize> = (0..count).map(|n| (0..n).map(|n| n * n).sum()).collect();
                assert_eq!(sums, exact);
            }
        });
    }

    /// Each item waits until as many threads work as there are: ten seconds, where one is missing.
    #[test]
    fn as_many_threads_work_as_are_asked_for() {
        let all_came = on_threads(3, || {
            let (seen, news) = (Mutex::new(HashSet::new()), Condvar::new());
            in_parallel((0..3).collect(), |_: i32| {
                let mut seen = seen.lock().unwrap();
                seen.insert(thread::current().id());
                news.notify_all();
                let (seen, _) = news.wait_timeout_while(seen, Duration::from_secs(10), |seen| seen.len() < 3).unwrap();
                seen.len() == 3
            })
        });
        assert_eq!(all_came, [true; 3]);
    }

    #[test]
    fn a_panic_reaches_the_one_who_asked_and_the_next_work_is_done() {
        on_threads(2, || {
            let failing = || in_parallel((0..20).collect(), |n: i32| assert!(n != 13, "unlucky"));
            let panic = catch_unwind(AssertUnwindSafe(failing)).expect_err("one of them panicked");
            assert_eq!(panic.downcast_ref::<&str>(), Some(&"unlucky"));
            assert_eq!(in_parallel(vec![1, 2, 3], |n| n + 1), [2, 3, 4]);
        });
    }

    /// Helpers that were begun by another thread compute with what is too small as the one who asks does.
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    #[test]
    fn helpers_flush_what_is_too_small_where_the_one_who_asks_does() {
        use std::hint::black_box;

        let tiny = |_: i32| {
            thread::sleep(Duration::from_millis(1));
            black_box(1e-30f32) * black_box(1e-10f32)
        };
        let plain = on_threads(2, move || in_parallel((0..8).collect(), tiny));
        let flushed = on_threads(2, move || {
            super::super::flush_subnormals();
            in_parallel((0..8).collect(), tiny)
        });
        assert!(plain.iter().all(|x| *x > 0.0) && flushed.iter().all(|x| *x == 0.0), "{plain:?} {flushed:?}");
    }
}
