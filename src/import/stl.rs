//! STL, ascii and binary: triangles with their own corners, welded here where corners have the same
//! coordinates.
//!
//! A binary file may begin with `solid` as ascii ones do; the size that its triangle count implies and the
//! word `facet` tell them apart. Normals and colours are not used.

use std::collections::HashMap;

use glam::{DAffine3, DVec3};

use super::detect::{contains, head, looks_binary};
use super::draft::{Draft, HashedPart, Piece, Source};
use super::error::ImportError;
use super::repair::{self, Dropped, MAX_PART_TRIANGLES};
use super::text::{name, number};
use crate::model::Colour;

const HEADER_BYTES: usize = 80;
const COUNT_END: usize = HEADER_BYTES + 4;
/// Normal, three corners, two bytes of attributes.
const TRIANGLE_BYTES: usize = 50;
/// Corners begin behind the normal.
const CORNERS_AT: usize = 12;

/// Triangle count of a binary file, if it is long enough to have one.
fn binary_count(bytes: &[u8]) -> Option<u32> {
    bytes.get(HEADER_BYTES..COUNT_END)?.try_into().ok().map(u32::from_le_bytes)
}

fn binary_size(count: u32) -> u64 {
    COUNT_END as u64 + u64::from(count) * TRIANGLE_BYTES as u64
}

/// True if the size is what a binary file with at least one triangle must have.
pub(super) fn is_binary_of_exact_size(bytes: &[u8]) -> bool {
    binary_count(bytes).is_some_and(|count| count > 0 && binary_size(count) == bytes.len() as u64)
}

/// True if this is a text that begins as an ascii STL does.
pub(super) fn is_ascii(bytes: &[u8]) -> bool {
    let head = head(bytes);
    let begins = head.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    let lower = head.to_ascii_lowercase();
    begins
        && !is_binary_of_exact_size(bytes)
        && !looks_binary(bytes)
        && (contains(&lower, b"facet") || contains(&lower, b"endsolid"))
}

pub(super) fn read(source: &Source) -> Result<Draft, ImportError> {
    let mut draft = Draft::default();
    if is_ascii(source.bytes) {
        for (name, soup) in read_ascii(source, &mut draft)? {
            add(source, &mut draft, name, soup)?;
        }
    } else {
        let soup = read_binary(source, &mut draft)?;
        add(source, &mut draft, source.stem(), soup)?;
    }
    Ok(draft)
}

/// Corners welded by equal coordinates, numbered in the order of first use.
#[derive(Default)]
struct Soup {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    // The standard hasher: a file cannot be made to collide on purpose.
    known: HashMap<[u64; 3], u32>,
}

impl Soup {
    fn triangle(&mut self, corners: [DVec3; 3]) {
        let indices = corners.map(|corner| {
            // + 0.0 makes -0 equal to 0.
            let bits = (corner + 0.0).to_array().map(f64::to_bits);
            *self.known.entry(bits).or_insert_with(|| {
                self.positions.push(corner);
                self.positions.len() as u32 - 1
            })
        });
        self.triangles.push(indices);
    }
}

fn add(source: &Source, draft: &mut Draft, name: String, soup: Soup) -> Result<(), ImportError> {
    let mut dropped = Dropped::default();
    let mesh = repair::tidy(&soup.positions, &soup.triangles, &mut dropped);
    let place = || format!("{}: solid \"{name}\"", source.name);
    dropped.report(&mut draft.findings, place);
    let node = draft.node(source, name.clone(), None, None)?;
    if let Some(part) = draft.part(HashedPart::new(name.clone(), mesh), place) {
        let piece = Piece { label: name, colour: Colour::default(), part };
        draft.place(source, node, DAffine3::IDENTITY, &[piece])?;
    }
    Ok(())
}

