//! A folder of shaders, read again whenever one of them changes.

use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::{Duration, SystemTime};

use anyhow::Result;
use eframe::egui;

use crate::gpu::shaders::Shaders;

/// Between two looks at the folder.
const PAUSE: Duration = Duration::from_millis(250);

/// A thread that looks at the folder until this is dropped.
pub struct Watch {
    read: mpsc::Receiver<Result<Shaders>>,
}

impl Watch {
    pub fn new(folder: PathBuf, ctx: egui::Context) -> Watch {
        let (sender, read) = mpsc::channel();
        std::thread::spawn(move || {
            let mut before = None;
            loop {
                let now = changed(&folder);
                if before != Some(now) {
                    before = Some(now);
                    if sender.send(Shaders::read(&folder)).is_err() {
                        return;
                    }
                    ctx.request_repaint();
                }
                std::thread::sleep(PAUSE);
            }
        });
        Watch { read }
    }

    /// What was read since, and last.
    pub fn newest(&self) -> Option<Result<Shaders>> {
        self.read.try_iter().last()
    }
}

/// When a file of the folder was written last, and how many there are; None where it cannot be looked into.
fn changed(folder: &Path) -> Option<(SystemTime, usize)> {
    let times = std::fs::read_dir(folder).ok()?.filter_map(|entry| {
        let entry = entry.ok()?;
        let shader = entry.path().extension().is_some_and(|extension| extension == "wgsl");
        entry.metadata().ok().filter(|_| shader)?.modified().ok()
    });
    times.fold(None, |all, time| match all {
        None => Some((time, 1)),
        Some((last, count)) => Some((time.max(last), count + 1)),
    })
}
