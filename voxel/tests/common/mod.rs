//! Small random scenes for the tests.
#![allow(dead_code, reason = "each test file uses its own part")]

use voxsight_voxel::grid::Grid;
use voxsight_voxel::voxelize::{Drawables, SnappedMesh};

/// Drawables with their triangles written out.
pub struct Soup(pub Vec<Vec<[[i32; 3]; 3]>>);

impl Drawables for Soup {
    fn count(&self) -> u32 {
        self.0.len() as u32
    }
    fn triangle_count(&self, drawable: u32) -> u32 {
        self.0[drawable as usize].len() as u32
    }
    fn load(&self, drawable: u32, mesh: &mut SnappedMesh) {
        let triangles = &self.0[drawable as usize];
        mesh.vertices = triangles.iter().flatten().copied().collect();
        mesh.triangles = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    }
}

/// `drawables` drawables of a few triangles each, from below a voxel to across the grid.
pub fn random_soup(seed: u64, log2: u32, drawables: usize) -> Soup {
    let mut random = oorandom::Rand64::new(seed.into());
    let side = 256u64 << log2;
    let drawable = |random: &mut oorandom::Rand64| {
        let centre = [0; 3].map(|_: i32| random.rand_range(0..side + 1) as i64);
        let reach = 1u64 << random.rand_range(5..u64::from(log2 + 9));
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
    Grid { origin: glam::DVec3::ZERO, voxel_size: 1.0, log2 }
}
