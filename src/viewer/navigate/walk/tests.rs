//! Walking among boxes.

use super::super::testing::{Boxes, Random, block, navigator};
use super::super::{Mode, Side};
use super::*;

const FRAME: f64 = 1.0 / 60.0;
const AHEAD: Motion = Motion { forward: 1.0, right: 0.0, up: 0.0, hurry: 1.0 };

/// Someone at a place whose feet are at a height, looking along -Z, Y up.
fn walker(x: f64, feet: f64, z: f64) -> Navigator {
    let mut navigator = navigator(DVec3::ZERO, DVec3::Y);
    navigator.look_from(Side::FRONT, 0.0);
    navigator.set_mode(Mode::Walk);
    navigator.pose.eye = DVec3::new(x, feet + 1.7, z);
    navigator
}

fn feet(navigator: &Navigator) -> f64 {
    navigator.pose.eye.y - 1.7
}

/// Ground at height 0, and boxes on it.
fn ground_and(boxes: &[(DVec3, DVec3)]) -> Boxes {
    let ground = block((-45.0, 45.0), (-1.0, 0.0), (-45.0, 45.0));
    Boxes(boxes.iter().copied().chain([ground]).collect())
}

fn walk(navigator: &mut Navigator, seconds: f64, motion: Motion, world: &Boxes) {
    (0..(seconds / FRAME).round() as u32).for_each(|_| navigator.step(FRAME, &motion, world));
}

#[test]
fn who_walks_falls_by_gravity_and_stands_at_eye_height() {
    let world = ground_and(&[]);
    let mut navigator = walker(3.0, 20.0, 4.0);
    walk(&mut navigator, 1.0, Motion::default(), &world);
    assert!((feet(&navigator) - (20.0 - 0.5 * 9.81)).abs() < 1e-9, "{}", feet(&navigator));
    walk(&mut navigator, 3.0, Motion::default(), &world);
    assert!(feet(&navigator).abs() < 1e-5, "{}", feet(&navigator));
    let standing = navigator.pose;
    walk(&mut navigator, 1.0, Motion::default(), &world);
    assert_eq!(navigator.pose, standing);
    // The same fall at another rate of frames.
    let mut slow = walker(3.0, 20.0, 4.0);
    (0..10).for_each(|_| slow.step(0.1, &Motion::default(), &world));
    assert!((feet(&slow) - (20.0 - 0.5 * 9.81)).abs() < 1e-9, "{}", feet(&slow));
}

#[test]
fn lengths_are_in_model_units() {
    let millimetres = Navigator::new(DVec3::splat(-50e3), DVec3::splat(50e3), DVec3::Y, 0.001).unwrap();
    assert!((millimetres.body.eye_height - 1700.0).abs() < 1e-9);
    assert!((millimetres.body.radius - 300.0).abs() < 1e-9);
    assert!([0.0, -1.0, f64::NAN, f64::INFINITY].into_iter().all(|unit| Body::person(unit).is_none()));
}

#[test]
fn looking_up_or_down_walks_level_and_as_fast() {
    let world = ground_and(&[]);
    for pitch in [-1.5, 0.0, 1.2] {
        let mut navigator = walker(0.0, 0.0, 0.0);
        let aim = super::super::pose::Aim { heading: 0.0, pitch };
        navigator.pose.world_from_view = navigator.compass.orientation(aim);
        walk(&mut navigator, 2.0, AHEAD, &world);
        assert!(navigator.pose.eye.distance(DVec3::new(0.0, 1.7, -3.2)) < 1e-6, "{}", navigator.pose.eye);
    }
}

#[test]
fn steps_are_climbed_up_to_the_step_height_and_no_further() {
    for (height, climbs) in [(0.1, true), (0.39, true), (0.43, false), (3.0, false)] {
        let world = ground_and(&[block((-5.0, 5.0), (-1.0, height), (-20.0, -2.0))]);
        let mut navigator = walker(0.0, 0.0, 0.0);
        walk(&mut navigator, 4.0, AHEAD, &world);
        let expected = if climbs { (height, -6.4) } else { (0.0, -1.7) };
        assert!((feet(&navigator) - expected.0).abs() < 1e-5, "{height}: {}", navigator.pose.eye);
        assert!((navigator.pose.eye.z - expected.1).abs() < 1e-6, "{height}: {}", navigator.pose.eye);
    }
}

#[test]
fn stairs_are_walked_up_and_down_without_falling_or_jumping() {
    let stair = |i: u32| {
        let start = -2.0 - 0.25 * f64::from(i);
        block((-5.0, 5.0), (-1.0, 0.2 * f64::from(i + 1)), (-20.0, start))
    };
    let world = ground_and(&(0..10).map(stair).collect::<Vec<_>>());
    let mut navigator = walker(0.0, 0.0, 0.0);
    for (motion, height) in [(AHEAD, 2.0), (Motion { forward: -1.0, ..AHEAD }, 0.0)] {
        for frame in 0..240 {
            let before = feet(&navigator);
            navigator.step(FRAME, &motion, &world);
            assert!((feet(&navigator) - before).abs() < 0.06 && navigator.fall_speed == 0.0, "frame {frame}");
        }
        assert!((feet(&navigator) - height).abs() < 1e-5, "{}", navigator.pose.eye);
    }
}

