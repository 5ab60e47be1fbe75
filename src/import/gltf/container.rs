//! Where the bytes of a glTF model are: the chunks of a GLB, data URIs, files beside it.

use std::collections::HashMap;
use std::path::PathBuf;

use super::json::Document;
use crate::import::detect::without_byte_order_mark;
use crate::import::draft::{Referred, Source};
use crate::import::error::{ImportError, excerpt};
use crate::import::files;

const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;
const JSON_CHUNK: &[u8; 4] = b"JSON";
const BIN_CHUNK: &[u8; 4] = b"BIN\0";

/// JSON text and binary chunk of a file, GLB or plain.
pub(super) fn split<'a>(source: &Source<'a>) -> Result<(&'a [u8], Option<&'a [u8]>), ImportError> {
    let bytes = source.bytes;
    if !bytes.starts_with(b"glTF") {
        return Ok((without_byte_order_mark(bytes), None));
    }
    let found = bytes.len() as u64;
    let u32_at = |at: usize| bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let (Some(version), Some(length)) = (u32_at(4), u32_at(8)) else {
        return Err(source.truncated("the header of a GLB", HEADER_BYTES as u64, found));
    };
    if version != 2 {
        return Err(source.invalid("GLB header", "version 2", format!("{version}: convert it to glTF 2.0")));
    }
    if u64::from(length) > found {
        return Err(source.truncated("the GLB", u64::from(length), found));
    }
    let file = bytes.get(..length as usize).unwrap_or_default();
    let Chunk { kind, content: json, rest } = chunk(source, file.get(HEADER_BYTES..).unwrap_or_default())?;
    if kind != JSON_CHUNK {
        return Err(source.invalid("GLB, first chunk", "type JSON", excerpt(kind)));
    }
    if rest.is_empty() {
        return Ok((json, None));
    }
    // Chunks of other kinds are to be ignored, says the specification.
    let Chunk { kind, content: bin, .. } = chunk(source, rest)?;
    Ok((json, (kind == BIN_CHUNK).then_some(bin)))
}

/// One chunk, and what follows it.
struct Chunk<'a> {
    kind: &'a [u8],
    content: &'a [u8],
    rest: &'a [u8],
}

fn chunk<'a>(source: &Source, bytes: &'a [u8]) -> Result<Chunk<'a>, ImportError> {
    let found = bytes.len() as u64;
    let header = bytes.split_first_chunk::<4>().and_then(|(length, rest)| {
        rest.split_at_checked(4).map(|(kind, rest)| (u32::from_le_bytes(*length), kind, rest))
    });
    let Some((length, kind, rest)) = header else {
        return Err(source.truncated("the header of a GLB chunk", CHUNK_HEADER_BYTES as u64, found));
    };
    match rest.split_at_checked(length as usize) {
        Some((content, rest)) => Ok(Chunk { kind, content, rest }),
        None => Err(source.truncated(
            format!("GLB chunk {}", excerpt(kind)),
            u64::from(length),
            rest.len() as u64,
        )),
    }
}

/// The content of all buffers.
pub(super) struct Buffers<'a> {
    bin: Option<&'a [u8]>,
    loaded: Vec<Vec<u8>>,
    places: Vec<Place>,
    referred: Referred,
}

/// Where the content of a buffer is.
struct Place {
    content: Content,
    length: usize,
}

enum Content {
    /// Nowhere: the stand-in of an extension.
    Nowhere,
    /// The binary chunk.
    Bin,
    /// Index in [`Buffers::loaded`].
    Loaded(usize),
}

