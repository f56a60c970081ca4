//! From a source (a file, or a builtin groom's name) to mended hair in the world's frame.

use super::groom::{GroomOptions, STYLES, grow};
use super::hair_format::{self, Header};
use super::{Hair, Mended, is_reversed, length, mend, metre, reverse, tfx_format};
use crate::file_kind::{FileKind, Role};
use crate::head::{Up, check_scale};
use anyhow::{Context, Result, bail, ensure};
use glam::Vec3;

/// Radii (after scaling) that f32 distances, areas and volumes can be computed with.
const RADIUS_RANGE: [f32; 2] = [1e-9, 1e9];

/// How a source becomes hair in the world.
#[derive(Clone, Debug)]
pub struct LoadOptions {
    /// The file's axis that points up. A builtin groom is y up whatever this says.
    pub up: Up,
    /// Factor on every length, 1e-9 to 1e9.
    pub scale: f32,
    /// Whether the file has strands from tip to root; None: told by where their ends lie. A builtin groom is stored from
    /// root to tip whatever this says.
    pub reverse: Option<bool>,
    /// What a builtin groom is grown with.
    pub groom: GroomOptions,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self { up: Up::default(), scale: 1.0, reverse: None, groom: GroomOptions::default() }
    }
}

/// Hair in the world's frame, and how it came to be so.
#[derive(Clone, Debug)]
pub struct LoadedHair {
    pub hair: Hair,
    pub mended: Mended,
    /// What was assumed where the source does not say: one line each.
    pub assumed: Vec<String>,
    pub file: FileDetails,
}

/// What a source holds, before turning, scaling and mending.
#[derive(Clone, Debug)]
pub struct FileDetails {
    /// `.hair`, `.tfx 4.0` or `builtin`.
    pub format: String,
    pub strands: usize,
    pub points: usize,
    /// Fewest and most segments of a strand.
    pub segments: [usize; 2],
    /// The arrays present: segments, points, thickness, transparency, colour.
    pub arrays: Vec<&'static str>,
    /// The header of a `.hair` file: defaults and text.
    pub header: Option<Header>,
}

/// Loads `source`: `builtin:` and a style, or the path of a `.hair` or binary `.tfx` file (told apart by
/// their first bytes), turns it by `up`, multiplies it by `scale` and mends it.
///
/// Fails, in one line that names the source, where it cannot be read, contradicts itself or is cut short, or
/// no strand is left after mending.
pub fn load(source: &str, options: &LoadOptions) -> Result<LoadedHair> {
    load_on(source, options, None)
}

/// The share, 0 to 1, of points (world) that lie on the head.
pub type OnHead<'a> = &'a dyn Fn(&[Vec3]) -> f64;

/// The same for hair on a head.
pub fn load_on(source: &str, options: &LoadOptions, on_head: Option<OnHead>) -> Result<LoadedHair> {
    check_scale(options.scale)?;
    match source.strip_prefix("builtin:") {
        Some(style) => {
            let hair = grow(style, &options.groom)?;
            let read = Read::new(hair, "builtin");
            finish(read, &LoadOptions { up: Up::Y, reverse: Some(false), ..options.clone() }, None)
        }
        None => {
            let bytes = std::fs::read(source).with_context(|| {
                format!(
                    "{source}: cannot be read (builtin grooms are builtin:{})",
                    STYLES.join(", builtin:")
                )
            })?;
            read(&bytes).and_then(|read| finish(read, options, on_head))
        }
    }
    .with_context(|| source.to_owned())
}

/// A source as it was read.
struct Read {
    hair: Hair,
    file: FileDetails,
    assumed: Vec<String>,
}

impl Read {
    fn new(hair: Hair, format: impl Into<String>) -> Self {
        let lengths = || hair.strands().map(|range| range.len().saturating_sub(1));
        let arrays = [
            ("points", true),
            ("thickness", hair.thickness.is_some()),
            ("transparency", hair.transparency.is_some()),
            ("colour", hair.color.is_some()),
        ];
        let file = FileDetails {
            format: format.into(),
            strands: hair.strand_count(),
            points: hair.points.len(),
            segments: [lengths().min(), lengths().max()].map(Option::unwrap_or_default),
            arrays: arrays.iter().filter(|a| a.1).map(|a| a.0).collect(),
            header: None,
        };
        Self { hair, file, assumed: Vec::new() }
    }
}

