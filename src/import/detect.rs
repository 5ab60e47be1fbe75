//! Which format a file has. A clear signature at its beginning decides, whatever its extension says; OBJ has
//! none and binary STL a poor one, so there the extension decides.

use std::fmt;
use std::path::Path;

use super::error::{ImportError, excerpt};
use super::stl;

/// A format that can be imported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Format {
    /// glTF 2.0 as JSON, with buffers inside or beside it.
    Gltf,
    /// glTF 2.0 in one binary file.
    Glb,
    /// Wavefront OBJ, with or without material library.
    Obj,
    /// Stanford polygon file, ascii or binary.
    Ply,
    /// Stereolithography, ascii or binary.
    Stl,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Format::Gltf => "glTF",
            Format::Glb => "GLB",
            Format::Obj => "OBJ",
            Format::Ply => "PLY",
            Format::Stl => "STL",
        })
    }
}

impl Format {
    /// By extension, upper or lower case.
    pub fn from_extension(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Some(match extension.as_str() {
            "gltf" => Format::Gltf,
            "glb" => Format::Glb,
            "obj" => Format::Obj,
            "ply" => Format::Ply,
            "stl" => Format::Stl,
            _ => return None,
        })
    }
}

/// The format of `bytes`, called `file`, which lies at `path`.
pub(super) fn detect(file: &str, path: &Path, bytes: &[u8]) -> Result<Format, ImportError> {
    if let Some(format) = signature(bytes) {
        return Ok(format);
    }
    let wrong = |expected| {
        Err(ImportError::WrongContent { file: file.to_owned(), expected, found: beginning(bytes) })
    };
    match Format::from_extension(path) {
        Some(Format::Gltf) if first_visible(bytes) == Some(b'{') => Ok(Format::Gltf),
        Some(Format::Gltf) => wrong("glTF, a JSON text that begins with {"),
        Some(Format::Glb) => wrong("GLB, which begins with glTF"),
        Some(Format::Ply) => wrong("PLY, which begins with ply"),
        Some(Format::Obj) if bytes.is_empty() || looks_binary(bytes) => wrong("OBJ, a text"),
        Some(Format::Obj) => Ok(Format::Obj),
        Some(Format::Stl) if bytes.is_empty() => wrong("STL, ascii or binary"),
        Some(Format::Stl) => Ok(Format::Stl),
        None if stl::is_binary_of_exact_size(bytes) => Ok(Format::Stl),
        None => Err(ImportError::UnknownFormat { file: file.to_owned(), found: beginning(bytes) }),
    }
}

fn signature(bytes: &[u8]) -> Option<Format> {
    if bytes.starts_with(b"glTF") {
        return Some(Format::Glb);
    }
    if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
        return Some(Format::Ply);
    }
    let head = head(bytes);
    if first_visible(bytes) == Some(b'{') && contains(head, b"\"asset\"") {
        return Some(Format::Gltf);
    }
    stl::is_ascii(bytes).then_some(Format::Stl)
}

fn first_visible(bytes: &[u8]) -> Option<u8> {
    without_byte_order_mark(bytes).trim_ascii_start().first().copied()
}

/// UTF-8 text without the mark that some editors put in front.
pub(super) fn without_byte_order_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes)
}

/// As much as is looked at to guess.
pub(super) fn head(bytes: &[u8]) -> &[u8] {
    &bytes[..bytes.len().min(4096)]
}

pub(super) fn contains(text: &[u8], word: &[u8]) -> bool {
    text.windows(word.len()).any(|window| window == word)
}

pub(super) fn looks_binary(bytes: &[u8]) -> bool {
    head(bytes).contains(&0)
}

fn beginning(bytes: &[u8]) -> String {
    if bytes.is_empty() { "is empty".to_owned() } else { format!("begins with {}", excerpt(head(bytes))) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str, bytes: &[u8]) -> Result<Format, String> {
        detect(name, Path::new(name), bytes).map_err(|e| e.to_string())
    }

    #[test]
    fn content_decides_and_the_extension_helps_where_there_is_no_signature() {
        assert_eq!(of("a.obj", b"glTF\x02\0\0\0"), Ok(Format::Glb));
        assert_eq!(of("a.stl", b"ply\r\nformat ascii 1.0"), Ok(Format::Ply));
        assert_eq!(of("a.dat", b"\xEF\xBB\xBF {\"asset\":{}}"), Ok(Format::Gltf));
        assert_eq!(of("a", b"solid x\n facet normal 0 0 0"), Ok(Format::Stl));
        assert_eq!(of("A.OBJ", b"# hello"), Ok(Format::Obj));
        let mut binary = vec![0; 134];
        binary[80] = 1;
        assert_eq!(of("nameless", &binary), Ok(Format::Stl));
    }

    #[test]
    fn a_file_that_is_not_what_its_name_says_is_refused_with_its_beginning() {
        for name in ["a.glb", "a.gltf", "a.ply", "a.txt"] {
            let error = of(name, b"%PDF-1.4").unwrap_err();
            assert!(error.contains("%PDF-1.4"), "{error}");
        }
        assert!(of("a.obj", b"\x7fELF\0\0").is_err());
        for name in ["a.glb", "a.gltf", "a.ply", "a.txt", "a.stl", "a.obj"] {
            assert!(of(name, b"").unwrap_err().contains("is empty"));
        }
    }
}
