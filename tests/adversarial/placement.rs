//! Far from the origin, mirrored, stretched.

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3, EulerRot};
use voxsight::camera::Camera;

use crate::common::cameras::cameras;
use crate::common::{Random, cuboid, sheet};
use crate::shapes::{block, wall};
use crate::trial::{Maker, Trial, parallel, perspective};

/// Blocks of 1 to 100 units on multiples of 1/8, moved by `offset`; the mesh of every other one is where the block is.
fn blocks(seed: u64, offset: DVec3) -> Trial {
    let mut random = Random::new(seed);
    let mut eighth = |most: u32| f64::from(random.below(8 * most)) / 8.0;
    let mut maker = Maker::default();
    for i in 0..80 {
        let most = [4, 20, 99][i % 3];
        let size = DVec3::new(eighth(most), eighth(most), eighth(most)) + 1.0;
        let at = DVec3::new(eighth(400), eighth(400), eighth(400)) - 200.0;
        if i % 2 == 0 {
            maker.add(block(offset + at, offset + at + size));
        } else {
            let part = maker.part(block(DVec3::ZERO, size));
            maker.place(part, DAffine3::from_translation(offset + at));
        }
    }
    maker.add(wall(offset.truncate() - 400.0, offset.truncate() + 400.0, offset.z - 250.0));
    maker.on_trial(8)
}

fn views(offset: DVec3) -> [Camera; 3] {
    let at = |x: f64, y: f64, z: f64| offset + DVec3::new(x, y, z);
    [
        perspective(at(60.0, 90.0, 700.0), at(0.0, 0.0, 0.0), 45.0, (97, 61)),
        perspective(at(10.0, -20.0, 150.0), at(40.0, 30.0, -50.0), 80.0, (61, 47)),
        parallel(at(100.0, 50.0, 600.0), at(0.0, 0.0, 0.0), 450.0, (97, 61)),
    ]
}

#[test]
fn a_scene_ten_million_units_away_looks_the_same() {
    for seed in [1, 2] {
        let mut near = blocks(seed, DVec3::ZERO);
        let here: Vec<_> =
            views(DVec3::ZERO).iter().map(|camera| near.look(&format!("seed {seed}"), camera)).collect();
        // Multiples of 1/8: every coordinate is exact, and so the answer is the same bit for bit.
        for offset in [DVec3::splat(1e7), DVec3::new(-1e7, 3e6, 1e7), DVec3::new(0.0, 16_777_216.0, 0.0)] {
            let mut far = blocks(seed, offset);
            for (camera, here) in views(offset).iter().zip(&here) {
                let there = far.look(&format!("seed {seed} at {offset}"), camera);
                for method in ["exact", "hybrid"] {
                    assert_eq!(there.of(method), here.of(method), "seed {seed} at {offset}: {method}");
                }
                assert_eq!(there.dense, here.dense);
                // Boxes are made wider with the distance: they may hide a little less.
                for method in ["hzm", "hzb", "hzb to the last pixel", "frustum"] {
                    let (there, here) = (there.of(method).visible_count(), here.of(method).visible_count());
                    assert!(there.abs_diff(here) <= 2, "seed {seed} at {offset}, {method}: {there} {here}");
                }
            }
        }
        // Elsewhere a coordinate is rounded by up to 2^-30 (at 1e7), and a part by half its step: hits move by no more.
        let offset = DVec3::new(1e7 + 0.1, -1e7 / 3.0, 1e7 / 7.0);
        let far = blocks(seed, offset);
        let (mut same, mut other) = (0u32, 0u32);
        for (there, here) in views(offset).iter().zip(views(DVec3::ZERO)) {
            let (there, here) = (there.rays().unwrap(), here.rays().unwrap());
            let (width, height) = here.size();
            for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
                let at = (f64::from(column) + 0.5, f64::from(row) + 0.5);
                let hit = |trial: &Trial, ray| {
                    let query = trial.loaded.query();
                    query.exact.closest(&ray, query.filter).map(|hit| (hit.drawable, hit.t))
                };
                match (hit(&far, there.ray(at.0, at.1)), hit(&near, here.ray(at.0, at.1))) {
                    (None, None) => same += 1,
                    (Some(there), Some(here)) if there.0 == here.0 && (there.1 - here.1).abs() < 1e-4 => {
                        same += 1
                    }
                    _ => other += 1,
                }
            }
        }
        println!("seed {seed}: {other} of {} pixels differ at {offset}", same + other);
        assert!(other <= 5, "seed {seed}: {other} pixels differ");
    }
}

#[test]
fn mirrored_and_strongly_stretched_parts_are_seen_as_they_are() {
    for seed in 1..=3 {
        let mut random = Random::new(seed);
        let mut maker = Maker::default();
        let parts =
            [maker.part(cuboid()), maker.part(sheet(8)), maker.part(wall(DVec2::ZERO, DVec2::ONE, 0.0))];
        for i in 0..90 {
            let power = |random: &mut Random| 10f64.powf(3.0 * random.vector().x);
            // From a thousandth to a thousand; the longest side is brought to about 4.
            let scale = DVec3::new(power(&mut random), power(&mut random), power(&mut random));
            let scale = scale * ((1.0 + 3.0 * random.unit()) / scale.max_element());
            let mirror = DVec3::new(
                if i & 1 == 0 { 1.0 } else { -1.0 },
                if i & 2 == 0 { 1.0 } else { -1.0 },
                if i & 4 == 0 { 1.0 } else { -1.0 },
            );
            let angles = random.vector() * 3.0;
            let turn = DQuat::from_euler(EulerRot::XYZ, angles.x, angles.y, angles.z);
            let mut matrix = DMat3::from_quat(turn) * DMat3::from_diagonal(scale * mirror);
            if i % 5 == 0 {
                // Sheared.
                matrix *= DMat3::from_cols(DVec3::X, DVec3::new(2.0, 1.0, 0.0), DVec3::Z);
            }
            maker.place(parts[i % 3], DAffine3::from_mat3_translation(matrix, random.vector() * 8.0));
        }
        let mut trial = maker.on_trial(8);
        let mut seen = 0;
        for camera in cameras(&trial.loaded, (97, 61)) {
            seen += trial.look(&format!("seed {seed}"), &camera).of("exact").visible_count();
        }
        trial.assert_threads_do_not_matter(&cameras(&trial.loaded, (97, 61))[2]);
        assert!(seen > 80, "seed {seed}: {seen}");
    }
}

#[test]
fn a_mirrored_wall_hides_as_well_as_one_that_is_not() {
    for scale in [DVec3::new(-6.0, 6.0, 0.1), DVec3::new(-6.0, -6.0, -0.001), DVec3::new(6.0, 6.0, 1e-5)] {
        let mut maker = Maker::default();
        let unit = maker.part(cuboid());
        maker.place(unit, DAffine3::from_scale(scale));
        let hidden = maker.place(unit, DAffine3::from_translation(DVec3::new(0.5, 0.0, -4.0)));
        let before = maker.place(unit, DAffine3::from_translation(DVec3::new(0.5, 0.0, 4.0)));
        let mut trial = maker.on_trial(7);
        for camera in [
            perspective(DVec3::new(0.0, 1.0, 20.0), DVec3::ZERO, 40.0, (97, 61)),
            parallel(DVec3::new(0.0, 1.0, 20.0), DVec3::ZERO, 14.0, (97, 61)),
        ] {
            let name = format!("wall scaled by {scale}");
            let answers = trial.look(&name, &camera);
            answers.assert_occluded(hidden, &name);
            answers.assert_all_see(before, &name);
        }
    }
}
