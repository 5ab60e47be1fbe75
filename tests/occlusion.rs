//! Depth images against a plain rasterizer and against rays; pyramids against brute force; and the promise of `hzm` and
//! `hzb`: no drawable is hidden that a ray through a pixel's centre meets first.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

mod common;

use std::sync::Arc;

use common::cameras::cameras_and_amid as cameras;
use common::{Random, build_model, load, random_model};
use fearless_simd::Level;
use glam::{DAffine3, DVec3};
use voxsight::camera::{Camera, Plane, Projection};
use voxsight::loaded::LoadedScene;
use voxsight::occlusion::OcclusionScene;
use voxsight::occlusion::boxes::{OrientedBox, ScreenBox, Sight};
use voxsight::occlusion::compactness::{compactness, covered};
use voxsight::occlusion::hzb::{Hzb, HzbSettings};
use voxsight::occlusion::hzm::{Hzm, HzmSettings};
use voxsight::occlusion::pyramid::Pyramid;
use voxsight::occlusion::raster::{DepthImage, Rasterizer, draw_triangles, reference};
use voxsight::occlusion::view::{FARTHEST, View};
use voxsight::progress::Silent;
use voxsight::visibility::culling::Culling;
use voxsight::visibility::{Jitter, Method, QuerySettings, RaysPerPixel, VisibleSet, query};

/// How much farther than the truth a depth image may be, as a part of nearness (parallel: of the scene).
const FARTHER: f64 = 1.0 / (1 << 11) as f64;

/// A ray through the middle of every pixel, which is where depth images look.
const CENTRES: QuerySettings = QuerySettings {
    rays_per_pixel: RaysPerPixel::ONE,
    first_sample: 0,
    jitter: Jitter::Regular,
    adaptive: false,
};

/// Drawables that a ray through a pixel's centre meets first.
fn seen_by_rays(loaded: &LoadedScene, camera: &Camera) -> VisibleSet {
    query(&loaded.query(), &camera.rays().unwrap(), Method::Exact, &CENTRES)
}

fn in_frustum(loaded: &LoadedScene, camera: &Camera) -> usize {
    query(&loaded.query(), &camera.rays().unwrap(), Method::Frustum, &CENTRES).visible_count()
}

fn occlusion_scene(loaded: &LoadedScene) -> Arc<OcclusionScene> {
    Arc::new(OcclusionScene::new(loaded.query().exact))
}

/// Both methods, with the pyramid asked once and as finely as there is.
fn methods(loaded: &LoadedScene) -> Vec<Box<dyn Culling>> {
    let scene = occlusion_scene(loaded);
    let mut methods: Vec<Box<dyn Culling>> = Vec::new();
    for finer_levels in [0, 32] {
        let hzm = HzmSettings { finer_levels, compactness_threshold: 0.3, ..HzmSettings::default() };
        methods.push(Box::new(Hzm::new(scene.clone(), loaded.query().exact, hzm)));
        let hzb = HzbSettings { finer_levels, first_frame_triangles: 500 };
        methods.push(Box::new(Hzb::new(scene.clone(), hzb)));
    }
    methods
}

fn ask(method: &mut dyn Culling, loaded: &LoadedScene, camera: &Camera) -> VisibleSet {
    method.frame(&loaded.query(), &camera.rays().unwrap(), &Silent).unwrap().found
}

/// Drawables with samples that the answer lacks.
fn lost(seen: &VisibleSet, answer: &VisibleSet) -> Vec<usize> {
    (0..seen.samples.len()).filter(|&d| seen.samples[d] > 0 && !answer.visible[d]).collect()
}

// --- The rasterizer ---

