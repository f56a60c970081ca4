//! The fibre's lobes drawn: across the strand round a pole, along it over the inclination.
//!
//! Radii and heights are square roots, since TT may be a hundred times as bright as R.

use std::f64::consts::PI;
use std::time::Duration;

use eframe::egui::{
    self, Align2, Color32, FontId, Painter, Rect, RichText, Role, Sense, Shape, Slider, Stroke, Ui,
    Vec2,
};

use super::fields;
use super::later::Later;
use super::lobes::{Curve, Lobes, NAMES, Subject, Values};
use crate::measure::plot::COLOURS;
use crate::scene::{Method, Scene};

/// Of a plot that a strong line shall not leave.
const FILLED: f32 = 0.94;

/// The lobes of a scene's fibre: those that shading looks up, thick, over the exact ones.
#[derive(Default)]
pub struct LobePlot {
    /// Inclination of the light.
    theta_i_deg: f64,
    exact: Later<Subject, Lobes>,
    /// Or why there are none.
    shaded: Later<Subject, Result<Lobes, String>>,
}

/// What is looked up takes a millisecond where η is known: so long it is waited for, that it follows a drag.
const PATIENCE: Duration = Duration::from_millis(6);

impl LobePlot {
    pub fn show(&mut self, ui: &mut Ui, scene: &Scene) {
        ui.horizontal(|ui| {
            let label = ui.label("light's inclination");
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let what = "light's inclination";
                let slider = fields::number(ui, what, fields::parse_number, |ui, parser| {
                    let slider = Slider::new(&mut self.theta_i_deg, -80.0..=80.0).suffix("°");
                    ui.add(slider.fixed_decimals(0).custom_parser(parser))
                });
                slider.labelled_by(label.id);
            });
        });
        let theta_i = self.theta_i_deg.to_radians();
        let (fibre, render) = (scene.fibre.clone(), scene.render.clone());
        let subject = Subject { fibre, render, theta_i };
        let look_up = |of: &Subject| Lobes::shaded(of).map_err(|error| format!("{error:#}"));
        let shaded = self.shaded.get(ui.ctx(), &subject, PATIENCE, look_up);
        // One that is not of this fibre is not shown.
        let exact = self.exact.get(ui.ctx(), &subject, Duration::ZERO, Lobes::exact);
        let exact = exact.filter(|(_, newest)| *newest).map(|(exact, _)| exact);

        const GAP: f32 = 10.0;
        let side = 0.5 * (ui.available_width() - GAP);
        let (rect, response) =
            ui.allocate_exact_size(Vec2::new(2.0 * side + GAP, side + 14.0), Sense::hover());
        let left = Rect::from_min_size(rect.min, Vec2::splat(side));
        let right = left.translate(Vec2::new(side + GAP, 0.0));
        frames(ui, left, right, theta_i);
        let shading = match scene.render.method {
            Method::Fast => "what shading looks up",
            Method::Xu => "the fits of xu",
        };
        let help = format!(
            "Luminance of the scene's fibre, without paint, under a light of no width.\n\
             Thick: {shading}; thin: the exact model.\n\
             Left: across the strand, N over azimuth. Right: along it, what goes to each inclination; \
             the dashes are where a mirror would send the light.\n\
             Radius and height are square roots. The numbers are the relative L2 difference of a lobe's \
             curves, the greater of the two."
        );
        let mut painter = ui.painter_at(rect);
        let mut differences = Vec::new();
        let now = shaded.and_then(|(of, newest)| of.as_ref().ok().filter(|_| newest));
        let before = shaded.and_then(|(of, _)| of.as_ref().ok());
        let rims = now.or(exact).or(before).map_or([1.0; 2], Lobes::most);
        if let Some(exact) = exact {
            let strong = ui.visuals().strong_text_color();
            curves(&painter, [left, right], rims, exact, &|_| Stroke::new(1.0, strong));
        }
        if let Some(shaded) = before {
            // Of the fibre that was, until this one's are there.
            painter.set_opacity(if now.is_some() { 1.0 } else { 0.25 });
            let stroke = |p| Stroke::new(2.5, color(ui, p).gamma_multiply(0.75));
            curves(&painter, [left, right], rims, shaded, &stroke);
            if let Some(exact) = exact.filter(|_| now.is_some()) {
                let apart = shaded.apart(exact).into_iter().enumerate();
                let text = |(p, off): (usize, Option<f64>)| {
                    Some((p, format!("{} {:.2} %", NAMES[p], 100.0 * off?)))
                };
                differences = apart.filter_map(text).collect();
            }
        }
        let name = match &differences[..] {
            [] => "Lobes, being computed".to_owned(),
            some => {
                let all: Vec<&str> = some.iter().map(|(_, text)| text.as_str()).collect();
                format!("Lobes, off the exact ones by {}", all.join(", "))
            }
        };
        response.widget_info(|| egui::WidgetInfo::labeled(Role::Image, true, &name));
        response.on_hover_text(help);
        ui.horizontal_wrapped(|ui| {
            for (p, text) in &differences {
                ui.label(RichText::new(text).color(color(ui, *p)));
            }
            match shaded {
                Some((Err(line), true)) => ui.weak(line),
                _ if differences.is_empty() => ui.weak("…"),
                _ => ui.weak("off, relative L2"),
            };
        });
    }
}

