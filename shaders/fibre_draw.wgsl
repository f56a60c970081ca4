// Directions that light comes to a fibre from, drawn by what the fibre sends of it to one viewer, for fast.wgsl. Twin:
// src/scattering/draw.rs. marschner.wgsl and deon.wgsl define draw_inclination, draw_cos_path and draw_blur.

// A direction, and by what radiance from there is multiplied; 0 of a draw that carries no light.
struct Drawn {
    theta_i: f32,
    phi_i: f32,     // counted as φ_o is
    weight: vec3f,
}

// Of R, TT, TRT, TRRT and all longer paths: energy compensation and tint; and the energy of the last.
struct Lobes {
    factors: array<vec3f, 5>,
    rest: vec3f,
}

// `factors` as fast.wgsl's Strand has them.
fn draw_lobes(fibre: Fibre, factors: Modes, theta_o: f32) -> Lobes {
    var lobes: Lobes;
    lobes.factors = array(factors.r, factors.tt, factors.trt, factors.longer, factors.longer);
    if has_mode(3u) {
        lobes.rest = rest_energy(fibre, max(cos(theta_o), 0.0));
    }
    return lobes;
}

// By four uniform numbers in [0, 1), for the viewer at θ_o and φ_o, counted from the minor axis of an eccentric fibre.
fn draw(fibre: Fibre, lobes: Lobes, theta_o: f32, phi_o: f32, u: vec4f) -> Drawn {
    // The offset first, then a lobe by what it has there of light at θ_i = −θ_o.
    let h = clamp(2.0 * u.w - 1.0, -1.0, 1.0);
    let cos_o = max(cos(theta_o), 0.0);
    var means: array<f32, 5>;
    var total = 0.0;
    for (var t = 0u; t < 4u; t++) {
        if has_mode(t) {
            let own = path_attenuation(fibre, t, h, mean_eta(fibre, t).eta, cos_o);
            means[t] = max(dot(lobes.factors[t], own) / 3.0, 0.0);
            total += means[t];
        }
    }
    means[4] = max(dot(lobes.factors[4], lobes.rest) / 3.0, 0.0);
    total += means[4];
    var left = u.x * total;
    var p = 0u;
    for (; p < 4u && left >= means[p]; p++) {
        left -= means[p];
    }
    let share = means[p];
    var drawn = Drawn(0.0, 0.0, vec3f());
    for (var there = share > 0.0; there; there = false) {
        let t = min(p, 3u);
        let along = draw_inclination(fibre, t, theta_o, u.yz);
        let cos_path = draw_cos_path(along.x, theta_o);
        drawn.theta_i = along.x;
        drawn.phi_i = wrap(phi_o + TWO_PI * u.w);
        var own = vec3f();
        if (p == 4u) {
            own = rest_energy(fibre, cos_path);
        } else {
            // What the choice leaves of its number is as even as the number was.
            let blur = draw_blur(fibre, t) * normal_quantile(left / share);
            var eta = mean_eta(fibre, t).eta;
            if (ECCENTRIC && t == 2u) {
                let phi = exit_azimuth(t, h, eta, cos_path) + blur;
                eta = max(fibre.eta_star.x + fibre.eta_star.y * cos(phi + 2.0 * phi_o), 1.0);
            }
            drawn.phi_i = wrap(phi_o + exit_azimuth(t, h, eta, cos_path) + blur);
            own = path_attenuation(fibre, t, h, eta, cos_path);
        }
        drawn.weight = max(along.y * total / share * lobes.factors[p] * own, vec3f());
    }
    return drawn;
}

// √(η²−sin²θ) of the path's cosθ.
fn slant(eta: f32, cos_path: f32) -> f32 {
    return sqrt(max(eta * eta - 1.0 + cos_path * cos_path, 1e-12));
}

// Φ_t(h), not wrapped.
fn exit_azimuth(t: u32, h: f32, eta: f32, cos_path: f32) -> f32 {
    let h_t = h * min(cos_path / slant(eta, cos_path), 1.0);
    return 2.0 * f32(t) * asin_accurate(h_t) - 2.0 * asin_accurate(h) + f32(t) * PI;
}

// A_t(h), RGB.
fn path_attenuation(fibre: Fibre, t: u32, h: f32, eta: f32, cos_path: f32) -> vec3f {
    let f = fresnel(cos_path * sqrt(max(1.0 - h * h, 0.0)), eta);
    let s = slant(eta, cos_path);
    let h_t = h * min(cos_path / s, 1.0);
    let chord = 2.0 * eta / s * sqrt(max(1.0 - h_t * h_t, 0.0));
    var surface = 1.0;
    for (var k = 1u; k < t; k++) {
        surface *= f;
    }
    let inside = surface * square(1.0 - f) * exp(-f32(t) * chord * fibre.sigma_a);
    return select(inside, vec3f(f), t == 0u);
}

// Reflectance of unpolarised light at a smooth surface, by its cosine of incidence.
fn fresnel(cosine: f32, eta: f32) -> f32 {
    let g = slant(eta, cosine);
    let s = (cosine - g) / (cosine + g);
    let p = (eta * eta * cosine - g) / (eta * eta * cosine + g);
    return 0.5 * (s * s + p * p);
}

// x below which lies the share u of a normal distribution of σ = 1, to 4e-3: Winitzki 2008.
fn normal_quantile(u: f32) -> f32 {
    const A = 0.147;
    let x = clamp(2.0 * u - 1.0, -0.9999999, 0.9999999);
    let log_ = log(max((1.0 - x) * (1.0 + x), 1e-7));
    let b = 2.0 / (PI * A) + 0.5 * log_;
    return sign(x) * sqrt(2.0 * max(sqrt(max(b * b - log_ / A, 0.0)) - b, 0.0));
}
