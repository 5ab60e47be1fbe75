//! PLY, ascii and binary of either byte order.
//!
//! The header is read by `ply-rs-bw`. The elements are not: that crate finds the place of each number by its
//! property's name, here the types are looked up once (Armadillo 77 ms instead of 153, ascii Bunny 41 ms
//! instead of 120, whole import, same machine). Counts are checked against the bytes that are left before
//! anything is read. Ascii numbers keep all digits, also where the header says `float`. The average of the
//! vertices' red, green and blue becomes the object's colour.

use glam::{DAffine3, DVec3};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, ElementDef, Encoding, PropertyType, ScalarType};

use super::draft::{Draft, HashedPart, Piece, Source};
use super::error::{ImportError, excerpt};
use super::repair::{self, Dropped, MAX_PART_TRIANGLES};
use super::text::{number, words};
use super::triangulate;
use crate::model::Colour;

/// One element of any kind: what is of interest of a vertex, a face or a triangle strip. Reused for all.
#[derive(Default)]
struct Row {
    position: [f64; 3],
    /// 0 to 255.
    rgb: [f64; 3],
    /// Indices as they stand in the file; what cannot be one is out of range.
    corners: Vec<u32>,
}

/// What a property is for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Role {
    Position(usize),
    Colour(usize),
    Corners,
    Other,
}

/// A property, ready to be read.
struct Column {
    role: Role,
    kind: PropertyType,
}

fn columns(element: &ElementDef) -> Vec<Column> {
    let column = |(name, property): (&String, &ply_rs_bw::ply::PropertyDef)| {
        let is_list = matches!(property.data_type, PropertyType::List(..));
        let role = match (name.as_str(), is_list) {
            ("x", false) => Role::Position(0),
            ("y", false) => Role::Position(1),
            ("z", false) => Role::Position(2),
            ("red", false) => Role::Colour(0),
            ("green", false) => Role::Colour(1),
            ("blue", false) => Role::Colour(2),
            ("vertex_indices" | "vertex_index", true) => Role::Corners,
            _ => Role::Other,
        };
        Column { role, kind: property.data_type.clone() }
    };
    element.properties.iter().map(column).collect()
}

impl Row {
    fn set(&mut self, role: Role, value: f64, kind: &ScalarType) {
        match role {
            Role::Position(axis) => {
                if let Some(entry) = self.position.get_mut(axis) {
                    *entry = value;
                }
            }
            Role::Colour(channel) => {
                // Floats go from 0 to 1.
                let is_float = matches!(kind, ScalarType::Float | ScalarType::Double);
                if let Some(entry) = self.rgb.get_mut(channel) {
                    *entry = (if is_float { value * 255.0 } else { value }).clamp(0.0, 255.0);
                }
            }
            // -1 ends a strip; it and every other impossible index are out of range.
            Role::Corners => {
                let is_index = value >= 0.0 && value < f64::from(u32::MAX) && value.fract() == 0.0;
                self.corners.push(if is_index { value as u32 } else { u32::MAX });
            }
            Role::Other => {}
        }
    }
}

/// What is taken from the file.
#[derive(Default)]
struct Shape {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    has_colours: bool,
    rgb_sum: [f64; 3],
    not_faces: u64,
}

impl Shape {
    fn vertex(&mut self, row: &Row) {
        self.positions.push(DVec3::from_array(row.position));
        for (sum, value) in self.rgb_sum.iter_mut().zip(row.rgb) {
            // A NaN colour counts as black.
            *sum += value.max(0.0);
        }
    }

    fn face(&mut self, row: &Row) {
        self.not_faces += u64::from(row.corners.len() < 3);
        let position = |i: u32| self.positions.get(i as usize).copied();
        triangulate::polygon(&row.corners, position, &mut self.triangles);
    }

    /// A list of strips, each ended by -1; every other triangle turns the other way.
    fn strips(&mut self, row: &Row) {
        for strip in row.corners.split(|&corner| corner == u32::MAX) {
            for (i, window) in strip.windows(3).enumerate() {
                if let &[a, b, c] = window {
                    self.triangles.push(if i % 2 == 0 { [a, b, c] } else { [b, a, c] });
                }
            }
        }
    }

    fn colour(&self) -> Colour {
        if !self.has_colours || self.positions.is_empty() {
            return Colour::default();
        }
        let [r, g, b] = self.rgb_sum.map(|sum| (sum / self.positions.len() as f64).round() as u8);
        Colour([r, g, b, 255])
    }
}

