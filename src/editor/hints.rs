//! What a parameter of the fibre does, in small pictures: at its least, as it is, at its most.

use std::time::Duration;

use eframe::egui::{Rect, Sense, Stroke, Ui, Vec2};

use super::fields::{assembly_color, swatch};
use super::later::Later;
use super::lobe_plot::{Pen, along_frame, along_lines, color, polar_frame, polar_lines};
use super::lobes::{Lobes, Subject};
use crate::scene::{FIELDS, FibreSpec, Field, Kind, Scene, Value};

/// Least, now, most.
const STOPS: usize = 3;
const NOW: usize = 1;
/// Of [`View::Strands`].
const STRANDS: usize = 5;
/// Points of a picture.
const SIZE: Vec2 = Vec2::new(92.0, 76.0);

/// What shows a field's effect.
#[derive(Clone, Copy, PartialEq)]
enum View {
    /// Lobes along the strand, one of them emphasised.
    Along(usize),
    /// The same, that one by how bright it is.
    Bright(usize),
    /// The colour that a lobe is multiplied by.
    Tint(usize),
    /// Lobes across it.
    Across,
    /// The colour of the hair as a whole.
    Color,
    /// Strands.
    Strands,
}

/// Pictures of the field that was asked for last.
#[derive(Default)]
pub struct Hints {
    lobes: Later<(String, FibreSpec), Vec<Lobes>>,
}

impl Hints {
    /// Shows what the field `key` of the fibre does; nothing of others.
    pub fn show(&mut self, ui: &mut Ui, key: &str, scene: &Scene) {
        let Some(field) = FIELDS.iter().find(|field| field.key == key) else { return };
        let Some(view) = view(key) else { return };
        let stops = stops(field, view, scene);
        let of = (key.to_owned(), scene.fibre.clone());
        let fibres: Vec<FibreSpec> = stops.iter().map(|(_, fibre)| fibre.clone()).collect();
        let lobes = match view {
            View::Along(_) | View::Bright(_) | View::Across => {
                let render = scene.render.clone();
                let made = self.lobes.get(ui.ctx(), &of, Duration::ZERO, move |_| {
                    let subject = |fibre| Subject { fibre, render: render.clone(), theta_i: 0.0 };
                    fibres.into_iter().map(|fibre| Lobes::exact(&subject(fibre))).collect()
                });
                made.filter(|(_, newest)| *newest).map(|(lobes, _)| lobes.as_slice())
            }
            View::Tint(_) | View::Color | View::Strands => None,
        };
        ui.set_max_width(STOPS as f32 * (SIZE.x + ui.spacing().item_spacing.x));
        ui.horizontal(|ui| {
            for (k, (label, fibre)) in stops.iter().enumerate() {
                ui.vertical(|ui| {
                    let (rect, _) = ui.allocate_exact_size(SIZE, Sense::hover());
                    picture(ui, rect, view, k, fibre, lobes);
                    ui.small(label);
                });
            }
        });
        ui.weak(match view {
            View::Along(_) | View::Bright(_) | View::Across if lobes.is_none() => "…",
            View::Along(_) => {
                "What goes along the strand, root to tip, of light from straight on; each lobe over its own peak"
            }
            View::Bright(_) => "What goes along the strand, root to tip; heights are square roots",
            View::Tint(_) => "What the lobe's own colour is multiplied by",
            View::Across => {
                "Lobes round the strand, light from the right; the radius is a square root"
            }
            View::Color => "Colour of the hair as a whole",
            View::Strands => "Width of the strands",
        });
    }
}

