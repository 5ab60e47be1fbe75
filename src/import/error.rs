//! Why an import failed: which file, where in it, what was expected, what was found, what to do.

use std::io;

use thiserror::Error;

use crate::report::Findings;

/// Why nothing was imported. `file` is the input as it was given, or relative to it.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ImportError {
    /// No input was given.
    #[error("no input: give a model file or a folder of model files")]
    NoInput,
    /// The operating system refused.
    #[error("{file}: cannot be read: {source}")]
    Io {
        /// The file or folder.
        file: String,
        /// What the operating system said.
        source: io::Error,
    },
    /// A device, a pipe, a socket.
    #[error("{file}: neither a file nor a folder")]
    NotAFile {
        /// The input.
        file: String,
    },
    /// A folder tree in which no file has the extension of a model.
    #[error(
        "{folder}: no model among its {skipped} files: expected .glb, .gltf, .obj, .ply or .stl somewhere below"
    )]
    NoModelInFolder {
        /// The folder.
        folder: String,
        /// How many other files are in it.
        skipped: u64,
    },
    /// Neither the content nor the extension says a format that is known here.
    #[error("{file}: unknown format: expected glTF, GLB, OBJ, PLY or STL, found a file that {found}")]
    UnknownFormat {
        /// The file.
        file: String,
        /// What its beginning looks like.
        found: String,
    },
    /// The extension says one format, the content is not of it.
    #[error("{file}: expected {expected}, found a file that {found}; is its extension right?")]
    WrongContent {
        /// The file.
        file: String,
        /// Format that the extension says, and how it begins.
        expected: &'static str,
        /// What its beginning looks like.
        found: String,
    },
    /// The file ends before what it announces.
    #[error("{file}: {what} needs {expected} bytes, found {found}: the file was cut short, copy it again")]
    Truncated {
        /// The file.
        file: String,
        /// Which piece of it.
        what: String,
        /// Bytes that should be there.
        expected: u64,
        /// Bytes that are there.
        found: u64,
    },
    /// A line of a text file (or of a text header) cannot be understood.
    #[error("{file}, line {line}: expected {expected}, found {found}")]
    Syntax {
        /// The file.
        file: String,
        /// Counted from 1.
        line: u64,
        /// What should stand there.
        expected: &'static str,
        /// What stands there, shortened.
        found: String,
    },
    /// The JSON of a glTF file is broken or has a value of the wrong type.
    #[error("{file}: its JSON cannot be read as glTF 2.0: {source}; export it again")]
    Json {
        /// The file.
        file: String,
        /// What is wrong, with line and column.
        source: serde_json::Error,
    },
    /// The file can be read, but contradicts its format.
    #[error("{file}: {place}: expected {expected}, found {found}")]
    Invalid {
        /// The file.
        file: String,
        /// Which thing in it: `accessor 12`.
        place: String,
        /// What the format wants.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The file says that it cannot be shown without an extension that is not supported here.
    #[error("{file}: needs the glTF extension {extension}, which is not supported: {advice}")]
    UnsupportedExtension {
        /// The file.
        file: String,
        /// Name of the extension.
        extension: String,
        /// What to do.
        advice: &'static str,
    },
    /// A file refers to another one outside its own folder.
    #[error(
        "{file}: refers to \"{uri}\", {reason}; put the file beside the model and refer to it by its name"
    )]
    UnsafePath {
        /// The file.
        file: String,
        /// The reference as it stands there, shortened.
        uri: String,
        /// Why it is refused.
        reason: &'static str,
    },
    /// More than [`super::ImportOptions`] or the data structures allow.
    #[error("{file}: more than {limit} {what}; {advice}")]
    TooMany {
        /// The file.
        file: String,
        /// What there is too much of.
        what: &'static str,
        /// How much is allowed.
        limit: u64,
        /// What to do.
        advice: &'static str,
    },
    /// Everything was read, and not one triangle is left.
    #[error("{file}: no triangles{}", because(.findings))]
    NoTriangles {
        /// The input.
        file: String,
        /// What was skipped and dropped on the way.
        findings: Findings,
    },
    /// The caller asked to stop.
    #[error("import cancelled")]
    Cancelled,
}

fn because(findings: &Findings) -> String {
    let said: Vec<_> =
        findings.0.iter().map(|(what, f)| format!("{what} ({}, first: {})", f.count, f.first)).collect();
    if said.is_empty() { String::new() } else { format!(": {}", said.join("; ")) }
}

/// Text from a file as it may stand in a message: at most 40 characters, nothing unprintable.
pub(super) fn excerpt(text: &[u8]) -> String {
    const MAX_CHARS: usize = 40;
    let head = &text[..text.len().min(4 * MAX_CHARS)];
    let mut shown: String = String::from_utf8_lossy(head)
        .chars()
        .take(MAX_CHARS)
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect();
    if text.len() > shown.len() {
        shown.push('…');
    }
    format!("\"{}\"", shown.trim())
}
