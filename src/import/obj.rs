//! Wavefront OBJ: polygons in groups, coloured by the materials of MTL libraries.
//!
//! Each `o` or `g` that has faces is a node; groups that follow an `o` are nodes below it. If its materials have one colour it carries one object;
//! otherwise each colour is a child node with an object. Texture coordinates and normals are not read, so
//! corners that differ only there are one vertex. Concave polygons are cut properly up to 256 corners.
//! Vertices may follow the faces that use them. The fourth number of `v` (a weight of rational curves) and
//! colours behind it are not used.

use std::borrow::Cow;
use std::collections::HashMap;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use super::draft::{Draft, HashedPart, Piece, Source};
use super::error::ImportError;
use super::files;
use super::mtl::Materials;
use super::repair::{self, Dropped, MAX_PART_TRIANGLES, Remap};
use super::text::{first_word, name, three_numbers, words};
use super::triangulate;
use crate::model::{Colour, Mesh};
use crate::report::Findings;

/// Libraries read for one OBJ; more are counted. Nobody has that many, and a file could ask for one a
/// thousand times under different spellings.
const MAX_LIBRARIES: usize = 64;

/// Triangles of one group that have one colour.
struct Bucket {
    label: String,
    colour: Colour,
    /// Indices into all vertices of the file, not yet checked.
    triangles: Vec<[u32; 3]>,
}

/// Faces between one `o` or `g` and the next.
struct Group {
    name: String,
    /// Index in [`Obj::objects`] of the `o` that it belongs to, if there was one.
    object: Option<usize>,
    buckets: Vec<Bucket>,
    by_colour: HashMap<Colour, usize>,
    /// Bucket of the last face.
    last: usize,
}

pub(super) fn read(source: &Source) -> Result<Draft, ImportError> {
    let mut parser = Obj::new(source);
    parser.parse()?;
    let Obj { positions, groups, objects, mut draft, .. } = parser;

    let buckets: Vec<_> = groups.iter().flat_map(|g| g.buckets.iter().map(move |b| (g, b))).collect();
    let tidied: Vec<(HashedPart, Findings)> = buckets
        .par_iter()
        .map_init(|| None, |remap, (group, bucket)| tidy(source, &positions, group, bucket, remap))
        .collect();
    source.check_cancelled()?;

    let mut tidied = tidied.into_iter();
    // The last `o` that has a node, and its node.
    let mut above: Option<(usize, u32)> = None;
    for group in &groups {
        let known = above.filter(|(object, _)| Some(*object) == group.object).map(|(_, node)| node);
        let object = group.object.and_then(|object| Some((object, objects.get(object)?)));
        let node = match (known, object) {
            (None, Some((id, object))) => {
                let node = draft.node(source, object.clone(), None, None)?;
                above = Some((id, node));
                let is_itself = *object == group.name;
                if is_itself { node } else { draft.node(source, group.name.clone(), Some(node), None)? }
            }
            (parent, _) => draft.node(source, group.name.clone(), parent, None)?,
        };
        let mut pieces = Vec::new();
        for (bucket, (part, findings)) in group.buckets.iter().zip(&mut tidied) {
            draft.findings.merge(findings);
            let place = || format!("{}: group \"{}\"", source.name, group.name);
            if let Some(part) = draft.part(part, place) {
                pieces.push(Piece { label: bucket.label.clone(), colour: bucket.colour, part });
            }
        }
        draft.place(source, node, DAffine3::IDENTITY, &pieces)?;
    }
    Ok(draft)
}

/// Makes the part of one bucket. `remap` is kept from bucket to bucket, where a table of all vertices pays.
fn tidy(
    source: &Source,
    positions: &[DVec3],
    group: &Group,
    bucket: &Bucket,
    remap: &mut Option<Remap>,
) -> (HashedPart, Findings) {
    let mut mesh = Mesh::default();
    let mut dropped = Dropped::default();
    let remap = remap.get_or_insert_with(|| Remap::new(positions.len(), usize::MAX));
    remap.clear();
    mesh.triangles.reserve(bucket.triangles.len());
    let position = |i: u32| positions.get(i as usize).copied().unwrap_or(DVec3::NAN);
    let triangles = bucket.triangles.iter().copied();
    repair::append(&mut mesh, positions.len(), position, triangles, remap, &mut dropped);
    let mut findings = Findings::default();
    dropped.report(&mut findings, || format!("{}: group \"{}\"", source.name, group.name));
    (HashedPart::new(group.name.clone(), mesh), findings)
}

