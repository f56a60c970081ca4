//! What a file is, judged by its content: for `info`, and for every reader's refusal.

use std::borrow::Cow;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result};

use crate::hair::{hair_format, tfx_format};
use crate::{environment, openexr, paint, srbf};

/// Bytes from a file's start that its kind is judged by.
const START: usize = 1 << 16;

/// What a file is given as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    Hair,
    Head,
    Map,
    Lights,
    Scene,
    Paint,
}

impl Role {
    fn name(self) -> &'static str {
        match self {
            Role::Hair => "hair",
            Role::Head => "a head",
            Role::Map => "a lat-long map",
            Role::Lights => "a list of lights",
            Role::Scene => "a scene file (TOML)",
            Role::Paint => "paint",
        }
    }

    /// How a file of this role is given.
    fn how(self) -> &'static str {
        match self {
            Role::Hair => "give it with --hair",
            Role::Head => "give it with --head",
            Role::Map | Role::Lights => "give it with --env",
            Role::Scene => "give it first, without a flag",
            Role::Paint => "give it with --paint, and with the groom that it was painted on",
        }
    }

    /// What to do with a file that should have this role and is of no known kind.
    fn remedy(self) -> &'static str {
        match self {
            Role::Hair => "export the groom as .hair or as binary .tfx",
            Role::Head => "export the mesh as .obj",
            Role::Map => "convert it to .exr or .hdr",
            Role::Lights => "hairlight fit writes one",
            Role::Scene => "hairlight capture --print-scene prints one",
            Role::Paint => "hairlight view writes it beside a scene",
        }
    }
}

/// What a file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    Empty,
    Hair,
    Tfx,
    Obj,
    OpenExr,
    Radiance,
    Lights,
    Scene,
    Paint,
    /// Text of no known kind.
    Text,
    /// A format that is known and not read: its name with an article, and what to do instead.
    Foreign(&'static str, &'static str),
    Unknown,
}

const GEOMETRY: &str = "export strands as .hair or binary .tfx, a head as .obj";
const STRANDS: &str = "export the groom as .hair or binary .tfx";
const MESH: &str = "export the mesh as .obj";
const PICTURE: &str =
    "a map needs linear light without an upper bound: convert its source to .exr or .hdr";
const ARCHIVE: &str = "unpack it and give what is in it";

/// Formats that Hairlight does not read, by their first bytes; of two that fit, the first holds.
const FOREIGN: [(&[u8], FileKind); 31] = [
    (b"Ogawa", FileKind::Foreign("an Alembic cache", GEOMETRY)),
    (
        b"\x89HDF\r\n\x1a\n",
        FileKind::Foreign("an HDF5 file, such as an old Alembic cache", GEOMETRY),
    ),
    (b"#usda", FileKind::Foreign("a USD scene as text", GEOMETRY)),
    (b"PXR-USDC", FileKind::Foreign("a binary USD scene", GEOMETRY)),
    (b"glTF", FileKind::Foreign("a binary glTF scene", GEOMETRY)),
    (b"Kaydara FBX Binary", FileKind::Foreign("an FBX scene", GEOMETRY)),
    (b"; FBX", FileKind::Foreign("an FBX scene as text", GEOMETRY)),
    (b"BLENDER", FileKind::Foreign("a Blender file", GEOMETRY)),
    (b"\x28\xb5\x2f\xfd", FileKind::Foreign("a zstd archive, such as a Blender file", GEOMETRY)),
    (b"//Maya", FileKind::Foreign("a Maya scene", GEOMETRY)),
    (b"FOR4", FileKind::Foreign("a Maya scene or cache", GEOMETRY)),
    (b"FOR8", FileKind::Foreign("a Maya scene or cache", GEOMETRY)),
    (b"\x7fNSJb", FileKind::Foreign("Houdini geometry", GEOMETRY)),
    (b"ply\n", FileKind::Foreign("a PLY file", GEOMETRY)),
    (b"ply\r", FileKind::Foreign("a PLY file", GEOMETRY)),
    (b"solid ", FileKind::Foreign("an STL mesh", MESH)),
    (b"\x93NUMPY", FileKind::Foreign("a NumPy array", STRANDS)),
    (
        b"version https://git-lfs",
        FileKind::Foreign(
            "a Git LFS pointer in place of a file",
            "fetch the file with git lfs pull",
        ),
    ),
    (b"version ", FileKind::Foreign("a text .tfx of TressFX 1 or 2", STRANDS)),
    (b"\x89PNG\r\n\x1a\n", FileKind::Foreign("a PNG picture", PICTURE)),
    (b"\xff\xd8\xff", FileKind::Foreign("a JPEG picture", PICTURE)),
    (b"GIF8", FileKind::Foreign("a GIF picture", PICTURE)),
    (b"RIFF", FileKind::Foreign("a RIFF file, such as a WebP picture", PICTURE)),
    (b"II*\0", FileKind::Foreign("a TIFF picture", "convert it to .exr")),
    (b"MM\0*", FileKind::Foreign("a TIFF picture", "convert it to .exr")),
    (b"DDS ", FileKind::Foreign("a DDS picture", "convert it to a lat-long .exr")),
    (b"PF\n", FileKind::Foreign("a PFM picture", "convert it to .exr")),
    (b"\x1f\x8b", FileKind::Foreign("a gzip archive", ARCHIVE)),
    (b"Rar!", FileKind::Foreign("a RAR archive", ARCHIVE)),
    (b"7z\xbc\xaf", FileKind::Foreign("a 7-Zip archive", ARCHIVE)),
    (b"%PDF", FileKind::Foreign("a PDF document", "give the file that it tells of")),
];

