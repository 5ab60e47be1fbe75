//! Shadow rays: is anything between a surface and a point of a light?
//!
//! # Where they start
//!
//! A ray that starts in its own surface would meet it. Against triangles it starts [`EXACT_HEIGHT`] of the grid's side
//! above the surface, far above what rounding moves a hit, far below any detail worth a shadow. Against voxels: every voxel
//! that touches a plane with normal n (length 1) has all its points within |n.x| + |n.y| + |n.z| voxels of the plane, as far as
//! the corners of a unit cube are apart along n. The overlap test widens a voxel by 1/256 on each side. A ray that starts
//! (|n.x| + |n.y| + |n.z|) (1 + 2/256) voxels above its surface has left all voxels of that plane behind: no acne on flat or
//! convex surfaces, whatever the light's slope. Things lower than that above a surface cast no shadow on it: it leaks there.
//!
//! # `hybrid`
//!
//! Voxels are thicker than what is in them, by up to a voxel on each side. Seen from the receiver a voxel of size s at distance
//! t covers s / t; where that is less than [`Shadows::Hybrid`]'s `tolerance` times the angle across the light, a voxel may decide:
//! it shifts a penumbra by less than this share of its width. Nearer, voxels name the candidates and triangles decide.

use glam::DVec3;
use voxsight_voxel::raycast::{GridRay, Next, PACKET_RAYS, PacketBrick, RayCaster, RayEnds, RayPacket};

use crate::exact::TriangleRays;
use crate::ray::Ray;
use crate::visibility::{Asked, QueryScene};

/// Height above its surface at which a shadow ray against triangles starts, in sides of the grid.
const EXACT_HEIGHT: f64 = 1e-7;

/// How shadow rays are cast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shadows {
    /// Not at all.
    None,
    /// Against the voxels.
    Voxel,
    /// Against the triangles where a voxel could be seen in the penumbra, against the voxels beyond.
    Hybrid {
        /// Share of a penumbra's width by which a voxel may shift it: 0 for triangles only.
        tolerance: f64,
    },
    /// Against the triangles: the reference.
    Exact,
}

impl Shadows {
    /// `hybrid` with an error that is not seen.
    pub const HYBRID: Self = Shadows::Hybrid { tolerance: 1.0 / 16.0 };
}

/// A ray from a surface towards a light.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShadowRay {
    /// Of the surface, world space.
    pub point: DVec3,
    /// Of the surface, on the light's side, length 1.
    pub normal: DVec3,
    /// Towards the light, length 1.
    pub direction: DVec3,
    /// How far away the light is; may be infinite.
    pub distance: f64,
    /// About the angle across the light, radians.
    pub spread: f64,
}

/// Room to work; one for each thread.
#[derive(Default)]
pub(super) struct ShadowScratch {
    packet: RayPacket,
    triangles: TriangleRays,
    asked: Asked,
    grid_rays: Vec<GridRay>,
    /// Rays, and which of the caller's each is.
    rays: Vec<Ray>,
    numbers: Vec<usize>,
}

/// Casts shadow rays in one way.
pub(super) struct ShadowTracer<'a> {
    scene: QueryScene<'a>,
    shadows: Shadows,
    /// Every drawable casts shadows: whose voxel it is does not matter.
    all_cast: bool,
    exact_height: f64,
}

impl<'a> ShadowTracer<'a> {
    pub fn new(scene: &QueryScene<'a>, shadows: Shadows) -> Self {
        let casts = |d| !scene.exact.is_transparent(d) && !scene.filter.is_hidden(d);
        ShadowTracer {
            scene: *scene,
            shadows,
            all_cast: (0..scene.exact.drawable_count()).all(casts),
            exact_height: scene.grid.voxel_size * f64::from(scene.grid.side()) * EXACT_HEIGHT,
        }
    }

    /// Which of up to [`PACKET_RAYS`] rays are stopped, as bits. `coherent`: they go about the same way.
    pub fn stopped(&self, rays: &[ShadowRay], coherent: bool, scratch: &mut ShadowScratch) -> u64 {
        debug_assert!(rays.len() <= PACKET_RAYS);
        match self.shadows {
            Shadows::None => 0,
            Shadows::Voxel => {
                let rays = rays.iter().enumerate();
                self.stopped_by_voxels(
                    rays.filter_map(|(i, ray)| Some((i, self.voxel_ray(ray)?))),
                    coherent,
                    scratch,
                )
            }
            Shadows::Hybrid { tolerance } => self.stopped_by_both(rays, tolerance, coherent, scratch),
            Shadows::Exact => (0..).zip(rays).fold(0, |bits, (i, ray)| {
                bits | u64::from(self.scene.exact.any(&self.exact_ray(ray), self.scene.filter)) << i
            }),
        }
    }

    /// World-space ray for triangles.
    fn exact_ray(&self, ray: &ShadowRay) -> Ray {
        let t_max = ray.distance - self.exact_height;
        Ray { t_max, ..Ray::new(ray.point + ray.normal * self.exact_height, ray.direction) }
    }

