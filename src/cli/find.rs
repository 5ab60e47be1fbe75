//! `voxsight find`: objects by name or path.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::Failure;
use super::output::{print_json, print_out};
use crate::container::layout::NONE;
use crate::scene::Scene;

/// Flags of `find`.
#[derive(Args)]
pub struct Find {
    /// The scene
    scene: PathBuf,
    /// Part of a name, or of a value of the extras, upper and lower case alike; with a `/` in it: part of a path
    text: String,
    /// Print the matches as JSON
    #[arg(long)]
    json: bool,
    /// Print no more than so many matches
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    limit: Option<u64>,
}

#[derive(Serialize)]
struct Match {
    node: u32,
    /// The object that the node carries.
    object: Option<u32>,
    path: String,
    name: String,
    /// Objects at or below the node.
    objects_below: u32,
    extras: Option<serde_json::Value>,
}

impl Find {
    pub fn run(self) -> Result<(), Failure> {
        let scene = Scene::open(&self.scene)?;
        let matches =
            scene.find(&self.text).take(self.limit.map_or(usize::MAX, |limit| limit as usize)).map(|node| {
                let record = &scene.nodes()[node as usize];
                let below = scene.subtree_objects(node);
                Match {
                    node,
                    object: (record.object != NONE).then_some(record.object),
                    path: scene.node_path(node),
                    name: scene.name(record.name).to_owned(),
                    objects_below: below.end - below.start,
                    extras: serde_json::from_str(scene.name(record.extras)).ok(),
                }
            });
        let matches: Vec<Match> = matches.collect();
        if self.json {
            print_json(&matches)?;
        }
        for found_node in matches.iter().filter(|_| !self.json) {
            let what = match found_node.object {
                Some(object) => format!("object {object}"),
                None => format!("{} objects", found_node.objects_below),
            };
            print_out!("{}\t{what}", found_node.path)?;
        }
        if matches.is_empty() {
            return Err(format!("nothing in {} matches \"{}\"", self.scene.display(), self.text).into());
        }
        Ok(())
    }
}
