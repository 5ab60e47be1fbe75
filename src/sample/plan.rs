//! An area as a plan: which parts stand where, before anything is meshed. Light enough to make, count and throw away.

use std::collections::BTreeMap;

use glam::DAffine3;
use oorandom::Rand64;

use super::shapes::{Detail, Solid, at, turn};
use crate::model::{Colour, Model, Node, NodeId, Object, Part, PartId};

/// A part of the plan, to be placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PartRef(usize);

/// What the area consists of, in depth-first order.
#[derive(Debug)]
enum Entry {
    Open { name: String, extras: Option<String> },
    Close,
    Place(Placed),
    Bolts(BoltCircle),
}

#[derive(Clone, Debug)]
struct Placed {
    name: String,
    part: PartRef,
    area_from_part: DAffine3,
    colour: Colour,
    extras: Option<String>,
}

/// The bolts of one flanged joint: optional objects, with which an area is filled up to its number of objects.
#[derive(Clone, Debug)]
struct BoltCircle {
    bolt: PartRef,
    name: String,
    /// Origin in the middle of the joint, +Y along the bolts.
    frame: DAffine3,
    radius: f64,
    count: u32,
    colour: Colour,
}

/// The plan of one area, in metres, +Y up, the area's low corner at the origin.
pub(super) struct Plan {
    /// Source of everything random in the area.
    pub rng: Rand64,
    entries: Vec<Entry>,
    parts: Vec<(String, Solid)>,
    shared: BTreeMap<String, PartRef>,
}

impl Plan {
    pub fn new(rng: Rand64) -> Self {
        Plan { rng, entries: Vec::new(), parts: Vec::new(), shared: BTreeMap::new() }
    }

    /// Everything that `fill` adds becomes the content of a node called `name`.
    pub fn group(&mut self, name: impl Into<String>, fill: impl FnOnce(&mut Plan)) {
        self.open(name.into(), None);
        fill(self);
        self.entries.push(Entry::Close);
    }

    /// [`Plan::group`] with properties, a JSON text, on the node.
    pub fn group_with(&mut self, name: impl Into<String>, extras: String, fill: impl FnOnce(&mut Plan)) {
        self.open(name.into(), Some(extras));
        fill(self);
        self.entries.push(Entry::Close);
    }

    fn open(&mut self, name: String, extras: Option<String>) {
        self.entries.push(Entry::Open { name, extras });
    }

    /// The part called `name`, described by `solid` when it is met first.
    pub fn shared(&mut self, name: &str, solid: impl FnOnce() -> Solid) -> PartRef {
        if let Some(&part) = self.shared.get(name) {
            return part;
        }
        let part = self.add_part(name.to_owned(), solid());
        self.shared.insert(name.to_owned(), part);
        part
    }

    fn add_part(&mut self, name: String, solid: Solid) -> PartRef {
        self.parts.push((name, solid));
        PartRef(self.parts.len() - 1)
    }

    /// Places a part under its own name.
    pub fn put(&mut self, part: PartRef, area_from_part: DAffine3, colour: Colour) {
        let name = self.parts[part.0].0.clone();
        self.put_as(name, part, area_from_part, colour);
    }

    /// Places a part as an object called `name`.
    pub fn put_as(
        &mut self,
        name: impl Into<String>,
        part: PartRef,
        area_from_part: DAffine3,
        colour: Colour,
    ) {
        let name = name.into();
        self.entries.push(Entry::Place(Placed { name, part, area_from_part, colour, extras: None }));
    }

    /// Places a part that occurs only here.
    pub fn put_new(
        &mut self,
        name: impl Into<String>,
        solid: impl Into<Solid>,
        area_from_part: DAffine3,
        colour: Colour,
    ) {
        let name = name.into();
        let part = self.add_part(name.clone(), solid.into());
        self.put_as(name, part, area_from_part, colour);
    }

    /// Properties, a JSON text, of the object placed last.
    pub fn describe(&mut self, extras: String) {
        if let Some(Entry::Place(placed)) = self.entries.last_mut() {
            placed.extras = Some(extras);
        }
    }

    /// Offers the bolts of a joint: +Y of `frame` along the bolts, the joint's middle at its origin.
    pub fn bolts(&mut self, bolt: PartRef, frame: DAffine3, radius: f64, count: u32, colour: Colour) {
        let name = self.parts[bolt.0].0.clone();
        self.entries.push(Entry::Bolts(BoltCircle { bolt, name, frame, radius, count, colour }));
    }

    /// A number in `[low, high)`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.rng.rand_float()
    }

    /// True with the given probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.rng.rand_float() < probability
    }

    /// One of `choices`, which must not be empty.
    pub fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.rng.rand_range(0..choices.len() as u64) as usize]
    }

    /// Objects without bolts.
    pub fn fixed_objects(&self) -> u64 {
        self.entries.iter().filter(|entry| matches!(entry, Entry::Place(_))).count() as u64
    }

    /// Bolts on offer.
    pub fn bolt_objects(&self) -> u64 {
        let bolts =
            |entry: &Entry| if let Entry::Bolts(circle) = entry { u64::from(circle.count) } else { 0 };
        self.entries.iter().map(bolts).sum()
    }

    /// Keeps the first `objects` objects; if there are fewer, the rest is filled with bolts, evenly over all joints.
    pub fn settle(self, objects: u64) -> SettledPlan {
        let wanted = objects.saturating_sub(self.fixed_objects());
        let offered = self.bolt_objects().max(1);
        let (mut placed, mut passed, mut bolts) = (0, 0, 0);
        let mut entries = self.entries;
        entries.retain(|entry| match entry {
            Entry::Place(_) => {
                placed += 1;
                placed <= objects
            }
            Entry::Bolts(circle) => {
                let count = u64::from(circle.count);
                passed += count;
                // After each joint the bolts kept are wanted / offered of those passed, to the nearest joint.
                let keep =
                    wanted > 0 && 2 * (bolts + count) * offered <= 2 * passed * wanted + count * offered;
                bolts += if keep { count } else { 0 };
                keep
            }
            Entry::Open { .. } | Entry::Close => true,
        });
        SettledPlan { entries, parts: self.parts }
    }
}

