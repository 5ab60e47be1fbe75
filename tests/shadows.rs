//! Shadows: that `hybrid` is `exact` where it promises to be, that flat and convex surfaces have no acne, that closed rooms
//! have no leaks, and that pictures are the same however they are cut up.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

mod common;

use common::{Random, build_model, cuboid, load, mesh, random_model};
use glam::{DAffine3, DQuat, DVec3};
use voxsight::camera::{Camera, CameraRays, Plane, Projection};
use voxsight::loaded::LoadedScene;
use voxsight::model::{Colour, Mesh, Model, Node, Object, Part};
use voxsight::progress::Silent;
use voxsight::render::{
    AreaLight, Film, KeyLight, LightKind, Lighting, NOBODY, PIXELS_VERSION, RayCount, RenderSettings,
    Renderer, Shadows, Sky, Sun,
};

/// A sun of half a degree, a sky that is occluded, and a lamp inside.
fn all_lights(random: &mut Random, centre: DVec3, reach: f64) -> Lighting {
    let direction = random.vector() + DVec3::Y;
    let angle_deg = [0.0, 0.5, 20.0][random.below(3) as usize];
    let area = AreaLight {
        corner: centre + random.vector() * 8.0,
        edge_u: random.vector() * 3.0,
        edge_v: random.vector() * 3.0,
        radiance: DVec3::splat(20.0),
    };
    Lighting {
        key: KeyLight::Sun(Sun { direction, angle_deg }),
        sky: Sky::Occluded { reach },
        areas: vec![area],
        fill: 0.5,
    }
}

fn settings(lighting: Lighting, shadows: Shadows, samples: u32) -> RenderSettings {
    RenderSettings { samples_per_pixel: samples, lighting, shadows, up: DVec3::Y, seed: 7 }
}

fn film(loaded: &LoadedScene, camera: &CameraRays, settings: &RenderSettings) -> Film {
    let picture = loaded.picture();
    Renderer::new(&picture, camera, settings).rows(0..camera.size().1, &Silent).unwrap().0
}

fn sum(film: &Film, kind: LightKind) -> RayCount {
    film.pixels.iter().fold(RayCount::default(), |sum, pixel| {
        let RayCount { cast, free } = pixel.shadow[kind as usize];
        RayCount { cast: sum.cast + cast, free: sum.free + free }
    })
}

#[test]
fn hybrid_shadows_without_tolerance_are_those_of_triangles_to_the_last_ray() {
    let folder = tempfile::tempdir().unwrap();
    let mut rays = [0; 3];
    for seed in 0..24u64 {
        let mut random = Random::new(seed);
        let offset = if seed % 3 == 0 { DVec3::splat(1e5) } else { DVec3::ZERO };
        let path = folder.path().join(format!("{seed}.vxs"));
        build_model(random_model(seed, 40, offset), 6 + (seed % 4) as u32, &path);
        let mut loaded = load(&path);
        let centre = offset + DVec3::splat(10.0);
        if seed % 4 == 1 {
            for drawable in 0..loaded.query().exact.drawable_count() {
                loaded.filter_mut().set_hidden(drawable, random.below(3) == 0);
            }
        }
        if seed % 4 == 2 {
            loaded.filter_mut().clip_by(Plane { normal: random.vector(), point: centre });
        }
        let camera = Camera::around(offset, offset + DVec3::splat(20.0), random.vector(), DVec3::Y, 45, 37);
        let camera = camera.rays().unwrap();
        let reach = [f64::INFINITY, 3.0][random.below(2) as usize];
        let lighting = all_lights(&mut random, centre, reach);
        let exact = film(&loaded, &camera, &settings(lighting.clone(), Shadows::Exact, 3));
        let hybrid = film(&loaded, &camera, &settings(lighting, Shadows::Hybrid { tolerance: 0.0 }, 3));
        for (pixel, (a, b)) in exact.pixels.iter().zip(&hybrid.pixels).enumerate() {
            assert_eq!(a.shadow, b.shadow, "seed {seed}, pixel {pixel}");
        }
        assert_eq!(exact, hybrid, "seed {seed}");
        for kind in LightKind::ALL {
            let RayCount { cast, free } = sum(&exact, kind);
            assert!(free <= cast);
            rays[kind as usize] += u32::from(free > 0 && free < cast);
        }
    }
    assert!(rays.iter().all(|&scenes| scenes > 15), "scenes with light and shadow, by kind: {rays:?}");
}