pub(super) fn read(source: &Source) -> Result<Draft, ImportError> {
    let parser = Parser::<DefaultElement>::new();
    let mut reader = Reader::new(source.bytes);
    let header = parser.read_header(&mut reader).map_err(|e| header_error(source, &e))?;
    let header_lines = source.bytes.len() - reader.get_ref().len();
    let line = source.bytes.get(..header_lines).unwrap_or_default().iter().filter(|&&b| b == b'\n').count();
    let mut body = Body { source, encoding: header.encoding, rest: reader.into_inner(), line: line as u64 };

    let mut shape = Shape::default();
    for element in header.elements.values() {
        match element.name.as_str() {
            "vertex" => {
                require_coordinates(source, element)?;
                shape.has_colours =
                    ["red", "green", "blue"].iter().all(|name| element.properties.contains_key(*name));
                body.each(element, |row| shape.vertex(row))?;
            }
            "face" => body.each(element, |row| shape.face(row))?,
            "tristrips" => body.each(element, |row| shape.strips(row))?,
            _ => body.each(element, |_| ())?,
        }
        if shape.triangles.len() as u64 > MAX_PART_TRIANGLES {
            let advice = "split it into several files";
            return Err(source.too_many("triangles in one part", MAX_PART_TRIANGLES, advice));
        }
    }
    draft_of(source, &shape)
}

fn draft_of(source: &Source, shape: &Shape) -> Result<Draft, ImportError> {
    let mut draft = Draft::default();
    let place = || source.name.to_owned();
    draft.findings.add("faces skipped: fewer than three corners", shape.not_faces, place);
    if shape.triangles.is_empty() {
        draft.findings.add("point clouds skipped: a PLY without faces", 1, place);
        return Ok(draft);
    }
    let mut dropped = Dropped::default();
    let mesh = repair::tidy(&shape.positions, &shape.triangles, &mut dropped);
    dropped.report(&mut draft.findings, place);
    let name = source.stem();
    let node = draft.node(source, name.clone(), None, None)?;
    if let Some(part) = draft.part(HashedPart::new(name.clone(), mesh), place) {
        let piece = Piece { label: name, colour: shape.colour(), part };
        draft.place(source, node, DAffine3::IDENTITY, &[piece])?;
    }
    Ok(draft)
}

fn require_coordinates(source: &Source, element: &ElementDef) -> Result<(), ImportError> {
    let is_scalar = |name: &&str| {
        element.properties.get(*name).is_some_and(|p| matches!(p.data_type, PropertyType::Scalar(_)))
    };
    if !["x", "y", "z"].iter().all(is_scalar) {
        let found = element.properties.keys().cloned().collect::<Vec<_>>().join(", ");
        return Err(source.invalid("element vertex", "properties x, y and z", excerpt(found.as_bytes())));
    }
    Ok(())
}

/// What follows the header.
struct Body<'a> {
    source: &'a Source<'a>,
    encoding: Encoding,
    rest: &'a [u8],
    /// Of the last line read, for ascii.
    line: u64,
}

impl Body<'_> {
    /// Reads all elements of one kind.
    fn each(&mut self, element: &ElementDef, mut take: impl FnMut(&Row)) -> Result<(), ImportError> {
        let smallest = smallest_element(element, self.encoding);
        if smallest == 0 {
            // No property, no byte: nothing to read, however many there are.
            return Ok(());
        }
        let needed = (element.count as u64).saturating_mul(smallest);
        // The last line may lack its end.
        let found = self.rest.len() as u64 + u64::from(self.encoding == Encoding::Ascii);
        if needed > found {
            let what = format!("{} elements \"{}\"", element.count, element.name);
            return Err(self.source.truncated(what, needed, self.rest.len() as u64));
        }
        let columns = columns(element);
        let mut row = Row::default();
        for i in 0..element.count {
            if i % 65_536 == 0 {
                self.source.check_cancelled()?;
            }
            row.corners.clear();
            match self.encoding {
                Encoding::Ascii => self.ascii(element, i, &columns, &mut row)?,
                Encoding::BinaryLittleEndian => self.binary::<false>(element, i, &columns, &mut row)?,
                Encoding::BinaryBigEndian => self.binary::<true>(element, i, &columns, &mut row)?,
            }
            take(&row);
        }
        Ok(())
    }

    fn ascii(
        &mut self,
        element: &ElementDef,
        i: usize,
        columns: &[Column],
        row: &mut Row,
    ) -> Result<(), ImportError> {
        let line = loop {
            if self.rest.is_empty() {
                let (needed, place) = (element.count, format!("element \"{}\"", element.name));
                let found = format!("{i}: the file was cut short");
                return Err(self.source.invalid(place, format!("{needed} lines"), found));
            }
            let end = self.rest.iter().position(|&b| b == b'\n').map_or(self.rest.len(), |at| at + 1);
            let (line, rest) = self.rest.split_at(end);
            self.rest = rest;
            self.line += 1;
            let line = line.trim_ascii();
            if !line.is_empty() {
                break line;
            }
        };
        read_words(line, columns, row)
            .ok_or_else(|| self.source.syntax(self.line, "a number for each property of the header", line))
    }

    fn binary<const BIG: bool>(
        &mut self,
        element: &ElementDef,
        i: usize,
        columns: &[Column],
        row: &mut Row,
    ) -> Result<(), ImportError> {
        let before = self.rest;
        read_bytes::<BIG>(&mut self.rest, columns, row).ok_or_else(|| {
            let at = self.source.bytes.len() - before.len();
            let place = format!("{} {i} of {}, at byte {at}", element.name, element.count);
            let found = "a list count that is negative, or the end of the file: was it cut short?";
            self.source.invalid(place, "all its properties", found)
        })
    }
}

