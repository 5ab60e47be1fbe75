//! What can be wrong with a container: which file, where in it, what was expected, what was found, what to do.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::layout::{SectionKind, VERSION};
use super::page::PageError;

/// Advice at the end of every message about damaged bytes.
const REBUILD: &str = "it was cut short or damaged; build it again with `voxsight build`";

/// A container could not be read or written.
#[derive(Debug, Error)]
#[error("{}: {problem}", .path.display())]
pub struct ContainerError {
    /// The container's path as given.
    pub path: PathBuf,
    /// What is wrong. Boxed, so that a `Result` stays small.
    pub problem: Box<Problem>,
}

impl ContainerError {
    /// `problem` of the file at `path`.
    pub fn new(path: &Path, problem: impl Into<Problem>) -> Self {
        ContainerError { path: path.to_owned(), problem: Box::new(problem.into()) }
    }
}

/// What is wrong with a container.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Problem {
    /// The operating system refused.
    #[error("cannot {doing}: {source}")]
    Io {
        /// What was tried, as in "cannot ...".
        doing: &'static str,
        /// Its answer.
        source: io::Error,
    },
    /// The path names a folder, a device or the like.
    #[error("is not a regular file: give the path of a .vxs file")]
    NotAFile,
    /// The first bytes are not a container's.
    #[error("is not a Voxsight scene: {0}")]
    NotAContainer(&'static str),
    /// Made by an older or newer program.
    #[error(
        "is a container of version {found}, and this program reads version {VERSION}: {}",
        if *found > VERSION { "use a newer voxsight, or build it again with this one" }
        else { "build it again from its sources with `voxsight build`" }
    )]
    Version {
        /// The file's version.
        found: u32,
    },
    /// The file's length is not what its header says.
    #[error("the file should have {expected} bytes and has {found}: {REBUILD}")]
    Length {
        /// As the header says; the least possible when the header itself is incomplete.
        expected: u64,
        /// The file's.
        found: u64,
    },
    /// Bytes that mean something impossible.
    #[error("{0}: {REBUILD}")]
    Damaged(#[from] Damage),
    /// A geometry page that does not decode.
    #[error("geometry page of level {level} at byte {byte} of the file: {source}: {REBUILD}")]
    Page {
        /// Index of the level's record.
        level: u32,
        /// Start of the page in the file.
        byte: u64,
        /// Why.
        source: PageError,
    },
    /// The caller asked for a record that does not exist.
    #[error("there is no {what} {index}: the container has {count}")]
    NoSuch {
        /// Node, level and so on.
        what: &'static str,
        /// The index asked for.
        index: u64,
        /// How many there are.
        count: u64,
    },
    /// The scene has more drawables than this machine has memory for.
    #[error("no memory for the table of {count} drawables: close other programs or use a machine with more")]
    OutOfMemory {
        /// Drawables of the scene.
        count: u64,
    },
    /// What was given to the writer does not make a valid container.
    #[error("cannot be written, the scene is not valid: {0}")]
    Unwritable(Damage),
    /// Stopped by [`crate::progress::Progress::is_cancelled`].
    #[error("stopped before the end, as asked")]
    Cancelled,
}

/// A place in a container and what is wrong there.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub struct Damage {
    /// Name of the section, or of the header or table.
    pub section: &'static str,
    /// Index of the record, page or byte.
    pub record: Option<u64>,
    /// From the start of the file, where the record starts; unknown before the file is written.
    pub byte: Option<u64>,
    /// What must stand there.
    pub expected: String,
    /// What does.
    pub found: String,
}

impl Damage {
    /// Record `record` of a section.
    pub(super) fn record(
        kind: SectionKind,
        record: usize,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        Damage { record: Some(record as u64), ..Damage::section(kind.name(), expected, found) }
    }

    /// A whole section, the header or the table.
    pub(super) fn section(section: &'static str, expected: impl Into<String>, found: impl ToString) -> Self {
        Damage { section, record: None, byte: None, expected: expected.into(), found: found.to_string() }
    }
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "section \"{}\"", self.section)?;
        if let Some(record) = self.record {
            write!(f, ", record {record}")?;
        }
        if let Some(byte) = self.byte {
            write!(f, " (byte {byte} of the file)")?;
        }
        write!(f, ": expected {}, found {}", self.expected, self.found)
    }
}
