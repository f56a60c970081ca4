//! Cem Yuksel's binary `.hair` format (cemyuksel.com/research/hairmodels), read and written in full.
//!
//! Little-endian. A header of 128 bytes: "HAIR", u32 strands, u32 points, u32 bits, u32 default segments,
//! f32 default thickness, f32 default transparency, 3 × f32 default colour, 88 bytes of text. Then the
//! arrays that the bits name, in the bits' order: 0 segments (u16 a strand), 1 points (3 × f32 a point),
//! 2 thickness (f32), 3 transparency (f32), 4 colour (3 × f32). A strand of s segments has s + 1 points.

use super::{Hair, float_rows};
use crate::file::write_whole;
use anyhow::{Context, Result, bail, ensure};
use glam::Vec3;
use std::io::Write;
use std::path::Path;

/// The first bytes of a `.hair` file.
pub const MAGIC: &[u8; 4] = b"HAIR";

const HEADER_BYTES: usize = 128;
const SEGMENTS: u32 = 1 << 0;
const POINTS: u32 = 1 << 1;
const THICKNESS: u32 = 1 << 2;
const TRANSPARENCY: u32 = 1 << 3;
const COLOR: u32 = 1 << 4;

/// What a `.hair` file holds.
#[derive(Clone, Debug)]
pub struct HairFile {
    pub hair: Hair,
    pub header: Header,
    /// Bytes after the last array, which no reader knows; they are not written back.
    pub trailing_bytes: usize,
}

/// What the header says beside the counts: the values that hold where an array is absent.
#[derive(Clone, Debug)]
pub struct Header {
    /// Whether the segments array is there; it is written besides where a strand has other than
    /// `default_segments`.
    pub segments_array: bool,
    pub default_segments: u32,
    /// A diameter, in the file's unit.
    pub default_thickness: f32,
    /// 0 (opaque) to 1.
    pub default_transparency: f32,
    pub default_color: [f32; 3],
    /// Free text, padded with zeros.
    pub info: [u8; 88],
}

impl Header {
    /// The text up to its first zero byte.
    pub fn info_text(&self) -> String {
        let text = self.info.split(|&b| b == 0).next().unwrap_or_default();
        String::from_utf8_lossy(text).trim().to_owned()
    }
}

impl Default for Header {
    fn default() -> Self {
        Self {
            segments_array: true,
            default_segments: 0,
            default_thickness: 1.0,
            default_transparency: 0.0,
            default_color: [1.0; 3],
            info: [0; 88],
        }
    }
}

