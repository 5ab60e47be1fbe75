//! What is written reads back.

use super::*;

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
