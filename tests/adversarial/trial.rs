//! A scene on trial: asks every method, and checks what each promises whatever the scene.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use voxsight::camera::{Camera, CameraRays, Projection};
use voxsight::loaded::LoadedScene;
use voxsight::model::{Colour, Mesh, Model, Node, Object, Part};
use voxsight::occlusion::OcclusionScene;
use voxsight::occlusion::hzb::{Hzb, HzbSettings};
use voxsight::occlusion::hzm::{Hzm, HzmSettings};
use voxsight::prepare::{BuildSettings, Resolution, build};
use voxsight::progress::Silent;
use voxsight::report::Findings;
use voxsight::visibility::coherent::CoherentQuery;
use voxsight::visibility::culling::{Culling, FreshQuery};
use voxsight::visibility::{
    Jitter, Method, QueryScene, QuerySettings, RayMethod, RaysPerPixel, VisibleSet, query,
};
use voxsight_voxel::raycast::{GridRay, Next};

use crate::common::brute_force::{Agreement, FlatScene, compare_with_brute_force};
use crate::common::load;
use crate::frames::OverFrames;

/// Rays per pixel of the dense reference; none goes through a centre.
const DENSE: QuerySettings = QuerySettings {
    rays_per_pixel: RaysPerPixel::rays(2),
    first_sample: 1,
    jitter: Jitter::Regular,
    adaptive: false,
};
/// A ray through the middle of every pixel, which is where depth images look.
const CENTRES: QuerySettings = QuerySettings { rays_per_pixel: RaysPerPixel::ONE, first_sample: 0, ..DENSE };

/// Pixels that are compared with brute force, about.
const BRUTE_FORCE_PIXELS: u64 = 800;
/// Where there are many triangles, pixels times triangles, about.
const BRUTE_FORCE_TESTS: u64 = 20_000_000;

/// A scene in the making. Objects count from 0; of a part of one chunk, the object's number is its drawable's.
#[derive(Default)]
pub struct Maker {
    model: Model,
}

impl Maker {
    /// A part, not placed yet.
    pub fn part(&mut self, mesh: Mesh) -> u32 {
        self.model.parts.push(Part { name: format!("part {}", self.model.parts.len()), mesh });
        self.model.parts.len() as u32 - 1
    }

    /// Places a part; returns the object.
    pub fn place(&mut self, part: u32, world_from_part: DAffine3) -> usize {
        let node = self.model.nodes.len() as u32;
        self.model.nodes.push(Node { name: format!("object {node}"), ..Node::default() });
        self.model.objects.push(Object { node, part, world_from_part, colour: Colour::default() });
        node as usize
    }

    /// A part of its own, placed where its mesh is.
    pub fn add(&mut self, mesh: Mesh) -> usize {
        let part = self.part(mesh);
        self.place(part, DAffine3::IDENTITY)
    }

    /// Makes an object of glass.
    pub fn glass(&mut self, object: usize) {
        self.model.objects[object].colour.0[3] = 90;
    }

    /// Through the real build, without coarser levels, and opened.
    pub fn on_trial(self, log2: u32) -> Trial {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.vxs");
        let resolution = Resolution::Log2(log2);
        let settings = BuildSettings { resolution, lod: false, ..BuildSettings::default() };
        build(self.model, Vec::new(), Findings::default(), &settings, &path, &Silent).unwrap();
        Trial::new(load(&path))
    }
}

