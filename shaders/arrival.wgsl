// What transport brings to a point, as a method takes it.

// The means of V e^(−sτ) over a light, at any s: ln(mean/open) is quadratic in s through its values at 0, ¼ and 1.
struct Depth {
    open: f32,          // at s = 0
    slope: vec2f,       // ln(mean/open) = slope.x s + slope.y s²
}

// From a packed transport::Reach.
fn depth_of(bits: u32) -> Depth {
    let direct = square(f32(bits & 1023u) / 1023.0);
    let quarter = square(f32((bits >> 10u) & 255u) / 255.0);
    let open = square(f32((bits >> 18u) & 63u) / 63.0);
    let ln_quarter = log(max(quarter, 1e-6) / max(open, 1e-6));
    let ln_direct = log(max(direct, 2e-7) / max(open, 1e-6));
    let p = (16.0 * ln_quarter - ln_direct) / 3.0;
    return Depth(open, vec2f(p, ln_direct - p));
}

fn through(depth: Depth, s: vec3f) -> vec3f {
    let ln_share = s * (depth.slope.x + depth.slope.y * s);
    return depth.open * exp(min(ln_share, vec3f()));
}

// Mean number of forward scatterings of what comes through at s = 1−ā_f, given that there was one.
fn scatterings(depth: Depth, a_f: vec3f) -> vec3f {
    let mean = max(-(depth.slope.x + 2.0 * depth.slope.y * (1.0 - a_f)) * a_f, vec3f(1e-4));
    return mean / (1.0 - exp(-mean));
}

// What a light brings to a point.
struct Arrival {
    theta_j: f32,
    phi: f32,           // φ_o − φ_j in [−π, π]
    cos_sum: f32,       // cos(φ_o + φ_j)
    lambda: f32,
    energy: f32,        // E_j = ∫G_j dω
    rgb: vec3f,         // L_j
    least: f32,         // radiance that must arrive to matter
    direct: f32,        // T̃
    beyond: f32,        // mean of e^(−τ′/2), τ′ behind the point
    depth: Depth,
    field: vec3f,       // radiance along an ordinate that other strands have scattered
}

fn square(x: f32) -> f32 {
    return x * x;
}
