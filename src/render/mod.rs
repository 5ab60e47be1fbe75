//! CPU renderer: flat shading under a headlight, or a sun, a sky and shining rectangles, with shadows by voxel or triangle
//! rays; object ids; depth.
//!
//! What pixels see is found as [`crate::visibility::TileTracer`] does, which is what triangles alone give: this is the
//! reference picture that others are compared with. The same settings give the same picture for any number of threads, and
//! rows rendered apart are the rows of the whole.

pub mod file;
mod film;
mod light;
mod sampling;
mod shade;
mod shadow;

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use glam::DVec3;
use image::RgbImage;

pub use film::{Film, FilmPixel, KINDS, LightKind, NOBODY, RayCount, id_colour};
pub use light::{AreaLight, KeyLight, Lighting, SUN_ANGLE_DEG, Sky, Sun};
pub use sampling::MAX_SAMPLES;
#[cfg(feature = "gpu")]
pub(crate) use shadow::HEIGHT;
pub use shadow::Shadows;

use crate::camera::CameraRays;
use crate::model::Colour;
use crate::progress::Progress;
use crate::visibility::QueryScene;
use shade::{PixelTile, Shader, TILE, TileScratch};

/// Version of what is rendered: another one wherever the same settings give other pixels, so that no picture is taken for the
/// same and none is finished with rows of both.
pub const PIXELS_VERSION: u32 = 4;

/// How a picture is made.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderSettings {
    /// Samples per pixel, 1 to [`MAX_SAMPLES`]: each takes one ray from the eye and one to each light.
    pub samples_per_pixel: u32,
    /// Where light comes from.
    pub lighting: Lighting,
    /// How shadow rays are cast.
    pub shadows: Shadows,
    /// The world's up direction, for the sky.
    pub up: DVec3,
    /// Another seed, other samples.
    pub seed: u32,
}

/// Why no picture can be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot render with {0}")]
pub struct SettingsError(String);

/// What shadow rays took, by kind of light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ShadowCost {
    /// Rays.
    pub rays: [u64; KINDS],
    /// Time of all threads together.
    pub time: [Duration; KINDS],
}

impl ShadowCost {
    fn add(&mut self, kind: LightKind, rays: u64, time: Duration) {
        self.rays[kind as usize] += rays;
        self.time[kind as usize] += time;
    }

    /// Both together.
    pub fn merge(&mut self, other: &Self) {
        for kind in LightKind::ALL {
            self.add(kind, other.rays[kind as usize], other.time[kind as usize]);
        }
    }
}

/// What a picture needs of a scene.
#[derive(Clone, Copy)]
pub struct RenderScene<'a> {
    /// Triangles and voxels.
    pub query: QueryScene<'a>,
    /// Colour of each drawable.
    pub colours: &'a [Colour],
}

/// Renders rows of a picture.
pub struct Renderer<'a> {
    shader: Shader<'a>,
    camera: &'a CameraRays,
}

impl RenderSettings {
    /// For depth and ids: one look at the middle of each pixel, and no shadows.
    pub fn middles(up: DVec3) -> Self {
        RenderSettings {
            samples_per_pixel: 1,
            lighting: Lighting::headlight(),
            shadows: Shadows::None,
            up,
            seed: 0,
        }
    }

    /// Can a picture be made with them?
    ///
    /// # Errors
    ///
    /// Samples, angles, lengths or light out of the ranges that they say; a zero direction.
    pub fn check(&self) -> Result<(), SettingsError> {
        self.fault().map_or(Ok(()), |fault| Err(SettingsError(fault)))
    }

