//! Camera paths from files: keyframes in, frames out.
//!
//! `{"keyframes":[{"t":0.0, ...camera...}, ...], "fps":30}`; a plain list of cameras is a path with a second between
//! two of them. Eye and target follow a Catmull-Rom spline through the keyframes (its tangents weighted by time, so that
//! uneven keyframes make no overshoot in time); a keyframe with `"cut":true` jumps. What a keyframe does not say (`up`, `fov_y_deg` or
//! `ortho_height`, `width`, `height`) is as in the one before.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::views::View;
use crate::camera::{Camera, CameraError, Projection};

/// Most frames of a path: an hour at 60 frames a second.
pub(crate) const MAX_FRAMES: f64 = 216_000.0;
/// Frames a second where nothing is said.
pub(crate) const DEFAULT_FPS: f64 = 30.0;

/// A camera at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keyframe {
    /// Seconds.
    pub t: f64,
    /// Where it is then.
    pub camera: Camera,
    /// It is jumped to: nothing is interpolated between the keyframe before and this one.
    pub cut: bool,
}

/// Keyframes by rising time, and frames a second.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath {
    keyframes: Vec<Keyframe>,
    fps: f64,
}

/// Why a path cannot be used. Keyframes are counted from 0.
#[derive(Debug, thiserror::Error)]
pub enum PathError {
    /// Not JSON, or not a path.
    #[error(
        "{0}; expected {{\"keyframes\":[{{\"t\":0.0,\"eye\":[x,y,z],\"target\":[x,y,z],\"up\":[x,y,z],\
         \"fov_y_deg\":60,\"width\":1024,\"height\":1024}}, {{\"t\":1.0,\"eye\":[x,y,z],\"target\":[x,y,z]}}, ...],\
         \"fps\":30}}, or a list of cameras"
    )]
    Json(#[from] serde_json::Error),
    /// No keyframe.
    #[error("the path has no keyframes")]
    Empty,
    /// Times fall, repeat, or are no numbers.
    #[error("keyframe {0} must come later than the one before")]
    Time(usize),
    /// Frames a second.
    #[error("fps must be above 0 and at most 1000; it is {0}")]
    Fps(f64),
    /// Too long.
    #[error("the path has {0:.0} frames; at most 216,000 are possible")]
    TooLong(f64),
    /// Sizes or projections of neighbours differ.
    #[error(
        "keyframes {before} and {0} differ in size or kind of projection: mark the second with \"cut\":true, \
         and give all the same size",
        before = .0 - 1
    )]
    Mixed(usize),
    /// A keyframe, or a frame between two.
    #[error("{frame}: {source}")]
    Camera {
        /// `keyframe 3` or `frame 17`.
        frame: String,
        /// What is wrong.
        source: CameraError,
    },
}

#[derive(Deserialize)]
#[serde(untagged)]
enum PathFile {
    Cameras(Vec<Value>),
    Path(KeyframeFile),
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyframeFile {
    keyframes: Vec<Value>,
    #[serde(default = "default_fps")]
    fps: f64,
}

fn default_fps() -> f64 {
    DEFAULT_FPS
}

impl CameraPath {
    /// A path of these keyframes.
    ///
    /// # Errors
    ///
    /// It cannot be walked.
    pub fn new(keyframes: Vec<Keyframe>, fps: f64) -> Result<Self, PathError> {
        let path = CameraPath { keyframes, fps };
        path.check()?;
        Ok(path)
    }

    /// By rising time, at least one.
    pub fn keyframes(&self) -> &[Keyframe] {
        &self.keyframes
    }

    /// Frames a second.
    pub fn fps(&self) -> f64 {
        self.fps
    }

    /// The text that [`CameraPath::from_json`] reads as this path again, to the last bit.
    ///
    /// # Errors
    ///
    /// None that is known: all numbers of a checked path are finite.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        let mut keyframes = Vec::with_capacity(self.keyframes.len());
        for Keyframe { t, camera, cut } in &self.keyframes {
            let mut value = serde_json::to_value(camera)?;
            if let Some(fields) = value.as_object_mut() {
                fields.insert("t".into(), serde_json::to_value(t)?);
                if *cut {
                    fields.insert("cut".into(), true.into());
                }
            }
            keyframes.push(value);
        }
        serde_json::to_string(&KeyframeFile { keyframes, fps: self.fps })
    }

