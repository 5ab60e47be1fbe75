//! The camera within parts, on their faces, and parts across the plane of the eye.

use glam::{DAffine3, DQuat, DVec3};

use crate::common::Random;
use crate::common::cuboid;
use crate::shapes::{block, joined, placed, rod};
use crate::trial::{Maker, Trial, parallel, perspective};

/// Object 0: a closed vessel, its wall from 7/4 to 2. Objects 1 to 6: blocks in it; 7 to 12: blocks outside.
fn vessel(by: DAffine3) -> Trial {
    let mut maker = Maker::default();
    let shell = |half: f64| placed(cuboid(), DAffine3::from_scale(DVec3::splat(half)));
    let vessel = maker.part(joined([shell(2.0), shell(1.75)]));
    maker.place(vessel, by);
    let small = maker.part(placed(cuboid(), DAffine3::from_scale(DVec3::splat(0.125))));
    for distance in [1.25, 4.0] {
        for axis in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z] {
            maker.place(small, by * DAffine3::from_translation(axis * distance));
        }
    }
    maker.on_trial(8)
}

const DIRECTIONS: [DVec3; 5] =
    [DVec3::X, DVec3::NEG_Y, DVec3::Z, DVec3::new(1.0, -0.5, 0.25), DVec3::new(-0.3, 0.7, 0.9)];

#[test]
fn from_inside_a_closed_vessel_its_contents_are_seen_and_nothing_else() {
    for turn in [DQuat::IDENTITY, DQuat::from_rotation_x(0.7) * DQuat::from_rotation_z(0.4)] {
        let by = DAffine3::from_quat(turn);
        let mut trial = vessel(by);
        for direction in DIRECTIONS {
            let (eye, target) = (by.transform_point3(DVec3::ZERO), by.transform_point3(direction));
            for camera in [perspective(eye, target, 90.0, (61, 47)), parallel(eye, target, 2.0, (64, 48))] {
                let answers = trial.look("in the vessel", &camera);
                assert_eq!(answers.of("exact").hits, answers.of("exact").weight, "the vessel is closed");
                for outside in 7..13 {
                    assert_eq!(answers.dense.samples[outside], 0);
                    assert!(!answers.of("hzb to the last pixel").visible[outside], "object {outside}");
                    assert!(!answers.of("voxel").visible[outside], "object {outside}");
                }
            }
        }
        let camera =
            perspective(by.transform_point3(DVec3::ZERO), by.transform_point3(DVec3::X), 90.0, (61, 47));
        trial.assert_threads_do_not_matter(&camera);
    }
}

#[test]
fn an_eye_in_a_wall_on_a_face_at_an_edge_or_a_vertex_hides_nothing_from_any_method() {
    let mut trial = vessel(DAffine3::IDENTITY);
    let in_wall = DVec3::new(1.875, 0.25, 0.5);
    let (on_face, on_edge, at_vertex) =
        (DVec3::new(2.0, 0.25, 0.5), DVec3::new(2.0, 2.0, 0.5), DVec3::splat(2.0));
    let (on_diagonal, inner_vertex) = (DVec3::new(2.0, 0.5, 0.5), DVec3::splat(1.75));
    let mut seen = 0;
    for (place, eye) in [
        ("in the wall", in_wall),
        ("on a face", on_face),
        ("on the edge of two triangles", on_diagonal),
        ("on an edge", on_edge),
        ("at a vertex", at_vertex),
        ("at an inner vertex", inner_vertex),
    ] {
        for direction in DIRECTIONS.into_iter().chain([DVec3::NEG_X]) {
            for camera in [
                perspective(eye, eye + direction, 90.0, (41, 31)),
                perspective(eye, eye + direction, 170.0, (32, 32)),
                // Rays that start in the very plane of the face, or pass along it.
                parallel(eye, eye + direction, 4.0, (40, 30)),
            ] {
                let answers = trial.look(&format!("{place}, towards {direction}"), &camera);
                seen += answers.of("exact").hits;
                // Its box holds the eye.
                for method in ["hzm", "hzb", "hzb to the last pixel", "frustum"] {
                    assert!(answers.of(method).visible[0], "{place}, {method}");
                }
            }
        }
    }
    assert!(seen > 30_000, "{seen}");
}

#[test]
fn parts_across_the_plane_of_the_eye_hide_only_what_is_behind_them() {
    let mut random = Random::new(5);
    let (mut seen, mut hidden) = (0, 0);
    for round in 0..4 {
        let mut maker = Maker::default();
        // Beams past the eye from far behind to far ahead, a room around all, and blocks ahead.
        for _ in 0..6 {
            let ahead = DVec3::new(6.0 * random.vector().x, 6.0 * random.vector().y, -30.0);
            let behind = DVec3::new(6.0 * random.vector().x, 6.0 * random.vector().y, 30.0);
            maker.add(rod(ahead, behind, 0.05 + random.unit()));
        }
        maker.add(block(DVec3::splat(-40.0), DVec3::splat(40.0)));
        for _ in 0..60 {
            let at = random.vector() * DVec3::new(12.0, 12.0, 20.0);
            maker.add(block(at - 0.4 * random.unit(), at + 0.1 + 0.4 * random.unit()));
        }
        let mut trial = maker.on_trial(7);
        let eye = random.vector();
        let target = eye + DVec3::new(0.2, 0.1, -1.0) + 0.3 * random.vector();
        for camera in [
            perspective(eye, target, 60.0, (61, 47)),
            perspective(eye, target, 165.0, (64, 64)),
            parallel(eye, target, 14.0, (61, 47)),
        ] {
            let answers = trial.look(&format!("seed 5, round {round}"), &camera);
            seen += answers.of("exact").visible_count();
            hidden +=
                answers.of("frustum").visible_count() - answers.of("hzb to the last pixel").visible_count();
            if round < 2 {
                trial.assert_threads_do_not_matter(&camera);
            }
        }
    }
    assert!(seen > 100 && hidden > 40, "{seen} seen, {hidden} hidden");
}
