//! M_p of d'Eon 2011, Eq 7: the density over θ_i of light that a rough fibre spreads about the specular
//! cone −θ_o, and samples of it (d'Eon et al. 2013; pbrt-v4 §9.9.3, §9.9.7).
//!
//! Where we deviate from the print: Eq 7 multiplies csch, exp and I₀, which overflow from v = 0.0014 down,
//! and Eq 15's eleven terms of I₀ are −35 % off at x = 20. With the scaled I₀e and differences of sines,
//!
//! > M_p = I₀e(cosθ_i cosθ_o/v) exp(−|d|²/2v) / (v (1−e^{−2/v})),  d = (sinθ_i + sinθ_o, cosθ_i − cosθ_o)
//!
//! holds for every v in [1e-6, 100]; its integral is 1 within 3e-9 (measured), which is the error of the
//! fit of I₀e here. That fit takes a fifth of the time of `gaussian::i0e`.

use std::f64::consts::TAU;

use super::model::Direction;

/// Less than any fibre's: the standard deviation of θ_i is √v.
const VARIANCE_MIN: f64 = 1e-9;

/// Sine and cosine of an inclination in [−π/2, π/2].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inclination {
    pub sin: f64,
    /// ≥ 0.
    pub cos: f64,
}

impl Inclination {
    /// Of an angle in radians.
    pub fn new(theta: f64) -> Self {
        let (sin, cos) = theta.sin_cos();
        Self { sin, cos: cos.abs() }
    }

    /// This inclination less `other`'s angle. Past the pole it comes down on the far side.
    pub fn less(&self, other: &Self) -> Self {
        Self {
            sin: self.sin * other.cos - self.cos * other.sin,
            cos: (self.cos * other.cos + self.sin * other.sin).abs(),
        }
    }

    /// The direction of this inclination at azimuth `phi` in [−π, π].
    pub fn direction(&self, phi: f64) -> Direction {
        Direction { sin_theta: self.sin, cos_theta: self.cos, phi }
    }
}

impl From<&Direction> for Inclination {
    fn from(direction: &Direction) -> Self {
        Self { sin: direction.sin_theta, cos: direction.cos_theta }
    }
}

/// M_p of one roughness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Longitudinal {
    v: f64,
    inverse_v: f64,
    /// 1 − e^{−2/v}.
    inside: f64,
    /// 1/(v (1−e^{−2/v})).
    scale: f64,
}

impl Longitudinal {
    /// Of roughness variance `v`, radians² of θ_i.
    pub fn new(v: f64) -> Self {
        let v = v.max(VARIANCE_MIN);
        let inside = -(-2.0 / v).exp_m1();
        Self { v, inverse_v: v.recip(), inside, scale: (v * inside).recip() }
    }

    /// M_p(θ_i; θ_o), symmetric: ∫M_p cosθ_i dθ_i = 1.
    pub fn density(&self, i: &Inclination, o: &Inclination) -> f64 {
        let apart = (i.sin + o.sin).powi(2) + (i.cos - o.cos).powi(2);
        let (factor, exponent) = scaled_i0(i.cos * o.cos * self.inverse_v);
        self.scale * factor * (-0.5 * apart * self.inverse_v - exponent).exp()
    }

    /// The θ_i drawn by two uniform numbers in [0, 1): a spherical Gaussian about the cone −θ_o.
    pub fn sample(&self, o: &Inclination, u: [f64; 2]) -> Inclination {
        // 1 − cosine of the angle from the Gaussian's axis.
        let t = (-self.v * (-u[0] * self.inside).ln_1p()).clamp(0.0, 2.0);
        let (along, across) = (1.0 - t, (t * (2.0 - t)).sqrt());
        let (turned, aside) = ((TAU * u[1]).cos(), (TAU * u[1]).sin());
        // The axis is (−sinθ_o, cosθ_o, 0).
        Inclination {
            sin: (across * turned * o.cos - along * o.sin).clamp(-1.0, 1.0),
            cos: (along * o.cos + across * turned * o.sin).hypot(across * aside),
        }
    }
}

/// (a, b) with I₀(x) e^{−x} = a e^{−b}, x ≥ 0: relative error below 5e-9 (measured). Polynomials of least
/// relative error, in x² below 6 and in 1/x above.
fn scaled_i0(x: f64) -> (f64, f64) {
    const SMALL: [f64; 9] = [
        1.000_000_000_248_782_3,
        2.499_999_874_973_595_5e-1,
        1.562_501_898_742_832e-2,
        4.340_191_118_551_324e-4,
        6.783_425_330_150_56e-6,
        6.763_624_820_269_669e-8,
        4.812_815_170_831_832e-10,
        2.076_616_560_609_307_6e-12,
        1.458_811_719_432_841e-14,
    ];
    const LARGE: [f64; 9] = [
        3.989_422_803_558_675_4e-1,
        4.986_807_582_686_303e-2,
        2.798_987_609_036_808e-2,
        3.336_456_751_538_52e-2,
        -8.622_442_121_700_798e-2,
        2.267_338_728_571_231_4,
        -1.934_219_676_518_719_7e1,
        8.976_254_072_441_164e1,
        -1.529_298_340_818_545_8e2,
    ];
    if x < 6.0 {
        (polynomial(&SMALL, x * x), x)
    } else {
        let inverse = x.recip();
        (polynomial(&LARGE, inverse) * inverse.sqrt(), 0.0)
    }
}