    /// The ray for voxels: started above its own, and ended before those of the light. `None` when nothing is left of it.
    fn voxel_ray(&self, ray: &ShadowRay) -> Option<Ray> {
        let size = self.scene.grid.voxel_size;
        let height = ray.normal.abs().element_sum() * (1.0 + 2.0 / 256.0) * size;
        let lamp = ray.direction.abs().element_sum() * size;
        let start = ray.point + ray.normal * height;
        self.scene.filter.clipped(&Ray { t_max: ray.distance - lamp, ..Ray::new(start, ray.direction) })
    }

    fn grid_ray(&self, ray: &Ray) -> GridRay {
        let grid = &self.scene.grid;
        GridRay {
            origin: grid.grid_from_world(ray.origin),
            direction: ray.direction / grid.voxel_size,
            t_min: ray.t_min,
            t_max: ray.t_max,
        }
    }

    /// Casts numbered rays against the voxels. Returns the numbers of those that are stopped, as bits.
    fn stopped_by_voxels(
        &self,
        rays: impl Iterator<Item = (usize, Ray)>,
        coherent: bool,
        scratch: &mut ShadowScratch,
    ) -> u64 {
        let ShadowScratch { packet, grid_rays, numbers, .. } = scratch;
        grid_rays.clear();
        numbers.clear();
        for (number, ray) in rays {
            grid_rays.push(self.grid_ray(&ray));
            numbers.push(number);
        }
        let QueryScene { exact, filter, owners, dag, .. } = self.scene;
        let casts = |owner: u32| !exact.is_transparent(owner) && !filter.is_hidden(owner);
        let mut stopped = 0;
        let caster = RayCaster::new(dag);
        let mut visit = |ray: usize, hit: &voxsight_voxel::raycast::VoxelHit| {
            // Glass casts no shadow: only a voxel with an opaque owner stops the light.
            let opaque = self.all_cast
                || owners.of_brick(hit.brick_ordinal(), hit.brick_mask()).of_voxel(hit.bit()).any(casts);
            if !opaque {
                return Next::Voxel;
            }
            stopped |= 1 << numbers[ray];
            Next::End
        };
        if coherent {
            packet.fill(grid_rays.iter().copied());
            caster.cast_packet(packet, &mut visit);
        } else {
            caster.cast_batch(grid_rays, &mut visit);
        }
        stopped
    }

    /// Voxels where they are fine enough, triangles before.
    fn stopped_by_both(
        &self,
        rays: &[ShadowRay],
        tolerance: f64,
        coherent: bool,
        scratch: &mut ShadowScratch,
    ) -> u64 {
        // From here on voxels decide; never where the light has no size.
        let fine = |ray: &ShadowRay| self.scene.grid.voxel_size / (tolerance * ray.spread);
        // The far part first: it is cheap, and what it stops needs no triangles.
        let far = rays.iter().enumerate().filter_map(|(i, ray)| {
            let whole = self.exact_ray(ray);
            let lamp = ray.direction.abs().element_sum() * self.scene.grid.voxel_size;
            let far = Ray { t_min: fine(ray), t_max: whole.t_max - lamp, ..whole };
            (far.t_min < far.t_max).then(|| self.scene.filter.clipped(&far)).flatten().map(|far| (i, far))
        });
        let stopped = self.stopped_by_voxels(far, coherent, scratch);

        let ShadowScratch { packet, triangles, asked, rays: near, numbers, .. } = scratch;
        near.clear();
        numbers.clear();
        for (i, ray) in rays.iter().enumerate().filter(|(i, _)| stopped >> i & 1 == 0) {
            let whole = self.exact_ray(ray);
            let ray = Ray { t_max: whole.t_max.min(fine(ray)), ..whole };
            if let Some(ray) = self.scene.filter.clipped(&ray) {
                near.push(ray);
                numbers.push(i);
            }
        }
        let met = self.stopped_by_triangles(near, packet, triangles, asked);
        numbers.iter().enumerate().fold(stopped, |bits, (i, &number)| bits | (met >> i & 1) << number)
    }

    /// Which of some rays meet a triangle: voxels name the candidates.
    fn stopped_by_triangles(
        &self,
        rays: &[Ray],
        packet: &mut RayPacket,
        triangles: &mut TriangleRays,
        asked: &mut Asked,
    ) -> u64 {
        let QueryScene { exact, filter, owners, dag, .. } = self.scene;
        let mut waiting = match rays.len() {
            0 => return 0,
            count => u64::MAX >> (PACKET_RAYS - count),
        };
        asked.begin(exact.drawable_count());
        packet.fill(rays.iter().map(|ray| self.grid_ray(ray)));
        triangles.fill(exact, rays);
        let mut ends = [0.0; PACKET_RAYS];
        rays.iter().zip(&mut ends).for_each(|(ray, end)| *end = ray.t_max);
        let mut meet = |brick: &PacketBrick, left: &mut RayEnds| {
            for owner in owners.all_of_brick(brick.ordinal()) {
                if !asked.is_new(owner) || exact.is_transparent(owner) || filter.is_hidden(owner) {
                    continue;
                }
                let mut t = ends;
                let met = exact.closest_of_packet(owner, triangles, waiting, &mut t);
                waiting &= !met;
                for ray in (0..PACKET_RAYS).filter(|ray| met >> ray & 1 != 0) {
                    left.shorten(ray, f64::NEG_INFINITY);
                }
            }
        };
        RayCaster::new(dag).cast_bricks(packet, &mut meet);
        !waiting & (u64::MAX >> (PACKET_RAYS - rays.len()))
    }
}
