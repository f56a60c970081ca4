//! The picture to be kept: made as `capture` makes it, on a thread, or copied as it is shown.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};

use anyhow::{Result, anyhow};
use eframe::egui::{self, Ui};

use super::Editor;
use crate::capture::{self, CaptureOptions};
use crate::editor::fields::{field, name_it};
use crate::progress::Reporting;
use crate::scene::{Background, OutputSpec, Scene, frame_within};

/// A picture that is being made and saved; given up where it is dropped.
pub(super) struct Saving {
    path: PathBuf,
    cancelled: Arc<AtomicBool>,
    told: mpsc::Receiver<Told>,
    /// What is being done, and the share done.
    now: (&'static str, f32),
}

enum Told {
    Progress(&'static str, f32),
    Done(Result<()>),
}

impl Drop for Saving {
    fn drop(&mut self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }
}

/// Size, samples and background of a picture of `scene`; `own` is what the scene itself has, `window` the size of its
/// frame in the window.
pub(super) fn picture_fields(
    ui: &mut Ui,
    scene: &mut Scene,
    own: &OutputSpec,
    window: Option<[u32; 2]>,
) {
    field(ui, "output.size", scene);
    ui.horizontal(|ui| {
        if ui.button("The scene's size").clicked() {
            scene.output.size = own.size;
        }
        if let Some(size) = window
            && ui.button("The window's size").clicked()
        {
            scene.output.size = size;
        }
    });
    field(ui, "render.samples", scene);
    let mut clear = scene.output.background == Background::Transparent;
    if ui.checkbox(&mut clear, "Transparent background").changed() {
        scene.output.background = match own.background {
            _ if clear => Background::Transparent,
            Background::Transparent => Background::Environment,
            other => other,
        };
    }
    ui.weak("A .png as it is seen, an .exr with the light's own numbers");
}

impl Editor {
    /// Makes the picture of `scene`, with what is painted, on a thread, and writes it to `path`.
    pub(super) fn save_picture(&mut self, mut scene: Scene, path: &Path) {
        if self.saving.is_some() {
            return self.say("A picture is still being saved: wait for it, or cancel it");
        }
        scene.output.path = path.to_string_lossy().into_owned();
        (scene.output.turntable, scene.output.stats) = (0, None);
        let paint = self.document.paint.clone();
        let cancelled = Arc::new(AtomicBool::new(false));
        let (sender, told) = mpsc::channel();
        let (flag, waking) = (cancelled.clone(), self.waking.clone());
        std::thread::spawn(move || {
            // Nobody listens once it is given up.
            let tell = |what: Told| {
                let _ = sender.send(what);
                waking.request_repaint();
            };
            let progress = |what, done| tell(Told::Progress(what, done));
            let reporting = Reporting { quiet: true, cancelled: &flag, told: Some(&progress) };
            let options = CaptureOptions { paint: paint.as_deref(), verify: false, reporting };
            tell(Told::Done(capture::run(&scene, &options)));
        });
        self.saving =
            Some(Saving { path: path.to_owned(), cancelled, told, now: ("loading", 0.0) });
    }

    /// Hears how far the picture is.
    pub(super) fn hear_saving(&mut self) {
        let Some(saving) = &mut self.saving else { return };
        let done = loop {
            match saving.told.try_recv() {
                Ok(Told::Progress(what, done)) => saving.now = (what, done),
                Ok(Told::Done(done)) => break done,
                Err(mpsc::TryRecvError::Empty) => return,
                Err(mpsc::TryRecvError::Disconnected) => {
                    break Err(anyhow!("{}: could not be made", saving.path.display()));
                }
            }
        };
        let line = format!("Saved {}", saving.path.display());
        self.saving = None;
        match done {
            Ok(()) => self.say(line),
            Err(error) => self.fail(&error),
        }
    }

    pub(super) fn saving_status(&mut self, ui: &mut Ui) {
        let Some(Saving { path, now: (what, done), .. }) = &self.saving else { return };
        let cancel = ui.small_button("Cancel");
        name_it(&cancel, "Cancel saving");
        ui.add(egui::ProgressBar::new(*done).desired_width(60.0).desired_height(6.0));
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        ui.weak(format!("Saving {name}: {what}"));
        if cancel.clicked() {
            self.saving = None;
            self.say("The picture was not saved");
        }
    }

    /// Copies the output's frame as it is shown.
    pub(super) fn copy_picture(&mut self, ctx: &egui::Context) {
        let Some(picture) = self.shown.picture.as_ref().filter(|_| self.finished()) else {
            return self.say("The picture is still being refined: copy it in a moment");
        };
        let [width, height] = picture.size.map(|s| s as usize);
        let frame = frame_within(self.document.scene.output.size, picture.size);
        let [wide, high] = frame.map(|s| s as usize);
        let (left, top) = ((width - wide) / 2, (height - high) / 2);
        let rows = picture.rgba.chunks_exact(4 * width).skip(top).take(high);
        let rgba: Vec<u8> =
            rows.flat_map(|row| &row[4 * left..4 * (left + wide)]).copied().collect();
        ctx.copy_image(egui::ColorImage::from_rgba_unmultiplied([wide, high], &rgba));
        self.say("Copied the picture");
    }
}