impl<'a> Buffers<'a> {
    /// Loads what is outside the binary chunk. The length of each buffer is checked.
    pub fn load(source: &Source, document: &Document, bin: Option<&'a [u8]>) -> Result<Self, ImportError> {
        let mut buffers =
            Buffers { bin, loaded: Vec::new(), places: Vec::new(), referred: Referred::default() };
        // A file that a thousand buffers name is loaded once.
        let mut files: HashMap<PathBuf, usize> = HashMap::new();
        for (i, buffer) in document.buffers.iter().enumerate() {
            let content = match buffer.uri.as_deref() {
                None if i == 0 && bin.is_some() => Content::Bin,
                None => Content::Nowhere,
                Some(uri) if uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:")) => {
                    buffers.loaded.push(data_uri(source, i, uri)?);
                    Content::Loaded(buffers.loaded.len() - 1)
                }
                Some(uri) => {
                    let name = percent_decoded(uri).ok_or_else(|| {
                        source.invalid(format!("buffer {i}, uri"), "%XX as in URIs", excerpt(uri.as_bytes()))
                    })?;
                    let path = files::resolve(source, &name)?;
                    let known = files.get(&path).copied();
                    let index = known.map_or_else(
                        || {
                            let content = files::read_beside(source, &name)?;
                            buffers.referred.add(&path, &content);
                            buffers.loaded.push(content);
                            Ok(buffers.loaded.len() - 1)
                        },
                        Ok,
                    )?;
                    files.insert(path, index);
                    Content::Loaded(index)
                }
            };
            let place = Place { content, length: buffer.byte_length };
            let expected = buffer.byte_length as u64;
            if let Some(content) = buffers.all_of(&place)
                && expected > content.len() as u64
            {
                return Err(source.truncated(format!("buffer {i}"), expected, content.len() as u64));
            }
            buffers.places.push(place);
        }
        Ok(buffers)
    }

    /// The content of a buffer, if it exists and has one.
    pub fn get(&self, buffer: usize) -> Option<&[u8]> {
        let place = self.places.get(buffer)?;
        self.all_of(place)?.get(..place.length)
    }

    /// Bytes in files beside the model.
    pub fn file_bytes(&self) -> u64 {
        self.referred.bytes
    }

    /// Hands over what was read beside the model.
    pub fn into_referred(self) -> Referred {
        self.referred
    }

    fn all_of(&self, place: &Place) -> Option<&[u8]> {
        match place.content {
            Content::Nowhere => None,
            Content::Bin => self.bin,
            Content::Loaded(index) => self.loaded.get(index).map(Vec::as_slice),
        }
    }
}

fn data_uri(source: &Source, buffer: usize, uri: &str) -> Result<Vec<u8>, ImportError> {
    let text = uri.split_once(',').filter(|(kind, _)| kind.ends_with(";base64")).map(|(_, text)| text);
    text.and_then(|text| base64(text.as_bytes())).ok_or_else(|| {
        let place = format!("buffer {buffer}, uri");
        source.invalid(place, "data:...;base64, and base64 text", excerpt(uri.as_bytes()))
    })
}

/// RFC 4648 with or without padding; `None` for any other character.
fn base64(text: &[u8]) -> Option<Vec<u8>> {
    let text = text.trim_ascii_end();
    let text = text.strip_suffix(b"==").or_else(|| text.strip_suffix(b"=")).unwrap_or(text);
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 2);
    for group in text.chunks(4) {
        let mut bits = 0_u32;
        for &character in group {
            let value = match character {
                b'A'..=b'Z' => character - b'A',
                b'a'..=b'z' => character - b'a' + 26,
                b'0'..=b'9' => character - b'0' + 52,
                b'+' | b'-' => 62,
                b'/' | b'_' => 63,
                _ => return None,
            };
            bits = bits << 6 | u32::from(value);
        }
        // n characters hold n - 1 whole bytes; one alone holds none.
        let whole = group.len().checked_sub(1).filter(|&whole| whole > 0)?;
        bits <<= 6 * (4 - group.len());
        bytes.extend(bits.to_be_bytes().iter().skip(1).take(whole));
    }
    Some(bytes)
}

fn percent_decoded(uri: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(match byte {
            b'%' => {
                let mut digit = || char::from(rest.next()?).to_digit(16);
                (digit()? * 16 + digit()?) as u8
            }
            _ => byte,
        });
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_the_rfc_is_decoded_and_nonsense_is_not() {
        for (text, bytes) in
            [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm8", "fo"), ("Zm9v", "foo"), ("Zm9vYmE=", "fooba")]
        {
            assert_eq!(base64(text.as_bytes()).unwrap(), bytes.as_bytes());
        }
        for text in ["Z", "Zm9vY", "Zm 9", "Z===", "Zm9\u{e9}"] {
            assert_eq!(base64(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn percent_escapes_are_decoded_once() {
        assert_eq!(percent_decoded("a%20b%2Fc%252e.bin").unwrap(), "a b/c%2e.bin");
        for broken in ["%", "%2", "%zz", "%ff"] {
            assert_eq!(percent_decoded(broken), None);
        }
    }
}
