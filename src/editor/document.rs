//! A scene and its paint, as they are edited and as they are kept.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};

use super::history::History;
use crate::file::write_whole;
use crate::file_kind::{FileKind, Role};
use crate::hair::Hair;
use crate::live::{ScenePart, same};
use crate::paint::Paint;
use crate::scene::{HairSpec, Scene};

/// What is being edited.
#[derive(Clone, Default)]
pub struct Document {
    pub scene: Scene,
    /// What was painted since the scene was opened, over what its file had; None while that holds.
    pub paint: Option<Arc<Paint>>,
    /// The scene file.
    pub path: Option<PathBuf>,
    saved: Option<(Scene, Option<Arc<Paint>>)>,
    /// The hair that `paint` is on, and the file that the scene named for it.
    shape: HairSpec,
    named: Option<String>,
    /// Paint of hair that is not shown: it comes back with its hair.
    aside: Vec<Aside>,
}

/// Hair, its paint's file, and what was painted since.
type Aside = (HairSpec, Option<String>, Option<Arc<Paint>>);

impl Document {
    pub fn new(scene: Scene, path: Option<PathBuf>) -> Self {
        let saved = Some((scene.clone(), None));
        let (shape, named) = (shape(&scene), scene.hair.paint.clone());
        Self { scene, paint: None, path, saved, shape, named, aside: Vec::new() }
    }

    /// Work that was never saved as it is now.
    pub fn unsaved(scene: Scene, paint: Option<Arc<Paint>>, path: Option<PathBuf>) -> Self {
        Self { paint, saved: None, ..Self::new(scene, path) }
    }

    /// The hair that paint goes on.
    pub fn shape(&self) -> &HairSpec {
        &self.shape
    }

    /// After the scene changed: paint, and the name of its file, go and come with the hair that they are on. Whether
    /// they did.
    pub fn follow_hair(&mut self) -> bool {
        let new = shape(&self.scene);
        let named = &mut self.scene.hair.paint;
        if new == self.shape {
            self.named.clone_from(named);
            return false;
        }
        let known = self.aside.iter().position(|(of, ..)| *of == new);
        let (_, back, paint) = known.map(|at| self.aside.remove(at)).unwrap_or_default();
        // A name that came along is that of the hair that went.
        if *named == self.named {
            *named = back;
        }
        let old = std::mem::replace(&mut self.shape, new);
        let gone = (old, self.named.take(), std::mem::replace(&mut self.paint, paint));
        self.named.clone_from(named);
        let something =
            |name: &Option<String>, paint: &Option<_>| name.is_some() || paint.is_some();
        let went = something(&gone.1, &gone.2);
        if went {
            self.aside.push(gone);
        }
        went || something(&self.named, &self.paint)
    }

    /// Puts a part of `instead` in place of the one that was refused; paint follows its hair.
    pub fn replace(&mut self, part: ScenePart, refused: &Scene, instead: &Scene) {
        part.copy(instead, &mut self.scene);
        // Without a file of its own nothing is lost by it.
        let unnamed = self.path.is_none();
        if let Some((saved, _)) = self.saved.as_mut().filter(|_| unnamed)
            && part.same(saved, refused)
        {
            part.copy(instead, saved);
        }
        self.follow_hair();
    }

    /// Takes the last step of a history back, or does the next one again; the camera stays. Whether there was one.
    pub fn step(&mut self, history: &mut History, redo: bool) -> bool {
        let mut paint = self.paint.clone().unwrap_or_default();
        let owned = Arc::make_mut(&mut paint);
        let camera = self.scene.camera;
        let did = match redo {
            true => history.redo(&mut self.scene, owned),
            false => history.undo(&mut self.scene, owned),
        };
        self.scene.camera = camera;
        if self.paint.as_ref().is_some_and(|before| **before != *paint) {
            self.put_paint(paint);
        }
        self.follow_hair();
        did
    }

    /// A scene file, or the default scene with the hair, head or map that `path` is.
    ///
    /// # Errors
    /// One line that names the file.
    pub fn open(path: &Path) -> Result<Self> {
        let mut scene = Scene::default();
        if put_file(&mut scene, path)? {
            return Ok(Self::new(scene, None));
        }
        Ok(Self::new(Scene::read(path)?, Some(path.to_owned())))
    }

    /// Before the first stroke: what the scene names to be painted, or bare hair, which is no change.
    pub fn begin_paint(&mut self, paint: Paint) {
        let paint = Arc::new(paint);
        if let Some((scene, saved)) = &mut self.saved
            && saved.is_none()
            && scene.hair == self.scene.hair
        {
            *saved = Some(paint.clone());
        }
        self.paint = Some(paint);
    }

