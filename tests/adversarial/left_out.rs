//! Walls that are cut away, hidden or of glass: they hide nothing from any method, in the very next frame.

use glam::{DAffine3, DQuat, DVec2, DVec3};
use voxsight::camera::{Camera, Plane};
use voxsight::filter::Filter;

use crate::common::{Random, cuboid};
use crate::shapes::{block, wall};
use crate::trial::{Maker, Trial, parallel, perspective};

const WALL: usize = 0;
const LEFT: usize = 1;
const RIGHT: usize = 2;

/// A wall, on either side of its middle a block behind it, all turned by `turn`.
fn walled(mesh_of_wall: voxsight::model::Mesh, is_glass: bool, turn: DAffine3) -> Trial {
    let mut maker = Maker::default();
    let part = maker.part(mesh_of_wall);
    let wall = maker.place(part, turn);
    if is_glass {
        maker.glass(wall);
    }
    let unit = maker.part(cuboid());
    for x in [-4.0, 4.0] {
        maker.place(unit, turn * DAffine3::from_translation(DVec3::new(x, 0.5, -5.0)));
    }
    maker.on_trial(8)
}

fn thin_wall() -> voxsight::model::Mesh {
    wall(DVec2::splat(-10.0), DVec2::splat(10.0), 0.0)
}

fn thick_wall() -> voxsight::model::Mesh {
    block(DVec3::new(-10.0, -10.0, -2.0), DVec3::new(10.0, 10.0, 0.0))
}

fn views(turn: DAffine3) -> [Camera; 3] {
    let at = |x: f64, y: f64, z: f64| turn.transform_point3(DVec3::new(x, y, z));
    [
        perspective(at(0.5, 1.0, 16.0), at(0.0, 0.0, 0.0), 50.0, (49, 37)),
        perspective(at(3.0, -2.0, 14.0), at(0.3, 0.0, 0.0), 60.0, (40, 40)),
        parallel(at(0.5, 1.0, 16.0), at(0.0, 0.0, 0.0), 12.0, (49, 37)),
    ]
}

/// A plane of the scene before it was turned.
fn plane(turn: DAffine3, normal: DVec3, point: DVec3) -> Plane {
    Plane { normal: turn.transform_vector3(normal), point: turn.transform_point3(point) }
}

fn turns() -> [DAffine3; 3] {
    let turn = DQuat::from_rotation_y(0.5) * DQuat::from_rotation_x(-0.3);
    [
        DAffine3::IDENTITY,
        DAffine3::from_quat(turn),
        DAffine3::from_rotation_translation(turn, DVec3::new(4.3e5, -5.2e6, 1e7)),
    ]
}

#[test]
fn a_section_through_a_wall_shows_what_the_wall_hid() {
    for (turn, mesh) in turns().into_iter().flat_map(|turn| [(turn, thin_wall()), (turn, thick_wall())]) {
        let mut trial = walled(mesh, false, turn);
        for camera in views(turn) {
            // Hidden, shown, hidden again: the methods remember their last frames.
            for is_cut in [false, true, false] {
                *trial.loaded.filter_mut() = Filter::default();
                if is_cut {
                    trial.loaded.filter_mut().clip_by(plane(turn, DVec3::NEG_Z, DVec3::NEG_Z * 3.0));
                }
                let answers = trial.look("whole wall", &camera);
                for part in [LEFT, RIGHT] {
                    if is_cut {
                        answers.assert_all_see(part, "whole wall cut away");
                    } else {
                        answers.assert_occluded(part, "whole wall");
                    }
                }
                if is_cut {
                    answers.assert_cut_away(WALL, "whole wall cut away");
                }
            }
            // Half of it is left.
            trial.loaded.filter_mut().clip_by(plane(turn, DVec3::X * 2.0, DVec3::new(0.125, 0.0, 0.0)));
            let answers = trial.look("half a wall", &camera);
            answers.assert_all_see(WALL, "half a wall");
            answers.assert_cut_away(LEFT, "half a wall");
            answers.assert_occluded(RIGHT, "half a wall");
            // Half of it is left, but of the blocks nothing is cut.
            *trial.loaded.filter_mut() = Filter::default();
            let slanted = plane(turn, DVec3::new(1.0, 0.0, -1.0), DVec3::new(1.0, 0.0, 0.0));
            trial.loaded.filter_mut().clip_by(slanted);
            let answers = trial.look("wall cut aslant", &camera);
            answers.assert_all_see(LEFT, "wall cut aslant");
            answers.assert_occluded(RIGHT, "wall cut aslant");
        }
        trial.assert_threads_do_not_matter(&views(turn)[0]);
    }
}

