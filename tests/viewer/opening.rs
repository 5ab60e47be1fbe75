//! Models that are opened: the scene that is made of them, kept and made anew.

use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};

use voxsight::progress::Silent;
use voxsight::viewer::load::{Opened, cache_of, open};

use super::Sample;

/// A box, `size` units a side, as an OBJ file.
fn write_box(path: &Path, size: f64) {
    let corner = |i: usize| [0, 1, 2].map(|k| if i >> k & 1 == 1 { size } else { 0.0 });
    let mut text = String::from("o box\n");
    (0..8).map(corner).for_each(|[x, y, z]| text += &format!("v {x} {y} {z}\n"));
    for face in [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]] {
        text += &format!("f {} {} {} {}\n", face[0], face[1], face[2], face[3]);
    }
    fs::write(path, text).unwrap();
}

fn set_time(path: &Path, seconds: u64) {
    let time = SystemTime::now() + Duration::from_secs(seconds);
    fs::File::options().write(true).open(path).unwrap().set_modified(time).unwrap();
}

#[test]
fn a_scene_is_made_once_and_anew_when_its_model_changes() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("plant");
    fs::create_dir(&model).unwrap();
    write_box(&model.join("a.obj"), 1.0);
    // One of the user's own, by the name that people give.
    let own = folder.path().join("plant.vxs");
    fs::write(&own, b"mine").unwrap();
    let first = open(&model, &Silent).unwrap();
    assert_eq!(first.path, folder.path().join("plant.view.vxs"));
    assert!(first.remarks.iter().any(|remark| remark.contains("metres assumed")), "{:?}", first.remarks);
    assert!(first.remarks.iter().any(|remark| remark.contains("z assumed")), "{:?}", first.remarks);
    let written = || fs::metadata(&first.path).unwrap().modified().unwrap();
    set_time(&first.path, 10);
    let before = written();
    let again = open(&model, &Silent).unwrap();
    assert!(written() == before && again.remarks.is_empty(), "it is kept");
    // By another name of the same folder, from within.
    assert_eq!(cache_of(&model.join(".")).unwrap(), first.path.canonicalize().unwrap());
    // Another file, later.
    write_box(&model.join("b.obj"), 2.0);
    set_time(&model.join("b.obj"), 20);
    let more = open(&model, &Silent).unwrap();
    assert_eq!(more.scene.scene().objects().len(), 2);
    // One that is gone is missed, though nothing is newer.
    fs::remove_file(model.join("a.obj")).unwrap();
    set_time(&more.path, 60);
    assert_eq!(open(&model, &Silent).unwrap().scene.scene().objects().len(), 1);
    // One of an older version, or damaged, is only a copy.
    fs::write(&more.path, b"VOXS, but of another time").unwrap();
    set_time(&more.path, 60);
    assert_eq!(open(&model, &Silent).unwrap().scene.scene().objects().len(), 1);
    assert_eq!(fs::read(&own).unwrap(), b"mine");
    let names: Vec<_> =
        fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 3, "{names:?}");
}

#[test]
fn a_shorter_file_of_an_older_time_is_another_model() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("a.ply");
    let write = |comment: &str| {
        let head = format!("ply\nformat ascii 1.0\ncomment {comment}\nelement vertex 3\n");
        let properties = "property float x\nproperty float y\nproperty float z\nelement face 1\n";
        let rest = "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
        fs::write(&model, format!("{head}{properties}{rest}")).unwrap();
    };
    write("revision B, the longer one");
    let first = open(&model, &Silent).unwrap();
    set_time(&first.path, 60);
    assert!(open(&model, &Silent).unwrap().remarks.is_empty(), "it is kept");
    write("A");
    assert!(!open(&model, &Silent).unwrap().remarks.is_empty(), "it is made anew, and says what it guessed");
}

/// A glTF file whose one triangle is in `buffers/part.bin`.
fn write_triangle(folder: &Path, size: f32) {
    let bytes: Vec<u8> =
        [0.0, 0.0, 0.0, size, 0.0, 0.0, 0.0, size, 0.0].iter().flat_map(|x: &f32| x.to_le_bytes()).collect();
    fs::create_dir_all(folder.join("buffers")).unwrap();
    fs::write(folder.join("buffers/part.bin"), bytes).unwrap();
    let text = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"name":"plate"}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "buffers":[{"uri":"buffers/part.bin","byteLength":36}],"bufferViews":[{"buffer":0,"byteLength":36}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[9,9,0]}]}"#;
    fs::write(folder.join("part.gltf"), text).unwrap();
}

