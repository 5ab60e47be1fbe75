//! The picture: frames of the walkthrough as a texture of the window, what is picked in it, what is drawn over it.

use std::ops::Range;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::Instant;

use eframe::egui_wgpu::RenderState;
use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, TextureId, pos2, vec2};
use glam::{DVec2, DVec3, UVec2};

use super::panels::Figures;
use super::pick::{PickImage, Picked, pick_pixel, refine};
use super::session::Session;
use crate::camera::{Camera, CameraRays};
use crate::exact::TriangleHit;
use crate::filter::Filter;
use crate::gpu::check::{Difference, check};
use crate::gpu::marks::{Marks, SELECTED};
use crate::gpu::shadow::ShadowSettings;
use crate::gpu::target::TextureRead;
use crate::gpu::view::ViewUniform;
use crate::gpu::{Context, GpuError};
use crate::loaded::LoadedScene;
use crate::lod::density::DensitySettings;
use crate::moved::Moved;
use crate::progress::Silent;
use crate::ray::Ray;
use crate::render::{Lighting, Sun};
use crate::streaming::StreamSettings;
use crate::visibility::coherent::CoherentSettings;
use crate::visibility::{QueryScene, RayMethod};
use crate::walkthrough::{FrameRecord, Look, WalkError, WalkSettings, Walkthrough};

/// How far off a click may be, pixels.
const PICK_RADIUS: u32 = 6;
/// Samples of shadows after which a still picture is not drawn any more.
const ENOUGH_SAMPLES: u32 = 256;
/// Names that are written into the picture, at most.
const MOST_LABELS: u32 = 12;

/// Why a click was made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Purpose {
    /// To select what is there, beside what is selected.
    Select {
        /// Beside what is selected.
        add: bool,
    },
    /// To measure from there.
    Measure,
}

/// A click whose answer is on its way from the GPU.
struct Pick {
    purpose: Purpose,
    cursor: DVec2,
    camera: Camera,
    drawables: TextureRead,
    depths: TextureRead,
    size: (u32, u32),
    view: ViewUniform,
    /// Depth that bringing a parallel view near took away.
    nearer_by: f64,
}

