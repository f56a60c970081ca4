//! Whether a fibre model's samples follow the density that it states: Pearson's χ² over the sphere.
//!
//! The sphere of ω_i is cut into even bins of (θ_i, φ_i). A bin's expected count is the integral of `pdf`
//! over it, by a product rule halved until it is far finer than the counts' own noise; bins that expect
//! fewer than [`EXPECTED_MIN`] samples are pooled with their neighbours. Draws without a direction are a
//! bin of their own, which expects what the density lacks of 1.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use hairlight::{
    reference::model::{Direction, FibreModel},
    scattering::quadrature::GaussLegendre,
};
use rayon::prelude::*;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Bins over θ_i in [−π/2, π/2] and over φ_i in [−π, π].
const ROWS: usize = 64;
/// See [`ROWS`].
const COLUMNS: usize = 64;

/// Pearson's statistic follows the χ² distribution only where every bin expects a good many.
const EXPECTED_MIN: f64 = 10.0;

/// The expected counts' own error, as a share of all samples: a density whose integral is as near to 1 as
/// this leaves no draw without a direction.
const RULE_ERROR: f64 = 1e-3;

/// Places across the fibre that stand for all where h is not given.
const OFFSETS: usize = 4;

/// A bin whose first 16 nodes, 0.016 to 0.033 rad apart, see less than this is not looked into: no lobe of
/// a standard deviation above 0.003 rad hides between them.
const EMPTY: f64 = 1e-4;

/// How often a bin may be halved both ways.
const DEPTH: u32 = 6;

/// Numbers spread evenly over [0, 1), by SplitMix64.
pub struct Uniform(pub u64);

impl Uniform {
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn array<const N: usize>(&mut self) -> [f64; N] {
        std::array::from_fn(|_| self.next())
    }
}

/// The p-value that each of `tests` independent tests must reach, so that all of them pass with
/// probability 1−`alpha` when nothing is wrong (Šidák).
pub fn sidak(alpha: f64, tests: usize) -> f64 {
    1.0 - (1.0 - alpha).powf(1.0 / tests as f64)
}

/// The p-value of `samples` draws of ω_i for ω_o = `o` against the stated density: evenly spread over [0, 1]
/// where the two agree, next to 0 where they do not. `h` = None takes [`OFFSETS`] places across the fibre
/// in turn. A density whose integral is above 1 by more than
/// [`RULE_ERROR`] has the p-value 0.
pub fn test(
    name: &str,
    model: &dyn FibreModel,
    o: &Direction,
    h: Option<f64>,
    samples: usize,
    seed: u64,
) -> f64 {
    let offsets = match h {
        Some(h) => vec![h],
        None => (0..OFFSETS).map(|k| 2.0 * (k as f64 + 0.5) / OFFSETS as f64 - 1.0).collect(),
    };
    let counts = counts(model, o, &offsets, samples, seed);
    let mut expected = expected(model, o, &offsets, samples);
    let total: f64 = expected.iter().sum();
    let lacking = 1.0 - total / samples as f64;
    if lacking < -RULE_ERROR {
        println!("χ² {name}: the density integrates to {:.4}", 1.0 - lacking);
        return 0.0;
    }
    expected.push(if lacking > RULE_ERROR { lacking * samples as f64 } else { 0.0 });

    let (mut statistic, mut groups) = (0.0, 0);
    let (mut pool, mut rest) = ((0.0, 0.0), (0.0, 0.0));
    for (&count, &expected) in counts.iter().zip(&expected) {
        pool = (pool.0 + count, pool.1 + expected);
        if pool.1 >= EXPECTED_MIN {
            statistic += (pool.0 - pool.1).powi(2) / pool.1;
            groups += 1;
            rest = std::mem::take(&mut pool);
        }
    }
    // What is left joins the last group.
    if pool.0 > 0.0 || pool.1 > 0.0 {
        statistic -= (rest.0 - rest.1).powi(2) / rest.1.max(1e-300);
        statistic += (rest.0 + pool.0 - rest.1 - pool.1).powi(2) / (rest.1 + pool.1);
    }
    assert!(groups > 1, "{name}: all samples in one bin");
    let p = ChiSquared::new((groups - 1) as f64).unwrap().sf(statistic);
    println!(
        "χ² {name}: {groups} groups, χ²/dof {:.3}, p {p:.3e}, density's integral {:.5}",
        statistic / (groups - 1) as f64,
        1.0 - lacking,
    );
    p
}

