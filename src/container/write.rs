//! Writing a container: to a temporary file beside the target, which is renamed over it when complete.
//!
//! Whatever happens before [`ContainerWriter::finish`] has renamed the file (an error, a panic, a killed process, a
//! power cut), the target stays as it was. A dropped writer removes its temporary file. A killed one cannot: the next
//! writer of the same target does it.

use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use bytemuck::{Pod, Zeroable};
use serde::Serialize;
use xxhash_rust::xxh3::Xxh3;

use super::error::{ContainerError, Damage, Problem};
use super::layout::{Header, MAGIC, SECTION_ALIGNMENT, SectionEntry, SectionKind, TABLE_END, VERSION};
use crate::atomic_file::{self, AtomicFile, CommitError};

/// Writes a container section by section, in any order; every [`SectionKind`] exactly once.
///
/// ```no_run
/// use std::io::Write;
/// use voxsight::container::{ContainerWriter, layout::SectionKind};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let mut writer = ContainerWriter::create("plant.vxs")?;
/// let mut strings = writer.begin_section(SectionKind::Strings)?;
/// strings.write_all(b"pump")?;
/// strings.end()?;
/// // ... the other sections ...
/// writer.finish()?;
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct ContainerWriter {
    /// As given, for messages.
    path: PathBuf,
    file: BufWriter<AtomicFile>,
    /// Bytes written so far, the place of header and table included.
    position: u64,
    /// Ended sections, by [`SectionKind::index`].
    entries: [Option<SectionEntry>; SectionKind::ALL.len()],
    /// The section that was begun and not ended.
    open: Option<SectionKind>,
}

impl ContainerWriter {
    /// Starts a container that will stand at `path`; a file that is there stays until [`ContainerWriter::finish`].
    ///
    /// # Errors
    ///
    /// `path` is a folder or device, or its folder does not exist or cannot be written.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, ContainerError> {
        let path = path.as_ref().to_owned();
        Self::start(&path).map_err(|problem| ContainerError::new(&path, problem))
    }

    fn start(path: &Path) -> Result<Self, Problem> {
        if atomic_file::is_special(path) || path.file_name().is_none() {
            return Err(Problem::NotAFile);
        }
        let file = AtomicFile::create(path).map_err(|source| Problem::Io {
            doing: "create a temporary file in its folder (does the folder exist, may you write there?)",
            source,
        })?;
        let mut writer = ContainerWriter {
            path: path.to_owned(),
            file: BufWriter::with_capacity(1 << 20, file),
            position: 0,
            entries: [None; SectionKind::ALL.len()],
            open: None,
        };
        writer.write(&[0; TABLE_END as usize]).map_err(writing)?;
        Ok(writer)
    }

    /// Begins a section. Its bytes are written through the result, which must be ended by [`SectionWriter::end`].
    ///
    /// # Errors
    ///
    /// The section was begun before, another one was not ended, or the disk is full.
    pub fn begin_section(&mut self, kind: SectionKind) -> Result<SectionWriter<'_>, ContainerError> {
        if let Some(open) = self.open {
            return Err(self.unwritable(open, "its end before the next section", kind.name()));
        }
        if self.entries[kind.index()].is_some() {
            return Err(self.unwritable(kind, "it once", "it twice"));
        }
        self.open = Some(kind);
        let padding = self.position.next_multiple_of(SECTION_ALIGNMENT) - self.position;
        self.write(&[0; SECTION_ALIGNMENT as usize][..padding as usize])
            .map_err(|error| ContainerError::new(&self.path, writing(error)))?;
        let start = self.position;
        Ok(SectionWriter { writer: self, kind, start, hash: Box::new(Xxh3::new()) })
    }

    /// Writes a whole section.
    ///
    /// # Errors
    ///
    /// As [`ContainerWriter::begin_section`].
    pub fn write_section<T: Pod>(&mut self, kind: SectionKind, records: &[T]) -> Result<(), ContainerError> {
        let path = self.path.clone();
        let mut section = self.begin_section(kind)?;
        section
            .write_all(bytemuck::cast_slice(records))
            .map_err(|error| ContainerError::new(&path, writing(error)))?;
        section.end()
    }

    /// Writes a section of JSON ([`SectionKind::Meta`], [`SectionKind::Report`]).
    ///
    /// # Errors
    ///
    /// As [`ContainerWriter::begin_section`].
    pub fn write_json(&mut self, kind: SectionKind, value: &impl Serialize) -> Result<(), ContainerError> {
        let json = serde_json::to_vec_pretty(value)
            .map_err(|error| self.unwritable(kind, "a value that JSON can say", &error.to_string()))?;
        self.write_section(kind, &json)
    }

    /// Completes the file, makes sure that it is on the disk, and puts it in the target's place in one step.
    ///
    /// # Errors
    ///
    /// A section is missing, the disk is full, or the target cannot be replaced. The target is then as it was.
    pub fn finish(mut self) -> Result<(), ContainerError> {
        let (header, table) = self.header_and_table()?;
        let path = self.path;
        let fail = |doing: &'static str| {
            let path = path.clone();
            move |source| ContainerError::new(&path, Problem::Io { doing, source })
        };
        self.file.seek(SeekFrom::Start(0)).map_err(fail("write"))?;
        self.file.write_all(bytemuck::bytes_of(&header)).map_err(fail("write"))?;
        self.file.write_all(bytemuck::cast_slice(&table)).map_err(fail("write"))?;
        let file = self.file.into_inner().map_err(|error| fail("write")(error.into_error()))?;
        file.commit().map_err(|CommitError { doing, source }| fail(doing)(source))
    }

    fn header_and_table(&self) -> Result<(Header, Vec<SectionEntry>), ContainerError> {
        if let Some(open) = self.open {
            return Err(self.unwritable(open, "its end", "none"));
        }
        let mut table = Vec::with_capacity(SectionKind::ALL.len());
        for kind in SectionKind::ALL {
            table.push(self.entries[kind.index()].ok_or_else(|| self.unwritable(kind, "it", "nothing"))?);
        }
        let mut header = Header {
            magic: MAGIC,
            version: VERSION,
            section_count: table.len() as u32,
            file_length: self.position,
            ..Header::zeroed()
        };
        header.checksum = header_checksum(&header, bytemuck::cast_slice(&table));
        Ok((header, table))
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all(bytes)?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    fn unwritable(&self, kind: SectionKind, expected: &str, found: &str) -> ContainerError {
        ContainerError::new(&self.path, Problem::Unwritable(Damage::section(kind.name(), expected, found)))
    }
}

