//! Routes: recorded, edited, played, kept.

use std::path::Path;

use super::{GLIDE, Session};
use crate::viewer::route::{Recorder, Route, RouteError, Tolerance};

impl Session {
    pub(super) fn set_recording(&mut self, is_on: bool) -> Result<(), String> {
        if is_on {
            self.keep_route()?;
            self.recording = Some((Recorder::new(Tolerance::default()), 0.0));
            return Ok(());
        }
        let (recorder, _) = self.recording.take().ok_or("nothing is recorded")?;
        let route = recorder.finish().map_err(|error| error.to_string())?;
        self.tell(format!("recorded {:.1} s, {} keyframes", route.duration(), route.keyframes().len()));
        self.route = Some(route);
        self.is_route_saved = false;
        Ok(())
    }

    /// Writes a route that is nowhere else beside the scene, before another takes its place.
    pub(super) fn keep_route(&mut self) -> Result<(), String> {
        if self.is_route_saved || self.route.as_ref().is_none_or(|route| route.keyframes().is_empty()) {
            return Ok(());
        }
        let name = |number: u32| match number {
            1 => self.path.with_extension("route.json"),
            _ => self.path.with_extension(format!("route-{number}.json")),
        };
        let free = (1..).map(name).find(|file| !file.exists()).unwrap_or_else(|| name(1));
        self.export_route(&free)
    }

    pub(super) fn open_route(&mut self, file: &Path) -> Result<(), String> {
        let text =
            std::fs::read_to_string(file).map_err(|e| format!("{}: cannot be read: {e}", file.display()))?;
        let route = Route::from_json(&text).map_err(|e| format!("{}: {e}", file.display()))?;
        self.keep_route()?;
        self.tell(format!(
            "{}: {:.1} s, {} keyframes",
            file.display(),
            route.duration(),
            route.keyframes().len()
        ));
        self.route = Some(route);
        self.is_route_saved = true;
        Ok(())
    }

    pub(super) fn go_to_keyframe(&mut self, index: usize) -> Result<(), String> {
        let keyframes = self.route.as_ref().map_or(&[][..], Route::keyframes);
        let there = keyframes.get(index).ok_or_else(|| format!("there is no keyframe {index}"))?.camera;
        self.glide_to(|navigator| navigator.go_to(&there, GLIDE).map_err(|error| error.to_string()))
    }

    pub(super) fn add_keyframe(&mut self) -> Result<(), String> {
        let camera = self.camera();
        if self.route.is_none() {
            self.route = Some(Route::new(Vec::new(), 30.0).map_err(|error| error.to_string())?);
        }
        self.edit_route(|route| {
            let at = route.keyframes().last().map_or(0.0, |last| last.t + 2.0);
            route.insert(at, camera).map(|_| ())
        })
    }

    pub(super) fn edit_route(
        &mut self,
        edit: impl FnOnce(&mut Route) -> Result<(), RouteError>,
    ) -> Result<(), String> {
        let route = self.route.as_mut().ok_or("there is no route: record one, or open one")?;
        edit(route).map_err(|error| error.to_string())?;
        self.is_route_saved = false;
        Ok(())
    }

    pub(super) fn export_route(&mut self, file: &Path) -> Result<(), String> {
        let route = self.route.as_ref().ok_or("there is no route: record one, or open one")?;
        let text = route.to_json(self.size).map_err(|error| error.to_string())?;
        crate::atomic_file::write_whole(file, text.as_bytes())
            .map_err(|e| format!("{}: {e}", file.display()))?;
        self.is_route_saved = true;
        self.tell(format!("the route is in {}", file.display()));
        Ok(())
    }

    pub(super) fn play(&mut self, seconds: f64) {
        let (Some(playing), Some(route)) = (&mut self.playing, &self.route) else { return };
        playing.seconds += seconds;
        let is_over = playing.seconds >= route.duration();
        let start = route.keyframes().first().map_or(0.0, |first| first.t);
        let camera = route.camera_at(start + playing.seconds.min(route.duration()));
        if let Some(camera) = camera
            && let Err(error) = self.navigator.set_camera(&camera)
        {
            self.tell(format!("the route cannot be played: {error}"));
            self.playing = None;
        } else if is_over {
            self.playing = None;
        }
    }

    pub(super) fn record(&mut self, seconds: f64) {
        let camera = self.camera();
        let Some((recorder, at)) = &mut self.recording else { return };
        *at += seconds.max(1e-6);
        if let Err(error) = recorder.add(*at, camera) {
            self.tell(format!("recording: {error}"));
        }
    }
}