/// Triangles around the origin: small and large, thin, flat on, sharing edges, through the eye's plane.
fn triangles(random: &mut Random, count: u32) -> Vec<[[f32; 3]; 3]> {
    let mut triangles: Vec<[[f32; 3]; 3]> = Vec::new();
    for i in 0..count {
        let at = random.vector() * 5.0;
        let size = [0.003, 0.05, 0.7, 12.0][random.below(4) as usize];
        let (a, b, c) = (at, at + size * random.vector(), at + size * random.vector());
        let c = if i % 7 == 0 { a.lerp(b, 0.4) + 1e-4 * random.vector() } else { c };
        let corners = [a, b, c].map(|p| p.as_vec3().to_array());
        triangles.push(corners);
        if i % 3 == 0 {
            // A neighbour across the edge.
            let d = (at - size * random.vector()).as_vec3().to_array();
            triangles.push([corners[1], corners[0], d]);
        }
    }
    triangles
}

#[test]
fn the_rasterizer_covers_what_the_plain_one_covers_and_is_never_nearer() {
    let mut random = Random::new(1);
    let (mut covered_pixels, mut rounded) = (0u64, 0.0f64);
    for round in 0..60 {
        let count = 20 + random.below(150);
        let triangles = triangles(&mut random, count);
        let size = [(1, 1), (3, 200), (64, 64), (97, 61), (130, 33)][round % 5];
        let projection = match round % 3 {
            0 => Projection::Orthographic { height: 1.0 + 12.0 * random.unit() },
            _ => Projection::Perspective { fov_y_deg: 20.0 + 120.0 * random.unit() },
        };
        let eye = random.vector() * if round % 2 == 0 { 14.0 } else { 3.0 };
        let camera = Camera {
            eye: eye.into(),
            target: random.vector().into(),
            up: [0.0, 1.0, 0.1],
            projection,
            width: size.0,
            height: size.1,
        };
        let view = View::new(&camera.rays().unwrap(), DVec3::ZERO, 5.0);
        let mut expected = DepthImage::new(size.0, size.1);
        reference::draw_triangles(&view, &triangles, &mut expected);
        let mut first: Option<DepthImage> = None;
        for level in [Level::baseline(), Level::new()] {
            let mut found = DepthImage::new(size.0, size.1);
            draw_triangles(&mut Rasterizer::new(level), &view, &triangles, &mut found);
            for row in 0..size.1 {
                for column in 0..size.0 {
                    let (a, b) = (found.at(column, row), expected.at(column, row));
                    let place = format!("seed 1, round {round}, {level:?}, pixel {column} {row}: {a} {b}");
                    assert_eq!(a == FARTHEST, b == FARTHEST, "{place}");
                    if b == FARTHEST {
                        continue;
                    }
                    covered_pixels += 1;
                    let unit = if view.is_parallel() { 1.0 } else { f64::from(b) };
                    let farther = (f64::from(b) - f64::from(a)) / unit;
                    // The reference rounds to f32.
                    assert!((-1.2e-7..FARTHER).contains(&farther), "{place}, farther by {farther:e}");
                    rounded = rounded.max(farther);
                    if let Some(first) = &first {
                        assert_eq!(a, first.at(column, row), "{place}: not the same with all instructions");
                    }
                }
            }
            first.get_or_insert(found);
        }
    }
    assert!(covered_pixels > 100_000, "{covered_pixels}");
    println!("{covered_pixels} pixels, farther by at most {rounded:e}");
}

#[test]
fn no_pixel_falls_between_triangles_whose_edges_pass_through_centres() {
    // A board of squares cut along both diagonals, seen so that its edges and corners lie on centres of pixels exactly.
    let camera = Camera {
        eye: [0.0, 0.0, 10.0],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        projection: Projection::Orthographic { height: 64.0 },
        width: 64,
        height: 64,
    };
    let at = |x: i32, y: i32| [x as f32 + 0.5, y as f32 + 0.5, 0.0];
    let mut triangles = Vec::new();
    for y in (-32..32).step_by(4) {
        for x in (-32..32).step_by(4) {
            let ring = [at(x, y), at(x + 4, y), at(x + 4, y + 4), at(x, y + 4)];
            (0..4).for_each(|i| triangles.push([ring[i], ring[(i + 1) % 4], at(x + 2, y + 2)]));
        }
    }
    let view = View::new(&camera.rays().unwrap(), DVec3::ZERO, 1.0);
    let mut image = DepthImage::new(64, 64);
    draw_triangles(&mut Rasterizer::default(), &view, &triangles, &mut image);
    let holes = (0..64).flat_map(|row| image.row(row)[1..].to_vec()).filter(|&n| n == FARTHEST).count();
    // The lowest row and the first column lie outside the board.
    assert!(holes <= 63, "{holes} holes");
}

