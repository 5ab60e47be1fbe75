//! Light, shadow and colour of a tile of pixels.
//!
//! Rays go in packets: first to what pixels see, then from there to a point of each light. Those of a packet should meet the
//! same voxels and triangles, so that it is of as few pixels as it can be: of one with 64 samples and more, of four with 16.

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

/// Side of a tile, pixels: what a thread does at a time.
pub(super) const TILE: u32 = 8;

const _: () = assert!((TILE * TILE) as usize == PACKET_RAYS, "with one sample a tile is a packet");

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

    /// Its pixels, as numbers, in square blocks of this side on the picture's lattice.
    fn blocks(&self, side: u32) -> Vec<Vec<usize>> {
        let per_row = TILE / side;
        let mut blocks = vec![Vec::new(); (per_row * per_row) as usize];
        for (number, (column, row)) in self.pixels().enumerate() {
            let block = (row % TILE / side) * per_row + column % TILE / side;
            blocks[block as usize].push(number);
        }
        blocks.retain(|block| !block.is_empty());
        blocks
    }
}

/// How many samples of a pixel go in one packet, a power of four.
fn samples_together(samples: u32) -> u32 {
    [64, 16, 4].into_iter().find(|&together| together <= samples).unwrap_or(1)
}

/// Room to work; one for each thread.
#[derive(Default)]
pub(super) struct TileScratch {
    hits: TileHits,
    shadow: ShadowScratch,
    /// What is to be looked at.
    looks: Vec<Look>,
    /// Rays that are not clipped away, and the look that each is of.
    rays: Vec<Ray>,
    looks_of_rays: Vec<Look>,
    surfaces: Vec<Surface>,
    waiting: Vec<Waiting>,
    rays_to_light: Vec<ShadowRay>,
    pub cost: ShadowCost,
}

/// A ray from the eye.
#[derive(Clone, Copy)]
struct Look {
    /// Of the tile.
    pixel: usize,
    /// Column and row of the picture.
    place: (u32, u32),
    /// `None`: through the middle of the pixel.
    sample: Option<u32>,
}

/// A seen piece of surface.
struct Surface {
    look: Look,
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
    camera: CameraRays,
    /// How far its rays start before those of the caller's camera.
    ahead: f64,
    tracer: TileTracer<'a>,
    shadows: ShadowTracer<'a>,
    up: DVec3,
    /// Level, at a right angle to the sun.
    across: DVec3,
    /// sRGB byte to linear.
    linear: Vec<f64>,
}

impl<'a> Shader<'a> {
    pub fn new(scene: &'a RenderScene<'a>, settings: &'a RenderSettings, far: &CameraRays) -> Self {
        let camera = scene.query.exact.brought_near(far);
        let up = settings.up.normalize_or(DVec3::Y);
        let across = match settings.lighting.key {
            KeyLight::Sun(sun) => up.cross(sun.direction).normalize_or_zero(),
            KeyLight::Headlight | KeyLight::None => DVec3::ZERO,
        };
        Shader {
            scene,
            settings,
            camera,
            ahead: (camera.eye() - far.eye()).dot(far.forward()),
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
        // What lies under a pixel is what its middle shows, whatever the samples; a single sample goes there itself.
        let samples = self.settings.samples_per_pixel;
        let middle = |(pixel, &place)| Look { pixel, place, sample: None };
        scratch.looks.clear();
        scratch.looks.extend(places.iter().enumerate().map(middle));
        self.see(&mut sums, scratch);
        note_what_is_seen(&scratch.surfaces, &mut film);
        if samples == 1 {
            self.light(&mut sums, &mut film, scratch);
        } else {
            sums.fill(DVec3::ZERO);
            self.samples(tile, &places, &mut sums, &mut film, scratch);
        }
        for (pixel, sum) in film.iter_mut().zip(sums) {
            pixel.colour = to_f32(sum / f64::from(samples));
        }
        film
    }

    /// Takes several samples of each pixel.
    fn samples(
        &self,
        tile: &PixelTile,
        places: &[(u32, u32)],
        sums: &mut [DVec3],
        film: &mut [FilmPixel],
        scratch: &mut TileScratch,
    ) {
        let samples = self.settings.samples_per_pixel;
        let together = samples_together(samples);
        let blocks = tile.blocks(TILE / together.isqrt());
        // Sums are over the samples of a pixel in an order that does not depend on where a tile was cut.
        for first in (0..samples).step_by(together as usize) {
            let group = first..(first + together).min(samples);
            for block in &blocks {
                let look = |pixel: usize, sample| Look { pixel, place: places[pixel], sample: Some(sample) };
                scratch.looks.clear();
                scratch
                    .looks
                    .extend(block.iter().flat_map(|&pixel| group.clone().map(move |s| look(pixel, s))));
                self.see(sums, scratch);
                self.light(sums, film, scratch);
            }
        }
    }

    /// The two numbers of a look for a purpose; a single sample is the first.
    fn numbers(&self, look: &Look, purpose: Purpose) -> (f64, f64) {
        let (column, row) = look.place;
        numbers(column, row, look.sample.unwrap_or(0), self.settings.seed, purpose)
    }

    /// Finds what the looks meet; where that is sky, adds it.
    fn see(&self, sums: &mut [DVec3], scratch: &mut TileScratch) {
        let TileScratch { looks, rays, looks_of_rays, hits, surfaces, .. } = scratch;
        rays.clear();
        looks_of_rays.clear();
        surfaces.clear();
        for look in looks.iter() {
            let (x, y) = look.sample.map_or((0.5, 0.5), |_| self.numbers(look, Purpose::Pixel));
            let ray = self.camera.ray(f64::from(look.place.0) + x, f64::from(look.place.1) + y);
            match self.scene.query.filter.clipped(&ray) {
                Some(ray) => {
                    rays.push(ray);
                    looks_of_rays.push(*look);
                }
                None => sums[look.pixel] += self.background(ray.direction),
            }
        }
        self.tracer.trace(rays, hits);
        let mut layers: Vec<(f64, u32)> = Vec::new();
        for (number, (ray, look)) in rays.iter().zip(looks_of_rays.iter()).enumerate() {
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
                let alpha = f64::from(self.scene.query.filter.alpha_of(drawable, alpha)) / 255.0;
                surfaces.extend(self.surface(ray, drawable, t, left * alpha, *look));
                left *= 1.0 - alpha;
            }
            match opaque {
                Some((drawable, t)) => surfaces.extend(self.surface(ray, drawable, t, left, *look)),
                None => sums[look.pixel] += left * self.background(ray.direction),
            }
        }
    }

