// N_R's polynomial, the circular Gaussians of N_TT and N_TRT, and 𝒩^G. Twins: src/scattering/azimuthal.rs,
// src/scattering/global.rs.

const FIT_ROWS = 256u;
const FIT_SIZE = 2u;
const GLOBAL_ROWS = 128u;
const GLOBAL_COLUMNS = 64u;

// Coefficients of |cos(φ/2)|(1−|cos(φ/2)|)^k, k = 0…5.
struct Polynomial {
    low: vec3f,
    high: vec3f,
}

// N_R with Schlick's Fresnel: ¼|cos(φ/2)|(F₀ + (1−F₀)(1−cosθ_d|cos(φ/2)|)⁵), where with c = cosθ_d
// 1−c|cos| = (1−c) + c(1−|cos|): all terms positive.
fn r_coefficients(eta: f32, theta_d: f32) -> Polynomial {
    let root = (1.0 - eta) / (1.0 + eta);
    let f0 = root * root;
    let c = cos(theta_d);
    let d = 1.0 - c;
    let s = 0.25 * (1.0 - f0);
    let c2 = c * c;
    let d2 = d * d;
    return Polynomial(
        s * d2 * vec3f(d2 * d, 5.0 * d2 * c, 10.0 * d * c2) + vec3f(0.25 * f0, 0.0, 0.0),
        s * c2 * c * vec3f(10.0 * d2, 5.0 * d * c, c2),
    );
}

// κ from the width 1/√(1+κ) that the table holds.
fn kappa_of(width: vec3f) -> vec3f {
    return max(1.0 / (width * width) - 1.0, vec3f());
}

// 𝒩^G at (θ_d, φ): each mode reads its own part of an entry.
fn global_place(theta_d: f32, column: Row) -> Row {
    let row = row_of(abs(theta_d) / HALF_PI, GLOBAL_ROWS);
    return Row(AVERAGE_ROWS * AVERAGE_SIZE + row.first * GLOBAL_COLUMNS + column.first, row.f);
}

// (R, TT rgb).
fn global_r_tt(theta_d: f32, column: Row) -> vec4f {
    let row = global_place(theta_d, column);
    let next = row.first + GLOBAL_COLUMNS;
    let near = mix(unpack(fibre_table[row.first].xy), unpack(fibre_table[row.first + 1u].xy), column.f);
    let far = mix(unpack(fibre_table[next].xy), unpack(fibre_table[next + 1u].xy), column.f);
    return mix(near, far, row.f);
}

fn global_trt(theta_d: f32, column: Row) -> vec3f {
    let row = global_place(theta_d, column);
    let next = row.first + GLOBAL_COLUMNS;
    let near = mix(unpack(fibre_table[row.first].zw), unpack(fibre_table[row.first + 1u].zw), column.f);
    let far = mix(unpack(fibre_table[next].zw), unpack(fibre_table[next + 1u].zw), column.f);
    return mix(near, far, row.f).xyz;
}

// The row of |θ_d| among the fits, as an index into fibre_table.
fn fit_row(theta_d: f32) -> Row {
    let row = row_of(abs(theta_d) / HALF_PI, FIT_ROWS);
    let fits = AVERAGE_ROWS * AVERAGE_SIZE + GLOBAL_ROWS * GLOBAL_COLUMNS;
    return Row(fits + row.first * FIT_SIZE, row.f);
}

// N_TT = b g^c(φ−π; κ).
struct FitTt {
    b: vec3f,
    kappa: vec3f,
}

fn fit_tt(theta_d: f32) -> FitTt {
    let row = fit_row(theta_d);
    let a = fibre_table[row.first];
    let b = fibre_table[row.first + FIT_SIZE];
    let low = mix(unpack(a.xy), unpack(b.xy), row.f);
    let high = mix(unpack2x16float(a.z), unpack2x16float(b.z), row.f);
    return FitTt(low.xyz, kappa_of(vec3f(low.w, high)));
}

// N_TRT = b_1 (g^c(φ−φ*; κ_1) + g^c(φ+φ*; κ_1)) + b_2 g^c(φ; κ_2).
struct FitTrt {
    b_1: vec3f,
    b_2: vec3f,
    kappa: vec3f,    // κ_1, κ_1, κ_2: of the lobes at φ*, −φ*, 0
    phi_star: f32,
}

// At η̄* = η*(mean of cos 2φ_h); a round fibre has one layer.
fn fit_trt(fibre: Fibre, theta_d: f32, mean_cos_2phi_h: f32) -> FitTrt {
    let row = fit_row(theta_d);
    var entry = trt_entry(row, 0u);
    if fibre.eta_layers > 1u {
        let eta = fibre.eta_star.x + fibre.eta_star.y * mean_cos_2phi_h;
        let layers = fibre.eta_layers;
        let layer = row_of((eta - fibre.eta_low) * fibre.eta_per_layer / f32(layers - 1u), layers);
        let low = trt_entry(row, layer.first);
        let high = trt_entry(row, layer.first + 1u);
        entry = TrtEntry(mix(low.b_1, high.b_1, layer.f), mix(low.b_2, high.b_2, layer.f));
    }
    let phi_star = entry.b_1.w;
    let width = entry.b_2.w;
    let kappa_1 = max(1.0 / (width * width) - 1.0, 0.0);
    let kappa_2 = min(2.0 / max(phi_star * phi_star, 1e-6), KAPPA_MAX);
    return FitTrt(entry.b_1.xyz, entry.b_2.xyz, vec3f(kappa_1, kappa_1, kappa_2), phi_star);
}

// (b_1, φ*) and (b_2, width of κ_1).
struct TrtEntry {
    b_1: vec4f,
    b_2: vec4f,
}

fn trt_entry(row: Row, layer: u32) -> TrtEntry {
    let i = row.first + layer * (FIT_ROWS * FIT_SIZE) + 1u;
    let a = fibre_table[i];
    let b = fibre_table[i + FIT_SIZE];
    return TrtEntry(mix(unpack(a.xy), unpack(b.xy), row.f), mix(unpack(a.zw), unpack(b.zw), row.f));
}
