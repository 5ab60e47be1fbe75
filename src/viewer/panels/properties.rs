//! What is known of the current part, and what is done with it: moving, sections, limits.

use std::ops::Range;
use std::sync::Arc;

use egui::{CollapsingHeader, DragValue, Grid, ScrollArea, Ui};
use glam::DVec3;
use serde_json::Value;

use super::{button, lists};
use crate::human::grouped;
use crate::viewer::action::{Action, AxisName};
use crate::viewer::document::{Section, triangles_by_level};
use crate::viewer::measure::LengthUnit;
use crate::viewer::session::Session;

/// How many of some objects are visible, and the pixels that they cover.
type SeenOf<'a> = &'a dyn Fn(Range<u32>) -> (u32, u64);

/// Shows it.
pub fn properties(ui: &mut Ui, session: &mut Session, seen_of: SeenOf) {
    ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
        section(ui, "Part", |ui| part(ui, session, seen_of));
        section(ui, "Move", |ui| moving(ui, session));
        section(ui, "Sections", |ui| sections(ui, session));
        section(ui, "Saved views", |ui| lists::bookmarks(ui, session));
        section(ui, "Route", |ui| lists::route(ui, session));
        section(ui, "Measurements", |ui| lists::measurements(ui, session));
        section(ui, "Limits", |ui| limits(ui, session));
    });
}

fn section(ui: &mut Ui, title: &str, contents: impl FnOnce(&mut Ui)) {
    CollapsingHeader::new(title).default_open(true).show(ui, contents);
}

fn part(ui: &mut Ui, session: &Session, seen_of: SeenOf) {
    let Some(node) = session.current else {
        let count = session.document.selected().count();
        ui.label(match count {
            0 => "Click a part, or a row of the tree.".to_owned(),
            _ => format!("{} parts are selected.", grouped(count.into())),
        });
        return;
    };
    let scene = Arc::clone(session.document.scene());
    let all = scene.scene();
    let record = &all.nodes()[node as usize];
    ui.strong(all.name(record.name));
    ui.label(all.node_path(node));
    let objects = all.subtree_objects(node);
    let unit = LengthUnit::of(&all.meta().settings);
    let width = (ui.available_width() - 130.0).max(60.0);
    Grid::new("part").num_columns(2).max_col_width(width).show(ui, |ui| {
        let mut line = |what: &str, value: String| {
            ui.label(what);
            ui.add(egui::Label::new(value).wrap());
            ui.end_row();
        };
        line("Parts", grouped(objects.len() as u64));
        if let Some((min, max)) = session.document.node_bounds(node) {
            let [x, y, z] = (max - min).to_array().map(|side| unit.show(side));
            line("Size", format!("{x} x {y} x {z}"));
        }
        if objects.len() == 1 {
            let levels = triangles_by_level(&scene, objects.start);
            let levels: Vec<String> = levels.into_iter().map(grouped).collect();
            line("Triangles by level", levels.join(", "));
            let moved = session.document.state().motions.get(&objects.start);
            if let Some(motion) = moved {
                line("Moved by", format!("{:.3}", motion.translation));
            }
        }
        let (count, pixels) = seen_of(objects.clone());
        let seen = match count {
            0 => "not in view".to_owned(),
            count => format!("{} of {}", grouped(count.into()), grouped(objects.len() as u64)),
        };
        line("Visible", seen);
        line("Pixels in view", grouped(pixels));
    });
    extras(ui, all.name(record.extras), width);
}

/// What the file tells of a part beside its shape: JSON, of which an object is listed.
fn extras(ui: &mut Ui, text: &str, width: f32) {
    if text.is_empty() {
        return;
    }
    ui.label("Extras");
    let Ok(Value::Object(fields)) = serde_json::from_str(text) else {
        ui.monospace(text);
        return;
    };
    Grid::new("extras").num_columns(2).max_col_width(width).show(ui, |ui| {
        for (name, value) in fields {
            let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            ui.label(name);
            ui.add(egui::Label::new(value).wrap());
            ui.end_row();
        }
    });
}

fn moving(ui: &mut Ui, session: &mut Session) {
    let is_any = session.document.selected().count() > 0;
    let scene = Arc::clone(session.document.scene());
    let bounds = scene.scene().meta().bounds;
    let step = 0.01 * (DVec3::from(bounds.max) - DVec3::from(bounds.min)).max_element();
    let on = !session.moves_parts;
    if ui.selectable_label(!on, "Handles").on_hover_text("Drag arrows and rings in the picture (G)").clicked()
    {
        session.act_or_tell(&Action::MoveTool { on });
    }
    ui.add_enabled_ui(is_any, |ui| {
        for axis in AxisName::ALL {
            ui.horizontal(|ui| {
                ui.label(axis.name());
                for (text, share) in [("--", -10.0), ("-", -1.0), ("+", 1.0), ("++", 10.0)] {
                    let by = (axis.unit() * step * share).to_array();
                    button(ui, session, text, "Move", &Action::Move { by });
                }
                for (text, degrees) in [("-15°", -15.0), ("+15°", 15.0)] {
                    button(ui, session, text, "Turn about the middle", &Action::Rotate { axis, degrees });
                }
            });
        }
        button(ui, session, "Move back", "Where the file has it", &Action::MoveBack);
    });
}

