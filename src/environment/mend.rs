//! Mending: what cannot be light is replaced, counted, and its effect on the energy reported.
//!
//! The rule, for each channel by itself; a value is sound if it is finite, ≥ 0 and not above the ceiling, which is
//! [`CEILING`] or, in a map whose median (of what shines) is above 1, as many times that:
//! - NaN becomes the mean of the sound values among its eight neighbours (weighted by solid angle,
//!   wrapping in u), else the channel's mean over the map: nothing known is lost, so nothing is
//!   added.
//! - +Inf and what lies above the ceiling become the channel's largest sound value: an overflowed
//!   sun stays the brightest, and no more is invented than the file shows elsewhere.
//! - Negative values (ringing of a resampled sun, −3890 in a real map) and −Inf become 0.
//!
//! Neighbours are read before any is mended, so the order of pixels does not matter. What the rule
//! does to the energy stands in [`Mended::mean_before`] and [`Mended::mean_after`].

use std::fmt;

use anyhow::{Result, ensure};
use rayon::prelude::*;

use super::Environment;

/// The largest radiance taken as real, in units or medians; the sun is 1.6e9 in cd/m².
const CEILING: f32 = 1e12;
/// Above it frames could not be reckoned in f32.
const HIGHEST_CEILING: f32 = 1e34;

/// What was mended. Counts are of channel values, up to three a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mended {
    pub nan: usize,
    /// ±Inf, and values above the ceiling.
    pub inf: usize,
    pub negative: usize,
    /// Mean of the file's finite values up to the ceiling, negatives included, weighted by solid
    /// angle.
    pub mean_before: [f64; 3],
    /// [`Environment::mean_radiance`] of the mended map.
    pub mean_after: [f64; 3],
}

impl Mended {
    /// Whether anything was mended.
    pub fn any(&self) -> bool {
        self.nan + self.inf + self.negative > 0
    }
}

/// One line: the counts, and the mean radiance before and after.
impl fmt::Display for Mended {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mean = |rgb: [f64; 3]| rgb.iter().sum::<f64>() / 3.0;
        let (before, after) = (mean(self.mean_before), mean(self.mean_after));
        write!(
            f,
            "mended {} NaN, {} infinite, {} negative values; \
             mean radiance {before:.4} → {after:.4}",
            self.nan, self.inf, self.negative
        )?;
        if before > 0.0 {
            write!(f, " ({:+.3} %)", 100.0 * (after / before - 1.0))?;
        }
        Ok(())
    }
}

fn is_sound(value: f32, ceiling: f32) -> bool {
    (0.0..=ceiling).contains(&value)
}

/// Applies the rule in place. The error, one line without the file's name: a channel that is
/// all NaN, infinite or above the ceiling. A map that comes out black is no error.
pub fn mend(environment: &mut Environment) -> Result<Mended> {
    let mut mended = Mended::default();
    for channel in 0..3 {
        mend_channel(environment, channel, &mut mended)?;
    }
    mended.mean_after = environment.mean_radiance();
    Ok(mended)
}

/// Of one channel over some pixels.
#[derive(Clone, Default)]
struct Channel {
    /// Σ of values and of weights: of those that are finite and not above the ceiling, and of the sound ones.
    finite: [f64; 2],
    sound: [f64; 2],
    largest: f32,
    /// Places of those that are not sound.
    unsound: Vec<usize>,
}

impl Channel {
    fn of_row(environment: &Environment, channel: usize, ceiling: f32, row: usize) -> Self {
        let mut sums = Self::default();
        let weight = environment.solid_angle(row);
        let first = row * environment.width;
        for (i, rgb) in environment.pixels[first..first + environment.width].iter().enumerate() {
            let value = rgb[channel];
            if value.is_finite() && value <= ceiling {
                sums.finite[0] += weight * f64::from(value);
                sums.finite[1] += weight;
            }
            if is_sound(value, ceiling) {
                sums.sound[0] += weight * f64::from(value);
                sums.sound[1] += weight;
                sums.largest = sums.largest.max(value);
            } else {
                sums.unsound.push(first + i);
            }
        }
        sums
    }

    fn of(environment: &Environment, channel: usize, ceiling: f32) -> Self {
        let of_row = |row| Self::of_row(environment, channel, ceiling, row);
        let rows: Vec<Self> = (0..environment.height).into_par_iter().map(of_row).collect();
        // In the order of the rows, so that it is the same on any number of threads.
        rows.into_iter().fold(Self::default(), |mut sum, row| {
            for k in 0..2 {
                sum.finite[k] += row.finite[k];
                sum.sound[k] += row.sound[k];
            }
            sum.largest = sum.largest.max(row.largest);
            sum.unsound.extend(row.unsound);
            sum
        })
    }
}

/// [`CEILING`], or as far above a channel whose usual values are above 1, up to what f32 can be reckoned with.
fn ceiling(environment: &Environment, channel: usize) -> f32 {
    let value = |rgb: &[f32; 3]| rgb[channel];
    if !environment.pixels.par_iter().map(value).any(|v| v.is_finite() && v > CEILING) {
        return CEILING;
    }
    let mut shining: Vec<f32> =
        environment.pixels.par_iter().map(value).filter(|v| v.is_finite() && *v > 0.0).collect();
    let middle = shining.len() / 2;
    let (_, median, _) = shining.select_nth_unstable_by(middle, f32::total_cmp);
    (CEILING * median.max(1.0)).min(HIGHEST_CEILING)
}

fn mend_channel(environment: &mut Environment, channel: usize, mended: &mut Mended) -> Result<()> {
    let (width, height) = (environment.width, environment.height);
    let ceiling = ceiling(environment, channel);
    let sums = Channel::of(environment, channel, ceiling);
    let Channel { finite: [finite_sum, finite_weight], sound, largest, unsound } = sums;
    let [sound_sum, sound_weight] = sound;
    ensure!(
        finite_weight > 0.0,
        "has nothing to light with: every {} value is NaN, infinite or above {ceiling:e}; \
         export the map again",
        ["red", "green", "blue"][channel]
    );
    mended.mean_before[channel] = finite_sum / finite_weight;

    let value_at = |index: usize| environment.pixels[index][channel];
    let neighbours_mean = |index: usize| {
        let (column, row) = (index % width, index / width);
        let (mut sum, mut weight) = (0.0, 0.0);
        for y in row.saturating_sub(1)..=(row + 1).min(height - 1) {
            let solid_angle = environment.solid_angle(y);
            for x in [column + width - 1, column, column + 1] {
                let value = value_at(y * width + x % width);
                if is_sound(value, ceiling) {
                    sum += solid_angle * f64::from(value);
                    weight += solid_angle;
                }
            }
        }
        if weight > 0.0 {
            sum / weight
        } else if sound_weight > 0.0 {
            sound_sum / sound_weight
        } else {
            0.0
        }
    };
    let mends: Vec<(usize, f32)> = unsound
        .into_iter()
        .map(|index| {
            let value = value_at(index);
            let mend = if value.is_nan() {
                mended.nan += 1;
                neighbours_mean(index) as f32
            } else if value.is_infinite() || value > ceiling {
                mended.inf += 1;
                if value > 0.0 { largest } else { 0.0 }
            } else {
                mended.negative += 1;
                0.0
            };
            (index, mend)
        })
        .collect();
    for (index, mend) in mends {
        environment.pixels[index][channel] = mend;
    }
    Ok(())
}
