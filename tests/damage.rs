//! Containers of real models, cut and flipped: every damage is found, nothing panics.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

mod common;

use std::fs::OpenOptions;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

use common::{build_file, model_files, models_folder};
use voxsight::container::{Container, verify};
use voxsight::progress::Silent;

const CUTS: u32 = 50;
const FLIPS: u32 = 200;
/// Flips in the geometry after which all pages are decoded, not only verified.
const DECODED_FLIPS: u32 = 5;

fn write_byte(path: &Path, at: u64, byte: u8) {
    let mut file = OpenOptions::new().write(true).open(path).unwrap();
    file.seek(SeekFrom::Start(at)).unwrap();
    file.write_all(&[byte]).unwrap();
}

#[test]
fn containers_of_real_models_survive_50_cuts_and_200_flips_each() {
    let Some(models) = models_folder() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (path, cut) = (folder.path().join("scene.vxs"), folder.path().join("cut.vxs"));
    for (seed, file) in model_files(&models).into_iter().enumerate() {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        build_file(&file, 7, &path);
        let bytes = std::fs::read(&path).unwrap();
        verify(&path, &Silent).unwrap();
        let mut random = oorandom::Rand64::new(seed as u128);
        for round in 0..CUTS {
            let length = random.rand_range(0..bytes.len() as u64);
            std::fs::write(&cut, &bytes[..length as usize]).unwrap();
            assert!(
                Container::open(&cut).is_err(),
                "{name}, seed {seed}, round {round}: cut at {length} is accepted"
            );
        }
        let mut in_geometry = 0;
        for round in 0..FLIPS {
            // Half of them in the header, the table and the first records, where they hurt most.
            let end = if round % 2 == 0 { bytes.len() as u64 } else { bytes.len().min(4096) as u64 };
            let at = random.rand_range(0..end);
            let flip = 1u8 << random.rand_range(0..8);
            write_byte(&path, at, bytes[at as usize] ^ flip);
            let place = || format!("{name}, seed {seed}, round {round}: byte {at} ^ {flip:#x}");
            // `verify` begins by opening: what is refused there need not be looked at again.
            if let Ok(container) = Container::open(&path) {
                // Only geometry is not read at opening: one page says why it does not decode.
                in_geometry += 1;
                assert!(verify(&path, &Silent).is_err(), "{} is not found", place());
                if in_geometry <= DECODED_FLIPS {
                    let levels = 0..container.levels().len() as u32;
                    let broken = levels.filter(|&level| container.decode_level(level).is_err()).count();
                    assert_eq!(broken, 1, "{}", place());
                }
            }
            write_byte(&path, at, bytes[at as usize]);
        }
    }
}
