//! The thread that asks what is visible, so that frames need not wait for it.

use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use glam::DVec3;

use crate::camera::{Camera, CameraError};
use crate::lod::density::{self, DensitySettings};
use crate::lod::{Candidate, Choice, ChunkLevels, Selection, candidates};
use crate::progress::Silent;
use crate::shown::Shown;
use crate::streaming::Priority;
use crate::visibility::coherent::{CoherentError, CoherentQuery, CoherentSettings};
use crate::visibility::culling::Culling;
use crate::visibility::{Method, QueryScene, QuerySettings, RayMethod, RaysPerPixel, query};

/// What is asked about a frame.
#[derive(Clone)]
pub struct Question {
    /// Of which frame.
    pub frame: u64,
    /// Seen from here.
    pub camera: Camera,
    /// It has jumped: what was found before is forgotten.
    pub is_cut: bool,
    /// A camera of later, known or predicted: what it will see can be loaded before.
    pub later: Option<Camera>,
    /// How fine that would be drawn.
    pub lod: DensitySettings,
    /// The scene as it is shown.
    pub shown: Arc<Shown>,
}

/// What the thread tells.
#[derive(Clone, Debug)]
pub enum Answer {
    /// What the frame's camera sees.
    Now(Seen),
    /// What its camera of later will see, and how fine.
    Later {
        /// The question's frame.
        frame: u64,
        /// What to load.
        expected: Vec<Priority>,
    },
}

/// What a camera sees.
#[derive(Clone, Debug)]
pub struct Seen {
    /// The question's frame.
    pub frame: u64,
    /// Visible drawables, rising.
    pub visible: Vec<Candidate>,
    /// Samples of each of them.
    pub samples: Vec<u32>,
    /// Drawables in the frustum, those that look largest first.
    pub in_frustum: Vec<u32>,
    /// How long it took, milliseconds.
    pub milliseconds: f64,
}

/// What the threads share.
#[derive(Default)]
struct Desk {
    /// Only the newest question is of interest.
    question: Option<Question>,
    is_closed: bool,
}

/// What the thread works with.
struct Work {
    levels: Arc<ChunkLevels>,
    query: CoherentQuery,
    /// Of what was moved, which it tells apart by its scene.
    moved: CoherentQuery,
    rays_per_pixel: RaysPerPixel,
}

/// Answers questions in the order they come, but only the newest of those that wait.
pub struct QueryWorker {
    desk: Arc<(Mutex<Desk>, Condvar)>,
    answers: Receiver<Answer>,
    thread: Option<JoinHandle<()>>,
}

impl QueryWorker {
    /// Starts the thread.
    ///
    /// # Errors
    ///
    /// Settings that make no query; the system has no more threads.
    pub fn new(levels: Arc<ChunkLevels>, settings: CoherentSettings) -> Result<Self, WorkerError> {
        let rays_per_pixel = settings.rays_per_pixel;
        let query = CoherentQuery::new(settings)?;
        let moved = CoherentQuery::new(CoherentSettings { method: RayMethod::Exact, ..settings })?;
        let mut work = Work { levels, query, moved, rays_per_pixel };
        let desk = Arc::new((Mutex::new(Desk::default()), Condvar::new()));
        let (tell, answers) = channel();
        let shared = Arc::clone(&desk);
        let thread =
            std::thread::Builder::new().name("visibility".into()).spawn(move || work.run(&shared, &tell))?;
        Ok(QueryWorker { desk, answers, thread: Some(thread) })
    }

    /// Asks; a question that nobody has begun to answer is dropped for it.
    ///
    /// # Errors
    ///
    /// A camera that is none.
    pub fn ask(&self, question: Question) -> Result<(), CameraError> {
        question.camera.rays()?;
        let (desk, bell) = &*self.desk;
        let mut desk = lock(desk);
        // Who jumps has jumped, whatever is asked after it.
        let has_jumped = desk.question.as_ref().is_some_and(|dropped| dropped.is_cut);
        desk.question = Some(Question { is_cut: question.is_cut || has_jumped, ..question });
        bell.notify_one();
        Ok(())
    }

    /// The next answer, oldest first, if there is one. Does not wait.
    ///
    /// # Errors
    ///
    /// The thread has died.
    pub fn answer(&self) -> Result<Option<Answer>, WorkerError> {
        match self.answers.try_recv() {
            Ok(answer) => Ok(Some(answer)),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(WorkerError::Died),
        }
    }

    /// Waits for the next answer.
    ///
    /// # Errors
    ///
    /// The thread has died.
    pub fn wait(&self) -> Result<Answer, WorkerError> {
        self.answers.recv().map_err(|_| WorkerError::Died)
    }
}

impl Drop for QueryWorker {
    fn drop(&mut self) {
        let (desk, bell) = &*self.desk;
        lock(desk).is_closed = true;
        bell.notify_one();
        if let Some(thread) = self.thread.take() {
            // It has panicked, which it has told already.
            let _ = thread.join();
        }
    }
}

