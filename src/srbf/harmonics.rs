//! Real spherical harmonics of a lat-long map and of lobes: exact blurs and exact norms.
//!
//! An SRBF of sharpness κ = 2/λ², scaled to unit integral, is the von Mises–Fisher density.
//! Convolving with it multiplies band l by A_l(κ) = I_{l+1/2}(κ)/I_{1/2}(κ), and the squared norm
//! of a map is the sum of its squared coefficients (Parseval), so an error after a blur needs no
//! grid. The map's pixels count as constant patches: projection integrates them exactly in azimuth
//! and by Gauss–Legendre in inclination.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use rayon::prelude::*;

use super::{SrbfLight, sharpness};
use crate::environment::Environment;

/// Rows are summed in this many groups, so that the sum does not depend on the number of threads.
const ROW_GROUPS: usize = 16;

/// Steps over the inclination, at least: maps of fewer rows have each row integrated in parts.
const MIN_INCLINATION_STEPS: usize = 256;

/// A function on the sphere by its RGB coefficients up to a band, in the order l² + l + m.
/// m ≥ 0 belongs to cos mφ, m < 0 to sin |m|φ; the axis is y and φ = atan2(x, −z).
#[derive(Clone, Debug)]
pub(super) struct Harmonics {
    band: usize,
    coefficients: Vec<[f64; 3]>,
}

/// The band beyond which a blur by λ leaves less than 1e-9 of anything: A_l ≈ exp(−l(l+1)/2κ).
pub(super) fn band_of_blur(lambda: f64) -> usize {
    (2.0 * sharpness(lambda) * 1e9f64.ln()).sqrt().ceil() as usize + 1
}

/// A_l(κ) for l = 0 ..= band, by downward recurrence of the ratio of neighbouring Bessel functions.
pub(super) fn lobe_bands(kappa: f64, band: usize) -> Vec<f64> {
    // The recurrence forgets its start at about exp(−n²/κ) after n steps.
    let start = band + 16 + (7.0 * kappa.sqrt()) as usize;
    let mut ratios = vec![0.0; band + 1];
    let mut ratio = 0.0;
    for l in (1..=start).rev() {
        ratio = 1.0 / ((2 * l + 1) as f64 / kappa + ratio);
        if l <= band {
            ratios[l] = ratio;
        }
    }
    let mut product = 1.0;
    ratios[0] = 1.0;
    for ratio in &mut ratios {
        product *= *ratio;
        *ratio = product;
    }
    ratios
}

/// Recurrence factors of the normalised associated Legendre functions, indexed l·(band+1) + m.
struct Legendre {
    band: usize,
    factors: Vec<[f64; 2]>,
}

impl Legendre {
    fn new(band: usize) -> Self {
        let mut factors = vec![[0.0; 2]; (band + 1) * (band + 1)];
        for l in 2..=band {
            for m in 0..l - 1 {
                let (l2, m2) = ((l * l) as f64, (m * m) as f64);
                let previous = ((l - 1) * (l - 1)) as f64;
                let a = ((4.0 * l2 - 1.0) / (l2 - m2)).sqrt();
                let b = ((previous - m2) / (4.0 * previous - 1.0)).sqrt();
                factors[l * (band + 1) + m] = [a, a * b];
            }
        }
        Self { band, factors }
    }

    /// Hands P̄_lm(cos θ) to `visit(l, m, value)` for every 0 ≤ m ≤ l ≤ band, without the phase
    /// (−1)^m.
    fn for_each(&self, cos_theta: f64, sin_theta: f64, mut visit: impl FnMut(usize, usize, f64)) {
        let mut diagonal = (0.25 / PI).sqrt();
        for m in 0..=self.band {
            if m > 0 {
                diagonal *= sin_theta * ((2 * m + 1) as f64 / (2 * m) as f64).sqrt();
            }
            let (mut before, mut value) = (0.0, diagonal);
            visit(m, m, value);
            for l in m + 1..=self.band {
                let next = if l == m + 1 {
                    ((2 * m + 3) as f64).sqrt() * cos_theta * value
                } else {
                    let [a, ab] = self.factors[l * (self.band + 1) + m];
                    a * cos_theta * value - ab * before
                };
                (before, value) = (value, next);
                visit(l, m, value);
            }
        }
    }
}