impl FileKind {
    /// Of the file with these bytes, of which the first 64 KiB suffice.
    pub fn of(bytes: &[u8]) -> FileKind {
        let start = &bytes[..bytes.len().min(START)];
        let decoded = utf16(start);
        let start = decoded.as_ref().map_or(without_mark(start), String::as_bytes);
        if start.is_empty() {
            return FileKind::Empty;
        }
        let own: [(&[u8], FileKind); 4] = [
            (hair_format::MAGIC, FileKind::Hair),
            (paint::MAGIC, FileKind::Paint),
            (&openexr::MAGIC, FileKind::OpenExr),
            (environment::HDR_MAGIC, FileKind::Radiance),
        ];
        let known = own.iter().chain(&FOREIGN).find(|(magic, _)| start.starts_with(magic));
        if let Some((_, kind)) = known {
            return *kind;
        }
        if start.starts_with(b"PK\x03\x04") {
            return zip(start);
        }
        if srbf::is_cached_fit(start) {
            let advice = "give the map that it was made from";
            return FileKind::Foreign("a fit of lights that Hairlight keeps in its cache", advice);
        }
        let control = |&byte: &u8| byte < b' ' && !b"\t\n\r\x0b\x0c\x1a\x1b".contains(&byte);
        if !start.iter().any(control) {
            return text_kind(&String::from_utf8_lossy(start));
        }
        if tfx_format::is_tfx(start) {
            return FileKind::Tfx;
        }
        if is_usc(start) {
            return FileKind::Foreign("strands as the USC hair data set has them", STRANDS);
        }
        let zeros = |from: usize| start.iter().skip(from).step_by(2).all(|&byte| byte == 0);
        if start.len() >= 4 && (zeros(0) || zeros(1)) {
            return FileKind::Foreign("UTF-16 text without a byte order mark", "save it as UTF-8");
        }
        FileKind::Unknown
    }

    /// Of the file at `path`.
    ///
    /// # Errors
    /// One line that names the file: it cannot be read.
    pub fn of_file(path: &Path) -> Result<FileKind> {
        let mut start = Vec::new();
        File::open(path)
            .and_then(|file| file.take(START as u64).read_to_end(&mut start))
            .with_context(|| format!("{}: cannot be read", path.display()))?;
        Ok(Self::of(&start))
    }

    /// What the file can be given as; None where Hairlight does not read it.
    pub fn role(self) -> Option<Role> {
        match self {
            FileKind::Hair | FileKind::Tfx => Some(Role::Hair),
            FileKind::Obj => Some(Role::Head),
            FileKind::OpenExr | FileKind::Radiance => Some(Role::Map),
            FileKind::Lights => Some(Role::Lights),
            FileKind::Scene => Some(Role::Scene),
            FileKind::Paint => Some(Role::Paint),
            FileKind::Empty | FileKind::Text | FileKind::Foreign(..) | FileKind::Unknown => None,
        }
    }

    /// With its article.
    fn name(self) -> &'static str {
        match self {
            FileKind::Empty => "an empty file",
            FileKind::Hair => "a .hair groom",
            FileKind::Tfx => "a binary .tfx groom",
            FileKind::Obj => "a Wavefront OBJ mesh",
            FileKind::OpenExr => "an OpenEXR picture",
            FileKind::Radiance => "a Radiance picture",
            FileKind::Lights => "a list of lights (JSON)",
            FileKind::Scene => "a scene file (TOML)",
            FileKind::Paint => "paint for a groom",
            FileKind::Text => "text of no kind that Hairlight knows",
            FileKind::Foreign(name, _) => name,
            FileKind::Unknown => "of no kind that Hairlight knows",
        }
    }

    /// Why the file is not `wanted`, and what to do, to be said after its name.
    pub fn refusal(self, wanted: Role) -> String {
        let remedy = match self {
            FileKind::Empty => return "is empty: export it again".to_owned(),
            FileKind::Foreign(_, remedy) => remedy,
            _ => self.role().map_or(wanted.remedy(), Role::how),
        };
        format!("is not {} but {}: {remedy}", wanted.name(), self.name())
    }

    /// What the file is, and what to do with it, to be said after its name.
    pub fn description(self) -> String {
        match self {
            FileKind::Empty => "is empty: export it again".to_owned(),
            FileKind::Foreign(name, remedy) => {
                format!("is {name}, which cannot be given to Hairlight: {remedy}")
            }
            _ => match self.role() {
                Some(role) => format!("is {}: {}", self.name(), role.how()),
                None => format!(
                    "is {}: it reads grooms as .hair and binary .tfx, heads as .obj, maps as .exr and .hdr",
                    self.name()
                ),
            },
        }
    }
}

