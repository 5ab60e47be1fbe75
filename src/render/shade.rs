//! Light, shadow and colour of a tile of pixels.
//!
//! The rays of one sample of all pixels of a tile go together: first to what the pixels see, then from there to a point of
//! each light. Neighbours meet the same voxels and triangles, so that they are traced as one packet.

use std::time::Instant;

use glam::DVec3;
use voxsight_voxel::raycast::PACKET_RAYS;

use super::film::{FilmPixel, KINDS, LightKind, RayCount, to_f32};
use super::light::{KeyLight, LightSample, Sky, sky_radiance, sky_reflected, sky_sample};
use super::sampling::{Purpose, numbers};
use super::shadow::{ShadowRay, ShadowScratch, ShadowTracer};
use super::{RenderScene, RenderSettings, ShadowCost, Shadows};
use crate::camera::CameraRays;
use crate::model::{Colour, linear_from_srgb};
use crate::ray::Ray;
use crate::visibility::{TileHits, TileTracer};

/// Transparent layers blended along one ray; more are not told apart by the eye.
const MAX_LAYERS: usize = 16;

/// Samples whose rays to the sky are collected before they are cast: the more, the more go about the same way.
const SKY_SAMPLES: u32 = 64;

/// Cells along each axis of the map of directions.
const CELLS: f64 = 16.0;

/// Side of a tile, pixels: one packet of rays.
pub(super) const TILE: u32 = 8;

/// Pixels of a tile: columns and rows of the picture.
#[derive(Clone, Debug)]
pub(super) struct PixelTile {
    pub columns: std::ops::Range<u32>,
    pub rows: std::ops::Range<u32>,
}

impl PixelTile {
    fn pixels(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.rows.clone().flat_map(|row| self.columns.clone().map(move |column| (column, row)))
    }
}

/// Room to work; one for each thread.
#[derive(Default)]
pub(super) struct TileScratch {
    hits: TileHits,
    shadow: ShadowScratch,
    /// Rays that are not clipped away, and the pixel of the tile that each is of.
    rays: Vec<Ray>,
    pixels: Vec<usize>,
    surfaces: Vec<Surface>,
    waiting: Vec<Waiting>,
    /// Of the sky, over several samples.
    waiting_for_sky: Vec<Waiting>,
    rays_to_light: Vec<ShadowRay>,
    pub cost: ShadowCost,
}

/// A seen piece of surface.
struct Surface {
    /// Of the tile.
    pixel: usize,
    /// How much of what it reflects comes through the glass before it.
    share: f64,
    depth: f64,
    drawable: u32,
    point: DVec3,
    /// On the side that is seen.
    normal: DVec3,
    albedo: DVec3,
    /// Towards the eye, length 1.
    to_eye: DVec3,
}

/// Light that waits for its shadow ray.
struct Waiting {
    pixel: usize,
    light: DVec3,
    ray: ShadowRay,
}

pub(super) struct Shader<'a> {
    scene: &'a RenderScene<'a>,
    settings: &'a RenderSettings,
    camera: &'a CameraRays,
    tracer: TileTracer<'a>,
    shadows: ShadowTracer<'a>,
    up: DVec3,
    /// Level, at a right angle to the sun.
    across: DVec3,
    /// sRGB byte to linear.
    linear: Vec<f64>,
}

impl<'a> Shader<'a> {
    pub fn new(scene: &'a RenderScene<'a>, settings: &'a RenderSettings, camera: &'a CameraRays) -> Self {
        let up = settings.up.normalize_or(DVec3::Y);
        let across = match settings.lighting.key {
            KeyLight::Sun(sun) => up.cross(sun.direction).normalize_or_zero(),
            KeyLight::Headlight | KeyLight::None => DVec3::ZERO,
        };
        Shader {
            scene,
            settings,
            camera,
            tracer: TileTracer::new(&scene.query),
            shadows: ShadowTracer::new(&scene.query, settings.shadows),
            up,
            across,
            linear: (0..=255).map(|byte| linear_from_srgb(f64::from(byte) / 255.0)).collect(),
        }
    }

    pub fn samples_per_pixel(&self) -> u32 {
        self.settings.samples_per_pixel
    }

    /// Renders the pixels of a tile, row by row.
    pub fn tile(&self, tile: &PixelTile, scratch: &mut TileScratch) -> Vec<FilmPixel> {
        let places: Vec<(u32, u32)> = tile.pixels().collect();
        let mut sums = vec![DVec3::ZERO; places.len()];
        let mut film = vec![FilmPixel::EMPTY; places.len()];
        // What lies under a pixel is what its middle shows, whatever the samples.
        let samples = self.settings.samples_per_pixel;
        if samples > 1 {
            self.see(&places, None, &mut vec![DVec3::ZERO; places.len()], scratch);
            note_what_is_seen(&scratch.surfaces, &mut film);
        }
        for sample in 0..samples {
            // A single sample goes to the middle itself.
            self.see(&places, (samples > 1).then_some(sample), &mut sums, scratch);
            if samples == 1 {
                note_what_is_seen(&scratch.surfaces, &mut film);
            }
            self.light(&places, sample, &mut sums, &mut film, scratch);
            let is_last = sample + 1 == samples;
            if is_last || (sample + 1).is_multiple_of(SKY_SAMPLES) {
                self.cast_to_sky(&mut sums, &mut film, scratch);
            }
        }
        for (pixel, sum) in film.iter_mut().zip(sums) {
            pixel.colour = to_f32(sum / f64::from(samples));
        }
        film
    }

