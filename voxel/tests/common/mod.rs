//! Small random scenes for the tests.
#![allow(dead_code, reason = "each test file uses its own part")]

use glam::DVec3;
use voxsight_voxel::grid::Grid;
use voxsight_voxel::raycast::GridRay;
use voxsight_voxel::voxelize::{Drawables, SnappedMesh};

/// Drawables with their triangles written out.
pub struct Soup(pub Vec<Vec<[[i32; 3]; 3]>>);

impl Drawables for Soup {
    fn count(&self) -> u32 {
        self.0.len() as u32
    }
    fn load(&self, drawable: u32, mesh: &mut SnappedMesh) {
        let triangles = &self.0[drawable as usize];
        mesh.vertices = triangles.iter().flatten().copied().collect();
        mesh.triangles = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    }
}

/// `drawables` drawables of a few triangles each, from below a voxel to across the grid.
pub fn random_soup(seed: u64, log2: u32, drawables: usize) -> Soup {
    random_soup_within(seed, log2, drawables, log2 + 1)
}

/// The same, with triangles of at most `2^reach_log2` voxels.
pub fn random_soup_within(seed: u64, log2: u32, drawables: usize, reach_log2: u32) -> Soup {
    let mut random = oorandom::Rand64::new(seed.into());
    let side = 256u64 << log2;
    let drawable = |random: &mut oorandom::Rand64| {
        let centre = [0; 3].map(|_: i32| random.rand_range(0..side + 1) as i64);
        let reach = 1u64 << random.rand_range(5..u64::from(reach_log2 + 8));
        let triangles = 1 + random.rand_range(0..6);
        let corner = |random: &mut oorandom::Rand64| {
            centre.map(|c| {
                let offset = random.rand_range(0..2 * reach) as i64 - reach as i64;
                (c + offset).clamp(0, side as i64) as i32
            })
        };
        (0..triangles)
            .map(|_| {
                let mut triangle = [0; 3].map(|_: i32| corner(random));
                match random.rand_range(0..8) {
                    0 => triangle[1] = triangle[2],
                    1 => triangle.iter_mut().for_each(|p| p[0] = triangle_plane(centre[0])),
                    _ => {}
                }
                triangle
            })
            .collect()
    };
    Soup((0..drawables).map(|_| drawable(&mut random)).collect())
}

fn triangle_plane(c: i64) -> i32 {
    (c as i32) & !255
}

/// A unit grid: world space is grid space.
pub fn unit_grid(log2: u32) -> Grid {
    Grid { origin: DVec3::ZERO, voxel_size: 1.0, log2 }
}

/// Rays of all kinds: from inside, near and a million grid sides away; axis-parallel, along faces, through corners, with
/// denormal, tiny, huge and negative zero components.
pub fn random_ray(random: &mut oorandom::Rand64, side: f64) -> GridRay {
    let point = |random: &mut oorandom::Rand64, reach: f64| {
        DVec3::new(random.rand_float(), random.rand_float(), random.rand_float()) * reach
            - DVec3::splat((reach - side) / 2.0)
    };
    let target = point(random, side);
    let mut origin = match random.rand_range(0..4) {
        0 => point(random, side),
        1 => point(random, side * 1e6),
        _ => point(random, side * 3.0),
    };
    let mut direction = target - origin;
    match random.rand_range(0..10) {
        0 => direction[random.rand_range(0..3) as usize] = 0.0,
        1 => {
            let axis = random.rand_range(0..3) as usize;
            direction = DVec3::ZERO;
            direction[axis] = if random.rand_range(0..2) == 0 { 1.0 } else { -1.0 };
            origin = point(random, side);
            origin[axis] = if direction[axis] > 0.0 { -1.0 } else { side + 1.0 };
        }
        2 => {
            // Along a face: one coordinate on a plane, no motion across it.
            let axis = random.rand_range(0..3) as usize;
            origin[axis] = random.rand_range(0..side as u64) as f64;
            direction[axis] = -0.0;
        }
        3 => {
            // Through corners.
            origin = origin.round();
            direction = DVec3::new(1.0, -1.0, 1.0);
        }
        4 => direction[random.rand_range(0..3) as usize] = 5e-324,
        5 => direction *= 1e-300,
        6 => direction *= 1e200,
        _ => {}
    }
    GridRay::new(origin, direction)
}
