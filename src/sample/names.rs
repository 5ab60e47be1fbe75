//! What things are called and painted: nominal bores, services, tags, colours.

use serde_json::json;

use super::plan::Plan;
use crate::model::Colour;

/// One nominal pipe size with its class 150 flange (ASME B36.10, B16.5), in metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bore {
    /// Nominal size in inches.
    pub inches: u32,
    /// Nominal size in millimetres.
    pub dn: u32,
    /// Outer radius of the pipe.
    pub radius: f64,
    /// Outer radius of the flange.
    pub flange_radius: f64,
    pub flange_thickness: f64,
    /// Radius of the bolt circle.
    pub bolt_radius: f64,
    pub bolts: u32,
    pub bolt: Bolt,
}

/// A stud bolt with two nuts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bolt {
    /// Thread diameter in millimetres.
    pub size: u32,
    /// Nut's width across flats, in metres.
    pub flats: f64,
}

const M16: Bolt = Bolt { size: 16, flats: 0.024 };
const M20: Bolt = Bolt { size: 20, flats: 0.030 };
const M24: Bolt = Bolt { size: 24, flats: 0.036 };
const M30: Bolt = Bolt { size: 30, flats: 0.046 };

#[rustfmt::skip]
const BORES: [Bore; 9] = [
    Bore { inches: 2, dn: 50, radius: 0.0302, flange_radius: 0.075, flange_thickness: 0.019, bolt_radius: 0.0603, bolts: 4, bolt: M16 },
    Bore { inches: 3, dn: 80, radius: 0.0445, flange_radius: 0.095, flange_thickness: 0.024, bolt_radius: 0.0762, bolts: 4, bolt: M16 },
    Bore { inches: 4, dn: 100, radius: 0.0572, flange_radius: 0.115, flange_thickness: 0.024, bolt_radius: 0.0953, bolts: 8, bolt: M16 },
    Bore { inches: 6, dn: 150, radius: 0.0842, flange_radius: 0.140, flange_thickness: 0.025, bolt_radius: 0.1207, bolts: 8, bolt: M20 },
    Bore { inches: 8, dn: 200, radius: 0.1096, flange_radius: 0.1725, flange_thickness: 0.029, bolt_radius: 0.1492, bolts: 8, bolt: M20 },
    Bore { inches: 10, dn: 250, radius: 0.1366, flange_radius: 0.2025, flange_thickness: 0.030, bolt_radius: 0.1810, bolts: 12, bolt: M24 },
    Bore { inches: 12, dn: 300, radius: 0.1620, flange_radius: 0.2425, flange_thickness: 0.032, bolt_radius: 0.2159, bolts: 12, bolt: M24 },
    Bore { inches: 16, dn: 400, radius: 0.2032, flange_radius: 0.2985, flange_thickness: 0.037, bolt_radius: 0.2699, bolts: 16, bolt: M24 },
    Bore { inches: 20, dn: 500, radius: 0.2540, flange_radius: 0.3495, flange_thickness: 0.043, bolt_radius: 0.3175, bolts: 20, bolt: M30 },
];

/// The bore of that many inches, or the next larger one that is stocked (20 at most).
pub(super) fn bore(inches: u32) -> Bore {
    let [.., largest] = BORES;
    BORES.into_iter().find(|bore| bore.inches >= inches).unwrap_or(largest)
}

/// The next smaller bore, or the smallest.
pub(super) fn bore_below(bore: Bore) -> Bore {
    BORES.into_iter().rev().find(|smaller| smaller.inches < bore.inches).unwrap_or(bore)
}

/// What a line carries: its code in line numbers, and its colour.
#[derive(Clone, Copy, Debug)]
pub(super) struct Service {
    pub code: &'static str,
    pub colour: Colour,
}

pub(super) const fn rgb(r: u8, g: u8, b: u8) -> Colour {
    Colour([r, g, b, 255])
}

/// Most process and steam lines are clad in aluminium; the others are painted by contents (after DIN 2403).
pub(super) const SERVICES: [Service; 9] = [
    Service { code: "PL", colour: ALUMINIUM },
    Service { code: "PG", colour: rgb(178, 182, 184) },
    Service { code: "CWS", colour: rgb(39, 116, 72) },
    Service { code: "CWR", colour: rgb(72, 138, 96) },
    Service { code: "LS", colour: rgb(196, 200, 204) },
    Service { code: "IA", colour: rgb(58, 122, 168) },
    Service { code: "NG", colour: rgb(226, 178, 22) },
    Service { code: "FW", colour: rgb(160, 33, 34) },
    Service { code: "HC", colour: rgb(124, 86, 58) },
];

