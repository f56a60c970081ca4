// The nodes of the `fast` method over θ_i: Gauss rules for a Gaussian that ends at ±π/2.
// Twin: src/scattering/nodes.rs. The integral is the sum of weight · F(θ), with F as it is.

const EXPONENT_MAX: f32 = 8.0;
// What a mode makes of a light from its brightest direction, over its mean; rounded up.
const PEAK: f32 = 4.0;
const TILT_MAX = 1.4;
const NODE_ROWS = 24u;
const NODE_COLUMNS = 32u;
const LAMBDA_MIDDLE = 0.5 * HALF_PI;
const OUTSIDE = 3.0;
const CROWDING = 6.0;

// Component k of an entry: (t_k, weight_k/λ) as 16-bit floats.
@group(0) @binding(2) var<storage, read> node_table: array<vec4u>;

// The Gaussian that places the nodes; G_j M_t is at most about e^{−exponent} of its peak.
struct Lobe {
    mu: f32,
    lambda: f32,
    exponent: f32,
}

// Of an SRBF of bandwidth λ_j at θ_j and M_t of bandwidth λ_M about centre = 2α_t−θ_o, with the mode's slope.
fn lobe_of(theta_o: f32, theta_j: f32, lambda_j: f32, centre: f32, lambda_m: f32, slope: f32) -> Lobe {
    let apart = theta_j - centre;
    let x = theta_j - clamp(centre, -HALF_PI, HALF_PI);
    // (sin(x/2)/(x/2))².
    let x2 = x * x;
    let stretch = 1.0 - x2 * (1.0 / 12.0 - x2 * (1.0 / 360.0 - x2 / 20160.0));
    let sharp_j = stretch / (lambda_j * lambda_j);
    let sharp_m = 1.0 / (lambda_m * lambda_m);
    let lambda = inverseSqrt(sharp_j + sharp_m);
    let share = sharp_j * lambda * lambda;
    let mu = centre + apart * share;
    let half = 0.5 * (theta_o - clamp(mu, -TILT_MAX, TILT_MAX));
    let half_tangent = sin_near(half) / cos_near(half);
    let tilt = clamp(-0.5 * slope * half_tangent * lambda, -1.0, 1.0);
    return Lobe(mu + lambda * tilt, lambda, apart * apart * share * sharp_m);
}

// A lobe fainter than e^−exponent_max of its peak is left out: less is kept of a light that brings little.
var<private> exponent_max: f32 = EXPONENT_MAX;

// Of a light that brings `share` to a point where `least` would be nothing.
fn set_exponent_max(share: f32, least: f32) {
    // By their ratio, which is the same for light of every brightness.
    exponent_max = min(log(PEAK / max(least / share, 1e-20)), EXPONENT_MAX);
}

// The factor of the integral; where it is 0 the lobe is left out.
fn lobe_share(lobe: Lobe) -> f32 {
    return saturate(exponent_max - lobe.exponent);
}

// The centre of d'Eon's M_p: past a pole it comes down on the far side.
fn over_the_pole(centre: f32) -> f32 {
    return sign(centre) * (HALF_PI - abs(HALF_PI - abs(centre)));
}

// Where a lobe's rule lies in the table; made once for its nodes.
struct NodePlace {
    first: u32,      // entry of the nearest corner
    side: f32,       // sign of μ
    near: f32,       // |μ|, or the last that is told apart
    lambda: f32,
    shares: vec4f,   // of the four corners
}

fn node_place(lobe: Lobe) -> NodePlace {
    if COUNT {
        done.lobes += 1u;
    }
    let last = HALF_PI + OUTSIDE * lobe.lambda;
    let near = min(abs(lobe.mu), last);
    let crowding = CROWDING * lobe.lambda;
    let row = row_of(lobe.lambda / (lobe.lambda + LAMBDA_MIDDLE), NODE_ROWS);
    let column = row_of(crowding * near / (last * (last - near + crowding)), NODE_COLUMNS);
    let f = vec2f(1.0 - column.f, column.f);
    let side = select(1.0, -1.0, lobe.mu < 0.0);
    return NodePlace(row.first * NODE_COLUMNS + column.first, side, near, lobe.lambda,
        vec4f((1.0 - row.f) * f, row.f * f));
}

// Node k, in no order that matters.
fn node_at(place: NodePlace, k: u32) -> Node {
    let i = place.first;
    let j = i + NODE_COLUMNS;
    let node = place.shares.x * unpack2x16float(node_table[i][k])
        + place.shares.y * unpack2x16float(node_table[i + 1u][k])
        + place.shares.z * unpack2x16float(node_table[j][k])
        + place.shares.w * unpack2x16float(node_table[j + 1u][k]);
    let theta = clamp(place.near + place.lambda * node.x, -HALF_PI, HALF_PI);
    return Node(place.side * theta, place.lambda * node.y);
}