#[test]
fn a_tolerance_shifts_penumbras_by_no_more_than_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    // A wall that ends in the air over a floor.
    let model = placed(&[
        (
            cuboid(),
            DAffine3::from_translation(DVec3::Y * -1.0) * DAffine3::from_scale(DVec3::new(20.0, 0.1, 20.0)),
        ),
        (
            cuboid(),
            DAffine3::from_translation(DVec3::new(0.0, 12.0, 0.0))
                * DAffine3::from_scale(DVec3::new(4.0, 0.05, 4.0)),
        ),
    ]);
    build_model(model, 9, &path);
    let loaded = load(&path);
    let camera = above(DVec3::new(0.0, 9.0, 0.0), 96);
    let lighting = Lighting {
        key: KeyLight::Sun(Sun { direction: DVec3::new(0.1, 1.0, 0.05), angle_deg: 12.0 }),
        sky: Sky::Plain,
        areas: Vec::new(),
        fill: 1.0,
    };
    let exact = film(&loaded, &camera, &settings(lighting.clone(), Shadows::Exact, 64));
    let error = |tolerance: f64| {
        let film = film(&loaded, &camera, &settings(lighting.clone(), Shadows::Hybrid { tolerance }, 64));
        let of = |film: &Film, pixel: usize| film.pixels[pixel].shadow[0].visibility().unwrap();
        let pixels = (0..exact.pixels.len()).filter(|&pixel| exact.pixels[pixel].shadow[0].cast > 0);
        let penumbra = pixels.filter(|&pixel| (0.01..0.99).contains(&of(&exact, pixel)));
        let errors: Vec<f64> = penumbra.map(|pixel| (of(&exact, pixel) - of(&film, pixel)).abs()).collect();
        assert!(errors.len() > 500, "{}", errors.len());
        errors.iter().sum::<f64>() / errors.len() as f64
    };
    // A voxel is 0.08, the wall 13 away, the penumbra 2.7 wide: voxels reach too far by up to 5 % of it, the diagonal of one.
    let (voxels_decide, triangles_decide) = (error(0.25), error(0.01));
    assert!(voxels_decide > 0.001 && voxels_decide < 0.05, "{voxels_decide}");
    assert_eq!(triangles_decide, 0.0);
}

/// A model of meshes, each an opaque object.
fn placed(meshes: &[(Mesh, DAffine3)]) -> Model {
    let mut model = Model::default();
    for (i, (mesh, world_from_part)) in (0..).zip(meshes) {
        model.parts.push(Part { name: format!("part {i}"), mesh: mesh.clone() });
        model.nodes.push(Node { name: format!("node {i}"), ..Node::default() });
        let colour = Colour([200, 200, 200, 255]);
        model.objects.push(Object { node: i, part: i, world_from_part: *world_from_part, colour });
    }
    model
}

/// A square view straight down.
fn above(eye: DVec3, side: u32) -> CameraRays {
    Camera {
        eye: eye.into(),
        target: (eye - DVec3::Y).into(),
        up: [0.0, 0.0, -1.0],
        projection: Projection::Perspective { fov_y_deg: 80.0 },
        width: side,
        height: side,
    }
    .rays()
    .unwrap()
}

/// A ball of many facets.
fn ball() -> Mesh {
    const RINGS: u32 = 24;
    let at = |ring: u32, step: u32| {
        let (pitch, turn) = (
            std::f64::consts::PI * f64::from(ring) / f64::from(RINGS),
            std::f64::consts::TAU * f64::from(step) / f64::from(2 * RINGS),
        );
        [pitch.sin() * turn.cos(), pitch.cos(), pitch.sin() * turn.sin()]
    };
    let steps = 2 * RINGS;
    let positions: Vec<[f64; 3]> = (0..=RINGS).flat_map(|r| (0..steps).map(move |s| at(r, s))).collect();
    let id = |ring: u32, step: u32| ring * steps + step % steps;
    let triangles: Vec<[u32; 3]> = (0..RINGS)
        .flat_map(|r| {
            (0..steps).flat_map(move |s| {
                [[id(r, s), id(r, s + 1), id(r + 1, s)], [id(r, s + 1), id(r + 1, s + 1), id(r + 1, s)]]
            })
        })
        .filter(|t| {
            let [a, b, c] = t.map(|i| DVec3::from(positions[i as usize]));
            (b - a).cross(c - a).length() > 1e-9
        })
        .collect();
    mesh(&positions, &triangles)
}

