// Gaussians on the line and on the circle. Twin: src/scattering/gaussian.rs.

const SQRT_PI = 1.77245385090552;
const KAPPA_MAX: f32 = 2e4;

// erf(t) and exp(−t²): Abramowitz & Stegun 7.1.26, absolute error below 3e-7 in f32.
fn erf_and_gauss(t: f32) -> vec2f {
    let gauss = exp(-t * t);
    let w = 1.0 / (1.0 + 0.3275911 * abs(t));
    let p = w * fma(fma(fma(fma(1.061405429, w, -1.453152027), w, 1.421413741), w, -0.284496736), w, 0.254829592);
    return vec2f(sign(t) * (1.0 - p * gauss), gauss);
}

// I₀(x)e^{−x}, x ≥ 0: Abramowitz & Stegun 9.8.1 and 9.8.2, relative error below 1e-6 in f32.
fn i0e(x: vec3f) -> vec3f {
    let t = min(x, vec3f(3.75)) / 3.75;
    let s = t * t;
    let near = exp(-min(x, vec3f(3.75))) * (1.0 + s * (3.5156229 + s * (3.0899424 + s * (1.2067492
        + s * (0.2659732 + s * (0.0360768 + s * 0.0045813))))));
    let far_x = max(x, vec3f(3.75));
    let w = 3.75 / far_x;
    let far = inverseSqrt(far_x) * (0.39894228 + w * (0.01328592 + w * (0.00225319 + w * (-0.00157565
        + w * (0.00916281 + w * (-0.02057706 + w * (0.02635537 + w * (-0.01647633 + w * 0.00392377))))))));
    return select(far, near, x < vec3f(3.75));
}

// κ = 2/λ².
fn concentration(lambda: f32) -> f32 {
    return 2.0 / (lambda * lambda);
}

// ∫g^c over the circle.
fn g_circular_integral(kappa: vec3f) -> vec3f {
    return TWO_PI * i0e(kappa);
}

// ∫g^c(x; 0, κ₁) g^c(δ−x; 0, κ₂) dx from sin²(δ/2), for three δ and κ₂.
fn g_circular_product(sin2: vec3f, kappa_1: f32, kappa_2: vec3f) -> vec3f {
    let sum = kappa_1 + kappa_2;
    let apart = 4.0 * sin2 * kappa_1 * kappa_2;
    let k = sqrt(max(sum * sum - apart, vec3f()));
    return TWO_PI * i0e(k) * exp(-apart / max(k + sum, vec3f(1e-20)));
}

// g·g = amplitude · g(·; mu, lambda).
struct Product {
    mu: f32,
    lambda: f32,
    amplitude: f32,
}

fn product(mu_1: f32, lambda_1: f32, mu_2: f32, lambda_2: f32) -> Product {
    let sum = lambda_1 * lambda_1 + lambda_2 * lambda_2;
    let apart = mu_1 - mu_2;
    return Product(
        mu_2 + apart * (lambda_2 * lambda_2 / sum),
        lambda_1 * lambda_2 * inverseSqrt(sum),
        exp(-apart * apart / sum),
    );
}

// ∫G dω = πλ²(1 − e^{−4/λ²}) of an SRBF.
fn srbf_integral(lambda: f32) -> f32 {
    let x = 4.0 / (lambda * lambda);
    // 1 − e^{−x} cancels for a wide light; its series does not.
    let series = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x / 120.0)));
    let share = select((1.0 - exp(-x)) / x, series, x < 0.2);
    return 4.0 * PI * share;
}
