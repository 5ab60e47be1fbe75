//! The reference: rays against the level-0 triangles, through a two-level hierarchy (obvhs).
//!
//! Boxes are tested in f32 and are widened so that no rounding can lose a triangle; triangles are tested in f64
//! ([`intersect`]). Of several hits at one distance the lowest drawable wins, so that the answer depends neither on
//! the hierarchy nor on the number of threads.

mod chunk_bvh;
pub mod intersect;
mod packet;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DAffine3, DMat3, DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::{Ray as BoxRay, RayHit};
use obvhs::{BvhBuildParams, fast_stack};
use rayon::prelude::*;

pub use chunk_bvh::{ChunkBvh, ChunkMesh};
use fearless_simd::Level;
use intersect::PartRay;
pub use packet::{LANES, TriangleRays};

use crate::camera::CameraRays;
use crate::filter::Filter;
use crate::ray::Ray;

/// Boxes are widened by this fraction of the scene's or chunk's size. f32 positions relative to a box near the ray's
/// origin, and obvhs' replacement of small direction components by 2^-23, are off by less than 2^-21 of it.
const WIDEN: f64 = 1.0 / (1 << 19) as f64;

/// An instance costs two transforms and a clip before its own hierarchy is entered: each gets a box of its own.
const INSTANCES_PER_LEAF: u32 = 1;

/// A placed chunk.
#[derive(Clone, Copy, Debug)]
pub struct Instance {
    /// Which of the chunks.
    pub chunk: u32,
    /// Placement.
    pub world_from_part: DAffine3,
    /// Seen, and seen through.
    pub transparent: bool,
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleHit {
    /// Parameter of the ray.
    pub t: f64,
    /// Index of the instance.
    pub drawable: u32,
    /// Index of the triangle in the chunk, in the order of the hierarchy.
    pub triangle: u32,
}

struct Placed {
    part_from_world: DAffine3,
    chunk: u32,
    transparent: bool,
}

/// Scenes made by this process: what tells one from another.
static SCENES: AtomicU64 = AtomicU64::new(0);

/// All level-0 triangles of a scene, ready for rays.
pub struct ExactScene {
    id: u64,
    chunks: Arc<[ChunkBvh]>,
    instances: Vec<Placed>,
    /// Of the instances, widened, relative to `centre`.
    boxes: Vec<Aabb>,
    /// Over these.
    top: Bvh2,
    centre: DVec3,
    min: DVec3,
    max: DVec3,
    /// Instructions for packets.
    level: Level,
}

impl ExactScene {
    /// Builds the hierarchies: one for each chunk, one over the instances. Transforms must be finite and invertible.
    pub fn new(chunks: Vec<ChunkMesh>, instances: &[Instance]) -> Self {
        let chunks: Vec<ChunkBvh> = chunks.into_par_iter().map(ChunkBvh::new).collect();
        Self::placed(chunks.into(), instances)
    }

    /// A scene of the same chunks, placed otherwise.
    pub fn with_instances(&self, instances: &[Instance]) -> Self {
        Self::placed(Arc::clone(&self.chunks), instances)
    }

    fn placed(chunks: Arc<[ChunkBvh]>, instances: &[Instance]) -> Self {
        let boxes: Vec<(DVec3, DVec3)> = instances
            .par_iter()
            .map(|instance| {
                let (min, max) = chunks[instance.chunk as usize].bounds();
                transformed_box(&instance.world_from_part, min, max)
            })
            .collect();
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (min, max) = boxes.iter().fold(empty, |(min, max), b| (min.min(b.0), max.max(b.1)));
        let (min, max) = if min.x <= max.x { (min, max) } else { (DVec3::ZERO, DVec3::ZERO) };
        let centre = min + 0.5 * (max - min);
        let slack = DVec3::splat((max - min).max_element() * WIDEN);
        let boxes: Vec<Aabb> =
            boxes.iter().map(|(low, high)| widened(*low - centre - slack, *high - centre + slack)).collect();
        let top = build(&boxes, INSTANCES_PER_LEAF);
        let instances = instances
            .iter()
            .map(|instance| Placed {
                part_from_world: instance.world_from_part.inverse(),
                chunk: instance.chunk,
                transparent: instance.transparent,
            })
            .collect();
        ExactScene {
            id: SCENES.fetch_add(1, Ordering::Relaxed),
            chunks,
            instances,
            boxes,
            top,
            centre,
            min: min - slack,
            max: max + slack,
            level: Level::new(),
        }
    }

    /// The nearest opaque hit. `through` is called for each transparent drawable that the ray meets, with its nearest
    /// hit, in no particular order; those behind the answer are to be ignored by the caller.
    pub fn closest_through(
        &self,
        ray: &Ray,
        filter: &Filter,
        mut through: impl FnMut(TriangleHit),
    ) -> Option<TriangleHit> {
        let mut best = None;
        let ray = filter.clipped(ray)?;
        self.visit(&ray, |drawable, t_max| {
            if filter.is_hidden(drawable) {
                return t_max;
            }
            if let Some(hit) = self.closest_of(drawable, &Ray { t_max, ..ray }) {
                if self.is_transparent(drawable) || filter.is_seen_through(drawable) {
                    through(hit);
                } else if is_nearer(&hit, &best) {
                    best = Some(hit);
                }
            }
            best.map_or(ray.t_max, |hit| hit.t)
        });
        best
    }

