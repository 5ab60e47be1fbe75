//! Of the navigator as a whole: projections, errors, and scenes far from the world's origin.

use glam::{DVec2, DVec3};

use super::testing::{Boxes, Random, SIZE, block, navigator, pixel};
use super::*;

/// A point of map coordinates.
const FAR: DVec3 = DVec3::new(1e7, -3e6, 2e7);

#[test]
fn a_new_navigator_sees_all_of_the_scene_at_60_degrees() {
    for up in [DVec3::Y, DVec3::Z] {
        let navigator = navigator(FAR, up);
        let camera = navigator.camera(SIZE);
        assert_eq!(camera.projection, Projection::Perspective { fov_y_deg: 60.0 });
        for i in 0..8 {
            let sign = |bit: i32| if i & bit == 0 { -50.0 } else { 50.0 };
            let at = pixel(&navigator, FAR + DVec3::new(sign(1), sign(2), sign(4)));
            assert!((0.0..640.0).contains(&at.x) && (0.0..480.0).contains(&at.y), "{at}");
        }
        assert!((DVec3::from(camera.eye) - FAR).dot(up) > 0.0, "from above");
    }
    assert!(navigator(FAR, DVec3::Y).camera((0, 0)).width == 0, "a minimised window has no picture");
}

#[test]
fn bad_scenes_are_refused_with_a_reason() {
    let new = |min: DVec3, up: DVec3, unit: f64| Navigator::new(min, DVec3::ONE, up, unit).unwrap_err();
    assert!(new(DVec3::ONE * 2.0, DVec3::Y, 1.0).to_string().contains("min must not be above max"));
    assert!(matches!(new(DVec3::NAN, DVec3::Y, 1.0), NavigateError::Bounds { .. }));
    assert!(new(DVec3::ZERO, DVec3::ZERO, 1.0).to_string().contains("up must be"));
    assert!(new(DVec3::ZERO, DVec3::Y, 0.0).to_string().contains("metres per model unit"));
    let mut point = Navigator::new(DVec3::ONE, DVec3::ONE, DVec3::Y, 1.0).unwrap();
    assert!(point.camera(SIZE).rays().is_ok(), "a single point is a scene");
    assert!(point.set_fov_y_deg(180.0).is_err() && point.set_fov_y_deg(35.0).is_ok());
    assert_eq!(point.camera(SIZE).projection, Projection::Perspective { fov_y_deg: 35.0 });
}

#[test]
fn changing_the_projection_keeps_what_is_at_the_pivots_depth() {
    let mut random = Random::new(51);
    for round in 0..300 {
        let mut navigator = navigator(DVec3::ZERO, DVec3::Z);
        navigator.set_fov_y_deg(20.0 + 80.0 * random.unit()).unwrap();
        navigator.orbit(random.vector().truncate() * 500.0, SIZE);
        navigator.set_pivot(random.vector() * 40.0);
        navigator.bring_pivot_ahead();
        let aside = random.vector() * 20.0;
        let forward = navigator.pose.forward();
        let point = navigator.pivot() + aside - aside.dot(forward) * forward;
        let before = pixel(&navigator, point);
        for is_parallel in [true, false, true] {
            navigator.set_parallel(is_parallel);
            assert_eq!(navigator.is_parallel(), is_parallel);
            assert!(pixel(&navigator, point).distance(before) < 1e-6, "seed 51, round {round}");
        }
        // After a zoom in the parallel view the perspective comes as near.
        let ray = navigator.camera(SIZE).rays().unwrap().ray(320.0, 240.0);
        navigator.zoom(3.0, &ray, None);
        let zoomed = pixel(&navigator, point);
        navigator.set_parallel(false);
        assert!(pixel(&navigator, point).distance(zoomed) < 1e-6, "seed 51, round {round}");
    }
}

/// One random motion of any kind, the same for scenes that differ only in their centre.
fn move_somehow(navigator: &mut Navigator, random: &mut Random, centre: DVec3, world: &Boxes) {
    let drag = random.vector().truncate() * 60.0;
    let cursor = DVec2::new(random.unit() * 640.0, random.unit() * 480.0);
    let motion = Motion { forward: random.unit(), right: random.unit(), ..Motion::default() };
    let point = centre + random.vector() * 30.0;
    match (random.unit() * 9.0) as u32 {
        0 => navigator.orbit(drag, SIZE),
        1 => navigator.pan(drag, SIZE),
        2 => {
            let ray = navigator.camera(SIZE).rays().unwrap().ray(cursor.x, cursor.y);
            navigator.zoom(4.0 * random.unit() - 2.0, &ray, Some(10.0 + 20.0 * random.unit()));
        }
        3 => navigator.look(drag, SIZE),
        4 => navigator.set_pivot(point),
        5 => navigator.set_parallel(random.unit() < 0.3),
        6 => {
            navigator.frame_box(point - 3.0, point + 5.0, SIZE, 0.5).unwrap();
            (0..20).for_each(|_| navigator.advance(0.02));
        }
        7 => {
            navigator.set_mode(Mode::Fly);
            (0..5).for_each(|_| navigator.step(0.02, &motion, world));
        }
        _ => {
            navigator.set_mode(Mode::Walk);
            (0..5).for_each(|_| navigator.step(0.02, &motion, world));
        }
    }
}

#[test]
fn a_scene_far_from_the_origin_moves_as_one_at_it() {
    let world = |centre: DVec3| {
        let ground = block((-50.0, 50.0), (-50.0, -20.0), (-50.0, 50.0));
        let pillar = block((-4.0, 4.0), (-20.0, 20.0), (-4.0, 4.0));
        Boxes([ground, pillar].map(|(min, max)| (centre + min, centre + max)).to_vec())
    };
    let (world_near, world_far) = (world(DVec3::ZERO), world(FAR));
    for seed in 0..40 {
        let (mut near, mut far) = (navigator(DVec3::ZERO, DVec3::Y), navigator(FAR, DVec3::Y));
        let (mut random_near, mut random_far) = (Random::new(seed), Random::new(seed));
        let mut points = Random::new(1000 + seed);
        for step in 0..60 {
            move_somehow(&mut near, &mut random_near, DVec3::ZERO, &world_near);
            move_somehow(&mut far, &mut random_far, FAR, &world_far);
            for _ in 0..10 {
                let ahead = near.pose.eye + (20.0 + 60.0 * points.unit()) * near.pose.forward();
                // On the grid of what f64 holds out there, so that both scenes have the very same point.
                let point = (FAR + ahead + 5.0 * points.vector()) - FAR;
                let apart = pixel(&near, point).distance(pixel(&far, FAR + point));
                assert!(apart < 1e-3, "seed {seed}, step {step}: {apart} pixels");
            }
        }
    }
}
