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
use std::time::Duration;

use anyhow::{Result, anyhow};
use eframe::egui;

use crate::file::state_folder;

pub use app::Editor;
pub use brush::{Brush, Canvas, Falloff, Mode, Places, Reach, Stroke};
pub use document::{Document, put_file};
pub use history::{History, Step};
pub use light_view::outline;

/// Unsaved work is kept no more often.
const KEPT_EVERY: Duration = Duration::from_secs(30);

/// Of the window. A surface that is lost or out of date is made anew: so eframe does by itself.
pub fn options() -> eframe::NativeOptions {
    eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("Hairlight")
            .with_app_id("hairlight")
            .with_inner_size([1280.0, 800.0])
            .with_min_inner_size([640.0, 400.0])
            .with_drag_and_drop(true),
        ..Default::default()
    }
}

/// Opens the window on a document and comes back when it is closed. `shaders`: a folder to draw by in place of the
/// built-in ones.
///
/// # Errors
/// One line, where no window can be opened.
pub fn run(document: Document, shaders: Option<PathBuf>) -> Result<()> {
    let editor = |ctx: &egui::Context| {
        let mut editor = Editor::new(document, ctx);
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
    })
}
