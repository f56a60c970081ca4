//! Files of the editor: what is opened, saved and asked for.

use std::path::{Path, PathBuf};

use eframe::egui::{self, Key, Ui};

use super::still::picture_fields;
use super::{Editor, History, SHORTCUTS};
use crate::editor::desktop;
use crate::editor::document::{Document, put_file};
use crate::editor::fields::name_it;
use crate::editor::recent::Recent;
use crate::file::typed_path;
use crate::scene::Scene;

/// A path that is asked for.
struct Prompt {
    kind: PromptKind,
    path: String,
    /// From the desktop's own dialog, on a thread.
    chosen: Option<std::sync::mpsc::Receiver<Option<PathBuf>>>,
    /// Of a picture: the scene, with what is asked for the picture alone.
    scene: Option<Scene>,
    /// What goes on once it is saved there.
    then: Option<Leaving>,
    /// Nothing was typed or clicked yet.
    new: bool,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum PromptKind {
    Open,
    Save,
    Picture,
}

/// What is asked before unsaved work would be lost.
#[derive(Clone, PartialEq)]
pub(super) enum Leaving {
    Close,
    Open(PathBuf),
    New,
    /// For the unsaved work in this folder.
    Recover(PathBuf),
}

/// What is asked of the user.
#[derive(Default)]
pub(super) struct Files {
    prompt: Option<Prompt>,
    leaving: Option<Leaving>,
    pub(super) recent: Recent,
    /// The close was allowed.
    pub(super) may_close: bool,
}

impl Files {
    /// Asks nothing any more.
    pub(super) fn give_up(&mut self) {
        (self.prompt, self.leaving) = (None, None);
    }

    /// Whether something is asked.
    pub(super) fn asking(&self) -> bool {
        self.prompt.is_some() || self.leaving.is_some()
    }
}

impl Editor {
    pub(super) fn ask_path(&mut self, kind: PromptKind) {
        let path = match kind {
            PromptKind::Open => String::new(),
            PromptKind::Save => {
                let path = self.document.path.clone();
                path.unwrap_or_else(|| "scene.toml".into()).to_string_lossy().into_owned()
            }
            PromptKind::Picture => self.document.scene.output.path.clone(),
        };
        let scene = (kind == PromptKind::Picture).then(|| self.document.scene.clone());
        self.files.prompt = Some(Prompt { kind, path, chosen: None, scene, then: None, new: true });
    }

    pub(super) fn save(&mut self) {
        match self.document.path.clone() {
            Some(path) => self.save_to(&path),
            None => self.ask_path(PromptKind::Save),
        }
    }

    pub(super) fn save_to(&mut self, path: &Path) {
        let stage = self.own_stage().cloned();
        let hair = stage.as_ref().map(|stage| stage.groom());
        match self.document.save(path, hair) {
            Ok(()) => {
                self.settled = self.document.scene.clone();
                self.files.recent.add(path);
                self.say(format!("Saved {}", path.display()));
            }
            Err(error) => self.fail(&error),
        }
    }

    /// Opens a scene, or takes a hair, head or map into this one.
    pub fn open(&mut self, path: &Path) {
        match put_file(&mut self.document.scene, path) {
            Ok(true) => {
                self.files.recent.add(path);
                self.say(format!("Opened {}", path.display()));
            }
            Ok(false) => self.leave(Leaving::Open(path.to_owned())),
            Err(error) => self.fail(&error),
        }
    }

    /// What was opened or saved last, to be opened again.
    pub(super) fn recent_menu(&mut self, ui: &mut Ui) {
        let mut chosen = None;
        ui.menu_button("Open recent", |ui| {
            for path in self.files.recent.there() {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                let folder = path.parent().unwrap_or(Path::new("")).to_string_lossy();
                let button = ui.add(egui::Button::new(&*name).shortcut_text(&*folder));
                name_it(&button, &path.to_string_lossy());
                if button.clicked() {
                    chosen = Some(path.to_owned());
                }
            }
            if self.files.recent.there().next().is_none() {
                ui.weak("Nothing yet");
            }
        });
        if let Some(path) = chosen {
            self.open(&path);
        }
    }

    pub(super) fn leave(&mut self, leaving: Leaving) {
        if self.document.changed() {
            self.files.prompt = None;
            self.files.leaving = Some(leaving);
        } else {
            self.left(leaving);
        }
    }

    /// Goes, whatever is not saved.
    pub(super) fn left(&mut self, leaving: Leaving) {
        let document = match leaving {
            Leaving::Close => {
                self.files.may_close = true;
                self.unsaved.forget();
                return;
            }
            Leaving::Recover(folder) => return self.recover(&folder),
            Leaving::New => Ok(Document::new(Scene::default(), None)),
            Leaving::Open(path) => Document::open(&path),
        };
        match document {
            Ok(document) => {
                if let Some(path) = &document.path {
                    self.files.recent.add(path);
                }
                self.show(document);
            }
            Err(error) => self.fail(&error),
        }
    }

