//! The assembly tree, and the search above it. Only the rows that are to be seen are laid out.

use std::sync::Arc;

use egui::collapsing_header::paint_default_icon;
use egui::{Align, Button, Layout, RichText, ScrollArea, Sense, TextEdit, Ui, vec2};

use crate::human::grouped;
use crate::viewer::action::Action;
use crate::viewer::document::Share;
use crate::viewer::session::Session;
use crate::viewer::tree::Row;

/// Height of a row, points.
const ROW: f32 = 18.0;
/// Indent of a generation, points.
const INDENT: f32 = 14.0;
/// Side of the arrow that opens a row, points.
const ARROW: f32 = 14.0;

/// What was done in a row.
enum Done {
    Opened(bool),
    Selected { add: bool },
    Zoomed,
    Hidden(bool),
    Asked(Action),
}

/// Shows the tree.
pub fn tree(ui: &mut Ui, session: &mut Session) {
    search_line(ui, session);
    counts(ui, session);
    ui.separator();
    let rows = session.tree.rows().len();
    let mut area = ScrollArea::vertical().auto_shrink([false, false]);
    if let Some(row) = session.scroll_to.take() {
        let spacing = ui.spacing().item_spacing.y;
        let above = (row as f32 * (ROW + spacing) - 0.4 * ui.available_height()).max(0.0);
        area = area.vertical_scroll_offset(above);
    }
    let mut done = None;
    area.show_rows(ui, ROW, rows, |ui, seen| {
        for index in seen {
            let Some(row) = session.tree.rows().get(index).copied() else { break };
            if let Some(what) = row_line(ui, session, &row) {
                done = Some((row, what));
            }
        }
    });
    if let Some((row, what)) = done {
        act(session, &row, what);
    }
}

fn search_line(ui: &mut Ui, session: &mut Session) {
    // The button first, from the right: the field takes what is left, and the panel does not grow.
    let size = vec2(ui.available_width(), ui.spacing().interact_size.y);
    ui.allocate_ui_with_layout(size, Layout::right_to_left(Align::Center), |ui| {
        if ui.button("x").on_hover_text("End the search").clicked() {
            session.search_for("");
        }
        let mut text = session.search_text.clone();
        let edit = TextEdit::singleline(&mut text).hint_text("Search by name or part number");
        let field = ui.add_sized([ui.available_width(), ui.spacing().interact_size.y], edit);
        if field.changed() {
            session.search_for(&text);
        }
        // Enter takes the first that was found.
        let is_done = field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
        if is_done && let Some(&first) = session.tree.found().and_then(<[u32]>::first) {
            session.select_node(first, false);
            session.reveal(first);
        }
    });
}

fn counts(ui: &mut Ui, session: &Session) {
    let scene = session.document.scene().scene();
    let text = match session.tree.found() {
        Some(found) => format!("{} found", grouped(found.len() as u64)),
        None => {
            let (nodes, objects) = (scene.nodes().len() as u64, scene.objects().len() as u64);
            format!("{} nodes, {} parts", grouped(nodes), grouped(objects))
        }
    };
    let changes = crate::viewer::document::describe(session.document.state());
    let comma = if changes.is_empty() { "" } else { ", " };
    let told = RichText::new(format!("{text}{comma}{changes}")).weak();
    ui.add(egui::Label::new(told).truncate());
}

/// One row. Tells what was done in it.
fn row_line(ui: &mut Ui, session: &Session, row: &Row) -> Option<Done> {
    let document = &session.document;
    let scene = Arc::clone(document.scene());
    let record = &scene.scene().nodes()[row.node as usize];
    let mut done = None;
    ui.horizontal(|ui| {
        ui.set_min_height(ROW);
        ui.add_space(INDENT * row.depth as f32);
        if row.has_children {
            let (_, arrow) = ui.allocate_exact_size(vec2(ARROW, ARROW), Sense::click());
            paint_default_icon(ui, if row.is_open { 1.0 } else { 0.0 }, &arrow);
            if arrow.clicked() {
                done = Some(Done::Opened(!row.is_open));
            }
        } else {
            ui.allocate_exact_size(vec2(ARROW, ARROW), Sense::hover());
        }
        let share = document.hidden_share(row.node);
        let mut is_shown = share != Share::All;
        let shown = ui.checkbox(&mut is_shown, "").on_hover_text("Shown");
        if shown.changed() {
            done = Some(Done::Hidden(!is_shown));
        }
        let objects = document.objects_of(row.node);
        let count = objects.len();
        let name = scene.scene().name(record.name);
        let name = if name.is_empty() { "(no name)" } else { name };
        let mut text = RichText::new(if count > 1 {
            format!("{name}  {}", grouped(count as u64))
        } else {
            name.to_owned()
        });
        if share != Share::None {
            text = text.weak();
        }
        if document.seen_through_share(row.node) != Share::None {
            text = text.italics();
        }
        if row.is_found {
            text = text.strong();
        }
        let is_selected = count > 0 && document.selected().count_of(objects) as usize == count;
        let is_marked = is_selected || session.current == Some(row.node);
        let label = ui.add(Button::selectable(is_marked, text).truncate());
        if label.double_clicked() {
            done = Some(Done::Zoomed);
        } else if label.clicked() {
            done = Some(Done::Selected { add: ui.input(|input| input.modifiers.command) });
        }
        label.context_menu(|ui| {
            for (text, action) in [
                ("Zoom to", Action::ZoomToSelection),
                ("Hide", Action::Hide),
                ("Show", Action::Show),
                ("Isolate", Action::Isolate),
                ("X-ray", Action::Xray),
                ("Opaque", Action::Opaque),
            ] {
                if ui.button(text).clicked() {
                    done = Some(Done::Asked(action));
                    ui.close();
                }
            }
        });
    });
    done
}

fn act(session: &mut Session, row: &Row, what: Done) {
    let scene = Arc::clone(session.document.scene());
    match what {
        Done::Opened(is_open) => session.tree.set_open(scene.scene(), row.node, is_open),
        Done::Selected { add } => session.select_node(row.node, add),
        Done::Zoomed => {
            session.select_node(row.node, false);
            session.act_or_tell(&Action::ZoomToSelection);
        }
        Done::Hidden(is_hidden) => {
            let objects = session.document.objects_of(row.node);
            session.document.set_hidden(objects, is_hidden);
        }
        Done::Asked(action) => {
            // What is selected with it is meant, too.
            let objects = session.document.objects_of(row.node);
            let count = objects.len();
            if count == 0 || session.document.selected().count_of(objects) as usize != count {
                session.select_node(row.node, false);
            }
            session.act_or_tell(&action);
        }
    }
}