/// Reads the bytes of a `.hair` file. Nothing is mended; nothing is allocated before the counts are known
/// to fit the bytes. Fails, in one line, where they do not.
pub fn parse(bytes: &[u8]) -> Result<HairFile> {
    ensure!(
        bytes.len() >= HEADER_BYTES && bytes.starts_with(MAGIC),
        "not a .hair file: a header of {HEADER_BYTES} bytes that starts with HAIR is missing"
    );
    let word = |at: usize| [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
    let [strands, points, bits, default_segments] =
        [4, 8, 12, 16].map(|at| u32::from_le_bytes(word(at)));
    let float = |at: usize| f32::from_le_bytes(word(at));
    let mut info = [0; 88];
    info.copy_from_slice(&bytes[40..HEADER_BYTES]);
    let header = Header {
        segments_array: bits & SEGMENTS != 0,
        default_segments,
        default_thickness: float(20),
        default_transparency: float(24),
        default_color: [float(28), float(32), float(36)],
        info,
    };

    ensure!(strands > 0, "holds no strands: export the groom again");
    ensure!(
        bits & POINTS != 0,
        "holds no points array (bit 1 of its header): export the groom with points"
    );
    let bytes_each = |bit: u32, each: u64| if bits & bit != 0 { each } else { 0 };
    let bytes_a_point =
        12 + bytes_each(THICKNESS, 4) + bytes_each(TRANSPARENCY, 4) + bytes_each(COLOR, 12);
    // At most 2^32 · 34 bytes: no overflow.
    let needed = HEADER_BYTES as u64
        + u64::from(strands) * bytes_each(SEGMENTS, 2)
        + u64::from(points) * bytes_a_point;
    let trailing_bytes = match (bytes.len() as u64).checked_sub(needed) {
        Some(n) => n as usize,
        None => bail!(
            "cut short: its header promises {strands} strands and {points} points, {needed} bytes, \
             but it has {}; copy or export it again",
            bytes.len()
        ),
    };

    let mut rest = &bytes[HEADER_BYTES..];
    let mut array = |count: u32, each: usize| {
        let (array, after) = rest.split_at(count as usize * each);
        rest = after;
        array
    };
    let segments = header.segments_array.then(|| array(strands, 2));
    let promised = match segments {
        // (2^32 − 1) · 2^32 < 2^64: no overflow.
        None => u64::from(strands) * (u64::from(default_segments) + 1),
        Some(segments) => u16s(segments).map(|s| u64::from(s) + 1).sum(),
    };
    ensure!(
        promised == u64::from(points),
        "contradicts itself: its {strands} strands have {promised} points by their segments, but the \
         header says {points}; export it again"
    );

    let mut offsets = Vec::with_capacity(strands as usize + 1);
    offsets.push(0);
    match segments {
        None => offsets.extend((1..=strands).map(|s| s * (default_segments + 1))),
        Some(segments) => {
            let mut end = 0;
            offsets.extend(u16s(segments).map(|s| {
                end += u32::from(s) + 1;
                end
            }));
        }
    }
    let hair = Hair {
        points: float_rows(array(points, 12)).map(Vec3::from_array).collect(),
        offsets,
        thickness: (bits & THICKNESS != 0).then(|| floats(array(points, 4))),
        transparency: (bits & TRANSPARENCY != 0).then(|| floats(array(points, 4))),
        color: (bits & COLOR != 0).then(|| float_rows(array(points, 12)).collect()),
    };
    Ok(HairFile { hair, header, trailing_bytes })
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    float_rows(bytes).map(|[x]| x).collect()
}

fn u16s(bytes: &[u8]) -> impl Iterator<Item = u16> {
    let (words, _) = bytes.as_chunks();
    words.iter().map(|&word| u16::from_le_bytes(word))
}

impl HairFile {
    /// The file's bytes: what `parse` read, bit for bit, but for trailing bytes and bits that no array has.
    ///
    /// Fails where a strand has no point or more than 65,535 segments, which the format cannot say.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let (hair, header) = (&self.hair, &self.header);
        let segments = hair
            .strands()
            .map(|range| match range.len().checked_sub(1) {
                Some(n) => u16::try_from(n)
                    .with_context(|| format!("a strand has {n} segments: .hair holds 65535")),
                None => bail!("a strand has no points: .hair cannot hold it"),
            })
            .collect::<Result<Vec<u16>>>()?;
        let segments_array = header.segments_array
            || segments.iter().any(|&s| u32::from(s) != header.default_segments);
        let bit = |there: bool, bit: u32| if there { bit } else { 0 };
        let bits = POINTS
            | bit(segments_array, SEGMENTS)
            | bit(hair.thickness.is_some(), THICKNESS)
            | bit(hair.transparency.is_some(), TRANSPARENCY)
            | bit(hair.color.is_some(), COLOR);

        let mut bytes = Vec::with_capacity(HEADER_BYTES + 34 * hair.points.len());
        bytes.extend(MAGIC);
        for word in [
            u32::try_from(segments.len())?,
            u32::try_from(hair.points.len())?,
            bits,
            header.default_segments,
        ] {
            bytes.extend(word.to_le_bytes());
        }
        put(&mut bytes, [header.default_thickness]);
        put(&mut bytes, [header.default_transparency]);
        put(&mut bytes, header.default_color);
        bytes.extend(header.info);
        if segments_array {
            bytes.extend(segments.iter().flat_map(|s| s.to_le_bytes()));
        }
        put(&mut bytes, hair.points.iter().flat_map(Vec3::to_array));
        put(&mut bytes, hair.thickness.iter().flatten().copied());
        put(&mut bytes, hair.transparency.iter().flatten().copied());
        put(&mut bytes, hair.color.iter().flatten().flatten().copied());
        Ok(bytes)
    }

    /// Writes the file, whole or not at all.
    pub fn write(&self, path: &Path) -> Result<()> {
        let bytes =
            self.to_bytes().with_context(|| format!("{}: cannot be written", path.display()))?;
        write_whole(path, |file| Ok(file.write_all(&bytes)?))
    }
}

fn put(bytes: &mut Vec<u8>, values: impl IntoIterator<Item = f32>) {
    bytes.extend(values.into_iter().flat_map(f32::to_le_bytes));
}