/// The file, as far as it is read.
struct Obj<'a> {
    source: &'a Source<'a>,
    positions: Vec<DVec3>,
    /// Finished groups.
    groups: Vec<Group>,
    /// The group that faces go to.
    group: Group,
    /// Name of the group that the next face opens; `None` if it goes to the current one.
    next_group: Option<String>,
    /// Names of all `o` so far; groups belong to the last one.
    objects: Vec<String>,
    /// The last `o`, unless it has no name.
    object: Option<usize>,
    materials: Materials,
    libraries: Vec<String>,
    material: String,
    colour: Colour,
    /// Corners of the current face.
    corners: Vec<u32>,
    draft: Draft,
}

impl<'a> Obj<'a> {
    fn new(source: &'a Source<'a>) -> Self {
        Obj {
            source,
            positions: Vec::new(),
            groups: Vec::new(),
            group: Group::new(source.stem(), None),
            next_group: None,
            objects: Vec::new(),
            object: None,
            materials: Materials::default(),
            libraries: Vec::new(),
            material: String::new(),
            colour: Colour::default(),
            corners: Vec::new(),
            draft: Draft::default(),
        }
    }

    fn parse(&mut self) -> Result<(), ImportError> {
        let mut rest = self.source.bytes;
        let mut line_number = 0;
        while !rest.is_empty() {
            let first = line_number + 1;
            let line = logical_line(&mut rest, &mut line_number);
            if first % 65_536 == 0 {
                self.source.check_cancelled()?;
            }
            self.statement(&line, first)?;
        }
        self.finish_group(String::new());
        let not_understood = self.materials.not_understood;
        self.count("MTL lines not understood", not_understood, String::new);
        Ok(())
    }

    fn statement(&mut self, line: &[u8], number: u64) -> Result<(), ImportError> {
        let (keyword, rest) = first_word(line);
        match keyword {
            b"v" => {
                let position = three_numbers(&mut words(rest))
                    .ok_or_else(|| self.source.syntax(number, "`v` and three numbers", line))?;
                self.positions.push(DVec3::from_array(position));
            }
            b"f" | b"fo" => self.face(rest, line, number)?,
            b"o" => {
                let name = name(rest);
                self.object = (!name.is_empty()).then_some(self.objects.len());
                self.objects.extend(self.object.map(|_| name.clone()));
                self.next_group = Some(name);
            }
            b"g" => self.next_group = Some(name(rest)),
            b"usemtl" => self.use_material(name(rest)),
            b"mtllib" => self.library(&name(rest)),
            b"l" | b"p" => {
                self.count("points and lines skipped", 1, || format!(", line {number}"));
            }
            b"vt" | b"vn" | b"vp" | b"s" => {}
            _ if keyword.first().is_none_or(|&b| b == b'#') => {}
            _ => self.count("OBJ statements ignored: not polygons", 1, || format!(", line {number}")),
        }
        Ok(())
    }

    fn face(&mut self, rest: &[u8], line: &[u8], number: u64) -> Result<(), ImportError> {
        self.corners.clear();
        for word in words(rest).take_while(|word| !word.starts_with(b"#")) {
            // v, v/vt, v/vt/vn, v//vn: only v is of interest.
            let vertex = word.split(|&b| b == b'/').next().unwrap_or_default();
            let vertex = whole_number(vertex)
                .ok_or_else(|| self.source.syntax(number, "`f` and vertex numbers", line))?;
            self.corners.push(self.absolute(vertex));
        }
        if self.corners.len() < 3 {
            self.count("faces skipped: fewer than three corners", 1, || format!(", line {number}"));
            return Ok(());
        }
        if let Some(name) = self.next_group.take() {
            // The current group is put away only now, hence + 2.
            let invented = || format!("{} {}", self.source.stem(), self.groups.len() + 2);
            let name = if name.is_empty() { invented() } else { name };
            self.finish_group(name);
        }
        let bucket = self.group.bucket(self.colour, &self.material);
        let position = |i: u32| self.positions.get(i as usize).copied();
        triangulate::polygon(&self.corners, position, &mut bucket.triangles);
        if bucket.triangles.len() as u64 > MAX_PART_TRIANGLES {
            let advice = "split it into several groups";
            return Err(self.source.too_many("triangles in one part", MAX_PART_TRIANGLES, advice));
        }
        Ok(())
    }