    /// Puts paint in place of what is there; what was saved is known again.
    pub fn put_paint(&mut self, paint: Arc<Paint>) {
        let saved = self.saved.as_ref().and_then(|(_, saved)| saved.clone());
        self.paint = Some(saved.filter(|saved| **saved == *paint).unwrap_or(paint));
    }

    /// Whether there is something that the file does not have.
    pub fn changed(&self) -> bool {
        !self
            .saved
            .as_ref()
            .is_some_and(|(scene, paint)| *scene == self.scene && same(paint, &self.paint))
    }

    /// Writes the scene to `path`, and what is painted beside it, as `NAME.paint`.
    ///
    /// # Errors
    /// One line that names the file; then nothing counts as saved.
    pub fn save(&mut self, path: &Path, hair: Option<&Hair>) -> Result<()> {
        let mut scene = self.scene.clone();
        scene.check_outputs(&[path])?;
        let beside = path.with_extension("paint");
        if self.paint.is_some() {
            if beside == path {
                bail!("{}: is where its paint goes: name the scene .toml", path.display());
            }
            scene.hair.paint = Some(beside.to_string_lossy().into_owned());
        }
        let text = portable(&scene, path)?.to_toml();
        write_whole(path, |file| {
            file.write_all(text.as_bytes())?;
            // Only once there was room for the scene: what cannot be saved leaves both files as they were.
            if let Some(paint) = &self.paint {
                let hair =
                    hair.context("the hair is still being loaded: save again in a moment")?;
                paint.write(&beside, hair)?;
            }
            Ok(())
        })?;
        self.scene.hair.paint = scene.hair.paint;
        self.named.clone_from(&self.scene.hair.paint);
        self.path = Some(path.to_owned());
        self.saved = Some((self.scene.clone(), self.paint.clone()));
        Ok(())
    }
}

/// Puts a hair, head or map file into a scene, judged by its name, else by its content; false for what may be a scene
/// file.
///
/// # Errors
/// One line that names the file: it is not there, or is none of these.
pub fn put_file(scene: &mut Scene, path: &Path) -> Result<bool> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
    let name = path.to_string_lossy().into_owned();
    let by_name = match extension.as_str() {
        "hair" | "tfx" => Some(Role::Hair),
        "obj" => Some(Role::Head),
        "exr" | "hdr" => Some(Role::Map),
        _ => None,
    };
    if by_name.is_some() && !path.is_file() {
        bail!("{name}: cannot be read");
    }
    let kind = match by_name {
        Some(_) => FileKind::Unknown,
        None => FileKind::of_file(path)?,
    };
    match by_name.or(kind.role()) {
        Some(Role::Hair) => scene.hair.source = name,
        Some(Role::Head) => scene.head.source = name,
        Some(Role::Map | Role::Lights) => scene.environment.set_source(name),
        _ if matches!(kind, FileKind::Scene | FileKind::Text | FileKind::Empty) => {
            return Ok(false);
        }
        _ => bail!("{name}: {}", kind.description()),
    }
    Ok(true)
}

/// Paths of a scene file count from its own folder: those within it are written so, others whole.
fn portable(scene: &Scene, path: &Path) -> Result<Scene> {
    let absolute = |p: &Path| std::path::absolute(p).with_context(|| p.display().to_string());
    let folder = absolute(path)?.parent().map(Path::to_owned).unwrap_or_default();
    let mut scene = scene.clone();
    let relate = |text: &mut String, words: &[&str]| -> Result<()> {
        if !text.starts_with("builtin:") && !words.contains(&text.as_str()) {
            let whole = absolute(Path::new(text.as_str()))?;
            let within = whole.strip_prefix(&folder).map(Path::to_owned).unwrap_or(whole);
            *text = within.to_string_lossy().into_owned();
        }
        Ok(())
    };
    relate(&mut scene.hair.source, &[])?;
    relate(&mut scene.head.source, &["auto", "builtin", "none"])?;
    relate(&mut scene.environment.source, &[])?;
    relate(&mut scene.output.path, &[])?;
    if let Some(paint) = &mut scene.hair.paint {
        relate(paint, &["colors"])?;
    }
    if let Some(stats) = &mut scene.output.stats {
        relate(stats, &[])?;
    }
    Ok(scene)
}

/// What hair a scene shows, whatever is painted on it.
fn shape(scene: &Scene) -> HairSpec {
    HairSpec { paint: None, ..scene.hair.clone() }
}