    /// Reads a path; `size` replaces the size of its cameras.
    ///
    /// # Errors
    ///
    /// It is not a path, or one that cannot be walked.
    pub fn from_json(text: &str, size: Option<(u32, u32)>) -> Result<Self, PathError> {
        let mut path = match serde_json::from_str(text)? {
            PathFile::Cameras(mut cameras) => {
                inherit(&mut cameras, size);
                let cameras = cameras.into_iter().enumerate().map(|(index, value)| camera(index, value));
                let timed = |(t, camera): (u32, Result<Camera, _>)| {
                    Ok(Keyframe { t: t.into(), camera: camera?, cut: false })
                };
                let keyframes: Result<_, PathError> = (0..).zip(cameras).map(timed).collect();
                CameraPath { keyframes: keyframes?, fps: DEFAULT_FPS }
            }
            PathFile::Path(mut file) => {
                inherit(&mut file.keyframes, size);
                let keyframes = file.keyframes.into_iter().enumerate();
                let keyframes: Result<_, _> =
                    keyframes.map(|(index, value)| keyframe(index, value)).collect();
                CameraPath { keyframes: keyframes?, fps: file.fps }
            }
        };
        if let Some((width, height)) = size {
            for keyframe in &mut path.keyframes {
                (keyframe.camera.width, keyframe.camera.height) = (width, height);
            }
        }
        path.check()?;
        Ok(path)
    }

    fn check(&self) -> Result<(), PathError> {
        let Some(last) = self.keyframes.last() else { return Err(PathError::Empty) };
        if !(self.fps > 0.0 && self.fps <= 1000.0) {
            return Err(PathError::Fps(self.fps));
        }
        for (index, keyframe) in self.keyframes.iter().enumerate() {
            keyframe
                .camera
                .rays()
                .map_err(|source| PathError::Camera { frame: format!("keyframe {index}"), source })?;
        }
        for (index, pair) in self.keyframes.windows(2).enumerate() {
            let [before, after] = pair else { continue };
            if !(after.t > before.t && after.t.is_finite() && before.t.is_finite()) {
                return Err(PathError::Time(index + 1));
            }
            let (a, b) = (before.camera, after.camera);
            let same_kind =
                std::mem::discriminant(&a.projection) == std::mem::discriminant(&b.projection) || after.cut;
            if !same_kind || (a.width, a.height) != (b.width, b.height) {
                return Err(PathError::Mixed(index + 1));
            }
        }
        let frames = (last.t - self.keyframes.first().map_or(0.0, |first| first.t)) * self.fps;
        if frames < MAX_FRAMES { Ok(()) } else { Err(PathError::TooLong(frames)) }
    }

    /// All frames, a `1 / fps` apart.
    ///
    /// # Errors
    ///
    /// Between two keyframes eye and target meet, or the view comes to lie along `up`.
    pub fn views(&self) -> Result<Vec<View>, PathError> {
        let (Some(first), Some(last)) = (self.keyframes.first(), self.keyframes.last()) else {
            return Err(PathError::Empty);
        };
        // A frame that falls on the last keyframe but for rounding is there.
        let count = ((last.t - first.t) * self.fps + 1e-6).floor() as u32 + 1;
        let mut segment_before = None;
        (0..count)
            .map(|frame| {
                let t = (first.t + f64::from(frame) / self.fps).min(last.t);
                let (segment, camera) = self.at(t);
                let name = format!("frame {frame}");
                camera.rays().map_err(|source| PathError::Camera { frame: name.clone(), source })?;
                let starts_anew = segment_before != Some(segment);
                segment_before = Some(segment);
                Ok(View { name, camera, starts_anew })
            })
            .collect()
    }

    /// The camera at a time, and which of the pieces between cuts it is in. Before the first keyframe it is there.
    ///
    /// Not checked: between two keyframes eye and target may meet, and the view may come to lie along `up`.
    pub fn at(&self, t: f64) -> (usize, Camera) {
        let keys = &self.keyframes;
        // `check` wants one at least.
        let t = t.max(keys[0].t);
        let after = keys.partition_point(|key| key.t <= t).clamp(1, keys.len());
        let piece = keys[..after].iter().filter(|key| key.cut).count();
        let from = &keys[after - 1];
        let Some(to) = keys.get(after).filter(|to| !to.cut) else { return (piece, from.camera) };
        // Neighbours beyond a cut are not neighbours.
        let before = keys[..after - 1].last().filter(|_| !from.cut);
        let beyond = keys.get(after + 1).filter(|key| !key.cut);
        (piece, between(before, from, to, beyond, t))
    }
}