#[test]
fn a_cut_along_the_very_face_of_a_wall_is_a_tie_that_loses_no_part() {
    for (turn, mesh) in turns().into_iter().flat_map(|turn| [(turn, thin_wall()), (turn, thick_wall())]) {
        for side in [DVec3::NEG_Z, DVec3::Z] {
            let mut trial = walled(mesh.clone(), false, turn);
            trial.loaded.filter_mut().clip_by(plane(turn, side, DVec3::ZERO));
            for camera in views(turn) {
                trial.look(&format!("cut along the face, towards {side}"), &camera);
            }
        }
    }
}

#[test]
fn random_sections_keep_all_promises() {
    for seed in 1..=2 {
        let mut random = Random::new(seed);
        let mut maker = Maker::default();
        maker.add(wall(DVec2::splat(-10.0), DVec2::splat(10.0), 0.0));
        maker.add(block(DVec3::splat(-9.0), DVec3::splat(9.0)));
        let unit = maker.part(cuboid());
        for _ in 0..60 {
            let size = DAffine3::from_scale(DVec3::splat(0.3 + 1.5 * random.unit()));
            maker.place(unit, DAffine3::from_translation(random.vector() * 9.0) * size);
        }
        let mut trial = maker.on_trial(8);
        for round in 0..12 {
            *trial.loaded.filter_mut() = Filter::default();
            for _ in 0..1 + round % 3 {
                let (normal, point) = (random.vector(), 4.0 * random.vector());
                trial.loaded.filter_mut().clip_by(Plane { normal, point });
            }
            (0..62)
                .filter(|_| random.below(6) == 0)
                .for_each(|d| trial.loaded.filter_mut().set_hidden(d, true));
            let (eye, target) = (20.0 * random.vector(), 3.0 * random.vector());
            let camera = if round % 3 == 0 {
                parallel(eye, target, 18.0, (61, 47))
            } else {
                perspective(eye, target, 70.0, (61, 47))
            };
            trial.look(&format!("seed {seed}, round {round}"), &camera);
        }
    }
}

#[test]
fn a_hidden_wall_and_one_of_glass_hide_nothing() {
    for (turn, mesh) in turns().into_iter().flat_map(|turn| [(turn, thin_wall()), (turn, thick_wall())]) {
        let mut trial = walled(mesh.clone(), false, turn);
        let mut glass = walled(mesh, true, turn);
        for camera in views(turn) {
            for is_hidden in [false, true, false] {
                trial.loaded.filter_mut().set_hidden(WALL as u32, is_hidden);
                let answers = trial.look("wall", &camera);
                for part in [LEFT, RIGHT] {
                    if is_hidden {
                        answers.assert_all_see(part, "hidden wall");
                    } else {
                        answers.assert_occluded(part, "wall");
                    }
                }
                assert_eq!(answers.shown_by(WALL).is_empty(), is_hidden);
            }
            let answers = glass.look("glass", &camera);
            (0..3).for_each(|drawable| answers.assert_all_see(drawable, "glass"));
            // And what is of glass is hidden by others.
            glass.loaded.filter_mut().set_hidden(WALL as u32, true);
            let answers = glass.look("hidden glass", &camera);
            assert!(answers.shown_by(WALL).is_empty());
            glass.loaded.filter_mut().set_hidden(WALL as u32, false);
        }
    }
}

#[test]
fn glass_is_hidden_behind_a_wall() {
    let mut maker = Maker::default();
    maker.add(thick_wall());
    let pane = maker.add(wall(DVec2::splat(-2.0), DVec2::splat(2.0), -5.0));
    maker.glass(pane);
    let mut trial = maker.on_trial(8);
    for camera in views(DAffine3::IDENTITY) {
        trial.look("pane", &camera).assert_occluded(pane, "pane");
    }
}
