//! Rows of trees, large ones among them.

use voxsight::model::{Colour, Model, Node, Object, Part};
use voxsight::viewer::tree::Tree;

use super::common::{Random, build_model, load, sheet};

/// Nodes in pre-order, some with an object.
fn forest(seed: u64, nodes: u32, objects: u32) -> Model {
    let mut random = Random::new(seed);
    let mut model = Model::default();
    model.parts.push(Part { name: "sheet".to_owned(), mesh: sheet(1) });
    let mut chain: Vec<u32> = Vec::new();
    for node in 0..nodes {
        // Inside of the one before, or of one of its ancestors.
        chain.truncate(chain.len() - random.below(chain.len() as u32 + 1) as usize % 4);
        let parent = chain.last().copied();
        chain.push(node);
        let name = format!("{} {node}", ["pump", "valve", "Rohr"][random.below(3) as usize]);
        model.nodes.push(Node { name, parent, ..Node::default() });
    }
    for object in 0..objects {
        let at = glam::DVec3::new(f64::from(object % 100), f64::from(object / 100), 0.0);
        let world_from_part = glam::DAffine3::from_translation(2.0 * at);
        let node = object * (nodes / objects);
        model.objects.push(Object { node, part: 0, world_from_part, colour: Colour([200, 200, 200, 255]) });
    }
    model
}

#[test]
fn rows_are_those_of_opened_nodes_and_of_what_was_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("forest.vxs");
    for seed in 1..6 {
        build_model(forest(seed, 400, 40), 6, &path);
        let scene = load(&path);
        let scene = scene.scene();
        let nodes = scene.nodes();
        let parent = |node: u32| Some(nodes[node as usize].parent).filter(|&p| (p as usize) < nodes.len());
        let mut tree = Tree::new(scene);
        let mut random = Random::new(seed);
        let mut open: std::collections::HashSet<u32> =
            tree.rows().iter().filter(|row| row.is_open).map(|row| row.node).collect();
        let above = |node: u32| std::iter::successors(parent(node), |&node| parent(node));
        for round in 0..200 {
            let row = tree.rows()[random.below(tree.rows().len() as u32) as usize];
            let is_open = random.below(3) > 0;
            tree.set_open(scene, row.node, is_open);
            if is_open {
                open.insert(row.node)
            } else {
                open.remove(&row.node)
            };
            let expected: Vec<u32> = (0..nodes.len() as u32)
                .filter(|&node| above(node).all(|ancestor| open.contains(&ancestor)))
                .collect();
            let found: Vec<u32> = tree.rows().iter().map(|row| row.node).collect();
            assert_eq!(found, expected, "seed {seed}, round {round}");
            assert!(tree.rows().iter().all(|row| row.depth as usize == above(row.node).count()));
        }
        let wanted: Vec<u32> = scene.find("pump").collect();
        tree.set_found(scene, Some(wanted.clone()));
        let found: Vec<u32> = tree.rows().iter().filter(|row| row.is_found).map(|row| row.node).collect();
        assert_eq!(found, wanted, "seed {seed}: all that was found has a row");
        for row in tree.rows().iter().filter(|row| !row.is_found) {
            let end = nodes[row.node as usize].subtree_end;
            let leads = wanted.iter().any(|&node| node > row.node && node < end);
            let inside =
                above(row.node).any(|ancestor| wanted.contains(&ancestor) && open.contains(&ancestor));
            assert!(leads || inside, "seed {seed}: node {} was not found", row.node);
        }
        tree.set_found(scene, None);
        let last = nodes.len() as u32 - 1;
        let at = tree.reveal(scene, last).unwrap();
        assert_eq!(tree.rows()[at].node, last);
    }
}

#[test]
fn two_hundred_thousand_nodes_are_listed_and_few_are_laid_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("forest.vxs");
    build_model(forest(9, 200_000, 1000), 6, &path);
    let mut session = super::session(&path);
    let scene = std::sync::Arc::clone(session.document.scene());
    session.tree.set_found(scene.scene(), Some((0..200_000).collect()));
    assert_eq!(session.tree.rows().len(), 200_000);
    session.scroll_to = Some(150_000);
    let mut harness = egui_kittest::Harness::builder()
        .with_size(egui::vec2(300.0, 600.0))
        .build_ui_state(voxsight::viewer::panels::tree, session);
    harness.run_steps(3);
    use egui_kittest::kittest::NodeT;
    let laid_out = harness.root().children_recursive().count();
    println!("{laid_out} widgets for 200,000 rows");
    assert!((20..600).contains(&laid_out), "{laid_out}");
    use egui_kittest::kittest::Queryable;
    let name = scene.scene().name(scene.scene().nodes()[150_000].name).to_owned();
    assert!(harness.query_by_label_contains(&name).is_some(), "row 150,000 is in view");
}
