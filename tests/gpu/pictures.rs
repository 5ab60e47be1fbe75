//! Whole frames against the CPU's picture.

use glam::DVec3;
use voxsight::camera::{Camera, CameraRays, Plane, Projection};
use voxsight::filter::Filter;
use voxsight::gpu::Context;
use voxsight::gpu::clear::ClearBricks;
use voxsight::gpu::frame::{FrameInput, FrameRenderer};
use voxsight::gpu::instance::{Changes, DrawList};
use voxsight::gpu::marks::Marks;
use voxsight::gpu::shadow::ShadowSettings;
use voxsight::gpu::target::NOBODY;
use voxsight::loaded::LoadedScene;
use voxsight::lod::Choice;
use voxsight::model::{Colour, Model, Node, Object, Part};
use voxsight::progress::Silent;
use voxsight::render::{FilmPixel, Lighting, RenderSettings, Renderer, Shadows};
use voxsight::sample::{PlantSettings, plant};
use voxsight::streaming::{Memory, page, pool::padded};

use super::common::{build_model, load, random_model, sheet};
use super::context;

/// A frame read back.
pub struct Frame {
    pub drawables: Vec<u32>,
    pub depths: Vec<f32>,
    pub picture: Vec<[u8; 4]>,
}

/// A frame with shadows.
pub struct Shadowed {
    pub frame: Frame,
    /// As [`voxsight::gpu::target`] has them.
    pub reversed: Vec<f32>,
    pub normals: Vec<u32>,
    /// Rays to sun and sky that nothing stopped, of so many samples.
    pub free: Vec<[u32; 2]>,
    pub samples: u32,
    /// Shares of sun and sky.
    pub reached: Vec<[f32; 2]>,
}

/// Draws what is asked for of a scene at level 0, everything resident.
fn draw(
    context: &Context,
    scene: &LoadedScene,
    camera: &CameraRays,
    lighting: &Lighting,
    is_drawn: impl Fn(u32) -> bool,
) -> Frame {
    draw_frames(context, scene, camera, lighting, is_drawn, None, 1).frame
}

/// Draws some frames with shadows, and tells of the last.
pub fn draw_with_shadows(
    context: &Context,
    scene: &LoadedScene,
    camera: &CameraRays,
    lighting: &Lighting,
    shadows: ShadowSettings,
    frames: u32,
) -> Shadowed {
    draw_frames(context, scene, camera, lighting, opaque(scene), Some(shadows), frames)
}

