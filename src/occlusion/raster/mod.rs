//! Depth images of triangles: a software rasterizer with SIMD, on all threads.
//!
//! A pixel holds the nearness ([`super::view`]) of the nearest triangle over its centre, both sides of every triangle
//! counting, rounded away from the eye: never nearer than the truth, and farther by at most 2^-11 of it (in parallel
//! projection: by 2^-15 of the scene), as a rule by 2^-20. Which triangles cover a centre is decided as f64 decides it, on every processor and by every path
//! (`setup`); where a clip plane cuts, per pixel. So a depth image is exact at the centres and says
//! nothing about what lies between them.
//!
//! What f64 cannot decide is left to its rounding: an edge function of the image is off by up to about 2^-51 columns x
//! rows, so that a triangle smaller than 2^-25 sqrt(columns x rows) pixels (2^-15 at 1024 x 1024) may cover a centre beside it.
//!
//! # How
//!
//! Sixteen triangles are set up together in f64 (`setup`); those that cover a centre, mostly few, are filled one after
//! the other with f32 edge functions (`fill`); the odd ones are done in f64 (`careful`). Each thread draws into an image of
//! its own, and the images are joined at the end: the maximum does not care about the order, so the answer is
//! the same for any number of threads.

mod careful;
mod fill;
mod image;
pub mod reference;
mod setup;

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;

pub use image::DepthImage;

use super::mesh::{OccluderMesh, TriangleBlock, corners};
use super::view::{PartView, View};
use setup::Batch;

/// Blocks of triangles that a thread takes at a time.
const BLOCKS_AT_A_TIME: usize = 64;

/// Planes through a placed part.
#[derive(Clone, Debug, Default)]
pub(super) struct Cuts {
    /// Height above each plane of a point of the part: m[0] x + m[1] y + m[2] z + m[3].
    pub heights: Vec<[f64; 4]>,
}

/// One mesh to be drawn.
pub(super) struct Drawing<'a> {
    pub mesh: &'a OccluderMesh,
    pub part: PartView,
    /// Planes that may cut it; what is below is not drawn.
    pub cuts: Cuts,
}

/// Border of an image.
#[derive(Clone, Copy)]
struct Screen {
    last_column: f32,
    last_row: f32,
}

impl Screen {
    fn of(image: &DepthImage) -> Self {
        let (width, height) = image.size();
        Screen { last_column: width as f32 - 1.0, last_row: height as f32 - 1.0 }
    }
}

/// The rasterizer: keeps the images of its threads from frame to frame.
#[derive(Debug)]
pub struct Rasterizer {
    level: Level,
    /// Of the threads but the first.
    images: Vec<Mutex<DepthImage>>,
}

impl Default for Rasterizer {
    fn default() -> Self {
        Rasterizer::new(Level::new())
    }
}

impl Rasterizer {
    /// With these instructions; all give the same coverage and the same depths.
    pub fn new(level: Level) -> Self {
        Rasterizer { level, images: Vec::new() }
    }

    /// Adds the drawings to `image`. Uses all threads of the current rayon pool.
    pub(super) fn draw(&mut self, drawings: &[Drawing], image: &mut DepthImage) {
        let pieces: Vec<(&Drawing, &[TriangleBlock])> = drawings
            .iter()
            .flat_map(|drawing| {
                drawing.mesh.blocks.chunks(BLOCKS_AT_A_TIME).map(move |blocks| (drawing, blocks))
            })
            .collect();
        let threads = rayon::current_num_threads().min(pieces.len());
        if threads <= 1 {
            return pieces
                .iter()
                .for_each(|(drawing, blocks)| draw_blocks(self.level, drawing, blocks, image));
        }
        let (width, height) = image.size();
        self.images
            .resize_with(self.images.len().max(threads - 1), || Mutex::new(DepthImage::new(width, height)));
        let next = AtomicUsize::new(0);
        let work = |image: &mut DepthImage| {
            while let Some((drawing, blocks)) = pieces.get(next.fetch_add(1, Ordering::Relaxed)) {
                draw_blocks(self.level, drawing, blocks, image);
            }
        };
        let (images, level_zero) = (&self.images[..threads - 1], Mutex::new(&mut *image));
        (0..threads).into_par_iter().with_max_len(1).for_each(|thread| match thread.checked_sub(1) {
            None => work(&mut level_zero.lock().unwrap_or_else(|poisoned| poisoned.into_inner())),
            Some(other) => {
                let mut image = images[other].lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                image.clear(width, height);
                work(&mut image);
            }
        });
        for other in &mut self.images[..threads - 1] {
            join(image, other.get_mut().unwrap_or_else(|poisoned| poisoned.into_inner()));
        }
    }
}

