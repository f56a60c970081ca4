//! The picture under the pointer: what drags, clicks and wheels do to camera, light and paint.

use std::sync::Arc;
use std::time::Instant;

use eframe::egui::{self, Color32, Pos2, Rect, Ui, Vec2};

use super::{Drag, Editor, Tool, Turn};
use crate::editor::brush::{Canvas, Places, Stroke, pick};
use crate::editor::{fields, viewport};
use crate::paint::{Channel, Paint};
use crate::scene::{Lens, Scene};
use crate::stage::Geometry;

impl Editor {
    pub(super) fn viewport(&mut self, ui: &mut Ui) {
        let room = ui.available_rect_before_wrap();
        let rect = if self.frame_only {
            let [width, height] = self.document.scene.output.size.map(|s| s as f32);
            let scale = (room.width() / width).min(room.height() / height).max(0.0);
            Rect::from_center_size(room.center(), scale * Vec2::new(width, height))
        } else {
            room
        };
        self.rect = Some(rect);
        let response = ui.allocate_rect(room, egui::Sense::click_and_drag());
        fields::name_it(&response, "Picture");
        self.shown.pane.paint(ui, rect, rect);
        self.paint_truth(ui, rect);
        let ctx = ui.ctx().clone();
        if let Some(frame) = self.frame_size(&ctx).filter(|_| !self.frame_only) {
            let frame = Vec2::from(frame.map(|s| s as f32)) / ctx.pixels_per_point();
            viewport::outline(ui, rect, Rect::from_center_size(rect.center(), frame));
        }
        self.drag_over(&ctx, &response, rect);
        if response.hover_pos().is_some_and(|at| self.truth.divides(at, rect)) {
            ctx.set_cursor_icon(egui::CursorIcon::ResizeHorizontal);
        } else if let Some(at) = response.hover_pos().filter(|_| self.tool == Tool::Paint) {
            let color = match self.brush.channel {
                Channel::Absorption => fields::swatch(fields::assembly_color(self.brush.sigma_a())),
                _ => Color32::WHITE,
            };
            viewport::ring(ui, rect, at, self.brush.radius * rect.height(), color);
            ctx.set_cursor_icon(egui::CursorIcon::Crosshair);
        }
        if response.hovered() {
            let steps = ctx.input(|i| i.smooth_scroll_delta().y);
            if let (Some(stage), Some(picture)) = (&self.stage, &self.shown.picture)
                && steps != 0.0
            {
                viewport::zoom(&mut self.document.scene, stage, &picture.lens, steps);
            }
        }
    }

    pub(super) fn drag_over(&mut self, ctx: &egui::Context, response: &egui::Response, rect: Rect) {
        let (modifiers, delta) = ctx.input(|i| (i.modifiers, i.pointer.delta()));
        let by = |button| response.drag_started_by(button);
        if by(egui::PointerButton::Primary) {
            let origin = ctx.input(|i| i.pointer.press_origin());
            self.drag = Some(match (self.tool, modifiers) {
                _ if origin.is_some_and(|at| self.truth.divides(at, rect)) => Drag::Divider,
                (_, m) if m.shift => Drag::Light,
                (Tool::Paint, m) if m.alt => Drag::Size,
                (Tool::Paint, _) => Drag::Stroke,
                (Tool::View, _) => Drag::Camera,
            });
        } else if by(egui::PointerButton::Middle) {
            self.drag = Some(if modifiers.shift { Drag::Pan } else { Drag::Camera });
        } else if by(egui::PointerButton::Secondary) {
            self.drag = Some(Drag::Pan);
        }
        let clicked = response.clicked() && self.tool == Tool::Paint && !modifiers.any();
        let stroking = self.drag == Some(Drag::Stroke) && response.dragged();
        if let Some(at) = response.interact_pointer_pos().filter(|_| clicked || stroking) {
            let of_pen = |event: &egui::Event| match event {
                egui::Event::Touch { force, .. } => *force,
                _ => None,
            };
            let pressure = ctx.input(|i| i.events.iter().rev().find_map(of_pen));
            self.paint_at(at, rect, pressure.unwrap_or(1.0));
        }
        if response.dragged() {
            let scene = &mut self.document.scene;
            match self.drag {
                Some(Drag::Camera) => viewport::turn(scene, self.stage.as_deref(), delta),
                Some(Drag::Light) => viewport::turn_light(scene, delta),
                Some(Drag::Size) => self.resize_brush((0.01 * delta.x).exp()),
                Some(Drag::Pan) => {
                    if let (Some(stage), Some(picture)) = (&self.stage, &self.shown.picture) {
                        viewport::pan(scene, stage, &picture.lens, delta, rect.height());
                    }
                }
                Some(Drag::Divider) => self.truth.divide(delta.x / rect.width().max(1.0)),
                Some(Drag::Stroke) | None => {}
            }
        }
        if response.drag_stopped() || clicked {
            if let Some(stroke) = self.stroke.take()
                && let Some(step) =
                    self.document.paint.as_ref().and_then(|paint| stroke.step(paint))
            {
                self.history.push(step);
            }
            self.drag = None;
        }
    }

