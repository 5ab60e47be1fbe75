//! Where the rays of a query come from, batch by batch: the cells of an image, or a list.

use super::sampling::{Part, RayGrid, Tile};
use super::{QueryScene, QuerySettings};
use crate::camera::CameraRays;
use crate::filter::Filter;
use crate::ray::Ray;

/// Batches of neighbouring rays.
pub(super) trait RaySource: Sync {
    /// Batches.
    fn batches(&self) -> usize;
    /// Into how many casts the rays of a batch are divided, at least 1.
    fn steps(&self) -> u32;
    /// Cells of a batch, for a progress bar.
    fn cells(&self, batch: usize) -> u64;
    /// Appends the rays of one step of a batch, cut to what the filter leaves. Returns how many there were.
    fn rays(&self, batch: usize, step: u32, rays: &mut Vec<Ray>) -> u64;
    /// May the steps after this one be spared where all its rays met the same? Then how many rays these are.
    fn rest(&self, batch: usize, step: u32) -> Option<u64>;
}

/// The rays of an image.
pub(super) struct ImageRays<'a> {
    grid: RayGrid,
    tiles: Vec<Tile>,
    filter: &'a Filter,
    settings: QuerySettings,
}

impl<'a> ImageRays<'a> {
    pub fn new(scene: &QueryScene<'a>, camera: &CameraRays, settings: &QuerySettings) -> Self {
        let grid = RayGrid::new(&scene.exact.brought_near(camera), settings.rays_per_pixel, settings.jitter);
        ImageRays { tiles: grid.tiles(), grid, filter: scene.filter, settings: *settings }
    }
}

impl ImageRays<'_> {
    /// A step is a sample; where there is but one, and it may do with less, a quarter of it, and the rest.
    fn is_divided(&self) -> bool {
        self.settings.adaptive && self.settings.rays_per_pixel.samples() == 1
    }

    /// Cells and sample of a step.
    fn step(&self, step: u32) -> (Part, u32) {
        let first = self.settings.first_sample;
        match (self.is_divided(), step) {
            (true, 0) => (Part::Quarter, first),
            (true, _) => (Part::Rest, first),
            (false, _) => (Part::All, first.wrapping_add(step)),
        }
    }
}

impl RaySource for ImageRays<'_> {
    fn batches(&self) -> usize {
        self.tiles.len()
    }

    fn steps(&self) -> u32 {
        if self.is_divided() { 2 } else { self.settings.rays_per_pixel.samples() }
    }

    fn cells(&self, batch: usize) -> u64 {
        self.tiles[batch].cells()
    }

    fn rays(&self, batch: usize, step: u32, rays: &mut Vec<Ray>) -> u64 {
        let (part, sample) = self.step(step);
        let mut cast = 0;
        self.grid.for_each_ray_of(&self.tiles[batch], part, sample, |cell| {
            cast += 1;
            rays.extend(self.filter.clipped(&cell.ray));
        });
        cast
    }

    fn rest(&self, batch: usize, step: u32) -> Option<u64> {
        (self.settings.adaptive && step == 0 && self.steps() > 1).then(|| {
            let tile = &self.tiles[batch];
            (1..self.steps())
                .map(|step| self.step(step))
                .map(|(part, sample)| self.grid.count_rays(tile, part, sample))
                .sum()
        })
    }
}

/// Rays in batches of their own.
pub(super) struct ListedRays<'a> {
    pub rays: &'a [Ray],
    pub per_batch: usize,
    pub filter: &'a Filter,
}

impl RaySource for ListedRays<'_> {
    fn batches(&self) -> usize {
        self.rays.len().div_ceil(self.per_batch)
    }

    fn steps(&self) -> u32 {
        1
    }

    fn cells(&self, batch: usize) -> u64 {
        self.batch(batch).len() as u64
    }

    fn rays(&self, batch: usize, _: u32, rays: &mut Vec<Ray>) -> u64 {
        rays.extend(self.batch(batch).iter().filter_map(|ray| self.filter.clipped(ray)));
        self.cells(batch)
    }

    fn rest(&self, _: usize, _: u32) -> Option<u64> {
        None
    }
}

impl ListedRays<'_> {
    fn batch(&self, batch: usize) -> &[Ray] {
        let start = batch * self.per_batch;
        &self.rays[start..(start + self.per_batch).min(self.rays.len())]
    }
}
