//! The container: what is written is read back, and no bytes whatever make a reader panic.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

mod bytes;
mod hostile;
mod other_files;
mod reading_back;
mod writer;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use bytemuck::Pod;
use glam::{DAffine3, DVec3, Vec3};
use tempfile::TempDir;
use voxsight::camera::Camera;
use voxsight::container::layout::{
    Header, LevelRecord, MAGIC, NONE, SectionEntry, SectionKind, TABLE_END, VERSION,
};
use voxsight::container::meta::{Axis, Bounds, DagMeta, Generator, GridMeta, Settings, Source};
use voxsight::container::page::canonical;
use voxsight::container::part::{GeometryWriter, encode_part};
use voxsight::container::tree::{SceneRecords, world_box, world_from_part};
use voxsight::container::{
    BuildReport, Container, ContainerError, ContainerWriter, Meta, Problem, VerifyReport, verify,
};
use voxsight::geometry::{LevelMesh, PreparedChunk, PreparedLevel, PreparedPart, decode};
use voxsight::loaded::LoadedScene;
use voxsight::model::{Colour, Model, Node, Object, Part};
use voxsight::progress::{CancelFlag, Silent};
use voxsight::scene::{Drawable, Scene};
use voxsight::visibility::{Method, QuerySettings, query};
use voxsight_voxel::grid::Grid;
use voxsight_voxel::voxelize::{Drawables, SnappedMesh, Voxelized, voxelize};
use xxhash_rust::xxh3::xxh3_64;

/// A fan of `count` triangles with vertices that the codecs can pack.
fn fan(count: u32) -> LevelMesh {
    let vertices = (0..count + 2).map(|i| [7 * i as u16, (i * i % 11) as u16, i as u16 / 2]).collect();
    LevelMesh { vertices, triangles: (0..count).map(|i| [i + 2, 0, i + 1]).collect() }
}

/// Levels of these triangle counts, with growing errors.
fn chunk(offset: [i32; 3], counts: &[u32]) -> PreparedChunk {
    let levels =
        counts.iter().zip(0u8..).map(|(&n, i)| PreparedLevel { mesh: fan(n), error: f32::from(i) * 0.5 });
    PreparedChunk { offset, levels: levels.collect() }
}

fn sample_parts() -> Vec<PreparedPart> {
    let part = |step: [f32; 3], chunks| PreparedPart {
        origin: DVec3::new(1.0, -2.0, 3.5),
        step: step.into(),
        chunks,
    };
    vec![
        part([0.5, 0.25, 2.0], vec![chunk([0, 0, 0], &[40, 20, 20])]),
        part([1.0; 3], vec![chunk([0, 0, 100_000], &[3]), chunk([70_000, 1, 2], &[90, 1])]),
        part([0.125; 3], vec![chunk([5, 6, 7], &[1])]),
    ]
}

