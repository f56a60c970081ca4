//! Gaussians on the line and on the circle (Xu 2011, Table 1 and Appendix).
//!
//! Every Gaussian here has a **bandwidth** λ = √2·(standard deviation). A circular Gaussian is named
//! by its concentration κ = 2/λ², which stays finite where the paper's λ′ = λ/√(cosθ_i cosθ_j)
//! diverges.
//!
//! Where we deviate: the paper's ∫g^c ≈ √π λ is +9.4 % off at λ = 1 and +17 % at 1.5, so we use
//! 2π I₀e(κ), which is exact; and its product of two circular Gaussians by √(2π/K) diverges at the
//! antipode (28 times too much at |κ₁−κ₂| = 1e-4), so we use 2π I₀e(K), exact too.

use std::f64::consts::{PI, TAU};

/// Below this an exponential counts as nothing.
const UNDERFLOW: f64 = -700.0;

/// g(x; μ, λ) = exp(−(x−μ)²/λ²).
pub fn g(x: f64, mu: f64, lambda: f64) -> f64 {
    (-((x - mu) / lambda).powi(2)).exp()
}

/// g^u = g/(√π λ), whose integral over the line is 1.
pub fn g_unit(x: f64, mu: f64, lambda: f64) -> f64 {
    g(x, mu, lambda) / (PI.sqrt() * lambda)
}

/// The concentration κ = 2/λ² of a circular Gaussian of bandwidth λ.
pub fn concentration(lambda: f64) -> f64 {
    2.0 / (lambda * lambda)
}

/// g^c(x; 0, λ) = exp(κ(cos x − 1)).
pub fn g_circular(x: f64, kappa: f64) -> f64 {
    (-2.0 * kappa * (0.5 * x).sin().powi(2)).exp()
}

/// ∫_{−π}^{π} g^c = 2π I₀e(κ).
pub fn g_circular_integral(kappa: f64) -> f64 {
    TAU * i0e(kappa)
}

/// ∫_{−π}^{π} g^c(x; 0, κ₁) g^c(δ−x; 0, κ₂) dx = 2π I₀e(K) exp(K−κ₁−κ₂), K = |κ₁ + κ₂e^{iδ}|.
pub fn g_circular_product(delta: f64, kappa_1: f64, kappa_2: f64) -> f64 {
    let sum = kappa_1 + kappa_2;
    if sum == 0.0 {
        return TAU;
    }
    let apart = 4.0 * kappa_1 * kappa_2 * (0.5 * delta).sin().powi(2);
    let k = (sum * sum - apart).max(0.0).sqrt();
    // K − κ₁ − κ₂ without the cancellation.
    let exponent = -apart / (k + sum);
    if exponent < UNDERFLOW { 0.0 } else { TAU * i0e(k) * exponent.exp() }
}

/// The κ of the circular Gaussian whose integral is `integral` in (0, 2π): the inverse of
/// [`g_circular_integral`], kept within [`KAPPA_MIN`, `KAPPA_MAX`].
pub fn concentration_of_integral(integral: f64) -> f64 {
    // 1/I₀e² − 1 grows from 2κ to 2πκ: nearly a straight line, which Newton's method likes.
    let line = |kappa: f64| i0e(kappa).powi(-2) - 1.0;
    let target = (TAU / integral).powi(2) - 1.0;
    if target >= line(KAPPA_MAX) {
        return KAPPA_MAX;
    }
    if target <= line(KAPPA_MIN) {
        return KAPPA_MIN;
    }
    let (mut low, mut high) = (target / TAU, 0.5 * target);
    let (mut at_low, mut at_high) = (line(low) - target, line(high) - target);
    for _ in 0..30 {
        if (high - low).abs() <= 1e-12 * high || at_high == at_low {
            break;
        }
        let next = (high - at_high * (high - low) / (at_high - at_low)).max(0.5 * KAPPA_MIN);
        (low, at_low) = (high, at_high);
        (high, at_high) = (next, line(next) - target);
    }
    high
}

/// A fitted lobe is kept between bandwidths 14 (a lobe that covers the circle evenly) …
pub const KAPPA_MIN: f64 = 0.01;
/// … and 0.01 rad (narrower than any light or any real fibre shows).
pub const KAPPA_MAX: f64 = 2e4;

/// The product g(x; μ₁, λ₁)·g(x; μ₂, λ₂) = amplitude · g(x; mu, lambda).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Product {
    pub mu: f64,
    pub lambda: f64,
    pub amplitude: f64,
}

/// The product of two Gaussians on the line, which is one (Xu 2011 §4.2.1).
pub fn product(mu_1: f64, lambda_1: f64, mu_2: f64, lambda_2: f64) -> Product {
    let sum = lambda_1 * lambda_1 + lambda_2 * lambda_2;
    let apart = mu_1 - mu_2;
    Product {
        mu: mu_2 + apart * (lambda_2 * lambda_2 / sum),
        lambda: lambda_1 * lambda_2 / sum.sqrt(),
        amplitude: (-apart * apart / sum).exp(),
    }
}

/// The integral ∫G dω = πλ²(1 − e^{−4/λ²}) of an SRBF over the sphere.
pub fn srbf_integral(lambda: f64) -> f64 {
    -PI * lambda * lambda * (-4.0 / (lambda * lambda)).exp_m1()
}

/// I₀(x)e^{−x} for x ≥ 0, relative error below 1e-14: the power series, whose terms are all
/// positive, then the asymptotic one, whose smallest term lies below 1e-17 from 20 on.
pub fn i0e(x: f64) -> f64 {
    let (mut term, mut sum) = (1.0, 1.0);
    if x < 20.0 {
        let quarter = 0.25 * x * x;
        for k in 1..80 {
            term *= quarter / (k * k) as f64;
            sum += term;
            if term < 1e-17 * sum {
                break;
            }
        }
        return sum * (-x).exp();
    }
    for k in 1..40 {
        let odd = (2 * k - 1) as f64;
        let next = term * odd * odd / (8.0 * k as f64 * x);
        if next > term || next < 1e-17 {
            break;
        }
        term = next;
        sum += term;
    }
    sum / (TAU * x).sqrt()
}

/// I_k/I_{k−1}(κ) for k from 1 to `count` − 1, with 1 at 0: the continued fraction from its `begin`th term, which is to
/// lie so far up that where it began is forgotten.
pub fn bessel_steps(kappa: f64, count: usize, begin: usize) -> Vec<f64> {
    let mut steps = vec![1.0; count];
    let mut step = 0.0;
    for k in (1..=begin).rev() {
        step = kappa / (2.0 * k as f64 + kappa * step);
        if let Some(kept) = steps.get_mut(k) {
            *kept = step;
        }
    }
    steps
}

/// The error function, absolute error below 1e-15: its series with positive terms, then its
/// continued fraction.
pub fn erf(x: f64) -> f64 {
    let a = x.abs();
    let gauss = (-a * a).exp();
    let value = if a < 2.5 {
        let (mut term, mut sum) = (a, a);
        for k in 1..80 {
            term *= 2.0 * a * a / (2 * k + 1) as f64;
            sum += term;
            if term < 1e-17 * sum {
                break;
            }
        }
        2.0 / PI.sqrt() * gauss * sum
    } else if a < 6.0 {
        let tail = (1..60).rev().fold(a, |tail, k| a + 0.5 * k as f64 / tail);
        1.0 - gauss / (PI.sqrt() * tail)
    } else {
        1.0
    };
    value.copysign(x)
}