/// Axes and their words.
fn frames(ui: &Ui, left: Rect, right: Rect, theta_i: f64) {
    let (painter, weak) = (ui.painter(), ui.visuals().weak_text_color());
    polar_frame(ui, left);
    along_frame(ui, right, theta_i);
    let font = FontId::proportional(10.0);
    let word = |at, anchor, text: &str| {
        painter.text(at, anchor, text, font.clone(), weak);
    };
    let rim = left.right_center();
    painter.arrow(rim, Vec2::new(-0.12 * left.width(), 0.0), Stroke::new(1.5, weak));
    word(rim - Vec2::new(0.0, 4.0), Align2::RIGHT_BOTTOM, "light");
    word(left.center_bottom(), Align2::CENTER_TOP, "across the strand");
    word(right.left_bottom(), Align2::LEFT_TOP, "root");
    word(right.center_bottom(), Align2::CENTER_TOP, "along the strand");
    word(right.right_bottom(), Align2::RIGHT_TOP, "tip");
}

/// Across on the left, along on the right, of rims of their own.
fn curves(
    painter: &Painter,
    [left, right]: [Rect; 2],
    [across, along]: [f64; 2],
    of: &Lobes,
    stroke: &dyn Fn(usize) -> Stroke,
) {
    polar_lines(painter, left, &of.across, &Pen { stroke, rim: &|_| across });
    along_lines(painter, right, &of.along, &Pen { stroke, rim: &|_| along });
}

/// How curves are drawn: the stroke of R, TT, TRT, longer paths and, at 4, their sum; and the value that reaches the
/// rim.
pub struct Pen<'a> {
    pub stroke: &'a dyn Fn(usize) -> Stroke,
    pub rim: &'a dyn Fn(usize) -> f64,
}

/// Of a lobe as in plots, or of their sum.
pub fn color(ui: &Ui, p: usize) -> Color32 {
    match p {
        0..4 => {
            let [r, g, b] = COLOURS[p];
            let color = Color32::from_rgb(r, g, b);
            // They were chosen for white paper.
            if ui.visuals().dark_mode { color.lerp_to_gamma(Color32::WHITE, 0.25) } else { color }
        }
        _ => ui.visuals().weak_text_color(),
    }
}

impl Pen<'_> {
    /// A stroke and its line for all that is to be seen: each angle with the square root of its value over the rim's.
    fn lines(&self, curve: &Curve) -> impl Iterator<Item = (Stroke, Vec<(f64, f32)>)> {
        let value = |values: &Values, p: usize| match values.get(p) {
            Some(&one) => one,
            None => values.iter().sum(),
        };
        (0..=NAMES.len()).filter_map(move |p| {
            let stroke = (self.stroke)(p);
            let seen = !stroke.is_empty() && curve.iter().any(|(_, values)| value(values, p) > 0.0);
            let line = || {
                let rim = (self.rim)(p).max(f64::MIN_POSITIVE);
                let height = |values| (value(values, p) / rim).max(0.0).sqrt().min(3.0) as f32;
                curve.iter().map(|(x, values)| (*x, height(values))).collect()
            };
            seen.then(|| (stroke, line()))
        })
    }
}

/// N over φ round the middle of `rect`, the light on the right.
pub fn polar_lines(painter: &Painter, rect: Rect, across: &Curve, pen: &Pen) {
    let (painter, rim) = (painter.with_clip_rect(rect), radius(rect));
    for (stroke, line) in pen.lines(across) {
        let at = |phi: f64, r: f32| {
            rect.center() + rim * r * Vec2::new(phi.cos() as f32, -phi.sin() as f32)
        };
        // N is even in φ.
        let half = line.iter().map(|&(phi, r)| at(phi, r));
        let other = line.iter().rev().map(|&(phi, r)| at(-phi, r));
        painter.add(Shape::line(half.chain(other).collect(), stroke));
    }
}

/// The rim and a ring at half of its radius, a quarter of its value.
pub fn polar_frame(ui: &Ui, rect: Rect) {
    let (painter, center, rim) = (ui.painter(), rect.center(), radius(rect));
    let stroke = axis(ui);
    for r in [0.5 * rim, rim] {
        painter.circle_stroke(center, r, stroke);
    }
    for spoke in [Vec2::X, Vec2::Y] {
        painter.line_segment([center - rim * spoke, center + rim * spoke], stroke);
    }
}

/// ∫S cosθ_i dφ over θ_o, −90° on the left.
pub fn along_lines(painter: &Painter, rect: Rect, along: &Curve, pen: &Pen) {
    let painter = painter.with_clip_rect(rect);
    for (stroke, line) in pen.lines(along) {
        let at = |&(theta, height): &(f64, f32)| {
            let up = FILLED * height * rect.height();
            rect.left_bottom() + Vec2::new(place(theta) * rect.width(), -up)
        };
        painter.add(Shape::line(line.iter().map(at).collect(), stroke));
    }
}

/// The axis, and a line where a mirror would send light from `theta_i`.
pub fn along_frame(ui: &Ui, rect: Rect, theta_i: f64) {
    let (painter, stroke) = (ui.painter(), axis(ui));
    painter.line_segment([rect.left_bottom(), rect.right_bottom()], stroke);
    let x = rect.left() + place(-theta_i) * rect.width();
    let line = [egui::pos2(x, rect.top()), egui::pos2(x, rect.bottom())];
    painter.extend(Shape::dashed_line(&line, stroke, 3.0, 3.0));
}

fn axis(ui: &Ui) -> Stroke {
    Stroke::new(0.7, ui.visuals().weak_text_color().gamma_multiply(0.5))
}

fn radius(rect: Rect) -> f32 {
    0.5 * FILLED * rect.width().min(rect.height())
}

/// Where θ_o stands in [−π/2, π/2], from 0 to 1.
fn place(theta: f64) -> f32 {
    (theta / PI + 0.5) as f32
}
