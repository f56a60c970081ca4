// The paper's method. Twin: src/scattering/xu.rs, which states units and deviations.
// Way of the data: a light's lobe over θ_i times M_t is one Gaussian (product); walk_* places its
// nodes; at each node the inner integral over φ is closed: R from circle_table, TT and TRT from the
// fits in fibre_table, all of 𝒩^G from its table there.

const AMPLITUDE_MIN: f32 = 1e-3;

// ∫G_j S_t cosθ_i dω, Eq 11. φ = φ_o−φ_j in [−π, π]; cos_sum = cos(φ_o+φ_j).
fn single_scattering(fibre: Fibre, theta_o: f32, theta_j: f32, phi: f32, cos_sum: f32, lambda_j: f32) -> Modes {
    var modes = Modes();
    let kappa_j = concentration(lambda_j) * max(cos(theta_j), 0.0);
    let column = circle_column(phi);

    let r = mode_lobe(theta_o, theta_j, lambda_j, fibre.alpha.x, fibre.lambda.x);
    if r.amplitude >= AMPLITUDE_MIN {
        var walk = walk_begin(r.mu, r.lambda, NODES);
        var sum = 0.0;
        for (var k = 0u; k + 1u < NODES; k++) {
            let node = walk_next(&walk, k);
            let kappa = kappa_j * max(cos(node.theta), 0.0);
            let c = r_coefficients(fibre.eta, 0.5 * (theta_o - node.theta));
            let inner = circle_reflection(kappa, column, c) * g_circular_integral(vec3f(kappa)).x;
            sum += node.weight * projection(node.theta, theta_o) * inner;
        }
        modes.r = vec3f(sum * lobe_scale(r, fibre.lambda.x));
    }

    let tt = mode_lobe(theta_o, theta_j, lambda_j, fibre.alpha.y, fibre.lambda.y);
    if tt.amplitude >= AMPLITUDE_MIN {
        var walk = walk_begin(tt.mu, tt.lambda, NODES);
        var sum = vec3f();
        let cos2 = vec3f(column.cos_half * column.cos_half);
        for (var k = 0u; k + 1u < NODES; k++) {
            let node = walk_next(&walk, k);
            let kappa = kappa_j * max(cos(node.theta), 0.0);
            let fit = fit_tt(0.5 * (theta_o - node.theta));
            let inner = fit.b * g_circular_product(cos2, kappa, fit.kappa);
            sum += node.weight * projection(node.theta, theta_o) * inner;
        }
        modes.tt = sum * lobe_scale(tt, fibre.lambda.y);
    }

    let trt = mode_lobe(theta_o, theta_j, lambda_j, fibre.alpha.z, fibre.lambda.z);
    if trt.amplitude >= AMPLITUDE_MIN {
        var walk = walk_begin(trt.mu, trt.lambda, NODES);
        var sum = vec3f();
        for (var k = 0u; k + 1u < NODES; k++) {
            let node = walk_next(&walk, k);
            let kappa = kappa_j * max(cos(node.theta), 0.0);
            var mean_cos = 0.0;
            if fibre.eta_layers > 1u {
                mean_cos = cos_sum * circle_mean_cosine(kappa);
            }
            let fit = fit_trt(fibre, 0.5 * (theta_o - node.theta), mean_cos);
            let half_sine = sin(0.5 * (phi + vec3f(-fit.phi_star, fit.phi_star, 0.0)));
            let lobes = g_circular_product(half_sine * half_sine, kappa, fit.kappa);
            let inner = fit.b_1 * (lobes.x + lobes.y) + fit.b_2 * lobes.z;
            sum += node.weight * projection(node.theta, theta_o) * inner;
        }
        modes.trt = sum * lobe_scale(trt, fibre.lambda.z);
    }
    return modes;
}

