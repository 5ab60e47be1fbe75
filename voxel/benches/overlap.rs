//! The overlap kernel: first against exact oracles on millions of hostile triangles, then timed.
//!
//! `cargo bench -p voxsight-voxel --bench overlap -- [--triangles 200000] [--seed 1] [--only-speed] [--legs 30]`
//!
//! Accuracy, for each class of triangles: the voxels of one brick around a random point of each triangle, against (a) the
//! snapped triangle and widened voxels in i128: must agree bit for bit; (b) the triangle itself and plain voxels in exact
//! integers: `missed` must be 0, `false` counts voxels set that the triangle does not touch. Speed: one thread, median of
//! five, for each SIMD level in one call, and for one call a triangle ("alone") on the best; masks are compared with the reference on a sample before anything is timed.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a bench stops at the first surprise"
)]

#[path = "../tests/exact/mod.rs"]
mod exact;

use std::hint::black_box;
use std::time::Instant;

use exact::{Class, GRID_LOG2};
use oorandom::Rand64;
use rayon::prelude::*;
use voxsight_voxel::grid::Grid;
use voxsight_voxel::raycast::Instructions;
use voxsight_voxel::voxelize::SnappedTriangle;
use voxsight_voxel::voxelize::overlap::TriangleOverlap;

const RUNS: usize = 5;
/// Voxels to set in a timed run, about.
const VOXELS_A_RUN: f64 = 4e6;
const SIDE: i32 = 1 << GRID_LOG2;
/// The block that timed triangles lie in: 256 voxels a side, at this corner.
const BLOCK: [i32; 3] = [300 * 256; 3];
const BLOCK_SHIFT: u32 = 8;

fn argument(name: &str) -> Option<u64> {
    std::env::args().skip_while(|a| a != name).nth(1).map(|text| text.parse().unwrap())
}

/// `--legs`: only triangles of this size are timed.
fn is_asked_for(leg: f64) -> bool {
    let asked = std::env::args().skip_while(|a| a != "--legs").nth(1);
    asked.is_none_or(|text| text.parse() == Ok(leg))
}

fn main() {
    let triangles = argument("--triangles").unwrap_or(200_000);
    let seed = argument("--seed").unwrap_or(1);
    if !std::env::args().any(|a| a == "--only-speed") {
        accuracy(triangles, seed);
    }
    speed();
}

/// What a class of triangles gave.
#[derive(Default)]
struct Count {
    voxels: u64,
    touched: u64,
    missed: u64,
    wrong: u64,
    false_positives: u64,
}

impl Count {
    fn add(self, other: Count) -> Count {
        Count {
            voxels: self.voxels + other.voxels,
            touched: self.touched + other.touched,
            missed: self.missed + other.missed,
            wrong: self.wrong + other.wrong,
            false_positives: self.false_positives + other.false_positives,
        }
    }
}

/// One triangle, one brick, both oracles.
fn check(class: Class, random: &mut Rand64) -> Count {
    let grid = Grid { origin: glam::DVec3::ZERO, voxel_size: 1.0, log2: GRID_LOG2 };
    let triangle = class.triangle(random);
    let snapped = triangle.map(|p| grid.snap(exact::grid_position(p)));
    let brick = exact::brick_near(random, triangle);
    // Alone, or among all bricks of a cell of up to 256 voxels a side: every way down to it.
    let shift = 2 + 2 * random.rand_range(0..4) as u32;
    let mut mask = 0;
    TriangleOverlap::new(snapped).for_each_brick(
        brick.map(|c| c >> shift << shift),
        shift,
        SIDE,
        &mut |b, m| {
            if b == brick {
                assert_eq!(mask, 0, "{class:?} {snapped:?}: {b:?} comes twice");
                mask = m;
            }
        },
    );
    let mut count = Count { voxels: 64, ..Count::default() };
    for bit in 0..64 {
        let voxel = [brick[0] + (bit & 3), brick[1] + (bit >> 2 & 3), brick[2] + (bit >> 4)];
        let found = mask >> bit & 1 == 1;
        let truly = exact::exact_touches_voxel(triangle, voxel);
        count.wrong += u64::from(found != exact::snapped_touches_cell(snapped, voxel, 0));
        count.touched += u64::from(truly);
        count.missed += u64::from(truly && !found);
        count.false_positives += u64::from(found && !truly);
    }
    count
}

fn accuracy(triangles: u64, seed: u64) {
    const BATCH: u64 = 1000;
    println!("2^{GRID_LOG2} voxels a side, seed {seed}");
    println!(
        "{:<14} {:>10} {:>12} {:>12} {:>8} {:>8} {:>10} {:>8}",
        "class", "triangles", "voxels", "touched", "differ", "missed", "false", "share"
    );
    for class in Class::ALL {
        let count = (0..triangles.div_ceil(BATCH))
            .into_par_iter()
            .map(|batch| {
                let mut random = Rand64::new(u128::from(seed) << 64 | u128::from(batch) << 8 | class as u128);
                let size = BATCH.min(triangles - batch * BATCH);
                (0..size).map(|_| check(class, &mut random)).fold(Count::default(), Count::add)
            })
            .reduce(Count::default, Count::add);
        println!(
            "{:<14} {:>10} {:>12} {:>12} {:>8} {:>8} {:>10} {:>7.3}%",
            format!("{class:?}"),
            triangles,
            count.voxels,
            count.touched,
            count.wrong,
            count.missed,
            count.false_positives,
            100.0 * count.false_positives as f64 / (count.touched + count.false_positives).max(1) as f64
        );
        assert_eq!((count.wrong, count.missed), (0, 0), "{class:?} is wrong: timing it would mean nothing");
    }
}

