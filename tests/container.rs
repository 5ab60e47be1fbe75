//! The container: what is written is read back, and no bytes whatever make a reader panic.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

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

// --- A small scene ---

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

// --- Reading back ---

#[test]
fn a_scene_reads_back_as_it_was_written() {
    let (_folder, path) = sample();
    let (model, parts) = (sample_model(), sample_parts());
    let report = check(&path).unwrap();
    assert_eq!((report.pages, report.triangles), (7, 40 + 20 + 20 + 3 + 90 + 1 + 1));
    assert_eq!(report.file_bytes, fs::metadata(&path).unwrap().len());

    let scene = Scene::open(&path).unwrap();
    let counts = scene.meta().counts;
    assert_eq!((counts.nodes, counts.parts, counts.objects, counts.chunks, counts.levels), (8, 3, 5, 4, 7));
    assert_eq!((counts.drawables, counts.unique_triangles, counts.placed_triangles), (6, 134, 136));
    assert_eq!(scene.meta().sources[0].bytes, 4);
    assert_eq!(scene.report().findings.0["triangles dropped: no area"].count, 2);
    let container = scene.container();
    let voxels = sample_voxels(6);
    assert_eq!(
        (container.dag_nodes(), container.dag_leaves()),
        (&voxels.dag.words[..], &voxels.dag.leaves[..])
    );
    assert_eq!(
        (container.dag_counts(), container.owner_directory(), container.owner_pages()),
        (&voxels.dag.counts[..], &voxels.owners.directory[..], &voxels.owners.pages[..])
    );

    for (record, part) in scene.parts().iter().zip(&model.parts) {
        assert_eq!(scene.name(record.name), part.name);
    }
    for (i, (record, object)) in scene.objects().iter().zip(&model.objects).enumerate() {
        let origin = parts[object.part as usize].origin;
        assert_eq!(scene.world_from_part(i as u32), world_from_part(object.world_from_part, origin));
        assert_eq!((record.node, record.part, record.colour), (object.node, object.part, object.colour.0));
    }
    let mut level = 0;
    for (p, part) in parts.iter().enumerate() {
        for chunk in &part.chunks {
            for prepared in &chunk.levels {
                let mesh = scene.level_mesh(level).unwrap();
                let triangles: Vec<_> = prepared.mesh.triangles.iter().copied().map(canonical).collect();
                assert_eq!((&mesh.vertices, &mesh.triangles), (&prepared.mesh.vertices, &triangles));
                assert_eq!(scene.levels()[level as usize].error, prepared.error);
                let chunk_index = scene.level_chunk(level);
                assert_eq!(scene.chunks()[chunk_index as usize].offset, chunk.offset);
                assert_eq!(scene.chunk_part(chunk_index), p as u32);
                let expected: Vec<Vec3> =
                    mesh.vertices.iter().map(|&q| decode(chunk.offset, q, part.step)).collect();
                assert_eq!(scene.level_positions(level, &mesh), expected);
                level += 1;
            }
        }
    }
    let error = scene.level_mesh(level).unwrap_err();
    assert!(error.to_string().ends_with("there is no level 7: the container has 7"), "{error}");
}

#[test]
fn drawables_are_the_chunks_of_each_object_in_order() {
    let (_folder, path) = sample();
    let scene = Scene::open(&path).unwrap();
    let expected = [(0, 0), (1, 3), (2, 3), (3, 1), (3, 2), (4, 3)];
    let found: Vec<_> = scene.drawables().iter().map(|&Drawable { object, chunk }| (object, chunk)).collect();
    assert_eq!(found, expected);
    for object in 0..5 {
        let range = scene.object_drawables(object);
        assert!(range.clone().all(|d| scene.drawable_object(d) == object));
        assert_eq!(range.len(), if object == 3 { 2 } else { 1 });
    }
}

