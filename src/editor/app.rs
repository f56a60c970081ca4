//! A frame of the interface: panels around the picture, what was typed and dragged, and what the worker said.

mod brush_color;
mod fibre;
mod files;
mod light;
mod panels;
mod picture;
mod still;
mod truth;
mod unsaved;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use eframe::egui::{self, Key, KeyboardShortcut, Modifiers, Rect, Ui};

use super::brush::{Brush, Mode, Places, Stroke};
use super::document::Document;
use super::fields;
use super::history::{History, Step};
use super::light_view::LightView;
use super::maps::Maps;
use super::shader_watch::Watch;
use super::viewport::{self, Shown};
use crate::gpu::shaders::Shaders;
use crate::live::{Refusal, Said, Wish, Worker, same};
use crate::scene::{HairSpec, Scene, frame_within};
use crate::stage::Geometry;
use brush_color::BrushColor;
use files::{Files, PromptKind};
use still::Saving;
use truth::Truth;
use unsaved::Unsaved;

const UNDO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::Z);
const REDO: KeyboardShortcut =
    KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::Z);
const SAVE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::S);
const SAVE_AS: KeyboardShortcut =
    KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::S);
const COPY: KeyboardShortcut =
    KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::C);
const OPEN: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::O);
const QUIT: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::Q);

