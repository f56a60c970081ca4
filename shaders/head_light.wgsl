// Irradiance of places on the head from the brightest lights, by rays; the rest comes from a volume (src/light.rs).
// Twin: StrandRays::irradiance of src/reference/transmittance.rs.

struct HeadLight {
    light: TracedLight,     // `column` is not used
    rgb: vec3f,             // L_j
    energy: f32,            // E_j = ∫G_j dω; of a lamp near the hair less than 0: its solid angle is found here
    wide: u32,              // 1 of a wide light: each vertex looks for it in directions of its own
    pad: array<u32, 3>,
}

struct HeadVertex {
    position: vec3f,
    seed: u32,              // by which rays to wide lights are drawn
    normal: vec3f,
    pad_2: u32,
    lights: vec2u,          // bit by bit, which are looked for
    pad_3: vec2u,
}

struct Lighting {
    vertices: u32,
    lights: u32,
    lift: f32,              // rays start so far above the surface
    spread: f32,            // and within so wide a square about the vertex
    head: vec2u,            // as Tracing has it
    light: array<HeadLight>,
}

@group(0) @binding(4) var<storage, read> head_vertices: array<HeadVertex>;
@group(0) @binding(5) var<storage, read_write> head_irradiance: array<f32>;  // of each light, were its radiance 1
@group(0) @binding(6) var<storage, read> lighting: Lighting;

@compute @workgroup_size(64)
fn light_head(@builtin(global_invocation_id) id: vec3u) {
    let place = id.y * 64u * 4096u + id.x;
    if (place >= lighting.vertices) {
        return;
    }
    let vertex = head_vertices[place];
    let above = vertex.position + lighting.lift * vertex.normal;
    let x = any_normal(vertex.normal);
    let y = cross(vertex.normal, x);
    for (var j = 0u; j < lighting.lights; j++) {
        var sum = 0.0;
        let light = lighting.light[j].light;
        let rays = select(0u, light.rays, (vertex.lights[j / 32u] >> (j % 32u) & 1u) == 1u);
        for (var k = 0u; k < rays; k++) {
            let draw = draw_of(lighting.light[j].wide * vertex.seed, 0u, k);
            // The place stands for what is about it, but the surface would shade itself.
            let aside = lighting.spread * (draw_of(1u, 0u, k).xy - 0.5);
            let origin = above + aside.x * x + aside.y * y;
            let aim = aim_at(light, origin, draw.xy);
            let cosine = dot(vertex.normal, aim.direction);
            // A loop that runs once: see resolve.wgsl.
            for (var lit = cosine > 0.0 && aim.distance > 0.0; lit; lit = false) {
                let strands = trace(ray_from(origin, aim.direction, aim.distance, 0.0, vec2u()), vec2u()).strands;
                let head = meets_head(ray_from(above, aim.direction, aim.distance, 0.0, vec2u()), lighting.head);
                sum += select(cosine, 0.0, head || strands > 0u);
            }
        }
        var energy = lighting.light[j].energy;
        if (energy < 0.0) {
            energy = lamp_lobe(light.direction, light.lambda, light.side, above).solid_angle;
        }
        head_irradiance[place * lighting.lights + j] = energy * sum / f32(light.rays);
    }
}
