//! The voxelizer against brute force: every voxel, every owner.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

mod common;

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use rayon::ThreadPoolBuilder;
use rayon::prelude::*;

use common::{Soup, random_soup, random_soup_within, unit_grid};
use voxsight_voxel::dag::owners::OwnersIndex;
use voxsight_voxel::dag::{DagRef, OwnerTable, OwnersRef};
use voxsight_voxel::voxelize::overlap::TriangleOverlap;
use voxsight_voxel::voxelize::{
    Drawables, OwnerSink, Settings, SnappedMesh, Streamed, VoxelizeError, Voxelized, voxelize, voxelize_into,
};

/// Owners of every occupied voxel, by testing each brick of the grid against each triangle.
fn owners_by_brute_force(soup: &Soup, log2: u32) -> BTreeMap<[i32; 3], Vec<u32>> {
    let mut owners: BTreeMap<[i32; 3], Vec<u32>> = BTreeMap::new();
    for (drawable, triangles) in soup.0.iter().enumerate() {
        for triangle in triangles {
            let overlap = TriangleOverlap::new(*triangle);
            for z in 0..1 << log2 {
                for y in 0..1 << log2 {
                    for x in 0..1 << log2 {
                        if overlap.touches_cell([x, y, z], 0) {
                            let of_voxel = owners.entry([x, y, z]).or_default();
                            if of_voxel.last() != Some(&(drawable as u32)) {
                                of_voxel.push(drawable as u32);
                            }
                        }
                    }
                }
            }
        }
    }
    owners
}

#[test]
fn every_voxel_knows_exactly_its_owners() {
    for seed in 0..6 {
        let log2 = 6 + (seed % 2) as u32;
        let soup = random_soup(seed, log2, 9);
        let expected = owners_by_brute_force(&soup, log2);
        let voxels = voxelize(&unit_grid(log2), &soup).unwrap();
        let (dag, statistics) =
            DagRef::validate(&voxels.dag.shape, &voxels.dag.words, &voxels.dag.counts, &voxels.dag.leaves)
                .unwrap();
        let (directory, pages) = (&voxels.owners.directory, &voxels.owners.pages);
        let index = OwnersIndex::validate(directory, pages, dag.brick_count(), 9).unwrap();
        let owners = OwnersRef::new(directory, pages, &index);
        owners.check_masks(&dag).unwrap();

        let mut found = BTreeMap::new();
        let mut ordinals = 0;
        dag.for_each_brick(|corner, ordinal, mask| {
            assert_eq!(ordinal, ordinals, "seed {seed}");
            ordinals += 1;
            for bit in (0..64).filter(|bit| mask >> bit & 1 == 1) {
                let voxel = [corner[0] + (bit & 3), corner[1] + (bit >> 2 & 3), corner[2] + (bit >> 4)];
                assert_eq!(dag.brick_at(voxel), Some((ordinal, mask)), "seed {seed} {voxel:?}");
                let of_brick = owners.of_brick(ordinal, mask);
                found.insert(voxel, of_brick.of_voxel(bit as u32).collect::<Vec<_>>());
                let masks = of_brick.masks();
                assert!(masks.iter().map(|m| m.0).eq(of_brick.all()), "seed {seed} {voxel:?}");
                let by_mask = masks.iter().filter(|m| m.1 >> bit & 1 == 1).map(|m| m.0);
                assert!(by_mask.eq(of_brick.of_voxel(bit as u32)), "seed {seed} {voxel:?}");
            }
            assert_eq!(dag.brick_mask(ordinal), Some(mask), "seed {seed}");
        });
        assert_eq!(found.len() as u64, statistics.voxels, "seed {seed}");
        assert_eq!(ordinals, statistics.bricks, "seed {seed}");
        assert_eq!(found, expected, "seed {seed}");
    }
}

