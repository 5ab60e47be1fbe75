//! Every path of the ray caster gives the voxels of the scalar reference, in its order, for every ray.

#![allow(clippy::unwrap_used, reason = "tests")]

mod common;

use common::{random_ray, random_soup_within, unit_grid};
use glam::DVec3;
use voxsight_voxel::dag::DagRef;
use voxsight_voxel::raycast::{Footprint, GridRay, Instructions, Next, PACKET_RAYS, RayCaster, RayPacket};
use voxsight_voxel::voxelize::{Voxelized, voxelize};

/// What a ray meets: voxel, whole brick, t, and the brick's ordinal.
type Met = Vec<([i32; 3], bool, u64, u64)>;

fn soup(seed: u64, log2: u32) -> Voxelized {
    // Large triangles fill small grids; fine ones in between keep large grids cheap.
    voxelize(&unit_grid(log2), &random_soup_within(seed, log2, 60, (log2 + 1).min(9))).unwrap()
}

/// Goes on, skips bricks or ends, decided by the voxel alone.
fn next(voxel: [i32; 3], end_after: u32) -> Next {
    let mixed = voxel.iter().fold(17u32, |h, &c| (h ^ c as u32).wrapping_mul(0x9e37_79b1)) >> 16;
    match mixed % 8 {
        0 => Next::Brick,
        n if n < end_after => Next::End,
        _ => Next::Voxel,
    }
}

fn reference(dag: &DagRef, ray: &GridRay, footprint: Footprint, end_after: u32) -> Met {
    let mut met = Vec::new();
    dag.cast_footprint(ray, footprint, |hit| {
        met.push((hit.voxel, hit.whole_brick, hit.t().to_bits(), hit.brick_ordinal()));
        next(hit.voxel, end_after)
    });
    met
}

/// 64 rays through neighbouring pixels, some with their own ends.
fn tile(random: &mut oorandom::Rand64, side: f64) -> Vec<GridRay> {
    let middle = random_ray(random, side);
    if random.rand_range(0..4) == 0 {
        return (0..PACKET_RAYS).map(|_| random_ray(random, side)).collect();
    }
    let length = middle.direction.length();
    let spread = length * 10f64.powf(-4.0 * random.rand_float());
    let beside = DVec3::new(0.3, -0.2, 0.9).cross(middle.direction).normalize_or(DVec3::X) * spread;
    let above = beside.cross(middle.direction).normalize_or(DVec3::Y) * spread;
    (0..1 + random.rand_range(0..PACKET_RAYS as u64))
        .map(|i| {
            let (x, y) = ((i % 8) as f64 / 8.0 - 0.5, (i / 8) as f64 / 8.0 - 0.5);
            let direction = middle.direction + x * beside + y * above;
            let t_min = if random.rand_range(0..8) == 0 { random.rand_float() } else { 0.0 };
            let t_max = if random.rand_range(0..8) == 0 { 2.0 * random.rand_float() } else { f64::INFINITY };
            GridRay { direction, t_min, t_max, ..middle }
        })
        .collect()
}

#[test]
fn all_paths_meet_what_the_reference_meets() {
    let (mut rays, mut hits, mut bricks) = (0u64, 0u64, 0u64);
    for (seed, log2) in [(1, 6), (2, 7), (3, 9), (4, 12), (5, 17)] {
        let voxels = soup(seed, log2);
        let dag = voxels.dag.view();
        let mut random = oorandom::Rand64::new(seed.into());
        for round in 0..400 {
            let packet_rays = tile(&mut random, f64::from(1u32 << log2));
            let footprint = match random.rand_range(0..3) {
                0 => Footprint { width: 8.0 * random.rand_float(), growth: 0.0 },
                1 => Footprint { width: 0.0, growth: 16.0 * random.rand_float() },
                _ => Footprint::default(),
            };
            let end_after = random.rand_range(1..9) as u32;
            let expected: Vec<Met> =
                packet_rays.iter().map(|ray| reference(&dag, ray, footprint, end_after)).collect();
            rays += packet_rays.len() as u64;
            hits += expected.iter().map(|met| met.len() as u64).sum::<u64>();
            bricks += expected.iter().flatten().filter(|met| met.1).count() as u64;
            for instructions in Instructions::available() {
                let place = || format!("seed {seed} round {round} 2^{log2} {instructions:?} {footprint:?}");
                let caster = RayCaster::new(dag).with_instructions(instructions).with_footprint(footprint);
                for (ray, expected) in packet_rays.iter().zip(&expected) {
                    let mut met = Vec::new();
                    caster.cast(ray, |hit| {
                        met.push((hit.voxel, hit.whole_brick, hit.t().to_bits(), hit.brick_ordinal()));
                        next(hit.voxel, end_after)
                    });
                    assert_eq!(&met, expected, "one ray, {}: {ray:?}", place());
                }
                let mut packet = RayPacket::default();
                assert_eq!(packet.fill(packet_rays.iter().copied()), packet_rays.len());
                let mut met = vec![Vec::new(); packet_rays.len()];
                caster.cast_packet(&mut packet, |ray, hit| {
                    met[ray].push((hit.voxel, hit.whole_brick, hit.t().to_bits(), hit.brick_ordinal()));
                    next(hit.voxel, end_after)
                });
                let mut in_batch = vec![Vec::new(); packet_rays.len()];
                caster.cast_batch(&packet_rays, |ray, hit| {
                    in_batch[ray].push((hit.voxel, hit.whole_brick, hit.t().to_bits(), hit.brick_ordinal()));
                    next(hit.voxel, end_after)
                });
                assert_eq!(in_batch, expected, "batch, {}", place());
                for (i, ray) in packet_rays.iter().enumerate() {
                    assert_eq!(met[i], expected[i], "packet ray {i}, {}: {ray:?}", place());
                }
            }
        }
    }
    println!("{rays} rays, {hits} hits, {bricks} whole bricks");
    assert!(hits > 50_000 && bricks > 5_000, "too few to mean anything: {hits} hits, {bricks} bricks");
}

