//! Unsaved work that outlives its process: kept while there is any, offered at the next start.
//!
//! `STATE/unsaved/` has a folder for each process with unsaved work, whose `lock` is held as long as the process lives.
//! `work.json` says the scene and names the paint that goes with it; it is written last, so that the two always belong
//! together.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::SystemTime;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use super::document::Document;
use crate::file::write_whole;
use crate::live::same;
use crate::paint::Paint;
use crate::scene::Scene;
use crate::stage::{Geometry, load_hair};

/// What would be lost.
pub struct Work {
    pub scene: Scene,
    pub paint: Option<Arc<Paint>>,
    /// Where it is saved.
    pub path: Option<PathBuf>,
}

impl Work {
    pub fn of(document: &Document) -> Self {
        let Document { scene, paint, path, .. } = document.clone();
        Self { scene, paint, path }
    }

    /// Whether it is all of a document.
    pub fn is(&self, document: &Document) -> bool {
        same(&self.paint, &document.paint)
            && (&self.path, &self.scene) == (&document.path, &document.scene)
    }
}

/// `work.json`.
#[derive(Serialize, Deserialize)]
struct Kept {
    /// Where it is saved.
    path: Option<PathBuf>,
    /// Relative paths of the scene start here.
    folder: PathBuf,
    /// A scene file.
    scene: String,
    /// Name of the paint's file beside this one.
    paint: Option<String>,
}

/// A folder of unsaved work, nobody else's while this lives.
pub struct Set {
    pub folder: PathBuf,
    /// Of what another process has left: when, and where it is saved.
    pub written: Option<SystemTime>,
    pub path: Option<PathBuf>,
    lock: File,
    /// What is in which file.
    paint: Option<(Arc<Paint>, String)>,
}

/// The names of its paint, in turn: the old one stays until `work.json` names the new one.
const PAINTS: [&str; 2] = ["a.paint", "b.paint"];

impl Set {
    fn new(state: &Path) -> Result<Self> {
        let all = state.join("unsaved");
        let made = fs::create_dir_all(&all)
            .and_then(|()| tempfile::Builder::new().prefix("").tempdir_in(&all))
            .with_context(|| format!("{}: cannot be made", all.display()))?;
        let folder = made.keep();
        let lock = File::create(folder.join("lock"))?;
        lock.try_lock().with_context(|| format!("{}: cannot be locked", folder.display()))?;
        Ok(Self { folder, written: None, path: None, lock, paint: None })
    }

    /// What processes that are no more have left, the newest first.
    pub fn left(state: &Path) -> Vec<Set> {
        let Ok(folders) = fs::read_dir(state.join("unsaved")) else { return Vec::new() };
        let open = |folder: PathBuf| {
            let lock = File::options().write(true).open(folder.join("lock")).ok()?;
            lock.try_lock().ok()?;
            let mut set = Self { folder, written: None, path: None, lock, paint: None };
            set.written = Some(fs::metadata(set.file()).ok()?.modified().ok()?);
            set.path = set.kept().ok().and_then(|kept| kept.path);
            Some(set)
        };
        let mut sets: Vec<_> = folders.flatten().filter_map(|entry| open(entry.path())).collect();
        sets.sort_by_key(|set| std::cmp::Reverse(set.written));
        sets
    }

    fn file(&self) -> PathBuf {
        self.folder.join("work.json")
    }

    /// Keeps work in place of what there was; paint needs the geometry that it is on.
    ///
    /// # Errors
    /// One line that names the file; what there was stays.
    fn write(&mut self, work: &Work, stage: Option<&Geometry>) -> Result<()> {
        let paint = match work.paint.as_ref().zip(stage) {
            None => None,
            Some((paint, stage)) => {
                let name = match &self.paint {
                    Some((known, name)) if Arc::ptr_eq(known, paint) => name.clone(),
                    Some((_, name)) => PAINTS[usize::from(name == PAINTS[0])].to_owned(),
                    None => PAINTS[0].to_owned(),
                };
                paint.write(&self.folder.join(&name), stage.groom())?;
                Some((paint.clone(), name))
            }
        };
        let kept = Kept {
            path: work.path.as_deref().map(std::path::absolute).transpose()?,
            folder: std::env::current_dir()?,
            scene: work.scene.to_toml(),
            paint: paint.as_ref().map(|(_, name)| name.clone()),
        };
        let text = serde_json::to_vec(&kept)?;
        write_whole(&self.file(), |file| Ok(file.write_all(&text)?))?;
        self.paint = paint;
        Ok(())
    }