#[test]
fn the_tree_reads_like_the_models() {
    let (_folder, path) = sample();
    let scene = Scene::open(&path).unwrap();
    let model = sample_model();
    for node in 0..8 {
        assert_eq!(scene.node_path(node), model.path(node));
        let children: Vec<u32> = (0..8).filter(|&i| model.nodes[i as usize].parent == Some(node)).collect();
        assert_eq!(scene.children(node).collect::<Vec<_>>(), children, "children of {node}");
    }
    assert_eq!(scene.node_path(3), r"/Plant/Unit 1\/A/Pump/bolt");
    assert_eq!(scene.roots().collect::<Vec<_>>(), [0, 6]);
    assert_eq!(
        [0, 1, 2, 3, 5, 6].map(|node| scene.subtree_objects(node)),
        [0..4, 0..3, 0..3, 1..2, 3..4, 4..5]
    );
    assert_eq!(scene.name(scene.nodes()[2].extras), r#"{"part number":"P-4711"}"#);
    assert_eq!((scene.nodes()[0].object, scene.nodes()[7].object), (NONE, 4));
}

#[test]
fn find_searches_names_and_with_a_slash_paths() {
    let (_folder, path) = sample();
    let scene = Scene::open(&path).unwrap();
    let find = |text: &str| scene.find(text).collect::<Vec<_>>();
    assert_eq!(find("BOLT"), [3, 4, 7]);
    assert_eq!(find("ü"), [5]);
    assert_eq!(find("valve"), [0; 0]);
    assert_eq!(find("pump/b"), [3, 4]);
    assert_eq!(find("/plant/"), [1, 2, 3, 4, 5]);
    assert_eq!(find("/YARD"), [6, 7]);
    assert_eq!(find("/bolt"), [3, 4, 7]);
    // Every answer of the incremental path search is the plain one.
    for text in ["/", "/u", "t/", "a/p", r"1\/a", "t/unit 1\\/a/pump/bol", "d/bolt", "x/"] {
        let plain: Vec<u32> = (0..8).filter(|&n| scene.node_path(n).to_lowercase().contains(text)).collect();
        assert_eq!(find(text), plain, "{text}");
    }
}

fn tree_of(parents: impl Iterator<Item = Option<u32>>) -> Model {
    let nodes = parents.map(|parent| Node { name: "n".to_owned(), parent, ..Node::default() });
    Model { nodes: nodes.collect(), ..Model::default() }
}

#[test]
fn a_deep_tree_is_opened_and_searched_and_a_deeper_one_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("chain.vxs");
    let chain = |depth: u32| tree_of((0..depth).map(|i| i.checked_sub(1)));
    write_scene(&path, &chain(1_024), &[]).unwrap();
    let scene = Scene::open(&path).unwrap();
    assert_eq!(scene.find("n/n/n").count(), 1_022);
    assert_eq!(scene.node_path(1_023).len(), 2 * 1_024);
    assert_eq!(scene.roots().chain(scene.children(0)).collect::<Vec<_>>(), [0, 1]);
    let message = write_scene(&path, &chain(1_025), &[]).unwrap_err().to_string();
    assert!(message.contains("record 1024: expected a tree of at most 1024 levels, found 1025"), "{message}");
}

#[test]
fn a_wide_tree_is_opened_and_searched() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wide.vxs");
    // Chains of 1,000 nodes side by side: each is left again.
    write_scene(&path, &tree_of((0..100_000).map(|i| (i % 1_000 != 0).then(|| i - 1))), &[]).unwrap();
    let scene = Scene::open(&path).unwrap();
    assert_eq!((scene.roots().count(), scene.find("n/n/n").count()), (100, 99_800));
    write_scene(&path, &tree_of((0..100_000).map(|i| (i > 0).then_some(0))), &[]).unwrap();
    let scene = Scene::open(&path).unwrap();
    assert_eq!((scene.children(0).count(), scene.find("n/n").count()), (99_999, 99_999));
    check(&path).unwrap();
}

#[test]
fn names_and_extras_have_limits() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.vxs");
    for (name, extras, text) in [
        (65_536, 1 << 24, ""),
        (65_537, 2, "a name of at most 65536 bytes, found 65537"),
        (1, (1 << 24) + 1, "extras of at most 16777216 bytes, found 16777217"),
    ] {
        let extras = Some(format!("\"{}\"", "e".repeat(extras - 2)));
        let node = Node { name: "n".repeat(name), parent: None, extras };
        match write_scene(&path, &Model { nodes: vec![node], ..Model::default() }, &[]) {
            Ok(()) => assert!(text.is_empty() && check(&path).is_ok()),
            Err(error) => assert!(!text.is_empty() && error.to_string().contains(text), "{error}"),
        }
    }
}

#[test]
fn the_world_box_of_a_part_holds_all_its_points() {
    for seed in 0..300 {
        let mut random = oorandom::Rand64::new(seed);
        let mut number = |scale: f64| (random.rand_float() - 0.5) * scale;
        let matrix = DAffine3::from_cols_array(&[0; 12].map(|_: i32| number(10.0)));
        let placed = DAffine3::from_translation(DVec3::splat(number(1e9))) * matrix;
        let (a, b) = (Vec3::splat(number(1e4) as f32), Vec3::splat(number(1e4) as f32));
        let (low, high) = world_box(&placed, a.min(b), a.max(b));
        for _ in 0..20 {
            let at = Vec3::from([0; 3].map(|_: i32| number(1.0) as f32 + 0.5));
            let corner = Vec3::select(at.cmplt(Vec3::splat(0.5)), a, b);
            for point in [corner, a.min(b) + (a.max(b) - a.min(b)) * at.clamp(Vec3::ZERO, Vec3::splat(0.999))]
            {
                let world = placed.transform_point3(point.as_dvec3());
                assert!(
                    low.cmple(world).all() && world.cmple(high).all(),
                    "seed {seed}: {world} {low} {high}"
                );
            }
        }
    }
}

// --- The bytes ---

