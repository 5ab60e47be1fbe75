//! Models that are opened: the scene that is made of them, kept and made anew.

use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};

use voxsight::progress::Silent;
use voxsight::viewer::load::{cache_of, open};

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
    for (wrong, part) in [
        (r#"[{"do":"hide","path":"/pump"}]"#, "there is no field `path`"),
        (r#"[{"do":"undo"},{"do":"click","x":1,"y":1,"button":2}]"#, "step 1"),
        (r#"[{"do":"jump"}]"#, "unknown variant `jump`"),
    ] {
        let told = read(wrong).unwrap_err().to_string();
        assert!(told.contains(part) && told.contains("steps.json"), "{told}");
    }
}