fn read(bytes: &[u8]) -> Result<Read> {
    match FileKind::of(bytes) {
        FileKind::Hair => {
            let hair_format::HairFile { hair, header, trailing_bytes } = hair_format::parse(bytes)?;
            let mut read = Read::new(hair, ".hair");
            if header.segments_array {
                read.file.arrays.insert(0, "segments");
            }
            let defaults = [header.default_thickness, header.default_transparency];
            if defaults.iter().chain(&header.default_color).any(|value| !value.is_finite()) {
                read.assumed
                    .push("a default of the header is NaN or infinite: none is used".to_owned());
            }
            read.file.header = Some(header);
            if trailing_bytes > 0 {
                read.assumed.push(format!(
                    "the {trailing_bytes} bytes after the last array are left unread"
                ));
            }
            Ok(read)
        }
        FileKind::Tfx => {
            let tfx_format::TfxFile { hair, version } = tfx_format::parse(bytes)?;
            let mut read = Read::new(hair, format!(".tfx {version:.1}"));
            read.assumed
                .push("every strand of the .tfx is drawn, none is added between them".to_owned());
            Ok(read)
        }
        other => bail!(other.refusal(Role::Hair)),
    }
}

fn finish(read: Read, options: &LoadOptions, on_head: Option<OnHead>) -> Result<LoadedHair> {
    let LoadOptions { up, scale, .. } = *options;
    let Read { mut hair, file, mut assumed } = read;
    for point in &mut hair.points {
        *point = up.to_world(*point) * scale;
    }
    for thickness in hair.thickness.iter_mut().flatten() {
        *thickness *= scale;
    }
    let mended = mend(&mut hair);
    ensure!(
        hair.strand_count() > 0,
        "no strand with two different points is left of its {}: export the groom again",
        file.strands
    );
    let (_, radius) = hair.center_radius();
    let [smallest, largest] = RADIUS_RANGE;
    ensure!(
        (smallest..=largest).contains(&radius),
        "its hair is {radius:e} units in radius, outside {smallest:e} to {largest:e}: give a scale"
    );

    if file.format != "builtin" {
        assumed.push(format!(
            "{up} is up and the scale {scale}: the file says neither (--up, --scale)"
        ));
        let reversed = options.reverse.unwrap_or_else(|| is_reversed(&hair, on_head));
        if reversed {
            reverse(&mut hair);
            assumed.push(
                "the strands are stored from tip to root: turned around (--reverse)".to_owned(),
            );
        }
        let strays = hair.strays().iter().filter(|&&stray| stray).count();
        if strays > 0 {
            let strands = if strays == 1 { "strand strays" } else { "strands stray" };
            assumed.push(format!(
                "{strays} {strands} far from all others: what is far out counts neither for the view nor for the light"
            ));
        }
        assumed.extend(lying_down(&hair, up, options.reverse));
        assumed.push(format!(
            "a metre is {:.4} units, judged by how far the roots spread and strands reach",
            metre(&hair)
        ));
    }
    // What became of one that was not kept is among what was mended.
    match &hair.thickness {
        Some(_) => {
            assumed.push("the thickness array is taken as a profile, not as a size".to_owned());
        }
        None if file.arrays.contains(&"thickness") => {}
        None => assumed
            .push("no thickness array: strands taper to 0.3 of their width at the tip".to_owned()),
    }
    Ok(LoadedHair { hair, mended, assumed, file })
}

/// A doubt about the up axis, where the strands, which should fall, fall along another of the file's axes.
fn lying_down(hair: &Hair, up: Up, reverse: Option<bool>) -> Option<String> {
    let falls = hair
        .polylines()
        .map(|points| (points[points.len() - 1] - points[0]) / length(points) as f32);
    // y is −1 where all strands hang straight; eight grooms have −0.37 (combed back) to −0.94.
    let fall_in_world = falls.sum::<Vec3>() / hair.strand_count() as f32;
    let fall_in_file = Vec3::AXES.map(|axis| up.to_world(axis).dot(fall_in_world));
    let rise = |up: Up| up.to_world(Vec3::from(fall_in_file)).y;
    let likely = Up::ALL.into_iter().min_by(|a, b| rise(*a).total_cmp(&rise(*b)))?;
    if rise(likely) >= -0.5 || rise(up) <= -0.2 {
        return None;
    }
    let stands_on_its_head = (rise(likely) + rise(up)).abs() < 1e-3;
    Some(match reverse {
        // Strands from tip to root rise as well.
        None if stands_on_its_head => {
            format!("the strands rise: --reverse yes or --up {likely} may be meant")
        }
        _ => format!("the strands fall as if {likely} were up: --up {likely} may be meant"),
    })
}
