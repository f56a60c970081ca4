//! The picture with the output's frame in it, the camera under the pointer, and the brush over it.

use eframe::egui::{self, Color32, Pos2, Rangef, Rect, Stroke, Ui, Vec2};
use glam::DVec3;

use crate::live::Picture;
use crate::scene::{Lens, Orbit, Scene, View};
use crate::stage::Geometry;

/// Degrees that a drag over a point (a ninety-sixth of an inch) turns by.
const DEGREES_A_POINT: f64 = 0.4;

/// A picture on the screen.
#[derive(Default)]
pub struct Pane {
    texture: Option<egui::TextureHandle>,
    /// Whether one sees through it.
    clear: bool,
}

impl Pane {
    /// `rgba`: sRGB with straight alpha, rows from the top.
    pub fn put(&mut self, ctx: &egui::Context, size: [u32; 2], rgba: &[u8]) {
        self.clear = rgba.chunks_exact(4).any(|p| p[3] < 255);
        let image = egui::ColorImage::from_rgba_unmultiplied(size.map(|s| s as usize), rgba);
        match &mut self.texture {
            Some(texture) => texture.set(image, egui::TextureOptions::LINEAR),
            None => {
                let texture = ctx.load_texture("frame", image, egui::TextureOptions::LINEAR);
                self.texture = Some(texture);
            }
        }
    }

    /// Paints what of the picture in `rect` lies within `part`, over squares where it is clear.
    pub fn paint(&self, ui: &Ui, rect: Rect, part: Rect) {
        let painter = ui.painter_at(part.intersect(rect));
        painter.rect_filled(rect, 0.0, Color32::from_gray(48));
        let Some(texture) = &self.texture else { return };
        let side = 12.0;
        if self.clear {
            let columns = (rect.width() / side).ceil() as usize;
            for k in 0..columns * (rect.height() / side).ceil() as usize {
                let (x, y) = (k % columns, k / columns);
                if (x + y) % 2 == 0 {
                    let at = rect.min + side * Vec2::new(x as f32, y as f32);
                    let square = Rect::from_min_size(at, Vec2::splat(side)).intersect(rect);
                    painter.rect_filled(square, 0.0, Color32::from_gray(64));
                }
            }
        }
        let whole = Rect::from_min_max(Pos2::ZERO, egui::pos2(1.0, 1.0));
        painter.image(texture.id(), rect, whole, Color32::WHITE);
    }
}

/// The frame.
#[derive(Default)]
pub struct Shown {
    pub pane: Pane,
    pub picture: Option<Picture>,
}

impl Shown {
    pub fn put(&mut self, ctx: &egui::Context, picture: Picture) {
        self.pane.put(ctx, picture.size, &picture.rgba);
        self.picture = Some(picture);
    }
}

/// Draws the border of the output's frame, and dims what of the picture in `rect` lies outside.
pub fn outline(ui: &Ui, rect: Rect, frame: Rect) {
    let painter = ui.painter_at(rect);
    let dim = Color32::from_black_alpha(70);
    let beside = |x: Rangef| Rect::from_x_y_ranges(x, rect.y_range());
    let across = |y: Rangef| Rect::from_x_y_ranges(frame.x_range(), y);
    for part in [
        beside(Rangef::new(rect.min.x, frame.min.x)),
        beside(Rangef::new(frame.max.x, rect.max.x)),
        across(Rangef::new(rect.min.y, frame.min.y)),
        across(Rangef::new(frame.max.y, rect.max.y)),
    ] {
        if part.is_positive() {
            painter.rect_filled(part, 0.0, dim);
        }
    }
    let stroke = Stroke::new(1.0, Color32::from_white_alpha(110));
    painter.rect_stroke(frame, 0.0, stroke, egui::StrokeKind::Outside);
}

/// The camera's orbit; one that stands at a place is brought into orbit where it is.
pub fn orbit<'a>(scene: &'a mut Scene, stage: Option<&Geometry>) -> &'a mut Orbit {
    if let View::Position(position) = scene.camera.view {
        let center = stage.map_or(DVec3::ZERO, |stage| stage.center.as_dvec3());
        let radius = stage.map_or(1.0, |stage| f64::from(stage.radius)).max(1e-9);
        let target = scene.camera.target.map_or(center, DVec3::from_array);
        let out = DVec3::from_array(position) - target;
        scene.camera.view = View::Orbit(Orbit {
            azimuth_deg: out.x.atan2(out.z).to_degrees(),
            elevation_deg: (out.y / out.length().max(1e-12)).clamp(-1.0, 1.0).asin().to_degrees(),
            distance: Some((out.length() / radius).clamp(0.01, 1000.0)),
        });
    }
    match &mut scene.camera.view {
        View::Orbit(orbit) => orbit,
        View::Position(_) => unreachable!("it was brought into orbit"),
    }
}

/// Turns the camera around what it looks at.
pub fn turn(scene: &mut Scene, stage: Option<&Geometry>, drag: Vec2) {
    let orbit = orbit(scene, stage);
    let turned = orbit.azimuth_deg - DEGREES_A_POINT * f64::from(drag.x);
    orbit.azimuth_deg = within(turned);
    let raised = orbit.elevation_deg + DEGREES_A_POINT * f64::from(drag.y);
    orbit.elevation_deg = raised.clamp(-89.0, 89.0);
}

/// Turns the light.
pub fn turn_light(scene: &mut Scene, drag: Vec2) {
    let turned = scene.environment.rotation_deg + DEGREES_A_POINT * f64::from(drag.x);
    scene.environment.rotation_deg = within(turned);
}

/// Degrees in (−180, 180].
pub fn within(degrees: f64) -> f64 {
    -((180.0 - degrees).rem_euclid(360.0) - 180.0)
}

/// Moves what the camera looks at, so that it stays under the pointer. `lens` is that of the picture, `height` the
/// picture's on the screen.
pub fn pan(scene: &mut Scene, stage: &Geometry, lens: &Lens, drag: Vec2, height: f32) {
    orbit(scene, Some(stage));
    let per_point = 2.0 * lens.distance * lens.up.length() / f64::from(height.max(1.0));
    let right = lens.right.normalize_or_zero();
    let up = lens.up.normalize_or_zero();
    let moved = per_point * (f64::from(drag.y) * up - f64::from(drag.x) * right);
    let target = scene.camera.target.map_or(stage.center.as_dvec3(), DVec3::from_array);
    scene.camera.target = Some((target + moved).to_array());
}

/// Goes nearer (above 0) or away; `lens` says how far the camera is.
pub fn zoom(scene: &mut Scene, stage: &Geometry, lens: &Lens, steps: f32) {
    let radius = f64::from(stage.radius).max(1e-9);
    let orbit = orbit(scene, Some(stage));
    let now = orbit.distance.unwrap_or(lens.distance / radius);
    orbit.distance = Some((now * 0.998f64.powf(f64::from(steps))).clamp(0.01, 1000.0));
}

/// Frames the hair.
pub fn frame(scene: &mut Scene, stage: Option<&Geometry>) {
    orbit(scene, stage).distance = None;
    scene.camera.target = None;
}

/// The brush's ring: its radius, and within it where its strength is a half.
pub fn ring(ui: &Ui, rect: Rect, at: Pos2, radius: f32, color: Color32) {
    let painter = ui.painter_at(rect);
    painter.circle_stroke(at, radius, Stroke::new(3.0, Color32::from_black_alpha(120)));
    painter.circle_stroke(at, radius, Stroke::new(1.5, color));
    painter.circle_stroke(at, 0.5 * radius, Stroke::new(0.5, Color32::from_white_alpha(110)));
}
