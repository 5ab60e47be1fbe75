//! CPU renderer: flat shading with a headlight or a sun, hard shadows by voxel or triangle rays; object ids; depth.
//!
//! Primary rays go to the triangles ([`crate::exact`]): this is the reference picture that others are compared with.
//! The same settings give the same image for any number of threads.

mod shade;

use glam::DVec3;
use image::{ImageBuffer, Luma, Rgb, RgbImage};
use rayon::prelude::*;

pub use shade::{Light, Shadows};

use crate::camera::CameraRays;
use crate::exact::TriangleHit;
use crate::model::Colour;
use crate::progress::Progress;
use crate::ray::Ray;
use crate::visibility::{QueryScene, sample_offset};

/// Rows rendered by one task.
const ROWS_PER_TASK: u32 = 4;

/// How a picture is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderSettings {
    /// Samples per pixel, at least 1.
    pub samples_per_pixel: u32,
    /// Where the light comes from.
    pub light: Light,
    /// How shadow rays are cast; only a sun casts shadows.
    pub shadows: Shadows,
    /// The world's up direction, for the sky's light.
    pub up: DVec3,
}

/// What a picture needs of a scene.
#[derive(Clone, Copy)]
pub struct RenderScene<'a> {
    /// Triangles and voxels.
    pub query: QueryScene<'a>,
    /// Colour of each drawable.
    pub colours: &'a [Colour],
}

/// A depth image and its range.
pub struct DepthImage {
    /// 0: nothing there; 1 to 65,535: depth along the view from `near` to `far`, linear.
    pub image: ImageBuffer<Luma<u16>, Vec<u16>>,
    /// Least depth of the picture, model units.
    pub near: f64,
    /// Greatest depth.
    pub far: f64,
}

/// Renders a shaded picture; `None` when cancelled.
pub fn render(
    scene: &RenderScene,
    camera: &CameraRays,
    settings: &RenderSettings,
    progress: &dyn Progress,
) -> Option<RgbImage> {
    let shader = shade::Shader::new(scene, settings, camera);
    pixels(camera, progress, |column, row| {
        let mut sum = DVec3::ZERO;
        for sample in 0..settings.samples_per_pixel {
            let (x, y) = sample_offset(sample);
            let ray = camera.ray(f64::from(column) + x, f64::from(row) + y);
            sum += shader.radiance(&ray);
        }
        Rgb(shade::encode(sum / f64::from(settings.samples_per_pixel)))
    })
    .map(|pixels| assemble(camera, pixels))
}

/// Renders object ids as colours, one sample in the middle of each pixel: 24 bits, red lowest, of
/// `(id + 1) * 0x9E3779 mod 2^24` (invertible, and neighbours differ to the eye); black where nothing is. Transparent
/// objects count as opaque here: the picture shows what a click would pick.
pub fn render_ids(
    scene: &RenderScene,
    camera: &CameraRays,
    object_of: impl Fn(u32) -> u32 + Sync,
    progress: &dyn Progress,
) -> Option<RgbImage> {
    pixels(camera, progress, |column, row| match middle_hit(scene, camera, column, row) {
        Some(hit) => Rgb(id_colour(object_of(hit.drawable))),
        None => Rgb([0; 3]),
    })
    .map(|pixels| assemble(camera, pixels))
}

/// The colour of an object id in [`render_ids`].
pub fn id_colour(object: u32) -> [u8; 3] {
    let [r, g, b, _] = object.wrapping_add(1).wrapping_mul(0x9e_3779).to_le_bytes();
    [r, g, b]
}

/// Renders depth, one sample in the middle of each pixel, scaled to the range of the picture.
pub fn render_depth(scene: &RenderScene, camera: &CameraRays, progress: &dyn Progress) -> Option<DepthImage> {
    let depths =
        pixels(camera, progress, |column, row| middle_hit(scene, camera, column, row).map(|hit| hit.t))?;
    let found = depths.iter().flatten();
    let (near, far) = found.fold((f64::INFINITY, 0.0f64), |(near, far), &t| (near.min(t), far.max(t)));
    let near = if near.is_finite() { near } else { 0.0 };
    let span = (far - near).max(f64::MIN_POSITIVE);
    let grey = |t: f64| 1 + ((t - near) / span * 65_534.0).round() as u16;
    let (width, height) = camera.size();
    let image = ImageBuffer::from_fn(width, height, |x, y| {
        Luma([depths[y as usize * width as usize + x as usize].map_or(0, grey)])
    });
    Some(DepthImage { image, near, far })
}

fn middle_hit(scene: &RenderScene, camera: &CameraRays, column: u32, row: u32) -> Option<TriangleHit> {
    let ray: Ray = camera.ray(f64::from(column) + 0.5, f64::from(row) + 0.5);
    scene.query.exact.closest(&ray, scene.query.filter)
}

/// Computes all pixels, rows in parallel; `None` when cancelled before the last rows are begun.
fn pixels<T: Send>(
    camera: &CameraRays,
    progress: &dyn Progress,
    pixel: impl Fn(u32, u32) -> T + Sync,
) -> Option<Vec<T>> {
    let (width, height) = camera.size();
    let tasks: Option<Vec<Vec<T>>> = (0..height.div_ceil(ROWS_PER_TASK))
        .into_par_iter()
        .map(|task| {
            if progress.is_cancelled() {
                return None;
            }
            let rows = task * ROWS_PER_TASK..((task + 1) * ROWS_PER_TASK).min(height);
            let count = u64::from(rows.end - rows.start) * u64::from(width);
            let pixels = rows.flat_map(|row| (0..width).map(move |column| (column, row)));
            let pixels = pixels.map(|(column, row)| pixel(column, row)).collect();
            progress.advance(count);
            Some(pixels)
        })
        .collect();
    tasks.map(|tasks| tasks.into_iter().flatten().collect())
}

fn assemble(camera: &CameraRays, pixels: Vec<Rgb<u8>>) -> RgbImage {
    let (width, height) = camera.size();
    RgbImage::from_fn(width, height, |x, y| pixels[y as usize * width as usize + x as usize])
}