/// Index of (l, m), m of either sign.
fn index(l: usize, m: isize) -> usize {
    (l * l + l).wrapping_add_signed(m)
}

/// 1 for m = 0, else √2: the factor of the real harmonics.
fn real_factor(m: usize) -> f64 {
    if m == 0 { 1.0 } else { std::f64::consts::SQRT_2 }
}

impl Harmonics {
    fn zero(band: usize) -> Self {
        Self { band, coefficients: vec![[0.0; 3]; (band + 1) * (band + 1)] }
    }

    fn add(&mut self, other: &Self) {
        for (sum, term) in self.coefficients.iter_mut().zip(&other.coefficients) {
            add_scaled(sum, 1.0, term);
        }
    }

    /// The map's coefficients up to `band`.
    pub(super) fn of_map(env: &Environment, band: usize) -> Self {
        let (width, height) = (env.width, env.height);
        let legendre = Legendre::new(band);
        // Columns are folded at φ = 0: cosines see the sum of x and its mirror image, sines the
        // difference.
        let folded = width.div_ceil(2);
        let mut cosines = vec![0.0; (band + 1) * folded];
        let mut sines = vec![0.0; (band + 1) * folded];
        for m in 0..=band {
            let half = m as f64 * PI / width as f64;
            let patch = TAU / width as f64 * if m == 0 { 1.0 } else { half.sin() / half };
            for x in 0..folded {
                let phi = ((x as f64 + 0.5) / width as f64 - 0.5) * TAU;
                let (sin, cos) = (m as f64 * phi).sin_cos();
                cosines[m * folded + x] = cos * patch;
                sines[m * folded + x] = sin * patch;
            }
        }
        let parts = MIN_INCLINATION_STEPS.div_ceil(height);
        let step = PI / (height * parts) as f64;
        let group = height.div_ceil(ROW_GROUPS);
        let groups: Vec<Self> = (0..ROW_GROUPS)
            .into_par_iter()
            .map(|g| {
                let mut sum = Self::zero(band);
                let mut waves = vec![[[0.0; 3]; 2]; band + 1];
                let mut planes = [(); 6].map(|()| vec![0.0; folded]);
                for y in (g * group).min(height)..((g + 1) * group).min(height) {
                    let row = &env.pixels[y * width..(y + 1) * width];
                    for x in 0..folded {
                        let mirror = width - 1 - x;
                        for c in 0..3 {
                            let (a, b) = (row[x][c] as f64, row[mirror][c] as f64);
                            let (a_plus_b, a_minus_b) =
                                if x == mirror { (a, 0.0) } else { (a + b, a - b) };
                            planes[c][x] = a_plus_b;
                            planes[3 + c][x] = a_minus_b;
                        }
                    }
                    for (m, wave) in waves.iter_mut().enumerate() {
                        let span = m * folded..(m + 1) * folded;
                        for c in 0..3 {
                            wave[0][c] = dot(&planes[c], &cosines[span.clone()]);
                            wave[1][c] = dot(&planes[3 + c], &sines[span.clone()]);
                        }
                    }
                    // ∫ P̄_lm sin θ dθ over the row, two Gauss nodes a part.
                    for node in 0..2 * parts {
                        let offset = if node % 2 == 0 { -0.5 } else { 0.5 } / 3f64.sqrt();
                        let theta = ((y * parts + node / 2) as f64 + 0.5 + offset) * step;
                        let (sin, cos) = theta.sin_cos();
                        legendre.for_each(cos, sin, |l, m, value| {
                            let value = value * real_factor(m) * sin * 0.5 * step;
                            for (sign, wave) in [(1, &waves[m][0]), (-1, &waves[m][1])] {
                                if m > 0 || sign > 0 {
                                    let sum = &mut sum.coefficients[index(l, sign * m as isize)];
                                    add_scaled(sum, value, wave);
                                }
                            }
                        });
                    }
                }
                sum
            })
            .collect();
        let mut sum = Self::zero(band);
        for group in &groups {
            sum.add(group);
        }
        sum
    }