    /// The surface that a ray meets.
    fn surface(&self, ray: &Ray, drawable: u32, t: f64, share: f64, look: Look) -> Option<Surface> {
        let hit = self.tracer.triangle(ray, drawable, t);
        debug_assert!(hit.is_some(), "packets and single rays find the same");
        let normal = self.scene.query.exact.normal(&hit?);
        let Colour([r, g, b, _]) = self.scene.colours[drawable as usize];
        Some(Surface {
            look,
            share,
            depth: self.ahead + t,
            drawable,
            point: ray.at(t),
            // CAD files are careless about winding: the side that is seen is the outside.
            normal: if normal.dot(ray.direction) > 0.0 { -normal } else { normal },
            albedo: DVec3::from([r, g, b].map(|c| self.linear[usize::from(c)])),
            to_eye: -ray.direction.normalize_or_zero(),
        })
    }

    /// Adds the light that the seen surfaces reflect.
    fn light(&self, sums: &mut [DVec3], film: &mut [FilmPixel], scratch: &mut TileScratch) {
        let lighting = &self.settings.lighting;
        for surface in &scratch.surfaces {
            sums[surface.look.pixel] += surface.share * surface.albedo * self.unshadowed(surface);
        }
        match lighting.key {
            KeyLight::Headlight => return,
            KeyLight::None => {}
            KeyLight::Sun(sun) => self.kind(LightKind::Sun, sums, film, scratch, |surface| {
                let (u, v) = self.numbers(&surface.look, Purpose::Sun);
                sun.sample(surface.normal, u, v)
            }),
        }
        for (number, area) in (0..).zip(&lighting.areas) {
            self.kind(LightKind::Area, sums, film, scratch, |surface| {
                let (u, v) = self.numbers(&surface.look, Purpose::Area(number));
                area.sample(surface.point, surface.normal, u, v)
            });
        }
        if let Sky::Occluded { reach } = lighting.sky {
            self.kind(LightKind::Sky, sums, film, scratch, |surface| {
                let (u, v) = self.numbers(&surface.look, Purpose::Sky);
                Some(sky_sample(surface.normal, reach, self.up, u, v))
            });
        }
    }

    /// What is seen where nothing is: the sky, even under a headlight; black where it does not shine.
    fn background(&self, direction: DVec3) -> DVec3 {
        let is_dark =
            self.settings.lighting.sky == Sky::None && self.settings.lighting.key != KeyLight::Headlight;
        if is_dark { DVec3::ZERO } else { sky_radiance(direction, self.up) }
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
                sums[surface.look.pixel] += reflected;
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
            waiting.push(Waiting { pixel: surface.look.pixel, light: reflected, ray });
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
            let stopped = self.shadows.stopped(rays_to_light, kind, shadow);
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

const _: () = assert!(LightKind::ALL.len() == KINDS);

/// Depth, drawable and normal of the nearest surface of each pixel; those of a pixel come front to back.
fn note_what_is_seen(surfaces: &[Surface], film: &mut [FilmPixel]) {
    for surface in surfaces.iter().rev() {
        let pixel = &mut film[surface.look.pixel];
        pixel.depth = surface.depth as f32;
        pixel.drawable = surface.drawable;
        pixel.normal = to_f32(surface.normal);
    }
}
