//! AMD TressFX's binary `.tfx` (versions 3 to 5, `TressFXFileFormat.h` of TressFX 4.1), read.
//!
//! Little-endian. A header of 160 bytes: f32 version, u32 strands, u32 points a strand, then the offsets in
//! bytes of five arrays (0: absent): positions (4 × f32 a point, strand after strand, w the inverse mass),
//! root texture coordinates, point texture coordinates, thickness (f32 a strand), colour (4 × f32 a
//! point); 32 words are reserved. Textures, masses and the colour's fourth value, whose meaning the format
//! leaves open, are not read.

use super::{Hair, float_rows};
use anyhow::{Result, bail, ensure};
use glam::Vec3;

const HEADER_BYTES: u64 = 160;

/// What a `.tfx` file holds.
#[derive(Clone, Debug)]
pub struct TfxFile {
    pub hair: Hair,
    /// The header's version of the format, such as 4.0.
    pub version: f32,
}

/// Whether the bytes begin as a binary `.tfx` does, whose magic is no more than a plausible version.
pub fn is_tfx(bytes: &[u8]) -> bool {
    let version = bytes.first_chunk().map(|&b| f32::from_le_bytes(b));
    version.is_some_and(|v| (1.0..10.0).contains(&v))
}

/// Reads the bytes of a `.tfx` file. Nothing is mended; nothing is allocated before the counts are known to
/// fit the bytes. Fails, in one line, where they do not.
pub fn parse(bytes: &[u8]) -> Result<TfxFile> {
    ensure!(
        bytes.len() as u64 >= HEADER_BYTES && is_tfx(bytes),
        "not a binary .tfx file: its header of {HEADER_BYTES} bytes is missing"
    );
    let word =
        |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let [strands, points_each] = [4, 8].map(word);
    let [position_offset, _, _, thickness_offset, color_offset] = [12, 16, 20, 24, 28].map(word);
    ensure!(strands > 0 && points_each > 0, "holds no strands: export the groom again");
    ensure!(position_offset > 0, "holds no positions: export the groom again");
    // Below 2^64: no overflow. Once the positions fit the file, it is far below 2^32.
    let points = u64::from(strands) * u64::from(points_each);
    let positions = float_array(bytes, "positions", position_offset, points, 4)?;
    ensure!(
        u32::try_from(points).is_ok(),
        "holds {points} points: more than {} are not supported",
        u32::MAX
    );

    let thickness = match thickness_offset {
        0 => None,
        offset => {
            let each = float_array(bytes, "thickness", offset, u64::from(strands), 1)?;
            let repeat = |[t]: [f32; 1]| std::iter::repeat_n(t, points_each as usize);
            Some(float_rows(each).flat_map(repeat).collect())
        }
    };
    let color = match color_offset {
        0 => None,
        offset => {
            let each = float_array(bytes, "colours", offset, points, 4)?;
            Some(float_rows(each).map(|[r, g, b, _]| [r, g, b]).collect())
        }
    };
    let hair = Hair {
        points: float_rows(positions).map(|[x, y, z, _]| Vec3::new(x, y, z)).collect(),
        offsets: (0..=strands).map(|s| s * points_each).collect(),
        thickness,
        color,
        transparency: None,
    };
    let version = f32::from_bits(word(0));
    Ok(TfxFile { hair, version })
}

/// The bytes of `count` rows of `width` floats at `offset`.
fn float_array<'a>(
    bytes: &'a [u8],
    name: &str,
    offset: u32,
    count: u64,
    width: u64,
) -> Result<&'a [u8]> {
    ensure!(
        u64::from(offset) >= HEADER_BYTES,
        "puts its {name} at byte {offset}, inside the header; export it again"
    );
    let end = count.checked_mul(4 * width).and_then(|length| length.checked_add(u64::from(offset)));
    match end {
        Some(end) if end <= bytes.len() as u64 => Ok(&bytes[offset as usize..end as usize]),
        _ => bail!(
            "cut short: its header promises {count} {name} from byte {offset} on, but it has {} bytes; \
             copy or export it again",
            bytes.len()
        ),
    }
}