    fn kept(&self) -> Result<Kept> {
        let attempt = || -> Result<Kept> { Ok(serde_json::from_slice(&fs::read(self.file())?)?) };
        attempt().with_context(|| format!("{}: cannot be read", self.file().display()))
    }

    /// What is kept, as a document that is not saved. It loads the hair that was painted on.
    ///
    /// # Errors
    /// One line that names the file.
    pub fn read(&mut self) -> Result<Document> {
        let kept = self.kept()?;
        let here = std::env::current_dir().is_ok_and(|here| here == kept.folder);
        let folder = if here { Path::new("") } else { &kept.folder };
        let name = self.file().display().to_string();
        let scene = Scene::from_toml(&kept.scene, &name, folder)?;
        if let Some(name) = kept.paint {
            let hair = load_hair(&scene)?.hair;
            let paint = Paint::read(&self.folder.join(&name), &hair)?;
            self.paint = Some((Arc::new(paint), name));
        }
        let paint = self.paint.as_ref().map(|(paint, _)| paint.clone());
        Ok(Document::unsaved(scene, paint, kept.path))
    }

    /// Forgets what is kept.
    pub fn remove(self) {
        let Self { folder, lock, .. } = self;
        // Some systems remove no open file.
        drop(lock);
        let _ = fs::remove_dir_all(folder);
    }
}

enum Order {
    Keep(Box<Work>, Option<Arc<Geometry>>),
    Adopt(Set),
    Forget,
}

/// Keeps this process's unsaved work, on a thread. Once dropped, what is kept and not forgotten stays.
pub struct Keeper {
    orders: Option<mpsc::Sender<Order>>,
    failed: mpsc::Receiver<anyhow::Error>,
    thread: Option<JoinHandle<()>>,
}

impl Keeper {
    /// Keeps in the folder `state`, which is made where it is missing; `wake` is called when that failed.
    pub fn new(state: PathBuf, wake: impl Fn() + Send + 'static) -> Self {
        let (orders, taken) = mpsc::channel();
        let (sender, failed) = mpsc::channel();
        let thread = std::thread::spawn(move || {
            let mut own: Option<Set> = None;
            for order in taken {
                let before = match order {
                    Order::Keep(work, stage) => {
                        let set = own.take().map_or_else(|| Set::new(&state), Ok);
                        let kept = set.and_then(|mut set| {
                            let written = set.write(&work, stage.as_deref());
                            own = Some(set);
                            written
                        });
                        if let Err(error) = kept {
                            // Nobody listens once the window is closed.
                            let _ = sender.send(error);
                            wake();
                        }
                        None
                    }
                    Order::Adopt(set) => own.replace(set),
                    Order::Forget => own.take(),
                };
                if let Some(before) = before {
                    before.remove();
                }
            }
        });
        Self { orders: Some(orders), failed, thread: Some(thread) }
    }

    fn order(&self, order: Order) {
        if let Some(orders) = &self.orders {
            // The thread ends after the sender alone.
            let _ = orders.send(order);
        }
    }

    /// Keeps work in place of what was kept before; paint needs the geometry that it is on.
    pub fn keep(&self, work: Work, stage: Option<Arc<Geometry>>) {
        self.order(Order::Keep(Box::new(work), stage));
    }

    /// Takes what another process has left for this one's, in place of what was kept before.
    pub fn adopt(&self, set: Set) {
        self.order(Order::Adopt(set));
    }

    pub fn forget(&self) {
        self.order(Order::Forget);
    }

    /// What went wrong since.
    pub fn failed(&self) -> Option<anyhow::Error> {
        self.failed.try_iter().last()
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        self.orders = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