fn sample_model() -> Model {
    let node = |name: &str, parent: Option<u32>| Node { name: name.to_owned(), parent, extras: None };
    let mut nodes = vec![
        node("Plant", None),
        node("Unit 1/A", Some(0)),
        node("Pump", Some(1)),
        node("bolt", Some(2)),
        node("bolt", Some(2)),
        node("Rohr\\Ü", Some(0)),
        node("Yard", None),
        node("bolt", Some(6)),
    ];
    nodes[2].extras = Some(r#"{"part number":"P-4711"}"#.to_owned());
    let object = |node, part, at: f64| Object {
        node,
        part,
        world_from_part: DAffine3::from_translation(DVec3::splat(at)) * DAffine3::from_rotation_z(at),
        colour: Colour([node as u8, 20, 30, 255]),
    };
    let part = |name: &str| Part { name: name.to_owned(), ..Part::default() };
    Model {
        nodes,
        parts: vec![part("casing"), part("pipe"), part("bolt")],
        objects: vec![
            object(2, 0, 0.5),
            object(3, 2, 1.0),
            object(4, 2, -3.0),
            object(5, 1, 1e6),
            object(7, 2, 9.0),
        ],
    }
}

/// Drawable i is a triangle near voxel (2 i, 2 i, 2 i): some bricks have one owner, some several.
struct Diagonal(u32);

impl Drawables for Diagonal {
    fn count(&self) -> u32 {
        self.0
    }
    fn load(&self, drawable: u32, mesh: &mut SnappedMesh) {
        let at = 256 * (2 * drawable as i32 % 60) + 100;
        mesh.vertices = vec![[at, at, at], [at + 300, at, at], [at, at + 700, at + 20]];
        mesh.triangles = vec![[0, 1, 2]];
    }
}

fn sample_voxels(drawables: u32) -> Voxelized {
    let grid = Grid { origin: DVec3::ZERO, voxel_size: 0.3, log2: 6 };
    voxelize(&grid, &Diagonal(drawables)).unwrap()
}

fn write_scene(path: &Path, model: &Model, parts: &[PreparedPart]) -> Result<(), ContainerError> {
    let mut writer = ContainerWriter::create(path)?;
    let mut geometry = GeometryWriter::begin(&mut writer)?;
    for part in parts {
        geometry.push(&encode_part(part).unwrap())?;
    }
    let geometry = geometry.end()?;
    let names: Vec<&str> = model.parts.iter().map(|part| part.name.as_str()).collect();
    let records = SceneRecords::new(&model.nodes, &model.objects, &names, geometry)
        .map_err(|damage| ContainerError::new(path, Problem::Unwritable(damage)))?;
    records.write(&mut writer)?;
    let voxels = sample_voxels(records.counts().drawables as u32);
    writer.write_section(SectionKind::DagNodes, &voxels.dag.words)?;
    writer.write_section(SectionKind::DagLeaves, &voxels.dag.leaves)?;
    writer.write_section(SectionKind::DagCounts, &voxels.dag.counts)?;
    writer.write_section(SectionKind::OwnerDirectory, &voxels.owners.directory)?;
    writer.write_section(SectionKind::OwnerPages, &voxels.owners.pages)?;
    let mut occupied = (0, 0);
    voxels.dag.view().for_each_brick(|_, _, mask| {
        occupied = (occupied.0 + 1, occupied.1 + u64::from(mask.count_ones()));
    });
    let bounds = records.bounds().unwrap_or(Bounds { min: [0.0; 3], max: [0.0; 3] });
    let extent = (DVec3::from(bounds.max) - DVec3::from(bounds.min)).max_element();
    let voxel_size = f64::max(0.3, extent / 64.0);
    writer.write_json(
        SectionKind::Meta,
        &Meta {
            generator: Generator { name: "test".to_owned(), version: "0".to_owned() },
            sources: vec![Source::of("plant.glb", b"glTF")],
            settings: Settings {
                resolution: 64,
                lod: true,
                max_position_error: Some(0.1),
                unit: "mm".to_owned(),
                metres_per_unit: 1e-3,
                up: Axis::Z,
            },
            bounds,
            grid: GridMeta { origin: bounds.min, voxel_size, log2: 6 },
            dag: DagMeta {
                root: voxels.dag.shape.root,
                height_ends: voxels.dag.shape.height_ends.clone(),
                brick_count: occupied.0,
                voxel_count: occupied.1,
            },
            counts: records.counts(),
        },
    )?;
    let mut report = BuildReport::default();
    report.findings.add("triangles dropped: no area", 2, || "node Pump".to_owned());
    report.statistics.insert("bits per voxel".to_owned(), 0.25.into());
    writer.write_json(SectionKind::Report, &report)?;
    writer.finish()
}

/// A folder with the sample scene in it.
fn sample() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plant.vxs");
    write_scene(&path, &sample_model(), &sample_parts()).unwrap();
    (folder, path)
}

fn check(path: &Path) -> Result<VerifyReport, ContainerError> {
    verify(path, &Silent)
}

fn files_in(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}
