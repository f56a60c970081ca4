//! The scene: what a user describes, in `scene.toml` or by flags.
//!
//! One table of fields ([`FIELDS`]) holds each key, flag, range and help line. A scene is built in
//! levels: the defaults, then a file, then the command line. Within a level the preset comes first
//! and then the level's other fields in order, so a later level's preset replaces an earlier
//! level's colour, roughness and tilt. Paths in a file are relative to that file.

mod camera;
mod fibre;
mod field;
mod lamp;
mod preset;
mod table;
mod target;

pub use camera::{Camera, CameraSpec, Lens, Orbit, View, frame_within};
pub use fibre::{ChiangSpec, FibreSpec, Pigment, assembly_color};
pub use field::{Alternative, Field, Kind, Value, srgb_to_linear};
pub use lamp::{LAMPS, LampKind, LampSpec};
pub use preset::{PRESETS, Preset};
pub use table::FIELDS;
pub use target::Target;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use field::choice;
use glam::Vec3;
use toml::de::{DeTable, DeValue};

use crate::file;
use crate::file_kind::{self, FileKind, Role};
use crate::head::Up;

/// Everything that a frame is made from.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Scene {
    pub hair: HairSpec,
    pub head: HeadSpec,
    pub environment: EnvironmentSpec,
    pub lamps: [LampSpec; LAMPS],
    pub fibre: FibreSpec,
    pub camera: CameraSpec,
    pub render: RenderSpec,
    pub output: OutputSpec,
}

/// Where the strands come from. `up`, `scale` and `reverse` act on files, the others but `source` and `paint` on builtin
/// grooms.
#[derive(Clone, Debug, PartialEq)]
pub struct HairSpec {
    /// `builtin:STYLE` or a path.
    pub source: String,
    /// The axis of the file that becomes +y of the world.
    pub up: Up,
    /// World lengths per length in the file.
    pub scale: f64,
    pub reverse: Reverse,
    pub strands: u32,
    pub seed: u32,
    /// Multiplies the style's own length.
    pub length: f64,
    /// Multiplies the style's own curl or wave.
    pub curl: f64,
    /// 0 (loose) to 1; `None` is the style's own.
    pub clump: Option<f64>,
    /// Share of stray strands, 0 to 1; `None` is the style's own.
    pub flyaway: Option<f64>,
    /// `colors`, or the path of what is painted on it (see `crate::paint`).
    pub paint: Option<String>,
}

/// The words of [`Up`].
const UP_WORDS: &[&str] = &["y", "z", "x", "-y", "-z", "-x"];

impl field::Slot for Up {
    fn value(&self) -> Value {
        Value::Text(self.to_string())
    }
    fn assign(&mut self, value: Value) {
        let Value::Text(word) = value else { unreachable!("a checked word") };
        *self = word.parse().unwrap_or_else(|_| unreachable!("a checked word"));
    }
}

/// Where the head comes from, and where it goes; None is found by where the roots of the hair are.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadSpec {
    /// `auto`, `builtin`, `none` or a path.
    pub source: String,
    /// World lengths per length in its file.
    pub scale: Option<f64>,
    /// The axis of its file that becomes +y of the world.
    pub up: Option<Up>,
    /// Where the origin of its file goes, world.
    pub offset: Option<[f64; 3]>,
    /// Diffuse reflectance, linear RGB, 0 to 1.
    pub color: [f64; 3],
}

/// The distant light.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentSpec {
    /// `builtin:NAME` or a path.
    pub source: String,
    /// Which layer of an EXR file; `None` is the finished picture.
    pub layer: Option<String>,
    /// Turns the light about +y, counter-clockwise seen from above, degrees.
    pub rotation_deg: f64,
    /// Stops: the light is multiplied by 2^exposure.
    pub exposure: f64,
    /// Number of SRBF lights fitted to the map; `None` is left to the quality asked for.
    pub lights: Option<u32>,
}

impl EnvironmentSpec {
    /// Another map, of which no layer is chosen yet.
    pub fn set_source(&mut self, source: String) {
        self.source = source;
        self.layer = None;
    }
}

