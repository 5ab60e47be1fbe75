//! Pictures into files, rows at a time: a picture may be larger than memory.
//!
//! Rows are rendered in bands and kept, as they will stand in the file, in a *part file* beside it
//! (`.NAME.FINGERPRINT.part`). When all are there they are encoded, and the picture appears under its name at once. A job that
//! was stopped or killed goes on after its last whole band when the same picture is asked for again; a finished picture of the
//! same scene and settings is left as it is. Both are known by a fingerprint, which the picture carries.

mod depth;
mod exr;
mod part;
mod png;

use std::fs::File;
use std::io::{self, BufWriter};
use std::ops::Range;
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::xxh3_128;

use super::shade::TILE;
use super::{Film, Renderer, ShadowCost};
use crate::atomic_file::AtomicFile;
use crate::progress::Progress;
pub use depth::DepthRange;
use part::PartFile;

/// Samples of a band, at most, but for one row of tiles: what an interrupted job loses, some seconds of work; and as many pixels
/// at most are in memory.
const BAND_SAMPLES: u64 = 1 << 20;

/// Rows that are encoded together: OpenEXR compresses 16 at a time.
const BLOCK_ROWS: u32 = 16;

/// How a picture is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// sRGB for screens, 8 bits.
    Png8,
    /// sRGB, 16 bits.
    Png16,
    /// Linear, brighter than white up to 65,504: R, G, B and the normal N.X, N.Y, N.Z in 16-bit floats; Z, the depth along the
    /// view, in 32 (infinite where there is nothing); id, the object, in 32-bit integers (4294967295 where there is nothing).
    Exr,
    /// PNG of objects as colours ([`crate::render::id_colour`]), of pixels' middles.
    Ids,
    /// PNG of depths, 16 bits grey: 0 where there is nothing, 1 to 65,535 from near to far, linear; of pixels' middles. The
    /// range is in it as text under "voxsight-depth": near and far, model units.
    Depth,
}

/// What tells one picture from every other: scene, camera, settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fingerprint(pub u128);

impl Fingerprint {
    /// The format is part of what tells pictures apart.
    fn of_format(self, format: Format) -> Self {
        let mut bytes = self.0.to_le_bytes().to_vec();
        bytes.push(format as u8);
        Fingerprint(xxh3_128(&bytes))
    }

    /// As it stands in files.
    fn text(self) -> String {
        format!("{:032x}", self.0)
    }
}

/// The keyword of the fingerprint in pictures.
const KEYWORD: &str = "voxsight";

/// The keyword of the range of depths.
const DEPTH_KEYWORD: &str = "voxsight-depth";

/// What came of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Written {
    /// It is there now.
    New {
        /// Rows that an earlier, interrupted job had rendered.
        resumed_rows: u32,
        /// What shadow rays took, of the other rows.
        cost: ShadowCost,
    },
    /// It was there already.
    Before,
}

/// Why a picture could not be made.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// Stopped on request. Whole bands are kept.
    #[error("{}", stopped(.path, .part, *.done, *.rows))]
    Stopped {
        /// The picture.
        path: PathBuf,
        /// What keeps the rows.
        part: PathBuf,
        /// Rows rendered.
        done: u32,
        /// Rows in all.
        rows: u32,
    },
    /// Another process makes the same picture.
    #[error("{0}: another process is rendering it")]
    Busy(PathBuf),
    /// Where the part file should be is a file of somebody else.
    #[error("{0}: expected a part file of an unfinished picture, found something else: move it away")]
    Foreign(PathBuf),
    /// Another process has written into the part file, on a drive that cannot lock files.
    #[error("{0}: two processes have written into it; run one of them again, alone")]
    Mixed(PathBuf),
    /// A file.
    #[error("{path}: cannot {doing}: {source}")]
    Io {
        /// The picture, or its part file.
        path: PathBuf,
        /// What could not be done.
        doing: &'static str,
        /// Why.
        source: io::Error,
    },
}

fn stopped(path: &Path, part: &Path, done: u32, rows: u32) -> String {
    let path = path.display();
    match done {
        0 => format!("{path}: stopped before the first of {rows} rows were done"),
        _ => format!(
            "{path}: stopped after {done} of {rows} rows; the same command goes on from there (they are in {})",
            part.display()
        ),
    }
}