/// Compares the depth image of everything with rays through the pixels' centres; returns pixels, and ties: centres on
/// the very edge of a silhouette.
fn compare_with_rays(name: &str, loaded: &LoadedScene, camera: &Camera) -> (u64, u64) {
    let rays = camera.rays().unwrap();
    let (scene, query) = (OcclusionScene::new(loaded.query().exact), loaded.query());
    let view = scene.view(&rays);
    let mut image = DepthImage::new(camera.width, camera.height);
    let all = 0..query.exact.drawable_count();
    scene.draw(&mut Rasterizer::default(), all, &view, query.filter, &mut image);
    let (mut hits, mut ties) = (0, 0);
    for row in 0..camera.height {
        for column in 0..camera.width {
            let ray = rays.ray(f64::from(column) + 0.5, f64::from(row) + 0.5);
            let hit = query.exact.closest_through(&ray, query.filter, |_| {});
            let found = image.at(column, row);
            hits += u64::from(hit.is_some());
            let expected = hit.map_or(f64::NEG_INFINITY, |hit| {
                let point = view.point(ray.at(hit.t));
                point.a / point.h
            });
            let unit = if view.is_parallel() { 1.0 } else { expected.abs() };
            let farther = (expected - f64::from(found)) / unit;
            let same = hit.is_none() && found == FARTHEST || (-1e-7..FARTHER).contains(&farther);
            if !same {
                println!("{name}, pixel {column} {row}: {found}, ray {hit:?} {expected}");
                ties += 1;
            }
        }
    }
    (hits, ties)
}

#[test]
fn depth_images_agree_with_rays_through_the_centres() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    for (seed, centre) in [(1, DVec3::ZERO), (2, DVec3::new(4.3e5, 5.2e6, -80.0)), (3, DVec3::splat(-1e7))] {
        build_model(random_model(seed, 120, centre), 8, &path);
        let mut loaded = load(&path);
        for filtered in [false, true] {
            if filtered {
                (0..40).for_each(|d| loaded.filter_mut().set_hidden(3 * d, true));
                let normal = DVec3::new(-1.0, 0.2, -0.4);
                loaded.filter_mut().clip_by(Plane { normal, point: centre + 10.0 });
                loaded.filter_mut().clip_by(Plane { normal: DVec3::Y * 3.0, point: centre + 6.0 });
            }
            let (mut hits, mut ties) = (0, 0);
            for (i, camera) in cameras(&loaded, (97, 61)).iter().enumerate() {
                let name = format!("seed {seed}, filtered {filtered}, camera {i}");
                let found = compare_with_rays(&name, &loaded, camera);
                (hits, ties) = (hits + found.0, ties + found.1);
            }
            assert!(hits > if filtered { 500 } else { 6000 }, "seed {seed}: only {hits} pixels hit anything");
            // At 1e7 units a coordinate is rounded by 2e-9: here and there across an edge.
            assert!(ties <= if seed == 1 { 0 } else { 2 }, "seed {seed}: {ties} of {hits} differ");
        }
    }
}

// --- The pyramid ---

