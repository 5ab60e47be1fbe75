//! Opens a scene on a thread of its own, or first makes one of a model, with progress that a window can show.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use crate::container::{ContainerError, ReferredFile, Source};
use crate::import::{ImportError, ImportOptions, import, length_beside};
use crate::loaded::LoadedScene;
use crate::prepare::{BuildError, BuildSettings, build};
use crate::progress::Progress;
use crate::scene::Scene;

/// Why there is nothing to be seen.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The file cannot be looked at.
    #[error("{}: cannot be read: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// As the system says.
        source: std::io::Error,
    },
    /// The model cannot be read.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// No scene can be made of it.
    #[error("{}: {error}. If the folder cannot be written to, use `voxsight build MODEL -o SCENE.vxs` and view that", cache.display())]
    Build {
        /// The scene that was to be written.
        cache: PathBuf,
        /// Why not.
        error: Box<BuildError>,
    },
    /// The scene cannot be opened.
    #[error(transparent)]
    Scene(#[from] ContainerError),
    /// The thread has died.
    #[error("loading has stopped by a fault of the program")]
    Died,
    /// The system has no more threads.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] std::io::Error),
}

/// How far loading is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LoadStatus {
    /// What is being done.
    pub stage: String,
    /// Units of it that are done.
    pub done: u64,
    /// All of them; 0 where that is not known.
    pub total: u64,
    /// What they are.
    pub unit: String,
}

#[derive(Default)]
struct Shared {
    status: Mutex<LoadStatus>,
    done: AtomicU64,
    is_cancelled: AtomicBool,
}

impl Progress for Shared {
    fn stage(&self, name: &str, total: u64, unit: &str) {
        let mut status = self.status.lock().unwrap_or_else(PoisonError::into_inner);
        *status = LoadStatus { stage: name.to_owned(), done: 0, total, unit: unit.to_owned() };
        self.done.store(0, Ordering::Relaxed);
    }

    fn advance(&self, count: u64) {
        self.done.fetch_add(count, Ordering::Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed)
    }
}

/// What was opened.
pub struct Opened {
    /// The scene.
    pub scene: Arc<LoadedScene>,
    /// Its file: the one asked for, or the one made of the model.
    pub path: PathBuf,
    /// What was repaired while it was made, a line each; empty for scenes that were there.
    pub remarks: Vec<String>,
    /// How long it took.
    pub took: Duration,
}

/// Loading under way. Dropped, it is cancelled, and waited for: it leaves nothing half-written.
pub struct Loading {
    shared: Arc<Shared>,
    opened: Receiver<Result<Opened, OpenError>>,
    path: PathBuf,
    thread: Option<JoinHandle<()>>,
}

impl Loading {
    /// Begins. `told` is called when it is done.
    ///
    /// # Errors
    ///
    /// The system has no more threads.
    pub fn begin(path: PathBuf, told: impl Fn() + Send + 'static) -> Result<Self, OpenError> {
        let shared = Arc::new(Shared::default());
        let (tell, opened) = channel();
        let (progress, file) = (Arc::clone(&shared), path.clone());
        let thread = std::thread::Builder::new().name("load".into()).spawn(move || {
            // Nobody waits any more: it was cancelled.
            let _ = tell.send(open(&file, &*progress));
            told();
        })?;
        Ok(Loading { shared, opened, path, thread: Some(thread) })
    }

    /// What is loaded.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How far it is.
    pub fn status(&self) -> LoadStatus {
        let status = self.shared.status.lock().unwrap_or_else(PoisonError::into_inner).clone();
        LoadStatus { done: self.shared.done.load(Ordering::Relaxed), ..status }
    }

    /// Has it ended?
    pub fn is_over(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Stops it: an error soon tells so.
    pub fn cancel(&self) {
        self.shared.is_cancelled.store(true, Ordering::Relaxed);
    }

    /// The scene, or why there is none, when it is done.
    pub fn take(&self) -> Option<Result<Opened, OpenError>> {
        match self.opened.try_recv() {
            Ok(opened) => Some(opened),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(OpenError::Died)),
        }
    }
}

impl Drop for Loading {
    fn drop(&mut self) {
        self.cancel();
        if let Some(thread) = self.thread.take() {
            // It has panicked, which it has told already.
            let _ = thread.join();
        }
    }
}

