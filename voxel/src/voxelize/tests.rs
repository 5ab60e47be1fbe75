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
    fn load(&self, drawable: u32, mesh: &mut SnappedMesh) {
        let triangles = &self.0[drawable as usize];
        mesh.vertices = triangles.iter().flatten().copied().collect();
        mesh.triangles = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    }
}

/// The voxels, and the number of tasks.
fn build(crowd: &Crowd, log2: u32, settings: &Settings, dense: u64) -> (Voxelized, u64) {
    let (voxels, cost) = build_at_cost(crowd, log2, settings, dense);
    (voxels, cost.tasks)
}

fn build_at_cost(crowd: &Crowd, log2: u32, settings: &Settings, dense: u64) -> (Voxelized, Cost) {
    let grid = Grid { origin: DVec3::ZERO, voxel_size: 1.0, log2 };
    let mut pages = Vec::new();
    let Streamed { dag, owner_directory, cost, .. } =
        voxelize_cutting(&grid, crowd, settings, dense, &mut pages).unwrap();
    (Voxelized { dag, owners: OwnerTable { directory: owner_directory, pages } }, cost)
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

#[test]
fn a_crowd_below_a_cell_that_only_settings_cut_is_not_cut_either() {
    // A cell of 256^3 that alone would be dense and worth cutting, in a grid that is dense but not worth it, because of
    // drawables that fill the rest of it: whether settings cut the grid must not decide what becomes of the cell.
    let (log2, side) = (10, 256 << 10);
    let mut crowd = Crowd::new(4, 8);
    crowd.0.remove(0);
    let large = [[70_000, 70_000, 70_000], [side, 70_000, 80_000], [70_000, side, side]];
    crowd.0.extend(vec![vec![large; 50]; 20]);
    let uncut = Settings { task_triangles: u64::MAX, task_bricks: u64::MAX, ..Settings::default() };
    let (expected, tasks) = build(&crowd, log2, &uncut, 500);
    assert_eq!(tasks, 1, "the grid should not be worth cutting");
    let by_bricks = Settings { task_bricks: 1, ..uncut };
    let (cut, tasks) = build(&crowd, log2, &by_bricks, 500);
    assert!(tasks > 1, "settings should have cut the grid");
    assert!(cut == expected, "settings changed the result");
    // Alone, it is cut: this is about a cell where the two rules differ.
    crowd.0.truncate(400);
    let (_, tasks) = build(&crowd, 8, &uncut, 500);
    assert!(tasks > 1, "the crowd should be worth cutting");
}

#[test]
fn a_large_drawable_of_many_triangles_is_not_loaded_again_and_again() {
    let mut random = oorandom::Rand64::new(21);
    for log2 in [9, 10, 11] {
        let side = 256i32 << log2;
        let sphere = |_| {
            let towards = DVec3::from_array([0.0; 3].map(|_: f64| random.rand_float() - 0.5));
            let at = towards.normalize_or_zero() * 0.49 + 0.5;
            let p = (at * f64::from(side)).to_array().map(|c| c as i32);
            [p, [p[0] + 100, p[1], p[2]], [p[0], p[1] + 100, p[2]]]
        };
        let pipe = |i: i32| [[i * (side / 6000), 9, 9], [i * (side / 6000) + 90, 40, 9], [i, 9, 40]];
        for (shape, triangles) in
            [("sphere", (0..6000).map(sphere).collect()), ("pipe", (0..6000).map(pipe).collect::<Vec<_>>())]
        {
            let one = Crowd(vec![triangles]);
            for (task_triangles, dense) in [(2000, u64::MAX), (u64::MAX, 2000), (500, 2000)] {
                let settings = Settings { task_triangles, ..Settings::default() };
                let (_, cost) = build_at_cost(&one, log2, &settings, dense);
                // Once to plan, and at most four times to build.
                let times = cost.loaded_triangles / 6000;
                assert!(times <= 5, "{shape}, 2^{log2}, {settings:?}, dense from {dense}: {times} times");
            }
        }
    }
}

#[test]
fn long_thin_triangles_count_for_planning_as_what_they_touch() {
    let side = 256 << 10;
    let needles = Crowd((0..30).map(|i| vec![[[0, i * 8000, 5], [side; 3], [side; 3]]]).collect());
    let settings = Settings { task_bricks: 1000, ..Settings::default() };
    // Each touches 256 bricks and more; without area they would be one each.
    assert!(build(&needles, 10, &settings, u64::MAX).1 > 7);
}
