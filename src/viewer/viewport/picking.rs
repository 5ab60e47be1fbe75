//! What is under the cursor: asked of the picture, and checked by rays through the triangles.

use std::sync::Arc;

use glam::{DVec2, UVec2};

use super::{Viewport, WalkError};
use crate::camera::{Camera, CameraRays};
use crate::exact::TriangleHit;
use crate::gpu::GpuError;
use crate::gpu::target::TextureRead;
use crate::ray::Ray;
use crate::shown::Shown;
use crate::viewer::pick::{PickImage, Picked, PixelPick, pick_pixel, pick_rectangle, refine};
use crate::viewer::session::Session;
use crate::visibility::QueryScene;

/// How far off a click may be, pixels.
const PICK_RADIUS: u32 = 6;

/// Why a click was made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Purpose {
    /// To select what is there, beside what is selected.
    Select {
        /// Beside what is selected.
        add: bool,
    },
    /// To select it and to bring it into view.
    Zoom,
    /// To measure from there.
    Measure,
    /// To select all that is seen between there and another place of the picture.
    Rectangle {
        /// Pixels.
        to: DVec2,
        /// Beside what is selected.
        add: bool,
    },
}

/// A click whose answer is on its way from the GPU.
pub(super) struct Pick {
    purpose: Purpose,
    cursor: DVec2,
    camera: Camera,
    shown: Arc<Shown>,
    drawables: TextureRead,
    depths: TextureRead,
    size: (u32, u32),
}

impl Viewport {
    /// The nearest point under the cursor, by rays through the triangles where they are shown; what is looked through does not
    /// count. The camera's ray there, and how far along it the point is.
    pub fn point_under(&self, cursor: DVec2) -> Option<(Ray, Option<f64>)> {
        let rays = self.drawn_camera?.rays().ok()?;
        let ray = rays.ray(cursor.x, cursor.y);
        let nearest = self.walk.shown().closest_through(&ray, |_| ());
        let unit = Ray { direction: ray.direction.normalize_or(rays.forward()), ..ray };
        Some((unit, nearest.map(|hit| hit.t * ray.direction.length())))
    }

    /// Asks what is at a place of the picture, pixels; the answer comes with one of the next frames.
    ///
    /// # Errors
    ///
    /// Nothing is drawn yet, or the place is beside the picture.
    pub fn pick(&mut self, cursor: DVec2, purpose: Purpose) -> Result<(), String> {
        let targets = self.walk.renderer().targets();
        let camera = self.drawn_camera.ok_or("nothing is drawn yet")?;
        let (width, height) = targets.size;
        let is_inside =
            cursor.cmpge(DVec2::ZERO).all() && cursor.cmplt(DVec2::new(width.into(), height.into())).all();
        if !is_inside {
            return Err(format!("{cursor} is beside the picture of {width} x {height} pixels"));
        }
        self.picks.push(Pick {
            purpose,
            cursor,
            camera,
            shown: Arc::clone(self.walk.shown()),
            drawables: targets.drawable.read_later(&self.context),
            depths: targets.depth.read_later(&self.context),
            size: targets.size,
        });
        Ok(())
    }

    /// Answers of earlier clicks.
    ///
    /// # Errors
    ///
    /// The GPU has failed.
    pub fn answers(&mut self, session: &mut Session) -> Result<(), WalkError> {
        while let Some(pick) = self.picks.first() {
            let Some(drawables) = pick.drawables.take::<u32>(&self.context)? else { return Ok(()) };
            // Both were copied one after the other.
            let reversed: Vec<f32> = loop {
                if let Some(reversed) = pick.depths.take(&self.context)? {
                    break reversed;
                }
                std::thread::yield_now();
            };
            let pick = self.picks.remove(0);
            let Ok(rays) = pick.camera.rays() else { continue };
            answer(session, &pick, &rays, &drawables, &reversed)?;
        }
        Ok(())
    }
}