#[test]
fn the_same_scene_gives_the_same_bytes() {
    let ((_a, first), (_b, second)) = (sample(), sample());
    assert_eq!(fs::read(first).unwrap(), fs::read(second).unwrap());
}

#[test]
fn version_2_stays_version_2() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("one.vxs");
    // One triangle: raw pages, so that the bytes depend on nothing but this crate.
    let part = PreparedPart { step: Vec3::ONE, chunks: vec![chunk([0; 3], &[1])], ..PreparedPart::default() };
    let node = Node { name: "triangle".to_owned(), ..Node::default() };
    let object = Object { node: 0, part: 0, world_from_part: DAffine3::IDENTITY, colour: Colour::default() };
    let model = Model { nodes: vec![node], parts: vec![Part::default()], objects: vec![object] };
    write_scene(&path, &model, &[part]).unwrap();
    let bytes = fs::read(&path).unwrap();
    let hex: String = bytes[..64].iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(hex, GOLDEN_HEADER, "magic, version, sections, length, checksum, reserved");
    assert_eq!(format!("{:016x}", xxh3_64(&bytes)), GOLDEN_FILE, "XXH3-64 of the whole file");
}

/// Of the file that `version_2_stays_version_2` writes. A change here is a new [`VERSION`].
const GOLDEN_HEADER: &str = "564f585349474854020000000e000000200a00000000000020a7186b992ab8a3\
    0000000000000000000000000000000000000000000000000000000000000000";
const GOLDEN_FILE: &str = "34c527f918891ae6";

#[test]
fn every_truncation_is_refused() {
    let (folder, path) = sample();
    let bytes = fs::read(&path).unwrap();
    let cut = folder.path().join("cut.vxs");
    for length in 0..bytes.len() {
        fs::write(&cut, &bytes[..length]).unwrap();
        let message = Container::open(&cut).unwrap_err().to_string();
        assert!(message.contains("cut.vxs") && message.contains("build it again"), "{length}: {message}");
        if length > TABLE_END as usize {
            let lengths = format!("should have {} bytes and has {length}", bytes.len());
            assert!(message.contains(&lengths), "{length}: {message}");
        }
    }
    fs::write(&cut, [&bytes[..], &[0]].concat()).unwrap();
    assert!(Container::open(&cut).is_err(), "a byte too many");
}

#[test]
fn verify_finds_every_changed_byte() {
    let (folder, path) = sample();
    let mut bytes = fs::read(&path).unwrap();
    let changed = folder.path().join("changed.vxs");
    for at in 0..bytes.len() {
        for mask in [1, 0x10, 0x80, 0xff] {
            bytes[at] ^= mask;
            fs::write(&changed, &bytes).unwrap();
            assert!(check(&changed).is_err(), "byte {at} changed by {mask:#x}");
            bytes[at] ^= mask;
        }
    }
    fs::write(&changed, &bytes).unwrap();
    check(&changed).expect("the unchanged bytes are sound");
}

// --- Hostile bytes ---

/// A container as bytes, to be changed and made to look sound again.
struct Forgery(Vec<u8>);

impl Forgery {
    fn get<T: Pod>(&self, at: usize) -> Option<T> {
        self.0.get(at..at.checked_add(size_of::<T>())?).map(bytemuck::pod_read_unaligned)
    }

    fn put<T: Pod>(&mut self, at: usize, value: T) {
        self.0[at..at + size_of::<T>()].copy_from_slice(bytemuck::bytes_of(&value));
    }

    fn entry_at(kind: SectionKind) -> usize {
        size_of::<Header>() + kind.index() * size_of::<SectionEntry>()
    }

    fn entry(&self, kind: SectionKind) -> SectionEntry {
        self.get(Self::entry_at(kind)).unwrap()
    }

    fn section(&self, kind: SectionKind) -> Option<&[u8]> {
        let SectionEntry { offset, length, .. } = self.entry(kind);
        self.0.get(offset as usize..offset.checked_add(length)? as usize)
    }

    /// Makes the checksums of pages right.
    fn seal_pages(&mut self) {
        let (levels, geometry) = (self.entry(SectionKind::Levels), self.entry(SectionKind::Geometry));
        for i in 0..levels.length as usize / size_of::<LevelRecord>() {
            let at = levels.offset as usize + i * size_of::<LevelRecord>();
            let Some(mut record) = self.get::<LevelRecord>(at) else { return };
            let start = geometry.offset.wrapping_add(record.page_offset) as usize;
            let end = start.wrapping_add(record.vertex_bytes as usize + record.index_bytes as usize);
            if let Some(page) = self.0.get(start..end) {
                record.checksum = xxh3_64(page);
                self.put(at, record);
            }
        }
    }