/// Draws and picks.
pub struct Viewport {
    context: Context,
    walk: Walkthrough,
    texture: Option<(TextureId, (u32, u32))>,
    /// Version of the document that is drawn.
    version: Option<u64>,
    filter: Filter,
    moved: Option<Arc<Moved>>,
    marks: Marks,
    lighting: Lighting,
    up: DVec3,
    has_voxels: bool,
    picks: Vec<Pick>,
    last: Option<(FrameRecord, Instant)>,
    /// Frames that were alike: the picture rests.
    still: u32,
    /// The frame that last looked otherwise than the one before.
    changed: u64,
    drawn_camera: Option<Camera>,
    frozen_camera: Option<Camera>,
    checking: Option<Receiver<Option<Difference>>>,
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
            query: CoherentSettings::new(RayMethod::Hybrid, preferences.rays_per_pixel),
            lod: limits(session),
            stream: StreamSettings { budget: preferences.geometry_bytes, ..StreamSettings::default() },
            ..WalkSettings::default()
        };
        let up = scene.scene().meta().settings.up.unit();
        Ok(Viewport {
            walk: Walkthrough::new(scene, context, settings)?,
            context: context.clone(),
            texture: None,
            version: None,
            filter: Filter::default(),
            moved: None,
            marks: Marks::default(),
            lighting: Lighting::sunny(Sun::default_direction(up)),
            up,
            has_voxels: false,
            picks: Vec::new(),
            last: None,
            still: 0,
            changed: 0,
            drawn_camera: None,
            frozen_camera: None,
            checking: None,
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
        };
        let record = self.walk.frame(&camera, false, None, &look)?;
        self.show(window);
        let now = Instant::now();
        let is_same = self.drawn_camera == Some(camera)
            && record.delta == [0; 3]
            && record.missing + record.substituted == 0;
        if !is_same {
            self.changed = record.frame;
        }
        // An answer about a frame since the last change: however long queries take.
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
            triangles: record.triangles,
            resident: record.resident,
            query_ms: record.query_ms,
            failed: record.failed,
            shadow_samples,
            ..std::mem::take(&mut self.figures)
        };
        self.last = Some((record, now));
        self.drawn_camera = Some(camera);
        if let Some(told) = self.take_check() {
            session.tell(told);
        }
        self.remember(session)?;
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
            || self.walk.is_finding_casters()
    }

    /// Remembers a view with its picture, as soon as that has come back.
    fn remember(&mut self, session: &mut Session) -> Result<(), GpuError> {
        let targets = self.walk.renderer().targets();
        if self.thumbnail.is_none() && !session.wanted_bookmarks.is_empty() {
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
        if self.version != Some(session.document.version()) {
            let (filter, moved) = session.document.changes();
            self.filter = filter.clone();
            self.moved.clone_from(&moved);
            self.walk.set_changes(filter, moved)?;
            self.version = Some(session.document.version());
            self.still = 0;
            self.changed = self.last.as_ref().map_or(0, |(record, _)| record.frame + 1);
        }
        self.walk.set_limits(limits(session));
        if session.is_frozen != self.frozen_camera.is_some() {
            self.walk.set_frozen(session.is_frozen);
            self.frozen_camera = session.is_frozen.then(|| session.camera());
        }
        self.marks.clear();
        let scene = session.document.scene().scene();
        for object in session.document.selected().iter() {
            scene.object_drawables(object).for_each(|drawable| self.marks.set(drawable, SELECTED, true));
        }
        if std::mem::take(&mut session.is_check_wanted) {
            self.begin_check(session)?;
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

    // --- Picking ---

    /// The nearest point under the cursor, by rays through the triangles as the document leaves them; what is looked through does
    /// not count. The camera's ray there, and how far along it the point is.
    pub fn point_under(&self, session: &Session, cursor: DVec2) -> Option<(Ray, Option<f64>)> {
        let rays = self.drawn_camera?.rays().ok()?;
        let scene = session.document.scene();
        let ray = rays.ray(cursor.x, cursor.y);
        let mut filter = self.filter.clone();
        if let Some(moved) = &self.moved {
            moved.hide_in(scene, &mut filter);
        }
        let opaque = scene.query().exact.closest_through(&ray, &filter, |_| ()).map(|hit| hit.t);
        let moved = self.moved.as_ref().and_then(|moved| moved.closest(&ray)).map(|hit| hit.t);
        let nearest = [opaque, moved].into_iter().flatten().reduce(f64::min);
        let unit = Ray { direction: ray.direction.normalize_or(rays.forward()), ..ray };
        Some((unit, nearest.map(|t| t * ray.direction.length())))
    }

    /// Asks what is at a place of the picture, pixels; the answer comes with one of the next frames.
    pub fn pick(&mut self, session: &Session, cursor: DVec2, purpose: Purpose) {
        let targets = self.walk.renderer().targets();
        let (Some(camera), size) = (self.drawn_camera, targets.size) else { return };
        let inside =
            cursor.x >= 0.0 && cursor.y >= 0.0 && cursor.x < size.0.into() && cursor.y < size.1.into();
        let Ok(rays) = camera.rays() else { return };
        if !inside {
            return;
        }
        let meta = session.document.scene().scene().meta().bounds;
        let (min, max) = (DVec3::from(meta.min), DVec3::from(meta.max));
        let near = rays.brought_near(min, max);
        self.picks.push(Pick {
            purpose,
            cursor,
            camera,
            drawables: targets.drawable.read_later(&self.context),
            depths: targets.depth.read_later(&self.context),
            size,
            view: ViewUniform::new(&near, min, max),
            nearer_by: (near.eye() - rays.eye()).dot(rays.forward()),
        });
    }

    /// Answers of earlier clicks.
    ///
    /// # Errors
    ///
    /// The GPU has failed.
    pub fn answers(&mut self, session: &mut Session) -> Result<(), GpuError> {
        while let Some(pick) = self.picks.first() {
            let Some(drawables) = pick.drawables.take::<u32>(&self.context)? else { return Ok(()) };
            // Both were copied one after the other.
            let depths: Vec<f32> = loop {
                if let Some(depths) = pick.depths.take(&self.context)? {
                    break depths;
                }
                std::thread::yield_now();
            };
            let pick = self.picks.remove(0);
            let Ok(rays) = pick.camera.rays() else { continue };
            let found = self.found(session, &pick, &rays, &drawables, &depths);
            answer(session, &self.filter, &pick, &rays, found);
        }
        Ok(())
    }

    /// What a click found: what is drawn there, or what of glass lies before it.
    fn found(
        &self,
        session: &Session,
        pick: &Pick,
        rays: &CameraRays,
        drawables: &[u32],
        reversed: &[f32],
    ) -> Option<Picked> {
        let view = &pick.view;
        let depth = |reversed: &f32| {
            let near = if view.near > 0.0 { view.near / reversed } else { (1.0 - reversed) * view.far };
            near + pick.nearer_by as f32
        };
        let depths: Vec<f32> = reversed.iter().map(depth).collect();
        let image = PickImage::new(drawables, &depths, pick.size).ok()?;
        let at = UVec2::new(pick.cursor.x as u32, pick.cursor.y as u32);
        let drawn = pick_pixel(&image, at, PICK_RADIUS)
            .and_then(|found| self.refined(session, rays, found.pixel, found.drawable));
        let glass = self.glass_at(session, rays, pick.cursor, drawn.map(|picked| picked.distance));
        glass.or(drawn)
    }

    fn refined(&self, session: &Session, rays: &CameraRays, pixel: UVec2, drawable: u32) -> Option<Picked> {
        let scene = session.document.scene();
        let object = scene.scene().drawable_object(drawable);
        let motion = session.document.state().motions.get(&object).copied();
        let query = QueryScene { filter: &self.filter, ..scene.query() };
        refine(&query, rays, pixel, drawable, motion)
    }

    /// What of glass a ray meets first, nearer than what is drawn, where the file has it. What is looked through is not picked.
    fn glass_at(
        &self,
        session: &Session,
        rays: &CameraRays,
        at: DVec2,
        nearer: Option<f64>,
    ) -> Option<Picked> {
        let scene = session.document.scene();
        let mut filter = self.filter.clone();
        if let Some(moved) = &self.moved {
            moved.hide_in(scene, &mut filter);
        }
        let exact = scene.query().exact;
        let ray = rays.ray(at.x, at.y);
        let mut first: Option<TriangleHit> = None;
        exact.closest_through(&ray, &filter, |hit| {
            let is_nearer = first.is_none_or(|first| hit.t < first.t);
            if !filter.is_seen_through(hit.drawable) && is_nearer {
                first = Some(hit);
            }
        });
        // Along the ray, as distances of what is drawn are: `t` is a depth.
        let distance = |hit: &TriangleHit| hit.t * ray.direction.length();
        let hit = first.filter(|hit| nearer.is_none_or(|nearer| distance(hit) < nearer))?;
        let normal = exact.normal(&hit);
        Some(Picked {
            drawable: hit.drawable,
            triangle: hit.triangle,
            point: ray.at(hit.t),
            normal: if normal.dot(ray.direction) > 0.0 { -normal } else { normal },
            distance: distance(&hit),
            is_confirmed: true,
        })
    }

    // --- The lost-pixel check ---

    fn begin_check(&mut self, session: &mut Session) -> Result<(), WalkError> {
        let Some(camera) = self.drawn_camera else { return Ok(()) };
        if self.moved.is_some() {
            session.tell("the check compares with the file: move parts back first");
            return Ok(());
        }
        let drawables: Vec<u32> = self.walk.renderer().targets().drawable.read(&self.context)?;
        let (scene, filter) = (Arc::clone(session.document.scene()), self.filter.clone());
        let (tell, told) = channel();
        let rays = camera.rays()?;
        let work = move || {
            // Nobody waits any more: the window is closed.
            let _ = tell.send(check(&scene, &filter, &rays, &drawables, &Silent));
        };
        std::thread::Builder::new().name("check".into()).spawn(work)?;
        self.checking = Some(told);
        session.tell("checking against rays through all triangles ...");
        Ok(())
    }

    fn take_check(&mut self) -> Option<String> {
        let found = self.checking.as_ref()?.try_recv();
        match found {
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) | Ok(None) => {
                self.checking = None;
                Some("the check has stopped".to_owned())
            }
            Ok(Some(difference)) => {
                self.checking = None;
                let Difference { pixels, differ, off_silhouettes, lost } = difference;
                let share = 100.0 * differ as f64 / pixels.max(1) as f64;
                Some(format!(
                    "check: {differ} of {pixels} pixels differ ({share:.3} %), {off_silhouettes} of them away from outlines; \
                     {lost} parts of 16 pixels and more are missing"
                ))
            }
        }
    }

    // --- Over the picture ---

    /// Names of what is selected, measurements, and where a frozen picture was seen from.
    pub fn overlay(&self, session: &Session, painter: &Painter, area: Rect) {
        let Some(rays) = self.drawn_camera.and_then(|camera| camera.rays().ok()) else { return };
        let screen = Overlay { rays, area, painter };
        let document = &session.document;
        let scene = document.scene().scene();
        if document.selected().count() <= MOST_LABELS {
            for object in document.selected().iter() {
                if let Some((min, max)) = document.bounds([object]) {
                    let node = scene.objects()[object as usize].node;
                    screen.label(0.5 * (min + max), scene.name(scene.nodes()[node as usize].name));
                }
            }
        }
        let unit = super::measure::LengthUnit::of(&scene.meta().settings);
        for measurement in &session.measuring.done {
            screen.line(measurement.from.point, measurement.to.point, Color32::YELLOW);
            let middle = 0.5 * (measurement.from.point + measurement.to.point);
            screen.label(middle, &unit.show(measurement.distance()));
        }
        if let Some(from) = &session.measuring.from {
            screen.dot(from.point, Color32::YELLOW);
        }
        if let Some(frozen) = self.frozen_camera.and_then(|camera| camera.rays().ok()) {
            screen.frustum(
                &frozen,
                0.2 * (DVec3::from(scene.meta().bounds.max) - DVec3::from(scene.meta().bounds.min)).length(),
            );
        }
    }
}

/// Does what a click was made for.
fn answer(session: &mut Session, filter: &Filter, pick: &Pick, rays: &CameraRays, found: Option<Picked>) {
    match pick.purpose {
        Purpose::Select { add } => session.select_picked(found.map(|picked| picked.drawable), add),
        Purpose::Measure => match &found {
            Some(picked) => session.measure_at(rays, filter, pick.cursor, picked),
            None => session.tell("there is nothing to measure from"),
        },
    }
}

fn limits(session: &Session) -> DensitySettings {
    DensitySettings {
        budget: session.preferences.triangles,
        pixel_error: session.preferences.pixel_error,
        ..DensitySettings::default()
    }
}

/// Draws world positions over the picture.
struct Overlay<'a> {
    rays: CameraRays,
    area: Rect,
    painter: &'a Painter,
}

