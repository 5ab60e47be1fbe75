//! Which required extensions can be honoured. Checked before any buffer is loaded.

use crate::import::draft::Source;
use crate::import::error::ImportError;

pub(super) const DRACO: &str = "KHR_draco_mesh_compression";
pub(super) const MESHOPT: &str = "EXT_meshopt_compression";

/// Extensions that change geometry and are read here.
const READ: [&str; 2] = ["KHR_mesh_quantization", "EXT_mesh_gpu_instancing"];

/// Beginnings of the names of extensions that change only how surfaces shine, what textures are made of, or
/// what is known about a thing: geometry and base colour are right without them.
const HARMLESS: [&str; 13] = [
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "KHR_animation_",
    "KHR_xmp",
    "EXT_texture_",
    "EXT_lights_",
    "EXT_mesh_features",
    "EXT_instance_features",
    "EXT_structural_metadata",
    "MSFT_texture_",
    "ADOBE_materials_",
    "AGI_articulations",
];

/// Refuses, by name, what the file requires and nobody here understands.
pub(super) fn check(source: &Source, required: &[String]) -> Result<(), ImportError> {
    let is_fine = |name: &str| READ.contains(&name) || HARMLESS.iter().any(|start| name.starts_with(start));
    match required.iter().find(|name| !is_fine(name)) {
        Some(name) => Err(unsupported(source, name)),
        None => Ok(()),
    }
}

pub(super) fn unsupported(source: &Source, name: &str) -> ImportError {
    let advice = match name {
        DRACO => "export it again without Draco compression",
        MESHOPT | "KHR_meshopt_compression" => {
            "export it again without compression, or run `gltfpack -i IN.glb -o OUT.glb -noq`"
        }
        _ => "export it again without that extension",
    };
    // A name is as long as the file's author likes.
    let extension = name.chars().take(80).collect();
    ImportError::UnsupportedExtension { file: source.name.to_owned(), extension, advice }
}
