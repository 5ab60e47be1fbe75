//! Windows of odd sizes, and fields of view from a hair to almost everything.

use glam::{DAffine3, DVec2, DVec3};
use voxsight::camera::{Camera, Projection};

use crate::common::cameras::cameras;
use crate::common::{Random, cuboid, random_model};
use crate::shapes::{block, wall_with_hole};
use crate::trial::{Maker, Trial, parallel, perspective};

/// A panel with a small hole, and blocks before and behind it.
fn behind_a_panel(seed: u64) -> Trial {
    let mut random = Random::new(seed);
    let mut maker = Maker::default();
    maker.add(wall_with_hole(8.0, DVec2::new(2.0, 1.0), DVec2::new(2.5, 2.25), 0.0));
    let part = maker.part(cuboid());
    for i in 0..60 {
        let at = random.vector() * DVec3::new(8.0, 8.0, 4.0);
        let at = if i % 10 == 0 { at } else { at.with_z(-5.0 - at.z.abs()) };
        let size = DAffine3::from_scale(DVec3::splat(0.1 + 0.6 * random.unit()));
        maker.place(part, DAffine3::from_translation(at) * size);
    }
    maker.on_trial(7)
}

/// Powers of two and not, single rows and columns, longer than 4096, up to the longest that a camera takes.
const SIZES: [(u32, u32); 16] = [
    (1, 1),
    (1, 2),
    (3, 1),
    (1, 97),
    (5, 3),
    (7, 7),
    (64, 64),
    (63, 65),
    (127, 33),
    (33, 129),
    (255, 17),
    (4097, 2),
    (3, 4099),
    (8191, 1),
    (1, 6_001),
    (20_001, 1),
];

#[test]
fn no_size_of_the_window_makes_a_method_lose_what_a_centre_sees() {
    let mut trial = behind_a_panel(1);
    let (mut hidden, mut seen) = (0, 0);
    for size in SIZES {
        // As wide a view of the panel as the window allows.
        let wide = f64::from(size.0) / f64::from(size.1);
        let height = 15.0 / wide.max(1.0);
        let fov = 2.0 * (height / 40.0).atan().to_degrees();
        let eye = DVec3::new(0.5, 0.25, 20.0);
        for camera in [perspective(eye, DVec3::ZERO, fov, size), parallel(eye, DVec3::ZERO, height, size)] {
            let answers = trial.look(&format!("{size:?}"), &camera);
            seen += answers.of("exact").visible_count();
            hidden +=
                answers.of("frustum").visible_count() - answers.of("hzb to the last pixel").visible_count();
            if u64::from(size.0) * u64::from(size.1) < 3000 {
                trial.assert_threads_do_not_matter(&camera);
            }
        }
    }
    assert!(hidden > 300 && seen > 60, "{hidden} hidden, {seen} seen");
}

#[test]
fn windows_one_after_the_other_leave_nothing_behind() {
    // `hzb` keeps the last frame's answer and its images from window to window.
    let mut trial = behind_a_panel(2);
    let mut random = Random::new(9);
    for round in 0..24 {
        let size = (1 + random.below(130), 1 + random.below(130));
        let eye = DVec3::new(0.0, 0.0, 16.0) + 3.0 * random.vector();
        let camera = if round % 4 == 0 {
            parallel(eye, random.vector(), 4.0 + 10.0 * random.unit(), size)
        } else {
            perspective(eye, random.vector(), 20.0 + 90.0 * random.unit(), size)
        };
        trial.look(&format!("seed 9, round {round}, {size:?}"), &camera);
    }
}

// Not wider: for triangles below a millionth of a pixel, f64 does not tell on which side of an edge a centre is, see
// `occlusion::raster`.
#[test]
fn fields_of_view_from_a_hair_to_almost_everything() {
    let mut maker = Maker::default();
    // The middle of the view is amid a face, far from its edges; behind it a block; one before it.
    maker.add(block(DVec3::new(-7.0, -6.0, -1.0), DVec3::new(5.0, 6.5, 0.0)));
    let behind = maker.add(block(DVec3::splat(-4.0), DVec3::splat(-3.0)));
    maker.add(block(DVec3::new(0.01, 0.02, 1.0), DVec3::new(0.05, 0.06, 1.1)));
    let mut trial = maker.on_trial(7);
    let target = DVec3::new(0.125, 0.25, 0.0);
    for (size, eye) in [
        ((32, 32), target + 12.0 * DVec3::Z),
        ((17, 5), target + 12.0 * DVec3::Z),
        ((31, 9), DVec3::new(3.3, 2.7, 9.1)),
    ] {
        let fields = [1e-12, 1e-9, 1e-6, 1e-3, 1.0, 90.0, 179.0, 179.9];
        let narrow = fields.map(|fov| perspective(eye, target, fov, size));
        let heights = [1e-18, 1e-15, 1e-12, 1e-6, 1.0, 1e2, 1e4];
        let close = heights.map(|height| parallel(eye, target, height, size));
        for (i, camera) in narrow.into_iter().chain(close).enumerate() {
            let answers = trial.look(&format!("field {i}: {:?}", camera.projection), &camera);
            let is_close = match camera.projection {
                Projection::Perspective { fov_y_deg } => fov_y_deg < 0.1,
                Projection::Orthographic { height } => height < 1e-3,
            };
            if is_close {
                assert_eq!(answers.samples(0), size.0 * size.1, "{:?}", camera.projection);
                assert!(!answers.of("hzb to the last pixel").visible[behind], "{:?}", camera.projection);
            }
        }
    }
}

#[test]
fn random_scenes_keep_all_promises_in_windows_of_random_sizes() {
    let folder = tempfile::tempdir().unwrap();
    for seed in [71, 72] {
        let path = folder.path().join("scene.vxs");
        crate::common::build_model(random_model(seed, 250, DVec3::ZERO), 7, &path);
        let mut trial = Trial::new(crate::common::load(&path));
        let mut random = Random::new(seed);
        for round in 0..4 {
            let size = (1 + random.below(150), 1 + random.below(100));
            let all: Vec<Camera> = cameras(&trial.loaded, size);
            trial.look(&format!("seed {seed}, round {round}"), &all[round]);
        }
    }
}