#[test]
fn walls_stop_and_are_slid_along_at_the_speed_that_they_leave() {
    let wall = ground_and(&[block((-40.0, 40.0), (0.0, 4.0), (-4.0, -2.0))]);
    let mut navigator = walker(0.0, 0.0, 0.0);
    walk(&mut navigator, 3.0, Motion { hurry: 5.0, ..AHEAD }, &wall);
    assert!(navigator.pose.eye.distance(DVec3::new(0.0, 1.7, -1.7)) < 1e-6, "{}", navigator.pose.eye);
    // At 45 degrees against it.
    walk(&mut navigator, 3.0, Motion { right: 1.0, ..AHEAD }, &wall);
    let way = 3.0 * 1.6 * 0.5f64.sqrt();
    assert!((navigator.pose.eye.x - way).abs() < 0.1 * way, "{}", navigator.pose.eye);
    assert!((-1.75..=-1.69).contains(&navigator.pose.eye.z), "{}", navigator.pose.eye);
}

#[test]
fn rails_stop_and_what_is_above_the_head_does_not() {
    for height in [0.5, 0.77, 1.1, 1.33, 1.62] {
        let rail = ground_and(&[block((-5.0, 5.0), (height, height + 0.04), (-2.05, -2.0))]);
        let mut navigator = walker(0.0, 0.0, 0.0);
        walk(&mut navigator, 4.0, AHEAD, &rail);
        assert!((-1.76..-1.5).contains(&navigator.pose.eye.z), "{height}: {}", navigator.pose.eye);
    }
    let beam = ground_and(&[block((-5.0, 5.0), (1.9, 2.4), (-3.0, -2.0))]);
    let mut navigator = walker(0.0, 0.0, 0.0);
    walk(&mut navigator, 4.0, AHEAD, &beam);
    assert!((navigator.pose.eye.z + 6.4).abs() < 1e-6, "{}", navigator.pose.eye);
}

#[test]
fn nobody_falls_out_of_the_world_and_edges_are_fallen_off() {
    let mut navigator = walker(0.0, 5.0, 0.0);
    walk(&mut navigator, 2.0, AHEAD, &Boxes::default());
    assert!((feet(&navigator) - 5.0).abs() < 1e-12, "no ground at all");
    // Ground below the scene's bounds, which end at -50.
    let deep = Boxes(vec![block((-40.0, 40.0), (-80.0, -70.0), (-40.0, 40.0))]);
    walk(&mut navigator, 2.0, AHEAD, &deep);
    assert!((feet(&navigator) - 5.0).abs() < 1e-12, "{}", navigator.pose.eye);
    let ledge = ground_and(&[block((-5.0, 5.0), (0.0, 3.0), (-2.0, 5.0))]);
    let mut navigator = walker(0.0, 3.0, 0.0);
    walk(&mut navigator, 4.0, AHEAD, &ledge);
    assert!(feet(&navigator).abs() < 1e-5, "{}", navigator.pose.eye);
}

#[test]
fn nobody_gets_into_walls_or_through_the_ground() {
    for seed in 0..4 {
        let mut random = Random::new(seed);
        let boxes: Vec<(DVec3, DVec3)> = (0..60)
            .map(|i| {
                let (at, half) = (random.vector() * 8.0, random.vector().abs() * 1.5 + 0.1);
                // To step on, or too high even from there.
                let height = if i % 3 == 0 { 0.39 * half.y / 1.6 } else { 0.9 + half.y };
                block((at.x - half.x, at.x + half.x), (-0.5, height), (at.z - half.z, at.z + half.z))
            })
            .filter(|(min, max)| apart(min, max, DVec3::ZERO) > 0.5)
            .collect();
        let world = ground_and(&boxes);
        let mut navigator = walker(0.0, 0.0, 0.0);
        let (mut farthest, mut highest) = (0.0f64, 0.0f64);
        for step in 0..1500 {
            if step % 40 == 0 {
                let aim = super::super::pose::Aim { heading: 7.0 * random.unit(), pitch: 0.0 };
                navigator.pose.world_from_view = navigator.compass.orientation(aim);
            }
            let hurry = if step % 3 == 0 { 4.0 } else { 1.0 };
            navigator.step(FRAME * (0.5 + random.unit()), &Motion { hurry, ..AHEAD }, &world);
            let eye = navigator.pose.eye;
            let at = feet(&navigator);
            assert!((-1e-6..0.4).contains(&at), "seed {seed}, step {step}: {eye}");
            for (min, max) in boxes.iter().filter(|(_, max)| max.y > 0.5) {
                let apart = apart(min, max, eye);
                assert!(apart > 0.2, "seed {seed}, step {step}: {apart} from {min} {max} at {eye}");
            }
            farthest = farthest.max(eye.distance(DVec3::new(0.0, 1.7, 0.0)));
            highest = highest.max(at);
        }
        assert!(farthest > 1.0 && highest > 0.0, "seed {seed}: {farthest} {highest}");
    }
}

/// Level distance of a box.
fn apart(min: &DVec3, max: &DVec3, eye: DVec3) -> f64 {
    let beyond = (*min - eye).max(eye - *max);
    beyond.x.max(0.0).hypot(beyond.z.max(0.0))
}
