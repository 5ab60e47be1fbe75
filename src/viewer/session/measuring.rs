//! Measuring from point to point.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use glam::{DAffine3, DVec2};

use super::Session;
use crate::camera::CameraRays;
use crate::shown::Shown;
use crate::viewer::measure::{Features, Measurement, Snap, SnapView, snap};
use crate::viewer::pick::Picked;

/// How near the cursor a vertex or an edge is snapped to, pixels.
const SNAP_PIXELS: f64 = 10.0;

/// Measuring from point to point.
#[derive(Default)]
pub struct Measuring {
    /// Do clicks measure?
    pub is_on: bool,
    /// The first point of the next one.
    pub from: Option<Snap>,
    /// Done.
    pub done: Vec<Measurement>,
    /// Points that are being worked out, in order: parts may have millions of triangles.
    under_way: VecDeque<Receiver<Snapped>>,
    /// What of an object can be snapped to; the newest.
    features: Option<Known>,
}

/// An object, and what of it can be snapped to.
type Known = (u32, Arc<Features>);
type Snapped = (Known, Snap);

impl Measuring {
    /// Is a point being worked out?
    pub fn is_busy(&self) -> bool {
        !self.under_way.is_empty()
    }

    /// Forgets all points.
    pub fn clear(&mut self) {
        *self = Measuring { is_on: self.is_on, ..Measuring::default() };
    }

    /// Takes the points that are ready. Has a thread died over one?
    pub(super) fn take(&mut self) -> bool {
        let mut has_died = false;
        while let Some(first) = self.under_way.front() {
            match first.try_recv() {
                Err(TryRecvError::Empty) => break,
                Err(TryRecvError::Disconnected) => has_died = true,
                Ok((known, found)) => {
                    self.features = Some(known);
                    match self.from.take() {
                        None => self.from = Some(found),
                        Some(from) => self.done.push(Measurement { from, to: found }),
                    }
                }
            }
            self.under_way.pop_front();
        }
        has_died
    }
}

impl Session {
    /// A click while measuring: the first point, or the second; [`Session::advance`] takes it when it is there.
    ///
    /// # Errors
    ///
    /// The system has no more threads.
    pub fn measure_at(
        &mut self,
        camera: &CameraRays,
        shown: &Arc<Shown>,
        cursor: DVec2,
        picked: &Picked,
    ) -> std::io::Result<()> {
        let object = shown.scene().scene().drawable_object(picked.drawable);
        let known = self.measuring.features.clone().filter(|(of, _)| *of == object);
        let (camera, shown, picked) = (*camera, Arc::clone(shown), *picked);
        let (tell, found) = channel();
        let told = Arc::clone(&self.told);
        std::thread::Builder::new().name("measure".into()).spawn(move || {
            let scene = shown.scene().scene();
            let features = known.map(|(_, features)| features).unwrap_or_else(|| {
                // All of it, or the borders of its chunks would be edges.
                let drawables = scene.object_drawables(object);
                Arc::new(Features::of_drawables(shown.scene().query().exact, drawables))
            });
            let moved = shown.moved().and_then(|moved| moved.world_from_part(object));
            let world_from_part: DAffine3 = moved.unwrap_or_else(|| scene.world_from_part(object));
            let view = SnapView { camera: &camera, filter: shown.filter(), world_from_part };
            let snapped = snap(&features, &view, cursor, SNAP_PIXELS, &picked);
            // Nobody waits any more: the points were forgotten.
            let _ = tell.send(((object, features), snapped));
            told();
        })?;
        self.measuring.under_way.push_back(found);
        Ok(())
    }
}
