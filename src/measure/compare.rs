//! The judge: how far a frame is from the truth, over the pixels that hair covers.
//!
//! Every mean is weighted by w, the coverage by hair of the **truth** (its `hair` channel; its alpha where
//! it has none; else every pixel counts alike), so that a pixel that hair half covers counts half, and one
//! without hair does not count. With a the frame, b the truth, ⟨·⟩ the weighted mean over pixels and
//! channels, all in linear radiance:
//!
//! - relative L2 = √(⟨(a−b)²⟩/⟨b²⟩): dominated by bright pixels.
//! - relMSE = ⟨(a−b)²/(b²+ε)⟩, ε = 0.01⟨b⟩²: a dark pixel counts as much as a bright one. The usual ε
//!   is 0.01 at any exposure; ours is that at a mean of 1, and does not change with the exposure.
//! - mean ratio = Σwa/Σwb for each channel: energy.
//! - FLIP (Andersson et al. 2020, LDR, 67 pixels a degree): what an eye sees when it flips between the
//!   two, both tone mapped as pictures are, with the exposure that brings the truth's mean luminance to middle grey.
//!   Pixels that do not count are black in both.
//! - noise: where variances are known, the relative L2 that noise alone would leave.

use std::fmt::{self, Display, Formatter};

use anyhow::{Result, bail, ensure};
use image::{Rgb, RgbImage};
use serde::Serialize;

use super::read::Picture;
use crate::image::{luminance, srgb8, tone_map};

/// The truth's mean luminance after exposure: middle grey, so that dark hair is judged as it would be shown.
const EXPOSED_MEAN: f64 = 0.18;
/// ε of relMSE as a share of the squared mean.
const RELATIVE_EPSILON: f64 = 0.01;

/// What pixels are weighted by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Weight {
    /// The truth's coverage by hair.
    Hair,
    /// The truth's alpha, for want of a `hair` channel.
    Alpha,
    /// 1, for want of both.
    Everything,
}

/// How far a frame is from the truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    pub frame: String,
    pub truth: String,
    pub width: usize,
    pub height: usize,
    pub weight: Weight,
    /// Pixels whose weight is above 0.
    pub pixels: usize,
    pub relative_l2: f64,
    pub relative_mse: f64,
    /// R, G, B; null where the truth has none of it.
    pub mean_ratio: [Option<f64>; 3],
    pub flip_mean: f64,
    /// The value that 99 % of the weight lies at or below.
    pub flip_p99: f64,
    /// The greatest difference in any channel.
    pub max_abs: f64,
    /// Its pixel: column and row from the top left.
    pub max_abs_at: [usize; 2],
    /// Σ|h_a − h_b| / Σh_b of the two `hair` channels, where both have one.
    pub coverage_difference: Option<f64>,
    pub noise: Option<Noise>,
    /// What both were multiplied by before tone mapping.
    pub exposure_scale: f64,
}

/// What of the error is noise, from the variances that the pictures carry.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Noise {
    /// √(⟨variance⟩/⟨b²⟩): the relative L2 expected if the two differed by noise alone.
    pub relative_l2: f64,
    /// Its square over the square of the measured one: the share of the squared error that is noise.
    pub share: f64,
    /// √(relative L2² − noise²), 0 where noise explains it all.
    pub relative_l2_without: f64,
}

impl Report {
    /// Relative L2 without what is known to be noise.
    pub fn error(&self) -> f64 {
        self.noise.map_or(self.relative_l2, |noise| noise.relative_l2_without)
    }
}

/// Judges `frame` by `truth`. Errors: sizes that differ, a value that is not finite or a variance below 0
/// (with its pixel), no pixel that counts, a truth that is black.
pub fn compare(frame: &Picture, truth: &Picture) -> Result<Report> {
    let pair = Pair::new(frame, truth)?;
    Ok(report(&pair, &pair.flip()))
}