    /// Makes the checksums of sections and header right, so that the checks behind them are reached.
    fn seal(&mut self) {
        for kind in SectionKind::ALL {
            if let Some(section) = self.section(kind) {
                let entry = SectionEntry { checksum: xxh3_64(section), ..self.entry(kind) };
                self.put(Self::entry_at(kind), entry);
            }
        }
        let header: Header = self.get(0).unwrap();
        self.put(0, Header { checksum: 0, ..header });
        let checksum = xxh3_64(&self.0[..TABLE_END as usize]);
        self.put(0, Header { checksum, ..header });
    }
}

/// Uses everything that a reader can ask a scene for.
fn use_all(path: &Path) -> Result<u64, ContainerError> {
    let scene = Scene::open(path)?;
    let mut sum = 0;
    for (i, node) in (0..).zip(scene.nodes()) {
        sum += (scene.node_path(i).len() + scene.name(node.extras).len()) as u64;
        sum += scene.children(i).count() as u64 + scene.subtree_objects(i).len() as u64;
    }
    sum += (scene.find("bolt").count() + scene.find("t/b").count() + scene.roots().count()) as u64;
    for (i, drawable) in (0..).zip(scene.drawables()) {
        assert_eq!(scene.drawable_object(i), drawable.object);
        assert!(scene.object_drawables(drawable.object).contains(&i));
        let (chunk, object) = (drawable.chunk, &scene.objects()[drawable.object as usize]);
        assert_eq!(scene.chunk_part(chunk), object.part);
        assert!(scene.world_from_part(drawable.object).is_finite());
        let chunk = &scene.chunks()[chunk as usize];
        for level in chunk.first_level..chunk.first_level + chunk.level_count {
            if let Ok(mesh) = scene.level_mesh(level) {
                assert!(scene.level_positions(level, &mesh).iter().all(|p| p.is_finite()));
                assert!(mesh.triangles.as_flattened().iter().all(|&v| (v as usize) < mesh.vertices.len()));
            }
        }
    }
    let bounds = scene.meta().bounds;
    let loaded = LoadedScene::new(scene, &Silent)?;
    for from in [DVec3::new(1.0, 0.3, 0.2), DVec3::new(-0.1, 0.2, 1.0)] {
        let camera = Camera::around(bounds.min.into(), bounds.max.into(), from, DVec3::Y, 8, 8);
        // The box may be a point too small for a camera.
        let Ok(rays) = camera.rays() else { continue };
        for method in [Method::Voxel, Method::Hybrid, Method::Exact, Method::Frustum] {
            sum += query(&loaded.query(), &rays, method, &QuerySettings::default()).hits;
        }
    }
    Ok(sum)
}

#[test]
fn sealed_forgeries_never_panic() {
    const INTERESTING: [u32; 12] =
        [0, 1, 2, 3, 7, 255, 65_536, 1 << 24, i32::MAX as u32, 1 << 31, u32::MAX - 1, u32::MAX];
    let (folder, path) = sample();
    let original = fs::read(&path).unwrap();
    let forged = folder.path().join("forged.vxs");
    let (mut opened, mut sound, trials) = (0, 0, 6_000);
    for seed in 0..trials {
        let mut random = oorandom::Rand32::new(seed);
        let mut forgery = Forgery(original.clone());
        for _ in 0..random.rand_range(1..4) {
            // Mostly the records and pages; now and then the table, or anything.
            let range = match random.rand_range(0..10) {
                0 => 64..TABLE_END as usize,
                1 => 0..original.len(),
                _ => {
                    let kind = SectionKind::ALL[random.rand_range(0..13) as usize];
                    let SectionEntry { offset, length, .. } = Forgery(original.clone()).entry(kind);
                    offset as usize..(offset + length) as usize
                }
            };
            let at = random.rand_range(range.start as u32..range.end as u32) as usize;
            let word = at & !3;
            match (random.rand_range(0..4), forgery.get::<u32>(word)) {
                (0, Some(_)) => forgery.put(word, INTERESTING[random.rand_range(0..12) as usize]),
                (1, Some(old)) => {
                    forgery.put(word, old.wrapping_add(random.rand_range(0..5)).wrapping_sub(2))
                }
                (2, Some(old)) => forgery.put(word, old ^ 1 << random.rand_range(0..32)),
                _ => forgery.0[at] = random.rand_u32() as u8,
            }
        }
        forgery.seal_pages();
        forgery.seal();
        fs::write(&forged, &forgery.0).unwrap();
        let outcome = std::panic::catch_unwind(|| (use_all(&forged).is_ok(), check(&forged).is_ok()));
        let (used, verified) = outcome.unwrap_or_else(|_| panic!("panicked on seed {seed}"));
        assert!(used || !verified, "seed {seed}: verify passed what does not open");
        opened += u32::from(used);
        sound += u32::from(verified);
    }
    // The trials reach all three outcomes, else they test little.
    assert!(
        sound > 100 && opened > sound + 100 && opened < trials as u32 - 1_000,
        "{opened} {sound} of {trials}"
    );
}

