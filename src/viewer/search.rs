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

/// Nodes that [`crate::scene::Scene::finder`] finds; `None` when it is not wanted any more.
fn find(scene: &LoadedScene, text: &str, is_old: impl Fn() -> bool) -> Option<Vec<u32>> {
    let mut is_found = scene.scene().finder(text);
    let mut nodes = Vec::new();
    for node in 0..scene.scene().nodes().len() as u32 {
        if (node as usize).is_multiple_of(AT_A_TIME) && is_old() {
            return None;
        }
        if is_found(node) {
            nodes.push(node);
        }
    }
    Some(nodes)
}

/// Names of what says a part's number in its extras; case and what is no letter do not matter.
const NUMBER_NAMES: [&str; 9] = [
    "partnumber",
    "partno",
    "partnr",
    "partid",
    "itemnumber",
    "articlenumber",
    "materialnumber",
    "number",
    "tag",
];

/// The part number that extras (JSON) tell, if they do.
pub fn part_number(extras: &str) -> Option<String> {
    let Ok(serde_json::Value::Object(fields)) = serde_json::from_str(extras) else { return None };
    let plain =
        |name: &str| name.chars().filter(char::is_ascii_alphabetic).collect::<String>().to_lowercase();
    NUMBER_NAMES.iter().find_map(|wanted| {
        let value = fields.iter().find(|(name, _)| plain(name) == *wanted)?.1;
        match value {
            serde_json::Value::String(text) => Some(text.clone()),
            serde_json::Value::Number(number) => Some(number.to_string()),
            _ => None,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::part_number;

    #[test]
    fn part_numbers_are_told_by_several_names() {
        let number = |extras: &str| part_number(extras);
        assert_eq!(number(r#"{"mass":3,"Part Number":"A-7"}"#).as_deref(), Some("A-7"));
        assert_eq!(number(r#"{"part_no":4711}"#).as_deref(), Some("4711"));
        for none in ["", "[1]", r#"{"mass":3}"#, r#"{"number":null}"#, "{"] {
            assert_eq!(number(none), None, "{none}");
        }
    }
}
