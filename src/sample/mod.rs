//! A process plant of any size, made from a seed: for the demo, for tests, for trying how things scale.
//!
//! Metres, right-handed, +Y up (as glTF wants), ground at Y = 0, the first area's low corner at the origin. The tree
//! is area / unit / equipment or line / part. Bolts, flanges, valves, steel of standard length and gratings are
//! shared parts; pipe spools, shells and walls are parts of their own.
//!
//! # How the size is reached
//!
//! The number of objects decides how many areas there are, how long their racks are, and how many of the flanged
//! joints have their bolts. Triangles per object then decide how finely each area's curves are divided (`shapes`).
//! Both targets are met within 10 percent between 60 and 3,000 triangles per object, and more than 10,000 are never
//! made; a plant of a few dozen objects
//! is one unfinished area. The same settings give the same bits on any machine: the only functions used besides
//! `+ - * /` and square roots are libm's.

mod access;
mod building;
mod copies;
mod fittings;
mod flanges;
mod frames;
mod instruments;
mod layout;
mod machines;
mod names;
mod piping;
mod plan;
mod rack;
mod sections;
mod shapes;
mod site;
mod steel;
mod vessels;
mod write;

use glam::DAffine3;

pub use copies::{CopiesSettings, copy_placements, write_copies};
pub use write::{SampleError, WriteSummary, write_plant};

use crate::model::{Model, NodeId, PartId};
use layout::Layout;

/// Beyond this, parts would grow without bound instead of in number.
const MAX_TRIANGLES_PER_OBJECT: u64 = 10_000;

/// What to generate. Zero objects or triangles count as one; there are never more than 10,000 triangles per object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlantSettings {
    /// Objects to place.
    pub objects: u64,
    /// Triangles to place: with instancing expanded.
    pub triangles: u64,
    /// Another seed is another plant.
    pub seed: u64,
}

impl Default for PlantSettings {
    /// The demo's plant.
    fn default() -> Self {
        PlantSettings { objects: 2_000, triangles: 500_000, seed: 1 }
    }
}

/// One area, planned and tuned but not meshed.
struct Area {
    plan: plan::SettledPlan,
    fineness: f64,
    world_from_area: DAffine3,
    /// Row on the grid of areas.
    row: u64,
}

impl Area {
    fn model(&self) -> Model {
        self.plan.model(self.fineness, self.world_from_area)
    }
}

/// Plans the areas one after another. Each gets an equal share of the objects, and triangles in proportion.
fn areas(settings: &PlantSettings) -> impl Iterator<Item = Area> + use<> {
    let objects = settings.objects.max(1);
    let triangles = settings.triangles.clamp(1, objects.saturating_mul(MAX_TRIANGLES_PER_OBJECT));
    let layout = Layout::new(objects, settings.seed);
    // What the areas so far should have had, so that a shortfall is made up for by the next.
    let (mut objects_left, mut triangles_left) = (objects, triangles);
    (0..layout.areas).map(move |index| {
        let remaining = layout.areas - index;
        let plan = layout.plan(index).settle(objects_left.div_ceil(remaining));
        let placed = plan.objects();
        let share = triangles_left as f64 * placed as f64 / objects_left.max(placed) as f64;
        let share = if remaining == 1 { triangles_left } else { share as u64 };
        let fineness = plan.fineness_for(share);
        objects_left = objects_left.saturating_sub(placed);
        triangles_left = triangles_left.saturating_sub(plan.triangles(fineness));
        Area { plan, fineness, world_from_area: layout.world_from_area(index), row: layout.cell(index).0 }
    })
}

/// The plant area by area, each a model of its own, so that any size streams in bounded memory (one area has at most
/// about 6,600 objects). Areas stand in their place in the plant; each has one root node.
pub fn plant_areas(settings: &PlantSettings) -> impl Iterator<Item = Model> + use<> {
    areas(settings).map(|area| area.model())
}

/// The whole plant in memory: about 50 bytes per triangle that is not instanced.
pub fn plant(settings: &PlantSettings) -> Model {
    let mut whole = Model::default();
    for area in plant_areas(settings) {
        append(&mut whole, area);
    }
    whole
}

/// Objects and placed triangles of the plant, without meshing anything.
pub fn plant_size(settings: &PlantSettings) -> (u64, u64) {
    areas(settings).fold((0, 0), |(objects, triangles), area| {
        (objects + area.plan.objects(), triangles + area.plan.triangles(area.fineness))
    })
}

/// Adds the roots, parts and objects of `more` behind those of `model`.
fn append(model: &mut Model, more: Model) {
    let (nodes, parts) = (model.nodes.len() as NodeId, model.parts.len() as PartId);
    model.nodes.extend(more.nodes.into_iter().map(|mut node| {
        node.parent = node.parent.map(|parent| parent + nodes);
        node
    }));
    model.parts.extend(more.parts);
    model.objects.extend(more.objects.into_iter().map(|mut object| {
        object.node += nodes;
        object.part += parts;
        object
    }));
}

/// A view worth looking at, in the plant's metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleCamera {
    /// `inside`, `deck` or `overview`.
    pub name: &'static str,
    /// Where the eye is.
    pub eye: [f64; 3],
    /// What it looks at.
    pub target: [f64; 3],
    /// Up.
    pub up: [f64; 3],
    /// Vertical field of view.
    pub fov_y_deg: f64,
}

/// Three views of the first area: under its rack, looking along it, where nearly everything is hidden by something
/// else; from a deck beside the rack; and from outside.
pub fn cameras(settings: &PlantSettings) -> [SampleCamera; 3] {
    let length = Layout::new(settings.objects.max(1), settings.seed).length();
    let up = [0.0, 1.0, 0.0];
    [
        SampleCamera {
            name: "inside",
            eye: [1.6, 1.9, 15.2],
            target: [length * 0.6, 3.4, 17.0],
            up,
            fov_y_deg: 60.0,
        },
        SampleCamera { name: "deck", eye: [1.0, 7.0, 9.0], target: [9.0, 4.0, 12.0], up, fov_y_deg: 70.0 },
        SampleCamera {
            name: "overview",
            eye: [length + 14.0, 19.0, -17.0],
            target: [length * 0.55, 6.0, 16.0],
            up,
            fov_y_deg: 50.0,
        },
    ]
}