/// Reads an element from the words of its line; `None` if there are too few or one is not a number.
fn read_words(line: &[u8], columns: &[Column], row: &mut Row) -> Option<()> {
    let mut words = words(line);
    for Column { role, kind } in columns {
        let value = number(words.next()?)?;
        match kind {
            PropertyType::Scalar(kind) => row.set(*role, value, kind),
            PropertyType::List(_, kind) => {
                // Too high a count ends with the line's words.
                for _ in 0..list_count(value)? {
                    row.set(*role, number(words.next()?)?, kind);
                }
            }
        }
    }
    Some(())
}

/// Reads an element from the front of `rest`; `None` if that is too short or a list count is impossible.
fn read_bytes<const BIG: bool>(rest: &mut &[u8], columns: &[Column], row: &mut Row) -> Option<()> {
    for Column { role, kind } in columns {
        match kind {
            PropertyType::Scalar(kind) => row.set(*role, scalar::<BIG>(rest, kind)?, kind),
            PropertyType::List(count, kind) => {
                let count = list_count(scalar::<BIG>(rest, count)?)?;
                if count.checked_mul(size(kind))? > rest.len() as u64 {
                    return None;
                }
                for _ in 0..count {
                    row.set(*role, scalar::<BIG>(rest, kind)?, kind);
                }
            }
        }
    }
    Some(())
}

fn list_count(value: f64) -> Option<u64> {
    (value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0).then_some(value as u64)
}

/// Takes a number off the front of `rest`. All types of PLY fit an f64 exactly.
#[inline]
fn scalar<const BIG: bool>(rest: &mut &[u8], kind: &ScalarType) -> Option<f64> {
    macro_rules! take {
        ($type:ty) => {{
            let (bytes, tail) = rest.split_first_chunk()?;
            *rest = tail;
            let value = if BIG { <$type>::from_be_bytes(*bytes) } else { <$type>::from_le_bytes(*bytes) };
            Some(f64::from(value))
        }};
    }
    match kind {
        ScalarType::Char => take!(i8),
        ScalarType::UChar => take!(u8),
        ScalarType::Short => take!(i16),
        ScalarType::UShort => take!(u16),
        ScalarType::Int => take!(i32),
        ScalarType::UInt => take!(u32),
        ScalarType::Float => take!(f32),
        ScalarType::Double => take!(f64),
    }
}

