//! The writer: what it replaces, what it leaves, what it refuses.

use super::*;

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