#[test]
fn flat_and_convex_surfaces_have_no_acne_at_any_angle() {
    let folder = tempfile::tempdir().unwrap();
    let mut rays = 0;
    for seed in 0..30u64 {
        let mut random = Random::new(seed);
        let turn = DQuat::from_axis_angle(random.vector().normalize_or(DVec3::Y), 6.0 * random.unit());
        let scale = DVec3::new(1.0, 0.02 + random.unit(), 0.3 + random.unit());
        let place =
            DAffine3::from_rotation_translation(turn, random.vector()) * DAffine3::from_scale(scale * 5.0);
        let body = if seed % 2 == 0 { cuboid() } else { ball() };
        let path = folder.path().join(format!("{seed}.vxs"));
        build_model(placed(&[(body, place)]), 6 + (seed % 5) as u32, &path);
        let loaded = load(&path);
        let bounds = loaded.scene().meta().bounds;
        let camera = Camera::around(bounds.min.into(), bounds.max.into(), random.vector(), DVec3::Y, 60, 60);
        let camera = camera.rays().unwrap();
        // A body that is convex shades nothing of itself that faces the light: every ray comes through.
        let lighting = Lighting {
            key: KeyLight::Sun(Sun {
                direction: random.vector(),
                angle_deg: [1.0, 25.0, 90.0][seed as usize % 3],
            }),
            sky: Sky::Occluded { reach: f64::INFINITY },
            areas: Vec::new(),
            fill: 1.0,
        };
        let coarse = Shadows::Hybrid { tolerance: 1.0 };
        for shadows in [Shadows::Voxel, coarse, Shadows::HYBRID, Shadows::Exact] {
            let film = film(&loaded, &camera, &settings(lighting.clone(), shadows, 2));
            for kind in [LightKind::Sun, LightKind::Sky] {
                let RayCount { cast, free } = sum(&film, kind);
                // Quantized facets of the ball may form a crease that a grazing ray does meet.
                let creases = if seed % 2 == 0 { 0 } else { cast / 200 };
                assert!(
                    free + creases >= cast,
                    "seed {seed}, {shadows:?}, {kind:?}: acne on {} of {cast}",
                    cast - free
                );
                rays += cast;
            }
        }
    }
    assert!(rays > 100_000, "{rays}");
}

#[test]
fn no_light_leaks_into_a_closed_room_of_sheets_without_thickness() {
    let folder = tempfile::tempdir().unwrap();
    let mut rays = 0;
    for seed in 0..12u64 {
        let mut random = Random::new(seed);
        let turn = DQuat::from_axis_angle(random.vector().normalize_or(DVec3::Y), 6.0 * random.unit());
        let place = DAffine3::from_rotation_translation(turn, random.vector());
        let room = DAffine3::from_scale(DVec3::new(3.0, 2.0, 4.0));
        let path = folder.path().join(format!("{seed}.vxs"));
        build_model(placed(&[(cuboid(), place * room)]), 6 + (seed % 4) as u32, &path);
        let loaded = load(&path);
        let eye = place.transform_point3(DVec3::ZERO);
        let camera = Camera {
            eye: eye.into(),
            target: (eye + random.vector()).into(),
            up: [0.0, 1.0, 0.0],
            projection: Projection::Perspective { fov_y_deg: 120.0 },
            width: 64,
            height: 64,
        };
        let lighting = Lighting {
            key: KeyLight::Sun(Sun { direction: random.vector(), angle_deg: 5.0 }),
            sky: Sky::Occluded { reach: f64::INFINITY },
            areas: Vec::new(),
            fill: 1.0,
        };
        for shadows in [Shadows::Voxel, Shadows::HYBRID, Shadows::Exact] {
            let film = film(&loaded, &camera.rays().unwrap(), &settings(lighting.clone(), shadows, 2));
            for kind in [LightKind::Sun, LightKind::Sky] {
                let RayCount { cast, free } = sum(&film, kind);
                assert_eq!(free, 0, "seed {seed}, {shadows:?}, {kind:?}: of {cast} rays some leak");
                rays += cast;
            }
        }
    }
    assert!(rays > 150_000, "{rays}");
}

