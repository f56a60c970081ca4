//! Widgets of the scene's table of fields: range, unit, words, help and default all come from there.

use std::cell::Cell;

use eframe::egui::{self, Color32, DragValue, Rgba, Slider, Ui};

use crate::file::typed_path;
pub use crate::scene::assembly_color;
use crate::scene::{Alternative, FIELDS, Field, Kind, Pigment, Scene, Value};

/// Shows a field with its name, and puts what the user makes of it into the scene. Fields that are stated another way
/// now are not shown.
pub fn field(ui: &mut Ui, key: &str, scene: &mut Scene) {
    explained(ui, key, scene, &mut |_, _, _| {});
}

/// What is shown beneath a field's help: of its key, in a scene.
pub type Explain<'a> = &'a mut dyn FnMut(&mut Ui, &str, &Scene);

/// The same with more in its help.
pub fn explained(ui: &mut Ui, key: &str, scene: &mut Scene, explain: Explain) {
    let Some(field) = FIELDS.iter().find(|field| field.key == key) else {
        debug_assert!(false, "no field {key}");
        return;
    };
    let Some(value) = field.get(scene) else { return };
    let mut next = None;
    ui.horizontal(|ui| {
        let name = name(field);
        let mut helped = |response: egui::Response| {
            response.on_hover_ui(|ui| {
                ui.label(help(field));
                explain(ui, key, scene);
            })
        };
        let label = helped(ui.label(&name));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let default = field.get(&Scene::default());
            if default.as_ref().is_some_and(|default| *default != value) {
                let reset = ui.add(egui::Button::new("reset").small().frame(false));
                name_it(&reset, &format!("Reset {name}"));
                if reset.on_hover_text("Back to the default").clicked() {
                    next = default;
                }
            }
            let response = widget(ui, field, &value, &mut next);
            helped(match (parts(field), &value) {
                ([], _) | (_, Value::Unset) => response.labelled_by(label.id),
                // Each has a name of its own.
                _ => response,
            });
        });
    });
    if let Some(next) = next {
        // Widgets keep to ranges; text that is no value yet is left where it is.
        let _ = field.put(scene, next);
    }
}

/// A name for those who do not see the sign on a widget.
pub fn name_it(response: &egui::Response, name: &str) {
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, name));
}

fn name(field: &Field) -> String {
    let name = field.name().trim_end_matches("_deg").replace('_', " ");
    match field.key {
        "fibre.eta" => "index of refraction".to_owned(),
        "fibre.sigma_a" => "absorption".to_owned(),
        "fibre.w_c" => "glint width".to_owned(),
        "fibre.model" => "fibre model".to_owned(),
        "fibre.tint_r" => "colour R".to_owned(),
        "fibre.tint_tt" => "colour TT".to_owned(),
        "fibre.tint_trt" => "colour TRT".to_owned(),
        "fibre.intensity_r" => "intensity R".to_owned(),
        "fibre.intensity_tt" => "intensity TT".to_owned(),
        "fibre.intensity_trt" => "intensity TRT".to_owned(),
        "fibre.beta_r_deg" => "width R".to_owned(),
        "fibre.beta_tt_deg" => "width TT".to_owned(),
        "fibre.beta_trt_deg" => "width TRT".to_owned(),
        "fibre.alpha_r_deg" => "shift R".to_owned(),
        "fibre.alpha_tt_deg" => "shift TT".to_owned(),
        "fibre.alpha_trt_deg" => "shift TRT".to_owned(),
        "fibre.color" => "hair colour".to_owned(),
        "hair.source" => "hair".to_owned(),
        "head.source" => "head".to_owned(),
        "environment.source" => "map".to_owned(),
        "environment.exposure" => "light exposure".to_owned(),
        "camera.fov_deg" => "field of view".to_owned(),
        // Hair has these as well.
        key if key.starts_with("head.") => format!("head {name}"),
        // There are four of each.
        key if key.starts_with("lamp") => format!("{} {name}", field.group()),
        _ => name,
    }
}

fn help(field: &Field) -> String {
    let mut text = field.help.to_owned();
    if let Some(first) = text.get(..1) {
        text = first.to_uppercase() + &text[1..];
    }
    format!("{text}.\n{}: {}", field.key, field.expects())
}

