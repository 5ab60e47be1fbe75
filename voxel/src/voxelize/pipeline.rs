//! Work in parallel, results taken in order, few waiting.
//!
//! Threads of its own, not a pool's: they wait for each other, and a pool's thread that waits inside its own work for
//! some other (`Drawables::load` may use rayon) may begin anything meanwhile, such as a wait for the very piece that
//! lies suspended beneath it.

use std::collections::BTreeMap;
use std::panic::resume_unwind;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How a pipeline's work is done. `Scratch` is what a thread keeps between two pieces.
pub(super) trait Work<T, R, E>: Sync {
    type Scratch;
    fn scratch(&self) -> Self::Scratch;
    /// Called on any thread, several at a time.
    fn run(&self, piece: T, scratch: &mut Self::Scratch) -> Result<R, E>;
    /// Bytes that a waiting result holds.
    fn bytes(&self, result: &R) -> u64;
}

/// Where results go: in the order of their pieces, one at a time, on any thread.
pub(super) trait Take<R, E>: Send {
    fn take(&mut self, result: R) -> Result<(), E>;
    /// Bytes that results may hold while they wait or are made, beside what has been taken.
    fn allowance(&self) -> u64;
}

/// State shared by the threads.
struct State<I, R, E> {
    pieces: I,
    /// Pieces that were begun, and of these, results that were taken.
    begun: usize,
    taken: usize,
    waiting: BTreeMap<usize, (Result<R, E>, u64)>,
    waiting_bytes: u64,
    /// Bytes of the largest result so far: what a piece under way is expected to come to.
    largest: u64,
    allowance: u64,
    exhausted: bool,
    is_taking: bool,
    stopped: bool,
    error: Option<E>,
}

impl<I, R, E> State<I, R, E> {
    /// May another piece begin? Always, when nothing is under way; else when its result will find room.
    fn has_room(&self, window: usize) -> bool {
        let under_way = self.begun - self.taken;
        let expected = (under_way - self.waiting.len() + 1) as u64 * self.largest + self.waiting_bytes;
        under_way == 0 || under_way < window && expected <= self.allowance
    }
}

/// Runs `work` on all pieces and hands the results to `take` in order, on as many threads as the current rayon pool has.
/// These are new ones, in no pool: rayon's calls inside `work` go to the global pool. At most `window` pieces are begun and not taken,
/// fewer when their results would hold more bytes than allowed. The error is that of the first piece in order that fails.
pub(super) fn run_in_order<T, R, E, W, I, K>(
    pieces: I,
    work: &W,
    take: K,
    window: usize,
) -> (I, K, Result<(), E>)
where
    I: Iterator<Item = T> + Send,
    R: Send,
    E: Send,
    W: Work<T, R, E>,
    K: Take<R, E>,
{
    let allowance = take.allowance();
    let state = Mutex::new(State {
        pieces,
        begun: 0,
        taken: 0,
        waiting: BTreeMap::new(),
        waiting_bytes: 0,
        largest: 0,
        allowance,
        exhausted: false,
        is_taking: false,
        stopped: false,
        error: None,
    });
    let (take, changed) = (Mutex::new(take), Condvar::new());
    std::thread::scope(|scope| {
        let spawn = |_| scope.spawn(|| run_thread(&state, &take, &changed, work, window));
        let threads: Vec<_> = (0..rayon::current_num_threads()).map(spawn).collect();
        lend_this_thread(|| threads.iter().all(|thread| thread.is_finished()));
        let panics = threads.into_iter().filter_map(|thread| thread.join().err());
        // All have ended before one panic is passed on.
        if let Some(panic) = panics.reduce(|first, _| first) {
            resume_unwind(panic);
        }
    });
    let state = state.into_inner().unwrap_or_else(PoisonError::into_inner);
    let take = take.into_inner().unwrap_or_else(PoisonError::into_inner);
    (state.pieces, take, state.error.map_or(Ok(()), Err))
}

/// Inside a rayon pool: does the pool's work on this thread until `is_done`. Work that runs elsewhere may need the pool, and
/// this may be its only thread. Outside of pools it returns at once.
fn lend_this_thread(is_done: impl Fn() -> bool) {
    /// Short against a task, long against a look at the queues.
    const PAUSE: Duration = Duration::from_micros(500);
    while !is_done() {
        match rayon::yield_now() {
            None => return,
            Some(rayon::Yield::Executed) => {}
            Some(rayon::Yield::Idle) => std::thread::sleep(PAUSE),
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A poisoned lock means that a thread panicked: `StopOnPanic` has stopped the others, and the scope
    // passes it on.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Wakes and stops the other threads when this one panics, so that none waits for ever.
struct StopOnPanic<'a, I, R, E>(&'a Mutex<State<I, R, E>>, &'a Condvar);

impl<I, R, E> Drop for StopOnPanic<'_, I, R, E> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            lock(self.0).stopped = true;
            self.1.notify_all();
        }
    }
}

