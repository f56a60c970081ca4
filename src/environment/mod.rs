//! The environment: distant light as a lat-long map of linear RGB radiance.
//!
//! Files (OpenEXR, Radiance, lists of lights) and built-in maps come in through [`load`], which mends what cannot be
//! light (see `mend`) and reports what it did. Nothing here knows how lights are fitted, or of hair.

mod builtin;
mod mend;
mod meter;
mod read_exr;
mod read_hdr;
mod read_lights;

use std::f64::consts::{PI, TAU};
use std::fmt;
use std::path::Path;

use anyhow::{Result, anyhow, bail, ensure};
use glam::DVec3;
use rayon::prelude::*;

use crate::file::read_picture_bytes;
use crate::file_kind::{FileKind, Role};
use crate::srbf::SrbfLight;

pub use mend::Mended;
pub use meter::LightMeter;
pub(crate) use read_hdr::MAGIC as HDR_MAGIC;

/// A lat-long radiance map, row-major from the zenith down.
/// The centre column looks along −z: u = 0.5 + atan2(x, −z)/2π, v = arccos(y)/π.
#[derive(Clone, Debug, Default)]
pub struct Environment {
    pub width: usize,
    pub height: usize,
    /// Linear RGB, finite and ≥ 0 once mended; length width · height.
    pub pixels: Vec<[f32; 3]>,
    /// The lights that the map is the sum of, which stand for it as they are; empty for every other map.
    pub lights: Vec<SrbfLight>,
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
    pub fn new(width: usize, height: usize, pixels: Vec<[f32; 3]>) -> Self {
        Self { width, height, pixels, lights: Vec::new() }
    }

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
        Environment::new(width, height, pixels)
    }

    /// The map at half its size or, where a side is odd, a little less: each pixel the mean of what it covers, weighted
    /// by solid angle, so that the energy stays. A side of 1 stays.
    pub fn halved(&self) -> Environment {
        let [width, height] = [self.width, self.height].map(|side| (side / 2).max(1));
        let across: Vec<[(usize, f32); 3]> =
            (0..width).map(|x| covered(x, width, self.width, |a, b| b - a)).collect();
        let mut pixels = vec![[0.0; 3]; width * height];
        pixels.par_chunks_exact_mut(width).enumerate().for_each(|(y, row)| {
            let area = |a: f64, b: f64| (PI * a).cos() - (PI * b).cos();
            let down = covered(y, height, self.height, area);
            for (pixel, across) in row.iter_mut().zip(&across) {
                for (line, down) in down {
                    for &(column, across) in across {
                        let weight = down * across;
                        let source = self.pixels[line * self.width + column];
                        *pixel = std::array::from_fn(|c| pixel[c] + weight * source[c]);
                    }
                }
            }
        });
        Environment::new(width, height, pixels)
    }

    /// Mean over the sphere, weighted by solid angle.
    pub fn mean_radiance(&self) -> [f64; 3] {
        let sum = |(row, pixels): (usize, &[[f32; 3]])| {
            let sum: DVec3 = pixels.iter().map(|rgb| DVec3::from(rgb.map(f64::from))).sum();
            sum * self.solid_angle(row)
        };
        // In the order of the rows, so that it is the same on any number of threads.
        let rows: Vec<DVec3> =
            self.pixels.par_chunks_exact(self.width).enumerate().map(sum).collect();
        (rows.into_iter().sum::<DVec3>() / (2.0 * TAU)).to_array()
    }

    /// BLAKE3 of size and pixels in hex: two maps of the same light have the same hash.
    pub fn content_hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&(self.width as u64).to_le_bytes());
        hasher.update(&(self.height as u64).to_le_bytes());
        hasher.update_rayon(bytemuck::cast_slice(&self.pixels));
        hasher.finalize().to_hex().to_string()
    }
}

/// Which of `source` equal parts of [0, 1] the `i`th of `count` covers, half as many or a few less, and the share of
/// each in it by `measure`.
fn covered(
    i: usize,
    count: usize,
    source: usize,
    measure: impl Fn(f64, f64) -> f64,
) -> [(usize, f32); 3] {
    let [start, end] = [i, i + 1].map(|i| i as f64 / count as f64);
    let first = i * source / count;
    let whole = measure(start, end);
    std::array::from_fn(|k| {
        let part = (first + k).min(source - 1);
        let [low, high] = [first + k, first + k + 1].map(|edge| edge as f64 / source as f64);
        let (low, high) = (low.max(start), high.min(end));
        (part, if low < high { (measure(low, high) / whole) as f32 } else { 0.0 })
    })
}

/// Linear Rec. 709 luminance.
fn luminance(rgb: DVec3) -> f64 {
    rgb.dot(DVec3::new(0.2126, 0.7152, 0.0722))
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

impl Loaded {
    /// What to tell whoever uses the map, a line each.
    pub fn notes(&self) -> Vec<String> {
        let mended = self.mended.any().then(|| self.mended.to_string());
        self.source.notes.iter().cloned().chain(mended).collect()
    }
}

/// What was read, for people to see.
#[derive(Clone, Debug, Default)]
pub struct SourceInfo {
    /// "OpenEXR", "Radiance", "lights" or "built-in".
    pub format: &'static str,
    /// Names and sample types, such as "R f16, G f16, B f16".
    pub channels: String,
    /// The chosen layer or part of an EXR; empty for the unnamed one.
    pub layer: String,
    /// All layers of an EXR that could have been chosen, as they are shown.
    pub layers: Vec<String>,
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
        if self.layers.len() > 1 {
            write!(f, "\nlayers: {}", self.layers.join(", "))?;
        }
        for note in &self.notes {
            write!(f, "\nnote: {note}")?;
        }
        Ok(())
    }
}

/// The map that `source` names: `builtin:studio`, `sunset`, `overcast` or `night`, else the path of
/// an OpenEXR, Radiance or lights file (told apart by its first bytes, not by its name). It comes mended.
/// An error is one line that names the source, what is wrong, and what to do.
pub fn load(source: &str) -> Result<Loaded> {
    load_layer(source, None)
}

/// [`load`], of an EXR file the layer of this name.
pub fn load_layer(source: &str, layer: Option<&str>) -> Result<Loaded> {
    load_unnamed(source, layer).map_err(|error| anyhow!("{source} {error:#}"))
}

fn load_unnamed(source: &str, layer: Option<&str>) -> Result<Loaded> {
    let (mut environment, mut info) = match source.strip_prefix("builtin:") {
        Some(name) => builtin::build(name)?,
        None => {
            let bytes = read_picture_bytes(Path::new(source))?;
            match FileKind::of(&bytes) {
                FileKind::OpenExr => read_exr::read(&bytes, layer)?,
                FileKind::Radiance => read_hdr::read(&bytes)?,
                FileKind::Lights => read_lights::read(&bytes)?,
                other => bail!(other.refusal(Role::Map)),
            }
        }
    };
    if let Some(name) = layer {
        ensure!(
            info.format == read_exr::FORMAT,
            "has no layers, so no {name}: leave environment.layer (--env-layer) at auto"
        );
    }
    if environment.width != 2 * environment.height {
        info.notes.push(format!(
            "{} × {} is not 2:1; the map is stretched over the whole sphere",
            environment.width, environment.height
        ));
    }
    let mended = mend::mend(&mut environment)?;
    if mended.mean_after == [0.0; 3] {
        info.notes.push("it is black all over: nothing is lit by it".to_owned());
    }
    Ok(Loaded { environment, mended, source: info })
}