/// Reads a number as it is typed, with a decimal point or a decimal comma; None for what is no finite number.
pub fn parse_number(text: &str) -> Option<f64> {
    let text: String = text.chars().filter(|c| !c.is_whitespace()).collect();
    let text = text.replace('−', "-");
    let text = match text.split_once(',') {
        Some((whole, decimals)) if !decimals.contains([',', '.']) && !whole.contains('.') => {
            format!("{whole}.{decimals}")
        }
        _ => text,
    };
    text.parse().ok().filter(|x: &f64| x.is_finite())
}

/// Reads a share as it is typed in per cent, with or without the sign.
pub fn parse_percent(text: &str) -> Option<f64> {
    Some(0.01 * parse_number(text.trim().trim_end_matches('%'))?)
}

/// Reads what is typed into a number's widget.
pub type NumberParser<'a> = &'a dyn Fn(&str) -> Option<f64>;

/// Adds a widget of a number named `what`. Text that `parse` does not read leaves the number as it is; it is red while it is
/// typed, and [`refused`] once it is left.
pub fn number(
    ui: &mut Ui,
    what: &str,
    parse: fn(&str) -> Option<f64>,
    add: impl FnOnce(&mut Ui, NumberParser) -> egui::Response,
) -> egui::Response {
    let id = ui.scope_id().with(("number", what));
    // What was read last: the text, where it is no number.
    let read: Cell<Option<Option<String>>> = Cell::new(None);
    let parser = |text: &str| {
        let number = parse(text);
        read.set(Some(number.is_none().then(|| text.to_owned())));
        number
    };
    // The text, and the widget that it is typed into; none once it was left, when egui reads it once more.
    let before: Option<(Option<egui::Id>, String)> = ui.data_mut(|d| d.remove_temp(id));
    let left = matches!(before, Some((None, _)));
    let color = ui.visuals().override_text_color;
    if before.is_some() && !left {
        ui.visuals_mut().override_text_color = Some(ui.visuals().error_fg_color);
    }
    let response = add(ui, &parser);
    ui.visuals_mut().override_text_color = color;
    let text = read.take().unwrap_or_else(|| before.as_ref().map(|(_, text)| text.clone()));
    let Some(text) = text.filter(|_| !left) else { return response };
    let focus = ui.memory(|memory| memory.focused());
    let stays = focus.is_some() && before.as_ref().is_none_or(|(of, _)| *of == focus);
    let escaped = ui.input(|i| i.key_pressed(egui::Key::Escape));
    if !stays && !escaped && before.is_some() {
        refuse(ui, format!("{what}: `{text}` is no number"));
    }
    ui.data_mut(|d| d.insert_temp(id, (focus.filter(|_| stays), text)));
    response
}

fn refused_id() -> egui::Id {
    egui::Id::unique("refused")
}

/// Tells that what was typed is not taken.
fn refuse(ui: &Ui, line: String) {
    ui.data_mut(|d| d.insert_temp(refused_id(), line));
}

/// What was typed last and is not taken, in one line; once.
pub fn refused(ctx: &egui::Context) -> Option<String> {
    ctx.data_mut(|d| d.remove_temp(refused_id()))
}

