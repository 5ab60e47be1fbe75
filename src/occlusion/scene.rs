//! What both methods keep of a scene: triangles in the rasterizer's form, and a box for each drawable.

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use super::boxes::{OrientedBox, Sight};
use super::mesh::OccluderMesh;
use super::raster::{Cuts, DepthImage, Drawing, Rasterizer};
use super::view::View;
use crate::camera::CameraRays;
use crate::exact::ExactScene;
use crate::filter::Filter;

/// Where a plane cuts a drawable, so many units in the last place of the largest coordinate are cut off besides: a ray that
/// starts or ends at the plane, as rounding has it, may miss a face that lies in it.
const CUT_ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Drawables that a thread looks at at a time.
const AT_A_TIME: usize = 256;

/// A scene made ready for occlusion culling. Takes 36 bytes for each level-0 triangle of a chunk and 200 for each drawable.
#[derive(Clone, Debug)]
pub struct OcclusionScene {
    /// One for each chunk.
    meshes: Vec<OccluderMesh>,
    drawables: Vec<Placed>,
    boxes: Vec<OrientedBox>,
    centre: DVec3,
    radius: f64,
}

#[derive(Clone, Copy, Debug)]
struct Placed {
    world_from_part: DAffine3,
    chunk: u32,
    transparent: bool,
}

impl OcclusionScene {
    /// From the level-0 triangles.
    pub fn new(exact: &ExactScene) -> Self {
        let meshes = exact.chunks().par_iter().map(OccluderMesh::of_chunk).collect();
        let drawables: Vec<Placed> = (0..exact.drawable_count())
            .map(|drawable| Placed {
                world_from_part: exact.world_from_part(drawable),
                chunk: exact.chunk_of(drawable),
                transparent: exact.is_transparent(drawable),
            })
            .collect();
        let of = |placed: &Placed| {
            let (min, max) = exact.chunks()[placed.chunk as usize].bounds();
            OrientedBox::placed(&placed.world_from_part, min, max)
        };
        let boxes: Vec<OrientedBox> = drawables.par_iter().map(of).collect();
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (min, max) = boxes.iter().fold(empty, |(min, max), b| {
            (min.min(b.centre - b.aligned_half()), max.max(b.centre + b.aligned_half()))
        });
        let (min, max) = if min.x <= max.x { (min, max) } else { (DVec3::ZERO, DVec3::ZERO) };
        OcclusionScene {
            meshes,
            drawables,
            boxes,
            centre: min + 0.5 * (max - min),
            radius: 0.5 * (max - min).length(),
        }
    }

    /// The camera as the depth images see it.
    pub fn view(&self, camera: &CameraRays) -> View {
        View::new(camera, self.centre, self.radius)
    }

    /// Boxes of the drawables, world space.
    pub fn boxes(&self) -> &[OrientedBox] {
        &self.boxes
    }

    /// Triangles of the chunks.
    pub fn meshes(&self) -> &[OccluderMesh] {
        &self.meshes
    }

    /// Which of the chunks a drawable places.
    pub fn chunk_of(&self, drawable: u32) -> u32 {
        self.drawables[drawable as usize].chunk
    }

    /// Level-0 triangles of a drawable.
    pub fn triangle_count(&self, drawable: u32) -> u32 {
        self.meshes[self.chunk_of(drawable) as usize].triangle_count()
    }

    /// May it hide others? What is seen through does not.
    pub fn occludes(&self, drawable: u32) -> bool {
        !self.drawables[drawable as usize].transparent
    }

    /// Half the diagonal of the scene's box.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Where each drawable is in the view; those that the filter leaves out are outside.
    pub fn sights(&self, view: &View, filter: &Filter, sights: &mut Vec<Sight>) {
        sights.resize(self.boxes.len(), Sight::Outside);
        let of = |(drawable, (sight, placed)): (usize, (&mut Sight, &OrientedBox))| {
            let is_there = !filter.is_hidden(drawable as u32)
                && filter.clip_planes().iter().all(|plane| placed.heights(plane).1 >= 0.0);
            *sight = if is_there { placed.seen(view) } else { Sight::Outside };
        };
        sights.par_iter_mut().zip(&self.boxes).with_min_len(AT_A_TIME).enumerate().for_each(of);
    }

    /// Adds drawables to a depth image: what the filter leaves of them. Those that do not occlude are passed over.
    pub fn draw(
        &self,
        rasterizer: &mut Rasterizer,
        drawables: impl IntoIterator<Item = u32>,
        view: &View,
        filter: &Filter,
        image: &mut DepthImage,
    ) {
        let drawings: Vec<Drawing> = drawables
            .into_iter()
            .filter(|&drawable| {
                self.occludes(drawable) && !filter.is_hidden(drawable) && !filter.is_seen_through(drawable)
            })
            .filter_map(|drawable| self.drawing(drawable, view, filter))
            .collect();
        rasterizer.draw(&drawings, image);
    }

    /// A drawable for the rasterizer, cut by the clip planes; `None` when nothing of it is left.
    fn drawing(&self, drawable: u32, view: &View, filter: &Filter) -> Option<Drawing<'_>> {
        let placed = &self.drawables[drawable as usize];
        let around = &self.boxes[drawable as usize];
        let mut cuts = Cuts::default();
        // Perspective needs no plane at the eye, see `raster::setup`.
        let eye_plane = view.is_parallel().then(|| view.eye_plane());
        let farthest = around.centre.length() + around.aligned_half().length() + view.eye().length();
        for plane in filter.clip_planes().iter().chain(&eye_plane) {
            let rounding = CUT_ROUNDING * plane.normal.length() * (farthest + plane.point.length());
            let (lowest, highest) = around.heights(plane);
            if highest < rounding {
                return None;
            }
            if lowest < rounding {
                let axes = placed.world_from_part.matrix3;
                let [x, y, z] = [axes.x_axis, axes.y_axis, axes.z_axis].map(|axis| plane.normal.dot(axis));
                let at_origin = plane.normal.dot(placed.world_from_part.translation - plane.point);
                cuts.heights.push([x, y, z, at_origin - rounding]);
            }
        }
        let part = view.of_part(&placed.world_from_part);
        Some(Drawing { mesh: &self.meshes[placed.chunk as usize], part, cuts })
    }
}
