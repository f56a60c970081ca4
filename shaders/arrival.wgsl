// What transport brings to a point, as a method takes it.

// Means over the rays of a light: with n the strands that a ray crosses, n′ those behind the point, V what the head leaves.
// Twin: src/transport/mod.rs.
struct TransmittanceMoments {
    t1: f32,            // of V [n = 0]: T̃
    t_quarter: f32,     // of V 0.75^n
    visibility: f32,    // of V
    back: f32,          // of 0.5^n′
}

// From words of transmittance.wgsl; the second counts for FORWARD alone.
fn transmittance_of(counts: u32, means: u32) -> TransmittanceMoments {
    let t1 = f32(counts & 0xffffu) / f32(max(counts >> 16u, 1u));
    if FORWARD {
        return TransmittanceMoments(t1, max(t1, f32((means >> 8u) & 4095u) / 4095.0), f32(means & 255u) / 255.0,
            f32(means >> 20u) / 4095.0);
    }
    return TransmittanceMoments(t1, t1, 1.0, 1.0);
}

// Of light that crosses strands on its way: the strands that stand for its rays, 1 or more.
fn strands_crossed(m: TransmittanceMoments) -> f32 {
    let crossing = max(m.visibility - m.t1, 1e-6);
    return max(log(clamp((m.t_quarter - m.t1) / crossing, 1e-6, 0.75)) / log(0.75), 1.0);
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
    known: TransmittanceMoments,
    field: vec3f,       // radiance along an ordinate that other strands have scattered
}
