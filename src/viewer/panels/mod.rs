//! What stands around the picture. Panels read a [`Session`] and act on it; none knows the GPU.

mod lists;
mod open;
mod properties;
mod status;
mod toolbar;
mod tree;

pub use open::recent;
pub use properties::properties;
pub use status::{Figures, status};
pub use toolbar::toolbar;
pub use tree::tree;

use super::session::Session;

/// Bytes for people.
pub fn bytes(count: u64) -> String {
    match count {
        0..1_000 => format!("{count} B"),
        1_000..1_000_000 => format!("{:.1} kB", count as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", count as f64 / 1e6),
        _ => format!("{:.2} GB", count as f64 / 1e9),
    }
}

/// A text that is taken when it is done: the field's text goes into `text`. Is it done?
fn line(ui: &mut egui::Ui, text: &mut String, width: f32) -> bool {
    let field = ui.add(egui::TextEdit::singleline(text).desired_width(width));
    field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter))
}

/// A button that does something.
fn button(ui: &mut egui::Ui, session: &mut Session, text: &str, hint: &str, action: &super::action::Action) {
    if ui.button(text).on_hover_text(hint).clicked() {
        session.act_or_tell(action);
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn numbers_are_for_people() {
        assert_eq!(super::bytes(1_234_567), "1.2 MB");
    }
}