    /// Puts the current group away, if it has faces, and opens one called `next`.
    fn finish_group(&mut self, next: String) {
        let done = std::mem::replace(&mut self.group, Group::new(next, self.object));
        if !done.buckets.is_empty() {
            self.groups.push(done);
        }
    }

    /// Index from 0: numbers count from 1, negative ones back from the last vertex so far. What is neither,
    /// and 0, is given as out of range.
    fn absolute(&self, vertex: i64) -> u32 {
        let index = match vertex {
            1.. => vertex - 1,
            0 => return u32::MAX,
            _ => (self.positions.len() as i64).saturating_add(vertex),
        };
        u32::try_from(index).unwrap_or(u32::MAX)
    }

    fn use_material(&mut self, material: String) {
        match self.materials.colour(&material) {
            Some(colour) => self.colour = colour,
            None => {
                self.colour = Colour::default();
                self.count("materials not found: grey is used", 1, || format!(": \"{material}\""));
            }
        }
        self.material = material;
    }

    fn library(&mut self, file: &str) {
        if self.libraries.iter().any(|known| known == file) {
            return;
        }
        if self.libraries.len() >= MAX_LIBRARIES {
            return self.count("material libraries skipped: more than 64", 1, || format!(": \"{file}\""));
        }
        self.libraries.push(file.to_owned());
        let read = files::read_beside(self.source, file);
        // What leads out of the folder is no file of the model.
        if let Ok(path) = files::resolve(self.source, file) {
            match &read {
                Ok(library) => self.draft.referred.add(&path, library),
                Err(_) => self.draft.referred.add_unread(&path),
            }
        }
        match read {
            Ok(library) => self.materials.add(&library),
            // `mtllib a.mtl b.mtl` and a name with a space cannot be told apart but by trying.
            Err(ImportError::Io { .. }) if file.contains(' ') => {
                file.split_whitespace().for_each(|part| self.library(part));
            }
            Err(why @ ImportError::UnsafePath { .. }) => {
                self.count("material libraries refused: outside the model's folder", 1, || {
                    format!(" ({why})")
                });
            }
            Err(why) => self.count("material libraries missing: grey is used", 1, || format!(" ({why})")),
        }
    }

    fn count(&mut self, what: &str, count: u64, place: impl FnOnce() -> String) {
        self.draft.findings.add(what, count, || self.source.name.to_owned() + &place());
    }
}

impl Group {
    fn new(name: String, object: Option<usize>) -> Self {
        Group { name, object, buckets: Vec::new(), by_colour: HashMap::new(), last: 0 }
    }

    /// Where triangles of this colour go; a new bucket is called by the material.
    fn bucket(&mut self, colour: Colour, material: &str) -> &mut Bucket {
        // Runs of one material are long: the bucket of the last face is nearly always it.
        if self.buckets.get(self.last).is_none_or(|bucket| bucket.colour != colour) {
            self.last = *self.by_colour.entry(colour).or_insert(self.buckets.len());
        }
        if self.last == self.buckets.len() {
            let label = if material.is_empty() { "no material".to_owned() } else { material.to_owned() };
            self.buckets.push(Bucket { label, colour, triangles: Vec::new() });
        }
        // `last` is in range since the line above.
        &mut self.buckets[self.last]
    }
}