/// The camera at a time between two keyframes; `before` and `beyond` are their neighbours of the same piece.
pub fn between(
    before: Option<&Keyframe>,
    from: &Keyframe,
    to: &Keyframe,
    beyond: Option<&Keyframe>,
    t: f64,
) -> Camera {
    let share = (t - from.t) / (to.t - from.t);
    let spline = |of: fn(&Camera) -> DVec3| {
        let point = |key: &Keyframe| (key.t, of(&key.camera));
        hermite(before.map(point), point(from), point(to), beyond.map(point), share)
    };
    let up = DVec3::from(from.camera.up).lerp(to.camera.up.into(), share);
    let projection = match (from.camera.projection, to.camera.projection) {
        (Projection::Perspective { fov_y_deg: a }, Projection::Perspective { fov_y_deg: b }) => {
            Projection::Perspective { fov_y_deg: a + share * (b - a) }
        }
        (Projection::Orthographic { height: a }, Projection::Orthographic { height: b }) => {
            Projection::Orthographic { height: a + share * (b - a) }
        }
        // `CameraPath::check` lets this through only before a cut, where nothing is interpolated.
        (kept, _) => kept,
    };
    Camera {
        eye: spline(|camera| camera.eye.into()).into(),
        target: spline(|camera| camera.target.into()).into(),
        up: up.into(),
        projection,
        ..from.camera
    }
}

/// A keyframe is a camera with two more fields; cameras refuse fields that they do not know.
fn keyframe(index: usize, mut value: Value) -> Result<Keyframe, PathError> {
    let Some(fields) = value.as_object_mut() else { return Err(wrong(index, "it is no object")) };
    let t = fields.remove("t").and_then(|t| t.as_f64());
    let t = t.ok_or_else(|| wrong(index, "it has no time \"t\""))?;
    let cut = fields.remove("cut").map_or(Ok(false), serde_json::from_value);
    let cut = cut.map_err(|error| wrong(index, error))?;
    Ok(Keyframe { t, cut, camera: camera(index, value)? })
}

fn camera(index: usize, value: Value) -> Result<Camera, PathError> {
    serde_json::from_value(value).map_err(|error| wrong(index, error))
}

fn wrong(index: usize, what: impl std::fmt::Display) -> PathError {
    use serde::de::Error;
    PathError::Json(serde_json::Error::custom(format!("keyframe {index}: {what}")))
}

/// Gives each keyframe what it does not say, from the one before; the first may do without a size where one is given.
fn inherit(keyframes: &mut [Value], size: Option<(u32, u32)>) {
    let mut known = serde_json::Map::new();
    if let Some((width, height)) = size {
        known.insert("width".into(), width.into());
        known.insert("height".into(), height.into());
    }
    let projections = ["fov_y_deg", "ortho_height"];
    for fields in keyframes.iter_mut().filter_map(Value::as_object_mut) {
        let has_projection = projections.iter().any(|name| fields.contains_key(*name));
        for (name, value) in &known {
            if !(fields.contains_key(name) || has_projection && projections.contains(&name.as_str())) {
                fields.insert(name.clone(), value.clone());
            }
        }
        let inherited = ["up", "fov_y_deg", "ortho_height", "width", "height"];
        known = inherited
            .iter()
            .filter_map(|name| Some(((*name).to_owned(), fields.get(*name)?.clone())))
            .collect();
    }
}

type Timed = (f64, DVec3);

