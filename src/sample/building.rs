//! The control building: walls with openings, and rooms with something in them.

use glam::{DAffine3, DVec3};

use super::names::{
    self, BLACK, CABINET, CONCRETE, GALVANIZED, GLASS, Tags, WALL, WOOD, properties, weathered,
};
use super::plan::Plan;
use super::sections::Plate;
use super::shapes::{Shape, Solid, along, at, block, cylinder, flat_ring, frame, yaw};
use super::site::Site;

/// Outer size along X and Z, and height of the walls.
const SIZE: [f64; 2] = [11.6, 8.4];
const HEIGHT: f64 = 3.9;
const WALL_M: f64 = 0.25;
/// Top of the floor above the paving.
const FLOOR: f64 = 0.3;

/// An opening of a wall: from where along it, sill height, width, height.
#[derive(Clone, Copy)]
enum Opening {
    Door { at: f64 },
    Window { at: f64, width: f64 },
}

impl Opening {
    /// `[x0, z0, x1, z1]` on the wall.
    fn cut(self) -> [f64; 4] {
        match self {
            Opening::Door { at } => [at, 0.0, at + 1.0, 2.1],
            Opening::Window { at, width } => [at, 1.0, at + width, 2.4],
        }
    }
}

/// A control room, an electrical room and an office under one roof; the entrance faces the rack.
pub(super) fn control_building(plan: &mut Plan, tags: &mut Tags, site: &Site) {
    let [x, z] = SIZE;
    // Local space: origin at the outer corner on the floor, +Z away from the rack or towards it, as it comes.
    let corner = site.centre + DVec3::new(-x / 2.0, FLOOR, -z / 2.0);
    let base = DAffine3::from_translation(corner);
    let tag = tags.tag("B");
    let extras = properties(&format!("{tag}-CB"), "C30/37", None);
    plan.group_with(format!("{tag} Control building"), extras, |plan| {
        plan.group("Shell", |plan| shell(plan, base, site.toward > 0.0));
        plan.group("Control room", |plan| control_room(plan, tags, base));
        plan.group("Electrical room", |plan| electrical_room(plan, tags, base));
        plan.group("Office", |plan| office(plan, base));
        plan.group("Roof", |plan| roof(plan, tags, base));
    });
}

/// A wall of `length` standing on `from` along `direction`, inner side to the left seen from above.
fn wall(
    plan: &mut Plan,
    name: &str,
    base: DAffine3,
    from: DVec3,
    direction: DVec3,
    length: f64,
    openings: &[Opening],
) {
    let cuts: Vec<[f64; 4]> = openings.iter().map(|opening| opening.cut()).collect();
    let plate = Plate::with_openings(length, HEIGHT, WALL_M, &cuts);
    let place = base * frame(from, direction, DVec3::Y.cross(direction));
    plan.put_new(name, Shape::Plate { plate, frame: DAffine3::IDENTITY }, place, WALL);
    for opening in openings {
        match *opening {
            Opening::Door { at: x } => {
                let leaf = plan.shared("DOOR LEAF 1000x2100", || {
                    Solid::from([
                        block(0.96, 2.06, 0.05, at(0.48, 0.01, 0.0)),
                        cylinder(0.02, -0.08, 0.16, along(DVec3::new(0.88, 1.0, 0.0), DVec3::Z)),
                    ])
                });
                // Local Z is up on a wall; the leaf stands ajar.
                let upright = frame(DVec3::new(x + 0.02, WALL_M / 2.0, 0.0), DVec3::X, DVec3::Z);
                plan.put(leaf, place * upright * yaw(0.9), names::rgb(92, 110, 124));
            }
            Opening::Window { at: x, width } => {
                let millimetres = (width * 1000.0).round();
                let sash = plan.shared(&format!("WINDOW FRAME {millimetres}x1400"), || {
                    let plate = Plate::with_openings(
                        width,
                        1.4,
                        0.08,
                        &[
                            [0.06, 0.06, width / 2.0 - 0.03, 1.34],
                            [width / 2.0 + 0.03, 0.06, width - 0.06, 1.34],
                        ],
                    );
                    Shape::Plate { plate, frame: DAffine3::IDENTITY }.into()
                });
                plan.put(sash, place * at(x, 0.08, 1.0), names::rgb(226, 228, 226));
                let pane = plan.shared(&format!("WINDOW PANE {millimetres}x1400"), || {
                    block(width - 0.1, 0.012, 1.3, at(width / 2.0, 0.034, 0.7)).into()
                });
                plan.put(pane, place * at(x, 0.08, 1.0), GLASS);
            }
        }
    }
}

