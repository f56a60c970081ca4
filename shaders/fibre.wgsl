// The fibre that a frame is shaded with, and the tables made from it on the CPU.
// Twin: src/scattering/fibre.rs; layout: src/gpu/uniforms.rs.
// Modes in the order R, TT, TRT. Angles in radians; bandwidths λ = √2·(standard deviation).

struct Fibre {
    alpha: vec3f,         // longitudinal shift α_t of θ_h
    eta: f32,             // index of refraction
    lambda: vec3f,        // bandwidth 2√2 β_t of M_t over θ_i
    linked: u32,          // bits: β_TT, β_TRT, α_TT, α_TRT follow R's where that is painted
    sigma_a: vec3f,       // absorption per radius
    blur: f32,            // 1−⟨cos⟩ of the fibre's own blur: TRT's w_c, or of all d'Eon's lobes
    eta_star: vec2f,      // η*(φ_h) = x + y cos 2φ_h, Eq 24
    eta_low: f32,         // η̄* of a table's first layer
    eta_per_layer: f32,   // layers per unit of η̄*, 0 for a round fibre
    eta_layers: u32,
    w_c: f32,             // bandwidth of TRT's own blur
    tint: array<vec3f, 3>, // RGB of R, TT, TRT towards the eye; longer paths take TRT's
}

// What a scene lacks costs nothing: set when the pipeline is made. A uniform in the place of NODES would have lavapipe compile
// the shader anew at each dispatch.
override ECCENTRIC: bool = true;
override MODES: u32 = 15u;      // bit t: mode t is there and bright enough to be seen; 3 is all past TRT
override NODES: u32 = 4u;       // `fast`: over θ_i, 2 to 4; `xu`: the segments m ≥ 2
override PARTS: u32 = 7u;       // SINGLE | GLOBAL | LOCAL
override COUNT: bool = false;   // whether work is counted
override PAINTED: bool = false; // whether points have fibres of their own

fn has_mode(t: u32) -> bool {
    return (MODES & (1u << t)) != 0u;
}

// Parts of the scattering.
const SINGLE = 1u;
const GLOBAL = 2u;
const LOCAL = 4u;

// What an invocation has done, where COUNT holds.
struct Done {
    lights: u32,    // that matter at the point
    single: u32,    // evaluations of the method
    global: u32,
    lobes: u32,     // joins of a mode with a light
}

var<private> done: Done;

// Group 0 also holds two tables, which a method declares at bindings 1 and 2.
@group(0) @binding(0) var<uniform> fibre: Fibre;

// RGB for each mode.
struct Modes {
    r: vec3f,
    tt: vec3f,
    trt: vec3f,
    longer: vec3f,  // TRRT and all that is longer, in fibres that have it
}

// By what modes are multiplied: their energy compensation, and tint.
fn factors(fibre: Fibre, energy: vec3f) -> Modes {
    let tint = fibre.tint;
    return Modes(energy.x * tint[0], energy.y * tint[1], energy.z * tint[2], tint[2]);
}

fn sum_of(by: Modes, modes: Modes) -> vec3f {
    return by.r * modes.r + by.tt * modes.tt + by.trt * modes.trt + by.longer * modes.longer;
}

// Four numbers of an entry.
fn unpack(pair: vec2u) -> vec4f {
    return vec4f(unpack2x16float(pair.x), unpack2x16float(pair.y));
}

// A place between two rows of a table: the index of the lower, and the part of the way to the next.
struct Row {
    first: u32,
    f: f32,
}

// x in [0, 1] among `rows` rows.
fn row_of(x: f32, rows: u32) -> Row {
    let place = clamp(x, 0.0, 1.0) * f32(rows - 1u);
    let first = min(u32(place), rows - 2u);
    return Row(first, place - f32(first));
}

// A point's own fibre: √σ_a, β_R; α_R, η, eccentricity. Twin: Fibres::fibre of src/paint.
fn painted_fibre(fibre: Fibre, first: vec4f, second: vec4f) -> Fibre {
    let beta_r = radians(first.w);
    let beta = vec3f(beta_r, linked_beta(0.5 * beta_r), linked_beta(2.0 * beta_r));
    let alpha = radians(second.x) * vec3f(1.0, -0.5, -1.5);
    let follows = (vec4u(fibre.linked) & vec4u(1u, 2u, 4u, 8u)) != vec4u();
    var own = fibre;
    own.sigma_a = first.xyz * first.xyz;
    own.lambda = select(fibre.lambda, sqrt(8.0) * beta, vec3<bool>(true, follows.xy));
    own.alpha = select(fibre.alpha, alpha, vec3<bool>(true, follows.zw));
    own.eta = second.y;
    if ECCENTRIC {
        let rise = 2.0 * (second.y - 1.0);
        let axes = rise * vec2f(square(second.z), 1.0 / square(second.z)) + 2.0 - second.y;
        own.eta_star = 0.5 * vec2f(axes.x + axes.y, axes.x - axes.y);
    } else {
        own.eta_star = vec2f(second.y, 0.0);
    }
    return own;
}

// Within the range of β.
fn linked_beta(beta: f32) -> f32 {
    return clamp(beta, radians(0.05), radians(45.0));
}
