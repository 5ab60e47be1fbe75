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
    /// What was last told by [`Showing::soon`].
    before: Arc<Shown>,
    /// Of the state as it was when it was begun.
    making: Option<Making>,
}

struct Making {
    made: Receiver<Arc<Shown>>,
    /// The state has changed since.
    is_old: bool,
}

impl Showing {
    /// As the file has it.
    pub fn new(scene: &Arc<LoadedScene>) -> Self {
        let all = Arc::new(make(scene, &State::default()));
        Showing { newest: OnceLock::from(Arc::clone(&all)), before: all, making: None }
    }

    /// The state is another one.
    pub fn replace(&mut self, before: &State, after: &State) {
        // Where planes alone are others, the rest is taken over: one is dragged.
        let alike = Arc::ptr_eq(&before.hidden, &after.hidden)
            && Arc::ptr_eq(&before.seen_through, &after.seen_through)
            && Arc::ptr_eq(&before.motions, &after.motions);
        let newest = self.newest.take().filter(|_| alike);
        self.newest = newest.map_or_else(OnceLock::new, |shown| {
            OnceLock::from(Arc::new(shown.with_planes(planes(after).collect())))
        });
        if let Some(making) = &mut self.making {
            making.is_old = true;
        }
    }

    /// Of the state as it is.
    pub fn now(&self, scene: &Arc<LoadedScene>, state: &State) -> Arc<Shown> {
        Arc::clone(self.newest.get_or_init(|| Arc::new(make(scene, state))))
    }

    /// Of the state as it is, if that is made or quickly made; else the newest that is, and a thread makes it. Is it of this state?
    pub fn soon(&mut self, scene: &Arc<LoadedScene>, state: &Arc<State>) -> (Arc<Shown>, bool) {
        let has_died = !self.take_made();
        let at_once = has_died || state.motions.len() <= MOST_AT_ONCE || self.newest.get().is_some();
        if at_once || (self.making.is_none() && !self.begin(scene, state)) {
            self.before = self.now(scene, state);
            return (Arc::clone(&self.before), true);
        }
        (Arc::clone(&self.before), false)
    }

    /// What was last told.
    pub fn before(&self) -> &Arc<Shown> {
        &self.before
    }

    /// Takes over what the thread has made: also of a state that has passed, so that a long drag is seen on its way. False: it has
    /// panicked.
    fn take_made(&mut self) -> bool {
        let Some(making) = &self.making else { return true };
        let mut lives = true;
        match making.made.try_recv() {
            Ok(made) if making.is_old => self.before = made,
            // Where it was made here meanwhile, that one is as good.
            Ok(made) => self.before = Arc::clone(self.newest.get_or_init(|| made)),
            Err(TryRecvError::Empty) => return true,
            Err(TryRecvError::Disconnected) => lives = false,
        }
        self.making = None;
        lives
    }

    /// Begins to make it on a thread. Does the system have one?
    fn begin(&mut self, scene: &Arc<LoadedScene>, state: &Arc<State>) -> bool {
        let (scene, state) = (Arc::clone(scene), Arc::clone(state));
        let (tell, made) = channel();
        let thread = std::thread::Builder::new().name("showing".into()).spawn(move || {
            // Nobody waits any more: the document is closed.
            let _ = tell.send(Arc::new(make(&scene, &state)));
        });
        self.making = thread.is_ok().then_some(Making { made, is_old: false });
        self.making.is_some()
    }
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