/// A scene with all methods ready.
pub struct Trial {
    pub loaded: LoadedScene,
    flat: FlatScene,
    /// Asked in one frame after the other: `hzb` remembers.
    boxes: Vec<(&'static str, Box<dyn Culling>)>,
    over_frames: OverFrames,
}

/// What each method found: `exact` and `hybrid` with rays through the centres.
pub struct Answers {
    found: Vec<(&'static str, VisibleSet)>,
    /// `exact` between the centres.
    pub dense: VisibleSet,
    pub brute_force: Agreement,
}

fn fresh(method: Method) -> Box<dyn Culling> {
    Box::new(FreshQuery { method, settings: CENTRES })
}

/// The methods that draw depth images: as they come, and hiding as much as they can.
fn box_methods(loaded: &LoadedScene) -> Vec<(&'static str, Box<dyn Culling>)> {
    let exact = loaded.query().exact;
    let scene = Arc::new(OcclusionScene::new(exact));
    let hzm = |settings| Box::new(Hzm::new(scene.clone(), exact, settings)) as Box<dyn Culling>;
    let hzb = |settings| Box::new(Hzb::new(scene.clone(), settings)) as Box<dyn Culling>;
    let all = HzmSettings {
        compactness_threshold: 0.0,
        active_occluders: usize::MAX,
        finer_levels: 32,
        ..HzmSettings::default()
    };
    vec![
        ("hzm", hzm(HzmSettings::default())),
        ("hzm with all occluders", hzm(all)),
        ("hzb", hzb(HzbSettings::default())),
        ("hzb to the last pixel", hzb(HzbSettings { first_frame_triangles: 1, finer_levels: 32 })),
    ]
}

/// `voxel` in plain words: the scalar walk, one ray at a time.
fn first_voxels(scene: &QueryScene, camera: &CameraRays) -> VisibleSet {
    let count = scene.exact.drawable_count() as usize;
    let mut found =
        VisibleSet { samples: vec![0; count], visible: vec![false; count], ..VisibleSet::default() };
    let (width, height) = camera.size();
    for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
        found.rays += 1;
        found.weight += 1;
        let ray = camera.ray(f64::from(column) + 0.5, f64::from(row) + 0.5);
        let Some(ray) = scene.filter.clipped(&ray) else { continue };
        let ray = GridRay {
            origin: scene.grid.grid_from_world(ray.origin),
            direction: ray.direction / scene.grid.voxel_size,
            t_min: ray.t_min,
            t_max: ray.t_max,
        };
        let mut met: Vec<u32> = Vec::new();
        scene.dag.cast(&ray, |hit| {
            let owners = scene.owners.of_brick(hit.brick_ordinal(), hit.brick_mask());
            let there: Vec<u32> =
                owners.of_voxel(hit.bit()).filter(|&owner| !scene.filter.is_hidden(owner)).collect();
            there.iter().for_each(|&owner| found.visible[owner as usize] = true);
            let opaque = there.iter().find(|&&owner| !scene.exact.is_transparent(owner));
            let glass = there.iter().filter(|&&owner| scene.exact.is_transparent(owner));
            met.extend(glass.chain(opaque));
            if opaque.is_some() { Next::End } else { Next::Voxel }
        });
        met.sort_unstable();
        met.dedup();
        met.iter().for_each(|&owner| found.samples[owner as usize] += 1);
        found.hits += u64::from(!met.is_empty());
    }
    found
}

/// Drawables with samples that an answer lacks.
fn lost(seen: &VisibleSet, answer: &VisibleSet) -> Vec<usize> {
    (0..seen.samples.len()).filter(|&d| seen.samples[d] > 0 && !answer.visible[d]).collect()
}

impl Trial {
    /// Of an opened scene.
    pub fn new(loaded: LoadedScene) -> Self {
        let (flat, boxes) = (FlatScene::new(loaded.scene()), box_methods(&loaded));
        Trial { flat, boxes, over_frames: OverFrames::default(), loaded }
    }

    /// Asks all methods what the camera sees and checks what they promise, twice: `hzb` has a last frame then.
    pub fn look(&mut self, name: &str, camera: &Camera) -> Answers {
        let pixels = u64::from(camera.width) * u64::from(camera.height);
        let triangles = self.loaded.scene().meta().counts.placed_triangles;
        let compared = BRUTE_FORCE_PIXELS.min(BRUTE_FORCE_TESTS / triangles.max(1)).max(1);
        let step = ((pixels / compared) as f64).sqrt().ceil() as usize;
        let brute_force = compare_with_brute_force(name, &self.loaded, &self.flat, camera, step.max(1));
        let rays = camera.rays().unwrap();
        let scene = self.loaded.query();
        let ask = |method, settings| query(&scene, &rays, method, settings);
        let exact = ask(Method::Exact, &CENTRES);
        let hybrid = ask(Method::Hybrid, &CENTRES);
        assert_eq!(hybrid, exact, "{name}: hybrid is not exact; {camera:?}");
        let dense = ask(Method::Exact, &DENSE);
        assert_eq!(ask(Method::Hybrid, &DENSE), dense, "{name}: hybrid is not exact; {camera:?}");
        let voxel = ask(Method::Voxel, &CENTRES);
        assert_eq!(voxel, first_voxels(&scene, &rays), "{name}: voxel; {camera:?}");
        // What a triangle's hit lies in is occupied.
        assert!(voxel.hits >= exact.hits, "{name}: {} of {} rays hit voxels", voxel.hits, exact.hits);

        let frustum = ask(Method::Frustum, &CENTRES);
        for seen in [&exact, &dense] {
            assert_eq!(lost(seen, &frustum), [0; 0], "{name}: frustum; {camera:?}");
        }
        let mut found = vec![("exact", exact), ("hybrid", hybrid), ("voxel", voxel), ("frustum", frustum)];
        let seen_px = |d: usize| f64::from(dense.samples[d]) / DENSE.rays_per_pixel.get();
        for (method, culling) in &mut self.boxes {
            for frame in 0..2 {
                let answer = culling.frame(&scene, &rays, &Silent).unwrap().found;
                let lost_drawables = lost(&found[0].1, &answer);
                assert_eq!(lost_drawables, [0; 0], "{name}: {method}, frame {frame}; {camera:?}");
                let between = lost(&dense, &answer);
                if !between.is_empty() {
                    let most = between.iter().map(|&d| seen_px(d)).fold(0.0, f64::max);
                    println!(
                        "{name}: {method} loses {} drawables seen between the centres only, of up to {most:.1} px",
                        between.len()
                    );
                }
                if frame == 1 {
                    found.push((*method, answer));
                }
            }
        }
        let over_frames = self.over_frames.look(name, &scene, &rays);
        for (method, answer) in found.iter().chain(&over_frames) {
            let hidden = (0..answer.visible.len())
                .find(|&d| scene.filter.is_hidden(d as u32) && (answer.visible[d] || answer.samples[d] > 0));
            assert_eq!(hidden, None, "{name}: {method} shows what is hidden");
        }
        Answers { found, dense, brute_force }
    }