/// How far a frame is from the truth, and where. The pictures are sRGB, row by row.
pub struct Judged {
    pub report: Report,
    /// The difference of luminance: red where the frame is brighter, blue where it is darker, full at the truth's mean.
    pub signed: Vec<[u8; 3]>,
    /// FLIP in the magma colours.
    pub flip: Vec<[u8; 3]>,
}

/// [`compare`], and pictures of the difference. Errors as there.
pub fn judge(frame: &Picture, truth: &Picture) -> Result<Judged> {
    let pair = Pair::new(frame, truth)?;
    let flip = pair.flip();
    Ok(Judged { report: report(&pair, &flip), signed: pair.signed(), flip: in_magma(&flip) })
}

fn report(pair: &Pair, flip: &[f32]) -> Report {
    let Pair { frame, truth, .. } = pair;
    let (a, b, w) = (&frame.rgb, &truth.rgb, &pair.weights);
    let channels = || (0..3 * w.len()).map(|i| (i / 3, i % 3));
    let total = 3.0 * w.iter().sum::<f64>();
    let mean = |of: &dyn Fn(usize, usize) -> f64| {
        channels().map(|(i, c)| w[i] * of(i, c)).sum::<f64>() / total
    };
    let squared = |i: usize, c: usize| (f64::from(a[i][c]) - f64::from(b[i][c])).powi(2);
    let b2 = |i: usize, c: usize| f64::from(b[i][c]).powi(2);

    let norm = mean(&b2);
    let relative_l2 = (mean(&squared) / norm).sqrt();
    let epsilon = RELATIVE_EPSILON * mean(&|i, c| f64::from(b[i][c])).powi(2);
    let sum =
        |of: &[[f32; 3]], c: usize| of.iter().zip(w).map(|(p, w)| w * f64::from(p[c])).sum::<f64>();
    let (max_abs, worst) = channels()
        .filter(|&(i, _)| w[i] > 0.0)
        .map(|(i, c)| (squared(i, c).sqrt(), i))
        .fold((0.0, 0), |most, this| if this.0 > most.0 { this } else { most });
    let variances: Vec<_> =
        [frame, truth].into_iter().filter_map(|p| p.variance.as_ref()).collect();
    let noise = (!variances.is_empty()).then(|| {
        let variance = mean(&|i, c| variances.iter().map(|v| f64::from(v[i][c])).sum());
        let (noise, error) = (variance / norm, relative_l2 * relative_l2);
        Noise {
            relative_l2: noise.sqrt(),
            share: if error > 0.0 { noise / error } else { 0.0 },
            relative_l2_without: (error - noise).max(0.0).sqrt(),
        }
    });
    let coverage_difference = frame.hair.as_ref().zip(truth.hair.as_ref()).map(|(a, b)| {
        let apart: f64 = a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).sum();
        apart / b.iter().map(|&b| f64::from(b)).sum::<f64>()
    });
    Report {
        frame: frame.name.clone(),
        truth: truth.name.clone(),
        width: truth.size[0],
        height: truth.size[1],
        weight: pair.weight,
        pixels: w.iter().filter(|&&w| w > 0.0).count(),
        relative_l2,
        relative_mse: mean(&|i, c| squared(i, c) / (b2(i, c) + epsilon)),
        mean_ratio: [0, 1, 2].map(|c| {
            let below = sum(b, c);
            (below != 0.0).then(|| sum(a, c) / below)
        }),
        flip_mean: flip.iter().zip(w).map(|(f, w)| f64::from(*f) * w).sum::<f64>() * 3.0 / total,
        flip_p99: percentile(flip, w, 0.99),
        max_abs,
        max_abs_at: [worst % truth.size[0], worst / truth.size[0]],
        coverage_difference,
        noise,
        exposure_scale: pair.scale,
    }
}

