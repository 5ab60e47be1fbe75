//! A walk through a scene, frame after frame: what viewer and `voxsight walk` share.
//!
//! ```text
//! query (its own thread) -> levels of detail -> what changes -> copies -> pictures
//! ```
//!
//! The query of a frame is answered while an earlier answer is drawn: a frame never waits for it, unless it is asked to
//! ([`Latency::None`]). Pages are read and decoded by threads of their own. What the answer wants and is not yet there is drawn at the
//! nearest level that is ([`crate::streaming`]).

mod casters;
mod record;
mod worker;

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use crate::camera::{Camera, CameraError};
use crate::gpu::clear::ClearBricks;
use crate::gpu::frame::{FrameInput, FrameRenderer};
use crate::gpu::instance::{Changes, DrawList};
use crate::gpu::marks::Marks;
use crate::gpu::memory::Copies;
use crate::gpu::shadow::ShadowSettings;
use crate::gpu::{Context, GpuError};
use crate::loaded::LoadedScene;
use crate::lod::density::{self, DensitySettings};
use crate::lod::{Choice, ChunkLevels, Selection};
use crate::moved::MovedError;
use crate::render::Lighting;
use crate::shown::Shown;
use crate::streaming::{
    ContainerPages, Frame, LoadError, Loader, Priority, StreamSettings, Streamer, predicted,
};
use crate::visibility::coherent::CoherentSettings;
use crate::visibility::{RayMethod, RaysPerPixel};

use casters::{CasterWorker, Casters, clear_bricks};
pub use record::{FrameRecord, csv_header, csv_line};
use worker::priorities;
pub use worker::{Answer, QueryWorker, Question, Seen, WorkerError};

/// Which answer a frame draws.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Latency {
    /// Its own: it waits for it.
    None,
    /// The newest there is.
    #[default]
    Newest,
}

/// How pages reach the GPU (Peng and Cao 2012).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Upload {
    /// What changes, gathered into one buffer: with coherence.
    #[default]
    Delta,
    /// All that is drawn, every frame, gathered: without coherence.
    Full,
    /// All that is drawn, every frame, one by one.
    Each,
}

/// How a walk goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WalkSettings {
    /// What is visible.
    pub query: CoherentSettings,
    /// How fine it is drawn.
    pub lod: DensitySettings,
    /// What is resident.
    pub stream: StreamSettings,
    /// Which answer is drawn.
    pub latency: Latency,
    /// How pages reach the GPU.
    pub upload: Upload,
    /// Frames ahead for which pages are loaded; 0 for none.
    pub ahead: f64,
    /// Wait for the GPU after copies and after drawing, and read its clock: for measuring.
    pub wait: bool,
}

impl Default for WalkSettings {
    fn default() -> Self {
        WalkSettings {
            query: CoherentSettings::new(RayMethod::Hybrid, RaysPerPixel::SIXTEENTH),
            lod: DensitySettings::default(),
            stream: StreamSettings::default(),
            latency: Latency::Newest,
            upload: Upload::Delta,
            ahead: 10.0,
            wait: false,
        }
    }
}

/// How a frame looks.
#[derive(Clone, Copy, Debug)]
pub struct Look<'a> {
    /// Light.
    pub lighting: &'a Lighting,
    /// The world's up direction.
    pub up: DVec3,
    /// What is selected.
    pub marks: &'a Marks,
    /// Cast by voxels, if at all.
    pub shadows: Option<ShadowSettings>,
    /// What is cut open is drawn as solid.
    pub caps: bool,
}

/// Why a walk cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum WalkError {
    /// The GPU.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The thread that asks what is visible.
    #[error(transparent)]
    Worker(#[from] WorkerError),
    /// The threads that load pages.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] std::io::Error),
}

