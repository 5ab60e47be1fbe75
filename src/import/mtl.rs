//! MTL, the material library of an OBJ: names, diffuse colours, opacity.

use std::collections::HashMap;

use super::text::{first_word, name, number, three_numbers, trim, words};
use crate::model::Colour;

/// Colours by material name.
#[derive(Default)]
pub(super) struct Materials {
    colours: HashMap<String, Colour>,
    /// Lines that should have been a colour or an opacity.
    pub not_understood: u64,
}

impl Materials {
    pub fn colour(&self, material: &str) -> Option<Colour> {
        self.colours.get(material).copied()
    }

    /// Adds the materials of a library; of two with one name the later counts.
    pub fn add(&mut self, library: &[u8]) {
        let mut current: Option<Material> = None;
        for line in library.split(|&b| b == b'\n') {
            let (keyword, rest) = first_word(trim(line));
            if keyword == b"newmtl" {
                self.store(current.replace(Material::new(name(rest))));
                continue;
            }
            let Some(material) = &mut current else { continue };
            let understood = match keyword {
                // `Kd spectral file` and `Kd xyz` exist on paper; they count as not understood.
                b"Kd" => three_numbers(&mut words(rest)).map(|rgb| material.rgb = rgb),
                // `d -halo 0.5` depends on the view; the number is at the end.
                b"d" => words(rest).last().and_then(number).map(|d| material.alpha = d),
                b"Tr" => words(rest).last().and_then(number).map(|t| material.alpha = 1.0 - t),
                _ => Some(()),
            };
            self.not_understood += u64::from(understood.is_none());
        }
        self.store(current);
    }

    fn store(&mut self, material: Option<Material>) {
        if let Some(material) = material {
            let colour = material.colour();
            self.colours.insert(material.name, colour);
        }
    }
}

struct Material {
    name: String,
    rgb: [f64; 3],
    alpha: f64,
}

impl Material {
    fn new(name: String) -> Self {
        // What a material without Kd looks like is left open; grey, as an object without material.
        let Colour([r, g, b, _]) = Colour::default();
        Material { name, rgb: [r, g, b].map(|c| f64::from(c) / 255.0), alpha: 1.0 }
    }

    /// MTL numbers are written by exporters as they are shown, that is sRGB-encoded.
    fn colour(&self) -> Colour {
        let [r, g, b] = self.rgb;
        // `as u8` clamps, and maps NaN to 0.
        Colour([r, g, b, self.alpha].map(|c| (c * 255.0).round() as u8))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_and_opacity_are_read_and_nonsense_is_counted() {
        let mut materials = Materials::default();
        materials.add(
            b"Kd 1 1 1\r\nnewmtl red glass\r\nKd 1 0 0.5\r\nd 0.5\r\nmap_Kd x.png\r\nnewmtl thin\r\n\tTr 0.25\r\n\
              newmtl odd\nKd 1 0\nKd nan -1 7\nTr\nnewmtl last",
        );
        assert_eq!(materials.colour("red glass"), Some(Colour([255, 0, 128, 128])));
        assert_eq!(materials.colour("thin"), Some(Colour([190, 190, 190, 191])));
        assert_eq!(materials.colour("odd"), Some(Colour([0, 0, 255, 255])));
        assert_eq!(materials.colour("last"), Some(Colour::default()));
        assert_eq!(materials.colour("none"), None);
        assert_eq!(materials.not_understood, 2);
    }
}
