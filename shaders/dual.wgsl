// Dual scattering's averages over θ. Twin: src/scattering/dual.rs, AverageTable, where each is defined.

const AVERAGE_ROWS = 129u;
const AVERAGE_SIZE = 3u;

struct Averages {
    a_f: vec3f,       // share scattered forward
    a_b: vec3f,       // share scattered backward
    A_b: vec3f,       // share returned by the strands behind
    beta_f2: vec3f,   // what one crossing adds to σ_f², a bandwidth² of θ
    energy: vec3f,    // energy compensation of R, TT, TRT at θ_o = θ
    delta_b: f32,     // centre of S_back in θ_i+θ_o
    sigma_b: f32,     // its bandwidth
}

fn averages(theta: f32) -> Averages {
    let row = average_row(theta);
    let next = row.first + AVERAGE_SIZE;
    let forward = mix(unpack(fibre_table[row.first].xy), unpack(fibre_table[next].xy), row.f);
    let spread = mix(unpack(fibre_table[row.first].zw), unpack(fibre_table[next].zw), row.f);
    let backward = mix(unpack(fibre_table[row.first + 1u].zw), unpack(fibre_table[next + 1u].zw), row.f);
    let energy = mix(unpack(fibre_table[row.first + 2u].xy), unpack(fibre_table[next + 2u].xy), row.f);
    return Averages(forward.xyz, backward.xyz, average_A_b(row), spread.xyz, energy.xyz, forward.w, spread.w);
}

fn average_row(theta: f32) -> Row {
    let row = row_of(theta / PI + 0.5, AVERAGE_ROWS);
    return Row(row.first * AVERAGE_SIZE, row.f);
}

fn average_A_b(row: Row) -> vec3f {
    let next = row.first + AVERAGE_SIZE;
    return mix(unpack(fibre_table[row.first + 1u].xy), unpack(fibre_table[next + 1u].xy), row.f).xyz;
}

// (Δ̄_b, σ̄_b) at θ.
fn average_back_lobe(theta: f32) -> vec2f {
    let row = average_row(theta);
    let a = fibre_table[row.first];
    let b = fibre_table[row.first + AVERAGE_SIZE];
    return mix(
        vec2f(unpack2x16float(a.y).y, unpack2x16float(a.w).y),
        vec2f(unpack2x16float(b.y).y, unpack2x16float(b.w).y), row.f);
}