#[test]
fn a_pyramid_never_hides_a_box_that_has_a_pixel_as_far() {
    let mut random = Random::new(3);
    let (mut hidden, mut shown) = (0, 0);
    for round in 0..400 {
        let (width, height) = (1 + random.below(70), 1 + random.below(70));
        let mut pyramid = Pyramid::new(width, height);
        // Quads at random depths; holes in between.
        let camera = Camera {
            eye: [0.0; 3],
            target: [0.0, 0.0, -1.0],
            up: [0.0, 1.0, 0.0],
            projection: Projection::Orthographic { height: 2.0 },
            width,
            height,
        };
        let view = View::new(&camera.rays().unwrap(), DVec3::ZERO, 1.0);
        let count = 1 + random.below(6);
        let triangles: Vec<_> = (0..count)
            .map(|_| {
                let z = -(0.1 + random.unit()) as f32;
                let mut corner = || [6.0 * random.vector().x as f32, 6.0 * random.vector().y as f32, z];
                [corner(), corner(), corner()]
            })
            .collect();
        draw_triangles(&mut Rasterizer::default(), &view, &triangles, pyramid.pixels_mut());
        pyramid.build();
        let top = pyramid.level_count() - 1;
        assert_eq!(pyramid.level_size(top), (1, 1), "{width} x {height}");
        for _ in 0..100 {
            let span = |random: &mut Random, size: u32| {
                let (a, b) = (random.below(size), random.below(size));
                if random.below(3) == 0 { (a, a) } else { (a.min(b), a.max(b)) }
            };
            let ((left, right), (top, bottom)) = (span(&mut random, width), span(&mut random, height));
            let nearest = -(1.3 * random.unit()) as f32;
            let seen = ScreenBox { left, right, top, bottom, nearest, area: 1.0 };
            let pixels = || (top..=bottom).flat_map(|row| (left..=right).map(move |column| (column, row)));
            let all_nearer = pixels().all(|(column, row)| pyramid.pixels().at(column, row) > nearest);
            let place = format!("seed 3, round {round}, {width} x {height}, {seen:?}");
            assert!(!pyramid.hides(&seen, 0) || all_nearer, "{place}");
            assert_eq!(pyramid.hides(&seen, 32), all_nearer, "{place}: asked to the last pixel");
            if all_nearer && pyramid.hides(&seen, 0) { hidden += 1 } else { shown += 1 }
        }
    }
    assert!(hidden > 3000 && shown > 3000, "{hidden} {shown}");
}

#[test]
fn a_texel_is_the_farthest_of_its_pixels_at_any_size() {
    let mut random = Random::new(4);
    for (width, height) in [(1, 1), (1, 9), (7, 5), (64, 64), (65, 63), (33, 1), (100, 31), (1023, 259)] {
        let mut pyramid = Pyramid::new(width, height);
        let camera = Camera {
            eye: [0.0; 3],
            target: [0.0, 0.0, -1.0],
            up: [0.0, 1.0, 0.0],
            projection: Projection::Perspective { fov_y_deg: 90.0 },
            width,
            height,
        };
        let view = View::new(&camera.rays().unwrap(), DVec3::ZERO, 1.0);
        // A slanted wall over everything, and things before it.
        let mut triangles = vec![[[-900.0, -90.0, -9.0], [900.0, -90.0, -5.0], [0.0, 300.0, -20.0]]];
        triangles.extend(self::triangles(&mut random, 60));
        draw_triangles(&mut Rasterizer::default(), &view, &triangles, pyramid.pixels_mut());
        pyramid.build();
        for level in 0..pyramid.level_count() {
            let (columns, rows) = pyramid.level_size(level);
            let mut farthest = vec![f32::INFINITY; (columns * rows) as usize];
            for row in 0..height {
                for column in 0..width {
                    let at = ((row >> level).min(rows - 1) * columns + (column >> level).min(columns - 1))
                        as usize;
                    farthest[at] = farthest[at].min(pyramid.pixels().at(column, row));
                }
            }
            for row in 0..rows {
                for column in 0..columns {
                    let expected = farthest[(row * columns + column) as usize];
                    let place = format!("{width} x {height}, level {level}, texel {column} {row}");
                    assert_eq!(pyramid.texel(level, column, row), expected, "{place}");
                }
            }
        }
    }
}

// --- Boxes ---