impl PictureError {
    fn io<'p>(path: &'p Path, doing: &'static str) -> impl FnOnce(io::Error) -> Self + use<'p> {
        move |source| PictureError::Io { path: path.to_owned(), doing, source }
    }
}

impl Format {
    /// Bytes of a row of so many pixels.
    fn row_bytes(self, width: u32) -> usize {
        let pixel = match self {
            Format::Png8 => png::Layout::COLOURS_8.bytes(),
            Format::Png16 => png::Layout::COLOURS_16.bytes(),
            Format::Ids => png::Layout::IDS.bytes(),
            Format::Depth => depth::BYTES,
            Format::Exr => exr::BYTES,
        };
        pixel * width as usize
    }

    /// How PNG has it; `None` for OpenEXR.
    fn layout(self) -> Option<png::Layout> {
        match self {
            Format::Png8 => Some(png::Layout::COLOURS_8),
            Format::Png16 => Some(png::Layout::COLOURS_16),
            Format::Ids => Some(png::Layout::IDS),
            Format::Depth => Some(png::Layout::DEPTHS),
            Format::Exr => None,
        }
    }

    /// The rows as the encoder takes them; depths raw.
    fn encode(self, film: &Film, object_of: &dyn Fn(u32) -> u32) -> Vec<u8> {
        match self {
            Format::Png8 => png::encode_8(film),
            Format::Png16 => png::encode_16(film),
            Format::Ids => film.to_ids(object_of).into_raw(),
            Format::Depth => film.pixels.iter().flat_map(|pixel| pixel.depth.to_le_bytes()).collect(),
            Format::Exr => exr::encode(film, object_of),
        }
    }

    /// The fingerprint of a picture that is there, whole; `None` when there is none, or one of other make.
    fn fingerprint_of(self, path: &Path) -> Option<Fingerprint> {
        // Whatever cannot be read is not the picture, and is replaced like any other file.
        let text = match self {
            Format::Exr => exr::keyword(path),
            _ => png::text(path, KEYWORD),
        }?;
        u128::from_str_radix(&text, 16).ok().map(Fingerprint)
    }
}

/// Renders a picture into a file. `object_of` maps drawables to the objects that [`Format::Exr`] stores. Tells `progress`
/// of pixels; of all of a picture that is there.
///
/// # Errors
///
/// Stopped; the file or its part file cannot be written; another process makes it.
pub fn render_to_file(
    renderer: &Renderer,
    path: &Path,
    format: Format,
    fingerprint: Fingerprint,
    object_of: &dyn Fn(u32) -> u32,
    progress: &dyn Progress,
) -> Result<Written, PictureError> {
    let (width, height) = renderer.camera.size();
    let fingerprint = fingerprint.of_format(format);
    let is_finished = || format.fingerprint_of(path) == Some(fingerprint);
    let before = || {
        progress.advance(u64::from(width) * u64::from(height));
        Ok(Written::Before)
    };
    if is_finished() && !PartFile::is_there(path, fingerprint) {
        return before();
    }
    let band_rows = band_rows(width, renderer.samples_per_pixel());
    let mut part = PartFile::open(path, fingerprint, [width, height, band_rows], format.row_bytes(width))?;
    // Another process may have finished it meanwhile, or an earlier one was killed just before it cleaned up.
    if is_finished() {
        part.remove()?;
        return before();
    }
    let stopped = |part: &PartFile| PictureError::Stopped {
        path: path.to_owned(),
        part: part.path().to_owned(),
        done: part.rows(),
        rows: height,
    };
    let resumed_rows = part.rows();
    progress.advance(u64::from(width) * u64::from(resumed_rows));
    let mut cost = ShadowCost::default();
    while part.rows() < height {
        let rows = part.rows()..(part.rows() + band_rows).min(height);
        let Some((film, band_cost)) = renderer.rows(rows, progress) else {
            return Err(stopped(&part));
        };
        cost.merge(&band_cost);
        part.append(&format.encode(&film, object_of))?;
    }
    part.check()?;
    let file = AtomicFile::create(path).map_err(PictureError::io(path, "write"))?;
    let file = match encode(file, format, [width, height], fingerprint, &mut part, progress) {
        Err(_) if progress.is_cancelled() => return Err(stopped(&part)),
        file => file.map_err(PictureError::io(path, "write"))?,
    };
    file.commit().map_err(|error| PictureError::io(path, "write")(error.into()))?;
    part.remove()?;
    Ok(Written::New { resumed_rows, cost })
}

