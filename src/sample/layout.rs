//! Composes areas: a rack through the middle, equipment on both sides, roads around; and the plant out of areas.

use glam::{DAffine3, DVec3};
use oorandom::Rand64;

use super::building;
use super::machines;
use super::names::{self, ASPHALT, PAVING, Tags};
use super::plan::Plan;
use super::rack::{self, BAY_M, RACK_Z, Rack};
use super::shapes::{Knot, Shape, Solid, along, at, block, cylinder};
use super::site::Site;
use super::steel;
use super::vessels;

/// Bays of the longest rack: an area of 66 m by 36 m.
const MAX_BAYS: u32 = 10;
/// Size of an area along Z.
const DEPTH_M: f64 = 36.0;
/// Width of the road beside an area.
const ROAD_M: f64 = 8.0;
/// From the area's border to the first frame of its rack.
const MARGIN_M: f64 = 3.0;
/// Objects of a full area: some 4,600 and a part of its 4,500 bolts.
const AREA_OBJECTS: u64 = 6_600;

/// At most this many percent of an area's objects are other than bolts.
const FIXED_PERCENT: u64 = 85;

/// How a plant is divided.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    pub areas: u64,
    bays: u32,
    columns: u64,
    seed: u64,
}

impl Layout {
    /// The fewest areas that can hold `objects`, with the longest racks that leave room for bolts.
    pub fn new(objects: u64, seed: u64) -> Self {
        let areas = objects.div_ceil(AREA_OBJECTS).max(1);
        let columns = near_square_columns(areas);
        let mut layout = Layout { areas, bays: MAX_BAYS, columns, seed };
        let share = objects.div_ceil(areas);
        for bays in (1..=MAX_BAYS).rev() {
            layout.bays = bays;
            if layout.plan(0).fixed_objects() * 100 <= share * FIXED_PERCENT {
                break;
            }
        }
        layout
    }

    /// Length of an area along X.
    pub fn length(&self) -> f64 {
        BAY_M * f64::from(self.bays) + 2.0 * MARGIN_M
    }

    /// Row and column of an area on the grid.
    pub fn cell(&self, area: u64) -> (u64, u64) {
        (area / self.columns, area % self.columns)
    }

    /// Where an area stands.
    pub fn world_from_area(&self, area: u64) -> DAffine3 {
        let (row, column) = self.cell(area);
        at(column as f64 * (self.length() + ROAD_M), 0.0, row as f64 * (DEPTH_M + ROAD_M))
    }

    /// The plan of one area: the same for the same seed, whatever was planned before.
    pub fn plan(&self, area: u64) -> Plan {
        let mut plan = Plan::new(Rand64::new(u128::from(self.seed) << 64 | u128::from(area)));
        let mut tags = Tags::new(area);
        plan.group(tags.area(), |plan| fill_area(plan, &mut tags, area, self.bays, self.length()));
        plan
    }
}

/// Columns of a grid of areas that is about as long as it is deep.
fn near_square_columns(areas: u64) -> u64 {
    (1..).find(|columns| columns * columns * 3 >= areas * 2).unwrap_or(1)
}

/// What stands beside the rack.
#[derive(Clone, Copy)]
enum Module {
    Pumps,
    Column,
    Drum,
    Exchangers,
    Tank,
    Building,
    Stairs,
    ControlValves,
    /// A steel table with a drum on it and exchangers under it.
    Deck,
}

impl Module {
    /// Along the rack.
    fn width(self) -> f64 {
        match self {
            Module::Pumps => 8.5,
            Module::Column => 6.5,
            Module::Drum | Module::Exchangers => 8.5,
            Module::Deck => 9.5,
            Module::Tank => 10.5,
            Module::Building => 13.5,
            Module::Stairs => 6.0,
            Module::ControlValves => 6.5,
        }
    }
}

/// In the order in which they stand, from the area's low X on; repeated when the area is longer.
const NEAR_SIDE: [Module; 8] = [
    Module::Deck,
    Module::Column,
    Module::Stairs,
    Module::Pumps,
    Module::Drum,
    Module::ControlValves,
    Module::Exchangers,
    Module::Tank,
];
const FAR_SIDE: [Module; 8] = [
    Module::Building,
    Module::Column,
    Module::Exchangers,
    Module::Pumps,
    Module::Deck,
    Module::Tank,
    Module::Drum,
    Module::ControlValves,
];

fn fill_area(plan: &mut Plan, tags: &mut Tags, area: u64, bays: u32, length: f64) {
    ground(plan, length);
    let rack = {
        let mut rack = None;
        let unit = tags.unit("Pipe rack");
        plan.group(unit, |plan| {
            rack = Some(rack::rack(plan, tags, MARGIN_M, bays));
            for bay in (1..bays).filter(|bay| bay % 4 != 3) {
                machines::air_cooler(plan, tags, MARGIN_M + BAY_M * f64::from(bay), BAY_M);
            }
        });
        rack.unwrap_or(Rack { lanes: Vec::new() })
    };
    // The first area is as listed; the others begin elsewhere in the lists.
    let shift = area as usize * 3;
    let unit = tags.unit("Separation");
    plan.group(unit, |plan| side(plan, tags, &rack, &NEAR_SIDE, shift, length, 1.0));
    let unit = tags.unit("Heat exchange and utilities");
    plan.group(unit, |plan| side(plan, tags, &rack, &FAR_SIDE, shift, length, -1.0));
    let unit = tags.unit("Site");
    plan.group(unit, |plan| {
        for pole in 0..=(length / 24.0) as u32 {
            let x = 1.5 + 24.0 * f64::from(pole);
            for z in [1.0, DEPTH_M - 1.0] {
                steel::lighting_pole(plan, tags.tag("LP"), x, z);
            }
        }
    });
}

