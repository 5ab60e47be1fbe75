//! obvhs over all level-0 triangles, placed: what the voxels are compared with.

use std::time::Duration;

use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use rayon::prelude::*;
use voxsight::scene::Scene;
use voxsight_voxel::dag::DagRef;
use voxsight_voxel::raycast::GridRay;

use super::views::Pinhole;

/// Both hierarchies; triangles in the order of their leaves, world units relative to the grid's corner.
pub struct Rivals {
    cwbvh: (CwBvh, Vec<Triangle>),
    bvh2: (Bvh2, Vec<Triangle>),
}

impl Rivals {
    pub fn build(scene: &Scene) -> Self {
        let origin = scene.grid().origin;
        let chunks: Vec<(Vec<glam::Vec3>, Vec<[u32; 3]>)> = scene
            .chunks()
            .par_iter()
            .map(|chunk| {
                let mesh = scene.level_mesh(chunk.first_level).unwrap();
                (scene.level_positions(chunk.first_level, &mesh), mesh.triangles)
            })
            .collect();
        let mut triangles = Vec::new();
        for drawable in scene.drawables() {
            let place = scene.world_from_part(drawable.object);
            let (positions, corners) = &chunks[drawable.chunk as usize];
            let at = |corner: u32| -> Vec3A {
                (place.transform_point3(positions[corner as usize].as_dvec3()) - origin).as_vec3a()
            };
            triangles.extend(corners.iter().map(|&[a, b, c]| Triangle { v0: at(a), v1: at(b), v2: at(c) }));
        }
        let in_order =
            |indices: &[u32]| indices.iter().map(|&i| triangles[i as usize]).collect::<Vec<Triangle>>();
        let cwbvh =
            build_cwbvh_from_tris(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
        let bvh2 = build_bvh2_from_tris(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
        let (for_cwbvh, for_bvh2) = (in_order(&cwbvh.primitive_indices), in_order(&bvh2.primitive_indices));
        Rivals { cwbvh: (cwbvh, for_cwbvh), bvh2: (bvh2, for_bvh2) }
    }

    /// Both hierarchies find the same distance for every pixel, and a triangle only where there is a voxel.
    pub fn check(&self, scene: &Scene, camera: &Pinhole, dag: &DagRef) {
        let eye = (camera.eye - scene.grid().origin).as_vec3a();
        let different: u64 = camera
            .tiles()
            .into_par_iter()
            .map(|tile| {
                let mut different = 0;
                for (direction, grid_ray) in camera.directions(tile).zip(camera.grid_rays(tile)) {
                    let ray = || Ray::new(eye, direction.as_vec3a(), 0.0, f32::INFINITY);
                    let (mut wide, mut binary) = (RayHit::none(), RayHit::none());
                    self.cwbvh.0.ray_traverse(ray(), &mut wide, |ray, id| self.cwbvh.1[id].intersect(ray));
                    self.bvh2.0.ray_traverse(ray(), &mut binary, |ray, id| self.bvh2.1[id].intersect(ray));
                    let is_same = wide.t == binary.t || (wide.t - binary.t).abs() <= 1e-5 * binary.t;
                    let has_voxel = wide.t == f32::INFINITY || dag.any_hit(&grid_ray);
                    different += u64::from(!is_same || !has_voxel);
                }
                different
            })
            .sum();
        // f32 rays that graze an edge may pass it on either side.
        assert!(different * 10_000 <= camera.pixels() as u64, "obvhs differs at {different} pixels");
    }

    /// Closest hits of all pixels by CWBVH; a checksum.
    pub fn cwbvh(&self, scene: &Scene, camera: &Pinhole) -> u64 {
        let (bvh, triangles) = &self.cwbvh;
        each_tile(scene, camera, |ray| {
            let mut hit = RayHit::none();
            bvh.ray_traverse(ray, &mut hit, |ray, id| triangles[id].intersect(ray));
            u64::from(hit.primitive_id)
        })
    }

    /// How many rays of grid space hit anything, by CWBVH.
    pub fn cwbvh_any(&self, scene: &Scene, rays: &[GridRay]) -> u64 {
        let (bvh, triangles) = &self.cwbvh;
        let size = scene.grid().voxel_size;
        let is_hit = |ray: &&GridRay| {
            let (origin, direction) = ((ray.origin * size).as_vec3a(), (ray.direction * size).as_vec3a());
            let ray = Ray::new(origin, direction, 0.0, f32::INFINITY);
            !bvh.ray_traverse_miss(ray, |ray, id| triangles[id].intersect(ray))
        };
        rays.iter().filter(is_hit).count() as u64
    }

    /// The same by BVH2.
    pub fn bvh2(&self, scene: &Scene, camera: &Pinhole) -> u64 {
        let (bvh, triangles) = &self.bvh2;
        each_tile(scene, camera, |ray| {
            let mut hit = RayHit::none();
            bvh.ray_traverse(ray, &mut hit, |ray, id| triangles[id].intersect(ray));
            u64::from(hit.primitive_id)
        })
    }
}

fn each_tile(scene: &Scene, camera: &Pinhole, trace: impl Fn(Ray) -> u64 + Sync) -> u64 {
    let eye: DVec3 = camera.eye - scene.grid().origin;
    let tile_sum = |tile| {
        let ray = |direction: DVec3| Ray::new(eye.as_vec3a(), direction.as_vec3a(), 0.0, f32::INFINITY);
        camera.directions(tile).map(|direction| trace(ray(direction))).sum::<u64>()
    };
    camera.tiles().into_par_iter().map(tile_sum).sum()
}
