//! PNG.

use std::io::{self, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;

use png::{BitDepth, ColorType, Decoder, Encoder, SrgbRenderingIntent};

use super::{Film, blocks, open};
use crate::model::srgb_from_linear;

/// What a pixel is made of.
#[derive(Clone, Copy)]
pub(super) struct Layout {
    color: ColorType,
    depth: BitDepth,
    /// Light for screens; otherwise numbers.
    is_srgb: bool,
}

impl Layout {
    pub const COLOURS_8: Self = Layout { color: ColorType::Rgb, depth: BitDepth::Eight, is_srgb: true };
    pub const COLOURS_16: Self = Layout { color: ColorType::Rgb, depth: BitDepth::Sixteen, is_srgb: true };
    pub const IDS: Self = Layout { color: ColorType::Rgb, depth: BitDepth::Eight, is_srgb: false };
    pub const DEPTHS: Self = Layout { color: ColorType::Grayscale, depth: BitDepth::Sixteen, is_srgb: false };

    /// Bytes of a pixel.
    pub fn bytes(self) -> usize {
        self.color.samples() * self.depth as usize / 8
    }
}

/// 8 bits a value.
pub(super) fn encode_8(film: &Film) -> Vec<u8> {
    film.to_rgb8().into_raw()
}

/// 16 bits a value, high byte first.
pub(super) fn encode_16(film: &Film) -> Vec<u8> {
    let value = |c: f32| (srgb_from_linear(f64::from(c).clamp(0.0, 1.0)) * 65_535.0).round() as u16;
    film.pixels.iter().flat_map(|pixel| pixel.colour.map(|c| value(c).to_be_bytes())).flatten().collect()
}

/// Writes rows of this layout, with texts under their keywords.
pub(super) fn write(
    file: &mut impl Write,
    [width, height]: [u32; 2],
    layout: Layout,
    texts: &[(&str, String)],
    rows: &mut dyn FnMut(Range<u32>) -> io::Result<Vec<u8>>,
) -> io::Result<()> {
    let mut encoder = Encoder::new(file, width, height);
    encoder.set_color(layout.color);
    encoder.set_depth(layout.depth);
    if layout.is_srgb {
        encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
    }
    for (keyword, text) in texts {
        encoder.add_text_chunk((*keyword).to_owned(), text.clone())?;
    }
    let mut writer = encoder.write_header()?;
    let mut stream = writer.stream_writer()?;
    for range in blocks(height) {
        stream.write_all(&rows(range)?)?;
    }
    stream.finish()?;
    writer.finish()?;
    Ok(())
}

/// The last bytes of a whole file: the chunk IEND.
const END: [u8; 12] = [0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60, 0x82];

/// The text under a keyword, of a file that was not cut short.
pub(super) fn text(path: &Path, keyword: &str) -> Option<String> {
    let mut end = [0; END.len()];
    let mut file = open(path)?;
    file.seek(SeekFrom::End(-(END.len() as i64))).ok()?;
    file.read_exact(&mut end).ok()?;
    if end != END {
        return None;
    }
    let reader = Decoder::new(open(path)?).read_info().ok()?;
    let texts = &reader.info().uncompressed_latin1_text;
    texts.iter().find(|text| text.keyword == keyword).map(|text| text.text.clone())
}