fn widget(ui: &mut Ui, field: &Field, value: &Value, next: &mut Option<Value>) -> egui::Response {
    if let (Some(word), Value::Unset) = (field.unset, value) {
        let own = ui.button(word);
        if own.clicked() {
            *next = first_value(field);
        }
        return own;
    }
    if field.unset.is_some() {
        let free = ui.add(egui::Button::new("×").small().frame(false));
        let word = field.unset.unwrap_or_default();
        name_it(&free, &format!("Leave {} {word}", name(field)));
        if free.on_hover_text(format!("Leave it {word}")).clicked() {
            *next = Some(Value::Unset);
        }
    }
    match (field.kind, value) {
        (Kind::Number { min, max }, Value::Number(x)) => {
            let mut y = *x;
            let suffix = match field.unit {
                "degrees" => "°",
                "radians" => " rad",
                "stops" => " EV",
                unit => unit,
            };
            let response = number(ui, &name(field), parse_number, |ui, parser| {
                // Ranges that no slider can hold are dragged.
                if max - min > 5e3 {
                    let drag = DragValue::new(&mut y).custom_parser(parser).range(min..=max);
                    ui.add(drag.speed(0.01 * x.abs().max(0.01)))
                } else {
                    // From 0 on, hundredths are the least that counts.
                    let wide = min >= 0.0 && max / min.max(0.01) > 500.0;
                    let slider = Slider::new(&mut y, min..=max).suffix(suffix).logarithmic(wide);
                    ui.add(slider.smallest_positive(0.01).custom_parser(parser))
                }
            });
            if response.changed() && !passed(&response, *x, y) {
                *next = Some(Value::Number(y));
            }
            response
        }
        (Kind::Integer { min, max }, Value::Number(x)) => {
            let mut y = *x;
            let response = number(ui, &name(field), parse_number, |ui, parser| {
                let drag = DragValue::new(&mut y).range(min..=max).fixed_decimals(0);
                ui.add(drag.speed((0.01 * x).max(0.05)).custom_parser(parser))
            });
            if response.changed() {
                *next = Some(Value::Number(y.round()));
            }
            response
        }
        (Kind::Choice(words), Value::Text(word)) => {
            let shown =
                egui::ComboBox::from_id_salt(field.key).selected_text(word).show_ui(ui, |ui| {
                    for &other in words {
                        if ui.selectable_label(other == word, other).clicked() {
                            *next = Some(Value::Text(other.to_owned()));
                        }
                    }
                });
            shown.response
        }
        (Kind::Color { min, max, .. }, Value::List(rgb)) => {
            let mut color = [0, 1, 2].map(|k| rgb.get(k).copied().unwrap_or(0.0) as f32);
            let response = ui.color_edit_button_rgb(&mut color);
            if response.changed() {
                let held = color.map(|c| f64::from(c).clamp(min, max));
                *next = Some(Value::List(held.to_vec()));
            }
            response
        }
        (Kind::Vector { min, max }, Value::List(xs)) => numbers(ui, field, xs, next, |y| {
            let speed = 0.01 * y.abs().max(0.1);
            DragValue::new(y).range(min..=max).speed(speed)
        }),
        (Kind::Size { min, max }, Value::List(xs)) => {
            let response = numbers(ui, field, xs, next, |y| {
                DragValue::new(y).range(min..=max).fixed_decimals(0)
            });
            if let Some(Value::List(ys)) = next {
                ys.iter_mut().for_each(|y| *y = y.round());
            }
            response
        }
        (Kind::Source { builtins, words }, Value::Text(text)) => {
            source(ui, field, builtins, words, text, next)
        }
        (_, Value::Text(text)) => typed(ui, field, text, next),
        _ => ui.label("–"),
    }
}

/// What the numbers of a field of several are called.
fn parts(field: &Field) -> &'static [&'static str] {
    match field.kind {
        Kind::Size { .. } => &["width", "height"],
        Kind::Vector { .. } if field.key == "fibre.sigma_a" => &["red", "green", "blue"],
        Kind::Vector { .. } => &["x", "y", "z"],
        _ => &[],
    }
}

/// Numbers in a row, each to be dragged.
fn numbers(
    ui: &mut Ui,
    field: &Field,
    xs: &[f64],
    next: &mut Option<Value>,
    widget: impl Fn(&mut f64) -> DragValue<'_>,
) -> egui::Response {
    let mut ys = xs.to_vec();
    let mut changed = false;
    let inner = ui.horizontal(|ui| {
        // From right to left.
        let named = ys.iter_mut().zip(xs).zip(parts(field)).rev();
        let added = named.map(|((y, x), part)| {
            let what = format!("{}, {part}", name(field));
            let response = number(ui, &what, parse_number, |ui, parser| {
                ui.add(widget(y).custom_parser(parser))
            });
            changed |= response.changed() && !passed(&response, *x, *y);
            response.accessible_name(what)
        });
        added.reduce(|all, one| all | one)
    });
    if changed {
        *next = Some(Value::List(ys));
    }
    inner.inner.unwrap_or(inner.response)
}

/// Whether the focus only went through a number: a widget that loses it reads its own text, which is the number rounded.
fn passed(response: &egui::Response, before: f64, after: f64) -> bool {
    let decimals = format!("{after}").split_once('.').map_or(0, |(_, decimals)| decimals.len());
    response.lost_focus() && format!("{before:.decimals$}") == format!("{after:.decimals$}")
}

/// What a field that is left to the program gets once it is not.
fn first_value(field: &Field) -> Option<Value> {
    Some(match field.kind {
        Kind::Number { .. } if field.name() == "scale" => Value::Number(1.0),
        Kind::Number { min, max } => Value::Number(0f64.clamp(min, max).max(0.1f64.min(max))),
        Kind::Integer { min, max } => Value::Number(16f64.clamp(min, max)),
        Kind::Vector { .. } => Value::List(vec![0.0; 3]),
        Kind::Target => Value::Text("20%".to_owned()),
        Kind::Output(endings) => Value::Text(format!("stats.{}", endings.first()?)),
        Kind::Choice(words) | Kind::Source { words, .. } => {
            Value::Text((*words.first()?).to_owned())
        }
        // A layer's usual name.
        Kind::Text => Value::Text("Combined".to_owned()),
        _ => return None,
    })
}