#[test]
fn forged_records_are_named_with_place_expected_and_found() {
    let (folder, path) = sample();
    let original = fs::read(&path).unwrap();
    let forged = folder.path().join("forged.vxs");
    let nan = f32::NAN.to_bits();
    // Section, record, byte in the record, forged word, part of the message.
    let cases = [
        (
            SectionKind::Nodes,
            3,
            16,
            5,
            "record 3 (byte ",
            "expected parent 2, whose subtree this is in, found 5",
        ),
        (SectionKind::Nodes, 2, 20, 9, "record 2", "expected a subtree that ends at 3 to 5, found 9"),
        (SectionKind::Nodes, 0, 20, 5, "record 5", "expected parent none, whose subtree this is in, found 0"),
        (
            SectionKind::Nodes,
            3,
            24,
            0,
            "record 3",
            "expected no object, or one that names this node, found 0",
        ),
        (SectionKind::Nodes, 0, 0, u32::MAX, "record 0", "expected a name inside the strings"),
        (SectionKind::Nodes, 6, 4, 0, "record 6", "not empty"),
        (SectionKind::Parts, 1, 12, u32::MAX, "record 1", "expected first chunk 1, and 1 to 3 of them"),
        (SectionKind::Parts, 0, 16, nan, "record 0", "powers of two"),
        (SectionKind::Parts, 0, 16, 0.75_f32.to_bits(), "record 0", "powers of two"),
        (SectionKind::Parts, 2, 40, nan, "record 2", "0 <= min <= max"),
        (SectionKind::Parts, 2, 52, 2, "record 2", "expected 1 triangles, as its chunks have, found 2"),
        (SectionKind::Objects, 1, 4, 0x7ff0_0000, "record 1", "expected a finite transform"),
        (
            SectionKind::Objects,
            0,
            144,
            3,
            "record 2",
            "expected no object, or one that names this node, found 0",
        ),
        (SectionKind::Objects, 0, 148, 3, "record 0", "expected a part below 3, found 3"),
        (SectionKind::Objects, 4, 152, 4, "record 4", "expected first drawable 5, found 4"),
        (SectionKind::Chunks, 1, 0, u32::MAX, "record 1", "expected offsets of 0 to 2^24 - 1"),
        (SectionKind::Chunks, 0, 16, 2, "record 1", "expected first level 2"),
        (SectionKind::Levels, 1, 0, 1, "record 1", "expected a page at byte"),
        (SectionKind::Levels, 0, 24, u32::MAX, "record 0", "expected 1 to 120 vertices, found 4294967295"),
        (SectionKind::Levels, 0, 28, u32::MAX, "record 0", "expected 1 to 65536 triangles, found 4294967295"),
        (SectionKind::Levels, 1, 32, nan, "record 1", "expected a finite error"),
        (SectionKind::Levels, 2, 32, 0, "record 0", "expected errors that do not shrink, found 0 after 0.5"),
        (SectionKind::Levels, 0, 36, 7, "record 0", "expected encoding 0 or 1 for the vertices, found 7"),
    ];
    for (kind, record, field, word, place, text) in cases {
        let mut forgery = Forgery(original.clone());
        let at = forgery.entry(kind).offset as usize + record * kind.record_size() + field;
        forgery.put(at, word);
        forgery.seal();
        fs::write(&forged, &forgery.0).unwrap();
        let message = Container::open(&forged).expect_err("forged").to_string();
        for part in ["forged.vxs: section \"", place, text, "build it again with `voxsight build`"] {
            assert!(message.contains(part), "{kind:?} {record} {field}: {part:?} is not in: {message}");
        }
    }
}

#[test]
fn verify_names_the_first_bad_page_whatever_the_threads() {
    let (_folder, path) = sample();
    let mut forgery = Forgery(fs::read(&path).unwrap());
    let geometry = forgery.entry(SectionKind::Geometry);
    let levels = forgery.entry(SectionKind::Levels).offset as usize;
    for level in [6, 3, 2] {
        let record: LevelRecord = forgery.get(levels + level * size_of::<LevelRecord>()).unwrap();
        forgery.0[(geometry.offset + record.page_offset) as usize + 1] ^= 4;
    }
    forgery.seal();
    fs::write(&path, &forgery.0).unwrap();
    Container::open(&path).expect("opening does not read pages");
    for threads in [1, 4] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let error = pool.install(|| check(&path)).unwrap_err();
        assert!(matches!(*error.problem, Problem::Page { level: 2, .. }), "{threads} threads: {error}");
    }
}

#[test]
fn verify_sees_a_box_that_is_not_its_parts() {
    let (_folder, path) = sample();
    // The part is nowhere placed: opening compares the boxes of objects with those of their parts.
    let mut model = sample_model();
    model.objects.retain(|object| object.part != 0);
    write_scene(&path, &model, &sample_parts()).unwrap();
    let mut forgery = Forgery(fs::read(&path).unwrap());
    let max_x = forgery.entry(SectionKind::Parts).offset as usize + 40;
    let old: f32 = forgery.get(max_x).unwrap();
    forgery.put(max_x, old + 0.5);
    forgery.seal();
    fs::write(&path, &forgery.0).unwrap();
    Container::open(&path).expect("opening does not decode");
    let message = check(&path).unwrap_err().to_string();
    assert!(
        message.contains("section \"parts\", record 0") && message.contains("as its vertices have"),
        "{message}"
    );
}

