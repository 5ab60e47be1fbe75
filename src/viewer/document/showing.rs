//! The scene as it is shown, made of what a user has done: at once, or on a thread of its own where very much was moved.

use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, OnceLock};

use super::{State, planes};
use crate::filter::Filter;
use crate::loaded::LoadedScene;
use crate::shown::Shown;

/// So many moved parts are made into a scene within a frame: a thousand take a millisecond.
const MOST_AT_ONCE: usize = 2000;

/// The scene as it is shown.
pub(super) struct Showing {
    /// Of the state as it is; made when it is first asked for.
    newest: OnceLock<Arc<Shown>>,
    /// What was last told by [`Showing::soon`], and the state that it is of.
    before: (Arc<Shown>, Arc<State>),
    /// Of the state as it was when it was begun.
    making: Option<Making>,
}

struct Making {
    made: Receiver<Arc<Shown>>,
    /// What it is made of.
    state: Arc<State>,
    /// A newer one was shown since.
    is_passed: bool,
}

impl Showing {
    /// As the file has it.
    pub fn new(scene: &Arc<LoadedScene>) -> Self {
        let state = Arc::default();
        let all = Arc::new(make(scene, &state));
        Showing { newest: OnceLock::from(Arc::clone(&all)), before: (all, state), making: None }
    }

    /// The state is another one.
    pub fn replace(&mut self, before: &State, after: &State) {
        // Where planes alone are others, the rest is taken over: one is dragged.
        let newest = self.newest.take().filter(|_| is_same_but_for_planes(before, after));
        self.newest = newest.map_or_else(OnceLock::new, |shown| OnceLock::from(with_planes(&shown, after)));
    }

    /// Is a thread at it?
    #[cfg(test)]
    pub fn is_making(&self) -> bool {
        self.making.is_some()
    }

    /// Of the state as it is.
    pub fn now(&self, scene: &Arc<LoadedScene>, state: &State) -> Arc<Shown> {
        Arc::clone(self.newest.get_or_init(|| Arc::new(make(scene, state))))
    }

    /// Of the state as it is, if that is made or quickly made; else the newest that is, and a thread makes it. Is it of this state?
    pub fn soon(&mut self, scene: &Arc<LoadedScene>, state: &Arc<State>) -> (Arc<Shown>, bool) {
        let has_died = !self.take_made(state);
        let (shown, of) = &self.before;
        if self.newest.get().is_none() && is_same_but_for_planes(of, state) {
            // Back where it was.
            self.newest = OnceLock::from(with_planes(shown, state));
        }
        let at_once = has_died || state.motions.len() <= MOST_AT_ONCE || self.newest.get().is_some();
        if at_once || (self.making.is_none() && !self.begin(scene, state)) {
            self.before = (self.now(scene, state), Arc::clone(state));
            if let Some(making) = &mut self.making {
                making.is_passed = true;
            }
            return (Arc::clone(&self.before.0), true);
        }
        (Arc::clone(&self.before.0), false)
    }

    /// Takes over what the thread has made. False: it has panicked.
    fn take_made(&mut self, state: &State) -> bool {
        let Some(making) = &self.making else { return true };
        let mut lives = true;
        match making.made.try_recv() {
            Ok(made) if is_same_but_for_planes(&making.state, state) => {
                // Where it was made here meanwhile, that one is as good.
                self.newest.get_or_init(|| with_planes(&made, state));
            }
            // Of a state that has passed: a long drag is seen on its way, but what was taken back is not seen again.
            Ok(made) if !making.is_passed => self.before = (made, Arc::clone(&making.state)),
            Ok(_) => {}
            Err(TryRecvError::Empty) => return true,
            Err(TryRecvError::Disconnected) => lives = false,
        }
        self.making = None;
        lives
    }

    /// Begins to make it on a thread. Does the system have one?
    fn begin(&mut self, scene: &Arc<LoadedScene>, state: &Arc<State>) -> bool {
        let (scene, of, state) = (Arc::clone(scene), Arc::clone(state), Arc::clone(state));
        let (tell, made) = channel();
        let thread = std::thread::Builder::new().name("showing".into()).spawn(move || {
            // Nobody waits any more: the document is closed.
            let _ = tell.send(Arc::new(make(&scene, &of)));
        });
        self.making = thread.is_ok().then_some(Making { made, state, is_passed: false });
        self.making.is_some()
    }
}

fn is_same_but_for_planes(a: &State, b: &State) -> bool {
    Arc::ptr_eq(&a.hidden, &b.hidden)
        && Arc::ptr_eq(&a.seen_through, &b.seen_through)
        && Arc::ptr_eq(&a.motions, &b.motions)
}

fn with_planes(shown: &Shown, state: &State) -> Arc<Shown> {
    Arc::new(shown.with_planes(planes(state).collect()))
}

fn make(scene: &Arc<LoadedScene>, state: &State) -> Shown {
    let all = scene.scene();
    let mut filter = Filter::default();
    planes(state).for_each(|plane| filter.clip_by(plane));
    for object in state.hidden.iter() {
        all.object_drawables(object).for_each(|drawable| filter.set_hidden(drawable, true));
    }
    for object in state.seen_through.iter() {
        all.object_drawables(object).for_each(|drawable| filter.set_seen_through(drawable, true));
    }
    Shown::new(Arc::clone(scene), filter, Arc::clone(&state.motions))
}
