//! Another file.

use std::path::{Path, PathBuf};

use egui::Ui;

use super::line;
use crate::viewer::preferences::Preferences;

/// Lists what was opened before, and takes a path. What is to be opened?
pub fn recent(ui: &mut Ui, preferences: &mut Preferences) -> Option<PathBuf> {
    let mut chosen = None;
    let id = ui.scope_id().with("path");
    let mut text: String = ui.data(|data| data.get_temp(id)).unwrap_or_default();
    ui.horizontal(|ui| {
        ui.label("Path");
        let is_done = line(ui, &mut text, 260.0);
        if (ui.button("Open").clicked() || is_done) && !text.trim().is_empty() {
            chosen = Some(PathBuf::from(text.trim()));
        }
    });
    ui.data_mut(|data| data.insert_temp(id, text));
    let before: Vec<PathBuf> = preferences.recent().map(Path::to_owned).collect();
    for file in before {
        ui.horizontal(|ui| {
            if ui.button("x").on_hover_text("Forget it").clicked() {
                preferences.forget(&file);
            }
            let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy();
            if ui.button(name).on_hover_text(file.display().to_string()).clicked() {
                chosen = Some(file.clone());
            }
        });
    }
    chosen
}
