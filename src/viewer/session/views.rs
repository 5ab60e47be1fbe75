//! Saved views.

use std::sync::Arc;

use super::{GLIDE, Session};
use crate::viewer::bookmarks::{Bookmark, Bookmarks, Thumbnail, find_nodes, node_paths};
use crate::viewer::document::{ObjectSet, Section};

impl Session {
    /// What is seen now, to be remembered by a name.
    pub(super) fn view(&self, name: &str) -> Bookmark {
        let scene = self.document.scene().scene();
        let paths = |objects: &ObjectSet| -> Vec<String> {
            let mut nodes: Vec<u32> =
                objects.iter().map(|object| scene.objects()[object as usize].node).collect();
            nodes.dedup();
            node_paths(scene, &nodes)
        };
        let state = self.document.state();
        // The shorter list: of a large plant with one pump isolated, the pump.
        let count = scene.objects().len() as u32;
        let mut shown = ObjectSet::default();
        if 2 * state.hidden.count() > count && state.hidden.count() < count {
            (0..count).filter(|&object| !state.hidden.has(object)).for_each(|object| shown.set(object, true));
        }
        let hidden = if shown.count() > 0 { Vec::new() } else { paths(&state.hidden) };
        Bookmark {
            name: name.to_owned(),
            camera: self.camera(),
            hidden,
            shown: paths(&shown),
            xray: paths(&state.seen_through),
            planes: self.document.planes().map(Into::into).collect(),
            thumbnail: None,
        }
    }

    /// Saves the views that are to be remembered, with what they look like.
    pub fn save_wanted(&mut self, picture: Option<&image::RgbImage>) {
        let thumbnail = picture.and_then(Thumbnail::new);
        let wanted = std::mem::take(&mut self.wanted_bookmarks);
        if wanted.is_empty() {
            return;
        }
        self.change_bookmarks(|bookmarks| {
            for view in wanted {
                bookmarks
                    .add(Bookmark { thumbnail: thumbnail.clone(), ..view })
                    .map_err(|e| e.to_string())?;
            }
            Ok(())
        });
    }

    /// Changes the views of the file, which others may have changed meanwhile, and takes them over.
    fn change_bookmarks(&mut self, change: impl FnOnce(&mut Bookmarks) -> Result<(), String>) {
        let mut done = Ok(());
        let changed = Bookmarks::change(&Bookmarks::path_beside(&self.path), |views| done = change(views));
        match changed {
            Ok(bookmarks) => self.bookmarks = bookmarks,
            Err(error) => done = Err(error.to_string()),
        }
        if let Err(told) = done {
            self.tell(told);
        }
    }

    fn bookmark(&self, name: &str) -> Result<&Bookmark, String> {
        Ok(&self.bookmarks.views()[place_of(&self.bookmarks, name)?])
    }

    pub(super) fn go_to_bookmark(&mut self, name: &str) -> Result<(), String> {
        let view = self.bookmark(name)?.clone();
        let scene = Arc::clone(self.document.scene());
        let (hidden, xray) = (find_nodes(scene.scene(), &view.hidden), find_nodes(scene.scene(), &view.xray));
        let shown = find_nodes(scene.scene(), &view.shown);
        let missing = hidden.missing + shown.missing + xray.missing;
        let own_objects = |nodes: &[u32]| {
            let mut set = ObjectSet::default();
            let objects = scene.scene().objects();
            for &node in nodes {
                let first = objects.partition_point(|object| object.node < node);
                let own = objects[first..].iter().take_while(|object| object.node == node).count();
                (first..first + own).for_each(|object| set.set(object as u32, true));
            }
            set
        };
        let sections = view.planes.iter().enumerate().map(|(number, &plane)| Section {
            name: format!("Plane {}", number + 1),
            plane: plane.into(),
            is_on: true,
        });
        let sections: Vec<Section> = sections.collect();
        self.document.change("Go to a view", |state| {
            let mut left_out = own_objects(&hidden.nodes);
            if !view.shown.is_empty() {
                let shown = own_objects(&shown.nodes);
                let all = 0..scene.scene().objects().len() as u32;
                all.filter(|&object| !shown.has(object)).for_each(|object| left_out.set(object, true));
            }
            state.hidden = Arc::new(left_out);
            state.seen_through = Arc::new(own_objects(&xray.nodes));
            state.sections = sections;
        });
        if missing > 0 {
            self.tell(format!("{missing} parts of the view \"{name}\" are not in this scene any more"));
        }
        self.glide_to(|navigator| navigator.go_to(&view.camera, GLIDE).map_err(|error| error.to_string()))
    }

    pub(super) fn rename_bookmark(&mut self, name: &str, to: &str) -> Result<(), String> {
        self.bookmark(name)?;
        if to.trim().is_empty() {
            return Err("a saved view needs a name".to_owned());
        }
        self.change_bookmarks(|bookmarks| {
            let at = place_of(bookmarks, name)?;
            bookmarks.rename(at, to.trim());
            Ok(())
        });
        Ok(())
    }

    pub(super) fn remove_bookmark(&mut self, name: &str) -> Result<(), String> {
        self.bookmark(name)?;
        self.change_bookmarks(|bookmarks| {
            bookmarks.remove(place_of(bookmarks, name)?);
            Ok(())
        });
        Ok(())
    }
}

/// Where the view of a name is in the list.
fn place_of(bookmarks: &Bookmarks, name: &str) -> Result<usize, String> {
    let at = bookmarks.views().iter().position(|view| view.name == name);
    at.ok_or_else(|| format!("there is no saved view \"{name}\""))
}