/// Changes the sample by `change`, makes its checksums right again, and returns what `verify` says.
fn verify_forged(change: impl FnOnce(&mut Forgery)) -> String {
    let (_folder, path) = sample();
    let mut forgery = Forgery(fs::read(&path).unwrap());
    change(&mut forgery);
    forgery.seal();
    fs::write(&path, &forgery.0).unwrap();
    check(&path).unwrap_err().to_string()
}

#[test]
fn placements_that_mean_nothing_are_not_sound() {
    for (value, text) in
        [(0.0, "expected a finite transform with an inverse"), (1e308, "expected a finite transform")]
    {
        let message = verify_forged(|forgery| {
            let objects = forgery.entry(SectionKind::Objects).offset as usize;
            for number in 0..12 {
                forgery.put(objects + 160 + 8 * number, value);
            }
        });
        assert!(message.contains("\"objects\", record 1") && message.contains(text), "{message}");
    }
    // Moved a little: the box does not follow.
    let message = verify_forged(|forgery| {
        let x = forgery.entry(SectionKind::Objects).offset as usize + 72;
        forgery.put(x, forgery.get::<f64>(x).unwrap() + 0.5);
    });
    assert!(
        message.contains("record 0") && message.contains("expected its part's box in world"),
        "{message}"
    );
    let message = verify_forged(|forgery| {
        let step = forgery.entry(SectionKind::Parts).offset as usize + 16;
        forgery.put(step, 2_f32.powi(46));
    });
    assert!(message.contains("powers of two, 2^-126 to 2^45"), "{message}");
}

#[test]
fn metadata_that_belongs_to_another_scene_is_not_sound() {
    // Written over the old text (and digits after it), so that the sections stay where they are.
    for (old, new, text) in [
        ("\"resolution\": 64", "\"resolution\": 65", "expected a resolution of 64"),
        ("\"max\": [\n      1", "\"max\": [\n      2", "as the objects have"),
        ("\"voxel_size\": 1", "\"voxel_size\": 10", "expected a grid around"),
    ] {
        let message = verify_forged(|forgery| {
            let meta = forgery.section(SectionKind::Meta).unwrap();
            let at = meta.windows(old.len()).position(|window| window == old.as_bytes()).expect(old);
            let at = forgery.entry(SectionKind::Meta).offset as usize + at;
            forgery.0[at..at + new.len()].copy_from_slice(new.as_bytes());
        });
        assert!(message.contains("section \"meta\"") && message.contains(text), "{old}: {message}");
    }
}

#[test]
fn forged_owners_are_refused_or_own_the_voxels_of_their_brick_and_no_others() {
    let (folder, path) = sample();
    let original = Forgery(fs::read(&path).unwrap());
    let (pages, directory) =
        (original.entry(SectionKind::OwnerPages), original.entry(SectionKind::OwnerDirectory));
    let mut refused: BTreeMap<String, u32> = BTreeMap::new();
    let mut accepted = 0;
    for byte in (directory.offset..directory.offset + directory.length)
        .chain(pages.offset..pages.offset + pages.length)
    {
        for bit in 0..8 {
            let mut forgery = Forgery(original.0.clone());
            forgery.0[byte as usize] ^= 1 << bit;
            forgery.seal();
            let forged = folder.path().join("forged.vxs");
            fs::write(&forged, &forgery.0).unwrap();
            match check(&forged) {
                Err(error) => {
                    let message = error.to_string();
                    let rule = message.split("expected ").nth(1).unwrap_or(&message);
                    *refused.entry(rule.split(", found").next().unwrap_or(rule).to_owned()).or_default() += 1;
                }
                Ok(_) => {
                    accepted += 1;
                    let container = Container::open(&forged).unwrap();
                    let (dag, owners) = (container.dag(), container.owners());
                    dag.for_each_brick(|_, ordinal, mask| {
                        let masks = owners.of_brick(ordinal, mask).masks();
                        let union = masks.iter().fold(0, |union, (_, mask)| union | mask);
                        assert!(masks.iter().all(|&(drawable, mask)| drawable < 6 && mask != 0));
                        assert!(masks.is_sorted_by_key(|(drawable, _)| *drawable) && union == mask);
                    });
                }
            }
        }
    }
    for rule in [
        "owner pages cover every brick",
        "the parts of an owner page lie in it",
        "an owner page has a start for each run",
        "an owner is a drawable, and owners of a set rise",
        "an owner run names an entry of its page's palette",
        "owner codes rise and lie in their page",
        "a masked owner run is one brick with several owners",
        "an owner code is as long as its brick's voxels ask for",
    ] {
        assert!(refused.keys().any(|message| message.contains(rule)), "never refused: {rule}; {refused:#?}");
    }
    // Another owner, or another share between two: as good as the true one without the triangles.
    assert!(accepted > 0 && accepted < refused.values().sum::<u32>(), "{accepted} accepted, {refused:#?}");
}

