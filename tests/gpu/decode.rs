//! Fetching and decoding on the GPU against the CPU, to the last bit.

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use voxsight::geometry::{self, LevelMesh};
use voxsight::gpu::Context;
use voxsight::gpu::instance::{Instance, Placement};
use voxsight::gpu::memory::{PagedMemory, Slabs};
use voxsight::gpu::shader;
use voxsight::streaming::{Memory, PageLayout, page};

use super::common::Random;
use super::context;

/// A triangle as the shader sees it.
struct Decoded {
    steps: [[u16; 3]; 3],
    positions: [Vec3; 3],
    normal: Vec3,
}

/// Runs `decode.wgsl` over a page.
fn decoded(context: &Context, pool: &Slabs, instance: Instance, triangles: u32) -> Vec<Decoded> {
    const WORDS: usize = 21;
    let device = &context.device;
    let module = shader::module(context, "decode", &[shader::PAGE, include_str!("decode.wgsl")]);
    let constants = pool.constants(shader::POOL_CONSTANTS);
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("main"),
        compilation_options: wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() },
        cache: None,
    });
    let instances = context.buffer("instance", &[instance], wgpu::BufferUsages::STORAGE);
    let found = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(triangles) * 4 * WORDS as u64,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    let others = [instances.as_entire_binding(), found.as_entire_binding()];
    let resources = pool.bindings().into_iter().chain(others);
    let group = context.bind("decode", &pipeline.get_bind_group_layout(0), resources);
    let mut encoder = device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.dispatch_workgroups(triangles.div_ceil(64), 1, 1);
    drop(pass);
    context.queue.submit([encoder.finish()]);
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(&context.read(&found).unwrap());
    let triangle = |words: &[u32]| Decoded {
        steps: [0, 1, 2].map(|c| [0, 1, 2].map(|axis| u16::try_from(words[6 * c + axis]).unwrap())),
        positions: [0, 1, 2]
            .map(|c| Vec3::from([0, 1, 2].map(|axis| f32::from_bits(words[6 * c + 3 + axis])))),
        normal: Vec3::from([18, 19, 20].map(|at| f32::from_bits(words[at]))),
    };
    words.chunks_exact(WORDS).map(triangle).collect()
}

fn random_mesh(random: &mut Random, vertices: u32, triangles: u32) -> LevelMesh {
    let coordinate = |random: &mut Random| match random.below(8) {
        0 => 0,
        1 => u16::MAX,
        _ => random.below(1 << 16) as u16,
    };
    LevelMesh {
        vertices: (0..vertices).map(|_| [0; 3].map(|_: i32| coordinate(random))).collect(),
        triangles: (0..triangles).map(|_| [0; 3].map(|_: i32| random.below(vertices))).collect(),
    }
}

#[test]
fn positions_are_those_of_the_cpu_to_the_last_bit() {
    let Some(context) = context() else { return };
    for (seed, vertices, triangles) in [
        (1, 3, 1),
        (2, 256, 700),
        (3, 257, 300),
        (4, 65_536, 2000),
        (5, 65_537, 2000),
        (6, 70_001, 9000),
        (7, 196_608, 65_536),
    ] {
        let mut random = Random::new(seed);
        let mesh = random_mesh(&mut random, vertices, triangles);
        let offset = [0; 3].map(|_: i32| random.below((1 << 24) - (1 << 16)) as i32);
        let step = [0; 3].map(|_: i32| 2f32.powi(random.below(40) as i32 - 30));
        let layout = PageLayout::new(vertices, triangles);
        // Small slabs, so that pages lie across two, and not at the start.
        let mut small = context.clone();
        small.limit_bindings(1 << 19);
        let before = 16 * u64::from(random.below(10_000));
        let mut memory = PagedMemory::new(&small, before + u64::from(layout.bytes)).unwrap();
        memory.write(before, &page::encode(&mesh));
        let mut encoder = context.device.create_command_encoder(&Default::default());
        memory.flush(context, &mut encoder);
        context.queue.submit([encoder.finish()]);
        // Placed as it is: the eye at the origin of an unmoved part, which the far form does not subtract.
        let diagonal = |axis: usize| Vec3::AXES[axis] * step[axis];
        let instance = Instance {
            column_x: diagonal(0).to_array(),
            column_y: diagonal(1).to_array(),
            column_z: diagonal(2).to_array(),
            base: offset,
            ..Instance::default().with_page(&layout, before)
        };
        let found = decoded(context, memory.slabs(), instance, triangles);
        assert_eq!(found.len(), triangles as usize);
        for (triangle, found) in mesh.triangles.iter().zip(&found) {
            for (corner, &vertex) in triangle.iter().enumerate() {
                let q = mesh.vertices[vertex as usize];
                assert_eq!(found.steps[corner], q, "seed {seed}");
                let expected = geometry::decode(offset, q, step.into());
                let bits = |p: Vec3| p.to_array().map(f32::to_bits);
                assert_eq!(bits(found.positions[corner]), bits(expected), "seed {seed}");
            }
        }
    }
}