fn draw_frames(
    context: &Context,
    scene: &LoadedScene,
    camera: &CameraRays,
    lighting: &Lighting,
    is_drawn: impl Fn(u32) -> bool,
    shadows: Option<ShadowSettings>,
    frames: u32,
) -> Shadowed {
    let all = scene.scene();
    let choices: Vec<Choice> = (0..all.drawables().len() as u32)
        .filter(|&drawable| is_drawn(drawable))
        .map(|drawable| Choice { drawable, level: 0 })
        .collect();
    let mut pages: Vec<u32> =
        choices.iter().map(|choice| all.page_of(choice.drawable, choice.level)).collect();
    pages.sort_unstable();
    pages.dedup();
    let encoded: Vec<(u32, Vec<u8>)> =
        pages.into_iter().map(|p| (p, page::encode(&all.level_mesh(p).unwrap()))).collect();
    let total: u64 = encoded.iter().map(|(_, bytes)| padded(bytes.len() as u64)).sum();
    let mut renderer = FrameRenderer::new(context, total.max(16), camera.size()).unwrap();
    let mut offsets = std::collections::HashMap::new();
    let mut at = 0;
    for (page, bytes) in encoded {
        renderer.memory.write(at, &bytes);
        offsets.insert(page, at);
        at += padded(bytes.len() as u64);
    }
    let changes = Changes { filter: scene.query().filter, moved: None };
    let list = DrawList::new(all, camera, &choices, &changes, |page| offsets.get(&page).copied());
    let marks = Marks::default();
    let clip = scene.query().filter.clip_planes();
    let input = FrameInput {
        list: &list,
        clip,
        lighting,
        up: DVec3::Y,
        marks: &marks,
        shadows,
        caps: false,
        scene: 0,
    };
    if shadows.is_some() {
        let query = scene.query();
        let clear = ClearBricks::new(&query.dag, &query.owners, |d| !query.exact.is_transparent(d));
        renderer.set_voxels(&query.dag, &query.grid, &clear).unwrap();
    }
    for _ in 0..frames {
        renderer.draw(&input).unwrap();
    }
    let reached =
        renderer.reached().map(|buffer| bytemuck::pod_collect_to_vec(&context.read(buffer).unwrap()));
    let free = renderer.free().map(|(free, _)| bytemuck::pod_collect_to_vec(&context.read(free).unwrap()));
    let samples = renderer.shadow_samples();
    let targets = renderer.targets();
    let reversed: Vec<f32> = targets.depth.read(context).unwrap();
    let view = voxsight::gpu::view::ViewUniform::new(&list.camera, list.bounds.0, list.bounds.1);
    let before = (list.camera.eye() - camera.eye()).dot(camera.forward()) as f32;
    let depth = |r: f32| if view.near > 0.0 { view.near / r } else { before + (1.0 - r) * view.far };
    let frame = Frame {
        drawables: targets.drawable.read(context).unwrap(),
        depths: reversed.iter().map(|&r| depth(r)).collect(),
        picture: targets.picture.read(context).unwrap(),
    };
    Shadowed {
        frame,
        reversed,
        normals: targets.normal.read(context).unwrap(),
        free: free.unwrap_or_default(),
        samples,
        reached: reached.unwrap_or_default(),
    }
}

/// All but glass.
pub fn opaque(scene: &LoadedScene) -> impl Fn(u32) -> bool + '_ {
    |drawable| !scene.query().exact.is_transparent(drawable)
}

/// The CPU's picture of what is opaque.
fn reference(scene: &mut LoadedScene, camera: &CameraRays, lighting: &Lighting) -> Vec<FilmPixel> {
    let settings = RenderSettings {
        samples_per_pixel: 1,
        lighting: lighting.clone(),
        shadows: Shadows::None,
        up: DVec3::Y,
        seed: 0,
    };
    let mut pixels = Vec::new();
    hide_glass(scene, |scene| {
        let picture = scene.picture();
        let renderer = Renderer::new(&picture, camera, &settings);
        let (film, _) = renderer.rows(0..camera.size().1, &Silent).unwrap();
        pixels = film.pixels;
    });
    pixels
}

/// Does something without what is transparent.
pub fn hide_glass(scene: &mut LoadedScene, work: impl FnOnce(&LoadedScene)) {
    let count = scene.scene().drawables().len() as u32;
    let glass: Vec<u32> = (0..count).filter(|&d| scene.query().exact.is_transparent(d)).collect();
    glass.iter().for_each(|&d| scene.filter_mut().set_hidden(d, true));
    work(scene);
    glass.iter().for_each(|&d| scene.filter_mut().set_hidden(d, false));
}

/// Is a neighbour of this pixel of another drawable, or much nearer or farther?
fn is_edge(film: &[FilmPixel], (width, height): (u32, u32), index: usize) -> bool {
    let (x, y) = (index as i64 % i64::from(width), index as i64 / i64::from(width));
    let here = &film[index];
    (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy))).any(|(x, y)| {
        let inside = (0..i64::from(width)).contains(&x) && (0..i64::from(height)).contains(&y);
        inside && film[(y * i64::from(width) + x) as usize].drawable != here.drawable
    })
}