/// Does the ray cross the brick widened by `margin` voxels?
fn passes_near(ray: &GridRay, corner: [i32; 3], margin: f64) -> bool {
    let (mut t_in, mut t_out) = (ray.t_min, ray.t_max);
    for (k, &corner) in corner.iter().enumerate() {
        let (low, high) = (f64::from(corner) - margin, f64::from(corner + 4) + margin);
        let (a, b) = ((low - ray.origin[k]) / ray.direction[k], (high - ray.origin[k]) / ray.direction[k]);
        if ray.direction[k] == 0.0 {
            if !(low..=high).contains(&ray.origin[k]) {
                return false;
            }
        } else {
            (t_in, t_out) = (t_in.max(a.min(b)), t_out.min(a.max(b)));
        }
    }
    let slack = 1e-6 * (t_in.abs() + margin / ray.direction.length());
    t_in <= t_out + slack
}

#[test]
fn bricks_of_a_packet_are_those_of_its_rays_and_few_others() {
    let (mut needed, mut visited, mut visited_short) = (0u64, 0u64, 0u64);
    let mut by_several_octants = 0;
    for (seed, log2) in [(1, 6), (2, 7), (3, 9), (4, 12), (5, 17)] {
        let voxels = soup(seed, log2);
        let dag = voxels.dag.view();
        let side = f64::from(1u32 << log2);
        let mut random = oorandom::Rand64::new(u128::from(seed) + 100);
        for round in 0..400 {
            let rays = tile(&mut random, side);
            // Every brick is below this footprint.
            let all = Footprint { width: f64::INFINITY, growth: 0.0 };
            let expected: Vec<Vec<([i32; 3], f64, u64)>> = rays
                .iter()
                .map(|ray| {
                    let mut bricks = Vec::new();
                    dag.cast_footprint(ray, all, |hit| {
                        bricks.push((hit.voxel, hit.t(), hit.brick_ordinal()));
                        Next::Brick
                    });
                    bricks
                })
                .collect();
            needed += expected.iter().map(|bricks| bricks.len() as u64).sum::<u64>();
            for instructions in Instructions::available() {
                let caster = RayCaster::new(dag).with_instructions(instructions);
                let mut packet = RayPacket::default();
                // To the end, then with rays that are stopped at some of their bricks.
                for stops in [false, true] {
                    let mut met = vec![Vec::new(); rays.len()];
                    let mut ended = vec![f64::INFINITY; rays.len()];
                    let mut visits_of = std::collections::BTreeMap::new();
                    packet.fill(rays.iter().copied());
                    caster.cast_bricks(&mut packet, |brick, ends| {
                        // Once for each octant, those rays apart that go alone.
                        if brick.rays.count_ones() > 1 {
                            let visits = visits_of.entry(brick.corner).or_insert(0u32);
                            *visits += 1;
                            assert!(*visits <= 8, "seed {seed} round {round}: {:?}", brick.corner);
                        }
                        for (i, expected) in expected.iter().enumerate() {
                            if brick.rays >> i & 1 == 0 {
                                continue;
                            }
                            met[i].push(brick.corner);
                            let Some(&(_, t, ordinal)) = expected.iter().find(|e| e.0 == brick.corner) else {
                                continue;
                            };
                            assert_eq!(brick.ordinal(), ordinal);
                            assert_eq!(
                                Some((ordinal, brick.mask())),
                                dag.brick_at(brick.corner.map(|c| c + 1))
                            );
                            if stops && next(brick.corner, 4) == Next::End {
                                ends.shorten(i, t);
                                ended[i] = ended[i].min(t);
                            }
                        }
                    });
                    by_several_octants += visits_of.values().filter(|&&visits| visits > 1).count();
                    for (i, ray) in rays.iter().enumerate() {
                        let place = || {
                            format!(
                                "seed {seed} round {round} 2^{log2} {instructions:?} stops {stops} ray {i}: {ray:?}"
                            )
                        };
                        // In order, and none missing.
                        let mut at = met[i].iter();
                        for (corner, t, _) in expected[i].iter().filter(|e| e.1 <= ended[i]) {
                            assert!(at.any(|m| m == corner), "{corner:?} at {t} is missing, {}", place());
                        }
                        let mut unique = met[i].clone();
                        unique.sort_unstable();
                        unique.dedup();
                        assert_eq!(unique.len(), met[i].len(), "a brick comes twice, {}", place());
                        for &corner in &met[i] {
                            let margin = side / f64::from(1 << 17);
                            assert!(passes_near(ray, corner, margin), "{corner:?} is far off, {}", place());
                        }
                        let count = met[i].len() as u64;
                        if stops { visited_short += count } else { visited += count }
                    }
                }
            }
        }
    }
    let sets = Instructions::available().len() as u64;
    println!("{needed} bricks, {} visited, {} with stops", visited / sets, visited_short / sets);
    assert!(by_several_octants > 0, "no packet across an axis met a brick");
    assert!(needed > 20_000, "too few bricks to mean anything: {needed}");
    assert!(visited < sets * (needed + needed / 20), "{visited} visited for {sets} times {needed}");
    assert!(2 * visited_short < visited, "rays that end early go on: {visited_short} of {visited}");
}