/// Cubic between `from` and `to` whose tangents are those of the neighbours' chords (one-sided at the ends).
fn hermite(before: Option<Timed>, from: Timed, to: Timed, beyond: Option<Timed>, share: f64) -> DVec3 {
    let chord = |a: Timed, b: Timed| (b.1 - a.1) / (b.0 - a.0);
    let length = to.0 - from.0;
    let out = length * chord(before.unwrap_or(from), to);
    let into = length * chord(from, beyond.unwrap_or(to));
    let (s, s2, s3) = (share, share * share, share * share * share);
    from.1 * (2.0 * s3 - 3.0 * s2 + 1.0)
        + out * (s3 - 2.0 * s2 + s)
        + to.1 * (3.0 * s2 - 2.0 * s3)
        + into * (s3 - s2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(t: f64, x: f64, extra: &str) -> String {
        format!(
            r#"{{"t":{t},"eye":[{x},0,9],"target":[{x},0,0],"up":[0,1,0],"fov_y_deg":60,"width":8,"height":6{extra}}}"#
        )
    }

    fn path(keys: &[String], fps: f64) -> Result<CameraPath, PathError> {
        CameraPath::from_json(&format!(r#"{{"keyframes":[{}],"fps":{fps}}}"#, keys.join(",")), None)
    }

    #[test]
    fn frames_pass_through_keyframes_and_go_evenly_between_even_ones() {
        let keys = [key(0.0, 0.0, ""), key(1.0, 4.0, ""), key(2.0, 8.0, ""), key(3.0, 12.0, "")];
        let views = path(&keys, 10.0).unwrap().views().unwrap();
        assert_eq!(views.len(), 31);
        for (frame, view) in views.iter().enumerate() {
            assert!((view.camera.eye[0] - 0.4 * frame as f64).abs() < 1e-9, "frame {frame}: {view:?}");
            assert_eq!(view.starts_anew, frame == 0);
        }
    }

    #[test]
    fn a_cut_jumps_and_bends_nothing_before_it() {
        let keys =
            [key(0.0, 0.0, ""), key(1.0, 1.0, ""), key(2.0, 500.0, r#","cut":true"#), key(3.0, 501.0, "")];
        let views = path(&keys, 4.0).unwrap().views().unwrap();
        let xs: Vec<f64> = views.iter().map(|view| view.camera.eye[0]).collect();
        assert_eq!(&xs[..8], [0.0, 0.25, 0.5, 0.75, 1.0, 1.0, 1.0, 1.0]);
        assert_eq!(&xs[8..], [500.0, 500.25, 500.5, 500.75, 501.0]);
        let anew: Vec<usize> = (0..views.len()).filter(|&i| views[i].starts_anew).collect();
        assert_eq!(anew, [0, 8]);
    }

    #[test]
    fn a_plain_list_of_cameras_is_a_second_between_two_and_size_can_be_replaced() {
        let list = [key(0.0, 0.0, ""), key(0.0, 3.0, "")].join(",").replace(r#""t":0,"#, "");
        let views = CameraPath::from_json(&format!("[{list}]"), Some((64, 32))).unwrap().views().unwrap();
        assert_eq!(views.len(), 31);
        assert_eq!((views[30].camera.eye, views[30].camera.width), ([3.0, 0.0, 9.0], 64));
    }

    #[test]
    fn what_a_keyframe_does_not_say_is_as_in_the_one_before() {
        let text = r#"{"keyframes":[{"t":0,"eye":[0,0,9],"target":[0,0,0],"up":[0,1,0],"ortho_height":3},
            {"t":1,"eye":[1,0,9],"target":[1,0,0]},{"t":2,"cut":true,"eye":[2,0,9],"target":[2,0,0],"fov_y_deg":40},
            {"t":3,"eye":[3,0,9],"target":[3,0,0],"up":[1,0,0]}]}"#;
        let path = CameraPath::from_json(text, Some((64, 32))).unwrap();
        let cameras: Vec<Camera> = path.keyframes().iter().map(|key| key.camera).collect();
        assert_eq!(cameras[1], Camera { eye: [1.0, 0.0, 9.0], target: [1.0, 0.0, 0.0], ..cameras[0] });
        assert_eq!(cameras[3].projection, Projection::Perspective { fov_y_deg: 40.0 });
        assert_eq!((cameras[2].up, cameras[3].up, cameras[3].width), ([0.0, 1.0, 0.0], [1.0, 0.0, 0.0], 64));
        // What is nowhere said is asked for, and where.
        let told = CameraPath::from_json(text, None).unwrap_err().to_string();
        assert!(told.contains("keyframe 0") && told.contains("width"), "{told}");
        let list = r#"[{"eye":[0,0,9],"target":[0,0,0],"up":[0,1,0],"fov_y_deg":60},{"eye":[1,0,9]}]"#;
        let told = CameraPath::from_json(list, Some((64, 32))).unwrap_err().to_string();
        assert!(told.contains("keyframe 1") && told.contains("target"), "{told}");
    }

    #[test]
    fn written_paths_are_read_as_they_were() {
        let keys = [key(-0.1, 0.3, ""), key(1.0 / 3.0, 1e7 + 0.1, ""), key(2.0, 0.7, r#","cut":true"#)];
        let written = path(&keys, 23.976).unwrap();
        assert_eq!(CameraPath::from_json(&written.to_json().unwrap(), None).unwrap(), written);
        assert_eq!(CameraPath::new(written.keyframes().to_vec(), written.fps()).unwrap(), written);
        assert_eq!(written.at(-5.0), (0, written.keyframes()[0].camera));
        assert_eq!(written.at(f64::INFINITY), (1, written.keyframes()[2].camera));
    }

    #[test]
    fn bad_paths_say_what_is_wrong() {
        let error = |keys: &[String], fps| path(keys, fps).unwrap_err().to_string();
        assert!(error(&[], 30.0).contains("no keyframes"));
        assert!(error(&[key(1.0, 0.0, ""), key(1.0, 1.0, "")], 30.0).contains("keyframe 1"));
        assert!(error(&[key(0.0, 0.0, "")], 0.0).contains("fps"));
        assert!(error(&[key(0.0, 0.0, ""), key(1e9, 0.0, "")], 30.0).contains("frames"));
        assert!(error(&[key(0.0, 0.0, r#","fov":3"#)], 30.0).contains("fov"));
        let wide = key(1.0, 0.0, "").replace(r#""width":8"#, r#""width":9"#);
        assert!(error(&[key(0.0, 0.0, ""), wide], 30.0).contains("size"));
        let parallel = key(1.0, 0.0, "").replace("fov_y_deg", "ortho_height");
        assert!(error(&[key(0.0, 0.0, ""), parallel], 30.0).contains("cut"));
        assert!(CameraPath::from_json("{}", None).is_err());
    }
}