    /// The answers of all methods are the same for 1, 2 and 5 threads.
    pub fn assert_threads_do_not_matter(&self, camera: &Camera) {
        let loaded = &self.loaded;
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| -> Vec<VisibleSet> {
                let methods = [Method::Exact, Method::Hybrid, Method::Voxel, Method::Frustum].map(fresh);
                let coherent = [RayMethod::Hybrid, RayMethod::Voxel]
                    .map(|method| Box::new(CoherentQuery::of(method, RaysPerPixel::ONE)) as Box<dyn Culling>);
                let settings = QuerySettings { adaptive: true, ..QuerySettings::default() };
                let adaptive = FreshQuery { method: Method::Hybrid, settings };
                let methods =
                    methods.into_iter().chain(coherent).chain([Box::new(adaptive) as Box<dyn Culling>]);
                let boxes = box_methods(loaded).into_iter().map(|(_, culling)| culling);
                let rays = camera.rays().unwrap();
                let frames = |mut culling: Box<dyn Culling>| {
                    [0, 1].map(|_| culling.frame(&loaded.query(), &rays, &Silent).unwrap().found)
                };
                methods.chain(boxes).flat_map(frames).collect()
            })
        };
        let one = with(1);
        for threads in [2, 5] {
            assert_eq!(with(threads), one, "{threads} threads; {camera:?}");
        }
    }
}

impl Answers {
    /// The answer of a method.
    pub fn of(&self, method: &str) -> &VisibleSet {
        &self.found.iter().find(|(name, _)| *name == method).unwrap().1
    }

    /// Samples of `exact` through the centres.
    pub fn samples(&self, drawable: usize) -> u32 {
        self.of("exact").samples[drawable]
    }

    /// Methods that have the drawable in their answer.
    pub fn shown_by(&self, drawable: usize) -> Vec<&'static str> {
        self.found.iter().filter(|(_, answer)| answer.visible[drawable]).map(|(name, _)| *name).collect()
    }

    /// `exact` counts samples of the drawable, and every method shows it.
    pub fn assert_all_see(&self, drawable: usize, name: &str) {
        self.assert_all_but_see(&[], drawable, name);
    }

    /// `exact` counts samples of the drawable, and every method shows it, those apart that do not promise to.
    pub fn assert_all_but_see(&self, apart: &[&str], drawable: usize, name: &str) {
        assert!(self.samples(drawable) > 0, "{name}: drawable {drawable} is not seen");
        let is_blind = |(method, answer): &&(&'static str, VisibleSet)| {
            !answer.visible[drawable] && !apart.contains(method)
        };
        let blind: Vec<_> = self.found.iter().filter(is_blind).map(|(method, _)| method).collect();
        assert!(blind.is_empty(), "{name}: {blind:?} do not show drawable {drawable}");
    }

    /// Only `frustum`, whose boxes are aligned with the axes, may show the drawable.
    pub fn assert_cut_away(&self, drawable: usize, name: &str) {
        let shown_by = self.shown_by(drawable);
        assert!(
            shown_by.iter().all(|&method| method == "frustum"),
            "{name}: {drawable} shown by {shown_by:?}"
        );
    }

    /// Only `frustum`, which knows no occlusion, shows the drawable.
    pub fn assert_occluded(&self, drawable: usize, name: &str) {
        assert_eq!(self.shown_by(drawable), ["frustum"], "{name}: drawable {drawable}");
        assert_eq!(self.dense.samples[drawable], 0, "{name}: drawable {drawable}");
    }
}

/// Perspective.
pub fn perspective(eye: DVec3, target: DVec3, fov_y_deg: f64, size: (u32, u32)) -> Camera {
    let forward = (target - eye).normalize_or_zero();
    // Not along any view of these tests.
    let up = if forward.y.abs() > 0.9 { DVec3::Z } else { DVec3::Y };
    let projection = Projection::Perspective { fov_y_deg };
    let (width, height) = size;
    Camera { eye: eye.into(), target: target.into(), up: up.into(), projection, width, height }
}

/// Parallel rays.
pub fn parallel(eye: DVec3, target: DVec3, height: f64, size: (u32, u32)) -> Camera {
    let projection = Projection::Orthographic { height };
    Camera { projection, ..perspective(eye, target, 1.0, size) }
}