fn run_thread<T, R, E, W, I, K>(
    state: &Mutex<State<I, R, E>>,
    take: &Mutex<K>,
    changed: &Condvar,
    work: &W,
    window: usize,
) where
    I: Iterator<Item = T>,
    W: Work<T, R, E>,
    K: Take<R, E>,
{
    let mut scratch = None;
    let _guard = StopOnPanic(state, changed);
    let mut now = lock(state);
    loop {
        if now.stopped || now.exhausted && now.taken == now.begun {
            return;
        }
        let next = now.taken;
        if !now.is_taking
            && let Some((result, bytes)) = now.waiting.remove(&next)
        {
            now.is_taking = true;
            drop(now);
            let taken = result.and_then(|result| lock(take).take(result));
            let allowance = lock(take).allowance();
            now = lock(state);
            now.is_taking = false;
            now.allowance = allowance;
            now.taken += 1;
            now.waiting_bytes -= bytes;
            if let Err(error) = taken {
                now.error = Some(error);
                now.stopped = true;
            }
            changed.notify_all();
            continue;
        }
        if !now.exhausted && now.has_room(window) {
            match now.pieces.next() {
                None => {
                    now.exhausted = true;
                    changed.notify_all();
                }
                Some(piece) => {
                    let index = now.begun;
                    now.begun += 1;
                    drop(now);
                    let result = work.run(piece, scratch.get_or_insert_with(|| work.scratch()));
                    if result.is_err() {
                        // It may be left in the middle of something.
                        scratch = None;
                    }
                    let bytes = result.as_ref().map_or(0, |result| work.bytes(result));
                    now = lock(state);
                    now.largest = now.largest.max(bytes);
                    now.waiting_bytes += bytes;
                    now.waiting.insert(index, (result, bytes));
                    changed.notify_all();
                }
            }
            continue;
        }
        now = changed.wait(now).unwrap_or_else(PoisonError::into_inner);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// Pieces are numbers; some take long, so that results come out of order.
    struct Uneven {
        fails_at: Option<u64>,
        panics_at: Option<u64>,
        held: AtomicU64,
        most_held: AtomicU64,
    }

    impl Work<u64, u64, u64> for Uneven {
        type Scratch = ();
        fn scratch(&self) {}
        fn run(&self, piece: u64, (): &mut ()) -> Result<u64, u64> {
            let mut random = oorandom::Rand64::new(piece.into());
            std::thread::sleep(Duration::from_micros(random.rand_range(0..300)));
            assert!(self.panics_at != Some(piece), "as asked");
            let held = self.held.fetch_add(1, Ordering::SeqCst) + 1;
            self.most_held.fetch_max(held, Ordering::SeqCst);
            if self.fails_at.is_some_and(|at| piece >= at) { Err(piece) } else { Ok(piece) }
        }
        fn bytes(&self, _: &u64) -> u64 {
            10
        }
    }

    struct Collected<'a>(Vec<u64>, u64, &'a Uneven);

    impl Take<u64, u64> for Collected<'_> {
        fn take(&mut self, result: u64) -> Result<(), u64> {
            self.2.held.fetch_sub(1, Ordering::SeqCst);
            self.0.push(result);
            Ok(())
        }
        fn allowance(&self) -> u64 {
            self.1
        }
    }

    fn run(work: &Uneven, threads: usize, window: usize, allowance: u64) -> (Vec<u64>, Result<(), u64>) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let take = Collected(Vec::new(), allowance, work);
        let (_, take, result) = pool.install(|| run_in_order(0..500u64, work, take, window));
        (take.0, result)
    }

    fn work() -> Uneven {
        Uneven { fails_at: None, panics_at: None, held: AtomicU64::new(0), most_held: AtomicU64::new(0) }
    }

    #[test]
    fn results_come_in_order_and_few_wait() {
        for (threads, window, allowance, most) in
            [(1, 8, u64::MAX, 1), (4, 8, u64::MAX, 8), (4, 3, u64::MAX, 3), (4, 100, 45, 5), (4, 100, 0, 1)]
        {
            let work = work();
            let (results, result) = run(&work, threads, window, allowance);
            assert_eq!((results, result), ((0..500).collect(), Ok(())), "{threads} threads");
            let held = work.most_held.load(Ordering::SeqCst);
            // The first results are begun before anything is known of their size.
            let most = if allowance < u64::MAX { most.max(threads as u64) } else { most };
            assert!(held <= most, "{threads} threads, window {window}, allowance {allowance}: {held} waited");
        }
    }

    #[test]
    fn the_error_is_that_of_the_first_piece_that_fails() {
        for threads in [1, 2, 5] {
            let work = Uneven { fails_at: Some(137), ..work() };
            let (results, result) = run(&work, threads, 16, u64::MAX);
            assert_eq!((results, result), ((0..137).collect(), Err(137)), "{threads} threads");
        }
    }

    #[test]
    fn a_panic_of_one_thread_ends_them_all() {
        let work = Uneven { panics_at: Some(40), ..work() };
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| run(&work, 4, 8, u64::MAX)));
        assert!(panicked.is_err());
    }
}