/// A plan with its final set of objects.
pub(super) struct SettledPlan {
    entries: Vec<Entry>,
    parts: Vec<(String, Solid)>,
}

impl SettledPlan {
    /// How often each part is placed.
    fn placements(&self) -> Vec<u64> {
        let mut placements = vec![0; self.parts.len()];
        for entry in &self.entries {
            match entry {
                Entry::Place(placed) => placements[placed.part.0] += 1,
                Entry::Bolts(circle) => placements[circle.bolt.0] += u64::from(circle.count),
                Entry::Open { .. } | Entry::Close => {}
            }
        }
        placements
    }

    /// Objects of the area.
    pub fn objects(&self) -> u64 {
        self.placements().iter().sum()
    }

    /// Triangles of the area with instancing expanded, without meshing anything.
    pub fn triangles(&self, fineness: f64) -> u64 {
        self.count(&self.placements(), fineness)
    }

    /// Triangles of the area, each part once.
    pub fn unique_triangles(&self, fineness: f64) -> u64 {
        let once: Vec<u64> = self.placements().iter().map(|&times| times.min(1)).collect();
        self.count(&once, fineness)
    }

    fn count(&self, placements: &[u64], fineness: f64) -> u64 {
        let used = self.parts.iter().zip(placements).enumerate().filter(|(_, (_, times))| **times > 0);
        used.map(|(at, ((_, solid), times))| times * solid.triangles(detail(fineness, at))).sum()
    }

    /// The fineness at which the area has `triangles` placed triangles, as nearly as can be.
    pub fn fineness_for(&self, triangles: u64) -> f64 {
        let placements = self.placements();
        let (mut low, mut high) = FINENESS_RANGE;
        // The count never falls while fineness grows, so bisection finds the step over `triangles`.
        for _ in 0..24 {
            let middle = libm::sqrt(low * high);
            if self.count(&placements, middle) <= triangles {
                low = middle;
            } else {
                high = middle;
            }
        }
        let miss = |fineness: f64| self.count(&placements, fineness).abs_diff(triangles);
        if miss(high) < miss(low) { high } else { low }
    }

    /// Meshes the area and places it: `world_from_area`.
    pub fn model(&self, fineness: f64, world_from_area: DAffine3) -> Model {
        let mut assembly = Assembly::default();
        let mut part_ids: Vec<Option<PartId>> = vec![None; self.parts.len()];
        for entry in &self.entries {
            let mut part_id = |part: PartRef, assembly: &mut Assembly| {
                *part_ids[part.0].get_or_insert_with(|| {
                    let (name, solid) = &self.parts[part.0];
                    let mesh = solid.mesh(detail(fineness, part.0));
                    assembly.model.parts.push(Part { name: name.clone(), mesh });
                    assembly.model.parts.len() as PartId - 1
                })
            };
            match entry {
                Entry::Open { name, extras } => assembly.open(name, extras.as_ref()),
                Entry::Close => assembly.close(),
                Entry::Place(placed) => {
                    let part = part_id(placed.part, &mut assembly);
                    let world_from_part = world_from_area * placed.area_from_part;
                    assembly.place(
                        &placed.name,
                        placed.extras.as_ref(),
                        part,
                        world_from_part,
                        placed.colour,
                    );
                }
                Entry::Bolts(circle) => {
                    let part = part_id(circle.bolt, &mut assembly);
                    for bolt in 0..circle.count {
                        // Bolt holes straddle the centre lines.
                        let round = turn(2 * bolt + 1, 2 * circle.count) * circle.radius;
                        let world_from_part = world_from_area * circle.frame * at(round.x, 0.0, round.y);
                        assembly.place(&circle.name, None, part, world_from_part, circle.colour);
                    }
                }
            }
        }
        assembly.model
    }
}

/// Fineness is sought between these.
const FINENESS_RANGE: (f64, f64) = (1.0, 20_000.0);

/// Fractional part of the golden ratio: its multiples fill `[0, 1)` evenly.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

fn detail(fineness: f64, part: usize) -> Detail {
    let spread = part as f64 * GOLDEN;
    Detail { fineness, phase: spread - spread.floor() }
}

/// Builds the model's tree; a group becomes a node only when something is placed in it.
#[derive(Default)]
struct Assembly {
    model: Model,
    open: Vec<OpenGroup>,
}

struct OpenGroup {
    name: String,
    extras: Option<String>,
    node: Option<NodeId>,
}

impl Assembly {
    fn open(&mut self, name: &str, extras: Option<&String>) {
        self.open.push(OpenGroup { name: name.to_owned(), extras: extras.cloned(), node: None });
    }

    fn close(&mut self) {
        self.open.pop();
    }

    fn place(
        &mut self,
        name: &str,
        extras: Option<&String>,
        part: PartId,
        world_from_part: DAffine3,
        colour: Colour,
    ) {
        let nodes = &mut self.model.nodes;
        let mut parent = None;
        for group in &mut self.open {
            parent = Some(*group.node.get_or_insert_with(|| {
                nodes.push(Node { name: group.name.clone(), parent, extras: group.extras.take() });
                nodes.len() as NodeId - 1
            }));
        }
        nodes.push(Node { name: name.to_owned(), parent, extras: extras.cloned() });
        let node = nodes.len() as NodeId - 1;
        self.model.objects.push(Object { node, part, world_from_part, colour });
    }
}