#[test]
fn files_that_a_model_refers_to_are_looked_at_wherever_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let size = || open(&folder.path().join("part.gltf"), &Silent).unwrap().scene.scene().meta().bounds.max[0];
    write_triangle(folder.path(), 1.0);
    assert!((size() - 1.0).abs() < 1e-3);
    let kept = folder.path().join("part.gltf.view.vxs");
    set_time(&kept, 10);
    let written = || fs::metadata(&kept).unwrap().modified().unwrap();
    let before = written();
    size();
    assert_eq!(written(), before, "it is kept");
    // Exported again, as long as before.
    write_triangle(folder.path(), 3.0);
    set_time(&folder.path().join("buffers/part.bin"), 20);
    assert!((size() - 3.0).abs() < 1e-3, "{}", size());
    // A line of libraries too long for a name, one of which is there: kept all the same.
    let long = folder.path().join("long.obj");
    write_box(&long, 1.0);
    let libraries = format!("mtllib {} a.mtl b.mtl/x", "x.mtl ".repeat(60));
    fs::write(&long, format!("{libraries}\n{}", fs::read_to_string(&long).unwrap())).unwrap();
    fs::write(folder.path().join("a.mtl"), "newmtl red\nKd 1 0 0\n").unwrap();
    open(&long, &Silent).unwrap();
    set_time(&folder.path().join("long.obj.view.vxs"), 10);
    assert!(open(&long, &Silent).unwrap().remarks.is_empty(), "it is kept");
    // A link that leads out of the folder is refused; what takes its place is not.
    #[cfg(unix)]
    {
        let elsewhere = tempfile::tempdir().unwrap();
        let library = elsewhere.path().join("library.mtl");
        fs::write(&library, "newmtl red\nKd 1 0 0\n").unwrap();
        let linked = folder.path().join("linked.obj");
        write_box(&linked, 1.0);
        let text = fs::read_to_string(&linked).unwrap();
        fs::write(&linked, format!("mtllib linked.mtl\nusemtl red\n{text}")).unwrap();
        std::os::unix::fs::symlink(&library, folder.path().join("linked.mtl")).unwrap();
        let refused = open(&linked, &Silent).unwrap();
        set_time(&refused.path, 10);
        assert!(open(&linked, &Silent).unwrap().remarks.is_empty(), "it is kept");
        fs::remove_file(folder.path().join("linked.mtl")).unwrap();
        fs::copy(&library, folder.path().join("linked.mtl")).unwrap();
        let colour = |opened: &Opened| opened.scene.scene().objects()[0].colour;
        assert_ne!(colour(&open(&linked, &Silent).unwrap()), colour(&refused));
    }
    // A material library that comes later.
    let model = folder.path().join("box.obj");
    write_box(&model, 1.0);
    fs::write(&model, format!("mtllib box.mtl\nusemtl red\n{}", fs::read_to_string(&model).unwrap()))
        .unwrap();
    let colour = || open(&model, &Silent).unwrap().scene.scene().objects()[0].colour;
    let plain = colour();
    set_time(&folder.path().join("box.obj.view.vxs"), 10);
    fs::write(folder.path().join("box.mtl"), "newmtl red\nKd 1 0 0\n").unwrap();
    assert_ne!(colour(), plain);
}

#[test]
fn what_cannot_be_opened_says_why_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let nothing = open(&folder.path().join("no.obj"), &Silent).err().unwrap().to_string();
    assert!(nothing.contains("no.obj"), "{nothing}");
    let broken = folder.path().join("broken.obj");
    fs::write(&broken, "v 1 2 x\n").unwrap();
    let told = open(&broken, &Silent).err().unwrap().to_string();
    assert!(told.contains("broken.obj"), "{told}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    let sample = Sample::new();
    fs::write(sample.path(), b"no scene").unwrap();
    assert!(open(&sample.path(), &Silent).err().unwrap().to_string().contains("plant.vxs"));
}

#[test]
fn steps_of_scripts_have_no_fields_that_mean_nothing() {
    use voxsight::viewer::script::Script;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("steps.json");
    let read = |text: &str| {
        fs::write(&path, text).unwrap();
        Script::read(&path)
    };
    read(r#"[{"do":"hide"},{"do":"wait"},{"do":"add_section","axis":"x"},{"do":"look_from","side":"top"}]"#)
        .unwrap();
    Script::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/viewer_session.json")).unwrap();
    for (wrong, part) in [
        (r#"[{"do":"hide","path":"/pump"}]"#, "there is no field `path`"),
        (r#"[{"do":"undo"},{"do":"click","x":1,"y":1,"button":2}]"#, "step 1"),
        (r#"[{"do":"jump"}]"#, "unknown variant `jump`"),
        (r#"[{"do":"add_section","axis":"w"}]"#, "unknown variant `w`"),
        (r#"[{"do":"jump"}]"#, "`check_lost`, `wait`, `click`"),
    ] {
        let told = read(wrong).unwrap_err().to_string();
        assert!(!told.contains("`wait`") || told.contains("jump"), "{told}");
        assert!(told.contains(part) && told.contains("steps.json"), "{told}");
    }
}
