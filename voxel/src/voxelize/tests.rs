//! Dense cells, with an idea of dense that tests can reach.

use glam::DVec3;

use super::*;
use crate::dag::DagRef;
use crate::dag::owners::{OwnersIndex, OwnersRef};

/// Small triangles, one cell of 256^3 full of them, and a sheet through the whole grid.
struct Crowd(Vec<Vec<SnappedTriangle>>);

impl Crowd {
    fn new(seed: u64, log2: u32) -> Self {
        let mut random = oorandom::Rand64::new(seed.into());
        let side = 256u64 << log2;
        let crowded = 256 << 8;
        let mut drawables = vec![vec![[[0, 5, 9], [side as i32, 7, 300], [11, side as i32, 9000]]]];
        for i in 0..400 {
            let within = if i % 8 == 0 { side } else { crowded };
            let centre = [0; 3].map(|_: i32| random.rand_range(0..within) as i32);
            let mut corner =
                || centre.map(|c| (c + random.rand_range(0..2000) as i32 - 1000).clamp(0, side as i32));
            drawables.push((0..4).map(|_| [corner(), corner(), corner()]).collect());
        }
        Crowd(drawables)
    }
}

impl Drawables for Crowd {
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

fn build(crowd: &Crowd, log2: u32, settings: &Settings, dense: u64) -> (Voxelized, u64) {
    let grid = Grid { origin: DVec3::ZERO, voxel_size: 1.0, log2 };
    let mut pages = Vec::new();
    let Streamed { dag, owner_directory, cost, .. } =
        voxelize_cutting(&grid, crowd, settings, dense, &mut pages).unwrap();
    (Voxelized { dag, owners: OwnerTable { directory: owner_directory, pages } }, cost.tasks)
}

/// Owners of every brick: (drawable, voxels).
fn owners(voxels: &Voxelized, drawables: u32) -> Vec<Vec<(u32, u64)>> {
    let Dag { shape, words, counts, leaves } = &voxels.dag;
    let (dag, statistics) = DagRef::validate(shape, words, counts, leaves).unwrap();
    let OwnerTable { directory, pages } = &voxels.owners;
    let index = OwnersIndex::validate(directory, pages, statistics.bricks, drawables).unwrap();
    let owners = OwnersRef::new(directory, pages, &index);
    owners.check_masks(&dag).unwrap();
    let mut all = Vec::new();
    dag.for_each_brick(|_, ordinal, mask| all.push(owners.of_brick(ordinal, mask).masks()));
    all
}

fn bricks(dag: &Dag) -> Vec<([i32; 3], u64)> {
    let mut all = Vec::new();
    dag.view().for_each_brick(|corner, _, mask| all.push((corner, mask)));
    all
}

#[test]
fn a_dense_cell_is_cut_and_settings_still_do_not_change_a_bit() {
    for (seed, log2) in [(1, 8), (2, 9), (3, 11)] {
        let crowd = Crowd::new(seed, log2);
        let (whole, _) = build(&crowd, log2, &Settings::default(), u64::MAX);
        let expected = owners(&whole, crowd.count());
        for dense in [10, 40, 200] {
            let (cut, tasks) = build(&crowd, log2, &Settings::default(), dense);
            assert!(tasks > 1, "seed {seed}, dense from {dense}: nothing was cut");
            // Not `assert_eq`: nobody reads a megabyte of numbers.
            assert!(bricks(&cut.dag) == bricks(&whole.dag), "seed {seed}, dense from {dense}: other voxels");
            assert!(cut.dag == whole.dag, "seed {seed}, dense from {dense}: the DAG differs");
            assert!(
                owners(&cut, crowd.count()) == expected,
                "seed {seed}, dense from {dense}: owners differ"
            );
            for (task_triangles, task_bricks, block_height) in
                [(1, u64::MAX, 3), (u64::MAX, 1, 2), (u64::MAX, u64::MAX, 1), (100, 1000, 3)]
            {
                let settings = Settings { memory: None, task_triangles, task_bricks, block_height };
                let (same, _) = build(&crowd, log2, &settings, dense);
                assert!(same == cut, "seed {seed}, dense from {dense}, {settings:?}");
            }
        }
    }
}

#[test]
fn a_dense_cell_of_large_drawables_is_not_cut() {
    // Every child would load them all.
    let side = 256 << 8;
    let crowd = Crowd(vec![vec![[[0, 0, 0], [side, 0, 9], [0, side, side]]; 50]; 10]);
    let (_, tasks) = build(&crowd, 8, &Settings::default(), 100);
    assert_eq!(tasks, 1);
}