    fn numbers(&self, (column, row): (u32, u32), sample: u32, purpose: Purpose) -> (f64, f64) {
        numbers(column, row, sample, self.settings.seed, purpose)
    }

    /// Finds what one sample of each pixel sees, or its middle; where that is sky, adds it.
    fn see(&self, places: &[(u32, u32)], sample: Option<u32>, sums: &mut [DVec3], scratch: &mut TileScratch) {
        let TileScratch { rays, pixels, hits, surfaces, .. } = scratch;
        rays.clear();
        pixels.clear();
        surfaces.clear();
        for (pixel, &place) in places.iter().enumerate() {
            let (x, y) = sample.map_or((0.5, 0.5), |sample| self.numbers(place, sample, Purpose::Pixel));
            let ray = self.camera.ray(f64::from(place.0) + x, f64::from(place.1) + y);
            match self.scene.query.filter.clipped(&ray) {
                Some(ray) => {
                    rays.push(ray);
                    pixels.push(pixel);
                }
                None => sums[pixel] += sky_radiance(ray.direction, self.up),
            }
        }
        self.tracer.trace(rays, hits);
        let mut layers: Vec<(f64, u32)> = Vec::new();
        for (number, (ray, &pixel)) in rays.iter().zip(pixels.iter()).enumerate() {
            let opaque = hits.opaque(number);
            let end = opaque.map_or(f64::INFINITY, |(_, t)| t);
            layers.clear();
            layers.extend(
                hits.through()
                    .iter()
                    .filter(|hit| hit.ray == number && hit.t < end)
                    .map(|h| (h.t, h.drawable)),
            );
            layers.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            layers.truncate(MAX_LAYERS);
            let mut left = 1.0;
            for &(t, drawable) in &layers {
                let Colour([.., alpha]) = self.scene.colours[drawable as usize];
                let alpha = f64::from(alpha) / 255.0;
                surfaces.extend(self.surface(ray, drawable, t, left * alpha, pixel));
                left *= 1.0 - alpha;
            }
            match opaque {
                Some((drawable, t)) => surfaces.extend(self.surface(ray, drawable, t, left, pixel)),
                None => sums[pixel] += left * sky_radiance(ray.direction, self.up),
            }
        }
    }

    /// The surface that a ray meets.
    fn surface(&self, ray: &Ray, drawable: u32, t: f64, share: f64, pixel: usize) -> Option<Surface> {
        let hit = self.tracer.triangle(ray, drawable, t);
        debug_assert!(hit.is_some(), "packets and single rays find the same");
        let normal = self.scene.query.exact.normal(&hit?);
        let Colour([r, g, b, _]) = self.scene.colours[drawable as usize];
        Some(Surface {
            pixel,
            share,
            depth: t,
            drawable,
            point: ray.at(t),
            // CAD files are careless about winding: the side that is seen is the outside.
            normal: if normal.dot(ray.direction) > 0.0 { -normal } else { normal },
            albedo: DVec3::from([r, g, b].map(|c| self.linear[usize::from(c)])),
            to_eye: -ray.direction.normalize_or_zero(),
        })
    }

    /// Adds the light that one sample's surfaces reflect.
    fn light(
        &self,
        places: &[(u32, u32)],
        sample: u32,
        sums: &mut [DVec3],
        film: &mut [FilmPixel],
        scratch: &mut TileScratch,
    ) {
        let lighting = &self.settings.lighting;
        for surface in &scratch.surfaces {
            sums[surface.pixel] += surface.share * surface.albedo * self.unshadowed(surface);
        }
        match lighting.key {
            KeyLight::Headlight => return,
            KeyLight::None => {}
            KeyLight::Sun(sun) => self.kind(LightKind::Sun, sums, film, scratch, |surface| {
                let (u, v) = self.numbers(places[surface.pixel], sample, Purpose::Sun);
                sun.sample(surface.normal, u, v)
            }),
        }
        for (number, area) in (0..).zip(&lighting.areas) {
            self.kind(LightKind::Area, sums, film, scratch, |surface| {
                let (u, v) = self.numbers(places[surface.pixel], sample, Purpose::Area(number));
                area.sample(surface.point, surface.normal, u, v)
            });
        }
        if let Sky::Occluded { reach } = lighting.sky {
            let TileScratch { surfaces, waiting_for_sky, .. } = scratch;
            self.collect(surfaces, sums, waiting_for_sky, |surface| {
                let (u, v) = self.numbers(places[surface.pixel], sample, Purpose::Sky);
                Some(sky_sample(surface.normal, reach, self.up, u, v))
            });
        }
    }

