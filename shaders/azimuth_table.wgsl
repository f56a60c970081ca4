// P_t, the azimuthal part of a mode under a light of circular width κ, by tables that hold no absorption. Twin:
// src/scattering/azimuth_table.rs, which states axes, units and errors.
//
// Way of the data: azimuth_columns places φ once per light; at a node, azimuth_layer turns κ into a place,
// azimuth reads four weights, and transmitted sums them for an absorption. Then
// ∫g^c(φ_i−φ_j; κ) N_t dφ_i = circular_integral(κ) · transmitted(…).

// Four 16-bit floats an entry: AzimuthTable::to_gpu.
@group(0) @binding(1) var<storage, read> azimuth_table: array<vec2u>;

// A mode's part of one η's table, [layer][row][column]; R's entries hold two columns at two layers.
struct AzimuthGrid {
    first: u32,
    rows: u32,     // over cosθ_d
    columns: u32,  // over |φ|
    layers: u32,   // over the width
}

const AZIMUTH_R = AzimuthGrid(0u, 20u, 23u, 9u);
const AZIMUTH_TT = AzimuthGrid(4140u, 20u, 32u, 14u);
const AZIMUTH_TRT = AzimuthGrid(13100u, 32u, 40u, 16u);
const AZIMUTH_TRRT = AzimuthGrid(33580u, 28u, 40u, 12u);
// [row][entry].
const AZIMUTH_ENERGY_FIRST = 47020u;
const AZIMUTH_ENERGY_ROWS = 64u;
const AZIMUTH_ENERGY_SIZE = 5u;
// Entries of one η.
const AZIMUTH_SIZE = 47340u;
// Place of the narrowest layer, (1−⟨cos⟩)^¼ of σ = 0.03.
const AZIMUTH_LAYER_FIRST: f32 = 0.145647532;

// Places of φ among the columns of each mode.
struct AzimuthColumns {
    r: Row,
    tt: Row,
    trt: Row,
    trrt: Row,
}

fn azimuth_columns(phi: f32) -> AzimuthColumns {
    let x = min(abs(phi) / PI, 1.0);
    return AzimuthColumns(
        row_of(azimuth_warp(1.0 - x, 0.3), AZIMUTH_R.columns + 1u),
        row_of(1.0 - x, AZIMUTH_TT.columns),
        row_of(azimuth_warp(x, 0.3), AZIMUTH_TRT.columns),
        row_of(1.0 - x, AZIMUTH_TRRT.columns),
    );
}

// u of x = u(fine + (1−fine)u).
fn azimuth_warp(x: f32, fine: f32) -> f32 {
    return 2.0 * x / (fine + sqrt(fine * fine + 4.0 * (1.0 - fine) * x));
}

// 1 − I₁(κ)/I₀(κ), relative error below 0.6 %.
fn mean_cosine_deficit(kappa: f32) -> f32 {
    let k2 = kappa * kappa;
    let q = (2.25 + 0.15 * k2) / (1.0 + 0.2 * k2);
    let root = sqrt(k2 + q);
    return (0.5 + q / (root + kappa)) / (0.5 + root);
}

// 2π I₀e(κ), relative error below 8e-4.
fn circular_integral(kappa: f32) -> f32 {
    let rise = fma(fma(fma(1.60286581, kappa, 0.89882240), kappa, 2.55125858), kappa, 2.0);
    let fall = fma(fma(fma(0.25510402, kappa, 0.25118035), kappa, 0.44925061), kappa, 1.0);
    return TWO_PI * inverseSqrt(1.0 + kappa * rise / fall);
}

// The place of κ, blurred further by the mode's own deficit, in [0, 1].
fn azimuth_layer(kappa: f32, own: f32) -> f32 {
    let d = mean_cosine_deficit(kappa);
    return (sqrt(sqrt(d + own - d * own)) - AZIMUTH_LAYER_FIRST) / (1.0 - AZIMUTH_LAYER_FIRST);
}