/// Σ c_k x^k by Estrin's scheme: half the latency of Horner's.
fn polynomial(c: &[f64; 9], x: f64) -> f64 {
    let x2 = x * x;
    let x4 = x2 * x2;
    let low = (c[0] + c[1] * x) + (c[2] + c[3] * x) * x2;
    let high = (c[4] + c[5] * x) + (c[6] + c[7] * x) * x2;
    low + high * x4 + c[8] * x4 * x4
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use crate::scattering::{gaussian::i0e, quadrature::GaussLegendre};

    #[test]
    fn scaled_i0_is_i0e() {
        let mut worst: f64 = 0.0;
        for k in -400..800 {
            let x = (f64::from(k) * 0.02).exp();
            let (a, b) = scaled_i0(x);
            worst = worst.max((a * (-b).exp() / i0e(x) - 1.0).abs());
        }
        println!("I₀e: relative error ≤ {worst:.1e}");
        assert!(worst < 5e-9);
        assert_eq!(scaled_i0(0.0).1, 0.0);
    }

    #[test]
    fn m_p_integrates_to_one() {
        let rule = GaussLegendre::new(16);
        let mut worst: f64 = 0.0;
        for v in [1e-6, 1e-4, 1e-3, 0.02, 0.1, 0.3, 1.0, 10.0, 100.0] {
            let m = Longitudinal::new(v);
            for theta_o in [0.0, 0.3, -1.2, 1.5, FRAC_PI_2] {
                let o = Inclination::new(theta_o);
                // Panels of half a standard deviation near the cone, where a narrow lobe is.
                let reach = (14.0 * f64::sqrt(v)).min(4.0);
                let low = (-theta_o - reach).max(-FRAC_PI_2);
                let high = (-theta_o + reach).min(FRAC_PI_2);
                let step = (high - low) / 60.0;
                let total: f64 = (0..60)
                    .map(|k| low + step * f64::from(k))
                    .map(|a| {
                        rule.integrate(a, a + step, |theta| {
                            m.density(&Inclination::new(theta), &o) * theta.cos()
                        })
                    })
                    .sum();
                worst = worst.max((total - 1.0).abs());
                assert!((total - 1.0).abs() < 1e-6, "v {v} θ_o {theta_o}: {total}");
            }
        }
        println!("|∫M_p cosθ dθ − 1| ≤ {worst:.1e}");
    }

    /// Means of sinθ_i and sin²θ_i over an even grid of numbers, against quadrature.
    #[test]
    fn samples_have_the_moments_of_the_density() {
        let rule = GaussLegendre::new(200);
        for v in [1e-6, 0.01, 0.5, 20.0] {
            let m = Longitudinal::new(v);
            for theta_o in [0.2, -1.3, FRAC_PI_2] {
                let o = Inclination::new(theta_o);
                let n = 500;
                let mut drawn = [0.0; 2];
                for (j, k) in (0..n).flat_map(|j| (0..n).map(move |k| (j, k))) {
                    let u = [j, k].map(|x| (f64::from(x) + 0.5) / f64::from(n));
                    let i = m.sample(&o, u);
                    assert!((i.sin.hypot(i.cos) - 1.0).abs() < 1e-12 && i.cos >= 0.0);
                    drawn[0] += i.sin / f64::from(n * n);
                    drawn[1] += (i.sin + o.sin).powi(2) / f64::from(n * n);
                }
                let reach = (9.0 * v.sqrt()).min(4.0);
                let low = (-theta_o - reach).max(-FRAC_PI_2);
                let high = (-theta_o + reach).min(FRAC_PI_2);
                let moment = |f: &dyn Fn(f64) -> f64, v: f64| {
                    let m = Longitudinal::new(v);
                    rule.integrate(low, high, |theta| {
                        m.density(&Inclination::new(theta), &o) * theta.cos() * f(theta.sin())
                    })
                };
                let first = moment(&|s| s, v);
                let second = |v| moment(&|s| (s + o.sin).powi(2), v);
                println!(
                    "v {v} θ_o {theta_o:.2}: mean {:.1e}, spread {:.1e} off",
                    drawn[0] - first,
                    drawn[1] / second(v) - 1.0
                );
                let scale = v.sqrt().min(1.0);
                assert!((drawn[0] - first).abs() < 2e-3 * scale);
                assert!((drawn[1] / second(v) - 1.0).abs() < 0.01);
                assert!((drawn[1] / second(1.1 * v) - 1.0).abs() > 0.01 || v > 1.0);
            }
        }
    }
}
