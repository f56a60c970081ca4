//! What was opened and saved last, from one start to the next.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Result;

use crate::file::write_whole;

/// So many are remembered.
const MOST: usize = 10;

/// Files, the newest first. By default they are forgotten at the end.
#[derive(Default)]
pub struct Recent {
    file: Option<PathBuf>,
    paths: Vec<PathBuf>,
}

impl Recent {
    /// What is remembered in the folder `state`; nothing, where that is missing or damaged.
    pub fn read(state: &Path) -> Self {
        let file = state.join("recent.json");
        let paths = read(&file);
        Self { file: Some(file), paths }
    }

    /// Those that are still there.
    pub fn there(&self) -> impl Iterator<Item = &Path> {
        self.paths.iter().map(PathBuf::as_path).filter(|path| path.is_file())
    }

    /// Puts a file first.
    pub fn add(&mut self, path: &Path) {
        let Ok(path) = std::path::absolute(path) else { return };
        if let Some(file) = &self.file {
            // Another window may have opened something too.
            let known = read(file);
            if !known.is_empty() {
                self.paths = known;
            }
        }
        self.paths.retain(|other| *other != path);
        self.paths.insert(0, path);
        self.paths.truncate(MOST);
        // The list is as good without its copy, so a full disk or a read-only home says nothing.
        let _ = self.write();
    }

    fn write(&self) -> Result<()> {
        let Some(file) = &self.file else { return Ok(()) };
        std::fs::create_dir_all(file.parent().unwrap_or(Path::new("")))?;
        let text = serde_json::to_vec(&self.paths)?;
        write_whole(file, |file| Ok(file.write_all(&text)?))
    }
}

fn read(file: &Path) -> Vec<PathBuf> {
    let bytes = std::fs::read(file).unwrap_or_default();
    serde_json::from_slice(&bytes).unwrap_or_default()
}
