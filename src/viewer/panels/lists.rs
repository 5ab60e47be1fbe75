//! Lists beside the picture: saved views, the route, measurements.

use std::path::PathBuf;
use std::sync::Arc;

use egui::{DragValue, ScrollArea, TextEdit, Ui};

use super::{button, line};
use crate::viewer::action::Action;
use crate::viewer::measure::LengthUnit;
use crate::viewer::session::Session;

pub fn bookmarks(ui: &mut Ui, session: &mut Session) {
    let names: Vec<String> = session.bookmarks.views().iter().map(|view| view.name.clone()).collect();
    for name in names {
        ui.horizontal(|ui| {
            thumbnail(ui, session, &name);
            button(ui, session, "x", "Forget it", &Action::RemoveBookmark { name: name.clone() });
            renamed(ui, session, &name);
            if ui.add(egui::Button::new(&name).truncate()).on_hover_text("See it again").clicked() {
                session.act_or_tell(&Action::GoToBookmark { name: name.clone() });
            }
        });
    }
    button(ui, session, "Save this view", "Beside the scene", &Action::AddBookmark { name: "View".into() });
}

/// A menu in which a saved view gets another name.
fn renamed(ui: &mut Ui, session: &mut Session, name: &str) {
    ui.menu_button("Rename", |ui| {
        let id = ui.scope_id().with(name);
        let mut text: String = ui.data(|data| data.get_temp(id)).unwrap_or_else(|| name.to_owned());
        let is_done = line(ui, &mut text, 160.0);
        if ui.button("Rename").clicked() || is_done {
            session.act_or_tell(&Action::RenameBookmark { name: name.to_owned(), to: text.clone() });
            ui.data_mut(|data| data.remove::<String>(id));
            ui.close();
        } else {
            ui.data_mut(|data| data.insert_temp(id, text));
        }
    })
    .response
    .on_hover_text("Another name");
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

pub fn route(ui: &mut Ui, session: &mut Session) {
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
    });
    keyframes(ui, session);
    let label = ui.label("File");
    ui.add(TextEdit::singleline(&mut session.route_file).desired_width(f32::INFINITY)).labelled_by(label.id);
    ui.horizontal_wrapped(|ui| {
        if let Some(route) = &session.route {
            let before = route.fps();
            let mut fps = before;
            let field = DragValue::new(&mut fps).range(1.0..=1000.0).suffix(" frames/s");
            if ui.add(field).changed() && fps != before {
                session.act_or_tell(&Action::RouteFps { fps });
            }
        }
        let file = PathBuf::from(session.route_file.trim());
        let hint = "Write it there, for compare, walk and render";
        button(ui, session, "Export", hint, &Action::ExportRoute { file: file.clone() });
        button(ui, session, "Open", "Read it from there", &Action::OpenRoute { file });
    });
}

/// Keyframes, each to be seen, set, timed and taken out.
fn keyframes(ui: &mut Ui, session: &mut Session) {
    let Some(route) = &session.route else { return };
    let times: Vec<(f64, bool)> =
        route.keyframes().iter().map(|keyframe| (keyframe.t, keyframe.cut)).collect();
    let mut done = None;
    let rows = ScrollArea::vertical().id_salt("keyframes").max_height(150.0);
    rows.show_rows(ui, ui.spacing().interact_size.y, times.len(), |ui, seen| {
        for index in seen {
            let Some(&(before, mut cut)) = times.get(index) else { break };
            ui.horizontal(|ui| {
                let mut seconds = before;
                let field = DragValue::new(&mut seconds).speed(0.05).suffix(" s").max_decimals(2);
                if ui.add(field).on_hover_text("When").changed() && seconds.is_finite() {
                    done = Some(Action::MoveKeyframe { index, seconds });
                }
                if ui.button("See").on_hover_text("What it sees").clicked() {
                    done = Some(Action::GoToKeyframe { index });
                }
                if ui.button("Set").on_hover_text("To this view").clicked() {
                    done = Some(Action::SetKeyframe { index });
                }
                if index > 0 && ui.checkbox(&mut cut, "Cut").on_hover_text("Jump to it").changed() {
                    done = Some(Action::CutKeyframe { index, on: cut });
                }
                if ui.button("x").on_hover_text("Take it out").clicked() {
                    done = Some(Action::RemoveKeyframe { index });
                }
            });
        }
    });
    if let Some(action) = done {
        session.act_or_tell(&action);
    }
}

pub fn measurements(ui: &mut Ui, session: &mut Session) {
    let scene = Arc::clone(session.document.scene());
    let unit = LengthUnit::of(&scene.scene().meta().settings);
    let up = scene.scene().meta().settings.up.unit();
    for measurement in &session.measuring.done {
        ui.label(measurement.shown(unit).to_string()).on_hover_text(format!(
            "{} level, {} up, {:.2}\u{b0}",
            unit.show(measurement.level_distance(up)),
            unit.show(measurement.rise(up)),
            measurement.slope_deg(up)
        ));
    }
    if session.measuring.is_on {
        ui.label(if session.measuring.from.is_some() { "Click the second point." } else { "Click a point." });
    }
    if !session.measuring.done.is_empty() {
        button(ui, session, "Forget all", "All measurements", &Action::ClearMeasurements);
    }
}