fn shell(plan: &mut Plan, base: DAffine3, entrance_high: bool) {
    let [x, z] = SIZE;
    let slab = block(x + 0.8, FLOOR + 0.15, z + 0.8, at(x / 2.0, -FLOOR - 0.15, z / 2.0));
    plan.put_new("Floor slab", slab, base, CONCRETE);
    let front = [
        Opening::Window { at: 0.9, width: 2.4 },
        Opening::Window { at: 4.0, width: 2.4 },
        Opening::Door { at: 6.9 },
        Opening::Window { at: 8.5, width: 1.8 },
    ];
    let back = [
        Opening::Window { at: 1.2, width: 1.8 },
        Opening::Window { at: 4.4, width: 2.4 },
        Opening::Door { at: 8.2 },
    ];
    let (low, high) = if entrance_high { (&back[..], &front[..]) } else { (&front[..], &back[..]) };
    wall(plan, "Wall 1", base, DVec3::new(0.0, 0.0, WALL_M), DVec3::X, x, low);
    wall(plan, "Wall 2", base, DVec3::new(0.0, 0.0, z), DVec3::X, x, high);
    let inner = z - 2.0 * WALL_M;
    let side = [Opening::Window { at: 1.2, width: 2.4 }];
    wall(plan, "Wall 3", base, DVec3::new(0.0, 0.0, WALL_M), DVec3::Z, inner, &side);
    wall(
        plan,
        "Wall 4",
        base,
        DVec3::new(x - WALL_M, 0.0, WALL_M),
        DVec3::Z,
        inner,
        &[Opening::Door { at: 5.5 }],
    );
    wall(
        plan,
        "Partition 1",
        base,
        DVec3::new(6.5, 0.0, WALL_M),
        DVec3::Z,
        inner,
        &[Opening::Door { at: 2.0 }, Opening::Door { at: 5.6 }],
    );
    let right = x - 6.5 - 2.0 * WALL_M;
    wall(
        plan,
        "Partition 2",
        base,
        DVec3::new(6.5 + WALL_M, 0.0, 4.4),
        DVec3::X,
        right,
        &[Opening::Door { at: 2.6 }],
    );
}

fn desk(plan: &mut Plan, place: DAffine3) {
    let table = plan.shared("DESK 1600x800", || {
        Solid::from([
            block(1.6, 0.03, 0.8, at(0.0, 0.71, 0.0)),
            block(0.04, 0.71, 0.7, at(-0.74, 0.0, 0.0)),
            block(0.04, 0.71, 0.7, at(0.74, 0.0, 0.0)),
        ])
    });
    plan.put(table, place, WOOD);
    let screen = plan.shared("MONITOR 27in", || {
        Solid::from([
            block(0.61, 0.36, 0.03, at(0.0, 0.12, 0.0)),
            cylinder(0.02, 0.0, 0.2, at(0.0, 0.0, -0.03)),
            cylinder(0.11, 0.0, 0.012, at(0.0, 0.0, -0.03)),
        ])
    });
    for x in [-0.36, 0.36] {
        plan.put(screen, place * at(x, 0.74, -0.15), BLACK);
    }
    let chair = plan.shared("CHAIR", || {
        Solid::from([
            block(0.48, 0.06, 0.46, at(0.0, 0.45, 0.0)),
            block(0.44, 0.5, 0.05, at(0.0, 0.6, 0.22)),
            cylinder(0.03, 0.06, 0.4, DAffine3::IDENTITY),
            cylinder(0.28, 0.0, 0.06, DAffine3::IDENTITY),
        ])
    });
    plan.put(chair, place * at(0.05, 0.0, 0.75), names::rgb(54, 60, 84));
}

fn ceiling_light(plan: &mut Plan, place: DAffine3) {
    let light = plan.shared("CEILING LIGHT 1200", || block(1.2, 0.06, 0.3, DAffine3::IDENTITY).into());
    plan.put(light, place, names::rgb(244, 244, 236));
}

