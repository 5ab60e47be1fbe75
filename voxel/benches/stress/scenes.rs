//! What the rays are cast at: small grids for the exact oracle, large ones for the oracle in f64.

use voxsight_voxel::dag::Dag;
use voxsight_voxel::voxelize::{VoxelizeError, voxelize};

use super::common::{Soup, random_soup_within, unit_grid};
use super::nearby::Nearby;
use super::random::Random;

/// A voxelized scene with the list of its occupied voxels.
pub struct Scene {
    pub name: &'static str,
    pub log2: u32,
    pub dag: Dag,
    pub voxels: Vec<[i32; 3]>,
    pub nearby: Nearby,
}

impl Scene {
    fn new(name: &'static str, log2: u32, soup: &Soup) -> Result<Self, VoxelizeError> {
        let dag = voxelize(&unit_grid(log2), soup)?.dag;
        let mut voxels = Vec::new();
        dag.view().for_each_brick(|corner, _, mask| {
            for bit in (0..64).filter(|bit| mask >> bit & 1 == 1) {
                voxels.push([corner[0] + (bit & 3), corner[1] + (bit >> 2 & 3), corner[2] + (bit >> 4)]);
            }
        });
        Ok(Scene { name, log2, dag, nearby: Nearby::new(&voxels), voxels })
    }

    /// Voxels a side.
    pub fn side(&self) -> f64 {
        f64::from(1u32 << self.log2)
    }

    /// Small enough for the exact oracle.
    pub fn is_small(&self) -> bool {
        self.log2 <= 7
    }

    /// Some occupied voxel.
    pub fn voxel(&self, random: &mut Random) -> [i32; 3] {
        random.pick(&self.voxels)
    }
}

/// All of them.
pub fn scenes(seed: u64) -> Result<Vec<Scene>, VoxelizeError> {
    let soup = |log2: u32, drawables: usize, reach: u32| random_soup_within(seed, log2, drawables, reach);
    let end = |log2: u32| 1i32 << log2;
    Ok(vec![
        Scene::new("soup 2^6", 6, &soup(6, 8, 6))?,
        Scene::new("soup 2^7", 7, &soup(7, 24, 7))?,
        Scene::new("box 2^6", 6, &hollow_box([3, 5, 17], [64, 50, 41]))?,
        Scene::new("stairs 2^7", 7, &stairs([0, 0, 0], [1, 1, 1], 128))?,
        Scene::new("falling stairs 2^6", 6, &stairs([0, 63, 0], [1, -1, 1], 64))?,
        Scene::new("block 2^7", 7, &block([56, 55, 58], [72, 73, 71]))?,
        Scene::new("soup 2^12", 12, &soup(12, 40, 8))?,
        Scene::new("box 2^12", 12, &hollow_box([1948, 1990, 2000], [2148, 2090, 2049]))?,
        Scene::new("stairs 2^12", 12, &stairs([0, 0, 0], [1, 1, 1], 4096))?,
        Scene::new("soup 2^17", 17, &soup(17, 40, 8))?,
        // In the grid's last corner, so that its own end counts.
        Scene::new("box 2^17", 17, &hollow_box([end(17) - 90, end(17) - 80, end(17) - 100], [end(17); 3]))?,
        Scene::new("stairs 2^17", 17, &stairs([63_488, 67_583, 63_488], [1, -1, 1], 4096))?,
        // Around the middle, where cells of all sizes meet.
        Scene::new("block 2^17", 17, &block([65_520, 65_523, 65_530], [65_552, 65_550, 65_545]))?,
    ])
}

/// Centre of a voxel, 1/256 voxels.
fn centre(voxel: [i32; 3]) -> [i32; 3] {
    voxel.map(|c| c * 256 + 128)
}

/// The layers of voxels in which axis k is `at`, from `low` to `high` along the others (one above the last).
fn layer(low: [i32; 3], high: [i32; 3], k: usize, at: i32) -> Vec<[[i32; 3]; 3]> {
    let (a, b) = ((k + 1) % 3, (k + 2) % 3);
    let corner = |far_a: bool, far_b: bool| {
        let mut voxel = low;
        voxel[k] = at;
        voxel[a] = if far_a { high[a] - 1 } else { low[a] };
        voxel[b] = if far_b { high[b] - 1 } else { low[b] };
        centre(voxel)
    };
    let (p, q, r, s) = (corner(false, false), corner(true, false), corner(true, true), corner(false, true));
    vec![[p, q, r], [p, r, s]]
}

/// Voxels of the six sides of a box.
fn hollow_box(low: [i32; 3], high: [i32; 3]) -> Soup {
    Soup((0..3).map(|k| [layer(low, high, k, low[k]), layer(low, high, k, high[k] - 1)].concat()).collect())
}

/// All voxels of a box.
fn block(low: [i32; 3], high: [i32; 3]) -> Soup {
    Soup((low[2]..high[2]).map(|z| layer(low, high, 2, z)).collect())
}

/// Single voxels along a diagonal, each touching the next in a corner only.
fn stairs(start: [i32; 3], step: [i32; 3], count: i32) -> Soup {
    let point = |i: i32| centre([0, 1, 2].map(|k| start[k] + i * step[k]));
    Soup(vec![(0..count).map(|i| [point(i); 3]).collect()])
}
