//! PNG.

use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;

use png::{BitDepth, ColorType, Decoder, Encoder, SrgbRenderingIntent};

use super::{Film, Fingerprint, KEYWORD, blocks, open};
use crate::atomic_file::AtomicFile;
use crate::model::srgb_from_linear;

pub(super) const BYTES_8: usize = 3;
pub(super) const BYTES_16: usize = 6;

/// 8 bits a value.
pub(super) fn encode_8(film: &Film) -> Vec<u8> {
    film.to_rgb8().into_raw()
}

/// 16 bits a value, high byte first.
pub(super) fn encode_16(film: &Film) -> Vec<u8> {
    let value = |c: f32| (srgb_from_linear(f64::from(c).clamp(0.0, 1.0)) * 65_535.0).round() as u16;
    film.pixels.iter().flat_map(|pixel| pixel.colour.map(|c| value(c).to_be_bytes())).flatten().collect()
}

/// Writes rows that [`encode_8`] or [`encode_16`] made.
pub(super) fn write(
    file: AtomicFile,
    [width, height]: [u32; 2],
    depth: BitDepth,
    fingerprint: Fingerprint,
    rows: &mut dyn FnMut(Range<u32>) -> io::Result<Vec<u8>>,
) -> io::Result<AtomicFile> {
    let mut file = BufWriter::new(file);
    let mut encoder = Encoder::new(&mut file, width, height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(depth);
    encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
    encoder.add_text_chunk(KEYWORD.to_owned(), fingerprint.text())?;
    let mut writer = encoder.write_header()?;
    let mut stream = writer.stream_writer()?;
    for range in blocks(height) {
        stream.write_all(&rows(range)?)?;
    }
    stream.finish()?;
    writer.finish()?;
    file.into_inner().map_err(io::IntoInnerError::into_error)
}

/// The last bytes of a whole file: the chunk IEND.
const END: [u8; 12] = [0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60, 0x82];

/// The text under our keyword, of a file that was not cut short.
pub(super) fn keyword(path: &Path) -> Option<String> {
    let mut end = [0; END.len()];
    let mut file = open(path)?;
    file.seek(SeekFrom::End(-(END.len() as i64))).ok()?;
    file.read_exact(&mut end).ok()?;
    if end != END {
        return None;
    }
    let reader = Decoder::new(open(path)?).read_info().ok()?;
    let texts = &reader.info().uncompressed_latin1_text;
    texts.iter().find(|text| text.keyword == KEYWORD).map(|text| text.text.clone())
}