fn control_room(plan: &mut Plan, tags: &mut Tags, base: DAffine3) {
    for row in 0..2 {
        for seat in 0..3 {
            let place = base * at(1.5 + 1.75 * f64::from(seat), 0.0, 2.6 + 2.3 * f64::from(row));
            plan.group(format!("Operator desk {}", 3 * row + seat + 1), |plan| desk(plan, place));
        }
        for light in 0..3 {
            ceiling_light(
                plan,
                base * at(1.3 + 1.9 * f64::from(light), HEIGHT - 0.07, 2.4 + 2.4 * f64::from(row)),
            );
        }
    }
    let wall_screen = plan.shared("WALL DISPLAY 70in", || block(1.55, 0.9, 0.06, DAffine3::IDENTITY).into());
    for seat in 0..3 {
        let place = base * at(1.5 + 1.75 * f64::from(seat), 1.3, 0.45);
        plan.put_as(tags.tag("HMI"), wall_screen, place, BLACK);
    }
}

fn electrical_room(plan: &mut Plan, tags: &mut Tags, base: DAffine3) {
    let cabinet = plan.shared("CABINET 800x2100x600", || {
        Solid::from([
            block(0.78, 2.1, 0.6, DAffine3::IDENTITY),
            block(0.7, 1.9, 0.02, at(0.0, 0.12, 0.31)),
            block(0.03, 0.2, 0.03, at(0.3, 1.0, 0.33)),
        ])
    });
    for column in 0..4 {
        for (z, half_turns) in [(0.75, 0), (3.65, 2)] {
            let place =
                base * at(7.4 + 0.85 * f64::from(column), 0.0, z) * super::shapes::quarter_turn(half_turns);
            let colour = weathered(plan, CABINET);
            plan.put_as(tags.tag("MCC"), cabinet, place, colour);
        }
    }
    let tray = plan.shared("CABLE TRAY 400 L=3600", || {
        Solid::from([block(3.6, 0.01, 0.4, DAffine3::IDENTITY), block(3.6, 0.08, 0.01, at(0.0, 0.01, 0.195))])
    });
    for z in [0.8, 3.6] {
        plan.put(tray, base * at(8.7, 2.7, z), GALVANIZED);
    }
    for x in [7.9, 10.0] {
        ceiling_light(plan, base * at(x, HEIGHT - 0.07, 2.2));
    }
}

fn office(plan: &mut Plan, base: DAffine3) {
    for x in [8.0, 10.2] {
        plan.group("Desk", |plan| desk(plan, base * at(x, 0.0, 6.6)));
        ceiling_light(plan, base * at(x, HEIGHT - 0.07, 6.4));
    }
    let shelf = plan.shared("SHELF 1000x2000", || {
        let mut shapes =
            vec![block(0.02, 2.0, 0.35, at(-0.49, 0.0, 0.0)), block(0.02, 2.0, 0.35, at(0.49, 0.0, 0.0))];
        for board in 0..6 {
            shapes.push(block(0.96, 0.02, 0.34, at(0.0, 0.05 + 0.38 * f64::from(board), 0.0)));
        }
        Solid(shapes)
    });
    plan.put(shelf, base * at(7.5, 0.0, 4.9), WOOD);
}

fn roof(plan: &mut Plan, tags: &mut Tags, base: DAffine3) {
    let [x, z] = SIZE;
    let slab = block(x + 0.5, 0.25, z + 0.5, at(x / 2.0, HEIGHT, z / 2.0));
    plan.put_new("Roof slab", slab, base, CONCRETE);
    let parapet = Plate::with_openings(x + 0.5, z + 0.5, 0.4, &[[0.15, 0.15, x + 0.35, z + 0.35]]);
    plan.put_new(
        "Parapet",
        Shape::Plate { plate: parapet, frame: at(-0.25, HEIGHT + 0.25, -0.25) },
        base,
        WALL,
    );
    let unit = plan.shared("HVAC UNIT 30kW", || {
        Solid::from([
            block(1.9, 1.1, 1.2, at(0.0, 0.15, 0.0)),
            flat_ring(0.36, 0.42, 1.25, 0.12, at(-0.45, 0.0, 0.0)),
            flat_ring(0.36, 0.42, 1.25, 0.12, at(0.45, 0.0, 0.0)),
            block(0.1, 0.15, 1.2, at(-0.7, 0.0, 0.0)),
            block(0.1, 0.15, 1.2, at(0.7, 0.0, 0.0)),
        ])
    });
    for offset in [2.6, 6.0] {
        plan.put_as(tags.tag("AC"), unit, base * at(offset, HEIGHT + 0.25, z * 0.5), CABINET);
    }
    let duct = plan.shared("DUCT 500x400 L=2500", || block(2.5, 0.4, 0.5, DAffine3::IDENTITY).into());
    plan.put(duct, base * at(8.6, HEIGHT + 0.45, z * 0.5), GALVANIZED);
}
