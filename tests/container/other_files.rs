//! Files that are something else.

use super::*;

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
        (b"glTF\x02\0\0\0".to_vec(), "it looks like a GLB model: build a scene from it first"),
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
    assert!(message.contains("none.vxs: cannot be read"), "{message}");
}