/// Adds the owners of every voxel in the triangles' boxes, by testing each.
fn owners_near_triangles(soup: &Soup, log2: u32) -> BTreeMap<[i32; 3], Vec<u32>> {
    let mut owners: BTreeMap<[i32; 3], Vec<u32>> = BTreeMap::new();
    for (drawable, triangles) in soup.0.iter().enumerate() {
        for triangle in triangles {
            let overlap = TriangleOverlap::new(*triangle);
            // Two voxels more on each side: nothing beyond is touched.
            let of_box = |k: usize| {
                let of_corners = triangle.map(|p| p[k] >> 8);
                let (low, high) = of_corners.iter().fold((i32::MAX, 0), |(l, h), &c| (c.min(l), c.max(h)));
                (low - 2).max(0)..=(high + 2).min((1 << log2) - 1)
            };
            let voxels =
                of_box(2).flat_map(|z| of_box(1).flat_map(move |y| of_box(0).map(move |x| [x, y, z])));
            for voxel in voxels.filter(|&voxel| overlap.touches_cell(voxel, 0)) {
                let of_voxel = owners.entry(voxel).or_default();
                if of_voxel.last() != Some(&(drawable as u32)) {
                    of_voxel.push(drawable as u32);
                }
            }
        }
    }
    owners
}

/// Owners of every occupied voxel.
fn owners_of(voxels: &Voxelized) -> BTreeMap<[i32; 3], Vec<u32>> {
    let dag = voxels.dag.view();
    let index = voxels.owners.index(dag.brick_count());
    let owners = OwnersRef::new(&voxels.owners.directory, &voxels.owners.pages, &index);
    let mut found = BTreeMap::new();
    dag.for_each_brick(|corner, ordinal, mask| {
        let of_brick = owners.of_brick(ordinal, mask);
        for bit in (0..64).filter(|bit| mask >> bit & 1 == 1) {
            let voxel = [corner[0] + (bit & 3), corner[1] + (bit >> 2 & 3), corner[2] + (bit >> 4)];
            found.insert(voxel, of_brick.of_voxel(bit as u32).collect());
        }
    });
    found
}

#[test]
fn corners_and_middle_of_the_largest_grids_know_exactly_their_owners() {
    for log2 in 14..=17 {
        let mut random = oorandom::Rand64::new(log2.into());
        let side = 256i32 << log2;
        let mut drawables = Vec::new();
        for place in 0..9 {
            // The eight corners of the grid, and its middle: triangles within 16 voxels of it, on both sides.
            let centre = if place == 8 { [side / 2; 3] } else { [0, 1, 2].map(|k| (place >> k & 1) * side) };
            for _ in 0..6 {
                let reach = 1 << random.rand_range(8..13);
                let mut corner = || {
                    centre.map(|c| {
                        let offset = random.rand_range(0..2 * reach + 1) as i32 - reach as i32;
                        (c + offset).clamp(0, side)
                    })
                };
                drawables.push((0..3).map(|_| [corner(), corner(), corner()]).collect());
            }
        }
        let soup = Soup(drawables);
        let expected = owners_near_triangles(&soup, log2);
        assert!(expected.len() > 1000, "2^{log2}: only {} voxels", expected.len());
        let middle = (1 << log2) / 2;
        for place in 0..8 {
            let [corner, beside] =
                [[0, (1 << log2) - 1], [middle - 1, middle]].map(|of| [0, 1, 2].map(|k| of[place >> k & 1]));
            let near = |at: [i32; 3]| expected.keys().any(|v| (0..3).all(|k| (v[k] - at[k]).abs() < 4));
            assert!(near(corner) && near(beside), "2^{log2}: nothing near {corner:?} or {beside:?}");
        }
        for settings in
            [Settings::default(), Settings { task_triangles: 10, block_height: 2, ..Settings::default() }]
        {
            let mut pages = Vec::new();
            let streamed = voxelize_into(&unit_grid(log2), &soup, &settings, &mut pages).unwrap();
            let Streamed { dag, owner_directory: directory, .. } = streamed;
            let found = owners_of(&Voxelized { dag, owners: OwnerTable { directory, pages } });
            assert!(found == expected, "seed {log2}, 2^{log2}, {settings:?}: other voxels or owners");
        }
    }
}

