//! Rays against every voxel they cross, by f64 slab tests over all occupied voxels.

mod common;

use common::{Soup, random_ray, random_soup, unit_grid};
use glam::DVec3;
use voxsight_voxel::dag::DagRef;
use voxsight_voxel::raycast::{Footprint, GridRay, Instructions, Next, RayCaster, RayPacket};
use voxsight_voxel::voxelize::voxelize;

/// A voxel crossed by more than this must be found (voxels).
const TOLERANCE: f64 = 1.0 / 1024.0;

/// The interval of `t` in which the ray is inside the voxel's box shrunk by `shrink`.
fn slab(ray: &GridRay, voxel: [i32; 3], shrink: f64) -> Option<(f64, f64)> {
    let (mut t_in, mut t_out) = (ray.t_min, ray.t_max);
    for (k, &cell) in voxel.iter().enumerate() {
        let (low, high) = (f64::from(cell) + shrink, f64::from(cell + 1) - shrink);
        let (o, d) = (ray.origin[k], ray.direction[k]);
        if d == 0.0 {
            if o < low || o > high {
                return None;
            }
        } else {
            let (a, b) = ((low - o) / d, (high - o) / d);
            t_in = t_in.max(a.min(b));
            t_out = t_out.min(a.max(b));
        }
    }
    (t_in <= t_out).then_some((t_in, t_out))
}

fn occupied(dag: &DagRef) -> Vec<[i32; 3]> {
    let mut voxels = Vec::new();
    dag.for_each_brick(|corner, _, mask| {
        for bit in (0..64).filter(|bit| mask >> bit & 1 == 1) {
            voxels.push([corner[0] + (bit & 3), corner[1] + (bit >> 2 & 3), corner[2] + (bit >> 4)]);
        }
    });
    voxels
}

#[test]
fn no_crossed_voxel_is_passed_and_none_is_made_up() {
    let mut hits = 0u64;
    for seed in 0..5 {
        let log2 = 6 + (seed % 2) as u32;
        let voxels = voxelize(&unit_grid(log2), &random_soup(seed, log2, 24)).unwrap();
        let dag = voxels.dag.view();
        let occupied = occupied(&dag);
        let mut random = oorandom::Rand64::new(seed.into());
        for round in 0..2500 {
            let ray = random_ray(&mut random, f64::from(1 << log2));
            // Far away, the ray itself is only known to so many digits.
            let blur = TOLERANCE + ray.origin.abs().max_element() * 1e-15;
            let mut found = Vec::new();
            let mut last_t = f64::NEG_INFINITY;
            dag.cast(&ray, |hit| {
                assert!(hit.t() >= last_t, "seed {seed} round {round}: {ray:?} goes back");
                last_t = hit.t();
                let (ordinal, mask) = dag.brick_at(hit.voxel).unwrap();
                assert_eq!((hit.brick_ordinal(), hit.brick_mask()), (ordinal, mask));
                assert!(mask >> hit.bit() & 1 == 1);
                let grown = slab(&ray, hit.voxel, -blur);
                assert!(grown.is_some(), "seed {seed} round {round}: {ray:?} does not cross {:?}", hit.voxel);
                found.push(hit.voxel);
                Next::Voxel
            });
            hits += found.len() as u64;
            found.sort_unstable();
            assert!(found.windows(2).all(|w| w[0] != w[1]), "seed {seed} round {round}: a voxel twice");
            for voxel in &occupied {
                if slab(&ray, *voxel, blur).is_some() {
                    assert!(
                        found.binary_search(voxel).is_ok(),
                        "seed {seed} round {round}: {ray:?} passed {voxel:?}"
                    );
                }
            }
        }
    }
    assert!(hits > 10_000, "too few hits to mean anything: {hits}");
}

#[test]
fn a_walk_past_bricks_meets_each_brick_once_and_all_of_them() {
    let voxels = voxelize(&unit_grid(7), &random_soup(2, 7, 24)).unwrap();
    let dag = voxels.dag.view();
    let mut random = oorandom::Rand64::new(2);
    let mut met = 0;
    for round in 0..2000 {
        let ray = random_ray(&mut random, 128.0);
        let mut all: Vec<u64> = Vec::new();
        dag.cast(&ray, |hit| {
            all.push(hit.brick_ordinal());
            Next::Voxel
        });
        let mut skipping: Vec<u64> = Vec::new();
        dag.cast(&ray, |hit| {
            skipping.push(hit.brick_ordinal());
            Next::Brick
        });
        all.dedup();
        assert_eq!(skipping, all, "seed 2, round {round}: {ray:?}");
        met += all.len();
    }
    assert!(met > 600, "too few bricks to mean anything: {met}");
}

#[test]
fn a_ray_is_clipped_to_its_interval() {
    let voxels = voxelize(&unit_grid(6), &random_soup(3, 6, 7)).unwrap();
    let dag = voxels.dag.view();
    let mut random = oorandom::Rand64::new(3);
    let mut clipped = 0;
    for _ in 0..2000 {
        let ray = random_ray(&mut random, 64.0);
        let Some((_, t)) = dag.first_hit(&ray) else { continue };
        if t <= 0.0 {
            continue;
        }
        assert!(dag.first_hit(&GridRay { t_max: t * (1.0 - 1e-9), ..ray }).is_none());
        assert_eq!(
            dag.first_hit(&GridRay { t_max: t * (1.0 + 1e-9), ..ray }).map(|hit| hit.0),
            dag.first_hit(&ray).map(|h| h.0)
        );
        clipped += 1;
    }
    assert!(clipped > 200, "{clipped}");
}

