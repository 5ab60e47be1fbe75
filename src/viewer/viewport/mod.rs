//! The picture: frames of the walkthrough as a texture of the window, what is picked in it, what is drawn over it.

mod checking;
mod overlay;
mod picking;

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use eframe::egui_wgpu::RenderState;
use egui::{Painter, Pos2, Rect, TextureId};
use glam::{DVec2, DVec3};

use super::measure::LengthUnit;
use super::panels::Figures;
use super::session::Session;
use crate::camera::{Camera, CameraRays};
use crate::gpu::marks::{Marks, SELECTED};
use crate::gpu::shadow::ShadowSettings;
use crate::gpu::target::TextureRead;
use crate::gpu::{Context, GpuError};
use crate::loaded::LoadedScene;
use crate::lod::density::DensitySettings;
use crate::render::{Lighting, Sun};
use crate::streaming::StreamSettings;
use crate::visibility::RayMethod;
use crate::visibility::coherent::CoherentSettings;
use crate::walkthrough::{FrameRecord, Look, WalkError, WalkSettings, Walkthrough};

use checking::{Checking, Faults};
use overlay::Overlay;
pub use overlay::cube_side;
use picking::Pick;
pub use picking::{Purpose, found};

/// Rays a pixel after which a still picture is not asked about any more: more would go on finding what is far smaller than a pixel.
const ENOUGH_RAYS: f64 = 2.0;
/// Samples of shadows after which a still picture is not drawn any more.
const ENOUGH_SAMPLES: u32 = 256;

/// Draws and picks.
pub struct Viewport {
    context: Context,
    walk: Walkthrough,
    texture: Option<(TextureId, (u32, u32))>,
    /// What is drawn is of a state before; that of now is being made.
    is_showing_late: bool,
    marks: Marks,
    /// The selection that is marked.
    marked: Option<u64>,
    lighting: Lighting,
    up: DVec3,
    has_voxels: bool,
    picks: Vec<Pick>,
    last: Option<(FrameRecord, Instant)>,
    /// Frames that were alike: the picture rests.
    still: u32,
    /// The frame that last looked otherwise than the one before.
    changed: u64,
    /// The first frame of what is shown.
    shown_since: u64,
    drawn_camera: Option<Camera>,
    frozen_camera: Option<Camera>,
    checking: Option<Checking>,
    faults: Option<Faults>,
    /// A picture on the way, for views that are to be remembered.
    thumbnail: Option<(TextureRead, (u32, u32))>,
    /// What is wrong with shadows, as it was told.
    told_fault: Option<String>,
    /// Figures of the newest frames.
    pub figures: Figures,
}

impl Viewport {
    /// For a session's scene.
    ///
    /// # Errors
    ///
    /// The GPU cannot hold the budget.
    pub fn new(context: &Context, session: &Session) -> Result<Self, WalkError> {
        let scene = Arc::clone(session.document.scene());
        let preferences = &session.preferences;
        let settings = WalkSettings {
            query: CoherentSettings {
                enough: ENOUGH_RAYS,
                ..CoherentSettings::new(RayMethod::Hybrid, preferences.rays_per_pixel)
            },
            lod: limits(session),
            stream: StreamSettings { budget: preferences.geometry_bytes, ..StreamSettings::default() },
            ..WalkSettings::default()
        };
        let up = scene.scene().meta().settings.up.unit();
        Ok(Viewport {
            walk: Walkthrough::new(scene, context, settings)?,
            context: context.clone(),
            texture: None,
            is_showing_late: false,
            marks: Marks::default(),
            marked: None,
            lighting: Lighting::sunny(Sun::default_direction(up)),
            up,
            has_voxels: false,
            picks: Vec::new(),
            last: None,
            still: 0,
            changed: 0,
            shown_since: 0,
            drawn_camera: None,
            frozen_camera: None,
            checking: None,
            faults: None,
            thumbnail: None,
            told_fault: None,
            figures: Figures { budget: preferences.geometry_bytes, ..Figures::default() },
        })
    }

