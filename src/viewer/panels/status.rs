//! What a frame takes and holds.

use std::collections::VecDeque;

use egui::{Color32, RichText, Ui, pos2, vec2};

use super::bytes;
use crate::human::grouped;
use crate::viewer::session::Session;

/// Frames whose times are plotted.
const PLOTTED: usize = 120;

/// Figures of the newest frames.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    /// Milliseconds from frame to frame, oldest first.
    pub times: VecDeque<f32>,
    /// Visible drawables.
    pub visible: u32,
    /// Drawn.
    pub drawn: u32,
    /// Wanted and not there yet.
    pub missing: u32,
    /// All that fits is there.
    pub is_complete: bool,
    /// Triangles drawn.
    pub triangles: u64,
    /// Bytes of geometry on the GPU.
    pub resident: u64,
    /// As many as there may be.
    pub budget: u64,
    /// Milliseconds of the visibility query.
    pub query_ms: f64,
    /// Samples of shadows so far; `None` without shadows.
    pub shadow_samples: Option<u32>,
    /// Pages that could not be loaded.
    pub failed: u32,
}

impl Figures {
    /// A frame came so many milliseconds after the one before.
    pub fn add_time(&mut self, milliseconds: f32) {
        self.times.push_back(milliseconds);
        if self.times.len() > PLOTTED {
            self.times.pop_front();
        }
    }

    /// The worst and the mean of the plotted times.
    fn worst_and_mean(&self) -> (f32, f32) {
        let worst = self.times.iter().copied().fold(0.0, f32::max);
        (worst, self.times.iter().sum::<f32>() / self.times.len().max(1) as f32)
    }
}

/// Shows the figures, and what was told last.
pub fn status(ui: &mut Ui, session: &Session, figures: &Figures) {
    ui.horizontal(|ui| {
        plot(ui, figures);
        let (worst, mean) = figures.worst_and_mean();
        ui.label(format!("{mean:.0} ms (worst {worst:.0})"));
        ui.separator();
        ui.label(format!(
            "{} visible, {} drawn",
            grouped(figures.visible.into()),
            grouped(figures.drawn.into())
        ));
        ui.label(format!("{} triangles", grouped(figures.triangles)));
        ui.separator();
        ui.label(format!("{} of {}", bytes(figures.resident), bytes(figures.budget)))
            .on_hover_text("Geometry on the GPU");
        ui.label(format!("query {:.0} ms", figures.query_ms));
        if let Some(samples) = figures.shadow_samples {
            ui.label(format!("{samples} shadow rays"));
        }
        if figures.missing > 0 {
            let (what, hint) = match figures.is_complete && figures.failed == 0 {
                true => ("have no room", "Allow more geometry on the GPU, under Limits"),
                false => ("loading", "Their geometry is on its way"),
            };
            let text =
                RichText::new(format!("{} {what}", grouped(figures.missing.into()))).color(Color32::YELLOW);
            ui.label(text).on_hover_text(hint);
        }
        if figures.failed > 0 {
            let text = format!("{} levels could not be loaded", figures.failed);
            ui.label(RichText::new(text).color(Color32::LIGHT_RED))
                .on_hover_text("`voxsight verify` tells more");
        }
        if session.is_frozen {
            ui.label(RichText::new("frozen").color(Color32::LIGHT_BLUE));
        }
        if session.is_recording() {
            ui.label(RichText::new("recording").color(Color32::LIGHT_RED));
        }
        ui.separator();
        if let Some(message) = session.messages.last() {
            let all = session.messages.join("\n");
            ui.add(egui::Label::new(message).truncate()).on_hover_text(all);
        }
    });
}

/// Times as bars, 100 ms high at most; green up to 1/30 s.
fn plot(ui: &mut Ui, figures: &Figures) {
    let (area, _) = ui.allocate_exact_size(vec2(PLOTTED as f32, 16.0), egui::Sense::hover());
    let painter = ui.painter_at(area);
    painter.rect_filled(area, 0.0, ui.visuals().extreme_bg_color);
    for (at, &time) in figures.times.iter().enumerate() {
        let colour =
            if time < 34.0 { Color32::from_rgb(90, 180, 90) } else { Color32::from_rgb(210, 160, 60) };
        let x = area.left() + at as f32 + 0.5;
        let height = (time / 100.0).min(1.0) * area.height();
        let line = [pos2(x, area.bottom()), pos2(x, area.bottom() - height)];
        painter.line_segment(line, egui::Stroke::new(1.0, colour));
    }
}
