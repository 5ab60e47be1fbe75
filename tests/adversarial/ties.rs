//! Faces of several parts in one plane: who wins is a matter of rules, not of error.

use glam::{DAffine3, DVec2, DVec3};
use voxsight::model::Mesh;

use crate::shapes::{block, wall};
use crate::trial::{Maker, parallel, perspective};

fn turned_inside_out(mut mesh: Mesh) -> Mesh {
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh
}

#[test]
fn of_faces_in_one_plane_the_lowest_drawable_wins_and_voxels_show_all() {
    let square = |low: f64, high: f64| wall(DVec2::splat(low), DVec2::splat(high), 1.0);
    let front = |low: DVec3| block(low, DVec3::new(low.x + 4.0, low.y + 4.0, 1.0));
    // Pairs that share a plane: equal, overlapping, one within the other, facing each other, a block and its label.
    let pairs: [(&str, Mesh, Mesh, f64); 5] = [
        ("equal", square(-4.0, 4.0), square(-4.0, 4.0), 8.0),
        ("facing", square(-4.0, 4.0), turned_inside_out(square(-4.0, 4.0)), 8.0),
        ("within", square(-4.0, 4.0), square(-2.0, 2.0), 4.0),
        ("overlapping", square(-4.0, 2.0), square(-2.0, 4.0), 4.0),
        ("blocks", front(DVec3::new(-3.0, -3.0, -2.0)), front(DVec3::new(-1.0, -1.0, -3.0)), 2.0),
    ];
    let mut ties = 0;
    for (name, first, second, overlap) in pairs {
        for swapped in [false, true] {
            let mut maker = Maker::default();
            let in_order = if swapped { [&second, &first] } else { [&first, &second] };
            let [low, high] = in_order.map(|mesh| maker.add(mesh.clone()));
            // Parts are equal but for their place and merged: it is the drawables that count.
            maker.add(wall(DVec2::splat(-6.0), DVec2::splat(6.0), -6.0));
            let mut trial = maker.on_trial(7);
            // Straight on, centres of pixels on multiples of 1/8 and not on edges: all arithmetic is exact.
            let camera = parallel(DVec3::new(0.0, 0.0, 8.0), DVec3::ZERO, 16.0, (128, 128));
            let name = format!("{name}, swapped {swapped}");
            let answers = trial.look(&name, &camera);
            let shared = (overlap * 8.0 * overlap * 8.0) as u32;
            let low_area = answers.samples(low);
            assert!(low_area >= shared, "{name}: {low_area} of {shared}");
            if name.starts_with("equal") || name.starts_with("facing") {
                assert_eq!((low_area, answers.samples(high)), (shared, 0), "{name}");
            }
            assert!(answers.of("voxel").visible[high], "{name}: a voxel has all its owners");
            assert!(answers.of("voxel").visible[low], "{name}: a voxel has all its owners");
            // Neither hides the other from the methods that test boxes.
            for method in ["hzm", "hzm with all occluders", "hzb", "hzb to the last pixel"] {
                let shown = &answers.of(method).visible;
                assert!(shown[low] && shown[high], "{name}: {method}");
            }
            // Askew, where rounding chooses: whoever wins, the methods agree, and brute force counts a tie.
            for camera in [
                perspective(DVec3::new(3.0, 2.0, 9.0), DVec3::ZERO, 70.0, (49, 37)),
                perspective(DVec3::new(-7.0, 1.0, 1.5), DVec3::new(0.0, 0.0, 1.0), 50.0, (40, 30)),
                parallel(DVec3::new(3.0, 2.0, 9.0), DVec3::ZERO, 11.0, (49, 37)),
            ] {
                let answers = trial.look(&name, &camera);
                ties += answers.brute_force.ties;
                assert!(answers.of("voxel").visible[low] && answers.of("voxel").visible[high], "{name}");
                for method in ["hzm with all occluders", "hzb to the last pixel"] {
                    let shown = &answers.of(method).visible;
                    assert!(shown[low] && shown[high], "{name}: {method}");
                }
            }
        }
    }
    println!("{ties} pixels where another of two equals was found");
}

#[test]
fn copies_at_one_place_are_one_for_the_eye_and_many_for_the_box_methods() {
    let mut maker = Maker::default();
    let part = maker.part(block(DVec3::new(-1.0, -2.0, -1.5), DVec3::new(1.0, 2.0, 1.5)));
    // The same place by way of different transforms: turned by half, mirrored, and once rounded differently.
    let mirror = |scale: [f64; 3]| DAffine3::from_scale(scale.into());
    for by in [
        DAffine3::IDENTITY,
        mirror([-1.0, 1.0, 1.0]),
        mirror([-1.0, -1.0, -1.0]),
        DAffine3::from_rotation_z(std::f64::consts::PI),
        DAffine3::from_translation(DVec3::splat(1.0 / 3.0))
            * DAffine3::from_translation(DVec3::splat(-1.0 / 3.0)),
    ] {
        maker.place(part, by);
    }
    let mut trial = maker.on_trial(8);
    for camera in [
        perspective(DVec3::new(3.0, 4.0, 7.0), DVec3::ZERO, 50.0, (49, 37)),
        parallel(DVec3::new(3.0, 4.0, 7.0), DVec3::ZERO, 6.0, (49, 37)),
    ] {
        let answers = trial.look("copies", &camera);
        trial.assert_threads_do_not_matter(&camera);
        for method in ["voxel", "hzm", "hzm with all occluders", "hzb", "hzb to the last pixel", "frustum"] {
            assert_eq!(answers.of(method).visible_count(), 5, "{method}");
        }
        assert!(answers.samples(0) > 0);
    }
}
