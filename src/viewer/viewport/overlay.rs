//! What is drawn over the picture: names, measurements, handles, sections, the view cube.

use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Shape as Drawn, Stroke, pos2, vec2};
use glam::{DVec2, DVec3};

use crate::camera::CameraRays;
use crate::viewer::action::AxisName;
use crate::viewer::cube::Cube;
use crate::viewer::handles::{self, Handle, Shape};
use crate::viewer::measure::LengthUnit;
use crate::viewer::screen::Screen;
use crate::viewer::session::Session;
use crate::viewer::{navigate, search};

/// Names that are written into the picture, at most.
const MOST_LABELS: u32 = 12;
/// Side of the view cube, points.
const CUBE: f32 = 110.0;
/// Between it and the picture's border, points.
const CUBE_MARGIN: f32 = 8.0;

/// Draws world positions over a picture of a camera.
pub(super) struct Overlay<'a> {
    camera: CameraRays,
    screen: Screen,
    area: Rect,
    painter: &'a Painter,
}

impl<'a> Overlay<'a> {
    pub fn new(camera: CameraRays, area: Rect, painter: &'a Painter) -> Self {
        Overlay { camera, screen: Screen::new(&camera, &Default::default()), area, painter }
    }

    /// Names of what is selected and shown, with part numbers, and boxes around it: it may be behind something.
    pub fn labels(&self, session: &Session) {
        let (document, scene) = (&session.document, session.document.scene().scene());
        if document.selected().count() > MOST_LABELS {
            // An assembly: the box around all of it.
            if let Some((min, max)) = session.current.and_then(|node| document.node_bounds(node)) {
                self.bounds(min, max);
            }
            return;
        }
        for object in document.selected().iter() {
            if document.state().hidden.has(object) {
                continue;
            }
            let Some((min, max)) = document.bounds([object]) else { continue };
            self.bounds(min, max);
            let node = &scene.nodes()[scene.objects()[object as usize].node as usize];
            let name = scene.name(node.name);
            match search::part_number(scene.name(node.extras)) {
                Some(number) => self.label(0.5 * (min + max), &format!("{name}\n{number}")),
                None => self.label(0.5 * (min + max), name),
            }
        }
    }

    fn bounds(&self, min: DVec3, max: DVec3) {
        let corner = |i: usize| {
            DVec3::from([0, 1, 2].map(|axis| if i >> axis & 1 == 1 { max[axis] } else { min[axis] }))
        };
        let stroke = Stroke::new(1.0, Color32::from_rgba_unmultiplied(255, 170, 60, 110));
        for from in 0..8 {
            for axis in (0..3).filter(|axis| from >> axis & 1 == 0) {
                self.line(&[corner(from), corner(from | 1 << axis)], stroke);
            }
        }
    }

    pub fn measurements(&self, session: &Session, unit: &LengthUnit) {
        for measurement in &session.measuring.done {
            self.line(&[measurement.from.point, measurement.to.point], Stroke::new(2.0, Color32::YELLOW));
            self.dot(measurement.from.point, Color32::YELLOW);
            self.dot(measurement.to.point, Color32::YELLOW);
            let middle = 0.5 * (measurement.from.point + measurement.to.point);
            self.label(middle, &unit.show(measurement.distance()));
        }
        if let Some(from) = &session.measuring.from {
            self.dot(from.point, Color32::YELLOW);
        }
    }

    /// Frames of section planes, and handles; the one that is dragged or under the cursor is bright.
    pub fn handles(&self, session: &Session, cursor: Option<DVec2>, unit: &LengthUnit) {
        let (min, max) = session.bounds();
        for section in session.document.state().sections.iter().filter(|section| section.is_on) {
            let mut outline = handles::outline(&section.plane, min, max);
            outline.extend(outline.first().copied());
            self.line(&outline, Stroke::new(1.0, Color32::from_rgb(255, 200, 80)));
        }
        let all = session.handles(&self.camera);
        let dragged = session.dragging.as_ref().map(|dragging| dragging.handle);
        let under = || cursor.and_then(|at| handles::under(&all, &self.camera, at)).map(|found| found.0);
        let bright = dragged.or_else(under);
        for (handle, shape) in &all {
            // While one is dragged the others are in the way.
            if dragged.is_none_or(|dragged| dragged == *handle) {
                self.handle(*handle, shape, bright == Some(*handle));
            }
        }
        if let (Some(dragging), Some(cursor)) = (&session.dragging, cursor) {
            self.text(self.place(cursor), &dragging.shown(unit));
        }
    }

    fn handle(&self, handle: Handle, shape: &Shape, is_bright: bool) {
        let colour = match handle {
            _ if is_bright => Color32::WHITE,
            Handle::Along(axis) | Handle::About(axis) => match axis {
                AxisName::X => Color32::from_rgb(235, 70, 70),
                AxisName::Y => Color32::from_rgb(80, 200, 80),
                AxisName::Z => Color32::from_rgb(80, 130, 255),
            },
            Handle::Section(_) => Color32::from_rgb(255, 200, 80),
        };
        let stroke = Stroke::new(if is_bright { 4.0 } else { 2.5 }, colour);
        self.line(&shape.line(), stroke);
        if let Shape::Arrow { from, to } = *shape
            && let (Some(foot), Some(tip)) = (self.point(from), self.point(to))
            && (tip - foot).length() > 1.0
        {
            let along = (tip - foot).normalized();
            let aside = along.rot90() * 5.0;
            let head = vec![tip + along * 10.0, tip + aside, tip - aside];
            self.painter.add(Drawn::convex_polygon(head, colour, Stroke::NONE));
        }
    }

