//! Assembly nodes by their paths, which survive a rebuild of the scene as numbers do not.
//!
//! Paths are those of [`Scene::node_path`]. Where several nodes have the same one (eight bolts side by side, all called
//! "bolt"), `\#3` behind it means the third in the order of the tree; in a node's own path a backslash stands before `\`
//! and `/` only. Without a number a path means all nodes that have it.

use std::collections::{HashMap, HashSet};

use crate::model::path_segment;
use crate::scene::Scene;

/// What paths lead to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// Nodes, rising, each once.
    pub nodes: Vec<u32>,
    /// Paths that lead nowhere: the scene was rebuilt without them.
    pub missing: usize,
}

/// The nodes that paths lead to.
pub fn find_nodes(scene: &Scene, paths: &[String]) -> Found {
    let wanted: Vec<Wanted> = paths.iter().map(|path| Wanted::new(path)).collect();
    let nodes_of = nodes_by_path(scene, &wanted);
    let mut found = Found::default();
    for wanted in &wanted {
        let of_path = nodes_of.get(wanted.path).map_or(&[][..], Vec::as_slice);
        let chosen = match wanted.number {
            None => of_path,
            Some(number) => number.checked_sub(1).and_then(|i| of_path.get(i..=i)).unwrap_or_default(),
        };
        found.missing += usize::from(chosen.is_empty());
        found.nodes.extend(chosen);
    }
    found.nodes.sort_unstable();
    found.nodes.dedup();
    found
}

/// The paths of nodes, each of which [`find_nodes`] finds again.
pub fn node_paths(scene: &Scene, nodes: &[u32]) -> Vec<String> {
    let paths: Vec<String> = nodes.iter().map(|&node| scene.node_path(node)).collect();
    let wanted: Vec<Wanted> = paths.iter().map(|path| Wanted::new(path)).collect();
    let nodes_of = nodes_by_path(scene, &wanted);
    let numbered = nodes.iter().zip(&paths).map(|(node, path)| {
        let of_path = nodes_of.get(path.as_str()).map_or(&[][..], Vec::as_slice);
        match of_path.binary_search(node) {
            Ok(before) if of_path.len() > 1 => format!("{path}\\#{}", before + 1),
            _ => path.clone(),
        }
    });
    numbered.collect()
}

/// A path taken apart.
struct Wanted<'a> {
    /// Without the number.
    path: &'a str,
    /// Which of the nodes with this path, from 1; all of them without.
    number: Option<usize>,
    /// Ends of the paths of its ancestors, in bytes.
    ancestors: Vec<usize>,
}

impl<'a> Wanted<'a> {
    fn new(text: &'a str) -> Self {
        let mut wanted = Wanted { path: text, number: None, ancestors: Vec::new() };
        let mut characters = text.char_indices();
        while let Some((at, character)) = characters.next() {
            match character {
                '/' if at > 0 => wanted.ancestors.push(at),
                '\\' => {
                    if let Some((hash, '#')) = characters.next() {
                        // What is no number leads nowhere, as 0 does.
                        wanted.number = Some(text.get(hash + 1..).and_then(|n| n.parse().ok()).unwrap_or(0));
                        wanted.path = text.get(..at).unwrap_or_default();
                        break;
                    }
                }
                _ => {}
            }
        }
        wanted
    }
}

