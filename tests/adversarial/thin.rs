//! Wires, sheets and specks far below a voxel or a pixel.

use glam::{DAffine3, DQuat, DVec2, DVec3, EulerRot};

use crate::common::Random;
use crate::common::cameras::cameras;
use crate::shapes::{block, rod, wall};
use crate::trial::{Maker, parallel, perspective};

#[test]
fn wires_and_sheets_far_below_a_voxel_are_found_where_rays_meet_them() {
    for (seed, thickness) in [(1, 1e-2), (2, 1e-4), (3, 1e-7), (4, 0.0)] {
        let mut random = Random::new(seed);
        let mut maker = Maker::default();
        maker.add(wall(DVec2::splat(-12.0), DVec2::splat(12.0), -4.0));
        for _ in 0..60 {
            maker.add(rod(random.vector() * 8.0, random.vector() * 8.0, thickness));
        }
        for _ in 0..40 {
            let (at, angles) = (random.vector() * 8.0, random.vector() * 3.0);
            let half = DVec3::new(0.2 + random.unit(), 0.2 + random.unit(), thickness);
            let turn = DQuat::from_euler(EulerRot::XYZ, angles.x, angles.y, angles.z);
            // A voxel is about 0.4 at first.
            let sheet = if thickness > 0.0 {
                block(-half, half)
            } else {
                wall(-half.truncate(), half.truncate(), 0.0)
            };
            let sheet = maker.part(sheet);
            maker.place(sheet, DAffine3::from_rotation_translation(turn, at));
        }
        let mut trial = maker.on_trial([6, 8][seed as usize % 2]);
        let (mut wires, mut sheets) = (0, 0);
        for camera in cameras(&trial.loaded, (97, 61)) {
            let answers = trial.look(&format!("seed {seed}, {thickness} thick"), &camera);
            wires += (1..61).filter(|&wire| answers.dense.samples[wire] > 0).count();
            sheets += (61..101).filter(|&sheet| answers.samples(sheet) > 0).count();
        }
        trial.assert_threads_do_not_matter(&cameras(&trial.loaded, (97, 61))[0]);
        assert!(
            sheets > 60 && (wires > 60 || thickness < 1e-2),
            "seed {seed}: {wires} wires, {sheets} sheets"
        );
    }
}

#[test]
fn a_wire_in_a_free_view_is_found_by_its_voxels_where_all_rays_miss_it() {
    // So thin that no ray hits it; no other part within two voxels.
    let mut maker = Maker::default();
    maker.add(wall(DVec2::splat(-10.0), DVec2::splat(10.0), -5.0));
    let wire = maker.add(rod(DVec3::new(-6.0, -3.1, 1.0), DVec3::new(6.1, 3.3, 2.0), 1e-6));
    let mut trial = maker.on_trial(6);
    for camera in [
        perspective(DVec3::new(1.0, 2.0, 15.0), DVec3::ZERO, 50.0, (64, 48)),
        parallel(DVec3::new(1.0, 2.0, 15.0), DVec3::ZERO, 20.0, (64, 48)),
    ] {
        let answers = trial.look("wire", &camera);
        assert_eq!((answers.samples(wire), answers.dense.samples[wire]), (0, 0));
        assert!(answers.of("voxel").samples[wire] > 20, "a voxel is as wide as a pixel");
        // They lack nothing that a ray meets; that nothing is in front of its box is enough for these.
        for method in ["hzm", "hzb", "hzb to the last pixel", "frustum"] {
            assert!(answers.of(method).visible[wire], "{method}");
        }
    }
}

#[test]
fn a_part_below_a_pixel_is_found_by_the_ray_that_meets_it() {
    let mut random = Random::new(6);
    for round in 0..12 {
        // The ray of one pixel, and a cube of a twentieth of a pixel on it.
        let size = [(31, 31), (64, 48), (1, 1), (7, 130)][round % 4];
        let eye = random.vector() * 5.0 + DVec3::new(0.0, 0.0, 30.0);
        let target = random.vector();
        let camera = if round % 3 == 0 {
            parallel(eye, target, 10.0, size)
        } else {
            perspective(eye, target, 30.0, size)
        };
        let rays = camera.rays().unwrap();
        let at = (f64::from(random.below(size.0)) + 0.5, f64::from(random.below(size.1)) + 0.5);
        let ray = rays.ray(at.0, at.1);
        let place = ray.at(25.0);
        let half = 0.025 * rays.pixel_at(25.0);
        let mut maker = Maker::default();
        let speck = maker.add(block(place - half, place + half));
        maker.add(wall(DVec2::splat(-40.0), DVec2::splat(40.0), -10.0));
        // As small, right behind it.
        let (behind, quarter) = (ray.at(25.5), 0.25 * half);
        let hidden = maker.add(block(behind - quarter, behind + quarter));
        let mut trial = maker.on_trial(7);
        let name = format!("seed 6, round {round}, pixel {at:?} of {size:?}");
        let answers = trial.look(&name, &camera);
        answers.assert_all_see(speck, &name);
        assert_eq!((answers.samples(speck), answers.samples(hidden)), (1, 0), "{name}");
    }
}