#[test]
fn verify_sees_extras_that_overlap() {
    let (_folder, path) = sample();
    let (strings, extras) = {
        let scene = Scene::open(&path).unwrap();
        (scene.container().section_length(SectionKind::Strings), scene.nodes()[2].extras)
    };
    let message = verify_forged(|forgery| {
        let at = forgery.entry(SectionKind::Strings).offset as usize + extras.offset as usize;
        forgery.0[at..at + extras.length as usize].fill(b'7');
        let nodes = forgery.entry(SectionKind::Nodes).offset as usize;
        // Numbers of 24, 23, ... digits, all of the same digits.
        for node in 0..8 {
            forgery.put(nodes + 32 * node + 8, [extras.offset, extras.length - node as u32]);
        }
    });
    assert!(strings < 8 * u64::from(extras.length - 7));
    assert!(message.contains("expected extras that do not overlap"), "{message}");
}

#[test]
fn verify_stops_when_asked() {
    let (_folder, path) = sample();
    let error = verify(&path, &CancelFlag(&AtomicBool::new(true))).unwrap_err();
    assert!(matches!(*error.problem, Problem::Cancelled), "{error}");
}

// --- Files that are something else ---

#[test]
fn other_files_are_refused_with_what_to_do() {
    let (folder, path) = sample();
    let original = fs::read(&path).unwrap();
    let with_version = |version: u32| {
        let mut bytes = original.clone();
        bytes[8..12].copy_from_slice(&version.to_le_bytes());
        bytes
    };
    let cases: [(Vec<u8>, &str); 8] = [
        (with_version(VERSION + 1), "use a newer voxsight"),
        (with_version(0), "build it again from its sources"),
        (b"glTF\x02\0\0\0".to_vec(), "it looks like a GLB model: build a container from it first"),
        (b"ply\nformat ascii 1.0".to_vec(), "PLY"),
        (b"# exported\nv 0 0 0".to_vec(), "OBJ"),
        (vec![0; 1000], "its first bytes are not VOXSIGHT"),
        (Vec::new(), "it is empty"),
        (MAGIC.to_vec(), "should have 512 bytes and has 8"),
    ];
    let other = folder.path().join("other.vxs");
    for (bytes, text) in cases {
        fs::write(&other, bytes).unwrap();
        let message = Scene::open(&other).unwrap_err().to_string();
        assert!(message.contains("other.vxs") && message.contains(text), "{text:?} is not in: {message}");
    }
    let message = Container::open(folder.path()).unwrap_err().to_string();
    assert!(message.contains("not a regular file"), "{message}");
    let message = Container::open(folder.path().join("none.vxs")).unwrap_err().to_string();
    assert!(message.contains("none.vxs: cannot open"), "{message}");
}

// --- The writer ---

#[test]
fn a_dropped_writer_leaves_the_old_file_and_nothing_else() {
    let (folder, path) = sample();
    let before = fs::read(&path).unwrap();
    let mut writer = ContainerWriter::create(&path).unwrap();
    writer.write_section(SectionKind::DagLeaves, &vec![7_u64; 1 << 18]).unwrap();
    assert_eq!(files_in(folder.path()).len(), 2, "the temporary file is beside the target");
    drop(writer);
    assert_eq!(files_in(folder.path()), ["plant.vxs"]);
    assert_eq!(fs::read(&path).unwrap(), before);
}

#[test]
fn an_unfinished_container_is_refused_and_leaves_the_old_file() {
    let (folder, path) = sample();
    let before = fs::read(&path).unwrap();
    let mut writer = ContainerWriter::create(&path).unwrap();
    writer.write_section::<u8>(SectionKind::Strings, &[]).unwrap();
    let twice = writer.write_section::<u8>(SectionKind::Strings, &[]).unwrap_err();
    assert!(twice.to_string().contains("expected it once, found it twice"), "{twice}");
    let missing = writer.finish().unwrap_err().to_string();
    assert!(missing.contains("section \"meta\": expected it, found nothing"), "{missing}");

    let mut writer = ContainerWriter::create(&path).unwrap();
    drop(writer.begin_section(SectionKind::Geometry).unwrap());
    assert!(writer.begin_section(SectionKind::Meta).is_err(), "the open section was not ended");
    assert!(writer.finish().is_err());

    let mut writer = ContainerWriter::create(&path).unwrap();
    let odd = writer.write_section(SectionKind::Nodes, &[0_u8; 33]).unwrap_err().to_string();
    assert!(odd.contains("records of 32 bytes each, found 33 bytes"), "{odd}");
    drop(writer);
    assert_eq!(files_in(folder.path()), ["plant.vxs"]);
    assert_eq!(fs::read(&path).unwrap(), before);
}