#[test]
fn placed_positions_are_as_exact_as_their_distance_and_normals_as_f32() {
    let Some(context) = context() else { return };
    let (mut worst_place, mut worst_normal) = (0f64, 0f64);
    for seed in 0..24 {
        let mut random = Random::new(100 + seed);
        let (vertices, triangles) = (3000, 4000);
        let mut mesh = random_mesh(&mut random, vertices, triangles);
        // Some long slivers: two corners almost in line with the third.
        for i in (0..vertices as usize).step_by(3) {
            let [x, y, z] = mesh.vertices[i];
            mesh.vertices[(i + 1) % 3000] = [x, y, z].map(|c| c / 2);
            mesh.vertices[(i + 2) % 3000] = [x / 4, y / 4, (z / 4).saturating_add(random.below(3) as u16)];
        }
        let step = DVec3::new(1.0, 0.5, 0.25) * 2f64.powi(random.below(24) as i32 - 18);
        let mirror = if seed % 3 == 0 { DVec3::new(1.0, -1.0, 1.0) } else { DVec3::ONE };
        let scale = DMat3::from_diagonal(mirror * (random.vector().abs() + 0.1));
        let turn = DQuat::from_axis_angle(random.vector().normalize_or(DVec3::X), 6.0 * random.unit());
        let origin = random.vector() * if seed % 2 == 0 { 1e7 } else { 10.0 };
        let linear = DMat3::from_quat(turn) * scale;
        let world_from_part = DAffine3 { matrix3: linear, translation: origin };
        let offset = [random.below(1 << 20) as i32, 0, random.below(1 << 10) as i32];
        let placement = Placement { offset, step, world_from_part };
        // In the middle of the part, beside it, and very far away.
        let middle = (DVec3::from(offset.map(f64::from)) + 30_000.0) * step;
        let away = [0.0, 1e5, 1e14][seed as usize % 3] * step.max_element();
        let eye = world_from_part.transform_point3(middle) + random.vector() * away;
        let layout = PageLayout::new(vertices, triangles);
        let mut memory = PagedMemory::new(context, layout.bytes.into()).unwrap();
        memory.write(0, &page::encode(&mesh));
        let mut encoder = context.device.create_command_encoder(&Default::default());
        memory.flush(context, &mut encoder);
        context.queue.submit([encoder.finish()]);
        let instance = Instance::placed(&placement, eye).with_page(&layout, 0);
        let found = decoded(context, memory.slabs(), instance, triangles);
        for (triangle, found) in mesh.triangles.iter().zip(&found) {
            let exact = triangle.map(|vertex| {
                let q = DVec3::from(mesh.vertices[vertex as usize].map(f64::from));
                world_from_part.transform_point3((DVec3::from(offset.map(f64::from)) + q) * step)
            });
            for (corner, exact) in exact.iter().enumerate() {
                let relative = *exact - eye;
                let error = (found.positions[corner].as_dvec3() - relative).length();
                // f64 world coordinates of the oracle are themselves rounded.
                let rounding = exact.abs().max_element().max(eye.abs().max_element()) * 4.0 * f64::EPSILON;
                let of_distance = (error - rounding).max(0.0) / (relative.length() + step.min_element());
                worst_place = worst_place.max(of_distance);
            }
            // Edges in steps are whole numbers: their cross product is exact in f64.
            let q = triangle.map(|vertex| DVec3::from(mesh.vertices[vertex as usize].map(f64::from)));
            let edges = [q[1] - q[0], q[2] - q[0]].map(|edge| linear * (edge * step));
            let expected = edges[0].cross(edges[1]);
            let in_steps = (q[1] - q[0]).cross(q[2] - q[0]);
            if in_steps == DVec3::ZERO {
                assert_eq!(found.normal, Vec3::ZERO, "seed {seed}");
                continue;
            }
            // What turning by cofactors gives in f64: edges of slivers lose digits in the cross product above.
            let (x, y, z) = (linear.x_axis * step.x, linear.y_axis * step.y, linear.z_axis * step.z);
            let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
            let exact = (cofactors * in_steps).normalize_or_zero();
            assert!(
                exact.dot(expected) >= 0.0
                    || expected.length() < 1e-9 * edges[0].length() * edges[1].length()
            );
            let angle = found.normal.as_dvec3().normalize_or_zero().cross(exact).length().asin().to_degrees();
            assert!(found.normal.as_dvec3().dot(exact) > 0.0, "seed {seed}: inside out");
            worst_normal = worst_normal.max(angle);
        }
    }
    println!("worst position {worst_place:.2e} of the distance, worst normal {worst_normal:.2e} degrees");
    assert!(worst_place < 1e-6, "{worst_place:e}");
    assert!(worst_normal < 0.05, "{worst_normal}");
}