#[test]
fn pictures_are_the_same_for_any_cut_and_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(random_model(5, 50, DVec3::ZERO), 8, &path);
    let loaded = load(&path);
    for (size, samples, cuts) in [((71, 53), 5, [0, 1, 9, 30, 30, 53]), ((20, 18), 130, [0, 3, 5, 8, 13, 18])]
    {
        let camera = Camera::around(DVec3::ZERO, DVec3::splat(20.0), DVec3::ONE, DVec3::Y, size.0, size.1);
        let camera = camera.rays().unwrap();
        for shadows in [Shadows::Voxel, Shadows::HYBRID, Shadows::Exact] {
            let lighting = all_lights(&mut Random::new(3), DVec3::splat(10.0), 5.0);
            let settings = settings(lighting, shadows, samples);
            let whole = film(&loaded, &camera, &settings);
            let picture = loaded.picture();
            let renderer = Renderer::new(&picture, &camera, &settings);
            for threads in [1, 3] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let mut pixels = Vec::new();
                for rows in cuts.windows(2).map(|ends| ends[0]..ends[1]) {
                    pixels.extend(pool.install(|| renderer.rows(rows, &Silent)).unwrap().0.pixels);
                }
                assert_eq!(pixels, whole.pixels, "{shadows:?}, {threads} threads");
            }
        }
    }
}

#[test]
fn a_lamp_that_is_drawn_does_not_darken_itself() {
    let folder = tempfile::tempdir().unwrap();
    let mut rays = 0;
    for seed in 0..12u64 {
        let mut random = Random::new(seed);
        let turn = DQuat::from_axis_angle(random.vector().normalize_or(DVec3::Y), 6.0 * random.unit());
        let place = DAffine3::from_rotation_translation(turn, random.vector() * 3.0);
        let corners = [[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]];
        let square = mesh(&corners, &[[0, 1, 2], [0, 2, 3]]);
        let height = 0.5 + 4.0 * random.unit();
        let panel = DAffine3::from_translation(DVec3::Y * height);
        let floor = DAffine3::from_scale(DVec3::new(6.0, 1.0, 6.0));
        let path = folder.path().join(format!("{seed}.vxs"));
        let parts = [(square.clone(), place * floor), (square, place * panel)];
        build_model(placed(&parts), 7 + (seed % 3) as u32, &path);
        let loaded = load(&path);
        let at = |x: f64, y: f64, z: f64| place.transform_point3(DVec3::new(x, y, z));
        let corner = at(-1.0, height, -1.0);
        let lighting = Lighting {
            key: KeyLight::None,
            sky: Sky::None,
            // Down, to the floor.
            areas: vec![AreaLight {
                corner,
                edge_u: at(1.0, height, -1.0) - corner,
                edge_v: at(-1.0, height, 1.0) - corner,
                radiance: DVec3::ONE,
            }],
            fill: 0.0,
        };
        let camera = Camera {
            eye: at(0.1, 0.4 * height, 0.2).into(),
            target: at(0.3, 0.0, 0.2).into(),
            up: (place.matrix3 * DVec3::Z).into(),
            projection: Projection::Perspective { fov_y_deg: 130.0 },
            width: 48,
            height: 48,
        };
        let coarse = Shadows::Hybrid { tolerance: 1.0 };
        for shadows in [Shadows::Voxel, coarse, Shadows::HYBRID, Shadows::Exact] {
            let film = film(&loaded, &camera.rays().unwrap(), &settings(lighting.clone(), shadows, 4));
            let RayCount { cast, free } = sum(&film, LightKind::Area);
            assert_eq!(free, cast, "seed {seed}, {shadows:?}");
            rays += cast;
        }
    }
    assert!(rays > 100_000, "{rays}");
}

