//! The small picture of a saved view: PNG in base64 in the file.

use std::io::Cursor;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::png::PngDecoder;
use image::{DynamicImage, ImageDecoder, ImageFormat, RgbImage};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A picture of at most [`Thumbnail::MOST`] pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Thumbnail {
    image: RgbImage,
}

impl Thumbnail {
    /// Pixels a row and rows, at most.
    pub const MOST: (u32, u32) = (192, 120);

    /// A picture, made smaller where it is larger than a thumbnail; `None` when it has no pixels.
    pub fn new(picture: &RgbImage) -> Option<Self> {
        let (width, height) = picture.dimensions();
        if width == 0 || height == 0 {
            return None;
        }
        let ratio = |most: u32, side: u32| f64::from(most) / f64::from(side);
        let scale = ratio(Self::MOST.0, width).min(ratio(Self::MOST.1, height));
        if scale >= 1.0 {
            return Some(Thumbnail { image: picture.clone() });
        }
        let side = |side: u32, most: u32| ((f64::from(side) * scale).round() as u32).clamp(1, most);
        let (width, height) = (side(width, Self::MOST.0), side(height, Self::MOST.1));
        Some(Thumbnail { image: image::imageops::thumbnail(picture, width, height) })
    }

    /// Its pixels.
    pub fn image(&self) -> &RgbImage {
        &self.image
    }

    fn from_base64(text: &str) -> Result<Self, String> {
        let png = STANDARD.decode(text).map_err(|error| error.to_string())?;
        let decoder = PngDecoder::new(Cursor::new(png)).map_err(|error| error.to_string())?;
        let ((width, height), most) = (decoder.dimensions(), Self::MOST);
        // Before it is unpacked: a small file may hold a large picture.
        if width > most.0 || height > most.1 {
            return Err(format!(
                "it has {width} x {height} pixels; at most {} x {} are expected",
                most.0, most.1
            ));
        }
        let image = DynamicImage::from_decoder(decoder).map_err(|error| error.to_string())?;
        Ok(Thumbnail { image: image.into_rgb8() })
    }
}

impl Serialize for Thumbnail {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let mut png = Cursor::new(Vec::new());
        self.image.write_to(&mut png, ImageFormat::Png).map_err(serde::ser::Error::custom)?;
        to.serialize_str(&STANDARD.encode(png.into_inner()))
    }
}

impl<'de> Deserialize<'de> for Thumbnail {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let text = String::deserialize(from)?;
        Self::from_base64(&text)
            .map_err(|what| serde::de::Error::custom(format!("a thumbnail is no PNG in base64: {what}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(width: u32, height: u32, seed: u64) -> RgbImage {
        let mut random = oorandom::Rand32::new(seed);
        RgbImage::from_fn(width, height, |_, _| image::Rgb([0; 3].map(|_: u8| random.rand_u32() as u8)))
    }

    #[test]
    fn pictures_are_made_small_enough_and_keep_their_shape() {
        for (size, expected) in [
            ((192, 120), (192, 120)),
            ((1920, 1080), (192, 108)),
            ((1080, 1920), (68, 120)),
            ((10, 7), (10, 7)),
            ((10_000, 3), (192, 1)),
            ((1, 4000), (1, 120)),
        ] {
            let thumbnail = Thumbnail::new(&noise(size.0, size.1, 1)).unwrap();
            assert_eq!(thumbnail.image().dimensions(), expected, "{size:?}");
        }
        assert_eq!(Thumbnail::new(&RgbImage::new(0, 5)), None);
        let grey = RgbImage::from_pixel(999, 777, image::Rgb([10, 20, 30]));
        assert!(Thumbnail::new(&grey).unwrap().image().pixels().all(|pixel| pixel.0 == [10, 20, 30]));
    }

    #[test]
    fn pixels_survive_and_damage_is_told() {
        for seed in 0..10 {
            let thumbnail = Thumbnail::new(&noise(1 + 19 * seed as u32, 60, seed)).unwrap();
            let text = serde_json::to_string(&thumbnail).unwrap();
            assert_eq!(serde_json::from_str::<Thumbnail>(&text).unwrap(), thumbnail, "seed {seed}");
        }
        let mut large = Cursor::new(Vec::new());
        noise(193, 10, 1).write_to(&mut large, ImageFormat::Png).unwrap();
        let large = STANDARD.encode(large.into_inner());
        for (text, expected) in [(large.as_str(), "193 x 10"), ("AAAA", "PNG"), ("%", "base64")] {
            let error = serde_json::from_str::<Thumbnail>(&format!("\"{text}\"")).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