    /// The view pyramid of another camera.
    pub fn frustum(&self, camera: &CameraRays, reach: f64) {
        let (width, height) = (f64::from(camera.size().0), f64::from(camera.size().1));
        let corners =
            [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)].map(|(x, y)| camera.ray(x, y));
        let stroke = Stroke::new(2.0, Color32::LIGHT_BLUE);
        for (i, corner) in corners.iter().enumerate() {
            self.line(&[corner.at(0.0), corner.at(reach), corners[(i + 1) % 4].at(reach)], stroke);
        }
        if let Some(place) = self.point(camera.eye()) {
            let font = FontId::proportional(12.0);
            self.painter.text(place, Align2::LEFT_BOTTOM, "frozen here", font, stroke.color);
        }
    }

    /// The view cube, in the upper right corner.
    pub fn cube(&self, navigator: &navigate::Navigator, pointer: Option<Pos2>) {
        let Some(square) = cube_square(self.area) else { return };
        let cube = cube_of(navigator);
        let hovered = pointer.and_then(|at| cube.side_at(in_square(square, at)));
        let place = |at: DVec2| square.center() + vec2(at.x as f32, -at.y as f32) * (0.5 * square.width());
        for face in cube.faces() {
            let corners = face.corners.map(place).to_vec();
            let light = 90 + (110.0 * face.facing) as u8;
            let fill = match hovered {
                Some(side) if side == face.side => Color32::from_rgb(255, 190, 110),
                _ => Color32::from_rgba_unmultiplied(light, light, light, 235),
            };
            let border = Stroke::new(1.0, Color32::from_gray(40));
            let middle = corners.iter().fold(egui::Vec2::ZERO, |sum, corner| sum + corner.to_vec2()) / 4.0;
            self.painter.add(Drawn::convex_polygon(corners, fill, border));
            if face.facing > 0.35 {
                let (font, dark) = (FontId::proportional(11.0), Color32::from_gray(20));
                self.painter.text(middle.to_pos2(), Align2::CENTER_CENTER, face.name, font, dark);
            }
        }
        // An edge or a corner: a dot there.
        if let Some(side) = hovered
            && cube.faces().iter().all(|face| face.side != side)
            && let Some(at) = cube.place_of(side)
        {
            self.painter.circle_filled(place(at), 6.0, Color32::from_rgb(255, 190, 110));
        }
    }

    fn place(&self, pixel: DVec2) -> Pos2 {
        let (width, height) = self.camera.size();
        let scale = vec2(self.area.width() / width as f32, self.area.height() / height as f32);
        self.area.min + vec2(pixel.x as f32 * scale.x, pixel.y as f32 * scale.y)
    }

    /// Where a point is in the window, or beside it; `None` behind the eye.
    fn point(&self, point: DVec3) -> Option<Pos2> {
        Some(self.place(self.screen.project(point - self.camera.eye())?.at))
    }

    fn label(&self, point: DVec3, text: &str) {
        let Some(place) = self.point(point).filter(|place| self.area.contains(*place)) else { return };
        self.text(place, text);
    }

    fn text(&self, place: Pos2, text: &str) {
        let (font, white) = (FontId::proportional(13.0), Color32::WHITE);
        let text = self.painter.layout_no_wrap(text.to_owned(), font, white);
        let size = text.size();
        let corner = pos2(place.x + 8.0, place.y - size.y - 8.0);
        let around = Rect::from_min_size(corner, size).expand(3.0);
        self.painter.line_segment([place, around.left_bottom()], Stroke::new(1.0, white));
        self.painter.rect_filled(around, 3.0, Color32::from_black_alpha(180));
        self.painter.galley(corner, text, white);
    }

    fn dot(&self, point: DVec3, colour: Color32) {
        if let Some(place) = self.point(point) {
            self.painter.circle_filled(place, 4.0, colour);
        }
    }

    /// What is seen of a line through points.
    fn line(&self, points: &[DVec3], stroke: Stroke) {
        let eye = self.camera.eye();
        for ends in points.windows(2) {
            let seen = self.screen.clipped_segment(ends[0] - eye, ends[1] - eye);
            let places = seen.map(|(a, b)| (self.screen.project(a), self.screen.project(b)));
            if let Some((Some(a), Some(b))) = places {
                self.painter.line_segment([self.place(a.at), self.place(b.at)], stroke);
            }
        }
    }
}

/// Where the view cube is in a picture; `None` in one that is too small for it.
fn cube_square(area: Rect) -> Option<Rect> {
    let square = Rect::from_min_size(
        pos2(area.right() - CUBE - CUBE_MARGIN, area.top() + CUBE_MARGIN),
        vec2(CUBE, CUBE),
    );
    (area.width() > 3.0 * CUBE && area.height() > 2.0 * CUBE).then_some(square)
}

fn cube_of(navigator: &navigate::Navigator) -> Cube {
    Cube::new(navigator.picture_axes(), navigator.sides())
}

/// A place as [`Cube`] counts.
fn in_square(square: Rect, at: Pos2) -> DVec2 {
    let away = (at - square.center()) / (0.5 * square.width());
    DVec2::new(away.x.into(), (-away.y).into())
}

/// The side of the view cube under the pointer.
pub fn cube_side(navigator: &navigate::Navigator, area: Rect, pointer: Pos2) -> Option<navigate::Side> {
    let square = cube_square(area).filter(|square| square.contains(pointer))?;
    cube_of(navigator).side_at(in_square(square, pointer))
}