/// Triangles with right-angled legs of about `leg` voxels inside the block; `flat` ones lie across an axis.
fn triangles_of(leg: f64, flat: bool, count: usize) -> Vec<SnappedTriangle> {
    let grid = Grid { origin: glam::DVec3::ZERO, voxel_size: 1.0, log2: GRID_LOG2 };
    let mut random = Rand64::new(leg.to_bits().into());
    let mut direction = || loop {
        let v = glam::DVec3::from_array([0; 3].map(|_: i32| 2.0 * random.rand_float() - 1.0));
        if (0.1..1.0).contains(&v.length_squared()) {
            break v / v.length();
        }
    };
    let mut triangles = Vec::with_capacity(count);
    while triangles.len() < count {
        let (mut p, mut q) = (direction(), direction());
        if flat {
            let k = triangles.len() % 3;
            (p[k], q[k]) = (0.0, 0.0);
        }
        let q = p.cross(q).cross(p);
        if p.length() < 0.1 || q.length() < 0.1 {
            continue;
        }
        let (p, q) = (p * (leg / p.length()), q * (leg / q.length()));
        // Anywhere in the block that holds it.
        let (low, high) = (p.min(q).min(glam::DVec3::ZERO), p.max(q).max(glam::DVec3::ZERO));
        let room = glam::DVec3::splat(254.0) - (high - low);
        if room.min_element() < 0.0 {
            continue;
        }
        let place = (direction() * 0.5 + 0.5) * room + 1.0 - low;
        let corner = glam::DVec3::from_array(BLOCK.map(f64::from)) + place;
        triangles.push([corner, corner + p, corner + q].map(|v| grid.snap(v)));
    }
    triangles
}

fn check_speed_sample(instructions: Instructions, triangle: SnappedTriangle) {
    let overlap = TriangleOverlap::new(triangle);
    let mut bricks = std::collections::BTreeMap::new();
    overlap.for_each_brick_with(instructions, BLOCK, BLOCK_SHIFT, SIDE, &mut |brick, mask| {
        assert_eq!(bricks.insert(brick, mask), None, "a brick comes twice");
    });
    let (first, last) = overlap.cell_range(2);
    for z in first[2]..=last[2] {
        for y in first[1]..=last[1] {
            for x in first[0]..=last[0] {
                let brick = [x, y, z].map(|c| c << 2);
                let touches = |b: &i32| {
                    overlap
                        .touches_cell([brick[0] + (b & 3), brick[1] + (b >> 2 & 3), brick[2] + (b >> 4)], 0)
                };
                let mask = if overlap.touches_cell(brick, 2) {
                    (0..64).filter(touches).fold(0u64, |mask, b| mask | 1 << b)
                } else {
                    0
                };
                assert_eq!(bricks.get(&brick).copied().unwrap_or(0), mask, "{triangle:?} {brick:?}");
            }
        }
    }
}

fn speed() {
    println!(
        "\none thread, triangles of right angle with both legs as given, in a block of 256 voxels a side"
    );
    println!(
        "{:<10} {:>9} {:>11} {:>11}   {:<8} {:>12} {:>12}",
        "legs", "triangles", "voxels each", "bricks each", "level", "M voxels/s", "M triangles/s"
    );
    for (leg, flat) in [
        (0.1, false),
        (0.3, false),
        (1.0, false),
        (2.5, false),
        (5.0, false),
        (12.0, false),
        (30.0, false),
        (100.0, false),
        (5.0, true),
        (30.0, true),
        (100.0, true),
    ] {
        if !is_asked_for(leg) {
            continue;
        }
        let count = (VOXELS_A_RUN / (3.0 + 2.0 * leg + leg * leg)) as usize;
        let triangles = triangles_of(leg, flat, count);
        for instructions in Instructions::available() {
            for &triangle in triangles.iter().take(if leg > 20.0 { 20 } else { 200 }) {
                check_speed_sample(instructions, triangle);
            }
            let name = format!("{instructions:?}");
            let seconds_and_visited = median(|visited| {
                for &triangle in black_box(&triangles) {
                    let overlap = TriangleOverlap::new(triangle);
                    let visit = &mut |_, mask| visited.add(mask);
                    overlap.for_each_brick_with(instructions, BLOCK, BLOCK_SHIFT, SIDE, visit);
                }
            });
            print_row(leg, flat, &name, count, seconds_and_visited);
        }
    }
}

/// What a timed run counts.
#[derive(Clone, Copy, Default)]
struct Visited {
    bricks: u64,
    voxels: u64,
}

impl Visited {
    #[inline(always)]
    fn add(&mut self, mask: u64) {
        self.bricks += 1;
        self.voxels += u64::from(mask.count_ones());
    }
}

fn median(work: impl Fn(&mut Visited)) -> (f64, Visited) {
    let mut visited = Visited::default();
    let mut times: Vec<f64> = (0..RUNS)
        .map(|_| {
            visited = Visited::default();
            let started = Instant::now();
            work(&mut visited);
            black_box(visited);
            started.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    (times[RUNS / 2], visited)
}

fn print_row(leg: f64, flat: bool, how: &str, count: usize, (seconds, visited): (f64, Visited)) {
    println!(
        "{:<10} {:>9} {:>11.1} {:>11.1}   {how:<8} {:>12.1} {:>12.3}",
        format!("{leg}{}", if flat { " flat" } else { "" }),
        count,
        visited.voxels as f64 / count as f64,
        visited.bricks as f64 / count as f64,
        visited.voxels as f64 / seconds / 1e6,
        count as f64 / seconds / 1e6
    );
}