#[test]
fn boxes_cover_every_pixel_that_their_points_reach() {
    let mut random = Random::new(5);
    let mut kinds = [0; 3];
    for round in 0..4000 {
        let far = if round % 4 == 0 { random.vector() * 1e7 } else { DVec3::ZERO };
        let projection = match round % 3 {
            0 => Projection::Orthographic { height: 0.5 + 20.0 * random.unit() },
            _ => Projection::Perspective { fov_y_deg: 20.0 + 130.0 * random.unit() },
        };
        let camera = Camera {
            eye: (far + 6.0 * random.vector()).into(),
            target: (far + random.vector()).into(),
            up: [0.1, 1.0, 0.0],
            projection,
            width: 1 + random.below(300),
            height: 1 + random.below(300),
        };
        let rays = camera.rays().unwrap();
        let view = View::new(&rays, far, 5.0);
        let angles = random.vector() * 3.0;
        let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, angles.x, angles.y, angles.z);
        let size = [0.01, 0.5, 3.0][random.below(3) as usize];
        let mut scale = size * (random.vector() + 1.1);
        scale.z *= if round % 5 == 0 { 0.0 } else { -1.0 };
        let placement = DAffine3::from_scale_rotation_translation(scale, turn, far + 4.0 * random.vector());
        let sight = OrientedBox::placed(&placement, DVec3::ZERO, DVec3::ONE).seen(&view);
        kinds[match sight {
            Sight::Outside => 0,
            Sight::AtEye => 1,
            Sight::Covers(_) => 2,
        }] += 1;
        for _ in 0..40 {
            let corner = |t: f64| {
                if t < 0.3 {
                    0.0
                } else if t > 0.7 {
                    1.0
                } else {
                    t
                }
            };
            let within = DVec3::new(corner(random.unit()), corner(random.unit()), corner(random.unit()));
            let world = placement.transform_point3(within);
            let depth = (world - rays.eye()).dot(rays.forward());
            let point = view.point(world);
            if depth <= 1e-6 {
                // What is wholly behind the eye is outside; what reaches in front of it is not.
                continue;
            }
            let (x, y) = (point.x / point.h + 0.5, point.y / point.h + 0.5);
            let margin = 1e-6 * (1.0 + x.abs() + y.abs());
            let is_in = |p: f64, size: u32| p > margin && p < f64::from(size) - margin;
            if !(is_in(x, camera.width) && is_in(y, camera.height)) {
                continue;
            }
            let place = format!("seed 5, round {round}: {sight:?}, {world}, pixel {x} {y}");
            match sight {
                Sight::Outside => panic!("{place}"),
                Sight::AtEye => {}
                Sight::Covers(seen) => {
                    assert!((seen.left..=seen.right).contains(&(x as u32)), "{place}");
                    assert!((seen.top..=seen.bottom).contains(&(y as u32)), "{place}");
                    assert!(
                        f64::from(seen.nearest) >= point.a / point.h,
                        "{place}: nearness {}",
                        point.a / point.h
                    );
                }
            }
        }
    }
    assert!(kinds.iter().all(|&count| count > 80), "{kinds:?}");
}

#[test]
fn compactness_tells_plates_from_sticks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let mut model = random_model(1, 3, DVec3::ZERO);
    model.objects.iter_mut().for_each(|object| object.world_from_part = DAffine3::IDENTITY);
    // Parts: box, tetrahedron, sheet. The sheet becomes a cross of two sticks: most of its box is empty.
    let stick = |mesh: &mut voxsight::model::Mesh| {
        mesh.triangles.truncate(2);
        mesh.positions =
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.05, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
                .map(DVec3::from)
                .to_vec();
        mesh.triangles = vec![[0, 1, 2], [0, 4, 1]];
    };
    stick(&mut model.parts[2].mesh);
    build_model(model, 6, &path);
    let loaded = load(&path);
    let exact = loaded.query().exact;
    let scene = OcclusionScene::new(exact);
    let of = |drawable: u32| {
        let chunk = scene.chunk_of(drawable) as usize;
        let (min, max) = exact.chunks()[chunk].bounds();
        compactness(covered(&scene.meshes()[chunk], min, max), &scene.boxes()[drawable as usize])
    };
    let found = [of(0), of(1), of(2)];
    assert!(found[0] > 0.99, "{found:?}");
    assert!((0.3..0.7).contains(&found[1]), "{found:?}");
    assert!(found[2] < 0.45, "{found:?}");
}

