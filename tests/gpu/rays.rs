//! Rays through the DAG on the GPU against their twin, and both against the reference in f64.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, IVec3, Vec3};
use voxsight::gpu::Context;
use voxsight::gpu::clear::ClearBricks;
use voxsight::gpu::dag::GpuDag;
use voxsight::gpu::shader;
use voxsight::gpu::twin::{self, GridRay};
use voxsight::loaded::LoadedScene;
use voxsight::sample::{PlantSettings, plant};
use voxsight_voxel::dag::DagRef;
use voxsight_voxel::raycast::{self, RayCaster};
use wgpu::util::DeviceExt;

use super::common::{Random, build_model, load, random_model};
use super::context;

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Listed {
    base: [i32; 3],
    t_end: f32,
    fraction: [f32; 3],
    padding_0: u32,
    direction: [f32; 3],
    padding_1: u32,
}

/// What the shader finds for each ray.
fn cast(context: &Context, dag: &GpuDag, rays: &[GridRay]) -> Vec<Option<IVec3>> {
    let device = &context.device;
    let module = shader::module(context, "rays", &[shader::DAG, include_str!("rays.wgsl")]);
    let constants = dag.constants();
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("main"),
        compilation_options: wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() },
        cache: None,
    });
    let listed: Vec<Listed> = rays
        .iter()
        .map(|ray| Listed {
            base: ray.base.to_array(),
            t_end: ray.t_end,
            fraction: ray.fraction.to_array(),
            padding_0: 0,
            direction: ray.direction.to_array(),
            padding_1: 0,
        })
        .collect();
    let rays = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: None,
        contents: bytemuck::cast_slice(&listed),
        usage: wgpu::BufferUsages::STORAGE,
    });
    let found = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 16 * listed.len() as u64,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    let entries = [
        wgpu::BindGroupEntry { binding: 0, resource: rays.as_entire_binding() },
        wgpu::BindGroupEntry { binding: 1, resource: found.as_entire_binding() },
    ];
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &entries,
    });
    let voxels = dag.bind(context, &pipeline.get_bind_group_layout(1));
    let mut encoder = device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.set_bind_group(1, &voxels, &[]);
    pass.dispatch_workgroups(listed.len().div_ceil(64) as u32, 1, 1);
    drop(pass);
    context.queue.submit([encoder.finish()]);
    let found: Vec<[i32; 4]> = bytemuck::pod_collect_to_vec(&context.read(&found).unwrap());
    found.into_iter().map(|[x, y, z, hit]| (hit == 1).then_some(IVec3::new(x, y, z))).collect()
}

fn split(point: DVec3, direction: Vec3, t_end: f32) -> GridRay {
    let whole = point.floor();
    GridRay { base: whole.as_ivec3(), fraction: (point - whole).as_vec3(), direction, t_end }
}

/// Rays from inside the grid, from its planes and corners, along axes and nearly so, short and long; and, if asked for, from outside.
fn random_rays(random: &mut Random, side: f64, count: usize, from_outside: bool) -> Vec<GridRay> {
    let ray = |random: &mut Random| {
        let mut point = (random.vector() * 0.5 + 0.5) * side;
        let mut direction = random.vector();
        match random.below(8) {
            0 => point = point.round().clamp(DVec3::ZERO, DVec3::splat(side)),
            1 => direction[random.below(3) as usize] = 0.0,
            2 => {
                direction =
                    DVec3::AXES[random.below(3) as usize] * if random.below(2) == 0 { 1.0 } else { -1.0 }
            }
            3 => direction[random.below(3) as usize] *= 1e-6,
            4 => {
                point = point.round().clamp(DVec3::ZERO, DVec3::splat(side));
                direction = direction.signum();
            }
            _ => {}
        }
        if from_outside {
            point = side * 0.5 + (point - side * 0.5) * 4.0;
            direction = side * (random.vector() * 0.3 + 0.5) - point;
        }
        let t_end = if random.below(4) == 0 { random.unit() * 20.0 } else { 1e6 };
        split(point, direction.normalize_or(DVec3::X).as_vec3(), t_end as f32)
    };
    (0..count).map(|_| ray(random)).collect()
}