    /// Goes on with a stroke, or begins one, at a place of the screen.
    pub(super) fn paint_at(&mut self, at: Pos2, rect: Rect, pressure: f32) {
        let (Some(stage), Some(picture)) = (self.own_stage().cloned(), &self.shown.picture) else {
            return;
        };
        let place = ((at - rect.min) / rect.height()).into();
        if self.document.paint.is_none() {
            match stage.paint(&self.document.scene) {
                Ok(paint) => {
                    let bare = Paint::bare(stage.groom().points.len());
                    self.document.begin_paint(paint.unwrap_or(bare));
                }
                Err(error) => return self.fail(&error),
            }
        }
        let places = places(&mut self.places, &stage, &picture.lens);
        let Some(paint) = &mut self.document.paint else { return };
        if paint.points() != stage.groom().points.len() {
            return;
        }
        let brush = &self.brush;
        let stroke = self.stroke.get_or_insert_with(|| Stroke::new(brush, paint.points()));
        let bare = bare(&self.document.scene, brush.channel);
        // A copy, so that what the worker reads stays as it is.
        let mut next = (**paint).clone();
        let canvas = Canvas { places, stage: &stage, bare };
        if stroke.to(place, pressure, &canvas, &mut next) {
            *paint = Arc::new(next);
        }
    }

    pub(super) fn give_up_stroke(&mut self) {
        let Some(stroke) = self.stroke.take() else { return };
        if let Some(paint) = &self.document.paint
            && let Some(step) = stroke.step(paint)
        {
            self.history.push(step);
            self.undo(false);
        }
        self.drag = None;
    }

    pub(super) fn eyedrop(&mut self, ctx: &egui::Context) {
        let (Some(rect), Some(at)) = (self.rect, ctx.pointer_latest_pos()) else { return };
        let (Some(stage), Some(picture)) = (&self.stage, &self.shown.picture) else { return };
        let places = places(&mut self.places, stage, &picture.lens);
        let channel = self.brush.channel;
        let layer = self.document.paint.as_ref().and_then(|paint| paint.layer(channel));
        let bare = bare(&self.document.scene, channel);
        match pick(((at - rect.min) / rect.height()).into(), 0.02, places, layer, bare) {
            Some(value) => self.brush.value = value,
            None => self.say("No hair under the pointer"),
        }
    }

    /// Starts or stops the turntable.
    pub(super) fn set_turning(&mut self, on: bool) {
        let metered = self.shown.picture.as_ref().map(|picture| {
            f64::from(picture.scale).log2() - self.document.scene.environment.exposure
        });
        self.turning = on.then(|| Turn { last: Instant::now(), exposure: metered });
    }

    pub(super) fn turn(&mut self, ctx: &egui::Context) {
        /// Degrees a second.
        const SPEED: f64 = 36.0;
        let Some(Turn { last, .. }) = &mut self.turning else { return };
        let seconds = last.elapsed().as_secs_f64();
        // No faster than there are pictures.
        if self.shown.picture.is_some() && seconds > 0.05 {
            *last = Instant::now();
            let orbit = viewport::orbit(&mut self.document.scene, self.stage.as_deref());
            orbit.azimuth_deg = (orbit.azimuth_deg + SPEED * seconds.min(0.3)).rem_euclid(360.0);
        }
        ctx.request_repaint();
    }
}

/// Where points are in a picture through `lens`: those that are known, or made anew.
fn places<'a>(known: &'a mut Option<Places>, stage: &Geometry, lens: &Lens) -> &'a Places {
    if known.as_ref().is_some_and(|places| !places.are_through(lens)) {
        *known = None;
    }
    known.get_or_insert_with(|| Places::new(stage, lens))
}

/// What the scene itself has of a channel.
pub(super) fn bare(scene: &Scene, channel: Channel) -> [f32; 3] {
    channel.of(&scene.fibre.resolve())
}
