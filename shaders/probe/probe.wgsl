// Runs one function of the library over many inputs. src/gpu/probe.rs puts a statement that reads `x` and
// sets `y` where the entry point names it.

const PROBE_IN = 2u;    // vec4 of input an item
const PROBE_OUT = 3u;   // vec4 of output an item

@group(1) @binding(0) var<storage, read> probe_in: array<array<vec4f, PROBE_IN>>;
@group(1) @binding(1) var<storage, read_write> probe_out: array<array<vec4f, PROBE_OUT>>;

@compute @workgroup_size(64)
fn probe(@builtin(global_invocation_id) id: vec3u) {
    let item = id.x;
    if item >= arrayLength(&probe_out) {
        return;
    }
    let x = probe_in[item];
    var y = array<vec4f, PROBE_OUT>();
    PROBED
    probe_out[item] = y;
}