/// How the frame is computed.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderSpec {
    pub method: Method,
    /// Of `fast`, over θ_i; `None`: what the fibre's model needs for 1 %.
    pub nodes: Option<u32>,
    /// Of `xu`: m of the longitudinal quadrature (Xu 2011, §4.2.2).
    pub segments: u32,
    /// Coverage samples a pixel; `None` is left to the quality asked for.
    pub samples: Option<u32>,
    /// `None`: the other fields say it.
    pub quality: Option<Target>,
    pub scattering: Scattering,
    pub energies: Energies,
    /// `auto`, `cpu`, or part of an adapter's name.
    pub adapter: String,
}

choice! {
    /// Whether a file has strands from tip to root.
    Reverse {
        /// Where the ends lie on a head says so.
        Auto = "auto",
        Yes = "yes",
        No = "no",
    }
}

choice! {
    /// How the integral of a mode against a light is evaluated.
    Method {
        /// Gauss nodes, a table over azimuth, and multiple scattering along ordinates.
        Fast = "fast",
        /// Xu et al. 2011 as printed, but for its misprints.
        Xu = "xu",
    }
}

choice! {
    /// How a fibre scatters.
    Bcsdf {
        /// Marschner 2003, each lobe scaled to lose nothing.
        Marschner = "marschner",
        /// d'Eon et al. 2011, its attenuation taken at θ_o so that it conserves energy.
        Deon = "deon",
        /// Chiang et al. 2016, after pbrt-v4.
        Chiang = "chiang",
    }
}

choice! {
    /// How ∫N_TT and ∫N_TRT are found (Xu 2011, Eq 18, 19, 22, 23).
    Energies {
        /// By quadrature over h, which holds for every absorption.
        Quadrature = "quadrature",
        /// As printed, by a fourth-order Taylor expansion: fit for σ_a ≤ 1.
        Taylor = "taylor",
    }
}

choice! {
    /// Which scattering is shown; all but `Both` are for study.
    Scattering {
        Both = "both",
        /// Light scattered by one fibre only, with its shadows.
        Single = "single",
        /// Light that other fibres have scattered before.
        Multiple = "multiple",
        /// Of that, what came forward; of `xu` alone.
        Global = "global",
        /// Of that, what came back from the fibres behind; of `xu` alone.
        Local = "local",
    }
}

/// What is written.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputSpec {
    /// A .png or .exr file.
    pub path: String,
    /// Width and height in pixels.
    pub size: [u32; 2],
    pub background: Background,
    /// Stops before tone mapping; `None` is chosen from the frame.
    pub exposure: Option<f64>,
    /// A .json file for figures.
    pub stats: Option<String>,
    /// Frames of a turn about the hair; 0 writes one still frame.
    pub turntable: u32,
}

/// What is seen past the hair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    Environment,
    /// Nothing; colours are premultiplied.
    Transparent,
    /// Linear RGB.
    Color([f64; 3]),
}

impl Default for HairSpec {
    fn default() -> Self {
        Self {
            source: "builtin:bob".to_owned(),
            up: Up::Y,
            scale: 1.0,
            reverse: Reverse::Auto,
            strands: 20_000,
            seed: 0,
            length: 1.0,
            curl: 1.0,
            clump: None,
            flyaway: None,
            paint: None,
        }
    }
}

impl Default for HeadSpec {
    fn default() -> Self {
        Self {
            source: "auto".to_owned(),
            scale: None,
            up: None,
            offset: None,
            color: crate::head::CLAY.map(f64::from),
        }
    }
}

impl HeadSpec {
    /// Diffuse reflectance, linear RGB.
    pub fn albedo(&self) -> Vec3 {
        self.color.map(|c| c as f32).into()
    }
}

impl Default for EnvironmentSpec {
    fn default() -> Self {
        let source = "builtin:studio".to_owned();
        Self { source, layer: None, rotation_deg: 0.0, exposure: 0.0, lights: None }
    }
}

