// Angles from vectors without the built-in asin and atan2, whose accuracy WGSL leaves open.

const PI = 3.14159265358979;
const HALF_PI = 1.57079632679490;
const TWO_PI = 6.28318530717959;
const SQRT_HALF = 0.70710678118655;

// asin(x), x in [−1, 1]: Abramowitz & Stegun 4.4.46 in f32, absolute error below 4e-7.
fn asin_accurate(x: f32) -> f32 {
    let a = min(abs(x), 1.0);
    let p = fma(fma(fma(fma(fma(fma(fma(-0.0012624911, a, 0.0066700901), a, -0.0170881256), a, 0.0308918810), a,
        -0.0501743046), a, 0.0889789874), a, -0.2145988016), a, 1.5707963050);
    return sign(x) * (HALF_PI - sqrt(1.0 - a) * p);
}

// atan2(y, x) in [−π, π], 0 for the null vector: Abramowitz & Stegun 4.4.49 in f32, absolute error
// below 4e-7.
fn atan2_accurate(y: f32, x: f32) -> f32 {
    let ax = abs(x);
    let ay = abs(y);
    let t = min(ax, ay) / max(max(ax, ay), 1e-30);
    let s = t * t;
    let p = fma(fma(fma(fma(fma(fma(fma(fma(0.0028662257, s, -0.0161657367), s, 0.0429096138), s, -0.0752896400), s,
        0.1065626393), s, -0.1420889944), s, 0.1999355085), s, -0.3333314528), s, 1.0);
    let octant = t * p;
    let quadrant = select(octant, HALF_PI - octant, ay > ax);
    let half_plane = select(quadrant, PI - quadrant, x < 0.0);
    return select(half_plane, -half_plane, y < 0.0);
}

// cos x and sin x, |x| ≤ π/2, absolute error below 2e-7: least squares in x². They need no range reduction.
fn cos_near(x: f32) -> f32 {
    let z = x * x;
    return 1.0 - z * fma(fma(fma(fma(2.60734801e-7, z, -2.47616557e-5), z, 1.38883984e-3), z, -4.16666403e-2), z, 0.5);
}

fn sin_near(x: f32) -> f32 {
    let z = x * x;
    return x * fma(fma(fma(fma(2.60516628e-6, z, -1.98090464e-4), z, 8.33305062e-3), z, -1.66666580e-1), z, 1.0);
}

// φ wrapped to [−π, π].
fn wrap(phi: f32) -> f32 {
    return phi - 2.0 * PI * round(phi / (2.0 * PI));
}

// A unit normal of unit u (Duff et al. 2017). Twin: `normals` of src/hair/curve.rs.
fn any_normal(u: vec3f) -> vec3f {
    let s = select(-1.0, 1.0, u.z >= 0.0);
    let a = -1.0 / (s + u.z);
    return vec3f(1.0 + s * u.x * u.x * a, s * u.x * u.y * a, -s * u.x);
}

fn square(x: f32) -> f32 {
    return x * x;
}