/// Four pictures side by side, for eyes: the frame and the truth, tone mapped, and those of [`Judged`]. Errors as of
/// [`compare`].
pub fn difference_picture(frame: &Picture, truth: &Picture) -> Result<RgbImage> {
    /// Pixels between pictures.
    const GAP: usize = 4;
    let pair = Pair::new(frame, truth)?;
    let [width, height] = truth.size;
    let shown = |picture: &Picture| picture.rgb.iter().map(|&p| pair.shown(p)).collect();
    let panels: [Vec<[u8; 3]>; 4] =
        [shown(frame), shown(truth), pair.signed(), in_magma(&pair.flip())];
    let mut picture = RgbImage::from_pixel(
        (panels.len() * (width + GAP) - GAP) as u32,
        height as u32,
        Rgb([255; 3]),
    );
    for (k, panel) in panels.iter().enumerate() {
        for (i, &rgb) in panel.iter().enumerate() {
            let x = (k * (width + GAP) + i % width) as u32;
            picture.put_pixel(x, (i / width) as u32, Rgb(rgb));
        }
    }
    Ok(picture)
}

fn in_magma(flip: &[f32]) -> Vec<[u8; 3]> {
    let magma = nv_flip::magma_lut().to_vec();
    let of = |&value: &f32| {
        let at = 3 * (255.0 * value.clamp(0.0, 1.0)).round() as usize;
        [magma[at], magma[at + 1], magma[at + 2]]
    };
    flip.iter().map(of).collect()
}

/// Two pictures that can be compared, and what pixels count.
struct Pair<'a> {
    frame: &'a Picture,
    truth: &'a Picture,
    weight: Weight,
    weights: Vec<f64>,
    /// Exposure before tone mapping.
    scale: f64,
}

impl<'a> Pair<'a> {
    fn new(frame: &'a Picture, truth: &'a Picture) -> Result<Self> {
        ensure!(
            frame.size == truth.size,
            "{} has {} × {} pixels and {} has {} × {}: render both at one size",
            frame.name,
            frame.size[0],
            frame.size[1],
            truth.name,
            truth.size[0],
            truth.size[1]
        );
        check(frame)?;
        check(truth)?;
        let (weight, coverage) = match (&truth.hair, &truth.alpha) {
            (Some(hair), _) => (Weight::Hair, Some(hair)),
            (None, Some(alpha)) => (Weight::Alpha, Some(alpha)),
            (None, None) => (Weight::Everything, None),
        };
        let weights: Vec<f64> = match coverage {
            Some(coverage) => coverage.iter().map(|&w| f64::from(w).max(0.0)).collect(),
            None => vec![1.0; truth.rgb.len()],
        };
        let total: f64 = weights.iter().sum();
        ensure!(
            total > 0.0,
            "{}: no pixel has any {}, so that there is nothing to compare",
            truth.name,
            if weight == Weight::Hair { "hair" } else { "coverage" }
        );
        let light: f64 =
            truth.rgb.iter().zip(&weights).map(|(&p, w)| w * f64::from(luminance(p))).sum();
        ensure!(
            light > 0.0,
            "{}: is black wherever pixels count, so that no error is relative to it",
            truth.name
        );
        Ok(Pair { frame, truth, weight, weights, scale: EXPOSED_MEAN * total / light })
    }

    /// sRGB bytes of a radiance.
    fn shown(&self, rgb: [f32; 3]) -> [u8; 3] {
        tone_map(rgb.map(|c| c * self.scale as f32)).map(srgb8)
    }

    /// See [`Judged::signed`].
    fn signed(&self) -> Vec<[u8; 3]> {
        let of = |i: usize| {
            let apart = luminance(self.frame.rgb[i]) - luminance(self.truth.rgb[i]);
            let apart = apart * self.scale as f32 / EXPOSED_MEAN as f32;
            let (more, less) = (apart.clamp(0.0, 1.0), (-apart).clamp(0.0, 1.0));
            [more + 0.1 * less, 0.25 * (more + less), less + 0.05 * more].map(srgb8)
        };
        let counts = |i: usize| self.weights[i] > 0.0;
        (0..self.weights.len()).map(|i| if counts(i) { of(i) } else { [0; 3] }).collect()
    }

