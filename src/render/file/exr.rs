//! OpenEXR: one layer with named channels, 16 lines to a ZIP-compressed block.

use std::io::{self, Seek, Write};
use std::ops::Range;
use std::path::Path;

use exr::block::reader::ChunksReader;
use exr::block::writer::ChunksWriter;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::compression::Compression;
use exr::meta::BlockDescription;
use exr::meta::attribute::{AttributeValue, ChannelDescription, LineOrder, SampleType, Text};
use exr::meta::header::Header;
use exr::prelude::f16;
use rayon::prelude::*;

use super::{BLOCK_ROWS, Film, Fingerprint, KEYWORD, open};
use crate::render::{FilmPixel, NOBODY};

/// Bytes of a pixel: six channels of two, two of four.
pub(super) const BYTES: usize = 6 * 2 + 2 * 4;

/// Channels in the order of the file, which sorts them by name.
const CHANNELS: [(&str, SampleType); 8] = [
    ("B", SampleType::F16),
    ("G", SampleType::F16),
    ("N.X", SampleType::F16),
    ("N.Y", SampleType::F16),
    ("N.Z", SampleType::F16),
    ("R", SampleType::F16),
    ("Z", SampleType::F32),
    ("id", SampleType::U32),
];

/// The rows as a block has them: line by line, channel by channel, in the order of this machine's bytes.
pub(super) fn encode(film: &Film, object_of: &dyn Fn(u32) -> u32) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(film.pixels.len() * BYTES);
    // A lamp seen from next to it can be brighter than that, and infinity would spread over the picture when it is filtered.
    let most = f16::MAX.to_f32();
    let half = |value: f32| f16::from_f32(value.clamp(-most, most)).to_ne_bytes();
    for line in film.pixels.chunks(film.width.max(1) as usize) {
        let halves: [fn(&FilmPixel) -> f32; 6] = [
            |pixel| pixel.colour[2],
            |pixel| pixel.colour[1],
            |pixel| pixel.normal[0],
            |pixel| pixel.normal[1],
            |pixel| pixel.normal[2],
            |pixel| pixel.colour[0],
        ];
        for channel in halves {
            bytes.extend(line.iter().flat_map(|pixel| half(channel(pixel))));
        }
        bytes.extend(line.iter().flat_map(|pixel| pixel.depth.to_ne_bytes()));
        let id = |pixel: &FilmPixel| match pixel.drawable {
            NOBODY => NOBODY,
            drawable => object_of(drawable),
        };
        bytes.extend(line.iter().flat_map(|pixel| id(pixel).to_ne_bytes()));
    }
    bytes
}

/// Writes rows that [`encode`] made.
pub(super) fn write(
    file: &mut (impl Write + Seek),
    [width, height]: [u32; 2],
    fingerprint: Fingerprint,
    rows: &mut dyn FnMut(Range<u32>) -> io::Result<Vec<u8>>,
) -> io::Result<()> {
    let channels = CHANNELS.iter().map(|&(name, kind)| ChannelDescription::new(name, kind, false));
    let header = Header::new(Text::from("voxsight"), (width as usize, height as usize), channels.collect());
    let mut header =
        header.with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing);
    header
        .own_attributes
        .other
        .insert(Text::from(KEYWORD), AttributeValue::Text(Text::from(fingerprint.text().as_str())));
    let mut failed = None;
    let written = exr::block::write(file, [header].into_iter().collect(), true, |meta, chunks| {
        // A few blocks at a time are in memory, as many as there are threads to compress them.
        let blocks: Vec<_> = exr::block::enumerate_ordered_header_block_indices(&meta.headers).collect();
        for group in blocks.chunks(rayon::current_num_threads()) {
            let read = |&(layer, index): &(usize, BlockIndex)| {
                let first = index.pixel_position.y() as u32;
                debug_assert!(index.pixel_size.height() as u32 <= BLOCK_ROWS);
                let data = rows(first..first + index.pixel_size.height() as u32)?;
                Ok((layer, UncompressedBlock { index, data }))
            };
            let read: io::Result<Vec<(usize, UncompressedBlock)>> = group.iter().map(read).collect();
            let read = read.map_err(|error| {
                failed = Some(error);
                exr::error::Error::Aborted
            })?;
            let compress = |(layer, block): (usize, UncompressedBlock)| {
                Ok((layer, block.compress_to_chunk(&meta.headers)?))
            };
            let compressed: Result<Vec<_>, exr::error::Error> = read.into_par_iter().map(compress).collect();
            for (layer, chunk) in compressed? {
                chunks.write_chunk(layer, chunk)?;
            }
        }
        Ok(())
    });
    match (failed, written) {
        (Some(error), _) => Err(error),
        (None, Err(exr::error::Error::Io(error))) => Err(error),
        (None, Err(error)) => Err(io::Error::other(error)),
        (None, Ok(())) => Ok(()),
    }
}

/// The text under our keyword, of a file that was not cut short.
pub(super) fn keyword(path: &Path) -> Option<String> {
    let whole = exr::block::read(open(path)?, false).ok()?.all_chunks(false).ok()?;
    let header = whole.headers().first()?.clone();
    for chunk in whole {
        chunk.ok()?;
    }
    match header.own_attributes.other.get(&Text::from(KEYWORD))? {
        AttributeValue::Text(text) => Some(text.to_string()),
        _ => None,
    }
}