fn read_binary(source: &Source, draft: &mut Draft) -> Result<Soup, ImportError> {
    let found = source.bytes.len() as u64;
    let count = binary_count(source.bytes)
        .ok_or_else(|| source.truncated("the header of a binary STL", COUNT_END as u64, found))?;
    let expected = binary_size(count);
    if found < expected {
        return Err(source.truncated(format!("a binary STL of {count} triangles"), expected, found));
    }
    if u64::from(count) > MAX_PART_TRIANGLES {
        return Err(source.too_many(
            "triangles in one part",
            MAX_PART_TRIANGLES,
            "split it into several files",
        ));
    }
    draft.findings.add("bytes behind the last triangle ignored", found - expected, || source.name.to_owned());
    let mut soup = Soup::default();
    let records = source.bytes.get(COUNT_END..).unwrap_or_default().chunks_exact(TRIANGLE_BYTES);
    for (i, record) in records.take(count as usize).enumerate() {
        if i % 65_536 == 0 {
            source.check_cancelled()?;
        }
        let float = |at: usize| {
            let bytes = record.get(at..at + 4).and_then(|bytes| bytes.try_into().ok());
            // A record has 50 bytes: never NaN for want of them.
            bytes.map_or(f64::NAN, |bytes| f64::from(f32::from_le_bytes(bytes)))
        };
        let corner = |k: usize| {
            let at = CORNERS_AT + 12 * k;
            DVec3::new(float(at), float(at + 4), float(at + 8))
        };
        soup.triangle([corner(0), corner(1), corner(2)]);
    }
    Ok(soup)
}

/// Words with the line they stand in.
struct Words<'a> {
    rest: &'a [u8],
    line: u64,
}

impl<'a> Words<'a> {
    fn next(&mut self) -> Option<&'a [u8]> {
        let start = self.rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(self.rest.len());
        let (space, rest) = self.rest.split_at(start);
        self.line += space.iter().filter(|&&b| b == b'\n').count() as u64;
        let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        let (word, rest) = rest.split_at(end);
        self.rest = rest;
        (!word.is_empty()).then_some(word)
    }

    /// What is left of the line.
    fn rest_of_line(&mut self) -> &'a [u8] {
        let end = self.rest.iter().position(|&b| b == b'\n').unwrap_or(self.rest.len());
        let (line, rest) = self.rest.split_at(end);
        self.rest = rest;
        line
    }
}