#[test]
fn what_a_killed_writer_left_is_removed_by_the_next_but_a_living_one_keeps_its_file() {
    let (folder, path) = sample();
    let before = fs::read(&path).unwrap();
    // Never dropped, like in a killed process, except that the lock stays.
    let mut living = ContainerWriter::create(&path).unwrap();
    living.write_section(SectionKind::DagLeaves, &vec![7_u64; 1 << 18]).unwrap();
    std::mem::forget(living);
    let temporary =
        files_in(folder.path()).into_iter().find(|name| name.starts_with(".plant.vxs.tmp-")).unwrap();
    for name in [".plant.vxs.tmp-killed", ".other.vxs.tmp-killed"] {
        fs::write(folder.path().join(name), b"half a file").unwrap();
    }
    assert_eq!(fs::read(&path).unwrap(), before, "the target is as it was");
    drop(ContainerWriter::create(&path).unwrap());
    let mut expected = vec![temporary, ".other.vxs.tmp-killed".into(), "plant.vxs".into()];
    expected.sort();
    assert_eq!(files_in(folder.path()), expected);
}

#[test]
fn a_scene_that_is_mapped_stays_readable_when_it_is_built_again() {
    let (_folder, path) = sample();
    let scene = Scene::open(&path).unwrap();
    write_scene(&path, &Model::default(), &[]).unwrap();
    assert_eq!(Scene::open(&path).unwrap().objects().len(), 0);
    assert_eq!((scene.objects().len(), scene.level_mesh(6).unwrap().triangles.len()), (5, 1));
}

#[test]
fn a_model_that_breaks_its_promises_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.vxs");
    let mut cases: Vec<(Model, &str)> = Vec::new();
    let mut case = |change: fn(&mut Model), text| {
        let mut model = sample_model();
        change(&mut model);
        cases.push((model, text));
    };
    case(|m| m.nodes[5].parent = Some(3), "expected parent 3, whose subtree this is in, found 2");
    case(|m| m.nodes[3].parent = Some(4), "expected parent 2");
    case(|m| m.nodes[3].name.clear(), "not empty");
    case(|m| m.objects[1].node = 99, "expected a node below 8, found 99");
    case(|m| m.objects[1].node = 2, "carries one already");
    case(|m| m.objects.swap(1, 2), "expected a node after the last object's");
    case(|m| m.objects[0].part = 3, "expected a part below 3, found 3");
    case(|m| m.objects[0].world_from_part.translation.x = f64::NAN, "expected a finite transform");
    case(|m| m.objects[3].world_from_part.matrix3.x_axis.x = 1e308, "expected a finite");
    for (model, text) in cases {
        let message = write_scene(&path, &model, &sample_parts()).unwrap_err().to_string();
        assert!(
            message.contains(text) && message.contains("cannot be written"),
            "{text:?} is not in: {message}"
        );
    }
    assert!(files_in(folder.path()).is_empty());
}

#[test]
fn more_drawables_than_the_limit_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("many.vxs");
    // 12,000 chunks placed 12,000 times: a file of a few megabytes that would ask for more than a gigabyte.
    let chunks = vec![chunk([0; 3], &[1]); 12_000];
    let parts = [PreparedPart { step: Vec3::ONE, chunks, ..PreparedPart::default() }];
    let nodes = vec![Node { name: "copy".to_owned(), ..Node::default() }; 12_000];
    let object =
        |node| Object { node, part: 0, world_from_part: DAffine3::IDENTITY, colour: Colour::default() };
    let model = Model { nodes, parts: vec![Part::default()], objects: (0..12_000).map(object).collect() };
    let message = write_scene(&path, &model, &parts).unwrap_err().to_string();
    assert!(message.contains("expected at most 134217728 drawables in all"), "{message}");
}

#[test]
fn a_missing_folder_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let message = ContainerWriter::create(folder.path().join("no/where.vxs")).unwrap_err().to_string();
    assert!(message.contains("where.vxs") && message.contains("does the folder exist"), "{message}");
}

#[cfg(unix)]
#[test]
fn devices_are_never_replaced_links_are_followed_and_files_get_the_usual_rights() {
    use std::os::unix::fs::PermissionsExt;
    assert!(matches!(*ContainerWriter::create("/dev/null").unwrap_err().problem, Problem::NotAFile));
    let (folder, path) = sample();
    let link = folder.path().join("link.vxs");
    std::os::unix::fs::symlink(&path, &link).unwrap();
    write_scene(&link, &Model::default(), &[]).unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(Scene::open(&path).unwrap().objects().len(), 0, "what the link names was replaced");
    let plain = folder.path().join("plain");
    fs::write(&plain, b"").unwrap();
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&path), mode(&plain));
}
