// What is known at a point of a strand: its frame, its own fibre, the lights, and the light between strands. For shade.wgsl
// and gather.wgsl, which bind what is named here and not declared: `painted`, `field` and `field_sampler`.

// Whether the first lights are lamps near the hair: set when the pipeline is made.
override LAMPS: bool = true;

// Of a lamp: its centre, its size, its radiance; least for E_j = 1; and `side` as lamp_lobe has it.
struct Light {
    direction: vec3f,
    lambda: f32,
    rgb: vec3f,
    energy: f32,        // E_j = ∫G_j dω
    least: f32,         // radiance that must arrive for the light to matter
    side: array<f32, 3>,
    chance: f32,        // that gather.wgsl draws this light: its share of all energy
    end: f32,           // sum of the chances up to this light's
    pad: vec2f,
}

// The grid that field::Field is of, relative to the hair's centre.
struct FieldGrid {
    origin: vec3f,
    cell: f32,
    dims: vec3f,
    scale: f32,         // what RGB is to be multiplied by
}

// A fibre's frame: its ellipse's minor axis lies at the stored twist from a fixed normal.
struct FibreFrame {
    u: vec3f,           // unit tangent, root to tip
    x: vec3f,           // from which azimuths count
    y: vec3f,
}

fn fibre_frame(u: vec3f, twist: f32) -> FibreFrame {
    let normal = any_normal(u);
    let x = cos(twist) * normal + sin(twist) * cross(u, normal);
    return FibreFrame(u, x, cross(u, x));
}

// θ of a unit vector.
fn inclination(frame: FibreFrame, direction: vec3f) -> f32 {
    return asin_accurate(clamp(dot(frame.u, direction), -1.0, 1.0));
}

// (cos φ, sin φ) of a unit vector; along the fibre any will do.
fn across(frame: FibreFrame, direction: vec3f) -> vec2f {
    let v = vec2f(dot(direction, frame.x), dot(direction, frame.y));
    let l = length(v);
    return select(vec2f(1.0, 0.0), v / max(l, 1e-20), l > 1e-6);
}

// The unit vector at θ and φ.
fn direction_at(frame: FibreFrame, theta: f32, phi: f32) -> vec3f {
    return normalize(sin(theta) * frame.u + cos(theta) * (cos(phi) * frame.x + sin(phi) * frame.y));
}

// A lamp as the light that it is from a place.
fn lamp_from(lamp: Light, position: vec3f) -> Light {
    let side = vec3f(lamp.side[0], lamp.side[1], lamp.side[2]);
    let lobe = lamp_lobe(lamp.direction, lamp.lambda, side, position);
    let energy = srbf_integral(lobe.lambda);
    var light = lamp;
    light.direction = lobe.direction;
    light.lambda = lobe.lambda;
    light.rgb = lamp.rgb * (lobe.solid_angle / energy);
    light.energy = energy;
    light.least = lamp.least / energy;
    return light;
}

fn fibre_of(point: u32) -> Fibre {
    if PAINTED {
        let width = textureDimensions(painted).x;
        let texel = textureLoad(painted, vec2u(point % width, point / width), 0);
        return painted_fibre(fibre, unpack(texel.xy), unpack(texel.zw));
    }
    return fibre;
}

// A place in cells; between the centres of cells, so that no ordinate's cells mix with another's.
fn field_cell(grid: FieldGrid, position: vec3f) -> vec3f {
    return clamp((position - grid.origin) / grid.cell, vec3f(0.5), grid.dims - 0.5);
}

// Radiance that other strands have scattered along an ordinate, at a place in cells.
fn field_at(grid: FieldGrid, cell: vec3f, ordinate: u32) -> vec3f {
    let place = vec3f(cell.xy, cell.z + f32(ordinate) * grid.dims.z);
    let size = vec3f(grid.dims.xy, f32(textureDimensions(field).z));
    let texel = textureSampleLevel(field, field_sampler, place / size, 0.0);
    return texel.rgb * (grid.scale / max(texel.a, 1e-4));
}
