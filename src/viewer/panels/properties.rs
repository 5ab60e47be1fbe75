//! What is known of the current part, and lists: sections, saved views, the route, measurements.

use std::ops::Range;
use std::sync::Arc;

use egui::{CollapsingHeader, DragValue, Grid, ScrollArea, Ui};
use glam::DVec3;

use super::{button, grouped};
use crate::viewer::action::{Action, AxisName};
use crate::viewer::document::triangles_by_level;
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
        section(ui, "Saved views", |ui| bookmarks(ui, session));
        section(ui, "Route", |ui| route(ui, session));
        section(ui, "Measurements", |ui| measurements(ui, session));
        section(ui, "Limits", |ui| limits(ui, session));
    });
}

fn section(ui: &mut Ui, title: &str, contents: impl FnOnce(&mut Ui)) {
    CollapsingHeader::new(title).default_open(true).show(ui, contents);
}

fn part(ui: &mut Ui, session: &Session, seen_of: SeenOf) {
    let Some(node) = session.current else {
        ui.label("Click a part, or a row of the tree.");
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
        if let Some((min, max)) = session.document.bounds(objects.clone()) {
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
    let extras = all.name(record.extras);
    if !extras.is_empty() {
        ui.label("Extras");
        ui.monospace(extras);
    }
}

fn moving(ui: &mut Ui, session: &mut Session) {
    let is_any = session.document.selected().count() > 0;
    let scene = Arc::clone(session.document.scene());
    let bounds = scene.scene().meta().bounds;
    let step = 0.01 * (DVec3::from(bounds.max) - DVec3::from(bounds.min)).max_element();
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
    let meta = session.document.scene().scene().meta();
    let (min, max) = (DVec3::from(meta.bounds.min), DVec3::from(meta.bounds.max));
    let speed = 1e-3 * (max - min).max_element();
    let mut sections = session.document.state().sections.clone();
    let (mut removed, mut dragged, mut ended) = (None, None, false);
    for (index, section) in sections.iter_mut().enumerate() {
        ui.horizontal(|ui| {
            let label = ui.checkbox(&mut section.is_on, section.name.as_str());
            // Where the plane is along its normal.
            let normal = section.plane.normal.normalize_or_zero();
            let mut at = normal.dot(section.plane.point);
            let value = ui.add(DragValue::new(&mut at).speed(speed)).labelled_by(label.id);
            if value.changed() {
                section.plane.point += normal * (at - normal.dot(section.plane.point));
                dragged = Some(index);
            }
            ended |= value.drag_stopped() || value.lost_focus();
            if ui.button("Flip").clicked() {
                section.plane.normal = -section.plane.normal;
            }
            if ui.button("x").on_hover_text("Remove").clicked() {
                removed = Some(index);
            }
        });
    }
    if let Some(index) = removed {
        sections.remove(index);
    }
    match dragged {
        Some(index) => {
            session
                .document
                .change_on(&format!("Move section {}", index + 1), |state| state.sections = sections);
        }
        None => session.document.change("Section", |state| state.sections = sections),
    }
    if ended {
        session.document.end_gesture();
    }
    for axis in AxisName::ALL {
        let action = Action::AddSection { axis, at: None, flip: false };
        button(ui, session, &format!("Across {}", axis.name()), "Through the middle", &action);
    }
}

fn bookmarks(ui: &mut Ui, session: &mut Session) {
    let names: Vec<String> = session.bookmarks.views().iter().map(|view| view.name.clone()).collect();
    for name in names {
        ui.horizontal(|ui| {
            thumbnail(ui, session, &name);
            button(ui, session, "x", "Forget it", &Action::RemoveBookmark { name: name.clone() });
            if ui.add(egui::Button::new(&name).truncate()).on_hover_text("See it again").clicked() {
                session.act_or_tell(&Action::GoToBookmark { name: name.clone() });
            }
        });
    }
    button(ui, session, "Save this view", "Beside the scene", &Action::AddBookmark { name: "View".into() });
}

/// The small picture of a saved view.
fn thumbnail(ui: &mut Ui, session: &Session, name: &str) {
    let view = session.bookmarks.views().iter().find(|view| view.name == name);
    let Some(picture) = view.and_then(|view| view.thumbnail.as_ref()) else { return };
    let picture = picture.image();
    // Another view of the same name has another picture.
    let id = egui::Id::unique(("thumbnail", name, xxhash_rust::xxh3::xxh3_64(picture.as_raw())));
    let known: Option<egui::TextureHandle> = ui.data(|data| data.get_temp(id));
    let texture = known.unwrap_or_else(|| {
        let size = [picture.width() as usize, picture.height() as usize];
        let pixels = egui::ColorImage::from_rgb(size, picture.as_raw());
        let texture = ui.ctx().load_texture(name, pixels, egui::TextureOptions::LINEAR);
        ui.data_mut(|data| data.insert_temp(id, texture.clone()));
        texture
    });
    ui.add(egui::Image::new(&texture).max_height(40.0));
}

fn route(ui: &mut Ui, session: &mut Session) {
    if let Some(route) = &session.route {
        ui.label(format!("{:.1} s, {} keyframes", route.duration(), route.keyframes().len()));
    }
    ui.horizontal_wrapped(|ui| {
        let on = !session.is_recording();
        let text = if on { "Record" } else { "Stop" };
        button(ui, session, text, "What the camera does from now on", &Action::Record { on });
        button(ui, session, "Add this view", "Two seconds after its end", &Action::AddKeyframe);
        if session.playing.is_some() {
            button(ui, session, "Stop playing", "Here (Escape)", &Action::Stop);
        } else {
            button(ui, session, "Play", "Play the route", &Action::Play);
        }
        button(ui, session, "Faster", "1.25 times", &Action::SpeedRoute { factor: 1.25 });
        button(ui, session, "Slower", "0.8 times", &Action::SpeedRoute { factor: 0.8 });
        button(ui, session, "Reverse", "Backwards", &Action::ReverseRoute);
        let file = session.path().with_extension("route.json");
        let export = Action::ExportRoute { file: file.clone() };
        button(ui, session, "Export", "Beside the scene, for compare, walk and render", &export);
        if file.exists() {
            button(ui, session, "Open", "The one beside the scene", &Action::OpenRoute { file });
        }
    });
}

fn measurements(ui: &mut Ui, session: &mut Session) {
    let scene = Arc::clone(session.document.scene());
    let unit = LengthUnit::of(&scene.scene().meta().settings);
    for measurement in &session.measuring.done {
        ui.label(measurement.shown(unit).to_string());
    }
    if session.measuring.is_on {
        ui.label(if session.measuring.from.is_some() { "Click the second point." } else { "Click a point." });
    }
    if !session.measuring.done.is_empty() {
        button(ui, session, "Forget all", "All measurements", &Action::ClearMeasurements);
    }
}

fn limits(ui: &mut Ui, session: &mut Session) {
    let preferences = &mut session.preferences;
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
        let label = ui.label("Geometry on the GPU, MB").on_hover_text("From the next start on");
        let mut megabytes = preferences.geometry_bytes / 1_000_000;
        ui.add(DragValue::new(&mut megabytes).range(17..=1_000_000).speed(10.0)).labelled_by(label.id);
        preferences.geometry_bytes = megabytes.max(1) * 1_000_000;
        ui.end_row();
        let label = ui.label("Mouse speed");
        ui.add(DragValue::new(&mut preferences.mouse_speed).range(0.05..=20.0).speed(0.05))
            .labelled_by(label.id);
        ui.end_row();
    });
    preferences.bring_into_range();
}