    /// Casts the rays to the sky that wait: those that go about the same way together.
    fn cast_to_sky(&self, sums: &mut [DVec3], film: &mut [FilmPixel], scratch: &mut TileScratch) {
        let mut waiting = std::mem::take(&mut scratch.waiting_for_sky);
        waiting.sort_by_cached_key(|waiting| direction_cell(waiting.ray.direction));
        self.cast(LightKind::Sky, &waiting, sums, film, scratch);
        waiting.clear();
        scratch.waiting_for_sky = waiting;
    }

    /// What a white surface reflects of light that casts no shadows.
    fn unshadowed(&self, surface: &Surface) -> DVec3 {
        let normal = surface.normal;
        if self.settings.lighting.key == KeyLight::Headlight {
            return DVec3::splat(0.12 + 0.88 * normal.dot(surface.to_eye).max(0.0));
        }
        // From the side, across the sun: walls at a right angle differ in the shade as well.
        let eye = 0.14 * (-normal.dot(self.camera.forward())).max(0.0);
        let side = 0.10 * normal.dot(self.across).abs();
        let sky = match self.settings.lighting.sky {
            Sky::Plain => sky_reflected(normal, self.up),
            Sky::Occluded { .. } | Sky::None => DVec3::ZERO,
        };
        sky + DVec3::splat(self.settings.lighting.fill * (eye + side))
    }

    /// Adds the light of one kind: a sample of it for each surface, where nothing is in the way.
    fn kind(
        &self,
        kind: LightKind,
        sums: &mut [DVec3],
        film: &mut [FilmPixel],
        scratch: &mut TileScratch,
        sample: impl Fn(&Surface) -> Option<LightSample>,
    ) {
        let mut waiting = std::mem::take(&mut scratch.waiting);
        waiting.clear();
        self.collect(&scratch.surfaces, sums, &mut waiting, sample);
        self.cast(kind, &waiting, sums, film, scratch);
        scratch.waiting = waiting;
    }

    /// A sample of a light for each surface: what has to wait for its shadow ray; without shadows it is added at once.
    fn collect(
        &self,
        surfaces: &[Surface],
        sums: &mut [DVec3],
        waiting: &mut Vec<Waiting>,
        sample: impl Fn(&Surface) -> Option<LightSample>,
    ) {
        for surface in surfaces {
            let Some(light) = sample(surface) else { continue };
            let reflected = surface.share * surface.albedo * light.reflected;
            if self.settings.shadows == Shadows::None {
                sums[surface.pixel] += reflected;
                continue;
            }
            let ray = ShadowRay {
                point: surface.point,
                normal: surface.normal,
                direction: light.direction,
                distance: light.distance,
                lamp: light.lamp,
                spread: light.spread,
            };
            waiting.push(Waiting { pixel: surface.pixel, light: reflected, ray });
        }
    }

    /// Casts shadow rays, and adds the light of those that meet nothing.
    fn cast(
        &self,
        kind: LightKind,
        waiting: &[Waiting],
        sums: &mut [DVec3],
        film: &mut [FilmPixel],
        scratch: &mut TileScratch,
    ) {
        let TileScratch { shadow, rays_to_light, cost, .. } = scratch;
        for packet in waiting.chunks(PACKET_RAYS) {
            let started = Instant::now();
            rays_to_light.clear();
            rays_to_light.extend(packet.iter().map(|waiting| waiting.ray));
            let stopped = self.shadows.stopped(rays_to_light, kind != LightKind::Sky, shadow);
            cost.add(kind, packet.len() as u64, started.elapsed());
            for (ray, Waiting { pixel, light, .. }) in packet.iter().enumerate() {
                let RayCount { cast, free } = &mut film[*pixel].shadow[kind as usize];
                *cast += 1;
                if stopped >> ray & 1 == 0 {
                    *free += 1;
                    sums[*pixel] += *light;
                }
            }
        }
    }
}

/// Number of the cell of a direction on an octahedral map of the sphere (Cigolle et al. 2014); cells with near numbers are near
/// each other, along a Z-order curve.
fn direction_cell(direction: DVec3) -> u32 {
    let d = direction / direction.abs().element_sum();
    let (x, y) = if d.z >= 0.0 {
        (d.x, d.y)
    } else {
        ((1.0 - d.y.abs()) * d.x.signum(), (1.0 - d.x.abs()) * d.y.signum())
    };
    let cell = |c: f64| ((0.5 * c + 0.5) * CELLS).clamp(0.0, CELLS - 1.0) as u32;
    let spread = |c: u32| (0..4).fold(0, |bits, i| bits | (c >> i & 1) << (2 * i));
    spread(cell(x)) | spread(cell(y)) << 1
}

const _: () = assert!(LightKind::ALL.len() == KINDS);

/// Depth, drawable and normal of the nearest surface of each pixel; those of a pixel come front to back.
fn note_what_is_seen(surfaces: &[Surface], film: &mut [FilmPixel]) {
    for surface in surfaces.iter().rev() {
        let pixel = &mut film[surface.pixel];
        pixel.depth = surface.depth as f32;
        pixel.drawable = surface.drawable;
        pixel.normal = to_f32(surface.normal);
    }
}