/// A line, joined with the next ones while it ends with `\`.
fn logical_line<'a>(rest: &mut &'a [u8], line_number: &mut u64) -> Cow<'a, [u8]> {
    let mut joined: Option<Vec<u8>> = None;
    loop {
        let end = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        let (line, tail) = rest.split_at(end);
        *rest = tail.get(1..).unwrap_or_default();
        *line_number += 1;
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        // A comment ends with its line, also one that ends with a Windows folder: `# made in C:\temp\`.
        let is_comment = || words(line).any(|word| word.starts_with(b"#"));
        let continued = line.strip_suffix(b"\\").filter(|_| !rest.is_empty() && !is_comment());
        match (continued, &mut joined) {
            (None, None) => return Cow::Borrowed(line),
            (None, Some(_)) => {
                let mut all = joined.unwrap_or_default();
                all.extend_from_slice(line);
                return Cow::Owned(all);
            }
            (Some(line), _) => {
                let all = joined.get_or_insert_default();
                all.extend_from_slice(line);
                all.push(b' ');
            }
        }
    }
}

/// A decimal whole number with an optional sign; saturates, which is out of range anyway.
fn whole_number(word: &[u8]) -> Option<i64> {
    let (negative, digits) = match word {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] => (false, digits),
        _ => (false, word),
    };
    if digits.is_empty() {
        return None;
    }
    let mut value = 0_i64;
    for &digit in digits {
        let digit = digit.wrapping_sub(b'0');
        if digit > 9 {
            return None;
        }
        value = value.saturating_mul(10).saturating_add(i64::from(digit));
    }
    Some(if negative { -value } else { value })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::ImportOptions;
    use crate::progress::Silent;

    fn read_text(folder: &std::path::Path, text: &str) -> Result<Draft, ImportError> {
        let (options, path) = (ImportOptions::default(), folder.join("hull.obj"));
        let (name, bytes) = ("hull.obj", text.as_bytes());
        read(&Source { name, path: &path, bytes, depth: 0, options: &options, progress: &Silent })
    }

    fn read_alone(text: &str) -> Result<Draft, ImportError> {
        read_text(tempfile::tempdir().unwrap().path(), text)
    }

    #[test]
    fn groups_become_parts_with_their_own_vertices_and_all_digits() {
        let draft = read_alone(
            "v 435440.123456 0 0\nv 435441 0 0\r\nv 435441 1 0\nv 435440 1 0 1 0.5 0.5\nvt 0 0\no empty\ng quad of four\n\
             f 1/1/1 2/7 3// \\\n 4\ng\nf -1 -2 -3\nf 2 3\nl 1 2\ncstype bezier\n",
        )
        .unwrap();
        let names: Vec<_> = draft.nodes.iter().map(|n| n.name.as_str()).collect();
        assert_eq!(names, ["empty", "quad of four", "hull 2"]);
        let [quad, second] = [0, 1].map(|i| &draft.parts[i].part.mesh);
        assert_eq!(quad.positions[0].x, 435_440.123456);
        assert_eq!(quad.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(
            second.positions,
            [(435_440.0, 1.0), (435_441.0, 1.0), (435_441.0, 0.0)].map(|(x, y)| DVec3::new(x, y, 0.0))
        );
        assert_eq!(draft.findings.0["faces skipped: fewer than three corners"].first, "hull.obj, line 12");
        assert_eq!(draft.findings.0["points and lines skipped"].count, 1);
        assert_eq!(draft.findings.0.len(), 3, "{:?}", draft.findings);
    }

    #[test]
    fn a_group_of_several_colours_becomes_a_node_with_a_child_a_colour() {
        let folder = tempfile::tempdir().unwrap();
        let library = "newmtl red\nKd 1 0 0\nnewmtl same\nKd 1 0 0\n";
        std::fs::write(folder.path().join("my paint.mtl"), library).unwrap();
        let text = "mtllib my paint.mtl\nmtllib my paint.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\ng wing\n\
             usemtl red\nf 1 2 3\nusemtl blue\nf 1 3 4\nusemtl same\nf 2 3 4\n";
        let draft = read_text(folder.path(), text).unwrap();
        let nodes: Vec<_> = draft
            .nodes
            .iter()
            .map(|n| (n.name.as_str(), n.parent, n.object.as_ref().map(|o| o.colour)))
            .collect();
        let red = Colour([255, 0, 0, 255]);
        let expected =
            [("wing", None, None), ("red", Some(0), Some(red)), ("blue", Some(0), Some(Colour::default()))];
        assert_eq!(nodes, expected);
        assert_eq!(draft.parts[0].part.mesh.triangles.len(), 2);
        assert_eq!(draft.findings.0["materials not found: grey is used"].first, "hull.obj: \"blue\"");
        assert_eq!(draft.referred.bytes, library.len() as u64);
    }

    #[test]
    fn libraries_that_are_missing_or_outside_are_findings() {
        let draft =
            read_alone("mtllib ../x.mtl\nmtllib C:\\x.mtl\nmtllib gone.mtl\nv 0 0 0\nf 1 1 1").unwrap();
        let count = |what: &str| draft.findings.0.iter().find(|f| f.0.contains(what)).map(|f| f.1.count);
        assert_eq!(count("outside the model's folder"), Some(2));
        assert_eq!(count("missing"), Some(1));
        assert_eq!(count("two corners"), Some(1));
        assert_eq!(count("no triangle"), Some(1));
        assert!(draft.nodes.len() == 1 && draft.nodes[0].object.is_none());
    }

    #[test]
    fn groups_of_an_object_stand_below_it() {
        let draft = read_alone(
            "v 0 0 0\nv 1 0 0\nv 0 1 0\ng loose\nf 1 2 3\no Pump\ng Pump_red\nf 1 2 3\ng Pump_blue\nf 1 2 3\n\
             o Valve\nf 1 2 3\ng handle\nf 1 2 3\no none\no Bolt\ng Bolt\nf 1 2 3\no Bolt\nf 1 2 3\n",
        )
        .unwrap();
        let nodes: Vec<_> =
            draft.nodes.iter().map(|n| (n.name.as_str(), n.parent, n.object.is_some())).collect();
        let expected = [
            ("loose", None, true),
            ("Pump", None, false),
            ("Pump_red", Some(1), true),
            ("Pump_blue", Some(1), true),
            ("Valve", None, true),
            ("handle", Some(4), true),
            ("Bolt", None, true),
            ("Bolt", None, true),
        ];
        assert_eq!(nodes, expected);
    }

    #[test]
    fn comments_end_with_their_line_and_may_stand_behind_a_face() {
        let draft = read_alone(
            "# made by C:\\temp\\\nv 0 0 0\nv 1 0 0 # corner C:\\temp\\\r\nv 0 1 0\nv 0 0 1\n\
             \t# x \\\nf 1 2 3 # face\nf 2 \\\n 3 4 #5\n",
        )
        .unwrap();
        assert_eq!(draft.parts[0].part.mesh.positions[0], DVec3::ZERO);
        assert_eq!(draft.parts[0].part.mesh.triangles, [[0, 1, 2], [1, 2, 3]]);
        assert!(draft.findings.0.is_empty(), "{:?}", draft.findings);
    }

    #[test]
    fn far_indices_are_dropped_and_nonsense_says_its_line() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 0 1 2\nf -9223372036854775808 1 2\n\
             f 99999999999999999999 1 2\nf 1/-9/-9 2/99999999999 3\nv nan 0 0\nf 1 2 4\nf 1 5 2\nv 0 0 1";
        let draft = read_alone(text).unwrap();
        assert_eq!(draft.parts[0].part.mesh.triangles.len(), 3, "the last face uses a later vertex");
        assert_eq!(draft.findings.0["triangles dropped: an index is out of range"].count, 3);
        assert_eq!(draft.findings.0["triangles dropped: a coordinate is not a finite number"].count, 1);
        for (text, line) in [("v 1 2", 1), ("\nv 1,5 2 3", 2), ("v 0 0 0\n\nf 1 1 a", 3), ("f /1 2 3", 1)] {
            let error = read_alone(text).err().map(|e| e.to_string()).unwrap();
            assert!(error.contains(&format!("line {line}:")), "{error}");
        }
    }
}