/// Compares a frame with the CPU's. Returns the share of pixels whose drawable differs.
fn compare(name: &str, frame: &Frame, film: &[FilmPixel], size: (u32, u32)) -> f64 {
    let mut differ = 0;
    let mut worst_depth = 0f64;
    for (index, expected) in film.iter().enumerate() {
        let found = frame.drawables[index];
        if found != expected.drawable {
            differ += 1;
            assert!(is_edge(film, size, index), "{name}: pixel {index} differs, and no edge is there");
            continue;
        }
        if found != NOBODY {
            let error = f64::from((frame.depths[index] / expected.depth - 1.0).abs());
            // Steep surfaces change their depth within the rounding of a pixel's place.
            if !is_edge(film, size, index) {
                worst_depth = worst_depth.max(error);
            }
        }
    }
    let share = f64::from(differ) / film.len() as f64;
    // Off the edges; on a steep surface a pixel's place, right to a 256th, is worth more.
    assert!(worst_depth < 0.2, "{name}: depths are off by {worst_depth} of themselves");
    println!("{name}: {differ} pixels differ, {:.4} %; worst depth error {worst_depth:.1e}", 100.0 * share);
    share
}

#[test]
fn drawables_are_those_of_exact_but_for_silhouettes() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let size = (384, 256);
    let lighting = Lighting::headlight();
    let settings = PlantSettings { objects: 3000, triangles: 300_000, ..PlantSettings::default() };
    build_model(plant(&settings), 8, &path);
    let mut scene = load(&path);
    let (min, max) =
        (DVec3::from(scene.scene().meta().bounds.min), DVec3::from(scene.scene().meta().bounds.max));
    let centre = 0.5 * (min + max);
    let mut cameras = vec![
        ("outside", Camera::around(min, max, DVec3::new(1.0, 0.6, 0.7), DVec3::Y, size.0, size.1)),
        ("top", Camera::around(min, max, DVec3::Y, DVec3::X, size.0, size.1)),
    ];
    let inside = Camera {
        eye: (centre + DVec3::new(0.3, 0.1, 0.2)).into(),
        target: (centre + DVec3::new(10.0, -1.0, 4.0)).into(),
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg: 70.0 },
        ..cameras[0].1
    };
    cameras.push(("inside", inside));
    cameras.push((
        "parallel",
        Camera {
            projection: Projection::Orthographic { height: 0.4 * (max - min).max_element() },
            ..cameras[0].1
        },
    ));
    let (sight, far) = (cameras[3].1, 1e4 * (max - min));
    let (eye, target) = (DVec3::from(sight.eye), DVec3::from(sight.target));
    let eye = eye + far.length() * (eye - target).normalize_or_zero();
    cameras.push(("parallel from afar", Camera { eye: eye.into(), ..sight }));
    for (name, camera, is_cut) in cameras.iter().map(|(name, camera)| (*name, camera, false)).chain([
        ("outside, cut", &cameras[0].1, true),
        ("inside, cut", &cameras[2].1, true),
        ("parallel, cut", &cameras[3].1, true),
    ]) {
        let camera = camera.rays().unwrap();
        *scene.filter_mut() = Filter::default();
        if is_cut {
            scene.filter_mut().clip_by(Plane { normal: DVec3::new(1.0, 0.1, 0.2), point: centre + DVec3::X });
            scene.filter_mut().clip_by(Plane { normal: DVec3::NEG_Y, point: centre + DVec3::Y * 2.0 });
        }
        let film = reference(&mut scene, &camera, &lighting);
        let frame = draw(context, &scene, &camera, &lighting, opaque(&scene));
        let share = compare(name, &frame, &film, size);
        assert!(share <= 0.002, "{name}: {share}");
        assert!(
            film.iter().filter(|p| p.drawable != NOBODY).count() > film.len() / 10,
            "{name}: next to nothing is seen"
        );
    }
}