// --- The methods ---

#[test]
fn no_drawable_is_hidden_that_a_ray_through_a_centre_meets() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let (mut views, mut shown, mut boxes) = (0, 0, 0);
    for (seed, centre) in [(11, DVec3::ZERO), (12, DVec3::new(4.3e5, 5.2e6, -80.0)), (13, DVec3::splat(-1e7))]
    {
        build_model(random_model(seed, 1200, centre), 7, &path);
        let mut loaded = load(&path);
        for filtered in [false, true] {
            if filtered {
                (0..300).for_each(|d| loaded.filter_mut().set_hidden(4 * d, true));
                loaded
                    .filter_mut()
                    .clip_by(Plane { normal: DVec3::new(-1.0, 0.2, -0.4), point: centre + 10.0 });
            }
            let mut methods = methods(&loaded);
            for (size, first) in [((97, 61), 0), ((256, 256), 1), ((33, 190), 2)] {
                for camera in cameras(&loaded, size).iter().skip(first).step_by(2) {
                    let seen = seen_by_rays(&loaded, camera);
                    boxes += in_frustum(&loaded, camera) * methods.len();
                    for method in &mut methods {
                        let answer = ask(method.as_mut(), &loaded, camera);
                        let name = method.name();
                        assert_eq!(lost(&seen, &answer), [0; 0], "seed {seed}, {name}, {size:?}: {camera:?}");
                        let hidden = (0..300).filter(|d| filtered && answer.visible[4 * d]).count();
                        assert_eq!(hidden, 0, "seed {seed}, {name} shows what is hidden");
                        views += 1;
                        shown += answer.visible_count();
                    }
                }
            }
        }
    }
    println!("{views} answers, {shown} of {boxes} drawables in the frustum shown");
    assert!(shown * 10 < boxes * 9, "{shown} of {boxes} shown: nothing is ever hidden");
}

#[test]
fn faces_in_one_plane_hide_nothing_of_each_other() {
    // Boards with their faces in one plane, each overlapping its neighbour: of every pair, rays see the lower number.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let mut model = random_model(21, 40, DVec3::ZERO);
    for (i, object) in model.objects.iter_mut().enumerate() {
        object.part = 0;
        object.colour.0[3] = 255;
        let at = DVec3::new((i % 8) as f64 * 0.75, (i / 8) as f64 * 0.75, 0.0);
        object.world_from_part = DAffine3::from_translation(at);
    }
    build_model(model, 7, &path);
    let loaded = load(&path);
    let (mut ties, mut seen_drawables) = (0, 0);
    for camera in cameras(&loaded, (120, 90)) {
        let seen = seen_by_rays(&loaded, &camera);
        seen_drawables += seen.visible_count();
        for mut method in methods(&loaded) {
            ties += lost(&seen, &ask(method.as_mut(), &loaded, &camera)).len();
        }
    }
    println!("{ties} ties among {seen_drawables} drawables seen");
    assert_eq!(ties, 0);
    assert!(seen_drawables > 60, "{seen_drawables}");
}