/// Opens a scene, or makes one of a model first.
///
/// # Errors
///
/// See [`OpenError`].
pub fn open(path: &Path, progress: &dyn Progress) -> Result<Opened, OpenError> {
    let began = Instant::now();
    if path.extension() == Some(OsStr::new("vxs")) {
        let scene = Arc::new(LoadedScene::new(Scene::open(path)?, progress)?);
        return Ok(Opened { scene, path: path.to_owned(), remarks: Vec::new(), took: began.elapsed() });
    }
    let cache = cache_of(path)?;
    let written = std::fs::metadata(&cache).and_then(|meta| meta.modified()).ok();
    // One of another version, or damaged, is only a copy.
    let kept = match written.zip(Scene::open(&cache).ok()) {
        Some((written, scene)) => {
            let file = |source| OpenError::File { path: path.to_owned(), source };
            is_current(&scene, written, path).map_err(file)?.then_some(scene)
        }
        None => None,
    };
    let (scene, remarks) = match kept {
        Some(scene) => (scene, Vec::new()),
        None => {
            let remarks = make(path, &cache, progress)?;
            (Scene::open(&cache)?, remarks)
        }
    };
    let scene = Arc::new(LoadedScene::new(scene, progress)?);
    Ok(Opened { scene, path: cache, remarks, took: began.elapsed() })
}

/// Where the scene of a model is kept: `pump.glb` has `pump.glb.view.vxs` beside it, the folder `plant` has `plant.view.vxs`. Nobody
/// names a scene of their own so: what stands there is replaced when it is not of the model any more.
///
/// # Errors
///
/// There is no such model.
pub fn cache_of(model: &Path) -> Result<PathBuf, OpenError> {
    // `.` and `..` have names, too.
    let whole = model.canonicalize().map_err(|source| OpenError::File { path: model.to_owned(), source })?;
    let mut name = whole.file_name().unwrap_or_default().to_owned();
    name.push(".view.vxs");
    let is_named = model.file_name() == whole.file_name();
    Ok(if is_named { model.with_file_name(name) } else { whole.with_file_name(name) })
}

/// Is a kept scene of this model as it is now: not older than any of its files, and those as long as they were? Lengths are looked at
/// since copies and archives keep the times of files.
fn is_current(scene: &Scene, kept: SystemTime, model: &Path) -> std::io::Result<bool> {
    let is_folder = model.is_dir();
    let sources = &scene.meta().sources;
    let mut newest = newest_of(model)?;
    let mut lengths_are_right = !sources.is_empty() && (is_folder || sources.len() == 1);
    for source in sources {
        // A folder's files have paths in it.
        let file = if is_folder { model.join(&source.name) } else { model.to_owned() };
        let folder = file.parent().unwrap_or(Path::new(""));
        let mut own_length = source.bytes;
        for ReferredFile { name, bytes } in &source.referred {
            own_length = own_length.saturating_sub(bytes.unwrap_or(0));
            // What was missing may come later.
            let length = length_beside(folder, name);
            lengths_are_right &= *bytes == length;
            if length.is_some() {
                newest = newest.max(std::fs::metadata(folder.join(name))?.modified()?);
            }
        }
        lengths_are_right &= std::fs::metadata(&file).is_ok_and(|meta| meta.len() == own_length);
    }
    Ok(lengths_are_right && kept > newest)
}

/// When a model was last changed; a folder also when something was put into it or taken out.
fn newest_of(model: &Path) -> std::io::Result<SystemTime> {
    let meta = std::fs::metadata(model)?;
    let mut newest = meta.modified()?;
    if meta.is_dir() {
        for entry in std::fs::read_dir(model)? {
            let entry = entry?;
            let is_folder = entry.file_type()?.is_dir();
            newest = newest.max(if is_folder {
                newest_of(&entry.path())?
            } else {
                entry.metadata()?.modified()?
            });
        }
    }
    Ok(newest)
}

/// Makes a scene of a model. Tells what was repaired.
fn make(model: &Path, cache: &Path, progress: &dyn Progress) -> Result<Vec<String>, OpenError> {
    let mut imported = import(&[model.to_owned()], &ImportOptions::default(), progress)?;
    imported.note_guesses(false, false);
    let settings = BuildSettings::of(&imported);
    let sources = imported.sources.iter().map(Source::from).collect();
    let outcome = build(imported.model, sources, imported.findings, &settings, cache, progress)
        .map_err(|error| OpenError::Build { cache: cache.to_owned(), error: Box::new(error) })?;
    let findings = outcome.report.findings.0.iter();
    Ok(findings
        .map(|(what, finding)| format!("{} {what} (first: {})", finding.count, finding.first))
        .collect())
}
