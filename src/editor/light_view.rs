//! The light as it is seen: the map, the lights fitted to it, and what sets them apart.
//!
//! Pictures and rings stand in the world, so that they turn with the light: the middle column is the direction −z,
//! behind the hair as the usual camera sees it.

use std::f64::consts::TAU;
use std::sync::Arc;

use eframe::egui::{self, Align2, Color32, FontId, Pos2, Rect, Sense, Stroke, Ui, Vec2};
use glam::DVec3;

use super::{fields, viewport};
use crate::environment::{Environment, direction_to_uv, uv_to_direction};
use crate::image::{display_bytes, luminance};
use crate::lamp::{Lamp, Shape};
use crate::live::Light;
use crate::scene::{LampSpec, Scene};
use crate::srbf::SrbfLight;
use crate::stage::{exposure_scale, place_light};

/// Steps around a ring.
const STEPS: usize = 96;
/// Points of the screen from which a light is hit.
const NEAR: f32 = 7.0;
/// A lamp's ring at least, radians.
const LEAST_RING: f64 = 0.05;
/// Where the lights, and where the map is the brighter, linear RGB.
const MORE: [f32; 3] = [1.0, 0.42, 0.05];
const LESS: [f32; 3] = [0.08, 0.38, 1.0];

#[derive(Clone, Copy, PartialEq)]
enum Showing {
    Map,
    Lights,
    Difference,
}

/// A light on a map that is not turned, u and v as fractions of its width and height.
struct Ring {
    centre: [f64; 2],
    outline: Vec<[f64; 2]>,
}

pub struct LightView {
    light: Option<Arc<Light>>,
    rings: Vec<Ring>,
    showing: Showing,
    show_rings: bool,
    chosen: Option<usize>,
    /// The lamp that is dragged, of the scene's.
    dragged: Option<usize>,
    /// The lamp whose fields are shown.
    pub lamp: Option<usize>,
    /// Of what is shown, at which exposure.
    texture: Option<(Showing, f32, egui::TextureHandle)>,
}

impl Default for LightView {
    fn default() -> Self {
        Self {
            light: None,
            rings: Vec::new(),
            showing: Showing::Map,
            show_rings: true,
            chosen: None,
            dragged: None,
            lamp: None,
            texture: None,
        }
    }
}

/// Where the light's radiance is half its peak ([`SrbfLight::half_angle`]), as a curve on the lat-long map: u and v as
/// fractions of width and height. u goes on beyond 0 and 1 where the curve crosses the seam, and ends a whole turn from
/// where it began where the curve goes round a pole. Empty for a light that falls to no half.
pub fn outline(light: &SrbfLight) -> Vec<[f64; 2]> {
    light.half_angle().map_or(Vec::new(), |angle| circle(light.direction, angle))
}

/// A ring of an angular radius about a direction, in the same way.
fn circle(direction: DVec3, angle: f64) -> Vec<[f64; 2]> {
    let (across, along) = direction.any_orthonormal_pair();
    let mut last = direction_to_uv(direction)[0];
    (0..=STEPS)
        .map(|k| {
            let (sin, cos) = (TAU * k as f64 / STEPS as f64).sin_cos();
            let aside = cos * across + sin * along;
            let [u, v] = direction_to_uv(angle.cos() * direction + angle.sin() * aside);
            last = u + (last - u).round();
            [last, v]
        })
        .collect()
}

/// A lamp as it is seen from the middle of the hair: unlike the map's lights it does not turn with the map.
fn lamp_ring(spec: &LampSpec) -> Option<Ring> {
    // The middle is the origin, and a radius the unit.
    let lit = LampSpec { color: [1.0; 3], irradiance: 1.0, ..*spec };
    let lamp = Lamp::new(&lit, glam::Vec3::ZERO, 1.0, 1.0)?;
    let angle = match lamp.shape {
        Shape::Sun { angle } => angle,
        Shape::Sphere { .. } => (spec.size / spec.distance).min(1.0).asin(),
        Shape::Softbox { .. } => spec.size.atan2(spec.distance),
    };
    // A ring too small to be seen is still one to be taken hold of.
    let outline = circle(lamp.toward, angle.max(LEAST_RING));
    Some(Ring { centre: direction_to_uv(lamp.toward), outline })
}