    /// Draws a frame of the session and hands its texture to the window. Is there more to come without anything being touched?
    ///
    /// # Errors
    ///
    /// The GPU has failed.
    pub fn draw(&mut self, session: &mut Session, window: &RenderState) -> Result<bool, WalkError> {
        self.follow(session)?;
        let camera = session.camera();
        let shadows = session.preferences.shadows;
        let samples = session.preferences.shadow_samples;
        let look = Look {
            lighting: &self.lighting,
            up: self.up,
            marks: &self.marks,
            shadows: shadows.then_some(ShadowSettings { samples, smooth: true }),
            caps: session.preferences.caps,
        };
        let record = self.walk.frame(&camera, false, None, &look)?;
        self.show(window);
        let now = Instant::now();
        let is_same = self.drawn_camera == Some(camera) && record.delta == [0; 3] && record.is_complete;
        if !is_same {
            self.changed = record.frame;
        }
        // An answer about a frame since the last change, however long queries take.
        let is_answered = session.is_frozen || record.frame - record.age.min(record.frame) > self.changed;
        self.still = if is_same && is_answered { self.still + 1 } else { 0 };
        if let Some((_, before)) = self.last {
            self.figures.add_time((now - before).as_secs_f32() * 1e3);
        }
        let shadow_samples = shadows.then(|| self.walk.renderer().shadow_samples());
        self.figures = Figures {
            visible: record.visible,
            drawn: record.drawn,
            missing: record.missing,
            is_complete: record.is_complete,
            triangles: record.triangles,
            resident: record.resident,
            query_ms: record.query_ms,
            failed: record.failed,
            shadow_samples,
            ..std::mem::take(&mut self.figures)
        };
        // What is kept of the picture, or judged by it, waits until it shows what the session does.
        let asked_in = record.frame - record.age.min(record.frame);
        let is_up_to_date = !self.is_showing_late && (session.is_frozen || asked_in >= self.shown_since);
        self.last = Some((record, now));
        self.drawn_camera = Some(camera);
        if is_up_to_date && std::mem::take(&mut session.is_check_wanted) {
            self.begin_check(session);
        }
        self.follow_check(session)?;
        self.remember(session, is_up_to_date)?;
        let fault = self.walk.shadow_fault().map(ToString::to_string);
        if fault != self.told_fault {
            fault.iter().for_each(|fault| session.tell(format!("shadows: {fault}")));
            self.told_fault = fault;
        }
        let gathers = shadow_samples.is_some_and(|samples| samples < ENOUGH_SAMPLES);
        Ok(self.still < 20 || gathers || self.is_asked())
    }

    /// Is an answer on its way?
    pub fn is_asked(&self) -> bool {
        !self.picks.is_empty()
            || self.checking.is_some()
            || self.thumbnail.is_some()
            || self.is_showing_late
            || self.walk.is_finding_casters()
    }

    /// Remembers a view with its picture, as soon as that has come back.
    fn remember(&mut self, session: &mut Session, is_up_to_date: bool) -> Result<(), GpuError> {
        let targets = self.walk.renderer().targets();
        if self.thumbnail.is_none() && !session.wanted_bookmarks.is_empty() && is_up_to_date {
            self.thumbnail = Some((targets.picture.read_later(&self.context), targets.size));
        }
        let Some((read, (width, height))) = &self.thumbnail else { return Ok(()) };
        let Some(texels) = read.take::<[u8; 4]>(&self.context)? else { return Ok(()) };
        let bytes: Vec<u8> = texels.into_iter().flat_map(|[r, g, b, _]| [r, g, b]).collect();
        session.save_wanted(image::RgbImage::from_raw(*width, *height, bytes).as_ref());
        self.thumbnail = None;
        Ok(())
    }

    /// Takes over what has changed in the session.
    fn follow(&mut self, session: &mut Session) -> Result<(), WalkError> {
        if session.preferences.shadows && !self.has_voxels {
            match self.walk.load_voxels() {
                Ok(()) => self.has_voxels = true,
                // The scene is seen all the same.
                Err(error) => {
                    session.preferences.shadows = false;
                    session.tell(format!("no shadows: {error}"));
                }
            }
        }
        let (shown, is_newest) = session.document.shown_soon();
        self.is_showing_late = !is_newest;
        if !Arc::ptr_eq(&shown, self.walk.shown()) {
            self.walk.set_shown(shown)?;
            self.still = 0;
            self.shown_since = self.last.as_ref().map_or(0, |(record, _)| record.frame + 1);
            self.changed = self.shown_since;
        }
        self.walk.set_limits(limits(session));
        if session.is_frozen != self.frozen_camera.is_some() {
            self.walk.set_frozen(session.is_frozen);
            self.frozen_camera = session.is_frozen.then(|| session.camera());
        }
        if self.marked != Some(session.document.selection_version()) {
            self.marked = Some(session.document.selection_version());
            self.marks.clear();
            let scene = session.document.scene().scene();
            for object in session.document.selected().iter() {
                scene.object_drawables(object).for_each(|drawable| self.marks.set(drawable, SELECTED, true));
            }
        }
        Ok(())
    }