/// The nodes of each wanted path, rising. Goes down the tree only where a wanted path does.
fn nodes_by_path<'a>(scene: &Scene, wanted: &[Wanted<'a>]) -> HashMap<&'a str, Vec<u32>> {
    let mut nodes_of: HashMap<&str, Vec<u32>> = wanted.iter().map(|w| (w.path, Vec::new())).collect();
    let ancestors = wanted.iter().flat_map(|w| w.ancestors.iter().filter_map(|&end| w.path.get(..end)));
    let ancestors: HashSet<&str> = ancestors.collect();
    let mut open: Vec<(u32, String)> = scene.roots().map(|root| (root, String::new())).collect();
    while let Some((node, mut path)) = open.pop() {
        let Some(record) = scene.nodes().get(node as usize) else { continue };
        path.push('/');
        path.push_str(&path_segment(scene.name(record.name)));
        if let Some(nodes) = nodes_of.get_mut(path.as_str()) {
            nodes.push(node);
        }
        if ancestors.contains(path.as_str()) {
            open.extend(scene.children(node).map(|child| (child, path.clone())));
        }
    }
    nodes_of.values_mut().for_each(|nodes| nodes.sort_unstable());
    nodes_of
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Colour, Mesh, Model, Node, Object, Part};
    use crate::prepare::{BuildSettings, Resolution, build};
    use crate::progress::Silent;
    use crate::report::Findings;

    /// A scene of nodes (name, parent), each of them a triangle.
    fn scene(nodes: &[(&str, Option<u32>)]) -> Scene {
        let positions = vec![glam::DVec3::ZERO, glam::DVec3::X, glam::DVec3::Y];
        let mesh = Mesh { positions, triangles: vec![[0, 1, 2]] };
        let mut model = Model::default();
        model.parts.push(Part { name: String::new(), mesh });
        for (index, (name, parent)) in nodes.iter().enumerate() {
            model.nodes.push(Node { name: (*name).into(), parent: *parent, extras: None });
            let world_from_part = glam::DAffine3::from_translation(glam::DVec3::Z * index as f64);
            let colour = Colour::default();
            model.objects.push(Object { node: index as u32, part: 0, world_from_part, colour });
        }
        let file = tempfile::tempdir().unwrap();
        let path = file.path().join("scene.vxs");
        let settings = BuildSettings { resolution: Resolution::Log2(7), ..BuildSettings::default() };
        build(model, Vec::new(), Findings::default(), &settings, &path, &Silent).unwrap();
        Scene::open(&path).unwrap()
    }

    #[test]
    fn nodes_are_found_again_in_a_rebuilt_scene() {
        let before = scene(&[
            ("unit", None),
            ("pump", Some(0)),
            ("bolt", Some(1)),
            ("bolt", Some(1)),
            (r"a/b\#1", Some(0)),
            ("unit", None),
            ("pump", Some(5)),
            ("bolt", Some(6)),
            ("é", Some(5)),
        ]);
        let all: Vec<u32> = (0..9).collect();
        let paths = node_paths(&before, &all);
        let expected = [
            r"/unit\#1",
            r"/unit/pump\#1",
            r"/unit/pump/bolt\#1",
            r"/unit/pump/bolt\#2",
            r"/unit/a\/b\\#1",
            r"/unit\#2",
            r"/unit/pump\#2",
            r"/unit/pump/bolt\#3",
            "/unit/é",
        ];
        assert_eq!(paths, expected);
        for (node, path) in paths.iter().enumerate() {
            let found = find_nodes(&before, std::slice::from_ref(path));
            assert_eq!(found, Found { nodes: vec![node as u32], missing: 0 }, "{path}");
        }
        // Other numbers, one bolt less, and no é.
        let after = scene(&[
            ("new", None),
            ("unit", None),
            ("pump", Some(1)),
            ("bolt", Some(2)),
            (r"a/b\#1", Some(1)),
            ("unit", None),
            ("pump", Some(5)),
            ("bolt", Some(6)),
        ]);
        assert_eq!(find_nodes(&after, &paths), Found { nodes: (1..8).collect(), missing: 2 });
    }

    #[test]
    fn a_path_without_number_means_all_and_nonsense_leads_nowhere() {
        let scene = scene(&[("unit", None), ("bolt", Some(0)), ("bolt", Some(0)), ("nut", Some(0))]);
        let find = |path: &str| find_nodes(&scene, &[path.to_owned()]);
        assert_eq!(find("/unit/bolt"), Found { nodes: vec![1, 2], missing: 0 });
        assert_eq!(find(r"/unit/nut\#1"), Found { nodes: vec![3], missing: 0 });
        let nonsense = ["", "/", "unit", "/unit/", "/unit/bolt/", r"/unit/bolt\#0", r"/unit/bolt\#3"];
        for path in nonsense.iter().chain(&[r"/unit/bolt\#", r"/unit/bolt\#x", r"/unit/bolt\", r"\#1"]) {
            assert_eq!(find(path), Found { nodes: vec![], missing: 1 }, "{path}");
        }
    }
}
