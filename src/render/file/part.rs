//! The part file: bands of a picture that is not finished.
//!
//! A header of 64 bytes (magic, fingerprint, width, height, rows of a band, bytes of a row), then band after band, each
//! followed by a checksum of 8 bytes. What a killed job left of its last band is cut off when another goes on.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::xxh3_64;

use super::{Fingerprint, PictureError};

const MAGIC: [u8; 8] = *b"VXSPART1";
const HEADER_BYTES: u64 = 64;
const CHECKSUM_BYTES: u64 = 8;

/// An opened part file. Its lock tells other processes that somebody is at work.
pub(super) struct PartFile {
    path: PathBuf,
    file: File,
    /// Nobody else can be at work.
    is_locked: bool,
    height: u32,
    band_rows: u32,
    row_bytes: usize,
    /// Whole rows that are there.
    rows: u32,
}

impl PartFile {
    /// Opens the part file of a picture, or begins one. `size` is width, height, and rows of a band.
    pub fn open(
        picture: &Path,
        fingerprint: Fingerprint,
        size: [u32; 3],
        row_bytes: usize,
    ) -> Result<Self, PictureError> {
        let path = part_path(picture, fingerprint);
        let (file, is_locked) = loop {
            let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
            let file = file.map_err(PictureError::io(&path, "open"))?;
            let is_locked = match file.try_lock() {
                Ok(()) => true,
                // Some network drives have no locks.
                Err(TryLockError::Error(_)) => false,
                Err(TryLockError::WouldBlock) => return Err(PictureError::Busy(picture.to_owned())),
            };
            // Whoever had the lock may have removed the file before it was ours.
            if is_at(&file, &path) {
                break (file, is_locked);
            }
        };
        let [_, height, band_rows] = size;
        let mut part = PartFile { path, file, is_locked, height, band_rows, row_bytes, rows: 0 };
        let header = header(fingerprint, size, row_bytes);
        let begun = part.resume(&header);
        match begun.map_err(PictureError::io(&part.path, "read"))? {
            true => Ok(part),
            false => Err(PictureError::Foreign(part.path)),
        }
    }

    /// Is there a part file of this picture?
    pub fn is_there(picture: &Path, fingerprint: Fingerprint) -> bool {
        part_path(picture, fingerprint).exists()
    }

    /// Whole rows that are there.
    pub fn rows(&self) -> u32 {
        self.rows
    }

    /// Takes over what is there, if it is of this picture, up to the last whole band. Returns false, and leaves everything as
    /// it is, when it is no part file.
    fn resume(&mut self, header: &[u8]) -> io::Result<bool> {
        let mut found = Vec::new();
        (&self.file).take(HEADER_BYTES).read_to_end(&mut found)?;
        if found != header {
            // Begun by a job that was killed at once, or by a version of the program with other bands.
            if !found.is_empty() && !found.starts_with(&MAGIC) {
                return Ok(false);
            }
            self.file.set_len(0)?;
            self.file.seek(SeekFrom::Start(0))?;
            self.file.write_all(header)?;
            return Ok(true);
        }
        self.rows = self.sound_rows()?;
        self.file.set_len(self.offset(self.rows))?;
        Ok(true)
    }

    /// Rows of whole bands with the right checksums, from the first on.
    fn sound_rows(&mut self) -> io::Result<u32> {
        self.file.seek(SeekFrom::Start(HEADER_BYTES))?;
        let mut sound = 0;
        while sound < self.height {
            let rows = self.band_rows.min(self.height - sound) as usize;
            let mut band = vec![0; rows * self.row_bytes + CHECKSUM_BYTES as usize];
            match self.file.read_exact(&mut band) {
                Ok(()) => {}
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => break,
                Err(error) => return Err(error),
            }
            let (bytes, checksum) = band.split_at(rows * self.row_bytes);
            if xxh3_64(bytes).to_le_bytes() != checksum {
                break;
            }
            sound += rows as u32;
        }
        Ok(sound)
    }

