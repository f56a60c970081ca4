//! A frame of the interface: panels around the picture, what was typed and dragged, and what the worker said.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use eframe::egui::{self, Color32, Key, KeyboardShortcut, Modifiers, Pos2, Rect, Ui, Vec2};

use super::brush::{Brush, Canvas, Falloff, Mode, Places, Reach, Stroke, pick};
use super::document::{Document, put_file};
use super::fields::{self, field};
use super::history::{History, Step};
use super::viewport::{self, Shown};
use crate::live::{Said, Wish, Worker, same_paint};
use crate::paint::{Channel, Paint};
use crate::scene::{PRESETS, Pigment, Scene};
use crate::stage::Geometry;

const UNDO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::Z);
const REDO: KeyboardShortcut =
    KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::Z);
const SAVE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::S);
const SAVE_AS: KeyboardShortcut =
    KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::S);
const OPEN: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::O);

/// What keys and drags do, as `?` shows it.
const SHORTCUTS: [(&str, &str); 17] = [
    ("Drag", "View: turn the camera. Paint: paint"),
    ("Middle drag", "Turn the camera, whatever the tool"),
    ("Right drag, Shift + middle drag", "Move the camera"),
    ("Wheel", "Nearer, farther"),
    ("Shift + drag", "Turn the light"),
    ("F", "Frame the hair"),
    ("V, B", "Tools: view, brush"),
    ("[ and ], Alt + drag", "Size of the brush"),
    ("I", "Eyedropper: take the value under the pointer"),
    ("X", "Brush: set, or erase"),
    ("T", "Turntable"),
    ("Ctrl + Z, Ctrl + Shift + Z", "Undo, redo"),
    ("Ctrl + O", "Open a scene, hair, head or map"),
    ("Ctrl + S, Ctrl + Shift + S", "Save, save as"),
    ("Ctrl + plus, minus, 0", "Size of the interface"),
    ("Esc", "Give up a stroke, close a window"),
    ("?", "This list"),
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tool {
    View,
    Paint,
}

/// A path that is asked for.
struct Prompt {
    kind: PromptKind,
    path: String,
    /// From the desktop's own dialog, on a thread.
    chosen: Option<std::sync::mpsc::Receiver<Option<PathBuf>>>,
}

#[derive(Clone, Copy, PartialEq)]
enum PromptKind {
    Open,
    Save,
    Picture,
}

/// What is asked before unsaved work would be lost.
#[derive(Clone, PartialEq)]
enum Leaving {
    Close,
    Open(PathBuf),
    New,
}

/// The editor's state.
pub struct Editor {
    pub document: Document,
    pub history: History,
    pub brush: Brush,
    tool: Tool,
    worker: Worker,
    shown: Shown,
    stage: Option<Arc<Geometry>>,
    /// The scene as the history has it.
    settled: Scene,
    asked: Option<(u64, Wish)>,
    /// Number of the wish that is shown.
    shown_of: u64,
    stroke: Option<Stroke>,
    places: Option<Places>,
    progress: Option<(&'static str, f32)>,
    /// What was said last, and whether something is wrong.
    message: Option<(String, bool)>,
    notes: Vec<String>,
    prompt: Option<Prompt>,
    leaving: Option<Leaving>,
    /// The close was allowed.
    may_close: bool,
    shortcuts: bool,
    turning: Option<Instant>,
    /// The light's or the brush's drag under way.
    drag: Option<Drag>,
    /// Of the picture on the screen.
    rect: Option<Rect>,
}

#[derive(Clone, Copy, PartialEq)]
enum Drag {
    Camera,
    Pan,
    Light,
    Size,
    Stroke,
}

impl Editor {
    pub fn new(document: Document, ctx: &egui::Context) -> Self {
        let waking = ctx.clone();
        Self {
            settled: document.scene.clone(),
            document,
            history: History::default(),
            brush: Brush::default(),
            tool: Tool::View,
            worker: Worker::new(move || waking.request_repaint()),
            shown: Shown::default(),
            stage: None,
            asked: None,
            shown_of: 0,
            stroke: None,
            places: None,
            progress: None,
            message: None,
            notes: Vec::new(),
            prompt: None,
            leaving: None,
            may_close: false,
            shortcuts: false,
            turning: None,
            drag: None,
            rect: None,
        }
    }

    /// A frame of the interface.
    pub fn ui(&mut self, ui: &mut Ui) {
        self.listen(ui.ctx());
        self.keys(ui);
        egui::Panel::top("menu").show(ui, |ui| self.menu(ui));
        egui::Panel::bottom("status").show(ui, |ui| self.status(ui));
        egui::Panel::right("scene").default_size(330.0).show(ui, |ui| {
            egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| self.scene_panel(ui));
        });
        egui::Panel::left("tools").exact_size(250.0).show(ui, |ui| {
            egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| self.tool_panel(ui));
        });
        egui::CentralPanel::no_frame().show(ui, |ui| self.viewport(ui));
        self.windows(ui);
        self.dropped(ui.ctx());
        self.turn(ui.ctx());
        self.settle(ui.ctx());
    }

    /// Whether the last picture is all that there will be of what is asked.
    pub fn finished(&self) -> bool {
        let newest = self.asked.as_ref().is_some_and(|(number, wish)| {
            *number == self.shown_of
                && wish.scene == self.document.scene
                && same_paint(&wish.paint, &self.document.paint)
        });
        newest && self.shown.picture.as_ref().is_some_and(|p| p.finished)
    }

    /// What is shown.
    pub fn picture(&self) -> Option<&crate::live::Picture> {
        self.shown.picture.as_ref()
    }

    /// The message of the status line.
    pub fn message(&self) -> Option<&str> {
        self.message.as_ref().map(|(line, _)| line.as_str())
    }

    fn listen(&mut self, ctx: &egui::Context) {
        let newest = self.asked.as_ref().map_or(0, |(number, _)| *number);
        for (number, said) in self.worker.said().collect::<Vec<_>>() {
            match said {
                Said::Picture(picture) => {
                    if number == newest {
                        self.progress = (!picture.finished).then_some(("refining", 0.0));
                    }
                    self.shown_of = number;
                    self.shown.put(ctx, picture);
                }
                Said::Progress(what, done) if number == newest => {
                    self.progress = Some((what, done))
                }
                Said::Progress(..) => {}
                Said::Geometry(stage) => {
                    self.stage = Some(stage);
                    self.places = None;
                }
                Said::Note(line) => self.notes.push(line),
                Said::Failed(line) => {
                    if number == newest {
                        self.progress = None;
                    }
                    self.message = Some((line, true));
                }
            }
        }
    }

    fn say(&mut self, line: impl Into<String>) {
        self.message = Some((line.into(), false));
    }

    fn fail(&mut self, error: &anyhow::Error) {
        self.message = Some((format!("{error:#}"), true));
    }

    // Doing and undoing.

    /// Once nothing is held down, what changed is a step.
    fn settle(&mut self, ctx: &egui::Context) {
        if self.document.follow_hair() {
            self.say("Paint stays with the hair it is on, and comes back with it");
        }
        let held = ctx.input(|i| i.pointer.any_down()) || self.turning.is_some();
        if !held && self.settled != self.document.scene {
            let after = self.document.scene.clone();
            let before = std::mem::replace(&mut self.settled, after.clone());
            // Where the camera is, is no work to be undone.
            let same = Scene { camera: after.camera, ..before.clone() } == after;
            if !same {
                self.history.push(Step::Scene { before: Box::new(before), after: Box::new(after) });
            }
        }
        let Some(size) = self.size(ctx) else { return };
        let scene = self.document.scene.clone();
        let wish = Wish { scene, paint: self.document.paint.clone(), size, moving: held };
        let same = self.asked.as_ref().is_some_and(|(_, asked)| {
            asked.same(&wish) && (asked.moving == wish.moving || wish.moving)
        });
        if !same {
            let number = self.worker.ask(wish.clone());
            self.asked = Some((number, wish));
        }
    }

    /// Of the picture in pixels: the scene's shape, as large as there is room.
    fn size(&self, ctx: &egui::Context) -> Option<[u32; 2]> {
        let size = self.rect?.size() * ctx.pixels_per_point();
        (size.x >= 1.0 && size.y >= 1.0).then_some([size.x.round() as u32, size.y.round() as u32])
    }

    fn undo(&mut self, redo: bool) {
        if self.stroke.is_some() {
            return;
        }
        let mut paint = self.document.paint.clone().unwrap_or_default();
        let owned = Arc::make_mut(&mut paint);
        let scene = &mut self.document.scene;
        let camera = scene.camera;
        let did = match redo {
            true => self.history.redo(scene, owned),
            false => self.history.undo(scene, owned),
        };
        scene.camera = camera;
        if !did {
            self.say(if redo { "Nothing to redo" } else { "Nothing to undo" });
            return;
        }
        if self.document.paint.as_ref().is_some_and(|before| **before != *paint) {
            self.document.paint = Some(paint);
        }
        self.document.follow_hair();
        self.settled = self.document.scene.clone();
    }

    fn keys(&mut self, ui: &Ui) {
        let ctx = ui.ctx();
        let pressed = |shortcut: &KeyboardShortcut| ctx.input_mut(|i| i.consume_shortcut(shortcut));
        // The longer shortcut first: its keys hold the shorter's.
        let (redo, undo) = (pressed(&REDO), pressed(&UNDO));
        if redo || undo {
            self.undo(redo);
        }
        if pressed(&SAVE_AS) {
            self.ask_path(PromptKind::Save);
        }
        if pressed(&SAVE) {
            self.save();
        }
        if pressed(&OPEN) {
            self.ask_path(PromptKind::Open);
        }
        if ctx.text_edit_focused() {
            return;
        }
        let key = |key: Key| ctx.input_mut(|i| i.consume_key(Modifiers::NONE, key));
        if key(Key::F) {
            viewport::frame(&mut self.document.scene, self.stage.as_deref());
        }
        if key(Key::V) {
            self.tool = Tool::View;
        }
        if key(Key::B) {
            self.tool = Tool::Paint;
        }
        if key(Key::OpenBracket) {
            self.resize_brush(0.9);
        }
        if key(Key::CloseBracket) {
            self.resize_brush(1.0 / 0.9);
        }
        if key(Key::X) {
            let erasing = self.brush.mode == Mode::Erase;
            self.brush.mode = if erasing { Mode::Set } else { Mode::Erase };
        }
        if key(Key::T) {
            self.turning = self.turning.is_none().then(Instant::now);
        }
        if key(Key::I) {
            self.eyedrop(ctx);
        }
        if key(Key::Escape) {
            self.give_up_stroke();
            (self.shortcuts, self.prompt, self.leaving) = (false, None, None);
        }
        if ctx.input(|i| i.events.iter().any(|e| matches!(e, egui::Event::Text(t) if t == "?"))) {
            self.shortcuts = !self.shortcuts;
        }
    }

    fn resize_brush(&mut self, by: f32) {
        self.brush.radius = (self.brush.radius * by).clamp(0.003, 0.5);
    }

    // Panels.

    fn menu(&mut self, ui: &mut Ui) {
        egui::MenuBar::new().ui(ui, |ui| {
            ui.menu_button("File", |ui| {
                if ui.button("New").clicked() {
                    self.leave(Leaving::New);
                }
                if ui.button("Open…").clicked() {
                    self.ask_path(PromptKind::Open);
                }
                ui.separator();
                if ui.button("Save").clicked() {
                    self.save();
                }
                if ui.button("Save as…").clicked() {
                    self.ask_path(PromptKind::Save);
                }
                if ui.button("Save picture…").clicked() {
                    self.ask_path(PromptKind::Picture);
                }
                ui.separator();
                if ui.button("Quit").clicked() {
                    ui.ctx().send_viewport_cmd(egui::ViewportCommand::Close);
                }
            });
            ui.menu_button("Edit", |ui| {
                let (steps, done) = self.history.steps();
                let (can_undo, can_redo) = (done > 0, done < steps.len());
                if ui.add_enabled(can_undo, egui::Button::new("Undo")).clicked() {
                    self.undo(false);
                }
                if ui.add_enabled(can_redo, egui::Button::new("Redo")).clicked() {
                    self.undo(true);
                }
            });
            ui.menu_button("View", |ui| {
                if ui.button("Frame the hair").clicked() {
                    viewport::frame(&mut self.document.scene, self.stage.as_deref());
                }
                let mut turning = self.turning.is_some();
                if ui.checkbox(&mut turning, "Turntable").clicked() {
                    self.turning = turning.then(Instant::now);
                }
                ui.separator();
                egui::widgets::global_theme_preference_buttons(ui);
            });
            if ui.button("?").on_hover_text("Shortcuts").clicked() {
                self.shortcuts = !self.shortcuts;
            }
            let name = self.document.path.as_deref().and_then(Path::file_name);
            let name = name.map_or("untitled".into(), |name| name.to_string_lossy());
            let mark = if self.document.changed() { " •" } else { "" };
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                ui.weak(format!("{name}{mark}"));
            });
        });
    }

    fn status(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            if let Some((line, wrong)) = &self.message {
                let color =
                    if *wrong { ui.visuals().error_fg_color } else { ui.visuals().text_color() };
                ui.colored_label(color, line);
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                if let Some(picture) = &self.shown.picture {
                    ui.weak(format!("{} in {:.0} ms", picture.quality, picture.ms));
                }
                if let Some((what, done)) = self.progress {
                    ui.add(egui::ProgressBar::new(done).desired_width(60.0).desired_height(6.0));
                    ui.weak(what);
                }
            });
        });
    }

    fn scene_panel(&mut self, ui: &mut Ui) {
        let scene = &mut self.document.scene;
        egui::CollapsingHeader::new("Fibre").default_open(true).show(ui, |ui| {
            ui.horizontal_wrapped(|ui| {
                for preset in PRESETS {
                    let chosen = scene.fibre.preset == preset.name;
                    if ui.selectable_label(chosen, preset.name).clicked() {
                        scene.fibre.set_preset(preset);
                    }
                }
            });
            let whole = fields::assembly_color(scene.fibre.pigment.sigma_a());
            ui.horizontal(|ui| {
                let (rect, _) = ui.allocate_exact_size(Vec2::new(40.0, 16.0), egui::Sense::hover());
                ui.painter().rect_filled(rect, 3.0, fields::swatch(whole));
                ui.weak("of the hair as a whole");
            });
            fields::alternatives(ui, "the colour of the fibre", "Colour by", scene);
            for key in [
                "fibre.beta_r_deg",
                "fibre.beta_tt_deg",
                "fibre.beta_trt_deg",
                "fibre.alpha_r_deg",
                "fibre.alpha_tt_deg",
                "fibre.alpha_trt_deg",
                "fibre.w_c",
                "fibre.eta",
                "fibre.eccentricity",
                "fibre.diameter",
                "fibre.model",
            ] {
                field(ui, key, scene);
            }
        });
        egui::CollapsingHeader::new("Light").default_open(true).show(ui, |ui| {
            for key in [
                "environment.source",
                "environment.rotation_deg",
                "environment.exposure",
                "environment.lights",
                "output.background",
                "output.exposure",
            ] {
                field(ui, key, scene);
            }
        });
        egui::CollapsingHeader::new("Camera").show(ui, |ui| {
            for key in [
                "camera.fov_deg",
                "camera.azimuth_deg",
                "camera.elevation_deg",
                "camera.distance",
                "camera.position",
                "camera.target",
            ] {
                field(ui, key, scene);
            }
        });
        egui::CollapsingHeader::new("Hair and head").show(ui, |ui| {
            for key in ["hair.source", "hair.up", "hair.scale", "head.source"] {
                field(ui, key, scene);
            }
            if scene.hair.source.starts_with("builtin:") {
                for key in [
                    "hair.strands",
                    "hair.length",
                    "hair.curl",
                    "hair.clump",
                    "hair.flyaway",
                    "hair.seed",
                ] {
                    field(ui, key, scene);
                }
            }
            self.notes.iter().rev().take(4).for_each(|line| {
                ui.weak(line);
            });
        });
        let scene = &mut self.document.scene;
        egui::CollapsingHeader::new("Rendering").show(ui, |ui| {
            for key in [
                "render.method",
                "render.nodes",
                "render.segments",
                "render.samples",
                "render.scattering",
                "render.adapter",
                "output.size",
                "output.path",
            ] {
                field(ui, key, scene);
            }
        });
    }

    fn tool_panel(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            ui.selectable_value(&mut self.tool, Tool::View, "View").on_hover_text("V");
            ui.selectable_value(&mut self.tool, Tool::Paint, "Paint").on_hover_text("B");
        });
        ui.separator();
        if self.tool == Tool::Paint {
            self.brush_panel(ui);
            ui.separator();
        }
        self.history_panel(ui);
    }

    fn brush_panel(&mut self, ui: &mut Ui) {
        let brush = &mut self.brush;
        let before = brush.channel;
        ui.label("What to paint");
        for channel in Channel::ALL {
            ui.radio_value(&mut brush.channel, channel, channel.name());
        }
        if brush.channel != before {
            brush.value = bare(&self.document.scene, brush.channel);
        }
        match brush.channel {
            Channel::Absorption => {
                let sigma_a = brush.value.map(|root| f64::from(root) * f64::from(root));
                let mut color = fields::assembly_color(sigma_a).map(|c| c as f32);
                ui.horizontal(|ui| {
                    let label = ui.label("Hair colour");
                    let edit = ui.color_edit_button_rgb(&mut color).labelled_by(label.id);
                    if edit.changed() {
                        let held = color.map(|c| f64::from(c).clamp(0.001, 0.999));
                        brush.value = Pigment::Color(held).sigma_a().map(|s| s.sqrt() as f32);
                    }
                });
                ui.horizontal_wrapped(|ui| {
                    for preset in PRESETS {
                        let mut fibre = crate::scene::FibreSpec::default();
                        fibre.set_preset(preset);
                        if ui.small_button(preset.name).on_hover_text("Its pigment").clicked() {
                            brush.value = fibre.pigment.sigma_a().map(|s| s.sqrt() as f32);
                        }
                    }
                });
            }
            channel => {
                let [least, most] = channel.range();
                let unit = match channel {
                    Channel::Roughness | Channel::Tilt => "°",
                    _ => "",
                };
                let slider = egui::Slider::new(&mut brush.value[0], least..=most).suffix(unit);
                ui.add(slider.text("Value"));
            }
        }
        ui.separator();
        ui.horizontal_wrapped(|ui| {
            for mode in Mode::ALL {
                ui.selectable_value(&mut brush.mode, mode, mode.word());
            }
        });
        ui.add(percent(&mut brush.radius, 0.003..=0.5).logarithmic(true).text("Radius"))
            .on_hover_text("Of the picture's height; [ and ]");
        ui.add(percent(&mut brush.strength, 0.0..=1.0).text("Strength"));
        ui.add(percent(&mut brush.spacing, 0.05..=1.0).text("Spacing"));
        egui::ComboBox::from_label("Falloff").selected_text(brush.falloff.word()).show_ui(
            ui,
            |ui| {
                for falloff in Falloff::ALL {
                    ui.selectable_value(&mut brush.falloff, falloff, falloff.word());
                }
            },
        );
        egui::ComboBox::from_label("Reach").selected_text(brush.reach.word()).show_ui(ui, |ui| {
            for reach in Reach::ALL {
                ui.selectable_value(&mut brush.reach, reach, reach.word());
            }
        });
        ui.add(percent(&mut brush.gradient[0], 0.0..=1.0).text("At the root"));
        ui.add(percent(&mut brush.gradient[1], 0.0..=1.0).text("At the tip"));
        ui.checkbox(&mut brush.mirror, "Mirror left and right");
    }

    fn history_panel(&mut self, ui: &mut Ui) {
        let (steps, done) = self.history.steps();
        let megabytes = self.history.bytes() as f64 / f64::from(1 << 20);
        ui.label("History").on_hover_text(format!("{megabytes:.1} MB kept"));
        if self.history.forgotten > 0 {
            ui.weak(format!("{} older steps let go for memory", self.history.forgotten));
        }
        let mut wanted = None;
        if ui.selectable_label(done == 0, "Opened").clicked() {
            wanted = Some(0);
        }
        for (k, step) in steps.iter().enumerate() {
            let label = egui::RichText::new(step.label());
            let label = if k < done { label } else { label.weak() };
            if ui.push_id(k, |ui| ui.selectable_label(k + 1 == done, label)).inner.clicked() {
                wanted = Some(k + 1);
            }
        }
        if let Some(wanted) = wanted {
            let steps = wanted.abs_diff(done);
            (0..steps).for_each(|_| self.undo(wanted > done));
        }
    }

    // The picture.

    fn viewport(&mut self, ui: &mut Ui) {
        let room = ui.available_rect_before_wrap();
        let [width, height] = self.document.scene.output.size.map(|s| s as f32);
        let scale = (room.width() / width).min(room.height() / height).max(0.0);
        let rect = Rect::from_center_size(room.center(), scale * Vec2::new(width, height));
        self.rect = Some(rect);
        let response = ui.allocate_rect(room, egui::Sense::click_and_drag());
        fields::name_it(&response, "Picture");
        self.shown.paint(ui, rect);
        let ctx = ui.ctx().clone();
        self.drag_over(&ctx, &response, rect);
        if let Some(at) = response.hover_pos().filter(|_| self.tool == Tool::Paint) {
            let color = match self.brush.channel {
                Channel::Absorption => {
                    let sigma_a = self.brush.value.map(|root| f64::from(root * root));
                    fields::swatch(fields::assembly_color(sigma_a))
                }
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

    fn drag_over(&mut self, ctx: &egui::Context, response: &egui::Response, rect: Rect) {
        let (modifiers, delta) = ctx.input(|i| (i.modifiers, i.pointer.delta()));
        let by = |button| response.drag_started_by(button);
        if by(egui::PointerButton::Primary) {
            self.drag = Some(match (self.tool, modifiers) {
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
    fn paint_at(&mut self, at: Pos2, rect: Rect, pressure: f32) {
        let (Some(stage), Some(picture)) = (self.stage.clone(), &self.shown.picture) else {
            return;
        };
        let place = ((at - rect.min) / rect.height()).into();
        if self.places.as_ref().is_none_or(|places| !places.are_through(&picture.lens)) {
            self.places = Some(Places::new(&stage, &picture.lens));
        }
        if self.document.paint.is_none() {
            match stage.paint(&self.document.scene) {
                Ok(paint) => {
                    let bare = Paint::bare(stage.hair.points.len());
                    self.document.paint = Some(Arc::new(paint.unwrap_or(bare)));
                }
                Err(error) => return self.fail(&error),
            }
        }
        let (Some(paint), Some(places)) = (&mut self.document.paint, &self.places) else { return };
        if paint.points() != stage.hair.points.len() {
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

    fn give_up_stroke(&mut self) {
        let Some(stroke) = self.stroke.take() else { return };
        if let Some(paint) = &self.document.paint
            && let Some(step) = stroke.step(paint)
        {
            self.history.push(step);
            self.undo(false);
        }
        self.drag = None;
    }

    fn eyedrop(&mut self, ctx: &egui::Context) {
        let (Some(rect), Some(at)) = (self.rect, ctx.pointer_latest_pos()) else { return };
        let (Some(stage), Some(picture)) = (&self.stage, &self.shown.picture) else { return };
        let places = match self.places.take().filter(|places| places.are_through(&picture.lens)) {
            Some(places) => self.places.insert(places),
            None => self.places.insert(Places::new(stage, &picture.lens)),
        };
        let channel = self.brush.channel;
        let layer = self.document.paint.as_ref().and_then(|paint| paint.layer(channel));
        let bare = bare(&self.document.scene, channel);
        match pick(((at - rect.min) / rect.height()).into(), 0.02, places, layer, bare) {
            Some(value) => self.brush.value = value,
            None => self.say("No hair under the pointer"),
        }
    }

    fn turn(&mut self, ctx: &egui::Context) {
        /// Degrees a second.
        const SPEED: f64 = 36.0;
        let Some(last) = &mut self.turning else { return };
        let seconds = last.elapsed().as_secs_f64();
        // No faster than there are pictures.
        if self.shown.picture.is_some() && seconds > 0.05 {
            *last = Instant::now();
            let orbit = viewport::orbit(&mut self.document.scene, self.stage.as_deref());
            orbit.azimuth_deg = (orbit.azimuth_deg + SPEED * seconds.min(0.3)).rem_euclid(360.0);
        }
        ctx.request_repaint();
    }

    // Files and windows.

    fn ask_path(&mut self, kind: PromptKind) {
        let path = match kind {
            PromptKind::Open => String::new(),
            PromptKind::Save => {
                let path = self.document.path.clone();
                path.unwrap_or_else(|| "scene.toml".into()).to_string_lossy().into_owned()
            }
            PromptKind::Picture => self.document.scene.output.path.clone(),
        };
        self.prompt = Some(Prompt { kind, path, chosen: None });
    }

    fn save(&mut self) {
        match self.document.path.clone() {
            Some(path) => self.save_to(&path),
            None => self.ask_path(PromptKind::Save),
        }
    }

    fn save_to(&mut self, path: &Path) {
        let hair = self.stage.as_ref().map(|stage| &stage.hair);
        match self.document.save(path, hair) {
            Ok(()) => {
                self.settled = self.document.scene.clone();
                self.say(format!("Saved {}", path.display()));
            }
            Err(error) => self.fail(&error),
        }
    }

    fn save_picture(&mut self, path: &Path) {
        let Some(picture) = self.shown.picture.as_ref().filter(|_| self.finished()) else {
            return self.say("The picture is still being refined: save it in a moment");
        };
        match crate::image::write_png_rgba(path, picture.size, &picture.rgba) {
            Ok(()) => self.say(format!("Saved {}", path.display())),
            Err(error) => self.fail(&error),
        }
    }

    /// Opens a scene, or takes a hair, head or map into this one.
    pub fn open(&mut self, path: &Path) {
        match put_file(&mut self.document.scene, path) {
            Ok(true) => self.say(format!("Took {}", path.display())),
            Ok(false) => self.leave(Leaving::Open(path.to_owned())),
            Err(error) => self.fail(&error),
        }
    }

    fn leave(&mut self, leaving: Leaving) {
        if self.document.changed() {
            self.leaving = Some(leaving);
        } else {
            self.left(leaving);
        }
    }

    /// Goes, whatever is not saved.
    fn left(&mut self, leaving: Leaving) {
        let document = match leaving {
            Leaving::Close => {
                self.may_close = true;
                return;
            }
            Leaving::New => Ok(Document::new(Scene::default(), None)),
            Leaving::Open(path) => Document::open(&path),
        };
        match document {
            Ok(document) => {
                self.settled = document.scene.clone();
                self.document = document;
                self.history = History::default();
                self.message = None;
            }
            Err(error) => self.fail(&error),
        }
    }

    fn dropped(&mut self, ctx: &egui::Context) {
        let files = ctx.input(|i| i.raw.dropped_files.clone());
        for path in files.into_iter().map(|file| file.path().to_owned()) {
            if !path.as_os_str().is_empty() {
                self.open(&path);
            }
        }
    }

    fn windows(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        if ctx.input(|i| i.viewport().close_requested()) && !self.may_close {
            self.leave(Leaving::Close);
            if !self.may_close {
                ctx.send_viewport_cmd(egui::ViewportCommand::CancelClose);
            }
        }
        egui::Window::new("Shortcuts").open(&mut self.shortcuts).resizable(false).show(
            &ctx,
            |ui| {
                egui::Grid::new("shortcuts").num_columns(2).striped(true).show(ui, |ui| {
                    for (keys, what) in SHORTCUTS {
                        ui.strong(keys);
                        ui.label(what);
                        ui.end_row();
                    }
                });
            },
        );
        self.leaving_window(&ctx);
        self.prompt_window(&ctx);
    }

    fn leaving_window(&mut self, ctx: &egui::Context) {
        let Some(leaving) = self.leaving.clone() else { return };
        let mut chosen = None;
        egui::Modal::new(egui::Id::unique("leaving")).show(ctx, |ui| {
            ui.label("What was changed is not saved.");
            ui.horizontal(|ui| {
                if ui.button("Save").clicked() {
                    chosen = Some(true);
                }
                if ui.button("Throw away").clicked() {
                    chosen = Some(false);
                }
                if ui.button("Cancel").clicked() {
                    self.leaving = None;
                }
            });
        });
        let Some(save) = chosen else { return };
        self.leaving = None;
        if save {
            self.save();
            if self.document.changed() {
                return;
            }
        }
        let close = leaving == Leaving::Close;
        self.left(leaving);
        if close {
            ctx.send_viewport_cmd(egui::ViewportCommand::Close);
        }
    }

    fn prompt_window(&mut self, ctx: &egui::Context) {
        let Some(mut prompt) = self.prompt.take() else { return };
        let title = match prompt.kind {
            PromptKind::Open => "Open a scene, hair, head or map",
            PromptKind::Save => "Save the scene as",
            PromptKind::Picture => "Save the picture as",
        };
        if let Some(Ok(chosen)) = prompt.chosen.as_ref().map(|chosen| chosen.try_recv()) {
            prompt.chosen = None;
            if let Some(path) = chosen {
                prompt.path = path.to_string_lossy().into_owned();
            }
        }
        let (mut done, mut given_up) = (false, false);
        egui::Modal::new(egui::Id::unique("path")).show(ctx, |ui| {
            ui.label(title);
            ui.horizontal(|ui| {
                let label = ui.label("Path");
                let edit = egui::TextEdit::singleline(&mut prompt.path).desired_width(360.0);
                let edit = ui.add(edit).labelled_by(label.id);
                if edit.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter)) {
                    done = true;
                }
                if ui.add_enabled(prompt.chosen.is_none(), egui::Button::new("Browse…")).clicked()
                {
                    prompt.chosen = Some(browse(prompt.kind, ctx.clone()));
                }
            });
            ui.horizontal(|ui| {
                let word = if prompt.kind == PromptKind::Open { "Open" } else { "Save" };
                done |= ui.button(word).clicked();
                given_up = ui.button("Cancel").clicked();
            });
        });
        if done && !prompt.path.is_empty() {
            let path = PathBuf::from(&prompt.path);
            match prompt.kind {
                PromptKind::Open => self.open(&path),
                PromptKind::Save => self.save_to(&path),
                PromptKind::Picture => self.save_picture(&path),
            }
        } else if !given_up {
            self.prompt = Some(prompt);
        }
    }
}

/// The desktop's own dialog, on a thread; nothing comes of it where there is no desktop.
fn browse(kind: PromptKind, ctx: egui::Context) -> std::sync::mpsc::Receiver<Option<PathBuf>> {
    let (sender, receiver) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let dialog = rfd::FileDialog::new();
        let chosen = match kind {
            PromptKind::Open => dialog
                .add_filter("Scene, hair, head, map", &["toml", "hair", "tfx", "obj", "exr", "hdr"])
                .pick_file(),
            PromptKind::Save => dialog.add_filter("Scene", &["toml"]).save_file(),
            PromptKind::Picture => dialog.add_filter("Picture", &["png"]).save_file(),
        };
        let _ = sender.send(chosen);
        ctx.request_repaint();
    });
    receiver
}

/// What the scene itself has of a channel.
fn bare(scene: &Scene, channel: Channel) -> [f32; 3] {
    let fibre = &scene.fibre;
    let one = |x: f64| [x as f32, 0.0, 0.0];
    match channel {
        Channel::Absorption => fibre.pigment.sigma_a().map(|s| s.sqrt() as f32),
        Channel::Roughness => one(fibre.beta_r_deg),
        Channel::Tilt => one(fibre.alpha_r_deg),
        Channel::Eta => one(fibre.eta),
        Channel::Eccentricity => one(fibre.eccentricity),
    }
}

/// A slider in per cent.
fn percent(x: &mut f32, range: std::ops::RangeInclusive<f32>) -> egui::Slider<'_> {
    egui::Slider::new(x, range).custom_formatter(|x, _| format!("{:.0} %", 100.0 * x))
}