/// Writes one section, hashing as it goes. Dropped without [`SectionWriter::end`], the container cannot be finished.
#[must_use = "a section that is not ended makes the container unfinished"]
pub struct SectionWriter<'a> {
    writer: &'a mut ContainerWriter,
    kind: SectionKind,
    start: u64,
    hash: Box<Xxh3>,
}

impl SectionWriter<'_> {
    /// Bytes written to this section so far.
    pub fn length(&self) -> u64 {
        self.writer.position - self.start
    }

    /// Path of the container, for messages.
    pub(super) fn path(&self) -> &Path {
        &self.writer.path
    }

    /// Ends the section.
    ///
    /// # Errors
    ///
    /// Its length is not a whole number of records.
    pub fn end(self) -> Result<(), ContainerError> {
        let length = self.length();
        let size = self.kind.record_size();
        if !length.is_multiple_of(size as u64) {
            let expected = format!("records of {size} bytes each");
            return Err(self.writer.unwritable(self.kind, &expected, &format!("{length} bytes")));
        }
        self.writer.entries[self.kind.index()] = Some(SectionEntry {
            kind: self.kind as u32,
            reserved: 0,
            offset: self.start,
            length,
            checksum: self.hash.digest(),
        });
        self.writer.open = None;
        Ok(())
    }
}

impl Write for SectionWriter<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writer.write(bytes)?;
        self.hash.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.file.flush()
    }
}

/// XXH3-64 of the header with its checksum field 0, followed by the table.
pub(super) fn header_checksum(header: &Header, table: &[u8]) -> u64 {
    let mut hash = Xxh3::new();
    hash.update(bytemuck::bytes_of(&Header { checksum: 0, ..*header }));
    hash.update(table);
    hash.digest()
}

fn writing(source: io::Error) -> Problem {
    Problem::Io { doing: "write (is the disk full?)", source }
}