#[test]
fn tasks_blocks_and_memory_do_not_change_a_bit() {
    // The last one is large enough for tasks of several sizes side by side.
    for (seed, log2, reach_log2) in [(4, 9, 10), (5, 10, 11), (6, 13, 9)] {
        let soup = random_soup_within(seed, log2, 40, reach_log2);
        let expected = voxelize(&unit_grid(log2), &soup).unwrap();
        let mut tasks = Vec::new();
        for (task_triangles, task_bricks, block_height, memory) in [
            (u64::MAX, u64::MAX, 3, None),
            (1, u64::MAX, 3, None),
            (1, u64::MAX, 1, Some(1 << 26)),
            (u64::MAX, 1, 2, Some(1 << 26)),
            (20, 300, 1, None),
            (20, 300, 2, None),
        ] {
            let settings = Settings { memory, task_triangles, task_bricks, block_height };
            let mut pages = Vec::new();
            let streamed = voxelize_into(&unit_grid(log2), &soup, &settings, &mut pages).unwrap();
            let owners = OwnerTable { directory: streamed.owner_directory, pages };
            let result = Voxelized { dag: streamed.dag, owners };
            // Not `assert_eq`: nobody reads a megabyte of numbers.
            assert!(result == expected, "seed {seed}, {settings:?}");
            tasks.push(streamed.cost.tasks);
        }
        assert_eq!(tasks[0], 1, "seed {seed}");
        assert!(tasks[3] > 7 && tasks[4] > 1, "seed {seed}: the grid was not cut: {tasks:?}");
        // For triangles, only where drawables are small.
        assert!(tasks[1] > 7 || log2 < 13, "seed {seed}: the grid was not cut for triangles: {tasks:?}");
    }
}

#[test]
fn a_dag_larger_than_the_memory_is_an_error_that_says_so() {
    let soup = random_soup(4, 10, 60);
    let settings = Settings { memory: Some(20_000), ..Settings::default() };
    let error = voxelize_into(&unit_grid(10), &soup, &settings, &mut Vec::new()).unwrap_err();
    assert!(matches!(error, VoxelizeError::Memory { limit: 20_000, used: 20_001.. }), "{error}");
}

#[test]
fn a_sink_that_fails_ends_the_work_with_its_error() {
    struct Full(usize);
    impl OwnerSink for Full {
        fn append(&mut self, words: &[u64]) -> std::io::Result<()> {
            self.0 = self.0.checked_sub(words.len()).ok_or(std::io::ErrorKind::StorageFull)?;
            Ok(())
        }
    }
    let soup = random_soup(4, 10, 60);
    let settings = Settings { task_bricks: 100, ..Settings::default() };
    let error = voxelize_into(&unit_grid(10), &soup, &settings, &mut Full(30)).unwrap_err();
    let VoxelizeError::Owners(error) = error else { panic!("{error}") };
    assert_eq!(error.kind(), std::io::ErrorKind::StorageFull);
}

#[test]
fn triangles_are_reported_once_and_a_stop_is_obeyed() {
    struct Counted(Soup, AtomicU64, u64);
    impl Drawables for Counted {
        fn count(&self) -> u32 {
            self.0.count()
        }
        fn load(&self, drawable: u32, mesh: &mut SnappedMesh) {
            self.0.load(drawable, mesh);
        }
        fn advance(&self, triangles: u64) -> ControlFlow<()> {
            let done = self.1.fetch_add(triangles, Ordering::SeqCst) + triangles;
            if done > self.2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        }
    }
    let soup = random_soup(7, 10, 60);
    let triangles: u64 = soup.0.iter().map(|d| d.len() as u64).sum();
    let settings = Settings { task_triangles: 5, ..Settings::default() };
    let counted = Counted(soup, AtomicU64::new(0), u64::MAX);
    voxelize_into(&unit_grid(10), &counted, &settings, &mut Vec::new()).unwrap();
    assert_eq!(counted.1.load(Ordering::SeqCst), triangles);
    let stopped = Counted(counted.0, AtomicU64::new(0), triangles / 2);
    let error = voxelize_into(&unit_grid(10), &stopped, &settings, &mut Vec::new()).unwrap_err();
    assert!(matches!(error, VoxelizeError::Cancelled), "{error}");
}