/// Cooling water supply.
pub(super) const COOLING_WATER: Service = SERVICES[2];
/// Process liquid.
pub(super) const PROCESS: Service = SERVICES[0];
/// Fire water.
pub(super) const FIRE_WATER: Service = SERVICES[7];

pub(super) const ALUMINIUM: Colour = rgb(200, 204, 208);
pub(super) const GALVANIZED: Colour = rgb(152, 160, 164);
pub(super) const BOLT_STEEL: Colour = rgb(112, 116, 120);
/// Painted structural steel, RAL 7046 or so.
pub(super) const STRUCTURE: Colour = rgb(116, 124, 132);
pub(super) const CONCRETE: Colour = rgb(190, 186, 178);
pub(super) const PAVING: Colour = rgb(166, 164, 158);
pub(super) const ASPHALT: Colour = rgb(92, 93, 96);
/// RAL 1023, traffic yellow.
pub(super) const SAFETY_YELLOW: Colour = rgb(240, 188, 0);
/// RAL 5015, sky blue: motors.
pub(super) const MOTOR_BLUE: Colour = rgb(36, 104, 160);
/// RAL 6011, reseda green: pumps.
pub(super) const PUMP_GREEN: Colour = rgb(96, 126, 88);
pub(super) const VALVE_BODY: Colour = rgb(84, 92, 102);
/// RAL 3020, traffic red: handwheels.
pub(super) const HANDWHEEL_RED: Colour = rgb(190, 32, 24);
pub(super) const VESSEL_WHITE: Colour = rgb(222, 222, 214);
pub(super) const GASKET: Colour = rgb(46, 46, 48);
pub(super) const INSTRUMENT: Colour = rgb(64, 110, 176);
pub(super) const GLASS: Colour = Colour([150, 190, 205, 90]);
pub(super) const BLACK: Colour = rgb(52, 54, 58);
pub(super) const WALL: Colour = rgb(214, 206, 190);
pub(super) const CABINET: Colour = rgb(196, 200, 198);
pub(super) const WOOD: Colour = rgb(168, 128, 84);

/// Numbers of one area: 100 for area 0, 200 for area 1; its units are 110, 120, and so on.
#[derive(Clone, Debug)]
pub(super) struct Tags {
    area: u64,
    unit: u64,
    next: u64,
    next_line: u64,
}

impl Tags {
    pub fn new(area_index: u64) -> Self {
        let area = 100 * (area_index + 1);
        Tags { area, unit: area, next: 0, next_line: 0 }
    }

    /// Name of the area's node.
    pub fn area(&self) -> String {
        format!("AREA-{}", self.area)
    }

    /// Starts the next unit; its name ends in what it does.
    pub fn unit(&mut self, what: &str) -> String {
        self.unit += 10;
        self.next = 0;
        format!("U-{} {what}", self.unit)
    }

    /// The next equipment or instrument tag of the unit, `P-11001`.
    pub fn tag(&mut self, letters: &str) -> String {
        self.next += 1;
        format!("{letters}-{}{:02}", self.unit, self.next)
    }

    /// The next line number of the unit, `6"-PL-11002-A1B`.
    pub fn line(&mut self, bore: Bore, service: Service) -> String {
        self.next_line += 1;
        format!("{}\"-{}-{}{:02}-A1B", bore.inches, service.code, self.unit, self.next_line)
    }
}

/// Properties of a piping or equipment part, as JSON text.
pub(super) fn properties(part_number: &str, material: &str, dn: Option<u32>) -> String {
    match dn {
        Some(dn) => json!({ "partNumber": part_number, "material": material, "dn": dn }),
        None => json!({ "partNumber": part_number, "material": material }),
    }
    .to_string()
}

/// `colour` as one of five near shades: no two batches of paint are equal.
pub(super) fn weathered(plan: &mut Plan, colour: Colour) -> Colour {
    let shade = plan.rng.rand_range(0..5) as i16 * 3 - 6;
    let Colour([r, g, b, alpha]) = colour;
    let [r, g, b] = [r, g, b].map(|c| (i16::from(c) + shade).clamp(0, 255) as u8);
    Colour([r, g, b, alpha])
}
