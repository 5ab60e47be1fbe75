//! Where the rays of a query come from, batch by batch: the cells of an image, or a list.

use super::sampling::{RayGrid, Tile};
use super::{QueryScene, QuerySettings};
use crate::camera::CameraRays;
use crate::filter::Filter;
use crate::ray::Ray;

/// Batches of neighbouring rays.
pub(super) trait RaySource: Sync {
    /// Batches.
    fn batches(&self) -> usize;
    /// Samples of each cell.
    fn samples(&self) -> u32;
    /// Cells of a batch, for a progress bar.
    fn cells(&self, batch: usize) -> u64;
    /// Appends the rays of one sample of a batch, cut to what the filter leaves. Returns how many there were.
    fn rays(&self, batch: usize, sample: u32, rays: &mut Vec<Ray>) -> u64;
    /// Does one sample do for a batch that is all one drawable?
    fn is_adaptive(&self) -> bool;
}

/// The rays of an image.
pub(super) struct ImageRays<'a> {
    grid: RayGrid<'a>,
    tiles: Vec<Tile>,
    filter: &'a Filter,
    settings: QuerySettings,
}

impl<'a> ImageRays<'a> {
    pub fn new(scene: &QueryScene<'a>, camera: &'a CameraRays, settings: &QuerySettings) -> Self {
        let grid = RayGrid::new(camera, settings.rays_per_pixel, settings.jitter);
        ImageRays { grid, tiles: grid.tiles(), filter: scene.filter, settings: *settings }
    }
}

impl RaySource for ImageRays<'_> {
    fn batches(&self) -> usize {
        self.tiles.len()
    }

    fn samples(&self) -> u32 {
        self.settings.rays_per_pixel.samples()
    }

    fn cells(&self, batch: usize) -> u64 {
        self.tiles[batch].cells()
    }

    fn rays(&self, batch: usize, sample: u32, rays: &mut Vec<Ray>) -> u64 {
        let mut cast = 0;
        let sample = self.settings.first_sample.wrapping_add(sample);
        self.grid.for_each_ray(&self.tiles[batch], sample, |cell| {
            cast += 1;
            rays.extend(self.filter.clipped(&cell.ray));
        });
        cast
    }

    fn is_adaptive(&self) -> bool {
        self.settings.adaptive
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

    fn samples(&self) -> u32 {
        1
    }

    fn cells(&self, batch: usize) -> u64 {
        self.batch(batch).len() as u64
    }

    fn rays(&self, batch: usize, _: u32, rays: &mut Vec<Ray>) -> u64 {
        rays.extend(self.batch(batch).iter().filter_map(|ray| self.filter.clipped(ray)));
        self.cells(batch)
    }

    fn is_adaptive(&self) -> bool {
        false
    }
}

impl ListedRays<'_> {
    fn batch(&self, batch: usize) -> &[Ray] {
        let start = batch * self.per_batch;
        &self.rays[start..(start + self.per_batch).min(self.rays.len())]
    }
}
