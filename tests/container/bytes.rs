//! The same scene gives the same bytes, and every changed byte is found.

use super::*;

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