#[test]
fn a_start_that_underflows_on_the_border_is_the_same_for_every_path() {
    // A corner that fills the first voxel.
    let corner = Soup(vec![vec![[[0, 0, 0], [200, 0, 0], [0, 200, 200]]]]);
    let voxels = voxelize(&unit_grid(6), &corner).unwrap();
    let dag = voxels.dag.view();
    assert!(dag.is_occupied([0, 0, 0]));
    let tiny = f64::from_bits(1);
    let footprints = [Footprint::default(), Footprint { width: 6.0, growth: 0.0 }];
    for (x, y, z) in [(tiny, 1e-136, 1e-139), (1e-136, tiny, 0.5), (0.5, 0.25, tiny), (tiny, tiny, tiny)] {
        for signs in 0..8 {
            let sign = |k: u32| if signs >> k & 1 == 1 { -1.0 } else { 1.0 };
            let direction = DVec3::new(262.0 * sign(0), 361.0 * sign(1), 359.0 * sign(2));
            let ray = GridRay::new(DVec3::new(x, y, z), direction);
            for footprint in footprints {
                let mut expected = Vec::new();
                dag.cast_footprint(&ray, footprint, |hit| {
                    expected.push((hit.voxel, hit.whole_brick));
                    Next::Voxel
                });
                for instructions in Instructions::available() {
                    let caster =
                        RayCaster::new(dag).with_instructions(instructions).with_footprint(footprint);
                    let mut found = [Vec::new(), Vec::new(), Vec::new()];
                    caster.cast(&ray, |hit| {
                        found[0].push((hit.voxel, hit.whole_brick));
                        Next::Voxel
                    });
                    caster.cast_batch(&[ray], |_, hit| {
                        found[1].push((hit.voxel, hit.whole_brick));
                        Next::Voxel
                    });
                    let mut packet = RayPacket::default();
                    packet.fill([ray]);
                    caster.cast_packet(&mut packet, |_, hit| {
                        found[2].push((hit.voxel, hit.whole_brick));
                        Next::Voxel
                    });
                    for met in &found {
                        assert_eq!(*met, expected, "{ray:?}, {instructions:?}, {footprint:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn rays_that_are_none_hit_nothing() {
    let voxels = voxelize(&unit_grid(6), &random_soup(3, 6, 7)).unwrap();
    let dag = voxels.dag.view();
    let inside = DVec3::splat(20.0);
    let good: Vec<GridRay> =
        (0..64).map(|i| GridRay::new(inside, DVec3::new(1.0, 0.01 * f64::from(i + 1), 0.4))).collect();
    let expected: Vec<_> = good.iter().map(|ray| dag.first_hit(ray).map(|hit| hit.0)).collect();
    assert!(expected.iter().flatten().count() > 10);
    let plain = GridRay::new(inside, DVec3::new(1.0, 0.2, 0.4));
    for none in [
        GridRay::new(inside, DVec3::ZERO),
        GridRay::new(inside, DVec3::NAN),
        GridRay::new(DVec3::NAN, DVec3::X),
        GridRay::new(inside, DVec3::INFINITY),
        GridRay::new(DVec3::INFINITY, DVec3::NEG_ONE),
        // One bad component among good ones.
        GridRay::new(inside, DVec3::new(f64::NAN, -1.0, 2.0)),
        GridRay::new(inside, DVec3::new(-1.0, 2.0, f64::NAN)),
        GridRay::new(inside, DVec3::new(1.0, f64::NEG_INFINITY, 2.0)),
        GridRay::new(DVec3::new(f64::NAN, 20.0, 20.0), DVec3::X),
        GridRay { t_min: f64::NAN, ..plain },
        GridRay { t_max: f64::NAN, ..plain },
        GridRay { t_min: f64::INFINITY, ..plain },
        GridRay { t_min: 2.0, t_max: 1.0, ..plain },
        GridRay { t_max: -1.0, ..plain },
    ] {
        assert_eq!(dag.first_hit(&none), None, "{none:?}");
        for instructions in Instructions::available() {
            let caster = RayCaster::new(dag).with_instructions(instructions);
            caster.cast(&none, |hit| panic!("{none:?} hit {:?}", hit.voxel));
            // In any lane of a packet, and in a batch, it leaves the others alone.
            for lane in 0..64 {
                let mut rays = good.clone();
                rays[lane] = none;
                let mut expected = expected.clone();
                expected[lane] = None;
                let mut found = vec![None; 64];
                let mut packet = RayPacket::default();
                packet.fill(rays.iter().copied());
                caster.cast_packet(&mut packet, |ray, hit| {
                    found[ray] = Some(hit.voxel);
                    Next::End
                });
                assert_eq!(found, expected, "packet, {instructions:?}, lane {lane}: {none:?}");
                found.fill(None);
                caster.cast_batch(&rays, |ray, hit| {
                    found[ray] = Some(hit.voxel);
                    Next::End
                });
                assert_eq!(found, expected, "batch, {instructions:?}, lane {lane}: {none:?}");
            }
        }
    }
}