#[test]
fn threads_do_not_change_a_bit() {
    for (seed, log2) in [(1, 10), (2, 11), (3, 12)] {
        let soup = random_soup_within(seed, log2, 60, log2 - 1);
        let build = |threads| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let settings = Settings { task_triangles: 20, task_bricks: 300, ..Settings::default() };
            let mut pages = Vec::new();
            let streamed =
                pool.install(|| voxelize_into(&unit_grid(log2), &soup, &settings, &mut pages).unwrap());
            (streamed, pages)
        };
        let one = build(1);
        // Not `assert_eq`: nobody reads a megabyte of numbers.
        assert!(one == build(2), "seed {seed}: two threads give something else");
        assert!(one == build(7), "seed {seed}: seven threads give something else");
        let (tasks, bricks) = (one.0.cost.tasks, one.0.dag.view().brick_count());
        assert!(tasks > 50 && bricks > 1000, "seed {seed}: {tasks} tasks, {bricks} bricks");
    }
}

/// A drawable whose loading is itself parallel, with rayon.
struct Nested(Soup);

impl Drawables for Nested {
    fn count(&self) -> u32 {
        self.0.count()
    }
    fn load(&self, drawable: u32, mesh: &mut SnappedMesh) {
        // Many small jobs that are stolen back and forth. (Not `yield_now`: that costs a time slice on a busy machine.)
        (0..32).into_par_iter().with_max_len(1).for_each(|_| (0..500).for_each(|_| std::hint::spin_loop()));
        self.0.load(drawable, mesh);
    }
}

/// Fails when work takes far longer than it can, instead of waiting for ever.
fn within_seconds(seconds: u64, work: impl FnOnce() + Send + 'static) {
    let (ended, end) = std::sync::mpsc::channel();
    let thread = std::thread::spawn(move || {
        work();
        ended.send(()).unwrap();
    });
    match end.recv_timeout(Duration::from_secs(seconds)) {
        Err(RecvTimeoutError::Timeout) => panic!("it hangs"),
        // Its panic is the news.
        _ => thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)),
    }
}

#[test]
fn drawables_may_use_rayon_while_they_are_loaded() {
    // A second on an idle machine.
    within_seconds(240, || {
        let nested = Nested(random_soup_within(2, 10, 60, 6));
        let expected = voxelize(&unit_grid(10), &nested.0).unwrap().dag;
        let settings = Settings { task_bricks: 20, ..Settings::default() };
        let build = || {
            let streamed = voxelize_into(&unit_grid(10), &nested, &settings, &mut Vec::new()).unwrap();
            assert!(streamed.cost.tasks > 20, "{} tasks", streamed.cost.tasks);
            assert!(streamed.dag == expected, "rayon inside `load` changed the result");
        };
        let pool = ThreadPoolBuilder::new().num_threads(8).build().unwrap();
        (0..20).for_each(|_| pool.install(build));
        // On every thread of the pool that `load` needs.
        rayon::broadcast(|_| build());
    });
}

