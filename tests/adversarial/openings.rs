//! Holes, gratings and gaps in what hides.

use glam::{DAffine3, DQuat, DVec2, DVec3};
use voxsight::camera::{Camera, CameraRays};

use crate::common::Random;
use crate::shapes::{block, joined, wall, wall_with_hole};
use crate::trial::{Maker, parallel, perspective};

/// Where the ray through a point of the image meets the plane z.
fn on_plane(rays: &CameraRays, x: f64, y: f64, z: f64) -> DVec3 {
    let ray = rays.ray(x, y);
    ray.at((z - ray.origin.z) / ray.direction.z)
}

/// Looking at the plane z = 0 from 10 away, a little askew.
fn both_projections(size: (u32, u32)) -> [Camera; 2] {
    let eye = DVec3::new(1.0, 0.5, 10.0);
    [perspective(eye, DVec3::ZERO, 50.0, size), parallel(eye, DVec3::ZERO, 9.0, size)]
}

#[test]
fn an_opening_at_the_edge_of_the_screen_shows_what_is_behind_it() {
    let mut free = 0;
    for size in [(61, 47), (33, 64), (257, 21)] {
        for camera in both_projections(size) {
            let rays = camera.rays().unwrap();
            let (right, bottom) = (f64::from(size.0), f64::from(size.1));
            for (x, y) in [(0.0, 0.5), (1.0, 0.5), (0.5, 0.0), (0.5, 1.0), (0.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
            {
                // Two pixels and a half to either side of a point of the border: half of it is beyond the screen.
                let (x, y) = (x * right, y * bottom);
                let corners = [(-2.5, -2.5), (2.5, -2.5), (2.5, 2.5), (-2.5, 2.5)]
                    .map(|(dx, dy)| on_plane(&rays, x + dx, y + dy, 0.0));
                let min = corners.into_iter().reduce(DVec3::min).unwrap().truncate();
                let max = corners.into_iter().reduce(DVec3::max).unwrap().truncate();
                let half_size = 0.1 * (max - min).max_element();
                let behind = on_plane(&rays, x.clamp(1.0, right - 1.0), y.clamp(1.0, bottom - 1.0), -3.0);
                let beside = on_plane(&rays, 0.5 * right, 0.5 * bottom, -3.0);
                // The widest view ends far to the side.
                let half = if size.0 > 8 * size.1 { 400.0 } else { 60.0 };
                let mut maker = Maker::default();
                let panel = maker.add(wall_with_hole(half, min, max, 0.0));
                let part = maker.add(block(behind - 4.0 * half_size, behind + 4.0 * half_size));
                let hidden = maker.add(block(beside - half_size, beside + half_size));
                let mut trial = maker.on_trial(10);
                let name = format!("opening at {x} {y} of {size:?}, {:?}", camera.projection);
                let answers = trial.look(&name, &camera);
                answers.assert_all_see(panel, &name);
                // `voxel` promises it where the rays pass the panel by more than two voxels.
                let is_free = (max - min).min_element() > 6.0 * trial.loaded.query().grid.voxel_size;
                free += u32::from(is_free);
                answers.assert_all_but_see(if is_free { &[] } else { &["voxel"] }, part, &name);
                for method in ["exact", "voxel", "hzb", "hzb to the last pixel", "hzm with all occluders"] {
                    assert!(!answers.of(method).visible[hidden], "{name}: {method} is blind to the panel");
                }
            }
        }
    }
    assert!(free > 10, "{free}");
}

#[test]
fn what_shows_through_a_slit_between_two_centres_is_lost_to_depth_images_alone() {
    // Not promised, see `occlusion`: this says where the promise ends.
    let camera = parallel(DVec3::new(0.0, 0.0, 10.0), DVec3::ZERO, 64.0, (64, 64));
    let mut maker = Maker::default();
    // Pixels are units, their centres halves: a slit from 0.1 below to 0.1 above a border of pixels.
    let slit = (DVec2::new(-20.0, -0.1), DVec2::new(20.0, 0.1));
    maker.add(wall_with_hole(40.0, slit.0, slit.1, 0.0));
    let part = maker.add(block(DVec3::new(-10.0, -3.0, -5.0), DVec3::new(10.0, 3.0, -3.0)));
    let mut trial = maker.on_trial(9);
    let answers = trial.look("slit", &camera);
    assert!(answers.samples(part) == 0 && answers.dense.samples[part] > 10);
    assert!(!answers.shown_by(part).contains(&"hzb to the last pixel"), "the promise may say more");
}

#[test]
fn gratings_are_seen_through_from_the_front_and_edge_on() {
    let mut random = Random::new(2);
    let mut seen = 0;
    for round in 0..4 {
        // Slats, turned about their length; from a third of a pixel apart to several.
        let pitch = [0.05, 0.17, 0.4, 1.1][round % 4];
        let tilt = DQuat::from_rotation_y(random.unit() * std::f64::consts::PI);
        let is_one_part = round % 2 == 0;
        let mut maker = Maker::default();
        let half = DVec3::new(0.02, 5.0, 0.3) * DVec3::new(pitch, 1.0, pitch);
        let slats: Vec<DAffine3> = (-(5.0 / pitch) as i32..=(5.0 / pitch) as i32)
            .map(|i| DAffine3::from_rotation_translation(tilt, DVec3::new(f64::from(i) * pitch, 0.0, 0.0)))
            .collect();
        if is_one_part {
            let slat = || block(-half, half);
            maker.add(joined(slats.iter().map(|&at| crate::shapes::placed(slat(), at))));
        } else {
            let slat = maker.part(block(-half, half));
            slats.iter().for_each(|&at| {
                maker.place(slat, at);
            });
        }
        let behind = maker.add(block(DVec3::new(-3.0, -3.0, -4.0), DVec3::new(3.0, 3.0, -3.0)));
        maker.add(wall(DVec2::splat(-8.0), DVec2::splat(8.0), -6.0));
        let mut trial = maker.on_trial(8);
        for (from, is_front) in
            [(DVec3::new(0.3, 0.2, 12.0), true), (tilt * DVec3::Z * 12.0, true), (DVec3::X * 14.0, false)]
        {
            for camera in
                [perspective(from, DVec3::ZERO, 40.0, (61, 47)), parallel(from, DVec3::ZERO, 9.0, (61, 47))]
            {
                let name = format!("seed 2, round {round}, pitch {pitch}, from {from}");
                let answers = trial.look(&name, &camera);
                seen += u32::from(is_front && answers.samples(behind) > 0);
            }
        }
    }
    assert!(seen >= 8, "only {seen} views through the gratings");
}

#[test]
fn a_giant_part_with_a_hole_shows_what_is_inside_of_it() {
    for log2 in [7, 9] {
        let mut maker = Maker::default();
        let side = |from: [f64; 3], to: [f64; 3]| block(from.into(), to.into());
        // A box around everything, open in the middle of its front: the other parts lie within its bounds.
        let giant = maker.add(joined([
            wall_with_hole(50.0, DVec2::splat(-3.0), DVec2::splat(3.0), 50.0),
            side([-50.0, -50.0, -51.0], [50.0, 50.0, -50.0]),
            side([-51.0, -50.0, -50.0], [-50.0, 50.0, 50.0]),
            side([50.0, -50.0, -50.0], [51.0, 50.0, 50.0]),
            side([-50.0, -51.0, -50.0], [50.0, -50.0, 50.0]),
            side([-50.0, 50.0, -50.0], [50.0, 51.0, 50.0]),
        ]));
        let shown = maker.add(block(DVec3::splat(-2.0), DVec3::splat(2.0)));
        let hidden = maker.add(block(DVec3::new(30.0, 30.0, -2.0), DVec3::new(34.0, 34.0, 2.0)));
        let mut trial = maker.on_trial(log2);
        let eye = DVec3::new(0.0, 0.0, 120.0);
        for camera in [
            perspective(eye, DVec3::ZERO, 60.0, (97, 61)),
            perspective(eye, DVec3::new(10.0, 5.0, 50.0), 30.0, (64, 64)),
            parallel(eye, DVec3::ZERO, 110.0, (128, 128)),
        ] {
            let answers = trial.look("giant", &camera);
            answers.assert_all_see(giant, "giant");
            answers.assert_all_see(shown, "giant");
            assert_eq!(answers.samples(hidden), 0);
            assert!(!answers.of("hzb to the last pixel").visible[hidden]);
            trial.assert_threads_do_not_matter(&camera);
        }
    }
}