/// Places a lamp where the map has `uv`.
fn place_lamp(spec: &mut LampSpec, [u, v]: [f64; 2]) {
    let [x, y, z] = uv_to_direction([u.rem_euclid(1.0), v.clamp(0.0, 1.0)]).to_array();
    spec.azimuth_deg = x.atan2(z).to_degrees();
    spec.elevation_deg = y.clamp(-1.0, 1.0).asin().to_degrees();
}

impl LightView {
    /// What is seen.
    pub fn light(&self) -> Option<&Arc<Light>> {
        self.light.as_ref()
    }

    /// Shows another light.
    pub fn put(&mut self, light: Arc<Light>) {
        let ring =
            |l: &SrbfLight| Ring { centre: direction_to_uv(l.direction), outline: outline(l) };
        self.rings = light.fit.lights.iter().map(ring).collect();
        (self.chosen, self.texture) = (None, None);
        self.light = Some(light);
    }

    /// The pictures and what is to be known of the lights; a drag over the picture turns the scene's light. `toward` is
    /// where the camera stands as seen from the hair.
    pub fn ui(&mut self, ui: &mut Ui, scene: &mut Scene, toward: Option<DVec3>) {
        let Some(light) = self.light.clone() else {
            ui.weak("The light is being made");
            return;
        };
        ui.horizontal(|ui| {
            let showing = &mut self.showing;
            ui.selectable_value(showing, Showing::Map, "Map");
            ui.selectable_value(showing, Showing::Lights, "Lights")
                .on_hover_text("The sum of the lights that are fitted to the map");
            ui.selectable_value(showing, Showing::Difference, "Difference")
                .on_hover_text("Luminance of the lights less that of the map");
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                ui.checkbox(&mut self.show_rings, "Rings")
                    .on_hover_text("Where each light falls to half its peak");
            });
        });
        self.picture(ui, &light, scene, toward);
        if self.showing == Showing::Difference {
            ui.horizontal(|ui| {
                let shade = |rgb: [f32; 3]| fields::swatch(rgb.map(f64::from));
                ui.colored_label(shade(MORE), "the lights are brighter");
                ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                    ui.colored_label(shade(LESS), "the map is brighter");
                });
            });
        }
        self.choice(ui, &light, scene);
        let short =
            format!("Fit: {:.2} % off at λ = 0.3", 100.0 * light.fit.relative_l2_blurred_0_30);
        egui::CollapsingHeader::new(short).id_salt("fit").show(ui, |ui| {
            table(ui, &light.fit.figures());
            ui.weak(
                "Relative L2: the root of ∫|map − lights|² over ∫|map|², over the sphere and RGB; blurred: after both \
                 are blurred by the lobe of that bandwidth, as hair blurs them.",
            );
        });
    }

    fn picture(&mut self, ui: &mut Ui, light: &Light, scene: &mut Scene, toward: Option<DVec3>) {
        let width = ui.available_width();
        let sense = Sense::click_and_drag();
        let (rect, response) = ui.allocate_exact_size(Vec2::new(width, 0.5 * width), sense);
        fields::name_it(&response, "Picture of the light");
        let lamps: Vec<(usize, Ring)> = (scene.lamps.iter().enumerate())
            .filter_map(|(k, spec)| Some((k, lamp_ring(spec)?)))
            .collect();
        let lamp_at = |at: Pos2| nearest(lamps.iter().map(|(k, ring)| (*k, ring)), rect, 0.0, at);
        if response.drag_started() {
            let press = ui.input(|i| i.pointer.press_origin());
            self.dragged = press.and_then(lamp_at);
            self.lamp = self.dragged.or(self.lamp);
        }
        if let Some(k) = self.dragged {
            if let Some(at) = response.interact_pointer_pos().filter(|_| response.dragged()) {
                let [u, v] = [(at.x - rect.min.x) / width, (at.y - rect.min.y) / rect.height()];
                place_lamp(&mut scene.lamps[k], [u, v].map(f64::from));
            }
        } else if response.dragged() {
            // What is under the pointer stays under it.
            let turned = 360.0 * f64::from(response.drag_delta().x / width.max(1.0));
            let rotation = &mut scene.environment.rotation_deg;
            *rotation = viewport::within(*rotation - turned);
        }
        let turn = scene.environment.rotation_deg / 360.0;
        let gain = 2f64.powf(scene.environment.exposure) as f32;
        let scale = exposure_scale(scene, &light.meter, toward.unwrap_or(DVec3::Z)) * gain;
        let left = turn as f32;
        let shown = Rect::from_min_max(egui::pos2(left, 0.0), egui::pos2(left + 1.0, 1.0));
        let texture = self.texture(ui.ctx(), light, scale);
        let painter = ui.painter_at(rect);
        painter.image(texture, rect, shown, Color32::WHITE);
        let hit = response.hover_pos().filter(|_| !response.dragged());
        let over_lamp = hit.and_then(lamp_at);
        let hit = hit.filter(|_| over_lamp.is_none());
        let hit = hit.and_then(|at| self.hit(rect, turn, at));
        if self.show_rings {
            for j in (0..self.rings.len()).rev().filter(|&j| self.chosen != Some(j)) {
                let width = if hit == Some(j) { 2.0 } else { 1.0 };
                self.ring(&painter, rect, turn, j, light.fit.lights[j].rgb, width);
            }
        }
        if let Some(j) = self.chosen {
            self.ring(&painter, rect, turn, j, light.fit.lights[j].rgb, 3.0);
        }
        if response.drag_stopped() {
            self.dragged = None;
        }
        for (k, ring) in &lamps {
            let width = if self.lamp == Some(*k) { 3.0 } else { 1.5 };
            draw(&painter, rect, 0.0, ring, scene.lamps[*k].color, width);
            let name = (Align2::CENTER_CENTER, FontId::proportional(12.0));
            for at in copies(rect, 0.0, std::slice::from_ref(&ring.centre)).flatten() {
                let at = at + Vec2::new(10.0, -8.0);
                let (text, black) = ((k + 1).to_string(), Color32::from_black_alpha(200));
                painter.text(at + Vec2::splat(1.0), name.0, &text, name.1.clone(), black);
                painter.text(at, name.0, text, name.1.clone(), Color32::WHITE);
            }
        }
        if response.has_focus() {
            painter.rect_stroke(rect, 0.0, ui.visuals().selection.stroke, egui::StrokeKind::Inside);
        }
        if !light.is_of(scene) {
            painter.rect_filled(rect, 0.0, Color32::from_black_alpha(140));
            let (align, font) = (Align2::CENTER_CENTER, FontId::proportional(12.0));
            painter.text(
                rect.center(),
                align,
                "the next light is being made",
                font,
                Color32::WHITE,
            );
        }
        compass(ui, rect, toward);
        if response.clicked()
            && let Some(at) = response.interact_pointer_pos()
        {
            match lamp_at(at) {
                Some(k) => self.lamp = Some(k),
                None => self.chosen = self.hit(rect, turn, at),
            }
        }
        if response.hovered() {
            ui.ctx().set_cursor_icon(match hit {
                _ if over_lamp.is_some() || self.dragged.is_some() => egui::CursorIcon::Move,
                Some(_) => egui::CursorIcon::PointingHand,
                None => egui::CursorIcon::ResizeHorizontal,
            });
        }
        if let Some(j) = hit {
            response.on_hover_ui_at_pointer(|ui| {
                ui.label(format!("Light {} of {}", j + 1, light.fit.lights.len()));
                table(ui, &figures(light, scene, j));
            });
        }
    }

    /// The light under a place: the nearest centre or ring.
    fn hit(&self, rect: Rect, turn: f64, at: Pos2) -> Option<usize> {
        nearest(self.rings.iter().enumerate(), rect, turn, at)
    }

    fn ring(
        &self,
        painter: &egui::Painter,
        rect: Rect,
        turn: f64,
        j: usize,
        rgb: [f64; 3],
        width: f32,
    ) {
        draw(painter, rect, turn, &self.rings[j], rgb, width);
    }

    fn texture(&mut self, ctx: &egui::Context, light: &Light, scale: f32) -> egui::TextureId {
        let (showing, [map, lights]) = (self.showing, &light.seen);
        if let Some((of, at, texture)) = &self.texture
            && (*of, *at) == (showing, scale)
        {
            return texture.id();
        }
        let image = match showing {
            Showing::Map => shown(map, scale),
            Showing::Lights => shown(lights, scale),
            Showing::Difference => shown(&difference(map, lights), scale),
        };
        let texture = ctx.load_texture("light", image, egui::TextureOptions::LINEAR_REPEAT);
        self.texture.insert((showing, scale, texture)).2.id()
    }

    /// The chosen light, and steps to others.
    fn choice(&mut self, ui: &mut Ui, light: &Light, scene: &Scene) {
        let count = self.rings.len();
        ui.horizontal(|ui| {
            let step = |ui: &mut Ui, word: &str, name: &str| {
                let button = ui.button(word);
                fields::name_it(&button, name);
                button.clicked()
            };
            if step(ui, "<", "Previous light") {
                self.chosen = Some(self.chosen.map_or(count - 1, |j| (j + count - 1) % count));
            }
            if step(ui, ">", "Next light") {
                self.chosen = Some(self.chosen.map_or(0, |j| (j + 1) % count));
            }
            match self.chosen {
                Some(j) => ui.label(format!("Light {} of {count}", j + 1)),
                None => ui.weak(format!("{count} lights, the strongest first")),
            };
        });
        if let Some(j) = self.chosen {
            table(ui, &figures(light, scene, j));
        }
    }
}

