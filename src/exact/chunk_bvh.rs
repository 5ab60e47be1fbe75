//! One chunk's triangles and their hierarchy, in part space.

use glam::{DVec3, Vec3};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::fast_stack;
use obvhs::ray::{Ray as BoxRay, RayHit};

use super::intersect::{PartRay, intersect};
use super::{ClippedRay, WIDEN, build, widened};
use crate::ray::Ray;

/// Triangles are tested in f64: smaller leaves than a hierarchy of f32 triangles would have.
const TRIANGLES_PER_LEAF: u32 = 3;

/// Decoded level-0 triangles of a chunk, part space.
#[derive(Clone, Debug, Default)]
pub struct ChunkMesh {
    /// Decoded positions.
    pub positions: Vec<Vec3>,
    /// Corners; every index is below `positions.len()`.
    pub triangles: Vec<[u32; 3]>,
}

/// A chunk ready for rays.
pub struct ChunkBvh {
    /// Corners, in the order of the hierarchy's leaves: a leaf reads one run of memory.
    triangles: Vec<[Vec3; 3]>,
    pub(super) bvh: Bvh2,
    /// Boxes of the hierarchy are relative to it.
    pub(super) centre: DVec3,
    pub(super) min: DVec3,
    pub(super) max: DVec3,
}

impl ChunkBvh {
    pub(super) fn new(mesh: ChunkMesh) -> Self {
        let corners = |t: &[u32; 3]| t.map(|corner| mesh.positions[corner as usize].as_dvec3());
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (min, max) =
            mesh.triangles.iter().flat_map(corners).fold(empty, |(l, h), p| (l.min(p), h.max(p)));
        let (min, max) = if min.x <= max.x { (min, max) } else { (DVec3::ZERO, DVec3::ZERO) };
        let centre = min + 0.5 * (max - min);
        let slack = DVec3::splat((max - min).max_element() * WIDEN);
        let boxes: Vec<Aabb> = mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = corners(t);
                widened(a.min(b).min(c) - centre - slack, a.max(b).max(c) - centre + slack)
            })
            .collect();
        let mut bvh = build(&boxes, TRIANGLES_PER_LEAF);
        let in_order = |&i: &u32| mesh.triangles[i as usize].map(|corner| mesh.positions[corner as usize]);
        let triangles = bvh.primitive_indices.iter().map(in_order).collect();
        bvh.primitive_indices = Vec::new();
        ChunkBvh { triangles, bvh, centre, min: min - slack, max: max + slack }
    }

    /// Low and high corner, part space, a little widened.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        (self.min, self.max)
    }

    /// Triangles.
    pub fn triangle_count(&self) -> u32 {
        self.triangles.len() as u32
    }

    /// Corners of a triangle, part space.
    #[inline]
    pub fn triangle(&self, index: u32) -> [DVec3; 3] {
        self.triangles[index as usize].map(|corner| corner.as_dvec3())
    }

    /// The nearest hit between `t_min` and `t_max`, both included: its parameter and triangle. Of several at one
    /// distance the one that comes first in the hierarchy's order.
    pub(super) fn closest(&self, ray: &PartRay, t_min: f64, t_max: f64) -> Option<(f64, u32)> {
        let clipped = ClippedRay::new(ray.origin, ray.direction, t_min, t_max, self.min, self.max)?;
        let world_like = Ray { origin: ray.origin, direction: ray.direction, t_min, t_max };
        let box_ray = clipped.box_ray(&world_like, self.centre, t_max);
        let mut best: Option<(f64, u32)> = None;
        let mut leaf = |node: &obvhs::bvh2::node::Bvh2Node, box_ray: &mut BoxRay, _: &mut RayHit| {
            for triangle in node.first_index..node.first_index + node.prim_count {
                let Some(t) = intersect(ray, self.triangle(triangle)) else { continue };
                let nearer = best.is_none_or(|(best_t, at)| t < best_t || t == best_t && triangle < at);
                if t >= t_min && t <= t_max && nearer {
                    best = Some((t, triangle));
                    box_ray.tmax = clipped.box_t_max(t);
                }
            }
            true
        };
        let mut unused = RayHit::none();
        fast_stack!(u32, (96, 192), self.bvh.max_depth, stack, {
            self.bvh.ray_traverse_dynamic(&mut stack, box_ray, &mut unused, &mut leaf);
        });
        best
    }

    /// Is there a hit between `t_min` and `t_max`, both included?
    pub(super) fn any(&self, ray: &PartRay, t_min: f64, t_max: f64) -> bool {
        let Some(clipped) = ClippedRay::new(ray.origin, ray.direction, t_min, t_max, self.min, self.max)
        else {
            return false;
        };
        let world_like = Ray { origin: ray.origin, direction: ray.direction, t_min, t_max };
        let box_ray = clipped.box_ray(&world_like, self.centre, t_max);
        let mut found = false;
        let mut leaf = |node: &obvhs::bvh2::node::Bvh2Node, _: &mut BoxRay, _: &mut RayHit| {
            found = (node.first_index..node.first_index + node.prim_count).any(|triangle| {
                intersect(ray, self.triangle(triangle)).is_some_and(|t| t >= t_min && t <= t_max)
            });
            !found
        };
        let mut unused = RayHit::none();
        fast_stack!(u32, (96, 192), self.bvh.max_depth, stack, {
            self.bvh.ray_traverse_dynamic(&mut stack, box_ray, &mut unused, &mut leaf);
        });
        found
    }
}
