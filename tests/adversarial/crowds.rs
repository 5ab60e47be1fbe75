//! Many drawables in one voxel, triangles without area, nothing at all, and far too much.

use glam::{DAffine3, DVec2, DVec3};
use voxsight::model::Mesh;

use crate::common::{Random, cuboid, mesh, sheet};
use crate::shapes::{block, joined, placed, wall};
use crate::trial::{Maker, parallel, perspective};

#[test]
fn hundreds_of_drawables_in_one_voxel_are_told_apart() {
    let mut random = Random::new(1);
    let mut maker = Maker::default();
    let speck = maker.part(cuboid());
    for _ in 0..250 {
        let size = DAffine3::from_scale(DVec3::splat(0.002 + 0.02 * random.unit()));
        maker.place(speck, DAffine3::from_translation(0.4 * random.vector()) * size);
    }
    // Far apart, so that a voxel holds the whole cloud, or an eighth of it; a wall behind it.
    maker.add(wall(DVec2::splat(-100.0), DVec2::splat(100.0), -50.0));
    let mut trial = maker.on_trial(6);
    assert!(trial.loaded.query().grid.voxel_size > 3.0);
    for camera in [
        perspective(DVec3::new(0.3, 0.2, 3.0), DVec3::ZERO, 20.0, (61, 47)),
        perspective(DVec3::new(0.1, 0.2, 0.3), DVec3::ZERO, 100.0, (40, 31)),
        parallel(DVec3::new(-1.0, 2.0, 3.0), DVec3::ZERO, 1.0, (61, 47)),
    ] {
        let answers = trial.look("cloud", &camera);
        assert!(answers.of("exact").visible_count() > 40, "{}", answers.of("exact").visible_count());
        // All owners of the first voxel are visible, those behind others in it too; voxels behind it are not.
        assert!(answers.of("voxel").visible_count() > 40, "{}", answers.of("voxel").visible_count());
        trial.assert_threads_do_not_matter(&camera);
    }
}

#[test]
fn triangles_without_area_are_seen_by_no_ray_and_stop_none() {
    let mut random = Random::new(2);
    // Points, segments, collinear corners; and one triangle that is none of these.
    let mut degenerate = |count: usize| {
        joined((0..count).map(|i| {
            let (a, b) = (random.vector() * 4.0, random.vector() * 4.0);
            // Multiples of 1/4 stay collinear when they are quantized.
            let (a, b) = ((a * 4.0).round() / 4.0, (b * 4.0).round() / 4.0);
            let c = [a, b, 0.5 * (a + b)][i % 3];
            mesh(&[a.into(), b.into(), c.into()], &[[0, 1, 2]])
        }))
    };
    let real = mesh(&[[-1.0, -1.0, 2.0], [1.0, -1.0, 2.0], [0.0, 1.5, 2.5]], &[[0, 1, 2]]);
    let mut maker = Maker::default();
    let mixed = maker.add(joined([degenerate(200), real, degenerate(200)]));
    let nothing = maker.add(degenerate(50));
    let points = maker.add(mesh(&[[0.5, 0.5, 3.0]; 3], &[[0, 1, 2]]));
    let behind = maker.add(block(DVec3::splat(-1.0), DVec3::ONE));
    let mut trial = maker.on_trial(7);
    let mut mixed_seen = 0;
    for camera in [
        perspective(DVec3::new(0.5, 0.25, 12.0), DVec3::ZERO, 50.0, (61, 47)),
        parallel(DVec3::new(0.0, 0.0, 12.0), DVec3::ZERO, 8.0, (64, 64)),
        perspective(DVec3::new(0.0, 0.25, 2.0), DVec3::ZERO, 90.0, (61, 47)),
    ] {
        let answers = trial.look("degenerate", &camera);
        assert_eq!((answers.samples(nothing), answers.samples(points)), (0, 0));
        assert_eq!((answers.dense.samples[nothing], answers.dense.samples[points]), (0, 0));
        assert!(answers.samples(behind) > 0);
        mixed_seen += answers.samples(mixed);
    }
    assert!(mixed_seen > 100, "{mixed_seen}");
}

#[test]
fn an_empty_view_has_an_empty_answer() {
    let mut maker = Maker::default();
    let unit = maker.part(cuboid());
    for i in 0..20 {
        maker.place(unit, DAffine3::from_translation(DVec3::new(f64::from(i % 5) * 3.0, 0.0, f64::from(i))));
    }
    let mut trial = maker.on_trial(6);
    let eye = DVec3::new(5.0, 2.0, 40.0);
    let away = eye + DVec3::new(0.1, 0.2, 1.0);
    for camera in [
        perspective(eye, away, 60.0, (61, 47)),
        perspective(eye, away, 60.0, (1, 1)),
        parallel(eye, away, 20.0, (61, 47)),
        // Beside everything.
        parallel(eye + 100.0 * DVec3::X, eye + DVec3::new(100.0, 0.0, -1.0), 20.0, (61, 47)),
    ] {
        let full = trial.look("full", &perspective(eye, DVec3::ZERO, 60.0, (61, 47)));
        assert!(full.of("hzb").visible_count() > 0);
        let answers = trial.look("empty", &camera);
        for method in ["exact", "hybrid", "voxel", "frustum", "hzm", "hzb", "hzb to the last pixel"] {
            assert_eq!((answers.of(method).hits, answers.of(method).visible_count()), (0, 0), "{method}");
        }
        trial.assert_threads_do_not_matter(&camera);
    }
    // All is hidden.
    (0..20).for_each(|d| trial.loaded.filter_mut().set_hidden(d, true));
    let answers = trial.look("all hidden", &perspective(eye, DVec3::ZERO, 60.0, (61, 47)));
    assert_eq!(answers.of("frustum").visible_count(), 0);
}

#[test]
fn a_tiny_part_in_front_hides_an_enormous_one() {
    let mut maker = Maker::default();
    // A plate a hundredth wide right before the eye, and tens of thousands of triangles behind it, in several chunks.
    let tiny = maker.add(wall(DVec2::splat(-0.005), DVec2::splat(0.005), 9.999));
    let rolling = |mesh: Mesh| placed(mesh, DAffine3::from_scale(DVec3::new(16.0, 16.0, 8.0)));
    let enormous =
        maker.add(placed(rolling(sheet(186)), DAffine3::from_translation(DVec3::new(-8.0, -8.0, 0.0))));
    let mut trial = maker.on_trial(8);
    let drawables: Vec<u32> = trial.loaded.scene().object_drawables(enormous as u32).collect();
    assert!(drawables.len() > 1, "{drawables:?}");
    let (eye, target) = (DVec3::new(0.0, 0.0, 10.0), DVec3::ZERO);
    let hidden = trial.look("behind the plate", &perspective(eye, target, 60.0, (61, 47)));
    hidden.assert_all_see(tiny, "plate");
    for &drawable in &drawables {
        assert_eq!(hidden.samples(drawable as usize), 0);
        assert!(!hidden.of("hzb").visible[drawable as usize], "chunk {drawable}");
    }
    // A step back, and it shows all around the plate.
    let beside = trial.look("beside the plate", &perspective(eye + DVec3::Z, target, 60.0, (61, 47)));
    assert!(drawables.iter().all(|&d| beside.samples(d as usize) > 0));
    trial.assert_threads_do_not_matter(&perspective(eye, target, 60.0, (61, 47)));
}