/// Of some rings the one whose centre or outline is nearest to a place, if it is near.
fn nearest<'a>(
    rings: impl Iterator<Item = (usize, &'a Ring)>,
    rect: Rect,
    turn: f64,
    at: Pos2,
) -> Option<usize> {
    let near = |ring: &Ring| {
        let mut least = f32::INFINITY;
        for line in copies(rect, turn, &ring.outline) {
            let ends = line.windows(2);
            least = ends.map(|p| to_segment(at, [p[0], p[1]])).fold(least, f32::min);
        }
        let centres = copies(rect, turn, std::slice::from_ref(&ring.centre));
        centres.flatten().map(|centre| centre.distance(at)).fold(least, f32::min)
    };
    let nearest = rings.map(|(j, ring)| (j, near(ring))).min_by(|a, b| a.1.total_cmp(&b.1));
    nearest.filter(|&(_, away)| away <= NEAR).map(|(j, _)| j)
}

fn draw(painter: &egui::Painter, rect: Rect, turn: f64, ring: &Ring, rgb: [f64; 3], width: f32) {
    let most = rgb.iter().copied().fold(1e-30, f64::max);
    let stroke = Stroke::new(width, fields::swatch(rgb.map(|c| c / most)));
    let under = Stroke::new(width + 1.5, Color32::from_black_alpha(150));
    for line in copies(rect, turn, &ring.outline) {
        painter.line(line.clone(), under);
        painter.line(line, stroke);
    }
    for centre in copies(rect, turn, std::slice::from_ref(&ring.centre)).flatten() {
        painter.circle(centre, 0.5 + width, stroke.color, Stroke::new(0.75, under.color));
    }
}

