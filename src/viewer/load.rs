//! Opens a scene on a thread of its own, or first makes one of a model, with progress that a window can show.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use crate::container::{ContainerError, Source};
use crate::import::{ImportError, ImportOptions, import};
use crate::loaded::LoadedScene;
use crate::prepare::{BuildError, BuildSettings, build};
use crate::progress::Progress;
use crate::scene::Scene;

/// Why there is nothing to be seen.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The file cannot be looked at.
    #[error("{}: {source}", path.display())]
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
}

/// Loading under way. Dropped, it is cancelled.
pub struct Loading {
    shared: Arc<Shared>,
    opened: Receiver<Result<Opened, OpenError>>,
    path: PathBuf,
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
        std::thread::Builder::new().name("load".into()).spawn(move || {
            // Nobody waits any more: it was cancelled.
            let _ = tell.send(open(&file, &*progress));
            told();
        })?;
        Ok(Loading { shared, opened, path })
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
    }
}

/// Opens a scene, or makes one of a model first.
///
/// # Errors
///
/// See [`OpenError`].
pub fn open(path: &Path, progress: &dyn Progress) -> Result<Opened, OpenError> {
    if path.extension() == Some(OsStr::new("vxs")) {
        let scene = Arc::new(LoadedScene::new(Scene::open(path)?, progress)?);
        return Ok(Opened { scene, path: path.to_owned(), remarks: Vec::new() });
    }
    let cache = cache_of(path);
    let mut remarks = Vec::new();
    if !is_fresh(path, &cache)? {
        remarks = make(path, &cache, progress)?;
    }
    let scene = match Scene::open(&cache) {
        Ok(scene) if !remarks.is_empty() || is_of(&scene, path) => scene,
        Ok(_) => {
            remarks = make(path, &cache, progress)?;
            Scene::open(&cache)?
        }
        // Of another version, or damaged: it is only a copy.
        Err(_) if remarks.is_empty() => {
            remarks = make(path, &cache, progress)?;
            Scene::open(&cache)?
        }
        Err(error) => return Err(error.into()),
    };
    Ok(Opened { scene: Arc::new(LoadedScene::new(scene, progress)?), path: cache, remarks })
}

/// Where the scene of a model is kept: `pump.glb` has `pump.glb.vxs` beside it.
pub fn cache_of(model: &Path) -> PathBuf {
    let mut name = model.file_name().unwrap_or_default().to_owned();
    name.push(".vxs");
    model.with_file_name(name)
}

/// Is the kept scene newer than its model: than the file, and the buffers and materials beside it, or all files of a folder?
fn is_fresh(model: &Path, cache: &Path) -> Result<bool, OpenError> {
    let file = |source| OpenError::File { path: model.to_owned(), source };
    let newest = newest_of(model).map_err(file)?;
    let Ok(kept) = std::fs::metadata(cache).and_then(|meta| meta.modified()) else { return Ok(false) };
    Ok(kept > newest)
}

/// Is a kept scene of this model, as long as it is now? Copies and archives keep the times of files.
fn is_of(scene: &Scene, model: &Path) -> bool {
    let length =
        |path: &Path| std::fs::metadata(path).ok().filter(|meta| meta.is_file()).map(|meta| meta.len());
    let sources = &scene.meta().sources;
    match (sources.as_slice(), length(model)) {
        // One file, and what it refers to is counted with it: it cannot be longer than both.
        ([only], Some(length)) => {
            length <= only.bytes && (model.extension() != Some(OsStr::new("glb")) || length == only.bytes)
        }
        (several, None) => several
            .iter()
            .all(|source| length(&model.join(&source.name)).is_none_or(|length| length <= source.bytes)),
        (_, Some(_)) => false,
    }
}

fn newest_of(model: &Path) -> std::io::Result<SystemTime> {
    let meta = std::fs::metadata(model)?;
    let mut newest = meta.modified()?;
    let (folder, is_folder) = match (meta.is_dir(), model.parent()) {
        (true, _) => (model, true),
        (false, Some(parent)) if parent != Path::new("") => (parent, false),
        (false, _) => (Path::new("."), false),
    };
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let path = entry.path();
        let is_beside = path.extension().is_some_and(|extension| extension == "bin" || extension == "mtl");
        if is_folder && entry.file_type()?.is_dir() {
            newest = newest.max(newest_of(&path)?);
        } else if is_folder || is_beside {
            newest = newest.max(entry.metadata()?.modified()?);
        }
    }
    Ok(newest)
}

/// Makes a scene of a model. Tells what was repaired.
fn make(model: &Path, cache: &Path, progress: &dyn Progress) -> Result<Vec<String>, OpenError> {
    let imported = import(&[model.to_owned()], &ImportOptions::default(), progress)?;
    let settings = BuildSettings::of(&imported);
    let sources = imported.sources.iter().map(|source| Source {
        name: source.name.clone(),
        bytes: source.bytes,
        xxh3: format!("{:016x}", source.xxh3),
    });
    let sources = sources.collect();
    let outcome = build(imported.model, sources, imported.findings, &settings, cache, progress)
        .map_err(|error| OpenError::Build { cache: cache.to_owned(), error: Box::new(error) })?;
    let findings = outcome.report.findings.0.iter();
    Ok(findings
        .map(|(what, finding)| format!("{} {what} (first: {})", finding.count, finding.first))
        .collect())
}