    /// A document in place of the one that was left.
    pub(super) fn show(&mut self, document: Document) {
        self.settled = document.scene.clone();
        self.document = document;
        self.history = History::default();
        self.message = None;
    }

    pub(super) fn dropped(&mut self, ctx: &egui::Context) {
        let files = ctx.input(|i| i.raw.dropped_files.clone());
        if self.asking() && !files.is_empty() {
            return self.say("Answer what is asked first, then drop the file again");
        }
        for path in files.into_iter().map(|file| file.path().to_owned()) {
            if !path.as_os_str().is_empty() {
                self.open(&path);
            }
        }
    }

    pub(super) fn windows(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        if ctx.input(|i| i.viewport().close_requested()) && !self.files.may_close {
            self.leave(Leaving::Close);
            if !self.files.may_close {
                ctx.send_viewport_cmd(egui::ViewportCommand::CancelClose);
            }
        }
        let shortcuts = egui::Window::new("Shortcuts").open(&mut self.shortcuts).resizable(false);
        let most = ctx.content_rect().size() - egui::Vec2::new(30.0, 60.0);
        shortcuts.scroll(true).max_size(most).show(&ctx, |ui| {
            egui::Grid::new("shortcuts").num_columns(2).striped(true).show(ui, |ui| {
                for (keys, what) in SHORTCUTS {
                    ui.strong(keys);
                    ui.label(what);
                    ui.end_row();
                }
            });
        });
        self.recovery_window(&ctx);
        self.leaving_window(&ctx);
        self.prompt_window(&ctx);
        if self.files.may_close {
            ctx.send_viewport_cmd(egui::ViewportCommand::Close);
        }
    }

    pub(super) fn leaving_window(&mut self, ctx: &egui::Context) {
        let Some(leaving) = self.files.leaving.clone() else { return };
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
                    self.files.leaving = None;
                }
            });
        });
        let Some(save) = chosen else { return };
        self.files.leaving = None;
        if save {
            self.save();
            if let Some(prompt) = &mut self.files.prompt {
                prompt.then = Some(leaving);
                return;
            }
            if self.document.changed() {
                return;
            }
        }
        self.left(leaving);
    }

    pub(super) fn prompt_window(&mut self, ctx: &egui::Context) {
        let Some(mut prompt) = self.files.prompt.take() else { return };
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
                if std::mem::take(&mut prompt.new) {
                    edit.request_focus();
                }
                if edit.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter)) {
                    done = true;
                }
                if ui.add_enabled(prompt.chosen.is_none(), egui::Button::new("Browse…")).clicked()
                {
                    prompt.chosen = Some(browse(prompt.kind, ctx));
                }
            });
            if let Some(scene) = &mut prompt.scene {
                let window = self.frame_size(ctx);
                picture_fields(ui, scene, &self.document.scene.output, window);
            }
            ui.horizontal(|ui| {
                let word = if prompt.kind == PromptKind::Open { "Open" } else { "Save" };
                done |= ui.button(word).clicked();
                given_up = ui.button("Cancel").clicked();
            });
            // Keys of the window rest while text is typed.
            given_up |= ui.input(|i| i.key_pressed(Key::Escape));
        });
        let path = PathBuf::from(typed_path(&prompt.path));
        if done && !path.as_os_str().is_empty() {
            match prompt.kind {
                PromptKind::Open => self.open(&path),
                PromptKind::Save => {
                    self.save_to(&path);
                    if self.document.changed() {
                        // Another path may do.
                        self.files.prompt = Some(prompt);
                    } else if let Some(then) = prompt.then {
                        self.left(then);
                    }
                }
                PromptKind::Picture => {
                    let scene = prompt.scene.unwrap_or_default();
                    self.save_picture(scene, &path);
                }
            }
        } else if !given_up {
            self.files.prompt = Some(prompt);
        }
    }
}

/// The desktop's own dialog.
fn browse(kind: PromptKind, ctx: &egui::Context) -> std::sync::mpsc::Receiver<Option<PathBuf>> {
    desktop::ask(ctx, move |dialog| match kind {
        PromptKind::Open => dialog
            .add_filter("Scene, hair, head, map", &["toml", "hair", "tfx", "obj", "exr", "hdr"])
            .pick_file(),
        PromptKind::Save => dialog.add_filter("Scene", &["toml"]).save_file(),
        PromptKind::Picture => dialog.add_filter("Picture", &["png", "exr"]).save_file(),
    })
}
