//! The environment: distant light as a lat-long map of linear RGB radiance.
//!
//! Files (OpenEXR, Radiance) and built-in maps come in through [`load`], which mends what cannot be
//! light (see `mend`) and reports what it did. Nothing here knows of light fitting or of hair.

mod builtin;
mod mend;
mod read_exr;
mod read_hdr;

use std::f64::consts::{PI, TAU};
use std::fmt;
use std::fs::File;
use std::io::Read;

use anyhow::{Context, Result, anyhow, bail, ensure};
use glam::DVec3;

use crate::file_kind::{FileKind, Role};
pub use mend::Mended;
pub(crate) use read_exr::MAGIC as EXR_MAGIC;
pub(crate) use read_hdr::MAGIC as HDR_MAGIC;

/// The largest map that is read: 16384 × 8192, 1.5 GiB of RGB floats.
pub const MAX_PIXELS: usize = 16384 * 8192;
/// The largest file that is read, for the same map uncompressed with a few more channels.
const MAX_FILE_BYTES: u64 = 4 << 30;
/// No side of a map is longer: twice the largest map's width leaves room for odd shapes.
const MAX_SIDE: usize = 32768;

/// A lat-long radiance map, row-major from the zenith down.
/// The centre column looks along −z: u = 0.5 + atan2(x, −z)/2π, v = arccos(y)/π.
#[derive(Clone, Debug)]
pub struct Environment {
    pub width: usize,
    pub height: usize,
    /// Linear RGB, finite and ≥ 0 once mended; length width · height.
    pub pixels: Vec<[f32; 3]>,
}

/// Position in the map that a unit direction looks at: u in [0, 1] from left to right, v in [0, 1]
/// from the zenith down. Inverse of [`uv_to_direction`]; u at the poles is arbitrary.
pub fn direction_to_uv(direction: DVec3) -> [f64; 2] {
    // v = arccos(y)/π, as an atan2 since arccos loses half the digits near the poles.
    let horizontal = direction.x.hypot(direction.z);
    [0.5 + direction.x.atan2(-direction.z) / TAU, horizontal.atan2(direction.y) / PI]
}

/// Unit direction of a position in the map; u wraps. Inverse of [`direction_to_uv`].
pub fn uv_to_direction([u, v]: [f64; 2]) -> DVec3 {
    let (sin_phi, cos_phi) = (TAU * (u - 0.5)).sin_cos();
    let (sin_polar, cos_polar) = (PI * v).sin_cos();
    DVec3::new(sin_polar * sin_phi, cos_polar, -sin_polar * cos_phi)
}

impl Environment {
    /// Solid angle in sr of one pixel in `row`, exactly: (2π/width)(cos θ₀ − cos θ₁) between its
    /// edges.
    pub fn solid_angle(&self, row: usize) -> f64 {
        let half_step = PI / (2.0 * self.height as f64);
        let polar = PI * (row as f64 + 0.5) / self.height as f64;
        TAU / self.width as f64 * 2.0 * polar.sin() * half_step.sin()
    }

    /// Unit direction through the centre of a pixel.
    pub fn pixel_direction(&self, column: usize, row: usize) -> DVec3 {
        uv_to_direction([
            (column as f64 + 0.5) / self.width as f64,
            (row as f64 + 0.5) / self.height as f64,
        ])
    }

    /// Radiance from a unit direction, bilinear between pixel centres: wraps around in u and holds
    /// the last row beyond its centre towards a pole.
    pub fn radiance(&self, direction: DVec3) -> [f64; 3] {
        let [u, v] = direction_to_uv(direction);
        let x = (u - 0.5 / self.width as f64).rem_euclid(1.0) * self.width as f64;
        let y = (v * self.height as f64 - 0.5).clamp(0.0, (self.height - 1) as f64);
        let (left, top) = (x as usize % self.width, y as usize);
        let (right, bottom) = ((left + 1) % self.width, (top + 1).min(self.height - 1));
        let (across, down) = (x.fract(), y.fract());
        let pixel = |column: usize, row: usize| {
            DVec3::from(self.pixels[row * self.width + column].map(f64::from))
        };
        pixel(left, top)
            .lerp(pixel(right, top), across)
            .lerp(pixel(left, bottom).lerp(pixel(right, bottom), across), down)
            .to_array()
    }