// Four weights of P_t of TT, TRT or TRRT. `base`: the first entry of an η's table, a multiple of AZIMUTH_SIZE.
fn azimuth(grid: AzimuthGrid, base: u32, cos_theta_d: f32, column: Row, layer: f32) -> vec4f {
    let row = row_of(cos_theta_d, grid.rows);
    let place = row_of(layer, grid.layers);
    let plane = grid.rows * grid.columns;
    let i = base + grid.first + place.first * plane + row.first * grid.columns + column.first;
    // The tetrahedron around the place: from the least corner to the greatest, by the axes in the order of their
    // parts of the way. Half of the loads of eight corners.
    let most = max(max(column.f, row.f), place.f);
    let least = min(min(column.f, row.f), place.f);
    let middle = column.f + row.f + place.f - most - least;
    let step_first = select(select(plane, grid.columns, row.f == most), 1u, column.f == most);
    let step_last = select(select(1u, grid.columns, row.f == least), plane, place.f == least);
    let last = i + plane + grid.columns + 1u;
    return unpack(azimuth_table[i]) * (1.0 - most)
        + unpack(azimuth_table[i + step_first]) * (most - middle)
        + unpack(azimuth_table[last - step_last]) * (middle - least)
        + unpack(azimuth_table[last]) * least;
}

// P_R.
fn azimuth_r(base: u32, cos_theta_d: f32, column: Row, layer: f32) -> f32 {
    let row = row_of(cos_theta_d, AZIMUTH_R.rows);
    let place = row_of(layer, AZIMUTH_R.layers + 1u);
    let i = base + (place.first * AZIMUTH_R.rows + row.first) * AZIMUTH_R.columns + column.first;
    let corners = mix(unpack(azimuth_table[i]), unpack(azimuth_table[i + AZIMUTH_R.columns]), row.f);
    let pair = mix(corners.xy, corners.zw, place.f);
    return max(mix(pair.x, pair.y, column.f), 0.0);
}

// Four weights of an energy: entry p is E_p, the last E of all longer paths, whose absorption is
// azimuth_rest_absorption.
fn azimuth_energy(base: u32, entry: u32, cos_theta_d: f32) -> vec4f {
    let row = row_of(cos_theta_d, AZIMUTH_ENERGY_ROWS);
    let i = base + AZIMUTH_ENERGY_FIRST + row.first * AZIMUTH_ENERGY_SIZE + entry;
    return mix(unpack(azimuth_table[i]), unpack(azimuth_table[i + AZIMUTH_ENERGY_SIZE]), row.f);
}

// The exponents of r^0 and r in `transmitted` for one crossing, per unit of σ_a.
fn azimuth_absorption(eta: f32, cos_theta_d: f32) -> vec2f {
    let edge = max(eta * eta - 1.0, 1e-6);
    let g = inverseSqrt(edge + cos_theta_d * cos_theta_d);
    let c_0 = sqrt(edge) * g;
    let chord = 2.0 * eta * g;
    return chord * vec2f(c_0 + 0.04 * (1.0 - c_0), 0.22 * (1.0 - c_0));
}

// The same for all longer paths together (p = 1).
fn azimuth_rest_absorption(eta: f32, cos_theta_d: f32) -> vec2f {
    let edge = max(eta * eta - 1.0, 1e-6);
    let g = inverseSqrt(edge + cos_theta_d * cos_theta_d);
    return eta * g * (1.0 + sqrt(edge) * g) * vec2f(4.0, 1.0);
}

// A mode's value, RGB, from four weights and the absorption of p crossings.
fn transmitted(weights: vec4f, p: f32, absorption: vec2f, sigma_a: vec3f) -> vec3f {
    let x = p * sigma_a;
    let r = exp(-absorption.y * x);
    return max(exp(-absorption.x * x) * absorbed(weights, r), vec3f());
}

fn absorbed(weights: vec4f, r: vec3f) -> vec3f {
    return (weights.x + r * weights.y) + r * r * r * (weights.z + r * weights.w);
}
