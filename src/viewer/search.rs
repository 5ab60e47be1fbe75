//! Search by name while one types: on a thread of its own, so that no key waits for it.

use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;

use crate::loaded::LoadedScene;

/// Nodes after which the thread looks whether another text is asked for.
const AT_A_TIME: usize = 4096;

/// What was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// Of which text.
    pub text: String,
    /// Nodes, rising.
    pub nodes: Vec<u32>,
}

#[derive(Default)]
struct Desk {
    text: Option<String>,
    is_closed: bool,
}

/// Searches for the newest text that it was given.
pub struct Search {
    desk: Arc<(Mutex<Desk>, Condvar)>,
    found: Receiver<Found>,
    thread: Option<JoinHandle<()>>,
}

impl Search {
    /// Starts the thread. `told` is called when something was found.
    ///
    /// # Errors
    ///
    /// The system has no more threads.
    pub fn new(scene: Arc<LoadedScene>, told: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let desk = Arc::new((Mutex::new(Desk::default()), Condvar::new()));
        let (tell, found) = channel();
        let shared = Arc::clone(&desk);
        let thread = std::thread::Builder::new()
            .name("search".into())
            .spawn(move || work(&scene, &shared, &tell, &told))?;
        Ok(Search { desk, found, thread: Some(thread) })
    }

    /// Searches for this; what was searched for before is given up.
    pub fn ask(&self, text: &str) {
        let (desk, bell) = &*self.desk;
        desk.lock().unwrap_or_else(PoisonError::into_inner).text = Some(text.to_owned());
        bell.notify_one();
    }

    /// What was found, the newest.
    pub fn take(&self) -> Option<Found> {
        let mut newest = None;
        loop {
            match self.found.try_recv() {
                Ok(found) => newest = Some(found),
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => return newest,
            }
        }
    }
}

impl Drop for Search {
    fn drop(&mut self) {
        let (desk, bell) = &*self.desk;
        desk.lock().unwrap_or_else(PoisonError::into_inner).is_closed = true;
        bell.notify_one();
        if let Some(thread) = self.thread.take() {
            // It has panicked, which it has told already.
            let _ = thread.join();
        }
    }
}

fn work(scene: &LoadedScene, shared: &(Mutex<Desk>, Condvar), tell: &Sender<Found>, told: &dyn Fn()) {
    let (desk, bell) = shared;
    loop {
        let waiting = desk.lock().unwrap_or_else(PoisonError::into_inner);
        let waiting = bell.wait_while(waiting, |desk| desk.text.is_none() && !desk.is_closed);
        let mut waiting = waiting.unwrap_or_else(PoisonError::into_inner);
        let (Some(text), false) = (waiting.text.take(), waiting.is_closed) else { return };
        drop(waiting);
        let is_old = || {
            let desk = desk.lock().unwrap_or_else(PoisonError::into_inner);
            desk.text.is_some() || desk.is_closed
        };
        if let Some(nodes) = find(scene, &text, is_old) {
            if tell.send(Found { text, nodes }).is_err() {
                return;
            }
            told();
        }
    }
}

/// Nodes that [`crate::scene::Scene::find`] finds; `None` when it is not wanted any more.
fn find(scene: &LoadedScene, text: &str, is_old: impl Fn() -> bool) -> Option<Vec<u32>> {
    let mut nodes = Vec::new();
    let mut looked_at = 0;
    for node in scene.scene().find(text) {
        nodes.push(node);
        // Between two that are found there may be many that are not: their numbers tell.
        if node as usize / AT_A_TIME != looked_at {
            looked_at = node as usize / AT_A_TIME;
            if is_old() {
                return None;
            }
        }
    }
    Some(nodes)
}