#[test]
fn large_grids_hold_every_point_of_every_triangle() {
    for (seed, log2) in [(11, 12), (12, 13), (13, 11)] {
        let soup = random_soup(seed, log2, 12);
        let small =
            Soup(soup.0.into_iter().map(|d| d.into_iter().map(|t| shrink(t, 1 << 18)).collect()).collect());
        let voxels = voxelize(&unit_grid(log2), &small).unwrap();
        let dag = voxels.dag.view();
        let index = voxels.owners.index(dag.brick_count());
        let owners = OwnersRef::new(&voxels.owners.directory, &voxels.owners.pages, &index);
        let mut random = oorandom::Rand64::new(99);
        for (drawable, triangles) in small.0.iter().enumerate() {
            for t in triangles {
                for _ in 0..300 {
                    let (mut u, mut v) = (random.rand_float(), random.rand_float());
                    if u + v > 1.0 {
                        (u, v) = (1.0 - u, 1.0 - v);
                    }
                    let at = |k: usize| {
                        let [a, b, c] = [t[0][k], t[1][k], t[2][k]].map(f64::from);
                        ((a + u * (b - a) + v * (c - a)) / 256.0).floor() as i32
                    };
                    let voxel = [at(0), at(1), at(2)].map(|c| c.clamp(0, (1 << log2) - 1));
                    let (ordinal, mask) =
                        dag.brick_at(voxel).unwrap_or_else(|| panic!("seed {seed} {voxel:?}"));
                    let bit = (voxel[0] & 3 | (voxel[1] & 3) << 2 | (voxel[2] & 3) << 4) as u32;
                    assert!(dag.is_occupied(voxel), "seed {seed} {voxel:?}");
                    let owned = owners.of_brick(ordinal, mask).of_voxel(bit).any(|d| d == drawable as u32);
                    assert!(owned, "seed {seed} {voxel:?} drawable {drawable}");
                }
            }
        }
    }
}

/// Keeps a triangle's size below `most` steps, so that the test stays quick.
fn shrink(t: [[i32; 3]; 3], most: i32) -> [[i32; 3]; 3] {
    t.map(|p| [0, 1, 2].map(|k| t[0][k] + (p[k] - t[0][k]).clamp(-most, most)))
}

#[test]
fn nothing_gives_an_empty_dag() {
    let voxels = voxelize(&unit_grid(9), &Soup(vec![vec![], vec![]])).unwrap();
    assert_eq!(voxels.dag.shape.root, None);
    let (dag, statistics) = DagRef::validate(&voxels.dag.shape, &[], &[], &[]).unwrap();
    assert_eq!((statistics.voxels, dag.brick_count()), (0, 0));
    assert!(OwnersIndex::validate(&voxels.owners.directory, &voxels.owners.pages, 0, 2).is_ok());
}

#[test]
fn validation_finds_damage_or_leaves_a_dag_that_is_safe_to_walk() {
    let soup = random_soup(5, 8, 20);
    let voxels = voxelize(&unit_grid(8), &soup).unwrap();
    let bricks = voxels.dag.view().brick_count();
    let mut random = oorandom::Rand64::new(17);
    let mut refused = 0;
    for _ in 0..3000 {
        let mut dag = voxels.dag.clone();
        let mut owners = voxels.owners.clone();
        let flip = 1u64 << random.rand_range(0..64);
        let mut pick = |length: usize| random.rand_range(0..length as u64) as usize;
        match pick(5) {
            0 => dag.words[pick(voxels.dag.words.len())] ^= (flip | flip >> 32) as u32,
            1 => dag.counts[pick(voxels.dag.counts.len())] ^= (flip | flip >> 32) as u32,
            2 => dag.leaves[pick(voxels.dag.leaves.len())] ^= flip,
            3 => owners.directory[pick(voxels.owners.directory.len())][pick(2)] ^= flip,
            _ => owners.pages[pick(voxels.owners.pages.len())] ^= flip,
        }
        let valid = DagRef::validate(&dag.shape, &dag.words, &dag.counts, &dag.leaves);
        let index = OwnersIndex::validate(&owners.directory, &owners.pages, bricks, 20);
        match (valid, index) {
            (Ok((dag, _)), Ok(index)) if dag.brick_count() == bricks => {
                let owners = OwnersRef::new(&owners.directory, &owners.pages, &index);
                dag.for_each_brick(|_, ordinal, mask| {
                    let of_brick = owners.of_brick(ordinal, mask);
                    (0..64).for_each(|bit| assert!(of_brick.of_voxel(bit).all(|d| d < 20)));
                    assert!(
                        of_brick.masks().iter().all(|&(d, of_drawable)| d < 20 && of_drawable & !mask == 0)
                    );
                });
                // Found or not, it ends.
                let _ = owners.check_masks(&dag);
            }
            _ => refused += 1,
        }
    }
    assert!(refused > 1000, "only {refused} of 3000 damaged tables were refused");
}
