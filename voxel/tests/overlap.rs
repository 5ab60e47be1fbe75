//! The overlap kernel against exact oracles: snapped triangles bit for bit on every SIMD level, and no voxel missed that
//! the triangle touches before snapping.

mod exact;

use std::collections::BTreeMap;

use exact::{Class, ExactTriangle, GRID_LOG2, UNIT};
use oorandom::Rand64;
use voxsight_voxel::grid::Grid;
use voxsight_voxel::raycast::Instructions;
use voxsight_voxel::voxelize::SnappedTriangle;
use voxsight_voxel::voxelize::overlap::TriangleOverlap;

const SIDE: i32 = 1 << GRID_LOG2;

fn grid() -> Grid {
    Grid { origin: glam::DVec3::ZERO, voxel_size: 1.0, log2: GRID_LOG2 }
}

fn snap(v: ExactTriangle) -> SnappedTriangle {
    v.map(|p| grid().snap(exact::grid_position(p)))
}

fn bricks(
    instructions: Instructions,
    v: SnappedTriangle,
    cell: [i32; 3],
    shift: u32,
    seed: &str,
) -> BTreeMap<[i32; 3], u64> {
    let mut bricks = BTreeMap::new();
    TriangleOverlap::new(v).for_each_brick_with(instructions, cell, shift, SIDE, &mut |brick, mask| {
        assert!(mask != 0, "{seed}: {v:?} {brick:?} is empty");
        assert_eq!(bricks.insert(brick, mask), None, "{seed}: {v:?} {brick:?} comes twice");
    });
    bricks
}

fn voxel(brick: [i32; 3], bit: i32) -> [i32; 3] {
    [brick[0] + (bit & 3), brick[1] + (bit >> 2 & 3), brick[2] + (bit >> 4)]
}

#[test]
fn masks_agree_with_thirteen_axes_in_i128_and_miss_nothing_that_the_exact_triangle_touches() {
    let (mut touched, mut false_positives) = (0u64, 0u64);
    for (index, class) in Class::ALL.into_iter().enumerate() {
        let seed = 40 + index as u128;
        let mut random = Rand64::new(seed);
        for round in 0..1500 {
            let exact = class.triangle(&mut random);
            let snapped = snap(exact);
            let brick = exact::brick_near(&mut random, exact);
            // Alone, or among all bricks of a cell of up to 256 voxels a side: every way down to it.
            let shift = 2 + 2 * random.rand_range(0..4) as u32;
            let cell = brick.map(|c| c >> shift << shift);
            let mut mask = 0;
            TriangleOverlap::new(snapped).for_each_brick(cell, shift, SIDE, &mut |b, m| {
                if b == brick {
                    mask |= m;
                }
            });
            for bit in 0..64 {
                let voxel = voxel(brick, bit);
                let found = mask >> bit & 1 == 1;
                let expected = exact::snapped_touches_cell(snapped, voxel, 0);
                assert_eq!(found, expected, "{class:?}, seed {seed}, round {round}: {snapped:?} {voxel:?}");
                let truly = exact::exact_touches_voxel(exact, voxel);
                assert!(found || !truly, "{class:?}, seed {seed}, round {round}: {exact:?} misses {voxel:?}");
                touched += u64::from(truly);
                false_positives += u64::from(found && !truly);
            }
        }
    }
    assert!(touched > 50_000, "too few voxels are touched to mean anything: {touched}");
    assert!(false_positives > 0, "the widening should show somewhere");
}

#[test]
fn single_cells_of_any_size_agree_with_thirteen_axes_in_i128() {
    for (index, class) in Class::ALL.into_iter().enumerate() {
        let seed = 60 + index as u128;
        let mut random = Rand64::new(seed);
        for round in 0..1000 {
            let exact = class.triangle(&mut random);
            let snapped = snap(exact);
            let brick = exact::brick_near(&mut random, exact);
            let overlap = TriangleOverlap::new(snapped);
            for shift in [0, 1, 2, 4, 8, 13] {
                let corner = brick.map(|c| c >> shift << shift);
                let expected = exact::snapped_touches_cell(snapped, corner, shift);
                let found = overlap.touches_cell(corner, shift);
                assert_eq!(
                    found, expected,
                    "{class:?}, seed {seed}, round {round}: {snapped:?} {corner:?} {shift}"
                );
                let (first, last) = overlap.cell_range(shift);
                let inside = (0..3).all(|k| (first[k]..=last[k]).contains(&(corner[k] >> shift)));
                assert!(inside || !expected, "{class:?}, seed {seed}, round {round}: outside the cell range");
            }
        }
    }
}

/// All bricks of a cell through single voxels, narrowed down by single cells.
fn bricks_one_by_one(
    overlap: &TriangleOverlap,
    corner: [i32; 3],
    shift: u32,
    found: &mut BTreeMap<[i32; 3], u64>,
) {
    if !overlap.touches_cell(corner, shift) || corner.iter().any(|&c| c >= SIDE) {
        return;
    }
    if shift == 2 {
        let mask = (0..64).filter(|&b| overlap.touches_cell(voxel(corner, b), 0)).fold(0, |m, b| m | 1 << b);
        found.insert(corner, mask);
        return;
    }
    for child in 0..8 {
        let half = 1 << (shift - 1);
        bricks_one_by_one(overlap, [0, 1, 2].map(|k| corner[k] + (child >> k & 1) * half), shift - 1, found);
    }
}