    /// The nearest hit, transparent or not.
    pub fn closest(&self, ray: &Ray, filter: &Filter) -> Option<TriangleHit> {
        let mut best = None;
        let ray = filter.clipped(ray)?;
        self.visit(&ray, |drawable, t_max| {
            if filter.is_hidden(drawable) {
                return t_max;
            }
            let hit = self.closest_of(drawable, &Ray { t_max, ..ray });
            if let Some(hit) = hit.filter(|hit| is_nearer(hit, &best)) {
                best = Some(hit);
            }
            best.map_or(ray.t_max, |hit| hit.t)
        });
        best
    }

    /// Is there an opaque hit?
    pub fn any(&self, ray: &Ray, filter: &Filter) -> bool {
        let mut found = false;
        let Some(ray) = filter.clipped(ray) else { return false };
        self.visit(&ray, |drawable, _| {
            let is_clear = self.is_transparent(drawable) || filter.is_seen_through(drawable);
            let casts = !is_clear && !filter.is_hidden(drawable);
            if casts && self.meets(drawable, &ray) {
                found = true;
                return f64::NEG_INFINITY;
            }
            ray.t_max
        });
        found
    }

    /// Does a ray meet one drawable anywhere?
    fn meets(&self, drawable: u32, ray: &Ray) -> bool {
        let (part_ray, chunk) = self.in_part(drawable, ray);
        chunk.any(&part_ray, ray.t_min, ray.t_max)
    }

    /// A ray in the space of a drawable's part, and the chunk there.
    fn in_part(&self, drawable: u32, ray: &Ray) -> (PartRay, &ChunkBvh) {
        let placed = &self.instances[drawable as usize];
        let part_ray = PartRay {
            origin: placed.part_from_world.transform_point3(ray.origin),
            direction: placed.part_from_world.transform_vector3(ray.direction),
        };
        (part_ray, &self.chunks[placed.chunk as usize])
    }

    /// The nearest hit with one drawable.
    pub fn closest_of(&self, drawable: u32, ray: &Ray) -> Option<TriangleHit> {
        let (part_ray, chunk) = self.in_part(drawable, ray);
        let (t, triangle) = chunk.closest(&part_ray, ray.t_min, ray.t_max)?;
        Some(TriangleHit { t, drawable, triangle })
    }

    /// Is this drawable seen through?
    pub fn is_transparent(&self, drawable: u32) -> bool {
        self.instances[drawable as usize].transparent
    }

    /// Number of instances.
    pub fn drawable_count(&self) -> u32 {
        self.instances.len() as u32
    }

    /// A number that no other scene of this process has: what was learned about this scene is marked with it.
    pub fn id(&self) -> u64 {
        self.id
    }

    /// World-space box of one drawable, a little wider than its triangles: by 2^-19 of the scene's largest side.
    pub fn drawable_box(&self, drawable: u32) -> (DVec3, DVec3) {
        let Aabb { min, max } = self.boxes[drawable as usize];
        (self.centre + min.as_dvec3(), self.centre + max.as_dvec3())
    }

    /// The same view from an eye that is not far before the scene, see [`CameraRays::brought_near`].
    pub fn brought_near(&self, camera: &CameraRays) -> CameraRays {
        camera.brought_near(self.min, self.max)
    }

    /// Largest side of the scene's box, world units.
    pub fn largest_side(&self) -> f64 {
        (self.max - self.min).max_element()
    }

    /// Triangles of one drawable.
    pub fn triangle_count(&self, drawable: u32) -> u32 {
        self.chunks[self.instances[drawable as usize].chunk as usize].triangle_count()
    }

    /// The chunks: decoded level-0 triangles, part space.
    pub fn chunks(&self) -> &[ChunkBvh] {
        &self.chunks
    }

    /// Which of [`ExactScene::chunks`] a drawable places.
    pub fn chunk_of(&self, drawable: u32) -> u32 {
        self.instances[drawable as usize].chunk
    }

    /// Where a drawable places its chunk: the placement that it was made with, to a few units in the last place.
    pub fn world_from_part(&self, drawable: u32) -> DAffine3 {
        self.instances[drawable as usize].part_from_world.inverse()
    }

    /// World-space normal of a hit's triangle on the side of its winding, length 1; zero for a degenerate triangle.
    pub fn normal(&self, hit: &TriangleHit) -> DVec3 {
        let placed = &self.instances[hit.drawable as usize];
        let [a, b, c] = self.chunks[placed.chunk as usize].triangle(hit.triangle);
        // Normals map by the inverse transpose, up to the sign of the determinant, which mirrors the winding.
        let linear: DMat3 = placed.part_from_world.matrix3;
        let normal = linear.transpose() * (b - a).cross(c - a);
        normal.normalize_or_zero() * linear.determinant().signum()
    }