/// Does what a click was made for.
fn answer(
    session: &mut Session,
    pick: &Pick,
    rays: &CameraRays,
    drawables: &[u32],
    reversed: &[f32],
) -> Result<(), GpuError> {
    // Only their order counts: reverse-Z falls with the depth.
    let depths: Vec<f32> = reversed.iter().map(|reversed| -reversed).collect();
    let Ok(image) = PickImage::new(drawables, &depths, pick.size) else { return Ok(()) };
    let found = || found(&pick.shown, &image, rays, pick.cursor, PICK_RADIUS);
    match pick.purpose {
        Purpose::Select { add } => session.select_picked(found().map(|picked| picked.drawable), add),
        Purpose::Zoom => {
            let Some(picked) = found() else { return Ok(()) };
            session.select_picked(Some(picked.drawable), false);
            session.act_or_tell(&crate::viewer::action::Action::ZoomToSelection);
        }
        Purpose::Measure => match found() {
            Some(picked) => {
                if let Err(error) = session.measure_at(rays, &pick.shown, pick.cursor, &picked) {
                    session.tell(format!("the point cannot be worked out: {error}"));
                }
            }
            None => session.tell("there is nothing to measure from"),
        },
        Purpose::Rectangle { to, add } => {
            let pixel = |at: DVec2| at.max(DVec2::ZERO).as_uvec2();
            session.select_drawables(&pick_rectangle(&image, pixel(pick.cursor), pixel(to)), add);
        }
    }
    Ok(())
}

/// What a click finds: what is drawn there, or of the finest triangles what lies before it. What is looked through is not picked.
/// `radius` is how many pixels a click may be off.
pub fn found(
    shown: &Shown,
    image: &PickImage,
    rays: &CameraRays,
    cursor: DVec2,
    radius: u32,
) -> Option<Picked> {
    let at = UVec2::new(cursor.x as u32, cursor.y as u32);
    // Where a ray of the finest triangles misses what is drawn: by less than a pixel, or by a coarser level.
    let refined = |found: PixelPick| {
        let query = QueryScene { filter: shown.filter(), ..shown.scene().query() };
        let object = shown.scene().scene().drawable_object(found.drawable);
        refine(&query, rays, found.pixel, found.drawable, shown.motions().get(&object).copied())
    };
    let drawn = match pick_pixel(image, at, radius) {
        // Something thin, or the nearest thing beside the cursor: unless a coarse level stands before what the finest show there.
        Some(found) if found.pixel != at => refined(found).and_then(|picked| {
            let middle = found.pixel.as_dvec2() + 0.5;
            if is_first(shown, rays, &picked) {
                Some(picked)
            } else {
                opaque_at(shown, rays, middle).or(Some(picked))
            }
        }),
        found => opaque_at(shown, rays, cursor).or_else(|| refined(found?)),
    };
    let glass = glass_at(shown, rays, cursor, drawn.map(|picked| picked.distance));
    glass.or(drawn)
}

/// Is nothing else that is opaque before what was picked, where things are shown?
fn is_first(shown: &Shown, rays: &CameraRays, picked: &Picked) -> bool {
    let from_eye = picked.point - rays.eye();
    let towards = if rays.is_parallel() { rays.forward() } else { from_eye.normalize_or(rays.forward()) };
    let ray = Ray { t_max: picked.distance, ..Ray::new(picked.point - picked.distance * towards, towards) };
    shown.closest_through(&ray, |_| ()).is_none_or(|hit| hit.drawable == picked.drawable)
}

/// What of the opaque triangles is first at a place.
fn opaque_at(shown: &Shown, rays: &CameraRays, at: DVec2) -> Option<Picked> {
    let ray = rays.ray(at.x, at.y);
    shown.closest_through(&ray, |_| ()).map(|hit| picked(shown, &ray, &hit))
}

/// What of glass a ray meets first, nearer than what is drawn.
fn glass_at(shown: &Shown, rays: &CameraRays, at: DVec2, nearer: Option<f64>) -> Option<Picked> {
    let ray = rays.ray(at.x, at.y);
    let mut first: Option<TriangleHit> = None;
    let mut through = |hit: TriangleHit| {
        let is_nearer = first.is_none_or(|first| hit.t < first.t);
        if !shown.filter().is_seen_through(hit.drawable) && is_nearer {
            first = Some(hit);
        }
    };
    shown.closest_through(&ray, &mut through);
    let found = picked(shown, &ray, &first?);
    nearer.is_none_or(|nearer| found.distance < nearer).then_some(found)
}

fn picked(shown: &Shown, ray: &Ray, hit: &TriangleHit) -> Picked {
    let normal = shown.normal(hit);
    Picked {
        drawable: hit.drawable,
        triangle: hit.triangle,
        point: ray.at(hit.t),
        normal: if normal.dot(ray.direction) > 0.0 { -normal } else { normal },
        // Along the ray, as distances of what is drawn are: `t` is a depth.
        distance: hit.t * ray.direction.length(),
        is_confirmed: true,
    }
}