#[test]
fn pictures_far_from_the_origin_stay_exact() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    for (seed, centre) in [(5, DVec3::ZERO), (5, DVec3::new(1e7, -3e6, 2e7))] {
        let path = folder.path().join("scene.vxs");
        build_model(random_model(seed, 60, centre), 8, &path);
        let mut scene = load(&path);
        let size = (256, 256);
        for eye in [DVec3::new(9.0, 11.0, 10.5), DVec3::new(-20.0, 25.0, 40.0)] {
            let camera = Camera {
                eye: (centre + eye).into(),
                target: (centre + DVec3::splat(10.0)).into(),
                up: [0.1, 1.0, 0.0],
                projection: Projection::Perspective { fov_y_deg: 60.0 },
                width: size.0,
                height: size.1,
            };
            let camera = camera.rays().unwrap();
            for lighting in [Lighting::headlight(), Lighting::sunny(DVec3::new(0.4, 1.0, 0.3))] {
                let film = reference(&mut scene, &camera, &lighting);
                let frame = draw(context, &scene, &camera, &lighting, opaque(&scene));
                let name = format!("{centre} from {eye}");
                let share = compare(&name, &frame, &film, size);
                assert!(share <= 0.002, "{name}: {share}");
                check_picture(&name, &frame, &film);
            }
        }
    }
}

/// The pictures are the same but for the last bit of a few bytes, where both see the same.
fn check_picture(name: &str, frame: &Frame, film: &[FilmPixel]) {
    let expected =
        voxsight::render::Film { width: film.len() as u32, rows: 0..1, pixels: film.to_vec() }.to_rgb8();
    let mut off = 0;
    for (index, expected) in expected.pixels().enumerate() {
        if frame.drawables[index] != film[index].drawable {
            continue;
        }
        let worst = (0..3).map(|c| frame.picture[index][c].abs_diff(expected.0[c])).max().unwrap();
        assert!(worst <= 3, "{name}: pixel {index}: {:?} instead of {:?}", frame.picture[index], expected.0);
        off += u32::from(worst > 1);
    }
    assert!(f64::from(off) <= 0.01 * film.len() as f64, "{name}: {off} pixels are off by more than 1");
}

#[test]
fn one_pane_of_glass_is_the_cpus_and_hides_nothing() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    // A wall, and before it a pane that covers its middle.
    let mut model = Model::default();
    model.parts.push(Part { name: "sheet".to_owned(), mesh: sheet(2) });
    for (node, (name, scale, height, colour)) in
        [("wall", 10.0, 0.0, [200, 120, 40, 255]), ("pane", 4.0, 3.0, [30, 90, 220, 100])]
            .into_iter()
            .enumerate()
    {
        let node = node as u32;
        let size = DVec3::new(scale, scale, 1.0);
        let at = DVec3::new(-0.5 * scale, -0.5 * scale, height);
        let world_from_part =
            glam::DAffine3::from_scale_rotation_translation(size, glam::DQuat::IDENTITY, at);
        model.nodes.push(Node { name: name.to_owned(), ..Node::default() });
        model.objects.push(Object { node, part: 0, world_from_part, colour: Colour(colour) });
    }
    build_model(model, 8, &path);
    let scene = load(&path);
    let camera = Camera {
        eye: [0.5, 0.4, 9.0],
        target: [0.0, 0.1, 0.0],
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg: 50.0 },
        width: 128,
        height: 128,
    };
    let camera = camera.rays().unwrap();
    for lighting in [Lighting::headlight(), Lighting::sunny(DVec3::new(0.4, 1.0, 0.3))] {
        let settings = RenderSettings {
            samples_per_pixel: 1,
            lighting: lighting.clone(),
            shadows: Shadows::None,
            up: DVec3::Y,
            seed: 0,
        };
        let picture = scene.picture();
        let (film, _) = Renderer::new(&picture, &camera, &settings).rows(0..128, &Silent).unwrap();
        let frame = draw(context, &scene, &camera, &lighting, |_| true);
        // The frame's drawables are those behind the glass, the film's those before: pictures alone are compared.
        let expected = film.to_rgb8();
        let (mut panes, mut off) = (0, 0);
        for (index, expected) in expected.pixels().enumerate() {
            let worst = (0..3).map(|c| frame.picture[index][c].abs_diff(expected.0[c])).max().unwrap();
            panes += u32::from(film.pixels[index].drawable == 1);
            off += u32::from(worst > 2);
            assert!(frame.drawables[index] != 1, "glass is not what is opaque");
        }
        println!("glass: {panes} pixels, {off} off by more than 2");
        assert!(panes > 1000 && off < 40, "{panes} {off}");
    }
}
