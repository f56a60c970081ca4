//! Mending: what cannot be light is replaced, counted, and its effect on the energy reported.
//!
//! The rule, for each channel by itself; a value is sound if it is finite, ≥ 0 and ≤ [`CEILING`]:
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

use super::Environment;

/// The largest radiance taken as real; the sun is 1.6e9 in cd/m². 16384 × 8192 squares of it sum in
/// f32.
pub const CEILING: f32 = 1e12;

/// What was mended. Counts are of channel values, up to three a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mended {
    pub nan: usize,
    /// ±Inf, and values above [`CEILING`].
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

fn is_sound(value: f32) -> bool {
    (0.0..=CEILING).contains(&value)
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

fn mend_channel(environment: &mut Environment, channel: usize, mended: &mut Mended) -> Result<()> {
    let (width, height) = (environment.width, environment.height);
    let (mut finite_sum, mut finite_weight) = (0.0, 0.0);
    let (mut sound_sum, mut sound_weight, mut largest) = (0.0, 0.0, 0.0f32);
    let mut unsound = Vec::new();
    for (row, pixels) in environment.pixels.chunks_exact(width).enumerate() {
        let weight = environment.solid_angle(row);
        for (column, rgb) in pixels.iter().enumerate() {
            let value = rgb[channel];
            if value.is_finite() && value <= CEILING {
                finite_sum += weight * f64::from(value);
                finite_weight += weight;
            }
            if is_sound(value) {
                sound_sum += weight * f64::from(value);
                sound_weight += weight;
                largest = largest.max(value);
            } else {
                unsound.push(row * width + column);
            }
        }
    }
    ensure!(
        finite_weight > 0.0,
        "has nothing to light with: every {} value is NaN, infinite or above {CEILING:e}; \
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
                if is_sound(value) {
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
            } else if value.is_infinite() || value > CEILING {
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