#[test]
fn what_lies_under_a_pixel_is_what_its_middle_shows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(random_model(9, 60, DVec3::ZERO), 8, &path);
    let loaded = load(&path);
    let camera =
        Camera::around(DVec3::ZERO, DVec3::splat(20.0), DVec3::ONE, DVec3::Y, 50, 40).rays().unwrap();
    let film = film(&loaded, &camera, &settings(Lighting::sunny(DVec3::Y), Shadows::None, 7));
    let mut seen = 0;
    for (i, pixel) in (0u32..).zip(&film.pixels) {
        let ray = camera.ray(f64::from(i % 50) + 0.5, f64::from(i / 50) + 0.5);
        let hit = loaded.query().exact.closest(&ray, loaded.query().filter);
        assert_eq!(pixel.depth, hit.map_or(f32::INFINITY, |hit| hit.t as f32), "pixel {i}");
        assert_eq!(pixel.drawable, hit.map_or(NOBODY, |hit| hit.drawable), "pixel {i}");
        seen += u32::from(hit.is_some());
    }
    assert!(seen > 150, "{seen}");
}

#[test]
fn light_leaks_into_acute_corners_only_as_far_as_rays_start_above_their_surface() {
    let folder = tempfile::tempdir().unwrap();
    let (mut rays, mut leaks) = (0, 0);
    for seed in 0..16u64 {
        let mut random = Random::new(seed);
        // A closed wedge: two sheets that meet in an edge, three more that close it.
        let angle = 0.2 + random.unit();
        let (tip, far) = ([0.0, 0.0], [[4.0 * angle.cos(), 4.0 * angle.sin()], [4.0, 0.0]]);
        let at = |[x, y]: [f64; 2], z: f64| [x, y, z];
        let corners: Vec<[f64; 3]> =
            [-3.0, 3.0].into_iter().flat_map(|z| [at(tip, z), at(far[0], z), at(far[1], z)]).collect();
        let faces = [[0, 1, 2], [3, 5, 4], [0, 4, 1], [0, 3, 4], [0, 2, 5], [0, 5, 3], [1, 4, 5], [1, 5, 2]];
        let turn = DQuat::from_axis_angle(random.vector().normalize_or(DVec3::Y), 6.0 * random.unit());
        let place = DAffine3::from_rotation_translation(turn, random.vector());
        let path = folder.path().join(format!("{seed}.vxs"));
        build_model(placed(&[(mesh(&corners, &faces), place)]), 6 + (seed % 3) as u32, &path);
        let loaded = load(&path);
        let world = |x: f64, y: f64, z: f64| place.transform_point3(DVec3::new(x, y, z));
        let camera = Camera {
            eye: world(2.5, 2.5 * (0.5 * angle).tan(), 0.0).into(),
            target: world(0.0, 0.0, 0.0).into(),
            up: (place.matrix3 * DVec3::Z).into(),
            projection: Projection::Perspective { fov_y_deg: 80.0 },
            width: 80,
            height: 80,
        };
        let camera = camera.rays().unwrap();
        let lighting = Lighting {
            key: KeyLight::Sun(Sun { direction: random.vector(), angle_deg: 5.0 }),
            sky: Sky::Occluded { reach: f64::INFINITY },
            areas: Vec::new(),
            fill: 1.0,
        };
        for shadows in [Shadows::HYBRID, Shadows::Exact] {
            let film = film(&loaded, &camera, &settings(lighting.clone(), shadows, 1));
            for kind in [LightKind::Sun, LightKind::Sky] {
                assert_eq!(sum(&film, kind).free, 0, "seed {seed}, {shadows:?}, {kind:?}");
            }
        }
        let film = film(&loaded, &camera, &settings(lighting, Shadows::Voxel, 1));
        let voxel = loaded.query().grid.voxel_size;
        for (i, pixel) in (0u32..).zip(&film.pixels) {
            let normal = DVec3::from(pixel.normal.map(f64::from));
            let cast =
                pixel.shadow[LightKind::Sun as usize].cast + pixel.shadow[LightKind::Sky as usize].cast;
            let free =
                pixel.shadow[LightKind::Sun as usize].free + pixel.shadow[LightKind::Sky as usize].free;
            rays += cast;
            if free == 0 {
                continue;
            }
            leaks += free;
            // Where the ray started, seen from the wedge: it has left it. The rule of src/render/shadow.rs.
            let point =
                camera.ray(f64::from(i % 80) + 0.5, f64::from(i / 80) + 0.5).at(f64::from(pixel.depth));
            let height = normal.abs().element_sum() * (1.0 + 2.0 / 256.0) * voxel;
            let start = place.inverse().transform_point3(point + normal * height);
            let inside = 1e-3 * voxel;
            let (below, above) = (start.y, start.x * angle.sin() - start.y * angle.cos());
            let is_out = below < inside || above < inside || start.z.abs() > 3.0 - inside;
            let edge = far[0][0] + (start.y - far[0][1]) / (far[1][1] - far[0][1]) * (far[1][0] - far[0][0]);
            assert!(
                is_out || start.x > edge - inside,
                "seed {seed}, pixel {i}: a leak from within, at {start}"
            );
        }
    }
    assert!(rays > 100_000 && leaks > 100, "{leaks} of {rays}");
}