fn sections(ui: &mut Ui, session: &mut Session) {
    let (min, max) = session.bounds();
    let speed = 1e-3 * (max - min).max_element();
    let mut done = None;
    for (index, section) in session.document.state().sections.iter().enumerate() {
        ui.horizontal(|ui| {
            let mut is_on = section.is_on;
            let label = ui.checkbox(&mut is_on, section.name.as_str());
            if label.changed() {
                done = Some((index, Done::Switched(is_on)));
            }
            // Where the plane is along its normal; of an axis, as the axis counts, whichever side is kept.
            let normal = section.plane.normal.normalize_or_zero();
            let normal = if normal.element_sum() < 0.0 { -normal } else { normal };
            let before = normal.dot(section.plane.point);
            let mut at = before;
            let value = ui.add(DragValue::new(&mut at).speed(speed)).labelled_by(label.id);
            if value.changed() && at.is_finite() {
                done = Some((index, Done::Moved(normal * (at - before))));
            } else if value.drag_stopped() || value.lost_focus() {
                done = Some((index, Done::Ended));
            }
            if ui.button("Flip").on_hover_text("Keep the other side").clicked() {
                done = Some((index, Done::Flipped));
            }
            if ui.button("x").on_hover_text("Remove").clicked() {
                done = Some((index, Done::Removed));
            }
        });
    }
    if let Some((index, what)) = done {
        change_section(session, index, what);
    }
    for axis in AxisName::ALL {
        let action = Action::AddSection { axis, at: None, flip: false };
        button(ui, session, &format!("Across {}", axis.name()), "Through the middle", &action);
    }
    let mut on = session.preferences.caps;
    let hint = "Draw what is cut open as solid: of closed bodies";
    if ui.checkbox(&mut on, "Caps").on_hover_text(hint).changed() {
        session.act_or_tell(&Action::Caps { on });
    }
}

/// What was done with a section.
enum Done {
    Switched(bool),
    Moved(DVec3),
    Ended,
    Flipped,
    Removed,
}

fn change_section(session: &mut Session, index: usize, what: Done) {
    let document = &mut session.document;
    let mut with = |name: &str, change: &dyn Fn(&mut Section)| {
        document.change(name, |state| state.sections.get_mut(index).map_or((), change));
    };
    match what {
        Done::Switched(is_on) => with("Switch section", &|section| section.is_on = is_on),
        Done::Flipped => with("Flip section", &|section| section.plane.normal = -section.plane.normal),
        Done::Moved(by) => document.change_on(&format!("Move section {}", index + 1), |state| {
            if let Some(section) = state.sections.get_mut(index) {
                section.plane.point += by;
            }
        }),
        Done::Ended => document.end_gesture(),
        Done::Removed => document.change("Remove section", |state| {
            state.sections.remove(index);
        }),
    }
}

fn limits(ui: &mut Ui, session: &mut Session) {
    let preferences = &mut session.preferences;
    let mut is_memory_changed = false;
    Grid::new("limits").num_columns(2).show(ui, |ui| {
        let label = ui.label("Triangles a frame");
        ui.add(DragValue::new(&mut preferences.triangles).speed(10_000.0)).labelled_by(label.id);
        ui.end_row();
        let label = ui.label("Pixels of error");
        ui.add(DragValue::new(&mut preferences.pixel_error).speed(0.05)).labelled_by(label.id);
        ui.end_row();
        let label = ui.label("Shadow rays a frame");
        ui.add(DragValue::new(&mut preferences.shadow_samples).range(1..=64)).labelled_by(label.id);
        ui.end_row();
        let label = ui.label("Geometry on the GPU, MB");
        let mut megabytes = preferences.geometry_bytes / 1_000_000;
        let field =
            DragValue::new(&mut megabytes).range(17..=1_000_000).speed(10.0).update_while_editing(false);
        let field = ui.add(field).labelled_by(label.id);
        if field.changed() {
            preferences.geometry_bytes = megabytes * 1_000_000;
        }
        // Not at each step of a drag: all of it is loaded anew.
        is_memory_changed = field.drag_stopped() || (field.changed() && !field.dragged());
        ui.end_row();
        let label = ui.label("Mouse speed");
        ui.add(DragValue::new(&mut preferences.mouse_speed).range(0.05..=20.0).speed(0.05))
            .labelled_by(label.id);
        ui.end_row();
    });
    preferences.bring_into_range();
    session.is_memory_changed |= is_memory_changed;
}