/// Text that takes effect when it is left or entered.
fn typed(ui: &mut Ui, field: &Field, text: &str, next: &mut Option<Value>) -> egui::Response {
    let id = ui.scope_id().with(("typed", field.key));
    let mut draft = ui.data(|d| d.get_temp::<String>(id)).unwrap_or_else(|| text.to_owned());
    let response = ui.add(egui::TextEdit::singleline(&mut draft).desired_width(140.0));
    if response.has_focus() {
        ui.data_mut(|d| d.insert_temp(id, draft));
    } else {
        if response.lost_focus() && draft != text {
            let names_file = matches!(field.kind, Kind::Source { .. } | Kind::Output(_));
            let draft = if names_file { typed_path(&draft) } else { draft };
            match field.parse(&draft) {
                Ok(value) => *next = Some(value),
                Err(line) => refuse(ui, line),
            }
        }
        ui.data_mut(|d| d.remove::<String>(id));
    }
    response
}

/// A file, a builtin, or a word.
fn source(
    ui: &mut Ui,
    field: &Field,
    builtins: &[&str],
    words: &[&str],
    text: &str,
    next: &mut Option<Value>,
) -> egui::Response {
    let shown = std::path::Path::new(text);
    let shown = shown.file_name().map_or(text.into(), |name| name.to_string_lossy());
    // A click into the text stays in the list.
    let stays = egui::PopupCloseBehavior::CloseOnClickOutside;
    let combo = egui::ComboBox::from_id_salt(field.key).selected_text(&*shown);
    let combo = combo.close_behavior(stays).show_ui(ui, |ui| {
        let names = builtins.iter().map(|name| format!("builtin:{name}"));
        for name in names.chain(words.iter().map(|&word| word.to_owned())) {
            if ui.selectable_label(name == text, &name).clicked() {
                *next = Some(Value::Text(name));
                ui.close();
            }
        }
        ui.separator();
        ui.label("Path of a file");
        typed(ui, field, text, next).accessible_name(format!("Path of the {}", name(field)));
        if next.is_some() {
            ui.close();
        }
    });
    combo.response
}

/// Of [`alternatives`]: what a fibre's pigment states.
pub const COLOR: &str = "the colour of the fibre";

/// The ways in which one thing can be stated, to choose from; and the fields of the one that holds.
pub fn alternatives(ui: &mut Ui, of: &str, label: &str, scene: &mut Scene, explain: Explain) {
    let ways = || {
        let mut ways: Vec<&'static str> = Vec::new();
        let stated = FIELDS.iter().filter_map(|f| f.alternative).filter(|a| a.of == of);
        for Alternative { way, .. } in stated {
            if !ways.contains(&way) {
                ways.push(way);
            }
        }
        ways
    };
    let of_way = |way: &'static str| {
        FIELDS.iter().filter(move |f| f.alternative.is_some_and(|a| a.of == of && a.way == way))
    };
    let holds = ways().into_iter().find(|way| of_way(way).all(|f| f.get(scene).is_some()));
    ui.horizontal_wrapped(|ui| {
        ui.label(label);
        for way in ways() {
            if ui.selectable_label(holds == Some(way), way).clicked() && holds != Some(way) {
                turn_to(scene, way);
            }
        }
    });
    if let Some(way) = ways().into_iter().find(|way| of_way(way).all(|f| f.get(scene).is_some())) {
        of_way(way).for_each(|f| explained(ui, f.key, scene, explain));
    }
}

/// States the fibre's colour another way, as near to what it was as that way has it.
fn turn_to(scene: &mut Scene, way: &str) {
    let sigma_a = scene.fibre.pigment.sigma_a();
    scene.fibre.pigment = match way {
        "absorption" => Pigment::Absorption(sigma_a),
        "melanin" => Pigment::melanin_near(sigma_a),
        _ => Pigment::Color(assembly_color(sigma_a)),
    };
}

/// Linear RGB as a colour of the interface.
pub fn swatch(rgb: [f64; 3]) -> Color32 {
    let [r, g, b] = rgb.map(|c| c as f32);
    Rgba::from_rgb(r, g, b).into()
}