impl Default for RenderSpec {
    fn default() -> Self {
        Self {
            method: Method::Fast,
            nodes: None,
            segments: 4,
            samples: None,
            quality: None,
            scattering: Scattering::Both,
            energies: Energies::Quadrature,
            adapter: "auto".to_owned(),
        }
    }
}

impl Default for OutputSpec {
    fn default() -> Self {
        Self {
            path: "hairlight.png".to_owned(),
            size: [720, 480],
            background: Background::Environment,
            exposure: None,
            stats: None,
            turntable: 0,
        }
    }
}

/// A field and the value that one level gives it, checked.
#[derive(Clone)]
pub struct Assignment {
    pub field: &'static Field,
    pub value: Value,
}

impl Scene {
    /// The defaults, changed by a scene file. Errors are one line that names the file and, where
    /// there is one, the line.
    pub fn read(path: &Path) -> Result<Scene> {
        let name = path.display();
        let bytes = std::fs::read(path).with_context(|| format!("{name}: cannot be read"))?;
        let kind = FileKind::of(&bytes);
        let other = !matches!(kind, FileKind::Scene | FileKind::Text | FileKind::Empty);
        let Some(text) = file_kind::text(&bytes).filter(|_| !other) else {
            bail!("{name}: {}", kind.refusal(Role::Scene));
        };
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::from_toml(&text, &name.to_string(), folder)
    }

    /// The defaults, changed by the text of a scene file; errors call it `name`, and its relative
    /// paths start at `folder`.
    pub fn from_toml(text: &str, name: &str, folder: &Path) -> Result<Scene> {
        let document = DeTable::parse(text).map_err(|e| {
            let (line, column) = position(text, e.span().map_or(0, |span| span.start));
            anyhow!("{name}:{line}:{column}: {}", e.message().replace(char::is_control, " "))
        })?;
        let mut leaves = Vec::new();
        flatten(document.get_ref(), "", &mut leaves);
        leaves.sort_by_key(|leaf| leaf.start);
        let mut level = Vec::new();
        for leaf in leaves {
            let assignment = field_named(&leaf.key)
                .and_then(|field| Ok(Assignment { field, value: field.read_toml(leaf.value)? }));
            let Assignment { field, value } = assignment.map_err(|e| {
                let reason = e.replace(char::is_control, " ");
                anyhow!("{name}:{}: {reason}", position(text, leaf.start).0)
            })?;
            level.push(Assignment { field, value: field.relocate(value, folder) });
        }
        let mut scene = Scene::default();
        scene.apply(level).with_context(|| name.to_owned())?;
        Ok(scene)
    }

    /// Applies one level: its presets, then its other fields in order.
    ///
    /// # Errors
    /// One line, if the level states one thing in two ways (see [`Alternative`]).
    pub fn apply(&mut self, level: Vec<Assignment>) -> Result<()> {
        for (i, later) in level.iter().enumerate() {
            let Some(b) = later.field.alternative else {
                continue;
            };
            for earlier in &level[..i] {
                if earlier.field.alternative.is_some_and(|a| a.of == b.of && a.way != b.way) {
                    let (first, second) = (earlier.field.key, later.field.key);
                    bail!("`{first}` and `{second}` both set {}; keep one of them", b.of);
                }
            }
        }
        let (presets, others): (Vec<_>, Vec<_>) =
            level.into_iter().partition(|a| a.field.key == preset::KEY);
        for Assignment { field, value } in presets.into_iter().chain(others) {
            (field.set)(self, value);
        }
        Ok(())
    }