fn read_ascii(source: &Source, draft: &mut Draft) -> Result<Vec<(String, Soup)>, ImportError> {
    let mut words = Words { rest: source.bytes, line: 1 };
    let mut solids: Vec<(String, Soup)> = Vec::new();
    let mut outline: Vec<DVec3> = Vec::new();
    let mut is_open = false;
    let mut words_read = 0_u64;
    while let Some(word) = words.next() {
        words_read += 1;
        if words_read.is_multiple_of(65_536) {
            source.check_cancelled()?;
        }
        let keyword = word.to_ascii_lowercase();
        let ends_the_outline =
            matches!(keyword.as_slice(), b"solid" | b"endsolid" | b"facet" | b"endfacet" | b"outer");
        if ends_the_outline && !outline.is_empty() {
            return Err(source.syntax(words.line, "endloop behind the vertices of a facet", word));
        }
        match keyword.as_slice() {
            b"solid" => {
                let given = name(words.rest_of_line());
                let stem = source.stem();
                let invented = if solids.is_empty() { stem } else { format!("{stem} {}", solids.len() + 1) };
                solids.push((if given.is_empty() { invented } else { given }, Soup::default()));
                is_open = true;
            }
            b"endsolid" => {
                words.rest_of_line();
                is_open = false;
            }
            // Three numbers follow `normal`; they are computed again where they are needed.
            b"normal" => (0..3).for_each(|_| {
                words.next();
            }),
            b"facet" | b"outer" | b"loop" | b"endfacet" => {}
            b"vertex" => {
                let mut coordinate = || {
                    let word = words.next().unwrap_or_default();
                    number(word).ok_or_else(|| source.syntax(words.line, "a number", word))
                };
                outline.push(DVec3::new(coordinate()?, coordinate()?, coordinate()?));
            }
            b"endloop" => {
                let expected = "at least three lines `vertex x y z` before endloop";
                let [first, rest @ ..] = outline.as_slice() else {
                    return Err(source.syntax(words.line, expected, word));
                };
                if rest.len() < 2 {
                    return Err(source.syntax(words.line, expected, word));
                }
                let Some((_, soup)) = solids.last_mut() else {
                    return Err(source.syntax(words.line, "a line `solid name` first", word));
                };
                if soup.triangles.len() as u64 + rest.len() as u64 > MAX_PART_TRIANGLES {
                    let advice = "split it into several solids";
                    return Err(source.too_many("triangles in one part", MAX_PART_TRIANGLES, advice));
                }
                for pair in rest.windows(2) {
                    if let &[b, c] = pair {
                        soup.triangle([*first, b, c]);
                    }
                }
                outline.clear();
            }
            _ => {
                let expected =
                    "a word of ascii STL (solid, facet, outer loop, vertex, endloop, endfacet, endsolid)";
                return Err(source.syntax(words.line, expected, word));
            }
        }
    }
    if !outline.is_empty() {
        return Err(source.syntax(words.line, "endloop and endfacet: the file was cut short", b""));
    }
    draft.findings.add("solids without endsolid: cut short?", u64::from(is_open), || source.name.to_owned());
    Ok(solids)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::import::ImportOptions;
    use crate::progress::Silent;

    fn read_bytes(bytes: &[u8]) -> Result<Draft, ImportError> {
        let options = ImportOptions::default();
        let path = Path::new("bolt.stl");
        read(&Source { name: "bolt.stl", path, bytes, depth: 0, options: &options, progress: &Silent })
    }

    fn binary(title: &[u8], corners: &[[f32; 3]]) -> Vec<u8> {
        let mut file = title.to_vec();
        file.resize(HEADER_BYTES, b' ');
        file.extend((corners.len() as u32 / 3).to_le_bytes());
        for triangle in corners.chunks_exact(3) {
            file.extend([0; CORNERS_AT]);
            triangle.iter().flatten().for_each(|c| file.extend(c.to_le_bytes()));
            file.extend([0; 2]);
        }
        file
    }

    const SQUARE: [[f32; 3]; 6] = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [-0.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, 0.5],
    ];

    #[test]
    fn binary_that_begins_with_solid_is_read_as_binary_and_welded() {
        let draft = read_bytes(&binary(b"solid facet", &SQUARE)).unwrap();
        let mesh = &draft.parts[0].part.mesh;
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.positions[3], DVec3::new(0.0, 1.0, 0.5));
        assert_eq!(draft.nodes[0].name, "bolt");
    }

    #[test]
    fn truncated_binary_says_the_expected_and_the_found_size() {
        let file = binary(b"", &SQUARE);
        for length in [0, 40, 83, 84, 133, file.len() - 1] {
            let error = read_bytes(&file[..length]).err().map(|e| e.to_string()).unwrap();
            let expected = if length < 84 { 84 } else { 184 };
            assert!(error.contains(&format!("{expected} bytes, found {length}")), "{error}");
        }
    }

    #[test]
    fn absurd_count_is_refused_before_memory_is_taken() {
        let mut file = binary(b"", &SQUARE);
        file[HEADER_BYTES..COUNT_END].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(matches!(read_bytes(&file), Err(ImportError::Truncated { expected: 214_748_364_834, .. })));
    }

    #[test]
    fn several_ascii_solids_become_several_parts_with_all_digits() {
        let file = b"SOLID left hand\r\n facet normal 0 0 1\r\n outer loop\r\n vertex 435440.123456 0 0\r\n\
            vertex 1 0 0 vertex 1 1 0\r\n endloop endfacet endsolid left hand\n\
            solid\n facet normal nan nan nan outer loop vertex 0 0 0 vertex 1 0 0 vertex 1 1 1e0 vertex 0 1 0\n\
            endloop endfacet\n";
        let draft = read_bytes(file).unwrap();
        let names: Vec<_> = draft.nodes.iter().map(|n| n.name.as_str()).collect();
        assert_eq!(names, ["left hand", "bolt 2"]);
        assert_eq!(draft.parts[0].part.mesh.positions[0].x, 435_440.123456);
        assert_eq!(draft.parts[1].part.mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(draft.findings.0.len(), 1, "{:?}", draft.findings);
    }

    #[test]
    fn broken_ascii_says_the_line() {
        let head = "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n";
        for (tail, line, found) in [
            ("vertex 0 0,5 0\n", 5, "0,5"),
            ("vertex 0 0\n", 6, ""),
            ("\nendloop\n", 6, "endloop"),
            ("vortex 1 2 3", 5, "vortex"),
            ("vertex 1 2 3\n", 6, ""),
            // Not a triangle less without a word.
            ("vertex 1 2 3\nvertex 1 2 4\nendfacet\nendsolid\n", 7, "endfacet"),
            ("vertex 1 2 3\nvertex 1 2 4\nfacet normal 0 0 1\n", 7, "facet"),
            ("vertex 1 2 3\nvertex 1 2 4\nouter loop\n", 7, "outer"),
            ("vertex 1 2 3\nvertex 1 2 4\nendsolid x\n", 7, "endsolid"),
            ("vertex 1 2 3\nvertex 1 2 4\nsolid y\n", 7, "solid"),
        ] {
            let error = read_bytes(format!("{head}{tail}").as_bytes()).err().map(|e| e.to_string()).unwrap();
            assert!(error.contains(&format!("line {line}:")) && error.contains(found), "{error}");
        }
    }
}