/// Pictures that were begun by one version of the program are not finished by another: [`PIXELS_VERSION`] tells them apart. If this
/// fails though nobody meant to change pixels, find out why; if it was meant, raise the version and write down the new hashes.
#[test]
fn pixels_change_only_with_their_version() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(random_model(5, 50, DVec3::ZERO), 8, &path);
    let loaded = load(&path);
    let camera = Camera::around(DVec3::ZERO, DVec3::splat(20.0), DVec3::ONE, DVec3::Y, 48, 40);
    let camera = camera.rays().unwrap();
    let all = all_lights(&mut Random::new(3), DVec3::splat(10.0), 5.0);
    let hash = |lighting: &Lighting, shadows: Shadows, samples: u32| {
        let film = film(&loaded, &camera, &settings(lighting.clone(), shadows, samples));
        let mut bytes = film.to_rgb8().into_raw();
        for pixel in &film.pixels {
            let floats = pixel.colour.iter().chain(&pixel.normal).chain([&pixel.depth]);
            bytes.extend(floats.flat_map(|value| value.to_le_bytes()));
            bytes.extend(pixel.drawable.to_le_bytes());
        }
        xxhash_rust::xxh3::xxh3_64(&bytes)
    };
    const PIXELS: [u64; 6] = [
        0xd573_41b2_1915_f63f,
        0x5a09_d931_abd4_c520,
        0xbb4b_54b1_b656_a946,
        0x583e_f311_444b_25ab,
        0x4b19_ec30_aa9d_eb80,
        0x4660_c255_8101_70ab,
    ];
    let hashes = [
        hash(&all, Shadows::Voxel, 1),
        hash(&all, Shadows::Voxel, 21),
        hash(&all, Shadows::Hybrid { tolerance: 1.0 }, 4),
        hash(&all, Shadows::Exact, 4),
        hash(&Lighting::sunny(DVec3::new(0.3, 1.0, 0.2)), Shadows::HYBRID, 4),
        hash(&Lighting::headlight(), Shadows::None, 1),
    ];
    assert_eq!((PIXELS_VERSION, hashes), (4, PIXELS), "{hashes:#x?}");
}

/// A floor of this half width, and a thin plate at a height that covers half of it.
fn floor_and_plate(half: f64, height: f64) -> Model {
    let floor =
        DAffine3::from_translation(-0.1 * DVec3::Y) * DAffine3::from_scale(DVec3::new(half, 0.1, half));
    let plate = DAffine3::from_translation(DVec3::new(0.5 * half, height, 0.0))
        * DAffine3::from_scale(DVec3::new(0.5 * half, 0.003, half));
    placed(&[(cuboid(), floor), (cuboid(), plate)])
}