fn picture(ui: &Ui, rect: Rect, view: View, k: usize, fibre: &FibreSpec, lobes: Option<&[Lobes]>) {
    let painter = ui.painter();
    let whole = swatch(assembly_color(fibre.pigment.sigma_a()));
    match view {
        View::Color => _ = painter.rect_filled(rect, 3.0, whole),
        View::Tint(lobe) => {
            let tint = [fibre.tint_r, fibre.tint_tt, fibre.tint_trt][lobe];
            painter.rect_filled(rect, 3.0, swatch(tint));
        }
        View::Strands => {
            for strand in 0..STRANDS {
                let x = (strand as f32 + 0.5) / STRANDS as f32 * rect.width();
                let width = 1.5 * 2f32.powi(k as i32);
                painter.vline(rect.left() + x, rect.y_range(), Stroke::new(width, whole));
            }
        }
        View::Along(lobe) | View::Bright(lobe) => {
            along_frame(ui, rect, 0.0);
            let Some(all) = lobes.filter(|lobes| lobes.len() == STOPS) else { return };
            let lobes = &all[k];
            let stroke = |p: usize| match p {
                _ if p == lobe => Stroke::new(2.0, color(ui, p)),
                0..3 => Stroke::new(0.7, color(ui, p).gamma_multiply(0.7)),
                _ => Stroke::NONE,
            };
            let peak =
                |of: &Lobes, p: usize| of.along.iter().map(|(_, v)| v[p]).fold(0.0, f64::max);
            let rim = |p: usize| match view {
                View::Bright(own) if own == p => peak(&all[STOPS - 1], p),
                _ => peak(lobes, p),
            };
            along_lines(painter, rect, &lobes.along, &Pen { stroke: &stroke, rim: &rim });
        }
        View::Across => {
            polar_frame(ui, rect);
            let Some(lobes) = lobes.filter(|lobes| lobes.len() == STOPS) else { return };
            // All by what there is now, so that they compare.
            let [most, _] = lobes[NOW].most();
            let stroke = |p: usize| Stroke::new(1.2, color(ui, p));
            let pen = Pen { stroke: &stroke, rim: &|_| most };
            polar_lines(painter, rect, &lobes[k].across, &pen);
        }
    }
}

fn view(key: &str) -> Option<View> {
    Some(match key {
        "fibre.beta_r_deg" | "fibre.alpha_r_deg" => View::Along(0),
        "fibre.beta_tt_deg" | "fibre.alpha_tt_deg" => View::Along(1),
        "fibre.beta_trt_deg" | "fibre.alpha_trt_deg" => View::Along(2),
        "fibre.intensity_r" => View::Bright(0),
        "fibre.intensity_tt" => View::Bright(1),
        "fibre.intensity_trt" => View::Bright(2),
        "fibre.tint_r" => View::Tint(0),
        "fibre.tint_tt" => View::Tint(1),
        "fibre.tint_trt" => View::Tint(2),
        "fibre.w_c" | "fibre.eta" | "fibre.eccentricity" => View::Across,
        "fibre.sigma_a" | "fibre.eumelanin" | "fibre.pheomelanin" | "fibre.color" => View::Color,
        "fibre.diameter" => View::Strands,
        _ => return None,
    })
}

/// The fibre at the least, the present and the greatest value of a field; of what has no ends that tell anything, at a
/// half and twice what it is.
fn stops(field: &Field, view: View, scene: &Scene) -> [(String, FibreSpec); STOPS] {
    let with = |value: Value| {
        let mut scene = scene.clone();
        // The same fibre, were the value none.
        let _ = field.put(&mut scene, value);
        scene.fibre
    };
    let now = ("now".to_owned(), scene.fibre.clone());
    match field.kind {
        Kind::Color { min, max, .. } if matches!(view, View::Tint(_)) => {
            let grey = |x: f64| with(Value::List(vec![x; 3]));
            let name = |x: f64| format!("{x},{x},{x}");
            [(name(min), grey(min)), now, (name(max), grey(max))]
        }
        Kind::Number { min, max } if !matches!(view, View::Color | View::Strands) => {
            let unit = if field.unit == "degrees" { "°" } else { "" };
            let [least, most] = [min, max].map(|x| (format!("{x}{unit}"), with(Value::Number(x))));
            [least, now, most]
        }
        Kind::Number { min, max } | Kind::Vector { min, max } | Kind::Color { min, max, .. } => {
            let by = |factor: f64, name: &str| {
                let part = |x: f64| (factor * x).clamp(min, max);
                let value = match field.get(scene) {
                    Some(Value::List(xs)) => Value::List(xs.into_iter().map(part).collect()),
                    Some(Value::Number(x)) => Value::Number(part(x)),
                    _ => Value::Unset,
                };
                (name.to_owned(), with(value))
            };
            [by(0.5, "half"), now, by(2.0, "twice")]
        }
        _ => [now.clone(), now.clone(), now],
    }
}