    /// Radiance from a unit direction as it is shown behind the hair: by a cubic B-spline over the 4 × 4 nearest
    /// pixels, which has no negative lobes and hides the pixels of a map that the lens magnifies. Twin:
    /// `environment_radiance` of shaders/resolve.wgsl.
    pub fn smooth_radiance(&self, direction: DVec3) -> [f64; 3] {
        let [u, v] = direction_to_uv(direction);
        let (x, y) = (u * self.width as f64 - 0.5, v * self.height as f64 - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (across, down) = (b_spline(x - left), b_spline(y - top));
        let mut sum = DVec3::ZERO;
        for (j, down) in down.into_iter().enumerate() {
            let row = (top as i64 + j as i64 - 1).clamp(0, self.height as i64 - 1) as usize;
            for (i, across) in across.into_iter().enumerate() {
                let column = (left as i64 + i as i64 - 1).rem_euclid(self.width as i64) as usize;
                let pixel = self.pixels[row * self.width + column].map(f64::from);
                sum += across * down * DVec3::from(pixel);
            }
        }
        sum.to_array()
    }

    /// The map in blocks of equally many pixels, each block its mean, so that no side is longer than `most` ≥ 1.
    pub fn shrunk(&self, most: usize) -> Environment {
        let factor = self.width.div_ceil(most).max(self.height.div_ceil(most));
        let (width, height) = (self.width.div_ceil(factor), self.height.div_ceil(factor));
        let mut pixels = vec![[0.0; 3]; width * height];
        for (y, row) in pixels.chunks_exact_mut(width).enumerate() {
            for (x, mean) in row.iter_mut().enumerate() {
                let (x0, y0) = (x * factor, y * factor);
                let (x1, y1) = ((x0 + factor).min(self.width), (y0 + factor).min(self.height));
                for yy in y0..y1 {
                    for pixel in &self.pixels[yy * self.width + x0..yy * self.width + x1] {
                        for c in 0..3 {
                            mean[c] += pixel[c] / ((x1 - x0) * (y1 - y0)) as f32;
                        }
                    }
                }
            }
        }
        Environment { width, height, pixels }
    }

    /// Mean over the sphere, weighted by solid angle.
    pub fn mean_radiance(&self) -> [f64; 3] {
        let mut sum = DVec3::ZERO;
        for (row, pixels) in self.pixels.chunks_exact(self.width).enumerate() {
            let row_sum: DVec3 = pixels.iter().map(|rgb| DVec3::from(rgb.map(f64::from))).sum();
            sum += row_sum * self.solid_angle(row);
        }
        (sum / (2.0 * TAU)).to_array()
    }

    /// BLAKE3 of size and pixels in hex: two maps of the same light have the same hash.
    pub fn content_hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&(self.width as u64).to_le_bytes());
        hasher.update(&(self.height as u64).to_le_bytes());
        hasher.update(bytemuck::cast_slice(&self.pixels));
        hasher.finalize().to_hex().to_string()
    }
}

/// Weights of the four nearest samples at t in [0, 1) past the second, for a cubic B-spline.
fn b_spline(t: f64) -> [f64; 4] {
    let r = 1.0 - t;
    let inner = |t: f64| 4.0 + 3.0 * t * t * (t - 2.0);
    [r * r * r, inner(t), inner(r), t * t * t].map(|w| w / 6.0)
}

/// A map ready to light with, and what to tell about where it came from.
#[derive(Debug)]
pub struct Loaded {
    pub environment: Environment,
    pub mended: Mended,
    pub source: SourceInfo,
}

/// What was read, for people to see.
#[derive(Clone, Debug)]
pub struct SourceInfo {
    /// "OpenEXR", "Radiance" or "built-in".
    pub format: &'static str,
    /// Names and sample types, such as "R f16, G f16, B f16".
    pub channels: String,
    /// The chosen layer or part of an EXR; empty for the unnamed one.
    pub layer: String,
    pub compression: &'static str,
    /// One line each: what is unusual about the file and how it was taken.
    pub notes: Vec<String>,
}

/// One line, then one for each note.
impl fmt::Display for SourceInfo {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}, {}", self.format, self.channels)?;
        if !self.layer.is_empty() {
            write!(f, ", layer {}", self.layer)?;
        }
        write!(f, ", compression {}", self.compression)?;
        for note in &self.notes {
            write!(f, "\nnote: {note}")?;
        }
        Ok(())
    }
}

/// The map that `source` names: `builtin:studio`, `sunset`, `overcast` or `night`, else the path of
/// an OpenEXR or Radiance file (told apart by its first bytes, not by its name). It comes mended.
/// An error is one line that names the source, what is wrong, and what to do.
pub fn load(source: &str) -> Result<Loaded> {
    load_unnamed(source).map_err(|error| anyhow!("{source} {error:#}"))
}

fn load_unnamed(source: &str) -> Result<Loaded> {
    let (mut environment, mut info) = match source.strip_prefix("builtin:") {
        Some(name) => builtin::build(name)?,
        None => read_file(source)?,
    };
    if environment.width != 2 * environment.height {
        info.notes.push(format!(
            "{} × {} is not 2:1; the map is stretched over the whole sphere",
            environment.width, environment.height
        ));
    }
    let mended = mend::mend(&mut environment)?;
    Ok(Loaded { environment, mended, source: info })
}

fn read_file(path: &str) -> Result<(Environment, SourceInfo)> {
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes))
        .context("cannot be read")?;
    ensure!(bytes.len() as u64 <= MAX_FILE_BYTES, "is larger than 4 GiB: scale the map down");
    if bytes.starts_with(&read_exr::MAGIC) {
        read_exr::read(&bytes)
    } else if bytes.starts_with(read_hdr::MAGIC) {
        read_hdr::read(&bytes)
    } else if bytes.is_empty() {
        bail!("is empty; export the file again")
    } else {
        bail!(FileKind::of(&bytes).refusal(Role::Map))
    }
}

/// One size for every claim of width and height, checked before anything is allocated.
fn check_pixels(width: usize, height: usize) -> Result<()> {
    ensure!(
        width.max(height) <= MAX_SIDE && (1..=MAX_PIXELS).contains(&width.saturating_mul(height)),
        "claims {width} × {height} pixels; up to 16384 × 8192 can be read: scale the map down"
    );
    Ok(())
}
