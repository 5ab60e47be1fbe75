//! What is dragged in the picture: selected parts, section planes.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec2, DVec3};

use super::Session;
use crate::camera::{CameraRays, Plane};
use crate::moved::Motions;
use crate::viewer::document::ObjectSet;
use crate::viewer::handles::{self, Drag, Handle, Shape};
use crate::viewer::measure::LengthUnit;

/// A handle under the mouse button.
pub struct Dragging {
    /// Which.
    pub handle: Handle,
    drag: Drag,
    before: Before,
    /// How far: model units, or radians.
    by: f64,
}

/// What it is dragged from.
enum Before {
    Parts { objects: ObjectSet, motions: Arc<Motions>, centre: DVec3 },
    Plane(Plane),
}

impl Dragging {
    /// How far, for people.
    pub fn shown(&self, unit: &LengthUnit) -> String {
        match self.handle {
            Handle::About(_) => format!("{:.1}\u{b0}", self.by.to_degrees()),
            Handle::Along(_) | Handle::Section(_) => unit.show(self.by),
        }
    }
}

impl Session {
    /// Handles in a picture of this camera.
    pub fn handles(&self, camera: &CameraRays) -> Vec<(Handle, Shape)> {
        let mut all = Vec::new();
        if self.moves_parts
            && let Some(centre) = self.handles_at()
        {
            all.extend(handles::of_selection(camera, centre));
        }
        let bounds = self.bounds();
        for (index, section) in self.document.state().sections.iter().enumerate() {
            if section.is_on
                && let Some(shape) = handles::of_section(camera, &section.plane, bounds)
            {
                all.push((Handle::Section(index), shape));
            }
        }
        all
    }

    /// Where the handles of the selection meet. While it is dragged that is known without looking at all of its parts.
    fn handles_at(&self) -> Option<DVec3> {
        match &self.dragging {
            Some(Dragging {
                before: Before::Parts { centre, .. }, handle: Handle::Along(axis), by, ..
            }) => Some(*centre + *by * axis.unit()),
            Some(Dragging { before: Before::Parts { centre, .. }, .. }) => Some(*centre),
            _ => self.document.middle_of_selection(),
        }
    }

    /// The handle at a place of the picture.
    pub fn handle_at(&self, camera: &CameraRays, cursor: DVec2) -> Option<(Handle, Shape)> {
        handles::under(&self.handles(camera), camera, cursor)
    }

    /// Takes the handle at a place of the picture, if there is one.
    pub fn begin_drag(&mut self, camera: &CameraRays, cursor: DVec2) -> bool {
        let Some((handle, shape)) = self.handle_at(camera, cursor) else { return false };
        let before = match (handle, self.document.middle_of_selection()) {
            (Handle::Section(index), _) => {
                let section = self.document.state().sections.get(index);
                section.map(|section| Before::Plane(section.plane))
            }
            (Handle::Along(_) | Handle::About(_), Some(centre)) => Some(Before::Parts {
                objects: self.document.selected().clone(),
                motions: Arc::clone(&self.document.state().motions),
                centre,
            }),
            (_, None) => None,
        };
        let drag = Drag::begin(shape, &camera.ray(cursor.x, cursor.y));
        let dragging = drag.zip(before);
        self.dragging = dragging.map(|(drag, before)| Dragging { handle, drag, before, by: 0.0 });
        self.document.end_gesture();
        self.dragging.is_some()
    }

    /// Drags it to a place of the picture.
    pub fn drag_to(&mut self, camera: &CameraRays, cursor: DVec2) {
        let (Some(dragging), document) = (&mut self.dragging, &mut self.document) else { return };
        let by = dragging.drag.to(&camera.ray(cursor.x, cursor.y));
        dragging.by = by;
        match (&dragging.before, dragging.handle) {
            (Before::Parts { objects, motions, .. }, Handle::Along(axis)) => {
                document.drag_by("Move", objects, motions, DAffine3::from_translation(by * axis.unit()));
            }
            (Before::Parts { objects, motions, centre }, Handle::About(axis)) => {
                let turn = DQuat::from_axis_angle(axis.unit(), by);
                document.drag_by("Rotate", objects, motions, turn_about(*centre, turn));
            }
            (Before::Plane(plane), Handle::Section(index)) => {
                let point = plane.point + by * plane.normal.normalize_or_zero();
                let name = format!("Move section {}", index + 1);
                document.change_on(&name, |state| {
                    if let Some(section) = state.sections.get_mut(index) {
                        section.plane.point = point;
                    }
                });
            }
            (Before::Parts { .. }, Handle::Section(_)) | (Before::Plane(_), _) => {}
        }
    }

    /// Puts back what is dragged, and lets it go.
    pub fn cancel_drag(&mut self) {
        self.rectangle = None;
        let Some(dragging) = self.dragging.take() else { return };
        match (&dragging.before, dragging.handle) {
            (Before::Parts { motions, .. }, handle) => {
                let name = if matches!(handle, Handle::About(_)) { "Rotate" } else { "Move" };
                self.document.change_on(name, |state| state.motions = Arc::clone(motions));
            }
            (Before::Plane(plane), Handle::Section(index)) => {
                self.document.change_on(&format!("Move section {}", index + 1), |state| {
                    if let Some(section) = state.sections.get_mut(index) {
                        section.plane = *plane;
                    }
                });
            }
            (Before::Plane(_), _) => {}
        }
        self.document.end_gesture();
    }

    /// Lets it go: what it did is one change.
    pub fn end_drag(&mut self) {
        self.dragging = None;
        self.document.end_gesture();
    }
}

/// A turn about a point.
pub(super) fn turn_about(centre: DVec3, turn: DQuat) -> DAffine3 {
    DAffine3::from_translation(centre) * DAffine3::from_quat(turn) * DAffine3::from_translation(-centre)
}