    /// Hands the picture to the window, as a texture with the same number as before.
    fn show(&mut self, window: &RenderState) {
        let targets = self.walk.renderer().targets();
        if self.texture.is_some_and(|(_, size)| size == targets.size) {
            return;
        }
        let (view, filter) = (&targets.picture.view, wgpu::FilterMode::Nearest);
        let mut renderer = window.renderer.write();
        let id = match self.texture {
            Some((id, _)) => {
                renderer.update_egui_texture_from_wgpu_texture(&window.device, view, filter, id);
                id
            }
            None => renderer.register_native_texture(&window.device, view, filter),
        };
        self.texture = Some((id, targets.size));
    }

    /// Takes its picture away from the window, before another takes its place.
    pub fn free(&mut self, window: &RenderState) {
        if let Some((id, _)) = self.texture.take() {
            window.renderer.write().free_texture(&id);
        }
    }

    /// The texture of the picture.
    pub fn texture(&self) -> Option<TextureId> {
        self.texture.map(|(id, _)| id)
    }

    /// Is everything that is wanted drawn, for some frames?
    pub fn is_settled(&self) -> bool {
        self.still > 3 && !self.is_asked()
    }

    /// How many of some objects that follow each other are visible in the newest answer, and the pixels that they cover there, by its
    /// samples. Takes as long as there are visible ones.
    pub fn seen_of(&self, scene: &LoadedScene, objects: Range<u32>) -> (u32, u64) {
        let all = scene.scene();
        let (Some(seen), false) = (self.walk.seen(), objects.is_empty()) else { return (0, 0) };
        let start = all.object_drawables(objects.start).start;
        let end = all.object_drawables(objects.end - 1).end;
        let first = seen.visible.partition_point(|candidate| candidate.drawable < start);
        let those = seen.visible[first..].iter().take_while(|candidate| candidate.drawable < end);
        let (mut count, mut last, mut pixels) = (0, None, 0.0);
        for candidate in those {
            let object = all.drawable_object(candidate.drawable);
            count += u32::from(last != Some(object));
            last = Some(object);
            pixels += candidate.pixels;
        }
        (count, pixels.round() as u64)
    }

    // --- Over the picture ---

    /// Paints over the picture: what a check has found, names, measurements, handles, where a frozen picture was seen from. `cursor`
    /// is where the mouse is over the picture.
    pub fn overlay(&mut self, session: &Session, painter: &Painter, area: Rect, pointer: Option<Pos2>) {
        self.paint_faults(painter, area);
        let Some(rays) = self.drawn_camera.and_then(|camera| camera.rays().ok()) else { return };
        let overlay = Overlay::new(rays, area, painter);
        let unit = LengthUnit::of(&session.document.scene().scene().meta().settings);
        overlay.labels(session);
        overlay.measurements(session, &unit);
        overlay.handles(session, pointer.map(|at| pixel_of(&rays, area, at)), &unit);
        if let Some(frozen) = self.frozen_camera.and_then(|camera| camera.rays().ok()) {
            let (min, max) = session.bounds();
            overlay.frustum(&frozen, 0.2 * (max - min).length());
        }
        overlay.cube(&session.navigator, pointer);
    }
}

/// The pixel of a camera's picture under a place in the window.
pub fn pixel_of(camera: &CameraRays, area: Rect, at: Pos2) -> DVec2 {
    let (width, height) = camera.size();
    let share = (at - area.min) / area.size();
    DVec2::new(f64::from(share.x) * f64::from(width), f64::from(share.y) * f64::from(height))
}

fn limits(session: &Session) -> DensitySettings {
    DensitySettings {
        budget: session.preferences.triangles,
        pixel_error: session.preferences.pixel_error,
        ..DensitySettings::default()
    }
}
