// The fast method. Twin: src/scattering/fast.rs, which states units and errors.
//
// Way of the data: lobe_of joins a light's lobe over θ_i with M_t, node_place finds its Gauss rule; at each
// node the inner integral over φ is a place in azimuth_table, and absorption two exponentials.

// The fibre is a file of its own, marschner.wgsl or deon.wgsl, which defines SLOPE, Lengthwise, lengthwise, own_blur,
// sight and energy_compensation.

// A node of ∫G M_t … dθ_i.
struct Sight {
    cos_i: f32,
    cos_path: f32,  // cosine of the inclination that A_t follows from
    weight: f32,    // M_t, the projection and the light's e^exponent over θ_i included
}

// Loops that run once: see resolve.wgsl.

// η among the layers of the table; a round fibre has one.
struct EtaPlace {
    eta: f32,
    base: u32,
    f: f32,
}

fn eta_place(fibre: Fibre, eta: f32) -> EtaPlace {
    if !ECCENTRIC || fibre.eta_layers < 2u {
        return EtaPlace(eta, 0u, 0.0);
    }
    let layers = fibre.eta_layers;
    let row = row_of((eta - fibre.eta_low) * fibre.eta_per_layer / f32(layers - 1u), layers);
    return EtaPlace(eta, row.first * AZIMUTH_SIZE, row.f);
}

// Four weights of P_t.
fn weights_at(eta: EtaPlace, grid: AzimuthGrid, cos_path: f32, column: Row, layer: f32) -> vec4f {
    let weights = azimuth(grid, eta.base, cos_path, column, layer);
    if ECCENTRIC {
        return mix(weights, azimuth(grid, eta.base + AZIMUTH_SIZE, cos_path, column, layer), eta.f);
    }
    return weights;
}

// Four weights of E_t.
fn energy_weights(eta: EtaPlace, entry: u32, cos_theta: f32) -> vec4f {
    let weights = azimuth_energy(eta.base, entry, cos_theta);
    if ECCENTRIC {
        return mix(weights, azimuth_energy(eta.base + AZIMUTH_SIZE, entry, cos_theta), eta.f);
    }
    return weights;
}

// E of all paths longer than TRRT.
fn rest_energy(fibre: Fibre, cos_theta: f32) -> vec3f {
    let eta = eta_place(fibre, fibre.eta);
    return transmitted(energy_weights(eta, 4u, cos_theta), 1.0, azimuth_rest_absorption(eta.eta, cos_theta),
        fibre.sigma_a);
}

// η, or of an eccentric fibre's TRT the mean of η*(φ_h).
fn mean_eta(fibre: Fibre, t: u32) -> EtaPlace {
    return eta_place(fibre, select(fibre.eta, max(fibre.eta_star.x, 1.0), t == 2u));
}

// An SRBF seen from a strand.
struct Lobewise {
    theta: f32,
    lambda: f32,
    kappa: f32,         // 2 cosθ_j/λ_j²
    cos_sum: f32,
    columns: AzimuthColumns,
}

// ln G_j over θ_i.
fn light_exponent(light: Lobewise, theta_i: f32) -> f32 {
    let s = 2.0 * sin_near(0.5 * (theta_i - light.theta)) / light.lambda;
    return -s * s;
}

// ∫G_j S_t cosθ_i dω, Eq 11, without energy compensation. φ = φ_o−φ_j in [−π, π]; cos_sum = cos(φ_o+φ_j).
fn single_scattering(fibre: Fibre, theta_o: f32, theta_j: f32, phi: f32, cos_sum: f32, lambda_j: f32) -> Modes {
    let kappa = concentration(lambda_j) * max(cos(theta_j), 0.0);
    let light = Lobewise(theta_j, lambda_j, kappa, cos_sum, azimuth_columns(phi));
    var modes = Modes(
        vec3f(single_r(fibre, theta_o, light)),
        single_inside(fibre, theta_o, light, 1u, AZIMUTH_TT, light.columns.tt),
        single_inside(fibre, theta_o, light, 2u, AZIMUTH_TRT, light.columns.trt),
        vec3f(),
    );
    if has_mode(3u) {
        modes.longer = single_inside(fibre, theta_o, light, 3u, AZIMUTH_TRRT, light.columns.trrt);
    }
    return modes;
}

