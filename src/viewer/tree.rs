//! The rows of the assembly tree that are to be seen: those of opened nodes, or of what a search has found.
//!
//! Rows are a plain list of nodes, made anew when something is opened: two milliseconds for 200,000 nodes. A window draws those that
//! it has room for.

use std::collections::HashSet;

use crate::scene::Scene;

/// A row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Row {
    /// Of which node.
    pub node: u32,
    /// Ancestors.
    pub depth: u32,
    /// Has it children?
    pub has_children: bool,
    /// Are they rows too?
    pub is_open: bool,
    /// Was it searched for? (Not only on the way to something that was.)
    pub is_found: bool,
}

/// Which nodes are open, and the rows that follow.
#[derive(Clone, Debug, Default)]
pub struct Tree {
    open: HashSet<u32>,
    /// What a search has found, rising; `None` without a search.
    found: Option<Vec<u32>>,
    /// On the way to something that was found, closed by hand.
    shut: HashSet<u32>,
    rows: Vec<Row>,
}

impl Tree {
    /// Of a scene, with its topmost nodes open if they are few.
    pub fn new(scene: &Scene) -> Self {
        let mut tree = Tree::default();
        let roots: Vec<u32> = scene.roots().take(2).collect();
        if let [only] = roots[..] {
            tree.open.insert(only);
        }
        tree.list(scene);
        tree
    }

    /// What is to be seen, from the top.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Opens a node, or closes it.
    pub fn set_open(&mut self, scene: &Scene, node: u32, is_open: bool) {
        if is_open {
            self.open.insert(node);
            self.shut.remove(&node);
        } else {
            self.open.remove(&node);
            self.shut.insert(node);
        }
        self.list(scene);
    }

    /// Opens all above a node, forgets a search that hides it, and tells its row.
    pub fn reveal(&mut self, scene: &Scene, node: u32) -> Option<usize> {
        let parent = |&node: &u32| {
            let parent = scene.nodes()[node as usize].parent;
            ((parent as usize) < scene.nodes().len()).then_some(parent)
        };
        let above: Vec<u32> = std::iter::successors(parent(&node), parent).collect();
        above.iter().for_each(|node| {
            self.shut.remove(node);
        });
        self.open.extend(above);
        self.list(scene);
        let found = self.row_of(node);
        if found.is_none() {
            self.found = None;
            self.list(scene);
        }
        found.or_else(|| self.row_of(node))
    }

    /// Where a node's row is.
    pub fn row_of(&self, node: u32) -> Option<usize> {
        // Rows are in pre-order, as nodes are numbered.
        self.rows.binary_search_by_key(&node, |row| row.node).ok()
    }

    /// Shows what was found and the way to it, or with `None` the tree again. `found` rises.
    pub fn set_found(&mut self, scene: &Scene, found: Option<Vec<u32>>) {
        self.found = found;
        self.shut.clear();
        self.list(scene);
    }

    /// What a search has found.
    pub fn found(&self) -> Option<&[u32]> {
        self.found.as_deref()
    }

    fn list(&mut self, scene: &Scene) {
        self.rows.clear();
        let nodes = scene.nodes();
        // Ancestors of the node at hand: end of the subtree, are all children rows?
        let mut above: Vec<(u32, bool)> = Vec::new();
        let mut node = 0;
        while let Some(record) = nodes.get(node as usize) {
            while above.last().is_some_and(|(end, _)| *end <= node) {
                above.pop();
            }
            let all_listed = above.last().is_none_or(|(_, all)| *all);
            let (is_found, has_found) = self.finds(node, record.subtree_end);
            let is_opened = self.open.contains(&node);
            let (is_listed, is_open, all_inside) = match &self.found {
                None => (true, is_opened, true),
                // What was found, and the way to it; and of what was opened by hand there, everything.
                Some(_) => {
                    let is_inside = all_listed && !above.is_empty();
                    let is_open = if has_found { !self.shut.contains(&node) } else { is_opened };
                    (is_found || has_found || is_inside, is_open, is_opened && (is_found || is_inside))
                }
            };
            let has_children = record.subtree_end > node + 1;
            let is_open = is_open && has_children;
            if is_listed {
                let depth = above.len() as u32;
                self.rows.push(Row { node, depth, has_children, is_open, is_found });
            }
            if is_listed && is_open {
                above.push((record.subtree_end, all_inside));
                node += 1;
            } else {
                node = record.subtree_end;
            }
        }
    }

    /// Was a node found, and is there anything in it that was?
    fn finds(&self, node: u32, subtree_end: u32) -> (bool, bool) {
        let Some(found) = &self.found else { return (false, false) };
        let at = found.partition_point(|&one| one < node);
        let is_found = found.get(at) == Some(&node);
        let inside = found.get(at + usize::from(is_found));
        (is_found, inside.is_some_and(|&one| one < subtree_end))
    }
}