/// Why there is no thread.
#[derive(Debug, thiserror::Error)]
pub enum WorkerError {
    /// Settings that make no query.
    #[error(transparent)]
    Settings(#[from] CoherentError),
    /// It has died.
    #[error("the thread that asks what is visible has stopped")]
    Died,
    /// The system has no more threads.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] std::io::Error),
}

fn lock(desk: &Mutex<Desk>) -> MutexGuard<'_, Desk> {
    desk.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Work {
    /// Answers until it is closed, or nobody listens.
    fn run(&mut self, shared: &(Mutex<Desk>, Condvar), tell: &Sender<Answer>) {
        let (desk, bell) = shared;
        loop {
            let waiting = bell.wait_while(lock(desk), |desk| desk.question.is_none() && !desk.is_closed);
            let mut waiting = waiting.unwrap_or_else(PoisonError::into_inner);
            let (Some(question), false) = (waiting.question.take(), waiting.is_closed) else { return };
            drop(waiting);
            let told = self.now(&question).is_none_or(|seen| tell.send(Answer::Now(seen)).is_ok());
            if !told {
                return;
            }
            // What comes later can wait, if something more urgent does not.
            let is_idle = lock(desk).question.is_none();
            if is_idle
                && let Some(expected) = self.later(&question)
                && tell.send(Answer::Later { frame: question.frame, expected }).is_err()
            {
                return;
            }
        }
    }

    fn now(&mut self, question: &Question) -> Option<Seen> {
        let started = Instant::now();
        // Checked when it was asked.
        let camera = question.camera.rays().ok()?;
        let scene = question.shown.unmoved();
        if question.is_cut {
            self.query.reset();
            self.moved.reset();
        }
        let seen = self.query.frame(&scene, &camera, &Silent)?.found;
        let in_view = query(&scene, &camera, Method::Frustum, &QuerySettings::default());
        let visible = candidates(scene.exact, &camera, &seen);
        let mut visible: Vec<(Candidate, u32)> =
            visible.into_iter().map(|one| (one, seen.samples[one.drawable as usize])).collect();
        let mut in_frustum = sized(&scene, camera.eye(), &in_view.visible);
        if let Some(moved) = question.shown.moved() {
            let found = moved.candidates(&scene, &camera, &mut self.moved);
            in_frustum.extend(found.iter().filter_map(|(one, _)| {
                Some((apparent_size(moved.drawable_box(one.drawable)?, camera.eye()), one.drawable))
            }));
            visible.extend(found);
            visible.sort_unstable_by_key(|(one, _)| one.drawable);
        }
        let (visible, samples) = visible.into_iter().unzip();
        Some(Seen {
            frame: question.frame,
            samples,
            visible,
            in_frustum: largest_first(in_frustum),
            milliseconds: started.elapsed().as_secs_f64() * 1e3,
        })
    }

    /// What the camera of later sees, by voxels alone and few rays: it decides only what is loaded.
    fn later(&self, question: &Question) -> Option<Vec<Priority>> {
        // A predicted camera may be none: then nothing is expected.
        let camera = question.later?.rays().ok()?;
        let scene = question.shown.unmoved();
        let few = QuerySettings { rays_per_pixel: self.rays_per_pixel, ..QuerySettings::default() };
        let seen = query(&scene, &camera, Method::Voxel, &few);
        let visible = candidates(scene.exact, &camera, &seen);
        let selection = density::select(&*self.levels, &visible, &question.lod, None);
        let samples: Vec<u32> = visible.iter().map(|one| seen.samples[one.drawable as usize]).collect();
        Some(priorities(&selection, &visible, &samples))
    }
}

/// What a selection wants, with the samples of what it was made for.
pub(super) fn priorities(selection: &Selection, visible: &[Candidate], samples: &[u32]) -> Vec<Priority> {
    let samples = |choice: &Choice| {
        let at = visible.binary_search_by_key(&choice.drawable, |candidate| candidate.drawable);
        at.map_or(0, |at| samples[at])
    };
    selection.choices.iter().map(|choice| Priority { choice: *choice, samples: samples(choice) }).collect()
}

/// How large a box looks from here, as a square of an angle; a drawable beside it.
type Sized = (f64, u32);

fn apparent_size((min, max): (DVec3, DVec3), eye: DVec3) -> f64 {
    (max - min).length_squared() / eye.clamp(min, max).distance_squared(eye).max(f64::MIN_POSITIVE)
}

/// Drawables of a set.
fn sized(scene: &QueryScene, eye: DVec3, set: &[bool]) -> Vec<Sized> {
    let members = (0..).zip(set).filter(|(_, is_member)| **is_member).map(|(drawable, _)| drawable);
    members.map(|drawable| (apparent_size(scene.exact.drawable_box(drawable), eye), drawable)).collect()
}

fn largest_first(mut sized: Vec<Sized>) -> Vec<u32> {
    sized.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    sized.into_iter().map(|(_, drawable)| drawable).collect()
}