#[test]
fn triangles_decide_up_to_where_the_tolerance_says_and_voxels_beyond() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    const TOLERANCE: f64 = 0.25;
    for is_lamp in [false, true] {
        for share in [0.8, 1.25] {
            // The plate's height decides how large the grid is, and so the voxels: a few rounds settle both.
            let (mut height, mut loaded, mut lighting) = (2.0, None, Lighting::headlight());
            for _ in 0..6 {
                build_model(floor_and_plate(4.0, height), 11, &path);
                let scene = load(&path);
                let diagonal = 3f64.sqrt() * scene.query().grid.voxel_size;
                let spread = if is_lamp {
                    // A square far above the plate, on its edge but for 8 degrees, seen along its diagonal.
                    let (flat, away) = (8f64.to_radians(), 30.0);
                    let along = DVec3::new(flat.sin(), flat.cos(), 0.0);
                    let (u, v) = (along + DVec3::Z, along - DVec3::Z);
                    let (edge_u, edge_v) = if u.cross(v).y < 0.0 { (u, v) } else { (v, u) };
                    let corner = DVec3::Y * away - along;
                    let radiance = DVec3::splat(1e4);
                    lighting = Lighting {
                        key: KeyLight::None,
                        areas: vec![AreaLight { corner, edge_u, edge_v, radiance }],
                        ..Lighting::sunny(DVec3::Y)
                    };
                    // As narrow as the rhombus between two of its parallel edges: area by edge.
                    let side = (flat.sin().powi(2) + 1.0).sqrt();
                    2.0 * flat.sin() / side / away
                } else {
                    lighting = Lighting {
                        key: KeyLight::Sun(Sun { direction: DVec3::Y, angle_deg: 6.0 }),
                        ..Lighting::sunny(DVec3::Y)
                    };
                    6f64.to_radians()
                };
                height = share * diagonal / (TOLERANCE * spread);
                loaded = Some(scene);
            }
            let loaded = loaded.unwrap();
            let camera = above(DVec3::new(0.0, 0.5 * height, 0.0), 64);
            let of = |shadows| film(&loaded, &camera, &settings(lighting.clone(), shadows, 16));
            let (exact, hybrid) = (of(Shadows::Exact), of(Shadows::Hybrid { tolerance: TOLERANCE }));
            let kind = if is_lamp { LightKind::Area } else { LightKind::Sun } as usize;
            let seen = |film: &Film| -> Vec<f64> {
                film.pixels.iter().filter_map(|pixel| pixel.shadow[kind].visibility()).collect()
            };
            let (exact, hybrid) = (seen(&exact), seen(&hybrid));
            let penumbra = exact.iter().filter(|&&v| v > 0.0 && v < 1.0).count();
            assert!(penumbra > 30, "lamp {is_lamp}, {share}: {penumbra} pixels of penumbra");
            let errors: Vec<f64> = exact.iter().zip(&hybrid).map(|(a, b)| (a - b).abs()).collect();
            let worst = errors.iter().copied().fold(0.0, f64::max);
            if share < 1.0 {
                assert_eq!(worst, 0.0, "lamp {is_lamp}: triangles decide");
            } else {
                // A shift by a share of the width changes visibility by at most 1.3 of it, and sampling by some of 16.
                assert!(worst > 0.0 && worst < 1.3 * TOLERANCE + 0.13, "lamp {is_lamp}: {worst}");
            }
        }
    }
}

#[test]
fn exact_and_hybrid_shadows_of_what_is_close_under_a_lamp_do_not_depend_on_voxels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let floor = DAffine3::from_translation(-DVec3::Y) * DAffine3::from_scale(DVec3::new(5.0, 0.1, 5.0));
    // A lamp at a height of 4, and under it, by less than a voxel, a louvre that covers half of it.
    let louvre = DAffine3::from_translation(DVec3::new(0.5, 3.99, 0.0))
        * DAffine3::from_scale(DVec3::new(0.5, 0.002, 1.0));
    let lamp = AreaLight {
        corner: DVec3::new(-1.0, 4.0, -1.0),
        edge_u: DVec3::X * 2.0,
        edge_v: DVec3::Z * 2.0,
        radiance: DVec3::ONE,
    };
    let lighting =
        Lighting { key: KeyLight::None, sky: Sky::None, areas: vec![lamp], ..Lighting::headlight() };
    let camera = above(DVec3::Y * 2.0, 48);
    let film_at = |log2: u32, shadows: Shadows| {
        build_model(placed(&[(cuboid(), floor), (cuboid(), louvre)]), log2, &path);
        film(&load(&path), &camera, &settings(lighting.clone(), shadows, 4))
    };
    let exact = film_at(7, Shadows::Exact);
    assert_eq!(exact, film_at(9, Shadows::Exact));
    let RayCount { cast, free } = sum(&exact, LightKind::Area);
    assert!(
        cast > 5000 && free > cast / 3 && free < cast * 2 / 3,
        "half of the lamp is covered: {free} of {cast}"
    );
    for log2 in [7, 9] {
        let RayCount { free: found, .. } =
            sum(&film_at(log2, Shadows::Hybrid { tolerance: 1.0 }), LightKind::Area);
        assert!(found.abs_diff(free) < cast / 20, "2^{log2}: {found}, exact {free} of {cast}");
    }
}