/// Why shadows are not those of what is shown.
#[derive(Debug, thiserror::Error)]
pub enum ShadowFault {
    /// What was moved has no voxels.
    #[error(transparent)]
    Moved(#[from] MovedError),
    /// The GPU cannot hold what it takes.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The thread that works it out.
    #[error(transparent)]
    Worker(#[from] WorkerError),
}

/// Frames of a scene.
pub struct Walkthrough {
    settings: WalkSettings,
    /// The scene as it was last asked for.
    shown: Arc<Shown>,
    casters: CasterWorker,
    levels: Arc<ChunkLevels>,
    pages: Arc<ContainerPages<LoadedScene>>,
    worker: QueryWorker,
    loader: Loader,
    streamer: Streamer,
    renderer: FrameRenderer,
    /// Host copies of pages, where each frame sends all.
    host: Vec<u8>,
    /// Frames that were begun; one that fails has a number of its own, too.
    begun: u64,
    before: Option<Camera>,
    last_cut: u64,
    /// The newest answer, and what was chosen by it.
    seen: Option<Seen>,
    selection: Selection,
    wanted: Vec<Priority>,
    expected: Vec<Priority>,
    /// Drawn in the frame before; another number whenever it changes.
    drawn: Vec<Choice>,
    scene_number: u64,
    failed: Vec<(u32, LoadError)>,
    shadow_fault: Option<ShadowFault>,
    is_frozen: bool,
    /// The camera has jumped since it was last asked what is visible.
    has_jumped: bool,
}

impl Walkthrough {
    /// Begins with nothing resident; pictures are as large as the cameras say.
    ///
    /// # Errors
    ///
    /// The GPU cannot hold the budget; no threads.
    pub fn new(
        scene: Arc<LoadedScene>,
        context: &Context,
        settings: WalkSettings,
    ) -> Result<Self, WalkError> {
        let renderer = FrameRenderer::new(context, settings.stream.budget, (1, 1))?;
        let host = match settings.upload {
            Upload::Delta => Vec::new(),
            Upload::Full | Upload::Each => vec![0; settings.stream.budget as usize],
        };
        let levels = Arc::new(ChunkLevels::new(scene.scene()));
        let pages = Arc::new(ContainerPages(Arc::clone(&scene)));
        Ok(Walkthrough {
            worker: QueryWorker::new(Arc::clone(&levels), settings.query)?,
            levels,
            loader: Loader::new(pages.clone(), 1)?,
            pages,
            streamer: Streamer::new(settings.stream),
            shown: Arc::new(Shown::all(scene)),
            casters: CasterWorker::default(),
            renderer,
            host,
            settings,
            begun: 0,
            before: None,
            last_cut: 0,
            seen: None,
            selection: Selection::default(),
            wanted: Vec::new(),
            expected: Vec::new(),
            drawn: Vec::new(),
            scene_number: 0,
            failed: Vec::new(),
            shadow_fault: None,
            is_frozen: false,
            has_jumped: false,
        })
    }

    /// Makes voxels cast shadows, in frames that ask for it.
    ///
    /// # Errors
    ///
    /// The GPU cannot hold them.
    pub fn load_voxels(&mut self) -> Result<(), WalkError> {
        let query = self.shown.scene().query();
        // Looking at all voxels takes long: who does not measure need not wait for it.
        let now = |walk: &Self| clear_bricks(&walk.shown);
        let clear = if self.settings.wait { now(self) } else { ClearBricks::default() };
        self.renderer.set_voxels(&query.dag, &query.grid, &clear)?;
        if self.settings.wait && self.shown.moved().is_none() { Ok(()) } else { self.find_casters() }
    }

    /// Shows the scene as a user has left it; it must be of the same scene. What that uncovers comes with the next answers, and
    /// shadows follow as soon as it is known what casts them.
    ///
    /// # Errors
    ///
    /// No more threads.
    pub fn set_shown(&mut self, shown: Arc<Shown>) -> Result<(), WalkError> {
        debug_assert!(Arc::ptr_eq(shown.scene(), self.shown.scene()), "of another scene");
        self.shown = shown;
        self.scene_number += 1;
        self.find_casters()
    }

    fn find_casters(&mut self) -> Result<(), WalkError> {
        if self.renderer.has_voxels() {
            self.casters.change(&self.shown)?;
        }
        Ok(())
    }

    /// Takes over what casts shadows now, if that has become known. What fails concerns shadows alone, and is kept for
    /// [`Walkthrough::shadow_fault`].
    fn take_casters(&mut self) -> Result<(), WalkError> {
        let wait = self.settings.latency == Latency::None;
        loop {
            let found = match self.casters.take(wait) {
                Ok(None) => return Ok(()),
                Ok(Some(casters)) => self.use_casters(casters),
                Err(error) => Err(error.into()),
            };
            self.shadow_fault = found.err();
            self.scene_number += 1;
        }
    }

    fn use_casters(&mut self, Casters { clear, moved }: Casters) -> Result<(), ShadowFault> {
        self.renderer.set_moved_voxels(None)?;
        self.renderer.set_clear(&clear)?;
        if let Some(voxels) = moved? {
            self.renderer.set_moved_voxels(Some((&voxels.dag.view(), &voxels.grid)))?;
        }
        Ok(())
    }

    /// The scene as it is shown.
    pub fn shown(&self) -> &Arc<Shown> {
        &self.shown
    }

    /// Is it being worked out what casts shadows? Then frames to come may look otherwise.
    pub fn is_finding_casters(&self) -> bool {
        self.casters.is_busy()
    }

    /// Why shadows are not those of what is shown, if they are not.
    pub fn shadow_fault(&self) -> Option<&ShadowFault> {
        self.shadow_fault.as_ref()
    }

    /// What draws: pictures to read back, times.
    pub fn renderer(&self) -> &FrameRenderer {
        &self.renderer
    }

    /// What the newest answer saw.
    pub fn seen(&self) -> Option<&Seen> {
        self.seen.as_ref()
    }

    /// Goes on drawing what is drawn now, wherever the camera goes: shows what is culled.
    pub fn set_frozen(&mut self, is_frozen: bool) {
        self.is_frozen = is_frozen;
    }

    /// Other limits from the next frame on; the memory's size and the rays stay.
    pub fn set_limits(&mut self, lod: DensitySettings) {
        if self.settings.lod != lod {
            self.settings.lod = lod;
            // What is frozen stays as it is; the next answer goes by them.
            if !self.is_frozen {
                self.select();
            }
        }
    }

    /// What was drawn last, rising by drawable.
    pub fn drawn(&self) -> &[Choice] {
        &self.drawn
    }

    /// Pages that could not be loaded, and why.
    pub fn failed(&self) -> &[(u32, LoadError)] {
        &self.failed
    }

    /// Draws a frame. `later` is where the camera will be [`WalkSettings::ahead`] frames later, where that is known; else it is
    /// predicted.
    ///
    /// # Errors
    ///
    /// See [`WalkError`].
    pub fn frame(
        &mut self,
        camera: &Camera,
        is_cut: bool,
        later: Option<Camera>,
        look: &Look,
    ) -> Result<FrameRecord, WalkError> {
        let started = Instant::now();
        let rays = camera.rays()?;
        let mut record = FrameRecord { frame: self.begun, is_cut, ..FrameRecord::default() };
        self.begun += 1;
        // A jump that nobody asks about is one when it is asked again.
        self.has_jumped |= is_cut;
        if !self.is_frozen {
            let has_jumped = std::mem::take(&mut self.has_jumped);
            self.ask(camera, has_jumped, later)?;
        }
        if !self.is_frozen && self.take_answers()? {
            let started = Instant::now();
            self.select();
            record.select_ms = milliseconds(started);
        }
        if let Some(seen) = &self.seen {
            record.age = record.frame - seen.frame;
            record.visible = seen.visible.len() as u32;
            record.query_ms = seen.milliseconds;
        }
        self.stream(&mut record);
        self.upload(&mut record)?;
        self.take_casters()?;

        let draw = Instant::now();
        let shown = &self.shown;
        let changes = Changes { filter: shown.filter(), moved: shown.moved() };
        let list = DrawList::new(shown.scene().scene(), &rays, &self.drawn, &changes, |page| {
            self.streamer.offset_of(page)
        });
        record.triangles = list.triangles;
        self.renderer.draw(&FrameInput {
            list: &list,
            clip: shown.filter().clip_planes(),
            lighting: look.lighting,
            up: look.up,
            marks: look.marks,
            shadows: look.shadows,
            caps: look.caps,
            scene: self.scene_number,
        })?;
        if self.settings.wait {
            self.renderer.context().wait()?;
        }
        record.draw_ms = milliseconds(draw);
        record.frame_ms = milliseconds(started);
        if self.settings.wait {
            record.passes = self.renderer.times()?;
        }
        self.before = Some(*camera);
        Ok(record)
    }

    /// Of the frame that is drawn, as [`FrameRecord::frame`] counts.
    fn frame_number(&self) -> u64 {
        self.begun.saturating_sub(1)
    }

    /// Asks what the frame sees.
    fn ask(&mut self, camera: &Camera, is_cut: bool, later: Option<Camera>) -> Result<(), WalkError> {
        let ahead = self.settings.ahead;
        let predict = || self.before.filter(|_| !is_cut).and_then(|before| predicted(&before, camera, ahead));
        let is_known = later.is_some();
        let later = if ahead > 0.0 { later.or_else(predict) } else { None };
        // What was predicted before a jump, or of a motion that has ended, will not be seen; a route that is known has the jump in it.
        if is_cut && !is_known {
            self.last_cut = self.frame_number();
        }
        if later.is_none() || (is_cut && !is_known) {
            self.expected.clear();
        }
        self.worker.ask(Question {
            frame: self.frame_number(),
            camera: *camera,
            is_cut,
            later,
            lod: self.settings.lod,
            shown: Arc::clone(&self.shown),
        })?;
        Ok(())
    }

    /// Takes the newest answer. Is there one about a frame?
    fn take_answers(&mut self) -> Result<bool, WalkError> {
        let mut is_new = false;
        while let Some(answer) = self.worker.answer()? {
            is_new |= self.take(answer);
        }
        let is_own = |seen: &Option<Seen>, frame| seen.as_ref().is_some_and(|seen| seen.frame == frame);
        // The first frame has nothing else to draw either.
        while self.seen.is_none()
            || (self.settings.latency == Latency::None && !is_own(&self.seen, self.frame_number()))
        {
            let answer = self.worker.wait()?;
            is_new |= self.take(answer);
        }
        Ok(is_new)
    }

    fn take(&mut self, answer: Answer) -> bool {
        match answer {
            Answer::Now(seen) => {
                self.seen = Some(seen);
                true
            }
            Answer::Later { frame, expected } => {
                if frame >= self.last_cut {
                    self.expected = expected;
                }
                false
            }
        }
    }

    /// Chooses levels for the newest answer.
    fn select(&mut self) {
        let Some(seen) = &self.seen else { return };
        self.selection =
            density::select(&*self.levels, &seen.visible, &self.settings.lod, Some(&self.selection));
        self.wanted = priorities(&self.selection, &seen.visible, &seen.samples);
    }

    /// Decides what to load and draw.
    fn stream(&mut self, record: &mut FrameRecord) {
        let started = Instant::now();
        let Walkthrough { settings, levels, pages, loader, streamer, renderer, host, seen, .. } = self;
        let in_frustum = seen.as_ref().map_or(&[][..], |seen| &seen.in_frustum);
        let frame = Frame { wanted: &self.wanted, in_frustum, expected: &self.expected };
        let bytes_of = |page: u32| pages.bytes_of(page);
        let memory: &mut dyn crate::streaming::Memory = match settings.upload {
            Upload::Delta => &mut renderer.memory,
            Upload::Full | Upload::Each => host,
        };
        let (report, requests) = streamer.frame(&**levels, &frame, &bytes_of, loader.fetch(), memory);
        loader.request(&requests);
        record.drawn = report.drawn.len() as u32;
        record.substituted = report.substituted;
        record.missing = report.missing;
        record.is_complete = report.is_complete;
        record.delta = [report.added, report.removed, report.changed];
        record.written = report.written;
        record.evicted = report.evicted;
        record.moved = report.moved;
        record.resident = report.resident;
        if self.drawn != report.drawn {
            self.drawn = report.drawn;
            self.scene_number += 1;
        }
        self.failed.extend(report.failed);
        record.failed = self.failed.len() as u32;
        record.stream_ms = milliseconds(started);
    }

    /// Copies pages to the GPU.
    fn upload(&mut self, record: &mut FrameRecord) -> Result<(), WalkError> {
        let started = Instant::now();
        let mut copies = Copies::default();
        if self.settings.upload != Upload::Delta {
            let scene = self.shown.scene().scene();
            let context = self.renderer.context().clone();
            let mut pages: Vec<u32> =
                self.drawn.iter().map(|choice| scene.page_of(choice.drawable, choice.level)).collect();
            pages.sort_unstable();
            pages.dedup();
            for page in pages {
                let Some(offset) = self.streamer.offset_of(page) else { continue };
                let bytes = &self.host[offset as usize..][..self.pages.bytes_of(page) as usize];
                if self.settings.upload == Upload::Full {
                    crate::streaming::Memory::write(&mut self.renderer.memory, offset, bytes);
                } else {
                    self.renderer.memory.write_alone(&context, offset, bytes);
                    copies.count += 1;
                    copies.bytes += bytes.len() as u64;
                }
            }
        }
        let gathered = self.renderer.upload()?;
        record.copies = copies.count + gathered.count;
        if self.settings.upload != Upload::Delta {
            record.written = copies.bytes + gathered.bytes;
        }
        if self.settings.wait {
            self.renderer.context().wait()?;
        }
        record.upload_ms = milliseconds(started);
        Ok(())
    }
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
