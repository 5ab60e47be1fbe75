//! glTF 2.0 and GLB.
//!
//! Read by hand over `serde_json`, only what matters here: see the module above for why. Transforms are f64
//! from the JSON text to the object. Meshes that several nodes use are one part; primitives of one colour
//! are merged, primitives of several colours become one child node each. Textures, cameras, lights, skins,
//! animations and morph targets are not used; what would change the shape is counted.

mod accessor;
mod container;
mod extensions;
mod json;
mod material;
mod mesh;
mod scene;
mod transform;

#[cfg(test)]
mod tests;

use accessor::Contents;
use container::Buffers;
use json::Document;

use super::UpAxis;
use super::draft::{Draft, Source};
use super::error::ImportError;

pub(super) fn read(source: &Source) -> Result<Draft, ImportError> {
    let (json, bin) = container::split(source)?;
    let document: Document = serde_json::from_slice(json)
        .map_err(|error| ImportError::Json { file: source.name.to_owned(), source: error })?;
    if !document.asset.version.starts_with("2.") {
        let found = super::error::excerpt(document.asset.version.as_bytes());
        return Err(source.invalid("asset.version", "2.0", format!("{found}: convert it to glTF 2.0")));
    }
    extensions::check(source, &document.extensions_required)?;
    let used = scene::check(source, &document)?;
    let buffers = Buffers::load(source, &document, bin)?;

    let mut draft = Draft { up_axis: Some(UpAxis::Y), metres_per_unit: Some(1.0), ..Draft::default() };
    let animations = document.animations.0.len() as u64;
    draft.findings.add("animations ignored: rest pose used", animations, || source.name.to_owned());

    let total_bytes = source.bytes.len() as u64 + buffers.file_bytes();
    let contents = Contents { source, document: &document, buffers: &buffers, total_bytes };
    let paints = material::paints(&document);
    let pieces = mesh::decode(contents, &used, &paints, &mut draft)?;
    scene::build(contents, &used, &pieces, &mut draft)?;
    draft.referred = buffers.into_referred();
    Ok(draft)
}
