//! The DAG as nodes and links, before it is packed into any format: taken from ours, split into octree nodes, merged
//! with mirror images.

use std::cmp::Reverse;
use std::collections::HashMap;
use std::hash::Hash;

use voxsight::scene::Scene;

/// A child: what it is a mirror image of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Link {
    /// Index in the height below; of a leaf mask at height 1.
    pub to: u32,
    /// Axes along which it is mirrored: x, y, z = 1, 2, 4.
    pub flip: u8,
}

/// A node: its occupied slots and a link for each of them, in the order of the slots.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Node {
    pub mask: u64,
    pub links: Vec<Link>,
}

/// Distinct leaf masks and distinct nodes, by height.
pub struct Tree {
    /// log2 of the child slots a side: 1 or 2. Slots count as x + y * side + z * side^2, voxels of a leaf too.
    pub width: u32,
    /// log2 of the voxels a side of a leaf mask: 1 or 2.
    pub leaf: u32,
    pub leaves: Vec<u64>,
    /// `heights[h - 1]`: nodes of height h; their children are in `heights[h - 2]`, or leaves.
    pub heights: Vec<Vec<Node>>,
    /// Of the greatest height.
    pub root: Link,
}

/// The positions of the set bits, rising.
fn set_bits(mask: u64) -> impl Iterator<Item = u32> {
    (0..64).filter(move |&bit| mask >> bit & 1 == 1)
}

/// What to XOR a slot with to mirror it along the axes of `flip`, where a side has 2^WIDTH slots.
#[inline(always)]
pub fn mirror_slot<const WIDTH: u32>(flip: u32) -> u32 {
    if WIDTH == 1 { flip } else { (flip & 1) * 3 + (flip & 2) * 6 + (flip & 4) * 12 }
}

/// Mirrors a mask by moving every bit.
pub fn mirror(mask: u64, slot_flip: u32) -> u64 {
    set_bits(mask).fold(0, |mirrored, bit| mirrored | 1 << (bit ^ slot_flip))
}

/// Distinct items, numbered in the order in which they came.
struct Distinct<T> {
    items: Vec<T>,
    index_of: HashMap<T, u32>,
}

impl<T: Clone + Eq + Hash> Distinct<T> {
    fn new() -> Self {
        Distinct { items: Vec::new(), index_of: HashMap::new() }
    }

    fn intern(&mut self, item: T) -> u32 {
        let next = self.items.len() as u32;
        let index = *self.index_of.entry(item.clone()).or_insert(next);
        if index == next {
            self.items.push(item);
        }
        index
    }
}

impl Tree {
    /// The scene's own DAG: 64 slots a node, 4^3 leaves.
    pub fn of_scene(scene: &Scene) -> Self {
        let words = scene.container().dag_nodes();
        let shape = scene.meta().dag_shape();
        let mut index_of_word = vec![u32::MAX; words.len()];
        let mut heights: Vec<Vec<Node>> = Vec::new();
        let mut at = 0;
        for &end in &shape.height_ends {
            let mut nodes = Vec::new();
            while at < end as usize {
                let mask = voxsight_voxel::dag::node::mask_at(words, at as u32);
                let children = &words[at + 2..at + 2 + mask.count_ones() as usize];
                let index =
                    |&word: &u32| if heights.is_empty() { word } else { index_of_word[word as usize] };
                let links = children.iter().map(|word| Link { to: index(word), flip: 0 }).collect();
                index_of_word[at] = nodes.len() as u32;
                nodes.push(Node { mask, links });
                at += 2 + children.len();
            }
            heights.push(nodes);
        }
        let root = shape.root.expect("the scene has voxels");
        let root = Link { to: index_of_word[root as usize], flip: 0 };
        Tree { width: 2, leaf: 2, leaves: scene.container().dag_leaves().to_vec(), heights, root }
    }

    /// The same voxels with 8 slots a node, over leaf masks of 4^3 (`leaf` 2) or 2^3 voxels (`leaf` 1).
    pub fn split(&self, leaf: u32) -> Self {
        assert!(self.width == 2 && self.leaf == 2, "only 64-wide nodes are split");
        let mut heights = Vec::new();
        let mut leaves = self.leaves.clone();
        if leaf == 1 {
            let mut octants = Distinct::new();
            let split_leaf = |&mask: &u64| split_mask(mask, |_, below| octants.intern(below));
            heights.push(self.leaves.iter().map(split_leaf).collect());
            leaves = octants.items;
        }
        for nodes in &self.heights {
            let mut lower = Distinct::new();
            let split_node = |node: &Node| {
                split_mask(node.mask, |octant, mask| {
                    let links = set_bits(mask).map(|slot| node.link(wide_slot(octant, slot))).collect();
                    lower.intern(Node { mask, links })
                })
            };
            let upper = nodes.iter().map(split_node).collect();
            heights.push(lower.items);
            heights.push(upper);
        }
        Tree { width: 1, leaf, leaves, heights, root: self.root }
    }