    /// FLIP for each pixel.
    fn flip(&self) -> Vec<f32> {
        let [width, height] = self.truth.size.map(|n| n as u32);
        let [truth, frame] = [self.truth, self.frame].map(|picture| {
            let bytes: Vec<u8> = picture
                .rgb
                .iter()
                .zip(&self.weights)
                .flat_map(|(&p, &w)| if w > 0.0 { self.shown(p) } else { [0; 3] })
                .collect();
            nv_flip::FlipImageRgb8::with_data(width, height, &bytes)
        });
        nv_flip::flip(truth, frame, nv_flip::DEFAULT_PIXELS_PER_DEGREE).to_vec()
    }
}

/// The least value that `share` of the weight lies at or below.
fn percentile(values: &[f32], weights: &[f64], share: f64) -> f64 {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&i, &j| values[i].total_cmp(&values[j]));
    let mut left = share * weights.iter().sum::<f64>();
    let at = order.iter().find(|&&i| {
        left -= weights[i];
        left <= 0.0
    });
    at.or(order.last()).map_or(0.0, |&i| f64::from(values[i]))
}

/// Errors on a value that is not finite, and on a variance below 0.
fn check(picture: &Picture) -> Result<()> {
    let fault = |i: usize, channel: &str, value: f32| -> Result<()> {
        bail!(
            "{}: {channel} is {value} at pixel ({}, {}): render the picture again",
            picture.name,
            i % picture.size[0],
            i / picture.size[0]
        )
    };
    for (i, pixel) in picture.rgb.iter().enumerate() {
        if let Some(c) = pixel.iter().position(|v| !v.is_finite()) {
            fault(i, ["R", "G", "B"][c], pixel[c])?;
        }
    }
    for (plane, channel) in [(&picture.alpha, "A"), (&picture.hair, "hair")] {
        for (i, &value) in plane.iter().flatten().enumerate() {
            if !value.is_finite() {
                fault(i, channel, value)?;
            }
        }
    }
    for (i, pixel) in picture.variance.iter().flatten().enumerate() {
        if let Some(c) = pixel.iter().position(|v| !v.is_finite() || *v < 0.0) {
            fault(i, ["variance.R", "variance.G", "variance.B"][c], pixel[c])?;
        }
    }
    Ok(())
}

impl Display for Report {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let by = match self.weight {
            Weight::Hair => "weighted by the truth's coverage by hair",
            Weight::Alpha => "weighted by the truth's alpha: it has no hair channel",
            Weight::Everything => "every pixel alike: the truth has neither hair nor alpha",
        };
        writeln!(f, "{} against {}", self.frame, self.truth)?;
        writeln!(f, "{} of {} × {} pixels, {by}", self.pixels, self.width, self.height)?;
        let mut row = |name: &str, value: String| writeln!(f, "  {name:<22} {value}");
        row("relative L2", format!("{:.4}", self.relative_l2))?;
        if let Some(noise) = self.noise {
            let (percent, without) = (100.0 * noise.share, noise.relative_l2_without);
            row("  of which noise", format!("{:.4} ({percent:.0} %)", noise.relative_l2))?;
            row("  without noise", format!("{without:.4}"))?;
        }
        row("relMSE", format!("{:.4}", self.relative_mse))?;
        let ratio = self.mean_ratio.map(|r| r.map_or("–".into(), |r| format!("{r:.4}")));
        row("mean ratio R, G, B", ratio.join("  "))?;
        row("FLIP mean", format!("{:.4}", self.flip_mean))?;
        row("FLIP p99", format!("{:.4}", self.flip_p99))?;
        let [x, y] = self.max_abs_at;
        row("greatest difference", format!("{:.4} at ({x}, {y})", self.max_abs))?;
        if let Some(apart) = self.coverage_difference {
            row("coverage difference", format!("{:.4}", apart))?;
        }
        Ok(())
    }
}