/// The text of a file: UTF-8, or UTF-16 with a byte order mark; marks are left out. None for what is neither.
pub fn text(bytes: &[u8]) -> Option<Cow<'_, str>> {
    match utf16(bytes) {
        Some(text) => Some(text.into()),
        None => std::str::from_utf8(without_mark(bytes)).ok().map(Cow::from),
    }
}

/// The same, with a sign in place of each byte that is no text.
pub fn lossy_text(bytes: &[u8]) -> Cow<'_, str> {
    text(bytes).unwrap_or_else(|| String::from_utf8_lossy(without_mark(bytes)))
}

/// The text of UTF-16 with a byte order mark; None for all else.
fn utf16(bytes: &[u8]) -> Option<String> {
    let (mark, rest) = bytes.split_first_chunk::<2>()?;
    let unit = match mark {
        [0xff, 0xfe] => u16::from_le_bytes,
        [0xfe, 0xff] => u16::from_be_bytes,
        _ => return None,
    };
    let units = rest.as_chunks::<2>().0.iter().map(|&pair| unit(pair));
    Some(char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect())
}

/// Without the byte order mark of UTF-8.
fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

/// By the first line that is no comment.
fn text_kind(text: &str) -> FileKind {
    let mut lines = text.split(['\n', '\r']).map(str::trim);
    let Some(first) = lines.find(|line| !line.is_empty() && !line.starts_with('#')) else {
        return FileKind::Text;
    };
    match first.split_whitespace().next().unwrap_or_default() {
        "v" | "vn" | "vt" | "vp" | "f" | "l" | "o" | "g" | "s" | "mtllib" | "usemtl" => {
            FileKind::Obj
        }
        "newmtl" => FileKind::Foreign("the materials of an OBJ mesh", "give the .obj itself"),
        word if word.starts_with('<') => match text.to_ascii_lowercase().contains("<html") {
            true => FileKind::Foreign(
                "a web page in place of a file",
                "download the file itself (its raw data)",
            ),
            false => FileKind::Foreign("an XML file, such as COLLADA", GEOMETRY),
        },
        word if word.starts_with('{') => match text.contains("\"asset\"") {
            true => FileKind::Foreign("a glTF scene", GEOMETRY),
            false => FileKind::Lights,
        },
        word if word.starts_with('[') || first.contains('=') => FileKind::Scene,
        _ => FileKind::Text,
    }
}

/// By the name of its first file.
fn zip(start: &[u8]) -> FileKind {
    let length = start.get(26..28).map_or(0, |l| usize::from(u16::from_le_bytes([l[0], l[1]])));
    let name = start.get(30..30 + length).unwrap_or_default().to_ascii_lowercase();
    let ends = |ending: &[u8]| name.ends_with(ending);
    if ends(b".usd") || ends(b".usda") || ends(b".usdc") {
        FileKind::Foreign("a packed USD scene", GEOMETRY)
    } else if ends(b".npy") {
        FileKind::Foreign("NumPy arrays", STRANDS)
    } else {
        FileKind::Foreign("a zip archive", ARCHIVE)
    }
}

/// Whether all strands that are there read as the USC data set (Hu et al. 2015) and those after it have them: an i32
/// for the number of strands, then of each strand an i32 for the number of its points, and x, y, z as f32.
fn is_usc(start: &[u8]) -> bool {
    let (words, _) = start.as_chunks::<4>();
    let Some((&strands, mut rest)) = words.split_first() else { return false };
    let mut left = u32::from_le_bytes(strands);
    if left == 0 || rest.is_empty() {
        return false;
    }
    while let Some((&points, after)) = rest.split_first().filter(|_| left > 0) {
        let points = u32::from_le_bytes(points) as usize;
        let numbers = &after[..after.len().min(3 * points)];
        let plausible = |&word: &[u8; 4]| f32::from_le_bytes(word).abs() < 1e6;
        if !(1..=10_000).contains(&points) || !numbers.iter().all(plausible) {
            return false;
        }
        (left, rest) = (left - 1, &after[numbers.len()..]);
    }
    true
}
