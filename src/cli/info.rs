//! `voxsight info`: what a scene holds.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::Failure;
use super::output::{human_bytes, print_json, print_out};
use crate::container::layout::{LevelRecord, NONE, SectionKind};
use crate::human::grouped;
use crate::scene::Scene;
use crate::streaming::PageLayout;

/// Flags of `info`.
#[derive(Args)]
pub struct Info {
    /// The scene
    scene: PathBuf,
    /// Print the assembly tree; nodes with geometry are marked *
    #[arg(long)]
    tree: bool,
    /// Print everything as JSON
    #[arg(long)]
    json: bool,
}

impl Info {
    pub fn run(self) -> Result<(), Failure> {
        let scene = Scene::open(&self.scene)?;
        match (self.json, self.tree) {
            (true, _) => print_json(&as_json(&scene, self.tree))?,
            (false, true) => print_tree(&scene)?,
            (false, false) => print_summary(&scene)?,
        }
        Ok(())
    }
}

fn as_json(scene: &Scene, tree: bool) -> serde_json::Value {
    let container = scene.container();
    let sections: serde_json::Map<_, _> = SectionKind::ALL
        .into_iter()
        .map(|kind| (kind.name().to_owned(), json!(container.section_length(kind))))
        .collect();
    let meta = scene.meta();
    let mut value = json!({
        "bounds": meta.bounds,
        "counts": meta.counts,
        "file_bytes": container.file_length(),
        "section_bytes": sections,
        "grid": meta.grid,
        "dag": meta.dag,
        "resident_bytes": { "level_0": resident_bytes(scene).0, "all_levels": resident_bytes(scene).1 },
        "settings": meta.settings,
        "sources": meta.sources,
        "generator": meta.generator,
        "report": scene.report(),
    });
    if tree {
        let nodes = scene.nodes().iter().enumerate().map(|(id, node)| {
            json!({
                "id": id,
                "name": scene.name(node.name),
                "parent": (node.parent != NONE).then_some(node.parent),
                "object": (node.object != NONE).then_some(node.object),
            })
        });
        value["tree"] = nodes.collect();
    }
    value
}

fn print_tree(scene: &Scene) -> Result<(), Failure> {
    // Open ancestors: the end of each one's subtree.
    let mut open: Vec<u32> = Vec::new();
    for (id, node) in scene.nodes().iter().enumerate() {
        while open.last().is_some_and(|&end| end as usize <= id) {
            open.pop();
        }
        let mark = if node.object == NONE { "" } else { " *" };
        print_out!("{:indent$}{}{mark}", "", scene.name(node.name), indent = 2 * open.len())?;
        open.push(node.subtree_end);
    }
    Ok(())
}

fn print_summary(scene: &Scene) -> Result<(), Failure> {
    let meta = scene.meta();
    let counts = &meta.counts;
    let container = scene.container();
    let geometry = container.section_length(SectionKind::Geometry);
    let unit = &meta.settings.unit;
    let size = [0, 1, 2].map(|k| meta.bounds.max[k] - meta.bounds.min[k]);
    print_out!(
        "file        {}, written by {} {}",
        human_bytes(container.file_length()),
        meta.generator.name,
        meta.generator.version
    )?;
    for source in &meta.sources {
        print_out!("source      {} ({})", source.name, human_bytes(source.bytes))?;
    }
    print_out!(
        "model       {} objects, {} parts, {} tree nodes",
        grouped(counts.objects),
        grouped(counts.parts),
        grouped(counts.nodes)
    )?;
    print_out!(
        "triangles   {} placed, {} stored",
        grouped(counts.placed_triangles),
        grouped(counts.unique_triangles)
    )?;
    print_out!(
        "size        {:.6} x {:.6} x {:.6} {unit}, {:?} up",
        size[0],
        size[1],
        size[2],
        meta.settings.up
    )?;
    let corner = |[x, y, z]: [f64; 3]| format!("[{x:.6}, {y:.6}, {z:.6}]");
    print_out!("bounds      {} to {}", corner(meta.bounds.min), corner(meta.bounds.max))?;
    print_out!(
        "geometry    {} in {} levels of {} chunks, {:.2} bytes a stored triangle",
        human_bytes(geometry),
        grouped(counts.levels),
        grouped(counts.chunks),
        geometry as f64 / counts.unique_triangles.max(1) as f64
    )?;
    let (finest, all) = resident_bytes(scene);
    print_out!(
        "in memory   {} for level 0 of all ({:.2} bytes a stored triangle), {} for all levels",
        human_bytes(finest),
        finest as f64 / counts.unique_triangles.max(1) as f64,
        human_bytes(all)
    )?;
    let dag_bytes =
        container.section_length(SectionKind::DagNodes) + container.section_length(SectionKind::DagLeaves);
    let owners = container.section_length(SectionKind::OwnerDirectory)
        + container.section_length(SectionKind::OwnerPages);
    print_out!(
        "voxels      {}^3 of {:.6} {unit}: {} occupied in {} bricks",
        meta.settings.resolution,
        meta.grid.voxel_size,
        grouped(meta.dag.voxel_count),
        grouped(meta.dag.brick_count)
    )?;
    print_out!(
        "dag         {} ({:.3} bits a voxel), owners {} ({:.2} bytes a brick)",
        human_bytes(dag_bytes),
        8.0 * dag_bytes as f64 / meta.dag.voxel_count.max(1) as f64,
        human_bytes(owners),
        owners as f64 / meta.dag.brick_count.max(1) as f64
    )?;
    if scene.report().findings.0.is_empty() {
        print_out!("repairs     none")?;
    }
    for (what, finding) in &scene.report().findings.0 {
        print_out!("repairs     {} {what} (first: {})", grouped(finding.count), finding.first)?;
    }
    Ok(())
}

/// Bytes that the pages of all chunks take on a GPU: at level 0, at all levels.
fn resident_bytes(scene: &Scene) -> (u64, u64) {
    let bytes = |level: &LevelRecord| u64::from(PageLayout::of(level).bytes);
    let finest = scene.chunks().iter().map(|chunk| bytes(&scene.levels()[chunk.first_level as usize])).sum();
    (finest, scene.levels().iter().map(bytes).sum())
}
