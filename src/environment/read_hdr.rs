//! Radiance `.hdr` in: RGBE pixels as linear RGB, from all eight orientations.
//!
//! EXPOSURE and COLORCORR lines are not undone (as in most renderers); a note says so.

use anyhow::{Context, Result, anyhow, bail, ensure};
use rayon::prelude::*;

use super::{Environment, SourceInfo};
use crate::file::check_pixels;

/// Files say `#?RADIANCE` or `#?RGBE`.
pub const MAGIC: &[u8] = b"#?";

/// Lines of pixels that are unpacked before they are converted.
const BATCH: usize = 64;
/// Lines of other lengths are never in separate planes.
const PLANAR_LENGTHS: std::ops::Range<usize> = 8..0x8000;

/// Red, green, blue, and the exponent that they share.
type Rgbe = [u8; 4];

/// # Errors
/// One line without the file's name: damaged or cut short, XYZE pixels, too large.
pub fn read(bytes: &[u8]) -> Result<(Environment, SourceInfo)> {
    let mut rest = bytes;
    let header = Header::read(&mut rest)?;
    let [width, height] = header.size();
    check_pixels(width, height)?;
    // The shortest line is a pixel and the longest runs: 2 of 255 bytes for each of 4 planes, or less.
    let [lines, length] = header.counts;
    ensure!(
        lines.saturating_mul(length.div_ceil(127)) <= rest.len(),
        "claims {width} × {height} pixels, more than its {} bytes can hold: it is cut short or damaged",
        bytes.len()
    );
    let mut map = Environment::new(width, height, vec![[0.0; 3]; width * height]);
    let powers: [f32; 256] = std::array::from_fn(power);
    let color = |[r, g, b, e]: Rgbe| [r, g, b].map(|v| powers[e as usize] * f32::from(v));
    let place = |i: usize, count: usize, rising: bool| if rising { i } else { count - 1 - i };
    let [lines_rise, pixels_rise] = header.rising;
    let mut batch: Vec<Rgbe> = vec![[0; 4]; BATCH.min(lines) * length];
    for first in (0..lines).step_by(BATCH) {
        let count = BATCH.min(lines - first);
        let batch = &mut batch[..count * length];
        for (i, line) in batch.chunks_exact_mut(length).enumerate() {
            unpack(&mut rest, line).with_context(|| {
                format!(
                    "is damaged or cut short in line {} of its {lines} lines of pixels; export the file again",
                    first + i + 1
                )
            })?;
        }
        let at = |line: usize| place(first + line, lines, lines_rise);
        if header.lines_are_rows {
            let top = at(0).min(at(count - 1));
            let rows = map.pixels[top * width..][..count * width].par_chunks_exact_mut(width);
            rows.enumerate().for_each(|(i, row)| {
                let line = place(i, count, lines_rise);
                for (x, &rgbe) in batch[line * length..][..length].iter().enumerate() {
                    row[place(x, length, pixels_rise)] = color(rgbe);
                }
            });
        } else {
            map.pixels.par_chunks_exact_mut(width).enumerate().for_each(|(y, row)| {
                let y = place(y, length, pixels_rise);
                for line in 0..count {
                    row[at(line)] = color(batch[line * length + y]);
                }
            });
        }
    }
    let info = SourceInfo {
        format: "Radiance",
        channels: "RGBE".to_owned(),
        compression: "RLE",
        notes: header.notes,
        ..SourceInfo::default()
    };
    Ok((map, info))
}

/// What stands before the pixels.
struct Header {
    /// Lines, and pixels in each.
    counts: [usize; 2],
    /// Whether lines are rows, or columns.
    lines_are_rows: bool,
    /// Whether lines, and pixels in them, go from the top down or from left to right.
    rising: [bool; 2],
    notes: Vec<String>,
}