    /// The whole scene as a scene file, each field with its help. Paths stay as they are, that is,
    /// relative to the working folder: saved there, it reads back to the same scene.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        let mut group = "";
        for field in FIELDS {
            let Some(value) = field.get(self) else {
                continue;
            };
            if field.group() != group {
                let gap = if group.is_empty() { "" } else { "\n" };
                group = field.group();
                text += &format!("{gap}[{group}]\n");
            }
            let setting = format!("{} = {}", field.name(), field.format(&value));
            text += &format!("{setting:<32} # {} ({})\n", field.help, field.expects());
        }
        text
    }

    /// The files that the scene is made from.
    fn files(&self) -> Vec<PathBuf> {
        let file = |field: &Field| match (field.kind, field.get(self)) {
            (Kind::Source { words, .. }, Some(Value::Text(text)))
                if !text.starts_with("builtin:") && !words.contains(&text.as_str()) =>
            {
                Some(PathBuf::from(text))
            }
            _ => None,
        };
        FIELDS.iter().filter_map(file).collect()
    }

    /// Checks that files can be written and that the scene is made of none of them: see [`file::check_outputs`].
    pub fn check_outputs(&self, outputs: &[&Path]) -> Result<()> {
        let inputs = self.files();
        file::check_outputs(outputs, &inputs.iter().map(PathBuf::as_path).collect::<Vec<_>>())
    }

    /// What the head is made from: `builtin` or a path; `None` where there is no head. `auto` puts
    /// the builtin head under builtin hair, which is made for it, and none under a file's.
    pub fn head_source(&self) -> Option<&str> {
        match self.head.source.as_str() {
            "none" => None,
            "auto" => self.hair.source.starts_with("builtin:").then_some("builtin"),
            source => Some(source),
        }
    }
}

/// Reads `key=value`, as `--set` takes it. The error is one line.
pub fn parse_assignment(text: &str) -> Result<Assignment, String> {
    let (key, value) = text
        .split_once('=')
        .ok_or_else(|| format!("`{text}` is not of the form key=value, such as fibre.eta=1.6"))?;
    let field = field_named(key.trim())?;
    Ok(Assignment { field, value: field.parse(value)? })
}

/// The field with this key. The error names the nearest key.
pub fn field_named(key: &str) -> Result<&'static Field, String> {
    let last = |key: &str| key.rsplit('.').next().unwrap_or_default().to_owned();
    // A key without its table, or in the wrong one, is near too.
    let nearness = |field: &Field| {
        let whole = strsim::normalized_damerau_levenshtein(key, field.key);
        let name = strsim::normalized_damerau_levenshtein(&last(key), field.name());
        (whole.max(0.95 * name), whole)
    };
    if let Some(field) = FIELDS.iter().find(|field| field.key == key) {
        return Ok(field);
    }
    if let Some(field) = FIELDS.iter().find(|field| field.group() == key) {
        return Err(format!("`{key}` is a table of keys such as `{}`", field.key));
    }
    // Of equals the first.
    let nearest = FIELDS.iter().rev().max_by(|a, b| {
        let ((a, whole_a), (b, whole_b)) = (nearness(a), nearness(b));
        a.total_cmp(&b).then(whole_a.total_cmp(&whole_b))
    });
    let nearest = nearest.map_or("", |field| field.key);
    Err(format!("unknown key `{key}`; did you mean `{nearest}`?"))
}

/// A key of a scene file that holds no further keys.
struct Leaf<'a> {
    key: String,
    value: &'a DeValue<'a>,
    /// Byte offset of the key.
    start: usize,
}

/// All leaves below a table; an empty table counts as one unless it is a group of the scene.
fn flatten<'a>(table: &'a DeTable<'a>, prefix: &str, leaves: &mut Vec<Leaf<'a>>) {
    for (name, value) in table {
        let key = format!("{prefix}{}", name.get_ref());
        match value.get_ref() {
            DeValue::Table(inner) if !inner.is_empty() => {
                flatten(inner, &format!("{key}."), leaves);
            }
            DeValue::Table(_) if FIELDS.iter().any(|field| field.group() == key) => {}
            value => leaves.push(Leaf { key, value, start: name.span().start }),
        }
    }
}

/// Line and column of a byte offset, both from 1.
fn position(text: &str, offset: usize) -> (usize, usize) {
    let before = &text.as_bytes()[..offset.min(text.len())];
    let line = before.iter().filter(|&&b| b == b'\n').count() + 1;
    let line_start = before.iter().rposition(|&b| b == b'\n').map_or(0, |i| i + 1);
    let column = String::from_utf8_lossy(&before[line_start..]).chars().count() + 1;
    (line, column)
}
