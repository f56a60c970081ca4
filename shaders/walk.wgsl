// The quadrature over θ_i of Xu 2011 §4.2.2: nodes weigh f(θ_i) in ∫g(θ; μ, λ) f(θ) dθ.
// Twin: src/scattering/longitudinal.rs, linear_quadrature.

// A walk over the m−1 inner nodes; the ends ±π/2 have no weight, since f is 0 there.
struct Walk {
    mu: f32,
    lambda: f32,
    high: f32,     // t = (θ−μ)/λ of the far end
    low: f32,      // and of the near one
    first: f32,    // t of the first inner node before clamping
    t: f32,        // the node to be returned next
    edge: vec2f,   // erf(t), exp(−t²)
    rise: f32,     // ∫ of its hat's rising side
    segments: u32, // m
}

fn walk_begin(mu: f32, lambda: f32, segments: u32) -> Walk {
    let low = (-HALF_PI - mu) / lambda;
    let high = (HALF_PI - mu) / lambda;
    let first = 1.0 - 0.5 * f32(segments);
    let t = clamp(first, low, high);
    let edge = erf_and_gauss(t);
    let sides = hat_sides(low, erf_and_gauss(low), t, edge);
    return Walk(mu, lambda, high, low, first, t, edge, sides.x, segments);
}

// The node k = 0…m−2; call once for each, in order.
fn walk_next(walk: ptr<function, Walk>, k: u32) -> Node {
    let t = (*walk).t;
    let inner = clamp((*walk).first + f32(k) + 1.0, (*walk).low, (*walk).high);
    let next = select(inner, (*walk).high, k + 2u == (*walk).segments);
    let edge = erf_and_gauss(next);
    let sides = hat_sides(t, (*walk).edge, next, edge);
    let weight = (*walk).lambda * ((*walk).rise + sides.y);
    (*walk).t = next;
    (*walk).edge = edge;
    (*walk).rise = sides.x;
    return Node(clamp((*walk).mu + (*walk).lambda * t, -HALF_PI, HALF_PI), weight);
}

// Over [a, b] against exp(−t²): x the rising side of the hat at b, y the falling side of the hat at a.
fn hat_sides(a: f32, edge_a: vec2f, b: f32, edge_b: vec2f) -> vec2f {
    let width = b - a;
    let mass = 0.5 * SQRT_PI * (edge_b.x - edge_a.x);
    let moment = 0.5 * (edge_a.y - edge_b.y);
    let sides = vec2f(moment - a * mass, b * mass - moment) / max(width, 1e-2);
    // The closed form cancels in a short segment.
    return max(select(sides, 0.5 * width * vec2f(edge_b.y, edge_a.y), width < 1e-2), vec2f());
}