/// Tone mapped as a frame is, after multiplying by `scale`.
pub fn shown(map: &Environment, scale: f32) -> egui::ColorImage {
    let opaque = |&[r, g, b]: &[f32; 3]| [r, g, b, 1.0];
    let pixels: Vec<[f32; 4]> = map.pixels.iter().map(opaque).collect();
    egui::ColorImage::from_rgba_unmultiplied(
        [map.width, map.height],
        &display_bytes(&pixels, scale),
    )
}

/// What the luminance of `lights` is above ([`MORE`]) or below ([`LESS`]) that of a map of the same size.
fn difference(map: &Environment, lights: &Environment) -> Environment {
    let colored = |(map, lights): (&[f32; 3], &[f32; 3])| {
        let more = luminance(*lights) - luminance(*map);
        let hue = if more > 0.0 { MORE } else { LESS };
        hue.map(|c| c * more.abs())
    };
    let pixels = map.pixels.iter().zip(&lights.pixels).map(colored).collect();
    Environment::new(map.width, map.height, pixels)
}

/// A curve of the unturned map on the screen, as often as it comes into `rect`.
fn copies(rect: Rect, turn: f64, uvs: &[[f64; 2]]) -> impl Iterator<Item = Vec<Pos2>> {
    let us = || uvs.iter().map(|uv| uv[0] - turn);
    let least = us().fold(f64::INFINITY, f64::min);
    let most = us().fold(f64::NEG_INFINITY, f64::max);
    // Of no points, none.
    let shifts = (-most).ceil() as i64..=(1.0 - least).floor() as i64;
    shifts.map(move |shift| {
        let place = |&[u, v]: &[f64; 2]| {
            let across = (u - turn + shift as f64) as f32;
            rect.min + Vec2::new(across * rect.width(), v as f32 * rect.height())
        };
        uvs.iter().map(place).collect()
    })
}