/// What keys and drags do, as `?` shows it.
const SHORTCUTS: [(&str, &str); 21] = [
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
    ("R", "The path-traced truth beside the frame; drag the line between them"),
    ("Drag over the map", "Turn the light; a lamp, by its ring: place it"),
    ("T", "Turntable"),
    ("Ctrl + Z, Ctrl + Shift + Z", "Undo, redo"),
    ("Ctrl + O", "Open a scene, hair, head or map"),
    ("Ctrl + S, Ctrl + Shift + S", "Save, save as"),
    ("Ctrl + Shift + C", "Copy the picture"),
    ("Ctrl + plus, minus, 0", "Size of the interface"),
    ("Ctrl + Q", "Quit"),
    ("Esc", "Give up a stroke, close a window"),
    ("?", "This list"),
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tool {
    View,
    Paint,
}

/// A turntable under way.
struct Turn {
    /// When the camera was last moved.
    last: Instant,
    /// Stops that were metered where it began: one exposure for the whole turn, as in a capture.
    exposure: Option<f64>,
}

/// The editor's state.
pub struct Editor {
    pub document: Document,
    pub history: History,
    pub brush: Brush,
    brush_color: BrushColor,
    tool: Tool,
    worker: Worker,
    /// For threads to wake.
    waking: egui::Context,
    shown: Shown,
    stage: Option<Arc<Geometry>>,
    light: LightView,
    maps: Maps,
    /// The hair of that.
    stage_of: HairSpec,
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
    /// What was said of parts of the scene that cannot be used, since the last picture.
    refusals: Option<String>,
    notes: Vec<String>,
    files: Files,
    truth: Truth,
    /// In place of the built-in ones.
    shaders: Option<Arc<Shaders>>,
    watch: Option<Watch>,
    fibre: fibre::FibreSection,
    unsaved: Unsaved,
    saving: Option<Saving>,
    cancelled: Option<&'static AtomicBool>,
    shortcuts: bool,
    turning: Option<Turn>,
    /// The light's or the brush's drag under way.
    drag: Option<Drag>,
    /// Shows the output's frame alone, and not what lies around it.
    pub frame_only: bool,
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
    /// Between frame and truth.
    Divider,
}

impl Editor {
    pub fn new(document: Document, ctx: &egui::Context) -> Self {
        let waking = ctx.clone();
        Self {
            settled: document.scene.clone(),
            document,
            history: History::default(),
            brush: Brush::default(),
            brush_color: BrushColor::default(),
            tool: Tool::View,
            worker: Worker::new(move || waking.request_repaint()),
            waking: ctx.clone(),
            shown: Shown::default(),
            stage: None,
            light: LightView::default(),
            maps: Maps::default(),
            stage_of: HairSpec::default(),
            asked: None,
            shown_of: 0,
            stroke: None,
            places: None,
            progress: None,
            message: None,
            refusals: None,
            notes: Vec::new(),
            files: Files::default(),
            truth: Truth::default(),
            shaders: None,
            watch: None,
            fibre: fibre::FibreSection::default(),
            unsaved: Unsaved::default(),
            saving: None,
            cancelled: None,
            shortcuts: false,
            turning: None,
            drag: None,
            frame_only: false,
            rect: None,
        }
    }

    /// A frame of the interface.
    pub fn ui(&mut self, ui: &mut Ui) {
        self.stop_if_cancelled(ui.ctx());
        self.listen(ui.ctx());
        self.keys(ui);
        // A minimised window has no room, and its panels keep the widths that they had.
        if ui.available_size().min_elem() > 1.0 {
            self.panels(ui);
        }
        self.windows(ui);
        self.dropped(ui.ctx());
        self.turn(ui.ctx());
        self.settle(ui.ctx());
        self.ask_truth(ui.ctx());
        self.keep(ui.ctx());
        if let Some(line) = fields::refused(ui.ctx()) {
            self.message = Some((line, true));
        }
    }

    fn panels(&mut self, ui: &mut Ui) {
        egui::Panel::top("menu").show(ui, |ui| self.menu(ui));
        egui::Panel::bottom("status").show(ui, |ui| self.status(ui));
        // Of a small window, or a large interface, the picture keeps a third.
        let width = ui.available_width();
        let right = egui::Panel::right("scene").default_size(336.0).max_size(0.38 * width);
        right.show(ui, |ui| scrolled(ui, 316.0, |ui| self.scene_panel(ui)));
        let left = egui::Panel::left("tools").resizable(false);
        let left = left.exact_size(f32::min(250.0, 0.29 * width));
        left.show(ui, |ui| scrolled(ui, 225.0, |ui| self.tool_panel(ui)));
        egui::CentralPanel::no_frame().show(ui, |ui| self.viewport(ui));
    }

    /// Whether the last picture is all that there will be of what is asked.
    pub fn finished(&self) -> bool {
        let newest = self.asked.as_ref().is_some_and(|(number, wish)| {
            *number == self.shown_of
                && wish.scene == self.document.scene
                && same(&wish.paint, &self.document.paint)
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

    /// Closes once `cancelled` is set, whatever is not saved: that is kept as it is after a crash. Who sets it wakes the
    /// window.
    pub fn stopped_by(mut self, cancelled: &'static AtomicBool) -> Self {
        self.cancelled = Some(cancelled);
        self
    }

    fn stop_if_cancelled(&mut self, ctx: &egui::Context) {
        let cancelled = self.cancelled.is_some_and(|cancelled| cancelled.load(Ordering::Relaxed));
        if cancelled && !self.files.may_close {
            self.keep_now();
            self.files.may_close = true;
            ctx.send_viewport_cmd(egui::ViewportCommand::Close);
        }
    }

    /// Draws by the shaders of a folder, read again whenever one of them changes.
    pub fn watch_shaders(&mut self, folder: PathBuf, ctx: &egui::Context) {
        self.watch = Some(Watch::new(folder, ctx.clone()));
    }

    fn listen(&mut self, ctx: &egui::Context) {
        match self.watch.as_ref().and_then(Watch::newest) {
            Some(Ok(shaders)) => {
                self.shaders = Some(Arc::new(shaders));
                self.say("Shaders read");
            }
            Some(Err(error)) => self.fail(&error),
            None => {}
        }
        self.hear_saving();
        let newest = self.asked.as_ref().map_or(0, |(number, _)| *number);
        for (number, said) in self.worker.said().collect::<Vec<_>>() {
            match said {
                Said::Picture(picture) => {
                    if number == newest {
                        self.progress = (!picture.finished).then_some(("refining", 0.0));
                    }
                    self.shown_of = number;
                    self.refusals = None;
                    self.shown.put(ctx, picture);
                }
                Said::Progress(what, done) if number == newest => {
                    self.progress = Some((what, done))
                }
                Said::Progress(..) => {}
                Said::Geometry(of, stage) => {
                    (self.stage, self.stage_of) = (Some(stage), of);
                    self.places = None;
                }
                Said::Light(light) => self.light.put(light),
                Said::Note(line) => self.notes.push(line),
                Said::Failed(line) => {
                    if number == newest {
                        self.progress = None;
                    }
                    self.message = Some((line, true));
                }
                Said::Refused(refusal) => self.refused(*refusal),
            }
        }
    }

    /// Goes on with what can be used in place of a part of the scene that cannot be, in the document and its history.
    fn refused(&mut self, refusal: Refusal) {
        let Refusal { part, line, refused, instead } = refusal;
        self.history.replace(part, &refused, &instead);
        if part.same(&self.settled, &refused) {
            part.copy(&instead, &mut self.settled);
        }
        // Something else may have been opened meanwhile.
        if part.same(&self.document.scene, &refused) {
            self.document.replace(part, &refused, &instead);
            let line = format!("{line}; in its place: {}", part.describe(&instead));
            // Of several that are wrong, one is found after another.
            let before = self.refusals.take().filter(|_| self.is_wrong());
            let line = before.map_or(line.clone(), |before| format!("{before}\n{line}"));
            self.message = Some((line.clone(), true));
            self.refusals = Some(line);
        }
    }

    /// Whether a dialog is open that waits for an answer.
    fn asking(&self) -> bool {
        self.files.asking() || self.unsaved.asking()
    }

    fn is_wrong(&self) -> bool {
        self.message.as_ref().is_some_and(|(_, wrong)| *wrong)
    }

    /// The geometry, once it is that of the document's hair.
    fn own_stage(&self) -> Option<&Arc<Geometry>> {
        self.stage.as_ref().filter(|_| self.stage_of == *self.document.shape())
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
        let mut scene = self.document.scene.clone();
        if let Some(turn) = &self.turning {
            scene.output.exposure = scene.output.exposure.or(turn.exposure);
        }
        let (paint, shaders) = (self.document.paint.clone(), self.shaders.clone());
        let wish = Wish { scene, paint, size, moving: held, shaders };
        let same = self.asked.as_ref().is_some_and(|(_, asked)| {
            asked.same(&wish) && (asked.moving == wish.moving || wish.moving)
        });
        if !same {
            let number = self.worker.ask(wish.clone());
            self.asked = Some((number, wish));
        }
    }

    /// Of the output's frame within the picture, in pixels.
    fn frame_size(&self, ctx: &egui::Context) -> Option<[u32; 2]> {
        Some(frame_within(self.document.scene.output.size, self.size(ctx)?))
    }

    /// Of the picture in pixels.
    fn size(&self, ctx: &egui::Context) -> Option<[u32; 2]> {
        let size = self.rect?.size() * ctx.pixels_per_point();
        (size.x >= 1.0 && size.y >= 1.0).then_some([size.x.round() as u32, size.y.round() as u32])
    }

    fn undo(&mut self, redo: bool) {
        if self.stroke.is_some() {
            return;
        }
        if !self.document.step(&mut self.history, redo) {
            self.say(if redo { "Nothing to redo" } else { "Nothing to undo" });
            return;
        }
        self.settled = self.document.scene.clone();
    }

    fn keys(&mut self, ui: &Ui) {
        let ctx = ui.ctx();
        // What is behind a dialog has no keys.
        if self.asking() {
            if !ctx.text_edit_focused() {
                self.escape(ctx);
            }
            return;
        }
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
        if pressed(&COPY) {
            self.copy_picture(ctx);
        }
        if pressed(&OPEN) {
            self.ask_path(PromptKind::Open);
        }
        if pressed(&QUIT) {
            ctx.send_viewport_cmd(egui::ViewportCommand::Close);
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
        if key(Key::R) {
            self.truth.on = !self.truth.on;
        }
        if key(Key::T) {
            self.set_turning(self.turning.is_none());
        }
        if key(Key::I) {
            self.eyedrop(ctx);
        }
        self.escape(ctx);
        if ctx.input(|i| i.events.iter().any(|e| matches!(e, egui::Event::Text(t) if t == "?"))) {
            self.shortcuts = !self.shortcuts;
        }
    }

    fn escape(&mut self, ctx: &egui::Context) {
        // Not taken away: menus and lists close by it too.
        if ctx.input(|i| i.key_pressed(Key::Escape)) {
            self.give_up_stroke();
            self.shortcuts = false;
            self.maps.open = false;
            if !self.files.asking() {
                self.unsaved.later();
            }
            self.files.give_up();
        }
    }

    fn resize_brush(&mut self, by: f32) {
        self.brush.radius = (self.brush.radius * by).clamp(0.003, 0.5);
    }
}

/// Shows what takes a panel's width, `natural` at least, and scrolls where there is no room for it.
fn scrolled(ui: &mut Ui, natural: f32, show: impl FnOnce(&mut Ui)) {
    let narrow = ui.available_width() < natural;
    egui::ScrollArea::new([narrow, true]).auto_shrink(false).show(ui, |ui| {
        if narrow {
            ui.set_width(natural);
        }
        show(ui);
    });
}