/// Draws in each bin, then those without a direction.
fn counts(
    model: &dyn FibreModel,
    o: &Direction,
    offsets: &[f64],
    samples: usize,
    seed: u64,
) -> Vec<f64> {
    let mut random = Uniform(seed);
    let mut counts = vec![0.0; ROWS * COLUMNS + 1];
    let place = |x: f64, bins: usize| ((x * bins as f64) as usize).min(bins - 1);
    for k in 0..samples {
        let bin = match model.sample(o, offsets[k % offsets.len()], random.array()) {
            Some(sample) => {
                let (theta, phi) = (sample.direction.theta(), sample.direction.phi);
                assert!(
                    theta.abs() <= FRAC_PI_2 + 1e-12 && phi.abs() <= PI + 1e-12,
                    "θ_i {theta}, φ_i {phi}"
                );
                let row = place((theta + FRAC_PI_2).max(0.0) / PI, ROWS);
                row * COLUMNS + place((phi + PI).max(0.0) / TAU, COLUMNS)
            }
            None => ROWS * COLUMNS,
        };
        counts[bin] += 1.0;
    }
    counts
}

/// Samples that each bin expects.
fn expected(model: &dyn FibreModel, o: &Direction, offsets: &[f64], samples: usize) -> Vec<f64> {
    let rule = GaussLegendre::new(4);
    let per_offset = samples as f64 / offsets.len() as f64;
    (0..ROWS * COLUMNS)
        .into_par_iter()
        .map(|bin| {
            let theta = -FRAC_PI_2 + PI * (bin / COLUMNS) as f64 / ROWS as f64;
            let phi = -PI + TAU * (bin % COLUMNS) as f64 / COLUMNS as f64;
            let cell = Cell { theta, phi, height: PI / ROWS as f64, width: TAU / COLUMNS as f64 };
            offsets
                .iter()
                .map(|&h| {
                    let density = |theta: f64, phi: f64| {
                        let i = Direction::new(theta, phi);
                        let pdf = model.evaluate(o, &i, h).pdf;
                        assert!(pdf.is_finite() && pdf >= 0.0, "pdf {pdf} at {i:?}, {o:?}, h {h}");
                        per_offset * pdf * i.cos_theta
                    };
                    let whole = cell.rule(&rule, &density);
                    cell.refined(&rule, &density, whole, DEPTH)
                })
                .sum()
        })
        .collect()
}

struct Cell {
    theta: f64,
    phi: f64,
    height: f64,
    width: f64,
}

impl Cell {
    fn rule(&self, rule: &GaussLegendre, f: &impl Fn(f64, f64) -> f64) -> f64 {
        rule.integrate(self.theta, self.theta + self.height, |theta| {
            rule.integrate(self.phi, self.phi + self.width, |phi| f(theta, phi))
        })
    }

    /// ∫f by halving until a step moves it by less than a tenth of its own √count; `whole` is the
    /// rule over the cell itself.
    fn refined(
        &self,
        rule: &GaussLegendre,
        f: &impl Fn(f64, f64) -> f64,
        whole: f64,
        depth: u32,
    ) -> f64 {
        if whole < EMPTY {
            return whole;
        }
        let (height, width) = (0.5 * self.height, 0.5 * self.width);
        let quarters = [(0.0, 0.0), (0.0, width), (height, 0.0), (height, width)].map(|(t, p)| {
            let cell = Cell { theta: self.theta + t, phi: self.phi + p, height, width };
            let sum = cell.rule(rule, f);
            (cell, sum)
        });
        let sum: f64 = quarters.iter().map(|q| q.1).sum();
        if depth == 0 || (sum - whole).abs() < 0.1 * sum.max(1.0).sqrt() {
            return sum;
        }
        quarters.iter().map(|(cell, whole)| cell.refined(rule, f, *whole, depth - 1)).sum()
    }
}
