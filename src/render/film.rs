//! What a picture is made of before it becomes a file: linear colour and what lies under each pixel.

use std::ops::Range;

use glam::DVec3;
use image::{Rgb, RgbImage};

use crate::model::Colour;

/// No drawable.
pub const NOBODY: u32 = u32::MAX;

/// One pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmPixel {
    /// Mean over the samples, linear RGB, not clipped.
    pub colour: [f32; 3],
    /// Depth along the view of what the pixel's middle shows, world units; infinite where there is nothing.
    pub depth: f32,
    /// The drawable that it shows, transparent or not; [`NOBODY`] where there is nothing.
    pub drawable: u32,
    /// Its normal, world space, on the side that is seen, length 1; zero where there is nothing.
    pub normal: [f32; 3],
    /// Shadow rays by kind of light.
    pub shadow: [RayCount; KINDS],
}

/// Kinds of light that cast shadows, in the order of [`FilmPixel::shadow`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightKind {
    /// The sun.
    Sun,
    /// The sky.
    Sky,
    /// Shining rectangles.
    Area,
}

/// How many there are.
pub const KINDS: usize = 3;

impl LightKind {
    /// All.
    pub const ALL: [Self; KINDS] = [LightKind::Sun, LightKind::Sky, LightKind::Area];

    /// As it stands in reports.
    pub fn name(self) -> &'static str {
        match self {
            LightKind::Sun => "sun",
            LightKind::Sky => "sky",
            LightKind::Area => "area",
        }
    }
}

/// Shadow rays of a pixel towards a kind of light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayCount {
    /// Cast: towards points of the light that the surface faces.
    pub cast: u32,
    /// That met nothing.
    pub free: u32,
}

impl RayCount {
    /// Share of the light that comes through; `None` where no ray was cast.
    pub fn visibility(self) -> Option<f64> {
        (self.cast > 0).then(|| f64::from(self.free) / f64::from(self.cast))
    }
}

impl FilmPixel {
    /// Nothing there.
    pub const EMPTY: Self = FilmPixel {
        colour: [0.0; 3],
        depth: f32::INFINITY,
        drawable: NOBODY,
        normal: [0.0; 3],
        shadow: [RayCount { cast: 0, free: 0 }; KINDS],
    };
}

/// Whole rows of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Pixels a row.
    pub width: u32,
    /// Which rows of the picture.
    pub rows: Range<u32>,
    /// Row by row.
    pub pixels: Vec<FilmPixel>,
}

/// The colour of an object in [`Film::to_ids`]: 24 bits, red lowest, of `(id + 1) * 0x9E3779 mod 2^24` (invertible, and
/// neighbours differ to the eye).
pub fn id_colour(object: u32) -> [u8; 3] {
    let [r, g, b, _] = object.wrapping_add(1).wrapping_mul(0x9e_3779).to_le_bytes();
    [r, g, b]
}

impl Film {
    /// Rows that it has.
    pub fn height(&self) -> u32 {
        self.rows.end.saturating_sub(self.rows.start)
    }

    /// What a click on each pixel would pick, as colours ([`id_colour`]); black where nothing is. Transparent objects count as
    /// opaque here.
    pub fn to_ids(&self, object_of: impl Fn(u32) -> u32) -> RgbImage {
        self.image(|pixel| match pixel.drawable {
            NOBODY => Rgb([0; 3]),
            drawable => Rgb(id_colour(object_of(drawable))),
        })
    }

    /// As a picture for screens: sRGB, 8 bits, brighter than white is white.
    pub fn to_rgb8(&self) -> RgbImage {
        self.image(|pixel| {
            let [r, g, b] = pixel.colour.map(f64::from);
            let Colour([r, g, b, _]) = Colour::from_linear([r, g, b, 1.0]);
            Rgb([r, g, b])
        })
    }

    fn image(&self, of: impl Fn(&FilmPixel) -> Rgb<u8>) -> RgbImage {
        RgbImage::from_fn(self.width, self.height(), |x, y| {
            of(&self.pixels[y as usize * self.width as usize + x as usize])
        })
    }
}

/// f64 to a film's f32.
pub(super) fn to_f32(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}