#[test]
fn two_passes_find_what_appears_along_a_path_in_the_same_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(random_model(31, 1500, DVec3::ZERO), 7, &path);
    let loaded = load(&path);
    let base = cameras(&loaded, (160, 120))[2];
    let mut hzb = Hzb::new(occlusion_scene(&loaded), HzbSettings::default());
    let (mut before, mut appeared, mut shown, mut boxes) = (None::<VisibleSet>, 0, 0, 0);
    for frame in 0..40 {
        // Forward, turning; and once a jump to where nothing was seen before.
        let turn = 0.7 * f64::from(frame) + if frame >= 25 { 2.0 } else { 0.0 };
        let eye = DVec3::new(10.0 + 6.0 * (0.1 * turn).cos(), 10.0, 10.0 + 6.0 * (0.1 * turn).sin());
        let target = eye + DVec3::new(turn.sin(), 0.1, turn.cos());
        let camera = Camera { eye: eye.into(), target: target.into(), ..base };
        let seen = seen_by_rays(&loaded, &camera);
        let answer = ask(&mut hzb, &loaded, &camera);
        assert_eq!(lost(&seen, &answer), [0; 0], "frame {frame}");
        if let Some(before) = &before {
            appeared += (0..1500).filter(|&d| seen.visible[d] && !before.visible[d]).count();
        }
        shown += answer.visible_count();
        boxes += in_frustum(&loaded, &camera);
        before = Some(answer);
    }
    assert!(appeared > 50, "only {appeared} drawables appeared");
    assert!(shown * 10 < boxes * 9, "{shown} of {boxes} shown");
    // Forgotten, it starts anew and finds the same as one that never saw another frame.
    hzb.reset();
    let camera = cameras(&loaded, (160, 120))[2];
    let fresh = ask(&mut Hzb::new(occlusion_scene(&loaded), HzbSettings::default()), &loaded, &camera);
    assert_eq!(ask(&mut hzb, &loaded, &camera), fresh);
}

#[test]
fn answers_do_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(random_model(41, 900, DVec3::ZERO), 7, &path);
    let loaded = load(&path);
    let camera = cameras(&loaded, (300, 211))[2];
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| -> Vec<VisibleSet> {
            let ask = |mut method: Box<dyn Culling>| {
                let first = ask(method.as_mut(), &loaded, &camera);
                let again = ask(method.as_mut(), &loaded, &camera);
                [first, again]
            };
            methods(&loaded).into_iter().flat_map(ask).collect()
        })
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
}

#[test]
fn the_pixel_error_threshold_leaves_out_only_what_is_small() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(random_model(51, 600, DVec3::ZERO), 7, &path);
    let loaded = load(&path);
    let camera = cameras(&loaded, (97, 61))[0];
    let scene = occlusion_scene(&loaded);
    let hzm = |pixel_error_threshold| {
        let settings = HzmSettings { pixel_error_threshold, ..HzmSettings::default() };
        ask(&mut Hzm::new(scene.clone(), loaded.query().exact, settings), &loaded, &camera)
    };
    let (all, large) = (hzm(0.0), hzm(12.0));
    let mut sights = Vec::new();
    let view = scene.view(&camera.rays().unwrap());
    scene.sights(&view, loaded.query().filter, &mut sights);
    for (drawable, sight) in sights.iter().enumerate() {
        let is_small = matches!(sight, Sight::Covers(seen) if seen.area < 12.0);
        assert_eq!(large.visible[drawable], all.visible[drawable] && !is_small, "{drawable}");
    }
    assert!(large.visible_count() < all.visible_count());
}

#[test]
fn every_stage_is_timed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(random_model(61, 50, DVec3::ZERO), 6, &path);
    let loaded = load(&path);
    let camera = cameras(&loaded, (64, 48))[0];
    let stages = |method: &mut dyn Culling| -> Vec<&'static str> {
        let frame = method.frame(&loaded.query(), &camera.rays().unwrap(), &Silent).unwrap();
        assert!(frame.stages.iter().all(|stage| stage.seconds > 0.0));
        frame.stages.iter().map(|stage| stage.stage).collect()
    };
    let mut methods = methods(&loaded);
    assert_eq!(stages(methods[0].as_mut()), ["frustum", "select", "raster", "pyramid", "test"]);
    let twice = ["frustum", "raster", "pyramid", "test", "raster 2", "pyramid 2", "test 2"];
    assert_eq!(stages(methods[1].as_mut()), twice);
}