/// Paving and the roads on two sides.
fn ground(plan: &mut Plan, length: f64) {
    plan.group("Ground", |plan| {
        let paving = block(length, 0.3, DEPTH_M, at(length / 2.0, -0.3, DEPTH_M / 2.0));
        plan.put_new("Paving", paving, DAffine3::IDENTITY, PAVING);
        let across =
            block(ROAD_M, 0.2, DEPTH_M + ROAD_M, at(length + ROAD_M / 2.0, -0.28, (DEPTH_M + ROAD_M) / 2.0));
        plan.put_new("Road 1", across, DAffine3::IDENTITY, ASPHALT);
        let along = block(length, 0.2, ROAD_M, at(length / 2.0, -0.28, DEPTH_M + ROAD_M / 2.0));
        plan.put_new("Road 2", along, DAffine3::IDENTITY, ASPHALT);
    });
}

/// Fills one side of the rack with modules, one beside the other.
fn side(
    plan: &mut Plan,
    tags: &mut Tags,
    rack: &Rack,
    modules: &[Module],
    shift: usize,
    length: f64,
    toward: f64,
) {
    let mut x = 0.8;
    let mut left = modules.len();
    for &module in modules.iter().cycle().skip(shift % modules.len()) {
        let width = module.width();
        if x + width > length - 0.5 {
            left -= 1;
            if left == 0 {
                return;
            }
            continue;
        }
        left = modules.len();
        let z = if toward > 0.0 { RACK_Z[0] - 7.2 } else { RACK_Z[1] + 7.2 };
        let site = Site { centre: DVec3::new(x + width / 2.0, 0.0, z), toward, rack };
        build(plan, tags, &site, module);
        x += width;
    }
}

fn build(plan: &mut Plan, tags: &mut Tags, site: &Site, module: Module) {
    let what = |plan: &mut Plan, names: &[&'static str]| plan.pick(names);
    match module {
        Module::Pumps => {
            let name = what(plan, &["Feed pump", "Reflux pump", "Product pump", "Charge pump"]);
            let near = Site { centre: site.at(0.0, 0.0, 3.9), ..*site };
            machines::pumps(plan, tags, &near, 3, name);
            let far = Site { centre: site.at(0.0, 0.0, -3.4), ..*site };
            vessels::drum(plan, tags, &far, "Suction drum");
        }
        Module::Column => {
            let name = what(plan, &["Stripper", "Absorber", "Depropanizer", "Splitter"]);
            vessels::column(plan, tags, site, name);
        }
        Module::Drum => {
            let name = what(plan, &["Reflux drum", "Separator", "Knock-out drum", "Flash drum"]);
            vessels::drum(plan, tags, site, name);
        }
        Module::Exchangers => {
            let name = what(plan, &["Feed preheater", "Reboiler", "Condenser", "Trim cooler"]);
            for z in [1.9, -2.9] {
                let pair = Site { centre: site.at(0.0, 0.0, z), ..*site };
                vessels::exchangers(plan, tags, &pair, name);
            }
            let valves = Site { centre: site.at(0.0, 0.0, 5.2), ..*site };
            machines::control_station(plan, tags, &valves);
        }
        Module::Deck => {
            let floor = 4.8;
            let name = what(plan, &["Reflux accumulator", "Overhead receiver", "Degasser"]);
            steel::deck(plan, tags.tag("S"), site.at(0.0, 0.0, -0.6), [8.4, 7.6], floor, -site.toward);
            let above = Site { centre: site.at(0.0, floor, -0.6), ..*site };
            vessels::drum(plan, tags, &above, name);
            let name = what(plan, &["Overhead condenser", "Feed/effluent exchanger"]);
            let below = Site { centre: site.at(0.0, 0.0, -1.6), ..*site };
            vessels::exchangers(plan, tags, &below, name);
            let pumps = Site { centre: site.at(0.0, 0.0, 4.9), ..*site };
            machines::pumps(plan, tags, &pumps, 2, "Reflux pump");
        }
        Module::Tank => vessels::tank(plan, tags, site, "Day tank"),
        Module::Building => building::control_building(plan, tags, site),
        Module::Stairs => machines::stair_tower(plan, tags, site),
        Module::ControlValves => {
            for z in [4.6, 2.4, 0.2, -2.0] {
                let near = Site { centre: site.at(0.0, 0.0, z), ..*site };
                machines::control_station(plan, tags, &near);
            }
        }
    }
    if matches!(module, Module::Column | Module::Stairs) {
        hydrant(plan, tags, site);
    }
}

/// A fire hydrant towards the road.
fn hydrant(plan: &mut Plan, tags: &mut Tags, site: &Site) {
    let part = plan.shared("HYDRANT DN100", || {
        let profile = vec![
            Knot::To(0.0, 0.0),
            Knot::To(0.16, 0.0),
            Knot::To(0.16, 0.03),
            Knot::To(0.09, 0.03),
            Knot::To(0.09, 0.85),
            Knot::To(0.12, 0.85),
            Knot::To(0.12, 0.95),
            Knot::Closing(0.0, 1.05),
        ];
        let outlet = cylinder(0.05, -0.2, 0.4, along(DVec3::new(0.0, 0.6, 0.0), DVec3::X));
        Solid::from([Shape::Lathe { profile, frame: DAffine3::IDENTITY }, outlet])
    });
    let place = DAffine3::from_translation(site.at(-2.4, 0.0, -6.4));
    plan.put_as(tags.tag("HY"), part, place, names::FIRE_WATER.colour);
}