/// Encodes a part file that is whole.
fn encode(
    file: AtomicFile,
    format: Format,
    size: [u32; 2],
    fingerprint: Fingerprint,
    part: &mut PartFile,
    progress: &dyn Progress,
) -> io::Result<AtomicFile> {
    let mut file = BufWriter::new(file);
    let mut read = |range: Range<u32>| match progress.is_cancelled() {
        true => Err(io::ErrorKind::Interrupted.into()),
        false => part.read(range),
    };
    let mut texts = vec![(KEYWORD, fingerprint.text())];
    match format.layout() {
        None => exr::write(&mut file, size, fingerprint, &mut read)?,
        Some(layout) if format == Format::Depth => {
            let mut range = DepthRange::EMPTY;
            for rows in blocks(size[1]) {
                range = range.with(&read(rows)?);
            }
            texts.push((DEPTH_KEYWORD, range.text()));
            png::write(&mut file, size, layout, &texts, &mut |rows| Ok(range.grey(&read(rows)?)))?;
        }
        Some(layout) => png::write(&mut file, size, layout, &texts, &mut read)?,
    }
    file.into_inner().map_err(io::IntoInnerError::into_error)
}

/// Can this format be written by [`render_to_stream`]?
pub fn is_for_streams(format: Format) -> bool {
    matches!(format, Format::Png8 | Format::Png16 | Format::Ids)
}

/// Renders a picture into a pipe or the like, rows at a time: nothing is kept that another job could go on from.
///
/// # Errors
///
/// Stopped ([`io::ErrorKind::Interrupted`]); writing failed; the format is not [`is_for_streams`].
pub fn render_to_stream(
    renderer: &Renderer,
    format: Format,
    object_of: &dyn Fn(u32) -> u32,
    stream: &mut impl io::Write,
    progress: &dyn Progress,
) -> io::Result<()> {
    let (width, height) = renderer.camera.size();
    let Some(layout) = format.layout().filter(|_| is_for_streams(format)) else {
        return Err(io::Error::new(io::ErrorKind::Unsupported, "this format needs a file"));
    };
    let mut rows = |range: Range<u32>| match renderer.rows(range, progress) {
        Some((film, _)) => Ok(format.encode(&film, object_of)),
        None => Err(io::ErrorKind::Interrupted.into()),
    };
    png::write(stream, [width, height], layout, &[], &mut rows)
}

/// The range of depths that a finished [`Format::Depth`] tells.
pub fn depth_range_of(path: &Path) -> Option<DepthRange> {
    DepthRange::from_text(&png::text(path, DEPTH_KEYWORD)?)
}

/// Part files of unfinished pictures of this name, whatever their settings.
pub fn unfinished(path: &Path) -> Vec<PathBuf> {
    part::part_files(path)
}

/// Rows of a band: whole tiles.
fn band_rows(width: u32, samples_per_pixel: u32) -> u32 {
    let pixels = BAND_SAMPLES / u64::from(samples_per_pixel);
    // At most 2^20, and one tile's at least.
    let rows = (pixels / u64::from(width)) as u32;
    (rows / TILE * TILE).max(TILE)
}

/// Opens a file for reading, if it is there.
fn open(path: &Path) -> Option<io::BufReader<File>> {
    File::open(path).ok().map(io::BufReader::new)
}

/// Rows in blocks of [`BLOCK_ROWS`].
fn blocks(height: u32) -> impl Iterator<Item = Range<u32>> {
    (0..height).step_by(BLOCK_ROWS as usize).map(move |row| row..(row + BLOCK_ROWS).min(height))
}
