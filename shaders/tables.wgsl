// The tables of `xu`, and circular moments. Twin: src/scattering/tables.rs.

// Eight 16-bit floats an entry. 𝒞_k and the half circle: CircleTable.
@group(0) @binding(1) var<storage, read> circle_table: array<vec4u>;
// Averages over θ, 𝒩^G over θ_d and φ, fits over η̄* and θ_d: AverageTable, GlobalTable, FitTable.
@group(0) @binding(2) var<storage, read> fibre_table: array<vec4u>;

const CIRCLE_ROWS = 64u;
const CIRCLE_COLUMNS = 96u;

// Where φ falls among the columns; made once for all nodes of a light.
struct Column {
    at: Row,
    cos_half: f32,   // cos(φ/2)
    sin_plus: f32,   // sin(π/4 + φ/2)
    sin_minus: f32,  // sin(π/4 − φ/2)
}

fn circle_column(phi: f32) -> Column {
    let x = abs(wrap(phi));
    let quarter = 0.25 * PI;
    return Column(row_of(x / PI, CIRCLE_COLUMNS), cos(0.5 * x), sin(quarter + 0.5 * x), sin(quarter - 0.5 * x));
}

fn circle_row(kappa: f32) -> Row {
    return row_of(inverseSqrt(1.0 + kappa), CIRCLE_ROWS);
}

// Weights of the four entries around a place, in the order of their loads.
fn bilinear(row: Row, column: Row) -> vec4f {
    let f = vec2f(1.0 - column.f, column.f);
    return vec4f((1.0 - row.f) * f, row.f * f);
}

// ∫ g^c times N_R, over 2π I₀e(κ), with c the r_coefficients at the node.
fn circle_reflection(kappa: f32, column: Column, c: Polynomial) -> f32 {
    let row = circle_row(kappa);
    let i = row.first * CIRCLE_COLUMNS + column.at.first;
    let j = i + CIRCLE_COLUMNS;
    let weights = bilinear(row, column.at);
    return weights.x * reflection_entry(circle_table[i], c) + weights.y * reflection_entry(circle_table[i + 1u], c)
        + weights.z * reflection_entry(circle_table[j], c) + weights.w * reflection_entry(circle_table[j + 1u], c);
}

fn reflection_entry(entry: vec4u, c: Polynomial) -> f32 {
    return dot(unpack(entry.xy).yzw, c.low) + dot(unpack(entry.zw).xyz, c.high);
}

// The share of g^c(·; 0, κ) within the half circle around φ.
fn circle_half(kappa: f32, column: Column) -> f32 {
    let row = circle_row(kappa);
    let i = row.first * CIRCLE_COLUMNS + column.at.first;
    let j = i + CIRCLE_COLUMNS;
    let rest = vec4f(
        unpack2x16float(circle_table[i].x).x, unpack2x16float(circle_table[i + 1u].x).x,
        unpack2x16float(circle_table[j].x).x, unpack2x16float(circle_table[j + 1u].x).x);
    let s = sqrt(2.0) * kappa * inverseSqrt(1.0 + kappa);
    let narrow = erf_and_gauss(s * column.sin_plus).x + erf_and_gauss(s * column.sin_minus).x;
    return clamp(dot(bilinear(row, column.at), rest) + 0.5 * narrow, 0.0, 1.0);
}

// ⟨cos φ′⟩ of g^c(φ′; 0, κ): 2cos²(φ′/2)−1 = 1 − 2(1−cos²), from 𝒟_0−𝒟_1 = 𝒞_2 at φ = 0.
fn circle_mean_cosine(kappa: f32) -> f32 {
    let row = circle_row(kappa);
    let near = unpack(circle_table[row.first * CIRCLE_COLUMNS].xy);
    let far = unpack(circle_table[(row.first + 1u) * CIRCLE_COLUMNS].xy);
    let d = mix(near, far, row.f);
    return 2.0 * (d.y - d.z) - 1.0;
}
