//! The desktop's own dialogs.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, channel};

use eframe::egui;
use rfd::FileDialog;

/// Asks on a thread; nothing comes of it where there is no desktop.
pub fn ask(
    ctx: &egui::Context,
    dialog: impl FnOnce(FileDialog) -> Option<PathBuf> + Send + 'static,
) -> Receiver<Option<PathBuf>> {
    let (sender, receiver) = channel();
    let ctx = ctx.clone();
    std::thread::spawn(move || {
        let _ = sender.send(dialog(FileDialog::new()));
        ctx.request_repaint();
    });
    receiver
}