#[test]
fn every_brick_of_a_cell_comes_once_on_every_simd_level() {
    let mut count = 0;
    for (index, class) in Class::ALL.into_iter().enumerate() {
        let seed = 80 + index as u128;
        let mut random = Rand64::new(seed);
        for round in 0..60 {
            let exact = class.triangle(&mut random);
            let snapped = snap(exact);
            let near = exact::brick_near(&mut random, exact);
            // Whole grids hold what is small; of what is large, cells of up to 64 voxels.
            let (min, max) = (snapped.map(|p| p.map(|c| c >> 8)), 48);
            let extent =
                (0..3).map(|k| (min[0][k] - min[1][k]).abs().max((min[0][k] - min[2][k]).abs())).max();
            let shifts: &[u32] = if extent <= Some(max) { &[2, 4, 8, 18] } else { &[2, 4, 6] };
            for &shift in shifts {
                let cell = near.map(|c| c >> shift << shift);
                let mut expected = BTreeMap::new();
                bricks_one_by_one(&TriangleOverlap::new(snapped), cell, shift, &mut expected);
                count += expected.len();
                for level in Instructions::available() {
                    let at = format!(
                        "{class:?}, seed {seed}, round {round}, {level:?}, cell {cell:?} of 2^{shift}"
                    );
                    assert_eq!(bricks(level, snapped, cell, shift, &at), expected, "{at}: {snapped:?}");
                }
            }
        }
    }
    assert!(count > 20_000, "too few bricks to mean anything: {count}");
}

#[test]
fn triangles_in_a_block_come_whole_whatever_their_size() {
    // Inside one block of 256 voxels, by size: every path from one voxel to all levels.
    for (seed, reach) in [(1, 0.3), (2, 1.0), (3, 2.5), (4, 7.0), (5, 20.0), (6, 60.0), (7, 127.0)] {
        let mut random = Rand64::new(seed);
        let centre = [0.0; 3].map(|_: f64| 300.0 * 256.0 + 128.0);
        for round in 0..(200.0 / reach) as u32 + 6 {
            let mut point =
                || centre.map(|c| ((c + (2.0 * random.rand_float() - 1.0) * reach) * UNIT as f64) as i64);
            let mut exact = [point(), point(), point()];
            // Every third lies flat.
            if round % 3 == 0 {
                let z = exact[0][2];
                exact.iter_mut().for_each(|p| p[2] = z);
            }
            let snapped = snap(exact);
            let mut expected = BTreeMap::new();
            bricks_one_by_one(&TriangleOverlap::new(snapped), [300 * 256; 3], 8, &mut expected);
            for level in Instructions::available() {
                let at = format!("seed {seed}, round {round}, {level:?}");
                assert_eq!(bricks(level, snapped, [300 * 256; 3], 8, &at), expected, "{at}: {snapped:?}");
            }
        }
    }
}

/// Clips the triangle by the six faces of the box in exact rationals (homogeneous integers in lowest terms): what is left
/// is what they share.
fn shares_a_point_by_clipping(v: ExactTriangle, low: [i64; 3], high: [i64; 3]) -> bool {
    let mut polygon: Vec<[i128; 4]> = v.iter().map(|p| [p[0].into(), p[1].into(), p[2].into(), 1]).collect();
    for k in 0..3 {
        for (sign, at) in [(1, low[k]), (-1, high[k])] {
            let inside = |p: &[i128; 4]| sign * (p[k] - i128::from(at) * p[3]);
            let mut kept = Vec::new();
            for (i, p) in polygon.iter().enumerate() {
                let q = &polygon[(i + 1) % polygon.len()];
                let (of_p, of_q) = (inside(p), inside(q));
                if of_p >= 0 {
                    kept.push(*p);
                }
                if (of_p < 0) != (of_q < 0) {
                    // The point of the edge on the face; weights keep the last coordinate positive.
                    let (wp, wq) = (of_q.abs(), of_p.abs());
                    let mut cut = [0, 1, 2, 3].map(|c| p[c] * wp + q[c] * wq);
                    let divisor = cut.iter().fold(0, |a, &b| gcd(a, b.abs())).max(1);
                    cut.iter_mut().for_each(|c| *c /= divisor);
                    kept.push(cut);
                }
            }
            polygon = kept;
        }
    }
    !polygon.is_empty()
}

fn gcd(a: i128, b: i128) -> i128 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[test]
fn the_exact_oracle_agrees_with_clipping_in_rationals() {
    let mut random = Rand64::new(23);
    let mut touched = 0;
    for round in 0..60_000 {
        let reach = 4 + random.rand_range(0..24);
        let v = [0; 3].map(|_| [0; 3].map(|_: i64| random.rand_range(0..reach) as i64 - reach as i64 / 2));
        let low = [0; 3].map(|_: i64| random.rand_range(0..5) as i64 - 3);
        let high = low.map(|c| c + 1 + random.rand_range(0..4) as i64);
        let expected = shares_a_point_by_clipping(v, low, high);
        touched += u32::from(expected);
        assert_eq!(
            exact::exact_overlaps_box(v, low, high),
            expected,
            "seed 23, round {round}: {v:?} {low:?}"
        );
        let snapped = v.map(|p| p.map(|c| c as i32));
        let found = exact::snapped_overlaps_box(snapped, low, high);
        assert_eq!(found, expected, "seed 23, round {round}: {v:?} {low:?}");
    }
    assert!((10_000..50_000).contains(&touched), "one-sided: {touched} of 60,000");
}
