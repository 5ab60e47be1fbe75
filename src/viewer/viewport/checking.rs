//! The lost-pixel check: the picture against what rays through all triangles see, and where they differ.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use egui::{Color32, ColorImage, Painter, Rect, TextureHandle, TextureOptions, pos2};

use super::Viewport;
use crate::camera::Camera;
use crate::gpu::check::{Difference, Fault, compare, expected};
use crate::gpu::target::TextureRead;
use crate::gpu::{Context, GpuError};
use crate::progress::CancelFlag;
use crate::shown::Shown;
use crate::viewer::session::Session;

/// What was found about a picture.
type Found = (Difference, Vec<Fault>);

/// One check: first the picture comes back from the GPU, then a thread casts the rays. Dropped, it is cancelled.
pub(super) struct Checking {
    camera: Camera,
    shown: Arc<Shown>,
    size: (u32, u32),
    drawables: Option<TextureRead>,
    found: Option<Receiver<Option<Found>>>,
    is_cancelled: Arc<AtomicBool>,
}

/// Where a picture was wrong, as long as it is the one that is shown.
pub(super) struct Faults {
    camera: Camera,
    shown: Arc<Shown>,
    size: (u32, u32),
    faults: Vec<Fault>,
    texture: Option<TextureHandle>,
}

impl Drop for Checking {
    fn drop(&mut self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }
}

impl Checking {
    /// What was found, when it is done; the check is over then. `Err` says why it cannot go on.
    fn step(&mut self, context: &Context) -> Result<Option<Result<Found, String>>, GpuError> {
        if let Some(read) = &self.drawables {
            let Some(drawables) = read.take::<u32>(context)? else { return Ok(None) };
            self.drawables = None;
            let Ok(rays) = self.camera.rays() else { return Ok(Some(Err("there is no camera".to_owned()))) };
            let (tell, found) = channel();
            let (shown, is_cancelled) = (Arc::clone(&self.shown), Arc::clone(&self.is_cancelled));
            let work = move || {
                let expected = expected(&shown, &rays, &CancelFlag(&is_cancelled));
                let found = expected.map(|expected| compare(&expected, &drawables, rays.size()));
                // Nobody waits any more: the check was given up.
                let _ = tell.send(found);
            };
            if let Err(error) = std::thread::Builder::new().name("check".into()).spawn(work) {
                return Ok(Some(Err(format!("cannot start a thread: {error}"))));
            }
            self.found = Some(found);
        }
        let Some(found) = &self.found else { return Ok(None) };
        Ok(match found.try_recv() {
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) | Ok(None) => Some(Err("the check has stopped".to_owned())),
            Ok(Some(found)) => Some(Ok(found)),
        })
    }
}

impl Viewport {
    /// Begins a check of what is drawn; one that is under way is given up.
    pub(super) fn begin_check(&mut self, session: &mut Session) {
        self.faults = None;
        let Some(camera) = self.drawn_camera else { return session.tell("nothing is drawn yet") };
        if session.is_frozen {
            return session.tell("what is frozen was chosen for another view: end Freeze, then check");
        }
        let targets = self.walk.renderer().targets();
        self.checking = Some(Checking {
            camera,
            shown: Arc::clone(self.walk.shown()),
            size: targets.size,
            drawables: Some(targets.drawable.read_later(&self.context)),
            found: None,
            is_cancelled: Arc::default(),
        });
        session.tell("checking against rays through all triangles ...");
    }

    pub(super) fn follow_check(&mut self, session: &mut Session) -> Result<(), GpuError> {
        let Some(checking) = &mut self.checking else { return Ok(()) };
        let Some(outcome) = checking.step(&self.context)? else { return Ok(()) };
        match outcome {
            Err(told) => session.tell(told),
            Ok((difference, faults)) => {
                session.tell(describe(&difference));
                let (camera, size) = (checking.camera, checking.size);
                let shown = Arc::clone(&checking.shown);
                self.faults = Some(Faults { camera, shown, size, faults, texture: None });
            }
        }
        self.checking = None;
        Ok(())
    }

    /// Paints what the last check found, if it was of this picture.
    pub(super) fn paint_faults(&mut self, painter: &Painter, area: Rect) {
        let is_same = |faults: &Faults| {
            self.drawn_camera == Some(faults.camera) && Arc::ptr_eq(&faults.shown, self.walk.shown())
        };
        if !self.faults.as_ref().is_some_and(is_same) {
            self.faults = None;
            return;
        }
        let Some(Faults { size, faults, texture, .. }) = &mut self.faults else { return };
        let texture = texture.get_or_insert_with(|| {
            let pixels: Vec<Color32> = faults.iter().copied().map(colour).collect();
            let size = [size.0 as usize, size.1 as usize];
            painter.ctx().load_texture("faults", ColorImage::new(size, pixels), TextureOptions::NEAREST)
        });
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        painter.image(texture.id(), area, whole, Color32::WHITE);
    }
}

/// Red is what is lost.
fn colour(fault: Fault) -> Color32 {
    match fault {
        Fault::None => Color32::TRANSPARENT,
        Fault::Silhouette => Color32::from_rgba_unmultiplied(255, 235, 60, 200),
        Fault::Wrong => Color32::from_rgba_unmultiplied(255, 120, 0, 220),
        Fault::Lost => Color32::from_rgba_unmultiplied(255, 0, 0, 230),
    }
}

fn describe(difference: &Difference) -> String {
    let Difference { pixels, differ, off_silhouettes, lost } = *difference;
    let share = 100.0 * differ as f64 / pixels.max(1) as f64;
    format!(
        "check: {differ} of {pixels} pixels differ ({share:.3} %; yellow), {off_silhouettes} of them away from outlines \
         (orange); {lost} parts of 16 pixels and more are missing (red)"
    )
}