    /// Before the rows are used: where files cannot be locked, another process may have written between ours.
    pub fn check(&mut self) -> Result<(), PictureError> {
        if self.is_locked {
            return Ok(());
        }
        match self.sound_rows().map_err(PictureError::io(&self.path, "read"))? {
            rows if rows == self.height => Ok(()),
            _ => Err(PictureError::Mixed(self.path.clone())),
        }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where a band that begins with this row lies.
    fn offset(&self, row: u32) -> u64 {
        let bands = u64::from(row.div_ceil(self.band_rows));
        HEADER_BYTES + u64::from(row) * self.row_bytes as u64 + bands * CHECKSUM_BYTES
    }

    /// Adds the next band.
    pub fn append(&mut self, bytes: &[u8]) -> Result<(), PictureError> {
        let rows = self.band_rows.min(self.height - self.rows);
        debug_assert_eq!(bytes.len(), rows as usize * self.row_bytes);
        let mut write = || {
            self.file.seek(SeekFrom::Start(self.offset(self.rows)))?;
            self.file.write_all(bytes)?;
            self.file.write_all(&xxh3_64(bytes).to_le_bytes())
        };
        write().map_err(PictureError::io(&self.path, "write"))?;
        self.rows += rows;
        Ok(())
    }

    /// Some rows that are there.
    pub fn read(&mut self, rows: Range<u32>) -> io::Result<Vec<u8>> {
        let mut bytes = vec![0; rows.len() * self.row_bytes];
        for (row, line) in rows.zip(bytes.chunks_mut(self.row_bytes.max(1))) {
            let band = row / self.band_rows * self.band_rows;
            let within = u64::from(row - band) * self.row_bytes as u64;
            self.file.seek(SeekFrom::Start(self.offset(band) + within))?;
            self.file.read_exact(line)?;
        }
        Ok(bytes)
    }

    /// Removes it: the picture is finished.
    pub fn remove(self) -> Result<(), PictureError> {
        match std::fs::remove_file(&self.path) {
            // Where files cannot be locked, another process may have finished the same picture.
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            removed => removed.map_err(PictureError::io(&self.path, "remove")),
        }
    }
}

/// Part files of pictures of this name: with the settings that each was begun with, they would go on.
pub(super) fn part_files(picture: &Path) -> Vec<PathBuf> {
    let folder = match picture.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let name = picture.file_name().unwrap_or_default().to_string_lossy();
    let is_part = |path: &PathBuf| {
        let found = path.file_name().unwrap_or_default().to_string_lossy();
        let rest = found.strip_prefix('.').and_then(|rest| rest.strip_prefix(&*name));
        rest.is_some_and(|rest| rest.len() == ".00000000.part".len() && rest.ends_with(".part"))
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut parts: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(is_part).collect();
    parts.sort();
    parts
}

/// `.NAME.FINGERPRINT.part`, beside the picture: with other settings it is another file, and nothing is lost.
fn part_path(picture: &Path, fingerprint: Fingerprint) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(picture.file_name().unwrap_or_default());
    name.push(format!(".{}.part", &fingerprint.text()[..8]));
    picture.with_file_name(name)
}

/// Is the opened file the one that is at the path?
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |metadata: std::fs::Metadata| (metadata.dev(), metadata.ino());
    match (file.metadata(), std::fs::metadata(path)) {
        (Ok(opened), Ok(there)) => identity(opened) == identity(there),
        _ => false,
    }
}

/// Is the opened file the one that is at the path? An opened file cannot be removed here.
#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true
}

fn header(fingerprint: Fingerprint, size: [u32; 3], row_bytes: usize) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend(fingerprint.0.to_le_bytes());
    size.iter().for_each(|number| bytes.extend(number.to_le_bytes()));
    bytes.extend((row_bytes as u64).to_le_bytes());
    bytes.resize(HEADER_BYTES as usize, 0);
    bytes
}