/// The reference's answer for a ray as f32 has it.
fn reference(dag: DagRef, ray: &GridRay) -> Option<IVec3> {
    let origin = ray.base.as_dvec3() + ray.fraction.as_dvec3();
    let ray = raycast::GridRay {
        t_max: ray.t_end.into(),
        ..raycast::GridRay::new(origin, ray.direction.as_dvec3())
    };
    RayCaster::new(dag).first_hit(&ray).map(|(voxel, _)| voxel.into())
}

fn check(context: &Context, scene: &LoadedScene, name: &str, seed: u64) {
    let query = scene.query();
    let none = ClearBricks::default();
    let side = f64::from(query.grid.side());
    // All in one slab, and paged over as many as there are.
    let bytes = 4 * query.dag.words().len() as u64 + 8 * query.dag.leaves().len() as u64;
    let mut small = context.clone();
    small.limit_bindings((bytes / 3).next_power_of_two());
    for (context, kind) in [(context, "one slab"), (&small, "paged")] {
        let dag = GpuDag::new(context, &query.dag, &none).unwrap();
        for from_outside in [false, true] {
            let mut random = Random::new(seed);
            let rays = random_rays(&mut random, side, 20_000, from_outside);
            let found = cast(context, &dag, &rays);
            let hits = found.iter().flatten().count();
            let (mut differ, mut wrong) = (0, 0);
            for (number, (ray, found)) in rays.iter().zip(&found).enumerate() {
                let expected = twin::first_hit(&query.dag, &none, ray);
                // Entering from outside may be fused; nothing else may differ.
                assert!(
                    from_outside || *found == expected,
                    "{name}, seed {seed}, ray {number}: {found:?}, not {expected:?}"
                );
                differ += u32::from(*found != expected);
                wrong += u32::from(*found != reference(query.dag, ray));
            }
            println!(
                "{name}, {kind}, outside {from_outside}: {hits} hits of {}; {differ} differ from the twin, {wrong} from f64",
                rays.len()
            );
            assert!(hits > rays.len() / 20, "{name}: too few hits to mean anything");
            let most = if from_outside { rays.len() / 100 } else { rays.len() / 1000 };
            assert!(differ as usize <= most / 10 && wrong as usize <= most, "{name}: {differ} {wrong}");
        }
    }
}

#[test]
fn rays_meet_the_voxels_of_their_twin_in_one_slab_and_paged() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    for (seed, log2) in [(1, 6), (2, 9), (3, 12)] {
        build_model(random_model(seed, 60, DVec3::ZERO), log2, &path);
        check(context, &load(&path), &format!("shapes {seed} at 2^{log2}"), seed);
    }
    let settings = PlantSettings { objects: 1000, triangles: 100_000, ..PlantSettings::default() };
    build_model(plant(&settings), 11, &path);
    check(context, &load(&path), "plant", 4);
}

#[test]
fn voxels_of_glass_are_passed_and_those_that_it_shares_are_not() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    build_model(random_model(7, 80, DVec3::ZERO), 8, &path);
    let scene = load(&path);
    let query = scene.query();
    let casts = |drawable: u32| !query.exact.is_transparent(drawable);
    let clear = ClearBricks::new(&query.dag, &query.owners, casts);
    // Each voxel, by its owners.
    let (mut passed, mut shared) = (0, 0);
    query.dag.for_each_brick(|corner, ordinal, mask| {
        let owners = query.owners.of_brick(ordinal, mask);
        for bit in (0..64).filter(|bit| mask >> bit & 1 == 1) {
            let voxel = IVec3::from(corner) + IVec3::new(bit & 3, bit >> 2 & 3, bit >> 4);
            let stops = owners.of_voxel(bit as u32).any(casts);
            assert_eq!(clear.is_clear(voxel), !stops, "{voxel}");
            passed += u32::from(!stops);
            shared += u32::from(stops && !owners.of_voxel(bit as u32).all(casts));
        }
    });
    assert!(passed > 1000 && shared > 10, "{passed} {shared}");
    let dag = GpuDag::new(context, &query.dag, &clear).unwrap();
    let mut random = Random::new(8);
    let rays = random_rays(&mut random, f64::from(query.grid.side()), 20_000, false);
    let found = cast(context, &dag, &rays);
    let mut through = 0;
    for (ray, found) in rays.iter().zip(found) {
        assert_eq!(found, twin::first_hit(&query.dag, &clear, ray));
        through += u32::from(found != twin::first_hit(&query.dag, &ClearBricks::default(), ray));
    }
    assert!(through > 100, "{through}");
}