fn size(kind: &ScalarType) -> u64 {
    match kind {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// Bytes that an element takes at least.
fn smallest_element(element: &ElementDef, encoding: Encoding) -> u64 {
    // In ascii, a digit and a separator.
    let size = |kind: &ScalarType| if encoding == Encoding::Ascii { 2 } else { size(kind) };
    let of = |kind: &PropertyType| match kind {
        PropertyType::Scalar(scalar) => size(scalar),
        PropertyType::List(count, _) => size(count),
    };
    element.properties.values().map(|property| of(&property.data_type)).sum()
}

fn header_error(source: &Source, error: &ParseError) -> ImportError {
    let line = error.line().unwrap_or(1) as u64;
    let text = source.bytes.split(|&b| b == b'\n').nth(line.saturating_sub(1) as usize).unwrap_or_default();
    source.syntax(line, "a line of a PLY header (format, comment, element, property, end_header)", text)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::import::ImportOptions;
    use crate::progress::Silent;

    fn read_bytes(bytes: &[u8]) -> Result<Draft, ImportError> {
        let options = ImportOptions::default();
        let path = Path::new("scan.ply");
        read(&Source { name: "scan.ply", path, bytes, depth: 0, options: &options, progress: &Silent })
    }

    fn error_of(bytes: &[u8]) -> String {
        read_bytes(bytes).err().map(|e| e.to_string()).unwrap()
    }

    const ASCII: &str = "ply\nformat ascii 1.0\ncomment \u{e9}\nelement vertex 4\nproperty float x\nproperty float y\n\
        property double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\n\
        property list uchar int vertex_indices\nend_header\n435440.123456 0 0 10 20 30\n435441 0 0 20 20 30\n\n\
        435441 1 0 30 20 30\n435440 1 0 40 20 31\n4 0 1 2 3\n3 0 1 7\n";

    #[test]
    fn ascii_keeps_all_digits_fans_polygons_and_averages_colours() {
        let draft = read_bytes(ASCII.as_bytes()).unwrap();
        let mesh = &draft.parts[0].part.mesh;
        assert_eq!(mesh.positions[0].x, 435_440.123456);
        assert_eq!(mesh.triangles.len(), 2);
        assert_eq!(draft.nodes[0].object.as_ref().unwrap().colour, Colour([25, 20, 30, 255]));
        assert_eq!(draft.findings.0["triangles dropped: an index is out of range"].count, 1);
    }

    /// One mesh with a property of every scalar type, written in both byte orders by this test.
    fn binary(big: bool) -> Vec<u8> {
        let order = if big { "big" } else { "little" };
        let mut file = format!(
            "ply\nformat binary_{order}_endian 1.0\nelement vertex 3\nproperty short s\nproperty double x\n\
             property float y\nproperty int8 z\nelement extra 2\nproperty list ushort float w\nelement face 1\n\
             property uchar flags\nproperty list uint8 uint16 vertex_index\nend_header\n"
        )
        .into_bytes();
        macro_rules! put {
            ($value:expr) => {
                file.extend(if big { $value.to_be_bytes().to_vec() } else { $value.to_le_bytes().to_vec() })
            };
        }
        for (x, y, z) in [(435_440.123456_f64, 0.5_f32, -1_i8), (1.0, 0.0, 0), (0.0, 1.0, 0)] {
            put!(7_i16);
            put!(x);
            put!(y);
            put!(z);
        }
        put!(2_u16);
        put!(1.5_f32);
        put!(2.5_f32);
        put!(0_u16);
        file.extend([9, 3]);
        for corner in [0_u16, 1, 2] {
            put!(corner);
        }
        file
    }

    #[test]
    fn both_byte_orders_give_the_same_mesh() {
        let [little, big] = [false, true].map(|order| read_bytes(&binary(order)).unwrap());
        let mesh = &little.parts[0].part.mesh;
        assert_eq!(*mesh, big.parts[0].part.mesh);
        assert_eq!(mesh.positions[0], DVec3::new(435_440.123456, 0.5, -1.0));
        assert_eq!(mesh.triangles, [[0, 1, 2]]);
    }

    #[test]
    fn every_cut_of_a_file_is_an_error() {
        for file in [binary(false), binary(true)] {
            for length in 0..file.len() {
                assert!(read_bytes(&file[..length]).is_err(), "cut at {length}");
            }
        }
        let ascii = ASCII.as_bytes();
        // Without its line end the last line is still whole, and a digit of it may be.
        for length in 0..ascii.len() - 8 {
            assert!(read_bytes(&ascii[..length]).is_err(), "cut at {length}");
        }
    }

    #[test]
    fn absurd_counts_are_refused_or_cost_nothing() {
        let error = error_of(&ASCII.replace("vertex 4", "vertex 9000000000000000000").into_bytes());
        assert!(error.contains("9000000000000000000 elements \"vertex\""), "{error}");
        let empty_element =
            ASCII.replace("element vertex", "element nothing 9000000000000000000\nelement vertex");
        assert!(read_bytes(empty_element.as_bytes()).is_ok());
        let long_list = ASCII.replace("4 0 1 2 3", "4000000000 0 1 2 3");
        assert!(error_of(long_list.as_bytes()).contains("line 19"));
    }

    #[test]
    fn strips_turn_every_other_triangle_and_points_alone_are_no_model() {
        let strips = ASCII.replace("element face 2", "element tristrips 1").replace("3 0 1 7\n", "");
        let strips = strips.replace("4 0 1 2 3", "8 0 1 2 3 -1 0 1 2");
        let strips = strips.replace("uchar int", "int int");
        assert_eq!(
            read_bytes(strips.as_bytes()).unwrap().parts[0].part.mesh.triangles,
            [[0, 1, 2], [2, 1, 3], [0, 1, 2]]
        );
        let points = ASCII.replace("element face 2", "element face 0");
        let draft = read_bytes(points.as_bytes()).unwrap();
        assert!(draft.nodes.is_empty());
        assert!(draft.findings.0.keys().any(|what| what.contains("point clouds")));
    }

    #[test]
    fn a_broken_line_is_named() {
        assert!(error_of(ASCII.replace("1 1 0 30", "1 one 0 30").as_bytes()).contains("line 17"));
        assert!(
            error_of(ASCII.replace("property float x", "property float q").as_bytes()).contains("x, y and z")
        );
        assert!(error_of(ASCII.replace("element face", "elephant face").as_bytes()).contains("line 11"));
    }
}
