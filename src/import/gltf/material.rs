//! Base colours: one a material, as an object has one.

use super::json::{Document, Material, Pbr};
use crate::import::draft::Source;
use crate::import::error::ImportError;
use crate::model::Colour;

/// What pieces of a mesh are coloured and called by.
#[derive(Clone)]
pub(super) struct Paint {
    pub colour: Colour,
    pub label: String,
}

/// All materials of the document.
pub(super) fn paints(document: &Document) -> Vec<Paint> {
    let paint = |(i, material): (usize, &Material)| {
        let name = material.name.as_deref().unwrap_or_default();
        let label = if name.trim().is_empty() { format!("material {i}") } else { name.to_owned() };
        Paint { colour: colour(material), label }
    };
    document.materials.iter().enumerate().map(paint).collect()
}

/// The paint of a primitive; grey where it has no material.
pub(super) fn paint_of(
    source: &Source,
    paints: &[Paint],
    material: Option<usize>,
    place: impl FnOnce() -> String,
) -> Result<Paint, ImportError> {
    match material {
        None => Ok(Paint { colour: Colour::default(), label: "no material".to_owned() }),
        Some(index) => paints.get(index).cloned().ok_or_else(|| {
            source.invalid(place(), format!("one of {} materials", paints.len()), index.to_string())
        }),
    }
}

/// Alpha counts only in mode BLEND. A MASK only cuts holes by its texture: what is left is opaque, and so is
/// here the whole.
fn colour(material: &Material) -> Colour {
    let Pbr { base_color_factor } = material.pbr_metallic_roughness;
    let old = material.extensions.specular_glossiness.as_ref().and_then(|old| old.diffuse_factor);
    let [r, g, b, a] = base_color_factor.or(old).unwrap_or([1.0; 4]);
    let alpha = if material.alpha_mode.as_deref() == Some("BLEND") { a } else { 1.0 };
    Colour::from_linear([r, g, b, alpha])
}