/// The nearer of both, pixel by pixel.
fn join(image: &mut DepthImage, other: &DepthImage) {
    let (from, to) = other.touched;
    if from >= to {
        return;
    }
    image.touch(from, to - 1);
    let rows = from * image.stride..to * image.stride;
    let band = 32 * image.stride;
    image.texels[rows.clone()].par_chunks_mut(band).zip(other.texels[rows].par_chunks(band)).for_each(
        |(mine, theirs)| mine.iter_mut().zip(theirs).for_each(|(mine, theirs)| *mine = mine.max(*theirs)),
    );
}

/// Draws a mesh on this thread alone, without cuts.
pub(super) fn draw_mesh(level: Level, mesh: &OccluderMesh, part: PartView, image: &mut DepthImage) {
    let drawing = Drawing { mesh, part, cuts: Cuts::default() };
    draw_blocks(level, &drawing, &mesh.blocks, image);
}

fn draw_blocks(level: Level, drawing: &Drawing, blocks: &[TriangleBlock], image: &mut DepthImage) {
    dispatch!(level, simd => {
        if drawing.part.is_parallel {
            draw_with::<_, true>(simd, drawing, blocks, image)
        } else {
            draw_with::<_, false>(simd, drawing, blocks, image)
        }
    });
}

#[inline(always)]
fn draw_with<S: Simd, const PARALLEL: bool>(
    simd: S,
    drawing: &Drawing,
    blocks: &[TriangleBlock],
    image: &mut DepthImage,
) {
    let screen = Screen::of(image);
    let places = fill::Places::new(simd);
    let mut batch = Batch::new();
    let mut heights = Vec::new();
    for block in blocks {
        let mut found = setup::set_up::<S, PARALLEL>(simd, &drawing.part, screen, block, &mut batch);
        if !drawing.cuts.heights.is_empty() {
            found = cut(drawing, block, found);
        }
        while found.fast != 0 {
            let lane = found.fast.trailing_zeros() as usize;
            found.fast &= found.fast - 1;
            fill::fill(simd, places, &batch, lane, image);
        }
        while found.careful != 0 {
            let lane = found.careful.trailing_zeros() as usize;
            found.careful &= found.careful - 1;
            let corners = corners(block, lane);
            heights.clear();
            heights.extend(drawing.cuts.heights.iter().map(|cut| corners.map(|corner| height(cut, corner))));
            careful::draw(simd, corners.map(|c| drawing.part.point(c)), PARALLEL, &heights, screen, image);
        }
    }
}

#[inline(always)]
fn height(cut: &[f64; 4], corner: [f32; 3]) -> f64 {
    let [x, y, z] = corner.map(f64::from);
    cut[0] * x + cut[1] * y + cut[2] * z + cut[3]
}

/// Drops triangles below a plane; those that one cuts through need care.
#[inline(never)]
fn cut(drawing: &Drawing, block: &TriangleBlock, mut found: setup::Found) -> setup::Found {
    for lane in 0..super::mesh::LANES {
        let bit = 1 << lane;
        if (found.fast | found.careful) & bit == 0 {
            continue;
        }
        let corners = corners(block, lane);
        for cut in &drawing.cuts.heights {
            let below = corners.iter().filter(|&&corner| height(cut, corner) < 0.0).count();
            if below == 3 {
                found.fast &= !bit;
                found.careful &= !bit;
            } else if below > 0 && found.fast & bit != 0 {
                found.fast &= !bit;
                found.careful |= bit;
            }
        }
    }
    found
}

/// A view of world-space triangles, for [`draw_triangles`] and the reference.
pub(super) fn identity(view: &View) -> PartView {
    view.of_part(&glam::DAffine3::IDENTITY)
}

/// Adds triangles of world space to an image: the rasterizer without a scene.
pub fn draw_triangles(
    rasterizer: &mut Rasterizer,
    view: &View,
    triangles: &[[[f32; 3]; 3]],
    image: &mut DepthImage,
) {
    let mesh = OccluderMesh::new(triangles);
    let drawing = Drawing { mesh: &mesh, part: identity(view), cuts: Cuts::default() };
    rasterizer.draw(&[drawing], image);
}