fn to_segment(at: Pos2, [a, b]: [Pos2; 2]) -> f32 {
    let along = b - a;
    let share = (at - a).dot(along) / along.length_sq().max(1e-12);
    at.distance(a + share.clamp(0.0, 1.0) * along)
}

/// Where the sides are, under the picture, and where the camera stands.
fn compass(ui: &mut Ui, rect: Rect, toward: Option<DVec3>) {
    let size = Vec2::new(rect.width(), 13.0);
    let (strip, response) = ui.allocate_exact_size(size, Sense::hover());
    response.on_hover_text(
        "Sides as the usual camera has them: the light in front of the hair falls on what it sees. The triangle is \
         where the camera stands now.\nDrag the picture to turn the light, click a ring for its figures; a lamp's ring, with \
         its number, is dragged to where the lamp is to be.",
    );
    let color = ui.visuals().weak_text_color();
    let words = ["front", "left", "behind", "right", "front"];
    let aligns = [
        Align2::LEFT_TOP,
        Align2::CENTER_TOP,
        Align2::CENTER_TOP,
        Align2::CENTER_TOP,
        Align2::RIGHT_TOP,
    ];
    for (k, (word, align)) in words.into_iter().zip(aligns).enumerate() {
        let at = strip.left_top() + Vec2::new(0.25 * k as f32 * strip.width(), 0.0);
        ui.painter().text(at, align, word, FontId::proportional(10.0), color);
    }
    if let Some(toward) = toward {
        let u = direction_to_uv(toward)[0] as f32;
        let tip = rect.left_bottom() + Vec2::new(u * rect.width(), -8.0);
        let feet = [Vec2::new(-5.0, 8.0), Vec2::new(5.0, 8.0)].map(|foot| tip + foot);
        let points = vec![tip, feet[1], feet[0]];
        let edge = Stroke::new(1.0, Color32::from_black_alpha(180));
        let triangle = egui::Shape::convex_polygon(points, Color32::WHITE, edge);
        ui.painter_at(rect).add(triangle);
    }
}

/// What is to be known of a light in the world.
fn figures(light: &Light, scene: &Scene, j: usize) -> [(&'static str, String); 5] {
    let of = place_light(&light.fit.lights[j], scene);
    let [x, y, z] = of.direction.to_array();
    let azimuth = x.atan2(z).to_degrees();
    let elevation = y.clamp(-1.0, 1.0).asin().to_degrees();
    let half = of.half_angle().map_or("nowhere at a half".to_owned(), |angle| {
        format!("a half at {:.1}°", angle.to_degrees())
    });
    let energy = |l: &SrbfLight| l.energy().iter().sum::<f64>();
    let all: f64 = light.fit.lights.iter().map(energy).sum();
    let [r, g, b] = of.rgb.map(three_digits);
    [
        ("direction", format!("azimuth {azimuth:.1}°, elevation {elevation:.1}°")),
        ("x, y, z", format!("{x:.3}, {y:.3}, {z:.3}")),
        ("bandwidth", format!("λ = {:.3}, {half}", of.lambda)),
        ("peak radiance", format!("{r}, {g}, {b}")),
        (
            "share of energy",
            format!("{:.1} %", 100.0 * energy(&light.fit.lights[j]) / all.max(1e-300)),
        ),
    ]
}

/// A number in about three digits.
fn three_digits(x: f64) -> String {
    match x.abs() {
        0.0 => "0".to_owned(),
        x if x >= 100.0 => format!("{x:.0}"),
        x if x >= 1.0 => format!("{x:.2}"),
        x if x >= 0.001 => format!("{x:.4}"),
        x => format!("{x:.1e}"),
    }
}

fn table(ui: &mut Ui, rows: &[(&str, String)]) {
    egui::Grid::new(ui.next_auto_id()).num_columns(2).show(ui, |ui| {
        for (name, figure) in rows {
            ui.weak(*name);
            ui.label(figure);
            ui.end_row();
        }
    });
}