    /// The same voxels with subtrees stored once that are mirror images of each other along x, y, z (Villanueva,
    /// Marton and Gobbetti, "SSVDAGs", 2016).
    pub fn merge_mirrored(&self) -> Self {
        let slot_flip = |width, flip: u8| match width {
            1 => mirror_slot::<1>(flip.into()),
            _ => mirror_slot::<2>(flip.into()),
        };
        let (leaves, mut below) =
            Images::merge(&self.leaves, |&mask, flip| mirror(mask, slot_flip(self.leaf, flip)));
        let mut heights = Vec::new();
        for nodes in &self.heights {
            let relinked: Vec<Node> = nodes
                .iter()
                .map(|node| {
                    let links = node.links.iter().map(|link| below.links[link.to as usize]).collect();
                    Node { mask: node.mask, links }
                })
                .collect();
            let (kept, here) = Images::merge(&relinked, |node, flip| {
                let slot_flip = slot_flip(self.width, flip);
                let mask = mirror(node.mask, slot_flip);
                let links = set_bits(mask).map(|slot| {
                    let Link { to, flip: before } = node.link(slot ^ slot_flip);
                    Link { to, flip: below.least(to, before ^ flip) }
                });
                Node { mask, links: links.collect() }
            });
            heights.push(kept);
            below = here;
        }
        let root = below.links[self.root.to as usize];
        Tree { leaves, heights, root, ..*self }
    }

    /// Links to each item of a height; height 0 are the leaves.
    pub fn uses(&self, height: usize) -> Vec<u32> {
        let items = if height == 0 { self.leaves.len() } else { self.heights[height - 1].len() };
        let mut uses = vec![0; items];
        let nodes = self.heights.get(height).into_iter().flatten();
        nodes.flat_map(|node| &node.links).for_each(|link| uses[link.to as usize] += 1);
        uses
    }

    /// The items of a height, those of most uses first.
    pub fn by_use(&self, height: usize) -> Vec<u32> {
        let uses = self.uses(height);
        let mut order: Vec<u32> = (0..uses.len() as u32).collect();
        order.sort_by_key(|&item| Reverse(uses[item as usize]));
        order
    }

    /// Distinct nodes of all heights, leaves not counted.
    pub fn node_count(&self) -> usize {
        self.heights.iter().map(Vec::len).sum()
    }
}

impl Node {
    /// The link of an occupied slot.
    fn link(&self, slot: u32) -> Link {
        self.links[(self.mask & ((1 << slot) - 1)).count_ones() as usize]
    }
}

/// The slot of 4x4x4 that is `slot` of 2x2x2 within `octant` of 2x2x2.
pub fn wide_slot(octant: u32, slot: u32) -> u32 {
    let spread = |s: u32| s & 1 | (s & 2) << 1 | (s & 4) << 2;
    spread(octant) << 1 | spread(slot)
}

/// A 4x4x4 mask as an octree node over its octants; `octant(number, mask)` gives the child for those that have something.
fn split_mask(mask: u64, mut child: impl FnMut(u32, u64) -> u32) -> Node {
    let mut node = Node { mask: 0, links: Vec::new() };
    for octant in 0..8 {
        let below = octant_of(mask, octant);
        if below != 0 {
            node.mask |= 1 << octant;
            node.links.push(Link { to: child(octant, below), flip: 0 });
        }
    }
    node
}

/// The 2x2x2 mask of an octant of a 4x4x4 mask.
pub fn octant_of(mask: u64, octant: u32) -> u64 {
    (0..8).fold(0, |below, slot| below | (mask >> wide_slot(octant, slot) & 1) << slot)
}

/// What became of the items of one height when only one of each set of mirror images was kept.
struct Images {
    /// What each of the old items is now.
    links: Vec<Link>,
    /// For each kept item, the flips that leave it as it is: bit `flip` of eight.
    symmetries: Vec<u8>,
}

impl Images {
    /// Keeps the least image of each item, given how to mirror one. Returns what was kept.
    fn merge<T: Clone + Eq + Hash + Ord>(old: &[T], mirrored: impl Fn(&T, u8) -> T) -> (Vec<T>, Self) {
        let mut kept = Distinct::new();
        let mut images = Images { links: Vec::new(), symmetries: Vec::new() };
        for item in old {
            let all: [T; 8] = std::array::from_fn(|flip| mirrored(item, flip as u8));
            let least = all.iter().min().expect("eight of them");
            let flips: Vec<u8> = (0..8).filter(|&flip| all[usize::from(flip)] == *least).collect();
            let to = kept.intern(least.clone());
            if to as usize == images.symmetries.len() {
                images.symmetries.push(flips.iter().fold(0, |set, flip| set | 1 << (flip ^ flips[0])));
            }
            // Mirroring undoes itself; of several ways to get there, the first.
            images.links.push(Link { to, flip: flips[0] });
        }
        (kept.items, images)
    }

    /// The least of the flips that make the same image of an item: so that equal images have equal links.
    fn least(&self, item: u32, flip: u8) -> u8 {
        let symmetries = self.symmetries[item as usize];
        let same = (0..8).filter(|same| symmetries >> same & 1 == 1).map(|same| flip ^ same);
        same.min().expect("flip 0 is always among them")
    }
}