impl Header {
    /// Takes the header off the bytes.
    fn read(bytes: &mut &[u8]) -> Result<Header> {
        let mut exposure = 1.0;
        let mut color_is_corrected = false;
        loop {
            let line = take_line(bytes)?;
            if line.is_empty() {
                break;
            }
            let Some((key, value)) = line.split_once('=').filter(|_| !line.starts_with('#')) else {
                continue;
            };
            match (key.trim(), value.trim()) {
                ("FORMAT", "32-bit_rle_rgbe") => {}
                ("FORMAT", "32-bit_rle_xyze") => {
                    bail!("holds XYZ colours; convert it to RGBE first")
                }
                ("FORMAT", other) => bail!(
                    "holds pixels as {:.40}, which cannot be read; convert them to 32-bit_rle_rgbe",
                    other.escape_default().to_string()
                ),
                ("EXPOSURE", value) => exposure *= value.parse().unwrap_or(1.0),
                ("COLORCORR", value) => {
                    color_is_corrected |= value.split_whitespace().any(|v| v.parse() != Ok(1.0));
                }
                _ => {}
            }
        }
        let mut notes = Vec::new();
        if exposure != 1.0 {
            notes.push(format!("its EXPOSURE of {exposure} is not undone"));
        }
        if color_is_corrected {
            notes.push("its COLORCORR is not undone".to_owned());
        }
        let line = take_line(bytes)?;
        let axes = || {
            let mut words = line.split_whitespace();
            let mut axis = || Some((words.next()?, words.next()?.parse().ok()?));
            let (first, second): ((&str, usize), (&str, usize)) = (axis()?, axis()?);
            let rising = |word: &str| match word {
                "+X" | "-Y" => Some(true),
                "-X" | "+Y" => Some(false),
                _ => None,
            };
            let lines_are_rows = first.0.ends_with('Y');
            (first.0.ends_with('X') != second.0.ends_with('X')).then_some(())?;
            Some(Header {
                counts: [first.1, second.1],
                lines_are_rows,
                rising: [rising(first.0)?, rising(second.0)?],
                notes,
            })
        };
        axes().ok_or_else(|| {
            anyhow!(
                "is damaged: `{:.40}` stands where its size should, such as -Y 512 +X 1024; export the file again",
                line.escape_default().to_string()
            )
        })
    }

    /// Width and height of the picture.
    fn size(&self) -> [usize; 2] {
        let [lines, length] = self.counts;
        if self.lines_are_rows { [length, lines] } else { [lines, length] }
    }
}

/// Takes a line off the bytes, its end left out, LF or CRLF.
fn take_line<'a>(bytes: &mut &'a [u8]) -> Result<std::borrow::Cow<'a, str>> {
    let end = bytes.iter().position(|&byte| byte == b'\n');
    let end = end.context("is cut short: its header does not end; export the file again")?;
    let line = &bytes[..end];
    *bytes = &bytes[end + 1..];
    Ok(String::from_utf8_lossy(line.strip_suffix(b"\r").unwrap_or(line)))
}

/// Takes as many bytes off; None where there are fewer.
fn take<'a>(bytes: &mut &'a [u8], count: usize) -> Option<&'a [u8]> {
    let (taken, rest) = bytes.split_at_checked(count)?;
    *bytes = rest;
    Some(taken)
}

/// Takes a line of pixels off the bytes: plane by plane in runs, or pixel by pixel with runs of equal ones or none.
/// None where it is not all there.
fn unpack(bytes: &mut &[u8], line: &mut [Rgbe]) -> Option<()> {
    if let [2, 2, high @ 0..128, low, ..] = **bytes
        && PLANAR_LENGTHS.contains(&line.len())
    {
        (usize::from(high) << 8 | usize::from(low) == line.len()).then_some(())?;
        take(bytes, 4)?;
        return (0..4).try_for_each(|channel| unpack_plane(bytes, line, channel));
    }
    let mut x = 0;
    let mut shift = 0;
    while x < line.len() {
        let pixel: Rgbe = take(bytes, 4)?.try_into().ok()?;
        if let [1, 1, 1, count] = pixel {
            // Further runs count in higher digits.
            let count = usize::from(count).checked_shl(shift)?;
            let before = *line.get(x.checked_sub(1)?)?;
            line.get_mut(x..x.checked_add(count)?)?.fill(before);
            x += count;
            shift += 8;
        } else {
            line[x] = pixel;
            x += 1;
            shift = 0;
        }
    }
    Some(())
}

fn unpack_plane(bytes: &mut &[u8], line: &mut [Rgbe], channel: usize) -> Option<()> {
    let mut x = 0;
    while x < line.len() {
        let count = usize::from(take(bytes, 1)?[0]);
        if count > 128 {
            let value = take(bytes, 1)?[0];
            let run = line.get_mut(x..x + count - 128)?;
            run.iter_mut().for_each(|pixel| pixel[channel] = value);
            x += count - 128;
        } else {
            let values = take(bytes, count)?;
            let run = line.get_mut(x..x + count)?;
            run.iter_mut().zip(values).for_each(|(pixel, &value)| pixel[channel] = value);
            x += count;
        }
    }
    Some(())
}

/// What a mantissa of a byte is multiplied by: 2^(e − 136), and 0 for 0.
fn power(exponent: usize) -> f32 {
    if exponent == 0 { 0.0 } else { 2f64.powi(exponent as i32 - 136) as f32 }
}
