//! Reads and decodes pages on threads of its own.

use std::collections::{HashSet, VecDeque};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use super::{LoadError, Loaded};

/// Where pages come from, such as a memory-mapped container.
pub trait PageSource: Send + Sync + 'static {
    /// Reads and decodes a page, as it goes into memory.
    ///
    /// # Errors
    ///
    /// It is damaged, or cannot be read.
    fn load(&self, page: u32) -> Result<Vec<u8>, LoadError>;
}

/// What the threads share.
#[derive(Default)]
struct Queue {
    /// Most important first.
    waiting: VecDeque<u32>,
    /// Being read, or come and not fetched yet.
    begun: HashSet<u32>,
    is_closed: bool,
}

/// Threads that load what was asked for last, most important first.
pub struct Loader {
    queue: Arc<(Mutex<Queue>, Condvar)>,
    loaded: Receiver<Loaded>,
    threads: Vec<JoinHandle<()>>,
}

impl Loader {
    /// Starts threads, at least one.
    ///
    /// # Errors
    ///
    /// The system refuses a thread.
    pub fn new(source: Arc<dyn PageSource>, threads: usize) -> std::io::Result<Self> {
        let queue = Arc::new((Mutex::new(Queue::default()), Condvar::new()));
        let (sender, loaded) = channel();
        let mut loader = Loader { queue: Arc::clone(&queue), loaded, threads: Vec::new() };
        for number in 0..threads.max(1) {
            let (queue, source, sender) = (Arc::clone(&queue), Arc::clone(&source), sender.clone());
            let thread = std::thread::Builder::new().name(format!("loader {number}"));
            loader.threads.push(thread.spawn(move || work(&queue, source.as_ref(), &sender))?);
        }
        Ok(loader)
    }

    /// Replaces what is waited for. Pages that are being read go on; they are not read twice.
    pub fn request(&self, pages: &[u32]) {
        let (queue, more) = &*self.queue;
        let mut queue = locked(queue);
        queue.waiting.clear();
        let Queue { waiting, begun, .. } = &mut *queue;
        waiting.extend(pages.iter().filter(|page| !begun.contains(page)));
        more.notify_all();
    }

    /// What has come since it was last asked. Never waits.
    pub fn fetch(&self) -> Vec<Loaded> {
        let come: Vec<Loaded> = self.loaded.try_iter().collect();
        let mut queue = locked(&self.queue.0);
        for loaded in &come {
            queue.begun.remove(&loaded.page);
        }
        come
    }

    /// Is nothing waited for, being read, or come and not fetched?
    pub fn is_idle(&self) -> bool {
        let queue = locked(&self.queue.0);
        queue.waiting.is_empty() && queue.begun.is_empty()
    }
}

impl Drop for Loader {
    fn drop(&mut self) {
        let (queue, more) = &*self.queue;
        locked(queue).is_closed = true;
        more.notify_all();
        for thread in self.threads.drain(..) {
            // A thread that panicked has told so; there is nobody to tell it again.
            drop(thread.join());
        }
    }
}

/// The queue is whole between any two statements: a thread that panicked elsewhere leaves it so.
fn locked(queue: &Mutex<Queue>) -> MutexGuard<'_, Queue> {
    queue.lock().unwrap_or_else(PoisonError::into_inner)
}

fn work(queue: &(Mutex<Queue>, Condvar), source: &dyn PageSource, sender: &Sender<Loaded>) {
    loop {
        let page = {
            let (queue, more) = queue;
            let mut queue = locked(queue);
            loop {
                if queue.is_closed {
                    return;
                }
                if let Some(page) = queue.waiting.pop_front() {
                    queue.begun.insert(page);
                    break page;
                }
                queue = more.wait(queue).unwrap_or_else(PoisonError::into_inner);
            }
        };
        let bytes = source.load(page);
        if sender.send(Loaded { page, bytes }).is_err() {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::time::{Duration, Instant};

    use super::*;

    /// Page 7 is damaged.
    struct Numbers {
        loads: AtomicU32,
    }

    impl PageSource for Numbers {
        fn load(&self, page: u32) -> Result<Vec<u8>, LoadError> {
            self.loads.fetch_add(1, Ordering::Relaxed);
            if page == 7 { Err(LoadError::Source("damaged".into())) } else { Ok(page.to_le_bytes().to_vec()) }
        }
    }

    fn fetch_all(loader: &Loader) -> Vec<Loaded> {
        let started = Instant::now();
        let mut all = Vec::new();
        while !loader.is_idle() {
            all.extend(loader.fetch());
            assert!(started.elapsed() < Duration::from_secs(60), "nothing comes");
            std::thread::yield_now();
        }
        all.sort_by_key(|loaded| loaded.page);
        all
    }

    #[test]
    fn every_page_comes_once_and_errors_come_too() {
        let source = Arc::new(Numbers { loads: AtomicU32::new(0) });
        let loader = Loader::new(Arc::clone(&source) as Arc<dyn PageSource>, 3).unwrap();
        for _ in 0..20 {
            // Asked again while they are read.
            loader.request(&(0..50).collect::<Vec<u32>>());
        }
        let all = fetch_all(&loader);
        let expected: Vec<u32> = (0..50).collect();
        // What had come before it was asked again may come again; nothing is missing.
        let mut pages: Vec<u32> = all.iter().map(|loaded| loaded.page).collect();
        pages.dedup();
        assert_eq!(pages, expected);
        for loaded in all {
            match loaded.bytes {
                Ok(bytes) => assert_eq!(bytes, loaded.page.to_le_bytes()),
                Err(error) => assert_eq!((loaded.page, error.to_string()), (7, "damaged".to_owned())),
            }
        }
        assert_eq!(source.loads.load(Ordering::Relaxed), 50, "a page was read twice");
        loader.request(&[3]);
        assert_eq!(fetch_all(&loader).len(), 1, "what was fetched can be asked for again");
    }

    #[test]
    fn what_is_asked_last_replaces_what_was_waited_for() {
        struct Slow;
        impl PageSource for Slow {
            fn load(&self, _: u32) -> Result<Vec<u8>, LoadError> {
                std::thread::sleep(Duration::from_millis(2));
                Ok(Vec::new())
            }
        }
        let loader = Loader::new(Arc::new(Slow), 1).unwrap();
        loader.request(&(0..1000).collect::<Vec<u32>>());
        loader.request(&[5000, 5001]);
        let pages: Vec<u32> = fetch_all(&loader).iter().map(|loaded| loaded.page).collect();
        assert!(pages.len() < 20 && pages.ends_with(&[5000, 5001]), "{pages:?}");
        drop(loader);
    }
}
