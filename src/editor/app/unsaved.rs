//! Unsaved work: kept while there is any, and what a process that died has left.

use std::path::Path;
use std::sync::mpsc;
use std::time::{Duration, Instant, SystemTime};

use anyhow::Result;
use eframe::egui;

use super::Editor;
use super::files::Leaving;
use crate::editor::document::Document;
use crate::editor::fields::name_it;
use crate::editor::recent::Recent;
use crate::editor::recovery::{Keeper, Set, Work};

#[derive(Default)]
pub(super) struct Unsaved {
    keeper: Option<Keeper>,
    /// No more often.
    every: Duration,
    /// What the keeper has, and since when.
    kept: Option<(Work, Instant)>,
    /// What may be recovered.
    left: Vec<Set>,
    recovering: Option<mpsc::Receiver<(Set, Result<Document>)>>,
}

impl Unsaved {
    /// Keeps nothing any more.
    pub(super) fn forget(&mut self) {
        if let (Some(keeper), Some(_)) = (&self.keeper, self.kept.take()) {
            keeper.forget();
        }
    }

    /// Whether something is asked, or waited for.
    pub(super) fn asking(&self) -> bool {
        !self.left.is_empty() || self.recovering.is_some()
    }

    /// Asks nothing before the next start.
    pub(super) fn later(&mut self) {
        self.left.clear();
    }
}

impl Editor {
    /// Remembers what is opened in the folder `state`, keeps unsaved work there, no more often than `every`, and offers
    /// what is left there.
    pub fn keeping(mut self, state: &Path, every: Duration, ctx: &egui::Context) -> Self {
        let waking = ctx.clone();
        let keeper = Keeper::new(state.to_owned(), move || waking.request_repaint());
        let left = Set::left(state);
        self.files.recent = Recent::read(state);
        if let Some(path) = &self.document.path {
            self.files.recent.add(path);
        }
        self.unsaved = Unsaved { keeper: Some(keeper), every, left, ..Unsaved::default() };
        self
    }

    /// Keeps what is not saved, unless something is held down.
    pub(super) fn keep(&mut self, ctx: &egui::Context) {
        let Some(keeper) = &self.unsaved.keeper else { return };
        if let Some(error) = keeper.failed() {
            self.message = Some((format!("Unsaved work is not kept: {error:#}"), true));
        }
        if self.files.may_close {
            return;
        }
        if !self.document.changed() {
            return self.unsaved.forget();
        }
        if self.stroke.is_some() || ctx.input(|i| i.pointer.any_down()) {
            return;
        }
        if let Some((work, since)) = &self.unsaved.kept {
            if work.is(&self.document) {
                return;
            }
            let wait = self.unsaved.every.saturating_sub(since.elapsed());
            if !wait.is_zero() {
                return ctx.request_repaint_after(wait);
            }
        }
        self.keep_now();
    }

    /// Keeps what is not saved, where anything is kept.
    pub(super) fn keep_now(&mut self) {
        let stage = self.own_stage().cloned();
        let Some(keeper) = self.unsaved.keeper.as_ref().filter(|_| self.document.changed()) else {
            return;
        };
        if self.document.paint.is_none() || stage.is_some() {
            keeper.keep(Work::of(&self.document), stage);
            self.unsaved.kept = Some((Work::of(&self.document), Instant::now()));
        }
    }

    /// Reads what is kept in a folder, on a thread: its hair may be large.
    pub(super) fn recover(&mut self, folder: &Path) {
        let Some(at) = self.unsaved.left.iter().position(|set| set.folder == folder) else {
            return;
        };
        let mut set = self.unsaved.left.remove(at);
        let (sender, receiver) = mpsc::channel();
        self.unsaved.recovering = Some(receiver);
        let waking = self.waking.clone();
        std::thread::spawn(move || {
            let document = set.read();
            let _ = sender.send((set, document));
            waking.request_repaint();
        });
    }

    fn recovered(&mut self, set: Set, document: Result<Document>) {
        match document {
            Ok(document) => {
                self.show(document);
                self.unsaved.kept = Some((Work::of(&self.document), Instant::now()));
                if let Some(keeper) = &self.unsaved.keeper {
                    keeper.adopt(set);
                }
            }
            Err(error) => {
                self.fail(&error);
                self.unsaved.left.push(set);
            }
        }
    }

    pub(super) fn recovery_window(&mut self, ctx: &egui::Context) {
        if let Some(receiver) = self.unsaved.recovering.take() {
            match receiver.try_recv() {
                Ok((set, document)) => self.recovered(set, document),
                Err(mpsc::TryRecvError::Empty) => {
                    egui::Modal::new(egui::Id::unique("recovering"))
                        .show(ctx, |ui| ui.label("Recovering…"));
                    self.unsaved.recovering = Some(receiver);
                }
                Err(mpsc::TryRecvError::Disconnected) => {}
            }
            return;
        }
        if self.unsaved.left.is_empty() || self.files.asking() {
            return;
        }
        let (mut recover, mut throw, mut later) = (None, None, false);
        egui::Modal::new(egui::Id::unique("unsaved")).show(ctx, |ui| {
            ui.label("Hairlight ended before this work was saved:");
            egui::Grid::new("unsaved").show(ui, |ui| {
                for (k, set) in self.unsaved.left.iter().enumerate() {
                    let name = set.path.as_deref().and_then(Path::file_name);
                    let name = name.map_or("untitled".into(), |name| name.to_string_lossy());
                    let label = ui.strong(&*name);
                    if let Some(path) = &set.path {
                        label.on_hover_text(path.display().to_string());
                    }
                    ui.weak(ago(set.written));
                    let button = ui.button("Recover");
                    name_it(&button, &format!("Recover {name}"));
                    if button.clicked() {
                        recover = Some(set.folder.clone());
                    }
                    let button = ui.button("Throw away");
                    name_it(&button, &format!("Throw away {name}"));
                    if button.clicked() {
                        throw = Some(k);
                    }
                    ui.end_row();
                }
            });
            later = ui.button("Later").on_hover_text("Asks again at the next start").clicked();
        });
        if let Some(folder) = recover {
            self.leave(Leaving::Recover(folder));
        }
        if let Some(k) = throw {
            self.unsaved.left.remove(k).remove();
        }
        if later {
            self.unsaved.later();
        }
    }
}

/// How long ago, in words.
fn ago(time: Option<SystemTime>) -> String {
    let minutes = time.and_then(|time| time.elapsed().ok()).map_or(0, |d| d.as_secs() / 60);
    match minutes {
        0 => "just now".to_owned(),
        1..120 => format!("{minutes} min ago"),
        120..2880 => format!("{} hours ago", minutes / 60),
        _ => format!("{} days ago", minutes / 1440),
    }
}