fn single_r(fibre: Fibre, theta_o: f32, light: Lobewise) -> f32 {
    let m = lengthwise(fibre, theta_o, 0u);
    let lobe = lobe_of(theta_o, light.theta, light.lambda, m.centre, m.lambda, SLOPE.x);
    var sum = 0.0;
    for (var lit = has_mode(0u) && lobe_share(lobe) > 0.0; lit; lit = false) {
        let place = node_place(lobe);
        let eta = eta_place(fibre, fibre.eta);
        for (var k = 0u; k < NODES; k++) {
            let node = node_at(place, k);
            let at = sight(theta_o, m, node, light_exponent(light, node.theta));
            let kappa = light.kappa * at.cos_i;
            let layer = azimuth_layer(kappa, own_blur(fibre, 0u));
            var p = azimuth_r(eta.base, at.cos_path, light.columns.r, layer);
            if ECCENTRIC {
                p = mix(p, azimuth_r(eta.base + AZIMUTH_SIZE, at.cos_path, light.columns.r, layer), eta.f);
            }
            sum += at.weight * circular_integral(kappa) * p;
        }
    }
    return lobe_share(lobe) * sum;
}

// A mode of t crossings, 1 or 2; or 3: TRRT and, over an even azimuth, all that is longer.
fn single_inside(fibre: Fibre, theta_o: f32, light: Lobewise, t: u32, grid: AzimuthGrid, column: Row) -> vec3f {
    let m = lengthwise(fibre, theta_o, t);
    let lobe = lobe_of(theta_o, light.theta, light.lambda, m.centre, m.lambda, SLOPE[t]);
    var sum = vec3f();
    for (var lit = has_mode(t) && lobe_share(lobe) > 0.0; lit; lit = false) {
        let place = node_place(lobe);
        var eta = eta_place(fibre, fibre.eta);
        for (var k = 0u; k < NODES; k++) {
            let node = node_at(place, k);
            let at = sight(theta_o, m, node, light_exponent(light, node.theta));
            let kappa = light.kappa * at.cos_i;
            let layer = azimuth_layer(kappa, own_blur(fibre, t));
            if ECCENTRIC && t == 2u {
                // η̄* of Eq 24–26.
                let mean_cos = (1.0 - mean_cosine_deficit(kappa)) * light.cos_sum;
                eta = eta_place(fibre, max(fibre.eta_star.x + fibre.eta_star.y * mean_cos, 1.0));
            }
            let weights = weights_at(eta, grid, at.cos_path, column, layer);
            var p = transmitted(weights, f32(t), azimuth_absorption(eta.eta, at.cos_path), fibre.sigma_a);
            if t == 3u {
                p += rest_energy(fibre, at.cos_path) / TWO_PI;
            }
            sum += at.weight * circular_integral(kappa) * p;
        }
    }
    return lobe_share(lobe) * sum;
}

// 1/2πv(1−e^{−2/v}): what makes exp((cos x − 1)/v) a density over the sphere.
fn von_mises_scale(v: f32) -> f32 {
    // v(1−e^{−2/v}) is 2 − 2/v + … for a wide lobe, where it cancels.
    let normaliser = select(v * (1.0 - exp(-2.0 / v)), 2.0 - (2.0 - 4.0 / (3.0 * v)) / v, v > 40.0);
    return 1.0 / (TWO_PI * normaliser);
}

const FORWARD = false;

// What all lights share at a point.
struct Strand {
    theta_o: f32,
    factors: Modes,     // energy compensation and tint
}

fn strand_at(fibre: Fibre, theta_o: f32) -> Strand {
    return Strand(theta_o, factors(fibre, energy_compensation(fibre, theta_o)));
}

// Light that other strands have scattered is a light like any: src/field.
fn light_scattering(fibre: Fibre, strand: Strand, arrival: Arrival, parts: u32) -> vec3f {
    var arriving = vec3f();
    if ((parts & SINGLE) != 0u) {
        arriving = arrival.known.t1 * arrival.rgb;
    }
    if ((parts & (GLOBAL | LOCAL)) != 0u) {
        arriving += arrival.field;
    }
    let most = max(arriving.x, max(arriving.y, arriving.z));
    var scattered = vec3f();
    for (var lit = most >= arrival.least && most > 0.0; lit; lit = false) {
        if COUNT {
            done.single += 1u;
        }
        set_exponent_max(most, arrival.least);
        let m = single_scattering(fibre, strand.theta_o, arrival.theta_j, arrival.phi, arrival.cos_sum, arrival.lambda);
        scattered = arriving * sum_of(strand.factors, m);
    }
    return scattered;
}