    fn fault(&self) -> Option<String> {
        let Lighting { key, sky, areas, fill } = &self.lighting;
        if !(1..=MAX_SAMPLES).contains(&self.samples_per_pixel) {
            return Some(format!(
                "{} samples per pixel; expected 1 to {MAX_SAMPLES}",
                self.samples_per_pixel
            ));
        }
        if let Shadows::Hybrid { tolerance } = self.shadows
            && !(0.0..=1.0).contains(&tolerance)
        {
            return Some(format!("a tolerance of {tolerance}; expected 0 to 1"));
        }
        if let KeyLight::Sun(Sun { direction, angle_deg }) = key
            && !((0.0..180.0).contains(angle_deg) && direction.try_normalize().is_some())
        {
            return Some(format!(
                "a sun towards {direction}, {angle_deg} degrees wide; expected a direction, and 0 to 180 degrees"
            ));
        }
        if let Sky::Occluded { reach } = sky
            && (reach.is_nan() || *reach <= 0.0)
        {
            return Some(format!("a sky occluded within {reach}; expected more than 0"));
        }
        let is_bad = |area: &AreaLight| {
            let across = area.edge_u.cross(area.edge_v);
            !(across.is_finite()
                && across.length() > 0.0
                && area.corner.is_finite()
                && area.radiance.is_finite()
                && area.radiance.min_element() >= 0.0)
        };
        if let Some(area) = areas.iter().find(|area| is_bad(area)) {
            return Some(format!("a rectangle without area, or with endless or negative light: {area:?}"));
        }
        if !(0.0..=1.0).contains(fill) {
            return Some(format!("a fill of {fill}; expected 0 to 1"));
        }
        if self.up.try_normalize().is_none() {
            return Some(format!("up {}; expected a direction", self.up));
        }
        None
    }
}

impl<'a> Renderer<'a> {
    /// For one picture.
    ///
    /// # Panics
    ///
    /// Settings that [`RenderSettings::check`] refuses.
    pub fn new(scene: &'a RenderScene<'a>, camera: &'a CameraRays, settings: &'a RenderSettings) -> Self {
        let fault = settings.fault();
        assert!(fault.is_none(), "cannot render with {}", fault.unwrap_or_default());
        Renderer { shader: Shader::new(scene, settings, camera), camera }
    }

    /// Samples of each pixel.
    pub fn samples_per_pixel(&self) -> u32 {
        self.shader.samples_per_pixel()
    }

    /// Renders some rows of the picture, and what their shadow rays took; `None` when cancelled. Uses all threads of the
    /// current rayon pool.
    pub fn rows(&self, rows: Range<u32>, progress: &dyn Progress) -> Option<(Film, ShadowCost)> {
        let width = self.camera.size().0;
        let tiles = tiles(width, &rows);
        let next = AtomicUsize::new(0);
        let parts = rayon::broadcast(|_| {
            let mut scratch = TileScratch::default();
            let mut done: Vec<(usize, Vec<FilmPixel>)> = Vec::new();
            loop {
                let index = next.fetch_add(1, Ordering::Relaxed);
                let Some(tile) = tiles.get(index) else { return Some((done, scratch.cost)) };
                if progress.is_cancelled() {
                    return None;
                }
                let pixels = self.shader.tile(tile, &mut scratch);
                progress.advance(pixels.len() as u64);
                done.push((index, pixels));
            }
        });
        let height = rows.end.saturating_sub(rows.start);
        let mut pixels = vec![FilmPixel::EMPTY; width as usize * height as usize];
        let mut cost = ShadowCost::default();
        for part in parts {
            let (done, part_cost) = part?;
            cost.merge(&part_cost);
            for (index, tile_pixels) in done {
                let tile = &tiles[index];
                let lines = tile_pixels.chunks(tile.columns.len());
                for (row, line) in tile.rows.clone().zip(lines) {
                    let start = (row - rows.start) as usize * width as usize + tile.columns.start as usize;
                    pixels[start..start + line.len()].copy_from_slice(line);
                }
            }
        }
        Some((Film { width, rows, pixels }, cost))
    }
}

/// The tiles of some rows, row by row; on the same lattice whatever the rows.
fn tiles(width: u32, rows: &Range<u32>) -> Vec<PixelTile> {
    let spans = |from: u32, to: u32| {
        (from / TILE..to.div_ceil(TILE)).map(move |i| (i * TILE).max(from)..((i + 1) * TILE).min(to))
    };
    spans(rows.start, rows.end)
        .flat_map(|rows| spans(0, width).map(move |columns| PixelTile { columns, rows: rows.clone() }))
        .collect()
}

/// Renders a picture for screens; `None` when cancelled.
pub fn render(
    scene: &RenderScene,
    camera: &CameraRays,
    settings: &RenderSettings,
    progress: &dyn Progress,
) -> Option<RgbImage> {
    let (film, _) = Renderer::new(scene, camera, settings).rows(0..camera.size().1, progress)?;
    Some(film.to_rgb8())
}