// 𝓜_t^G, Eq 27 and 28, per unit of forward-scattered radiance integrated over direction (for an SRBF
// multiply by srbf_integral). σ_f is a bandwidth of θ.
fn global_scattering(fibre: Fibre, theta_o: f32, theta_j: f32, phi: f32, sigma_f: f32) -> Modes {
    var modes = Modes();
    let spread = min(sigma_f, SPREAD_MAX);
    let scale = 1.0 / (SQRT_PI * spread * spread_normaliser(theta_j, spread));
    let column = row_of(abs(phi) / PI, GLOBAL_COLUMNS);

    let r = mode_lobe(theta_o, theta_j, spread, fibre.alpha.x, fibre.lambda.x);
    if r.amplitude >= AMPLITUDE_MIN {
        var walk = walk_begin(r.mu, r.lambda, NODES);
        var sum = 0.0;
        for (var k = 0u; k + 1u < NODES; k++) {
            let node = walk_next(&walk, k);
            let inner = global_r_tt(0.5 * (theta_o - node.theta), column).x;
            sum += node.weight * projection(node.theta, theta_o) * inner;
        }
        modes.r = vec3f(scale * sum * lobe_scale(r, fibre.lambda.x));
    }

    let tt = mode_lobe(theta_o, theta_j, spread, fibre.alpha.y, fibre.lambda.y);
    if tt.amplitude >= AMPLITUDE_MIN {
        var walk = walk_begin(tt.mu, tt.lambda, NODES);
        var sum = vec3f();
        for (var k = 0u; k + 1u < NODES; k++) {
            let node = walk_next(&walk, k);
            let inner = global_r_tt(0.5 * (theta_o - node.theta), column).yzw;
            sum += node.weight * projection(node.theta, theta_o) * inner;
        }
        modes.tt = scale * sum * lobe_scale(tt, fibre.lambda.y);
    }

    let trt = mode_lobe(theta_o, theta_j, spread, fibre.alpha.z, fibre.lambda.z);
    if trt.amplitude >= AMPLITUDE_MIN {
        var walk = walk_begin(trt.mu, trt.lambda, NODES);
        var sum = vec3f();
        for (var k = 0u; k + 1u < NODES; k++) {
            let node = walk_next(&walk, k);
            let inner = global_trt(0.5 * (theta_o - node.theta), column);
            sum += node.weight * projection(node.theta, theta_o) * inner;
        }
        modes.trt = scale * sum * lobe_scale(trt, fibre.lambda.z);
    }
    return modes;
}

// ∫G_j S_back cosθ_i dω: light that reached this strand directly and comes back from those behind.
fn local_scattering_direct(fibre: Fibre, theta_o: f32, theta_j: f32, phi: f32, lambda_j: f32) -> vec3f {
    let lobe = back_lobe(theta_o, theta_j, lambda_j);
    if lobe.gaussian.amplitude < AMPLITUDE_MIN {
        return vec3f();
    }
    let kappa_j = concentration(lambda_j) * max(cos(theta_j), 0.0);
    let column = circle_column(phi);
    var walk = walk_begin(lobe.gaussian.mu, lobe.gaussian.lambda, NODES);
    var sum = vec3f();
    for (var k = 0u; k + 1u < NODES; k++) {
        let node = walk_next(&walk, k);
        let kappa = kappa_j * max(cos(node.theta), 0.0);
        let azimuth = g_circular_integral(vec3f(kappa)).x * circle_half(kappa, column);
        sum += azimuth * back_node(node, theta_o);
    }
    return sum / PI * lobe_scale(lobe.gaussian, lobe.sigma_b);
}

// 𝓜^L, Eq 29: the same for light that came forward through other strands; units as in
// global_scattering.
fn local_scattering_forward(fibre: Fibre, theta_o: f32, theta_j: f32, phi: f32, sigma_f: f32) -> vec3f {
    let spread = min(sigma_f, SPREAD_MAX);
    let lobe = back_lobe(theta_o, theta_j, spread);
    if lobe.gaussian.amplitude < AMPLITUDE_MIN {
        return vec3f();
    }
    var walk = walk_begin(lobe.gaussian.mu, lobe.gaussian.lambda, NODES);
    var sum = vec3f();
    for (var k = 0u; k + 1u < NODES; k++) {
        let node = walk_next(&walk, k);
        sum += back_node(node, theta_o);
    }
    let azimuth = (PI - abs(phi)) / (PI * PI);
    let scale = azimuth / (SQRT_PI * spread * spread_normaliser(theta_j, spread));
    return scale * sum * lobe_scale(lobe.gaussian, lobe.sigma_b);
}

// The light's Gaussian of bandwidth `width` times M_t's.
fn mode_lobe(theta_o: f32, theta_j: f32, width: f32, alpha: f32, lambda_m: f32) -> Product {
    return product(theta_j, width, 2.0 * alpha - theta_o, lambda_m);
}

// The factor of the walk's sum: the product's amplitude over the area of the unit Gaussian in it.
fn lobe_scale(lobe: Product, lambda_m: f32) -> f32 {
    return lobe.amplitude / (SQRT_PI * lambda_m);
}