impl Overlay<'_> {
    /// Where a point is in the window; `None` behind the eye.
    fn place(&self, point: DVec3) -> Option<Pos2> {
        let (width, height) = self.rays.size();
        let (column, row) = self.rays.pixel_steps();
        let away = point - self.rays.eye();
        let depth = if self.rays.is_parallel() { 1.0 } else { away.dot(self.rays.forward()) };
        if depth <= 1e-12 {
            return None;
        }
        let x = away.dot(column) / column.length_squared() / depth + 0.5 * f64::from(width);
        let y = away.dot(row) / row.length_squared() / depth + 0.5 * f64::from(height);
        let scale = vec2(self.area.width() / width as f32, self.area.height() / height as f32);
        Some(self.area.min + vec2(x as f32 * scale.x, y as f32 * scale.y))
    }

    fn label(&self, point: DVec3, text: &str) {
        let Some(place) = self.place(point).filter(|place| self.area.contains(*place)) else { return };
        let (font, white) = (FontId::proportional(13.0), Color32::WHITE);
        let text = self.painter.layout_no_wrap(text.to_owned(), font, white);
        let size = text.size();
        let corner = pos2(place.x + 8.0, place.y - size.y - 8.0);
        let around = Rect::from_min_size(corner, size).expand(3.0);
        self.painter.line_segment([place, around.left_bottom()], Stroke::new(1.0, white));
        self.painter.rect_filled(around, 3.0, Color32::from_black_alpha(180));
        self.painter.galley(corner, text, white);
    }

    fn dot(&self, point: DVec3, colour: Color32) {
        if let Some(place) = self.place(point) {
            self.painter.circle_filled(place, 4.0, colour);
        }
    }

    fn line(&self, from: DVec3, to: DVec3, colour: Color32) {
        if let (Some(a), Some(b)) = (self.place(from), self.place(to)) {
            self.painter.line_segment([a, b], Stroke::new(2.0, colour));
            [a, b].iter().for_each(|&end| {
                self.painter.circle_filled(end, 3.0, colour);
            });
        }
    }

    /// The view pyramid of another camera.
    fn frustum(&self, camera: &CameraRays, reach: f64) {
        let (width, height) = (f64::from(camera.size().0), f64::from(camera.size().1));
        let corners =
            [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)].map(|(x, y)| camera.ray(x, y));
        for (i, corner) in corners.iter().enumerate() {
            self.line(corner.at(1e-3 * reach), corner.at(reach), Color32::LIGHT_BLUE);
            self.line(corner.at(reach), corners[(i + 1) % 4].at(reach), Color32::LIGHT_BLUE);
        }
        let told = self.place(camera.eye());
        if let Some(place) = told {
            let (font, colour) = (FontId::proportional(12.0), Color32::LIGHT_BLUE);
            self.painter.text(place, Align2::LEFT_BOTTOM, "frozen here", font, colour);
        }
    }
}
