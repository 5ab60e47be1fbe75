//! The panels, as a user clicks them.

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use voxsight::viewer::panels::{Figures, properties, status, toolbar, tree};
use voxsight::viewer::session::Session;

use super::{Sample, wait_for};

/// All panels, one below the other.
fn harness(session: Session) -> Harness<'static, Session> {
    Harness::builder().with_size(egui::vec2(900.0, 2400.0)).build_ui_state(
        |ui, session| {
            toolbar(ui, session);
            properties_in(ui, session);
            status(ui, session, &Figures::default());
            tree(ui, session);
        },
        session,
    )
}

fn properties_in(ui: &mut egui::Ui, session: &mut Session) {
    ui.allocate_ui(egui::vec2(900.0, 1400.0), |ui| {
        properties(ui, session, &|objects| (objects.len() as u32, 7777))
    });
}

/// A row of the tree, which comes last; the name may stand elsewhere, too.
fn row<'h>(harness: &'h Harness<'static, Session>, name: &'h str) -> egui_kittest::Node<'h> {
    harness.get_all_by_label(name).last().unwrap()
}

#[test]
fn a_part_is_searched_selected_hidden_and_shown_again() {
    let sample = Sample::new();
    let mut harness = harness(sample.session());
    harness.run_steps(2);
    let scene = std::sync::Arc::clone(harness.state().document.scene());
    let scene = scene.scene();
    // A name that no other node has in its own.
    let names = || scene.objects().iter().map(|object| scene.name(scene.nodes()[object.node as usize].name));
    let name = names().find(|name| scene.find(name).count() == 1).unwrap().to_owned();
    // The tree comes last.
    let field = |harness: &Harness<'static, Session>| {
        let fields = harness.get_all_by(|node| node.role() == egui::accesskit::Role::TextInput);
        fields.last().unwrap().focus();
    };
    field(&harness);
    harness.run_steps(1);
    let fields = harness.get_all_by(|node| node.role() == egui::accesskit::Role::TextInput);
    fields.last().unwrap().type_text(&name);
    harness.run_steps(2);
    assert_eq!(harness.state().search_text, name);
    wait_for(harness.state_mut(), "an answer", |session| session.tree.found().is_some());
    harness.run_steps(2);
    row(&harness, &name).click();
    harness.run_steps(2);
    assert_eq!(harness.state().document.selected().count(), 1);
    assert!(harness.query_by_label_contains("Triangles by level").is_some(), "its properties are shown");
    assert!(harness.query_all_by_label("7,777").count() > 0, "pixels in view");
    harness.get_by_label("Hide").click();
    harness.run_steps(2);
    assert_eq!(harness.state().document.state().hidden.count(), 1);
    harness.get_by_label("Undo").click();
    harness.run_steps(2);
    assert_eq!(harness.state().document.state().hidden.count(), 0);
    harness.get_by_label("Isolate").click();
    harness.run_steps(2);
    let all = scene.objects().len() as u32;
    assert_eq!(
        harness.state().document.state().hidden.count(),
        0,
        "nothing was selected: {:?}",
        harness.state().messages
    );
    assert_eq!(harness.state().messages.last().map(String::as_str), Some("nothing is selected"));
    row(&harness, &name).click();
    harness.run_steps(2);
    harness.get_by_label("Isolate").click();
    harness.run_steps(2);
    assert_eq!(harness.state().document.state().hidden.count(), all - 1);
    harness.get_by_label("Show all").click();
    harness.run_steps(2);
    assert_eq!(harness.state().document.state().hidden.count(), 0);
}

#[test]
fn sections_views_and_modes_have_buttons() {
    let sample = Sample::new();
    let mut harness = harness(sample.session());
    harness.run_steps(2);
    harness.get_all_by_label("Across Z").next().unwrap().click();
    harness.run_steps(2);
    assert_eq!(harness.state().document.planes().count(), 1);
    let before = harness.state().document.planes().next().unwrap().normal;
    harness.get_by_label("Flip").click();
    harness.run_steps(2);
    assert_eq!(harness.state().document.planes().next().unwrap().normal, -before);
    harness.get_by_label("Walk").click();
    harness.run_steps(2);
    assert_eq!(harness.state().navigator.mode(), voxsight::viewer::navigate::Mode::Walk);
    harness.get_by_label("Save this view").click();
    harness.run_steps(2);
    assert_eq!(harness.state().wanted_bookmarks.len(), 1, "the window adds its picture");
    harness.get_by_label("Shadows").click();
    harness.run_steps(2);
    assert!(harness.state().preferences.shadows);
    harness.get_by_label("Record").click();
    harness.run_steps(2);
    assert!(harness.state().is_recording());
}