    /// Calls `test(drawable, t_max)` for the instances whose boxes the ray meets, near ones first by and large; what it
    /// returns becomes the new `t_max`, and negative infinity ends the visit.
    fn visit(&self, ray: &Ray, mut test: impl FnMut(u32, f64) -> f64) {
        let Some(clipped) =
            ClippedRay::new(ray.origin, ray.direction, ray.t_min, ray.t_max, self.min, self.max)
        else {
            return;
        };
        let box_ray = clipped.box_ray(ray, self.centre, ray.t_max);
        let mut t_max = ray.t_max;
        let mut leaf = |node: &obvhs::bvh2::node::Bvh2Node, box_ray: &mut BoxRay, _: &mut RayHit| {
            for slot in node.first_index..node.first_index + node.prim_count {
                let drawable = self.top.primitive_indices[slot as usize];
                t_max = test(drawable, t_max);
                if t_max == f64::NEG_INFINITY {
                    return false;
                }
            }
            box_ray.tmax = clipped.box_t_max(t_max);
            true
        };
        let mut unused = RayHit::none();
        fast_stack!(u32, (96, 192), self.top.max_depth, stack, {
            self.top.ray_traverse_dynamic(&mut stack, box_ray, &mut unused, &mut leaf);
        });
    }
}

fn is_nearer(hit: &TriangleHit, best: &Option<TriangleHit>) -> bool {
    best.as_ref().is_none_or(|best| hit.t < best.t || hit.t == best.t && hit.drawable < best.drawable)
}

/// A ray clipped to a box in f64, from where f32 boxes can be tested without losing digits to a far origin.
pub(crate) struct ClippedRay {
    t_enter: f64,
    scale: f64,
}

impl ClippedRay {
    pub fn new(
        origin: DVec3,
        direction: DVec3,
        t_min: f64,
        t_max: f64,
        min: DVec3,
        max: DVec3,
    ) -> Option<Self> {
        let (mut t_in, mut t_out) = (t_min, t_max);
        for k in 0..3 {
            if direction[k] == 0.0 {
                if origin[k] < min[k] || origin[k] > max[k] {
                    return None;
                }
            } else {
                // One reciprocal: what it rounds off is far below the widening of the box.
                let inverse = direction[k].recip();
                let (a, b) = ((min[k] - origin[k]) * inverse, (max[k] - origin[k]) * inverse);
                t_in = t_in.max(a.min(b));
                t_out = t_out.min(a.max(b));
            }
        }
        let scale = direction.abs().max_element();
        (t_in <= t_out && scale > 0.0).then_some(ClippedRay { t_enter: t_in, scale })
    }

    /// The ray for boxes relative to `centre`, its largest direction component 1, starting at the entry.
    pub fn box_ray(&self, ray: &Ray, centre: DVec3, t_max: f64) -> BoxRay {
        let origin = (ray.at(self.t_enter) - centre).as_vec3a();
        let direction = (ray.direction / self.scale).as_vec3a();
        BoxRay::new(origin, direction, 0.0, self.box_t_max(t_max))
    }

    /// `t_max` in the box ray's parameter, rounded up generously: a box at just this distance is still entered.
    pub fn box_t_max(&self, t_max: f64) -> f32 {
        let t = (t_max - self.t_enter) * self.scale;
        (t * (1.0 + WIDEN) + f64::from(f32::MIN_POSITIVE)) as f32 * (1.0 + 4.0 * f32::EPSILON)
    }
}

fn widened(min: DVec3, max: DVec3) -> Aabb {
    let (low, high) = (min.as_vec3(), max.as_vec3());
    Aabb::new(
        Vec3A::new(low.x.next_down(), low.y.next_down(), low.z.next_down()),
        Vec3A::new(high.x.next_up(), high.y.next_up(), high.z.next_up()),
    )
}

/// Builds a hierarchy with at most so many boxes a leaf.
fn build(boxes: &[Aabb], max_prims_per_leaf: u32) -> Bvh2 {
    let params = BvhBuildParams { max_prims_per_leaf, ..BvhBuildParams::medium_build() };
    build_bvh2(boxes, params, &mut std::time::Duration::default())
}

/// Box of a transformed box.
pub(crate) fn transformed_box(transform: &DAffine3, min: DVec3, max: DVec3) -> (DVec3, DVec3) {
    let centre = transform.transform_point3(min + 0.5 * (max - min));
    let half = 0.5 * (max - min);
    let m = transform.matrix3;
    let reach = m.x_axis.abs() * half.x + m.y_axis.abs() * half.y + m.z_axis.abs() * half.z;
    // A few units in the last place, for the rounding of the sums above.
    let slack = (centre.abs() + reach) * (4.0 * f64::EPSILON);
    (centre - reach - slack, centre + reach + slack)
}