    /// The lights' coefficients up to `band`, exact.
    pub(super) fn of_lights(lights: &[SrbfLight], band: usize) -> Self {
        let legendre = Legendre::new(band);
        let mut sum = Self::zero(band);
        for light in lights {
            let bands = lobe_bands(sharpness(light.lambda), band);
            let energy = light.energy();
            for_each_harmonic(&legendre, light.direction, |l, i, value| {
                add_scaled(&mut sum.coefficients[i], bands[l] * value, &energy);
            });
        }
        sum
    }

    /// The function blurred by the unit-integral lobe of bandwidth λ.
    pub(super) fn blurred(&self, lambda: f64) -> Self {
        let bands = lobe_bands(sharpness(lambda), self.band);
        let mut blurred = self.clone();
        for (l, band) in bands.iter().enumerate() {
            for coefficient in &mut blurred.coefficients[l * l..(l + 1) * (l + 1)] {
                *coefficient = coefficient.map(|v| v * band);
            }
        }
        blurred
    }

    /// ∫ |f|² dω summed over RGB.
    pub(super) fn squared_norm(&self) -> f64 {
        self.coefficients.iter().flatten().map(|v| v * v).sum()
    }

    /// ∫ |f − g|² dω summed over RGB; both must have the same band.
    pub(super) fn squared_distance(&self, other: &Self) -> f64 {
        assert_eq!(self.band, other.band);
        let pairs = self.coefficients.iter().flatten().zip(other.coefficients.iter().flatten());
        pairs.map(|(a, b)| (a - b) * (a - b)).sum()
    }

    /// ∫ f dω per channel.
    pub(super) fn integral(&self) -> [f64; 3] {
        self.coefficients[0].map(|v| v * (4.0 * PI).sqrt())
    }

    /// f at each direction.
    pub(super) fn at(&self, directions: &[DVec3]) -> Vec<[f64; 3]> {
        let legendre = Legendre::new(self.band);
        directions
            .par_iter()
            .map(|&direction| {
                let mut sum = [0.0; 3];
                for_each_harmonic(&legendre, direction, |_, i, value| {
                    add_scaled(&mut sum, value, &self.coefficients[i]);
                });
                sum
            })
            .collect()
    }
}

/// Hands Y_lm(direction) to `visit(l, index, value)` for every coefficient.
fn for_each_harmonic(
    legendre: &Legendre,
    direction: DVec3,
    mut visit: impl FnMut(usize, usize, f64),
) {
    let cos_theta = direction.y.clamp(-1.0, 1.0);
    let sin_theta = direction.x.hypot(direction.z);
    // At the poles φ is free, and every m > 0 vanishes.
    let (sin_phi, cos_phi) = if sin_theta > 0.0 {
        (direction.x / sin_theta, -direction.z / sin_theta)
    } else {
        (0.0, 1.0)
    };
    let mut waves = vec![[1.0, 0.0]; legendre.band + 1];
    for m in 1..=legendre.band {
        let [cos, sin] = waves[m - 1];
        waves[m] = [cos * cos_phi - sin * sin_phi, sin * cos_phi + cos * sin_phi];
    }
    legendre.for_each(cos_theta, sin_theta, |l, m, value| {
        let value = value * real_factor(m);
        visit(l, index(l, m as isize), value * waves[m][0]);
        if m > 0 {
            visit(l, index(l, -(m as isize)), value * waves[m][1]);
        }
    });
}

/// sum += factor · rgb.
pub(super) fn add_scaled(sum: &mut [f64; 3], factor: f64, rgb: &[f64; 3]) {
    for (sum, v) in sum.iter_mut().zip(rgb) {
        *sum += factor * v;
    }
}

/// Σ a·b in eight running sums, which the compiler turns into vectors.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a_blocks, a_rest) = a.as_chunks::<8>();
    let (b_blocks, b_rest) = b.as_chunks::<8>();
    for (a, b) in a_blocks.iter().zip(b_blocks) {
        for i in 0..8 {
            sums[i] += a[i] * b[i];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}
