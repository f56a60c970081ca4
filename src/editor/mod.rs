//! The editor: a window on a live scene, to change and to paint it.
//!
//! - `document`: the scene and its paint, open and saved.
//! - `history`: what was done, step by step, to be undone.
//! - `brush`: from a place on the screen to paint on strands.
//! - `viewport`: the picture, the camera and the brush over it.
//! - `light_view`: the map and its lights, to be looked at and turned.
//! - `maps`: maps to choose from, with thumbnails.
//! - `shader_watch`: shaders that are read again when they change.
//! - `speed_plot`: speed against error, of the view that is shown.
//! - `recent`: what was opened last.
//! - `recovery`: unsaved work, kept for when a process dies.
//! - `fields`: the widgets of the scene's table of fields; nothing here names a range.
//! - `lobes`, `lobe_plot`: a fibre's lobes as curves, drawn; `hints`: what a field does, in small pictures of them.
//! - `thumbnails`: presets as pictures; `later`: what takes time, made on a thread.
//! - `desktop`: the desktop's own dialogs.
//! - `app`: what holds them together: a frame of the interface, its sections a file each.

mod app;
mod brush;
mod desktop;
mod document;
mod fields;
mod hints;
mod history;
mod later;
mod light_view;
mod lobe_plot;
pub mod lobes;
mod maps;
mod recent;
mod recovery;
mod shader_watch;
mod speed_plot;
mod thumbnails;
mod viewport;

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Result, anyhow, bail};
use eframe::egui;

use crate::file::state_folder;

pub use app::Editor;
pub use brush::{Brush, Canvas, Falloff, Mode, Places, Reach, Stroke};
pub use document::{Document, put_file};
pub use history::{History, Step};
pub use light_view::outline;
pub use thumbnails::{SIDE as PRESET_SIDE, preset_scene};

/// Unsaved work is kept no more often.
const KEPT_EVERY: Duration = Duration::from_secs(30);

/// Between two looks at whether the window is to be closed from outside.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Of the window. A surface that is lost or out of date is made anew: so eframe does by itself.
pub fn options() -> eframe::NativeOptions {
    eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("Hairlight")
            .with_app_id("hairlight")
            .with_inner_size([1280.0, 800.0])
            .with_min_inner_size([320.0, 240.0])
            .with_drag_and_drop(true),
        ..Default::default()
    }
}

/// Opens the window on a document and comes back when it is closed, or once `cancelled` is set; what is not saved then is
/// kept. `shaders`: a folder to draw by in place of the built-in ones.
///
/// # Errors
/// One line, where no window can be opened; "cancelled".
pub fn run(
    document: Document,
    shaders: Option<PathBuf>,
    cancelled: &'static AtomicBool,
) -> Result<()> {
    let editor = |ctx: &egui::Context| {
        let mut editor = Editor::new(document, ctx).stopped_by(cancelled);
        let ctx_to_wake = ctx.clone();
        std::thread::spawn(move || {
            while !cancelled.load(Ordering::Relaxed) {
                std::thread::sleep(LOOK_EVERY);
            }
            ctx_to_wake.request_repaint();
        });
        if let Some(folder) = shaders {
            editor.watch_shaders(folder, ctx);
        }
        match state_folder() {
            Some(folder) => editor.keeping(&folder, KEPT_EVERY, ctx),
            None => editor,
        }
    };
    struct Window(Editor);
    impl eframe::App for Window {
        fn ui(&mut self, ui: &mut egui::Ui, _: &mut eframe::Frame) {
            self.0.ui(ui);
        }
    }
    let opened = eframe::run_native(
        "hairlight",
        options(),
        Box::new(|context| Ok(Box::new(Window(editor(&context.egui_ctx))))),
    );
    opened.map_err(|error| {
        anyhow!(
            "no window can be opened ({error}): run it on a desktop, or use `hairlight capture`"
        )
    })?;
    if cancelled.load(Ordering::Relaxed) {
        bail!("cancelled");
    }
    Ok(())
}