// The light's Gaussian times S_back's, with Δ̄_b and σ̄_b averaged over the light (Eq 31).
struct BackLobe {
    gaussian: Product,
    sigma_b: f32,
}

fn back_lobe(theta_o: f32, theta_j: f32, width: f32) -> BackLobe {
    let low = average_back_lobe(0.5 * (clamp(theta_j - width, -HALF_PI, HALF_PI) - theta_o));
    let middle = average_back_lobe(0.5 * (theta_j - theta_o));
    let high = average_back_lobe(0.5 * (clamp(theta_j + width, -HALF_PI, HALF_PI) - theta_o));
    let mean = (low + 4.0 * middle + high) / 6.0;
    return BackLobe(product(theta_j, width, mean.x - theta_o, mean.y), mean.y);
}

// weight · cos²θ_i/cos²θ_d · Ā_b at a node.
fn back_node(node: Node, theta_o: f32) -> vec3f {
    let theta = 0.5 * (node.theta - theta_o);
    return node.weight * projection(node.theta, theta_o) * average_A_b(average_row(theta));
}

// Dual scattering, Xu 2011 Eq 2–4, with transport's means in place of T̃ and T_f:
//
//   T̃ · (M_j + d_b b M_j^L,direct) + E_j forward · (M_j^G + d_b b M_j^L)
//
// forward = d_f · (share of light that crosses strands) · ā_f^n, n strands that stand for all that its rays cross;
// E_j = ∫G_j dω, since ψ_f is normalised and G_j is not; b = 1 − (mean 0.5^n′)^{4(1−ā_f)}, the share of the endless medium's
// back scattering that the hair behind the point can give. With the factor 2 dropped from M and from S_back alike, and with
// s̃_f = 1/π in M^L, no further π belongs before d_b.

const FORWARD = true;
const D_B = 0.7;
const D_F = 0.7;

struct Strand {
    theta_o: f32,
    factors: Modes,     // energy compensation and tint
}

fn strand_at(fibre: Fibre, theta_o: f32) -> Strand {
    return Strand(theta_o, factors(fibre, averages(theta_o).energy));
}

fn light_scattering(fibre: Fibre, strand: Strand, arrival: Arrival, parts: u32) -> vec3f {
    let brightest = max(arrival.rgb.x, max(arrival.rgb.y, arrival.rgb.z));
    let least = select(arrival.least / brightest, 1e30, brightest <= 0.0);
    let a = averages(arrival.theta_j);
    let known = arrival.known;
    let strands = strands_crossed(known);
    let forward = D_F * max(known.visibility - known.t1, 0.0) * pow(max(a.a_f, vec3f(1e-6)), vec3f(strands));
    let spread2 = strands * dot(a.beta_f2, vec3f(1.0 / 3.0));
    let sigma_f = sqrt(arrival.lambda * arrival.lambda + spread2);
    let back = D_B * (1.0 - exp(4.0 * (1.0 - a.a_f) * log(max(known.back, 1e-6))));

    // Loops that run once: see resolve.wgsl.
    var scattered = vec3f(0.0);
    for (var lit = known.t1 >= least; lit; lit = false) {
        if COUNT {
            done.single += 1u;
        }
        if ((parts & SINGLE) != 0u) {
            let m = single_scattering(fibre, strand.theta_o, arrival.theta_j, arrival.phi, arrival.cos_sum, arrival.lambda);
            scattered += known.t1 * sum_of(strand.factors, m);
        }
        if ((parts & LOCAL) != 0u) {
            scattered += back * known.t1
                * local_scattering_direct(fibre, strand.theta_o, arrival.theta_j, arrival.phi, arrival.lambda);
        }
    }
    let forward_energy = arrival.energy * forward;
    for (var lit = any(forward >= vec3f(least)); lit; lit = false) {
        if COUNT {
            done.global += 1u;
        }
        if ((parts & GLOBAL) != 0u) {
            let m = global_scattering(fibre, strand.theta_o, arrival.theta_j, arrival.phi, sigma_f);
            scattered += forward_energy * sum_of(strand.factors, m);
        }
        if ((parts & LOCAL) != 0u) {
            scattered += back * forward_energy
                * local_scattering_forward(fibre, strand.theta_o, arrival.theta_j, arrival.phi, sigma_f);
        }
    }
    return arrival.rgb * scattered;
}
