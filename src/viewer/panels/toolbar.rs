//! The tools above the picture.

use egui::Ui;

use super::button;
use crate::viewer::action::{Action, AxisName};
use crate::viewer::navigate::{Mode, Side};
use crate::viewer::session::Session;

/// Shows the tools.
pub fn toolbar(ui: &mut Ui, session: &mut Session) {
    ui.horizontal_wrapped(|ui| {
        views(ui, session);
        ui.separator();
        parts(ui, session);
        ui.separator();
        tools(ui, session);
    });
}

fn views(ui: &mut Ui, session: &mut Session) {
    ui.menu_button("Open", |ui| {
        if let Some(file) = super::recent(ui, &mut session.preferences) {
            session.act_or_tell(&Action::Open { file });
            ui.close();
        }
    });
    button(ui, session, "All", "See everything (Home)", &Action::ZoomAll);
    ui.menu_button("View", |ui| {
        for (side, name) in Side::NAMED {
            button(ui, session, name, "Look from there", &Action::LookFrom { side });
        }
        ui.separator();
        let on = !session.navigator.is_parallel();
        let text = if on { "Parallel" } else { "Perspective" };
        button(ui, session, text, "The other projection", &Action::Parallel { on });
    });
    for (mode, name, hint) in [
        (Mode::Orbit, "Orbit", "Drag to turn about what is under the cursor"),
        (Mode::Fly, "Fly", "W A S D, Q and E; drag to look"),
        (Mode::Walk, "Walk", "W A S D on the ground; drag to look"),
    ] {
        let is_on = session.preferences.navigation == mode;
        if ui.selectable_label(is_on, name).on_hover_text(hint).clicked() {
            session.act_or_tell(&Action::Navigate { mode });
        }
    }
}

fn parts(ui: &mut Ui, session: &mut Session) {
    for (text, hint, action) in [
        ("Zoom", "Bring what is selected into view (F)", Action::ZoomToSelection),
        ("Hide", "Hide what is selected (H)", Action::Hide),
        ("Isolate", "Show only what is selected (I)", Action::Isolate),
        ("X-ray", "Look through what is selected (X)", Action::Xray),
        ("Show all", "Hide nothing, look through nothing", Action::ShowAll),
    ] {
        button(ui, session, text, hint, &action);
    }
    let (undo, redo) = session.document.undoable();
    let (undo, redo) = (undo.map(str::to_owned), redo.map(str::to_owned));
    ui.add_enabled_ui(undo.is_some(), |ui| {
        button(ui, session, "Undo", &format!("Undo: {} (Ctrl Z)", undo.unwrap_or_default()), &Action::Undo);
    });
    ui.add_enabled_ui(redo.is_some(), |ui| {
        button(ui, session, "Redo", &format!("Redo: {} (Ctrl Y)", redo.unwrap_or_default()), &Action::Redo);
    });
}

fn tools(ui: &mut Ui, session: &mut Session) {
    ui.menu_button("Section", |ui| {
        for axis in AxisName::ALL {
            let text = format!("Across {}", axis.name());
            let action = Action::AddSection { axis, at: None, flip: false };
            button(ui, session, &text, "Through the middle of what is selected, or of all", &action);
        }
        button(ui, session, "Remove all", "Cut nothing", &Action::ClearSections);
    });
    let on = !session.moves_parts;
    let hint = "Drag what is selected by arrows and rings (G)";
    if ui.selectable_label(!on, "Move").on_hover_text(hint).clicked() {
        session.act_or_tell(&Action::MoveTool { on });
    }
    let on = !session.measuring.is_on;
    if ui.selectable_label(!on, "Measure").on_hover_text("Click two points (M)").clicked() {
        session.act_or_tell(&Action::Measure { on });
    }
    let mut on = session.preferences.shadows;
    if ui.checkbox(&mut on, "Shadows").changed() {
        session.act_or_tell(&Action::Shadows { on });
    }
    let mut on = session.is_frozen;
    let hint = "Go on drawing what is drawn now, and look around: what is culled is missing";
    if ui.checkbox(&mut on, "Freeze").on_hover_text(hint).changed() {
        session.act_or_tell(&Action::Freeze { on });
    }
    let hint = "Compare the picture with what rays through all triangles see";
    button(ui, session, "Check", hint, &Action::CheckLost);
}
