//! Light transport against what is known exactly: analytic slabs, spheres and lobes, and rays.

use glam::{DVec3, Vec3, Vec3Swizzles as _};
use hairlight::gpu::frame::{Background, Parts, Renderer};
use hairlight::gpu::method::MethodData;
use hairlight::hair::Hair;
use hairlight::head::{FineHead, Head};
use hairlight::light::HairMedium;
use hairlight::reference::transmittance::{RealStrands, StrandRays};
use hairlight::scattering::dual::D_F;
use hairlight::scattering::model::Model;
use hairlight::scene::{Energies, FibreSpec, Lens, Scene};
use hairlight::srbf::{SrbfLight, lobe_integral, sample_lobe, split_wide};
use hairlight::stage::Geometry;
use hairlight::transport::draws::{
    HeadLight, HeadVertex, Rays, TracedLight, pack_means, unpack_means,
};
use hairlight::transport::sheared::{OpticalDepth, Shear};
use hairlight::transport::volume::Volume;
use hairlight::transport::{Occluders, lobe_directions, transport};

use crate::wgsl::cpu;

fn light(direction: Vec3, lambda: f64) -> SrbfLight {
    SrbfLight { direction: direction.as_dvec3().normalize(), lambda, rgb: [1.0, 2.0, 3.0] }
}

fn volume_of(
    segments: impl Iterator<Item = (Vec3, Vec3, f32)>,
    [low, high]: [Vec3; 2],
    cells: usize,
) -> Volume {
    let mut volume = Volume::empty(low, high, cells);
    segments.for_each(|(a, b, diameter)| volume.splat(a, b, diameter));
    volume
}

/// Uniform in 0…1, by splitmix64.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }

    fn within(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    fn point(&mut self, low: f32, high: f32) -> Vec3 {
        Vec3::new(self.within(low, high), self.within(low, high), self.within(low, high))
    }
}

/// Along and against each axis, the diagonals of faces and of the cube, and two directions of no symmetry.
fn directions() -> Vec<Vec3> {
    let mut directions = vec![Vec3::new(0.3, -0.8, 0.52), Vec3::new(-0.91, 0.13, 0.4)];
    for i in -1..=1 {
        for j in -1..=1 {
            for k in -1..=1 {
                directions.push(Vec3::new(i as f32, j as f32, k as f32));
            }
        }
    }
    directions.retain(|d| *d != Vec3::ZERO);
    directions.into_iter().map(Vec3::normalize).collect()
}

#[test]
fn moments_survive_packing_within_the_stated_errors() {
    let mut worst = [0.0f32; 3];
    for i in 0..=10_000u32 {
        let given = [1, 3, 7].map(|k| (k * i % 10_001) as f32 / 10_000.0);
        let back = unpack_means(pack_means(given));
        for field in 0..3 {
            worst[field] = worst[field].max((back[field] - given[field]).abs());
        }
    }
    // Half a step of 8, 12 and 12 bits.
    for (worst, stated) in worst.into_iter().zip([0.5 / 255.0, 0.5 / 4095.0, 0.5 / 4095.0]) {
        assert!(worst <= 1.01 * stated && worst > 0.9 * stated, "{worst} {stated}");
    }
}

#[test]
fn points_of_a_ray_share_columns_and_depth_grows_towards_the_light() {
    let mut random = Random(1);
    for omega in directions() {
        let shear = Shear::new(omega);
        for _ in 0..50 {
            let (p, t) = (random.point(-40.0, 40.0), random.within(0.5, 50.0));
            let [x, y, depth] = shear.apply(p);
            let [x1, y1, depth1] = shear.apply(p + t * omega);
            assert!((x1 - x).hypot(y1 - y) < 1e-3, "{omega}: {x} {y} to {x1} {y1}");
            assert!(((depth1 - depth) * shear.stretch - t).abs() < 1e-3 * t, "{omega}: {t}");
            let beside = (omega + 0.02 * omega.any_orthonormal_vector()).normalize();
            let [x2, y2, _] = shear.apply(p + t * beside);
            assert!((x2 - x).hypot(y2 - y) > 1e-3, "a ray of another direction is told apart");
        }
    }
}

/// A box of uniform density inside an empty margin, with one tensor per unit of length.
struct Slab {
    volume: Volume,
    low: Vec3,
    high: Vec3,
}

impl Slab {
    fn new(tensor: [f32; 6]) -> Slab {
        const MARGIN: usize = 2;
        let (cell, origin) = (0.25, Vec3::new(-3.0, 1.0, 7.0));
        let dims = [36, 28, 44];
        let inside = |i: usize, n: usize| (MARGIN..n - MARGIN).contains(&i);
        let mut cells = Vec::new();
        for k in 0..dims[2] {
            for j in 0..dims[1] {
                for i in 0..dims[0] {
                    let full = inside(i, dims[0]) && inside(j, dims[1]) && inside(k, dims[2]);
                    cells.push(if full { tensor } else { [0.0; 6] });
                }
            }
        }
        let size = cell * Vec3::from(dims.map(|n| n as f32));
        let margin = Vec3::splat(cell * MARGIN as f32);
        Slab {
            volume: Volume::new(origin, cell, dims, cells),
            low: origin + margin,
            high: origin + size - margin,
        }
    }

    /// Distance from `p` inside to the surface along `omega`.
    fn exit(&self, p: Vec3, omega: Vec3) -> f32 {
        let wall = Vec3::select(omega.cmpgt(Vec3::ZERO), self.high, self.low);
        let t = (wall - p) / omega;
        Vec3::select(omega.cmpeq(Vec3::ZERO), Vec3::INFINITY, t).min_element()
    }
}

#[test]
fn optical_depth_of_a_uniform_slab_is_density_times_length() {
    let isotropic = ([0.2, 0.2, 0.2, 0.0, 0.0, 0.0], None);
    let along = Vec3::new(0.6, 0.0, 0.8);
    let [x, y, z] = along.to_array();
    let parallel = ([x * x, y * y, z * z, x * y, x * z, y * z].map(|v| 0.6 * v), Some(along));
    for (tensor, fibres) in [isotropic, parallel] {
        let slab = Slab::new(tensor);
        let mut random = Random(2);
        let (mut wrong_way, mut checks) = (0, 0);
        for omega in directions() {
            // Trace 0.6 both times: √(s² − s·s/3), and s times the sine to the fibres.
            let rho = match fibres {
                None => 0.6 * (2.0f32 / 3.0).sqrt(),
                Some(t) => 0.6 * t.cross(omega).length(),
            };
            let depth = OpticalDepth::new(&slab.volume, omega);
            let away = OpticalDepth::new(&slab.volume, -omega);
            for _ in 0..40 {
                // Where edges are cut off within a cell's blur, only a mean would be right.
                let p = slab.low + (slab.high - slab.low) * random.point(0.2, 0.8);
                let (ahead, behind) = (rho * slab.exit(p, omega), rho * slab.exit(p, -omega));
                let at = slab.volume.to_cells(p);
                let tau = depth.tau(depth.shear.apply(at));
                let beyond = away.tau(away.shear.apply(at));
                // Near an edge the blur of one cell takes up to a quarter of a cell's depth.
                let close =
                    |a: f32, b: f32| (a - b).abs() <= 0.02 * b + 0.3 * rho * slab.volume.cell;
                assert!(close(tau, ahead), "{omega} {p}: {tau} for {ahead}");
                assert!(close(beyond, behind), "{omega} {p}: {beyond} for {behind}");
                checks += 1;
                wrong_way += usize::from(!close(tau, behind));
            }
        }
        assert!(wrong_way * 2 > checks, "light from the other side is told apart: {wrong_way}");
    }
}

#[test]
fn nothing_stands_beside_the_volume() {
    let slab = Slab::new([0.2, 0.2, 0.2, 0.0, 0.0, 0.0]);
    for omega in directions() {
        let depth = OpticalDepth::new(&slab.volume, omega);
        let tau = |p: Vec3| depth.tau(depth.shear.apply(slab.volume.to_cells(p)));
        let middle = 0.5 * (slab.low + slab.high);
        assert_eq!(tau(middle + 100.0 * omega), 0.0, "{omega}: before it");
        assert_eq!(tau(middle + 100.0 * omega.any_orthonormal_vector()), 0.0, "{omega}: aside");
        let rho = 0.6 * (2.0f32 / 3.0).sqrt();
        let chord = rho * (slab.exit(middle, omega) + slab.exit(middle, -omega));
        let behind = tau(middle - 100.0 * omega);
        assert!((behind / chord - 1.0).abs() < 0.05, "{omega}: {behind} for {chord}");
    }
}

#[test]
fn the_volume_holds_every_diameter_times_length() {
    let mut random = Random(3);
    let segments: Vec<(Vec3, Vec3, f32)> = (0..2000)
        .map(|_| {
            let a = random.point(-1.0, 1.0);
            let b = (a + random.point(-0.3, 0.3)).clamp(Vec3::NEG_ONE, Vec3::ONE);
            (a, b, random.within(0.001, 0.01))
        })
        .collect();
    let total = |segments: &[(Vec3, Vec3, f32)]| {
        let volume = volume_of(segments.iter().copied(), [Vec3::NEG_ONE, Vec3::ONE], 24);
        let cubed = f64::from(volume.cell).powi(3);
        let sum = |c: usize| volume.cells.iter().map(|s| f64::from(s[c])).sum::<f64>() * cubed;
        [0, 1, 2, 3, 4, 5].map(sum)
    };
    let mut exact = [0.0; 6];
    for &(a, b, diameter) in &segments {
        let (step, length) = ((b - a).as_dvec3(), f64::from(a.distance(b)));
        let [x, y, z] = step.to_array();
        let products = [x * x, y * y, z * z, x * y, x * z, y * z];
        (0..6).for_each(|c| exact[c] += f64::from(diameter) * products[c] / length);
    }
    let trace = exact[0] + exact[1] + exact[2];
    let given: f64 = segments.iter().map(|(a, b, d)| f64::from(d * a.distance(*b))).sum();
    assert!((trace / given - 1.0).abs() < 1e-5);
    let error =
        |found: [f64; 6]| (0..6).map(|c| (found[c] - exact[c]).abs() / trace).fold(0.0, f64::max);
    let whole = error(total(&segments));
    assert!(whole < 1e-5, "{whole}");
    let lacking = error(total(&segments[20..]));
    assert!(lacking > 1e-3, "1 % less is told apart: {lacking}");
    // What lies outside is left out, and stirs nothing.
    let mut outside = segments.clone();
    outside.push((Vec3::splat(5.0), Vec3::splat(6.0), 1.0));
    outside.push((Vec3::splat(-1e9), Vec3::splat(-1e9 - 100.0), 1.0));
    assert_eq!(total(&outside), total(&segments));
}

/// The unit sphere by latitudes and longitudes.
fn sphere() -> Head {
    const ROWS: u32 = 32;
    const COLUMNS: u32 = 64;
    let mut positions = Vec::new();
    for row in 0..=ROWS {
        let (sin, cos) = (std::f32::consts::PI * row as f32 / ROWS as f32).sin_cos();
        for column in 0..COLUMNS {
            let (s, c) = (std::f32::consts::TAU * column as f32 / COLUMNS as f32).sin_cos();
            positions.push(Vec3::new(sin * c, cos, sin * s));
        }
    }
    let mut triangles = Vec::new();
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let next = (column + 1) % COLUMNS;
            let [a, b] = [row, row + 1].map(|r| r * COLUMNS + column);
            let [c, d] = [row, row + 1].map(|r| r * COLUMNS + next);
            triangles.extend([[a, b, c], [c, b, d]]);
        }
    }
    Head { normals: positions.clone(), positions, triangles }
}

#[test]
fn a_head_blocks_what_lies_behind_it_and_is_lit_from_the_front() {
    let head = sphere();
    let volume = Volume::empty(Vec3::splat(-2.0), Vec3::splat(2.0), 32);
    let narrow = 0.05;
    for omega in directions() {
        let light = light(omega, narrow);
        let side = omega.any_orthonormal_vector();
        // Before it, on its lit surface, beside it, behind it, on its dark surface.
        let points = [1.5 * omega, omega, 1.2 * side, -1.5 * omega, -omega];
        let open = |head: Option<&Head>| {
            Occluders { volume: &volume, head }.transmittance(&light, &points)
        };
        assert_eq!(open(Some(&head)), [1.0, 1.0, 1.0, 0.0, 0.0], "{omega}");
        assert_eq!(open(None), [1.0; 5], "{omega}: without a head");

        let occluders = Occluders { volume: &volume, head: Some(&head) };
        let irradiance = occluders.irradiance(&light);
        let peak = lobe_integral(narrow) as f32;
        let (mut total, mut exact_total) = (0.0, 0.0);
        for (normal, irradiance) in head.normals.iter().zip(irradiance) {
            let cosine = normal.dot(omega);
            let exact = peak * cosine.max(0.0);
            let area = normal.xz().length();
            total += area * irradiance;
            exact_total += area * exact;
            // Nearer the terminator the head shades itself where a texel is deeper than the bias.
            if !(0.0..0.4).contains(&cosine) {
                let off = (irradiance - exact).abs();
                assert!(off <= 1e-4 * exact, "{omega} {normal}: {irradiance}");
            }
        }
        // What that costs of the whole: 0.2 to 0.5 %.
        assert!((total / exact_total - 1.0).abs() < 0.01, "{omega}: {total} of {exact_total}");
    }
    // The pole is lit from above alone.
    let occluders = Occluders { volume: &volume, head: Some(&head) };
    let front = |omega: Vec3| occluders.irradiance(&light(omega, narrow))[0];
    assert!(front(Vec3::Y) > 0.0 && front(Vec3::NEG_Y) == 0.0);
}

#[test]
fn cancelled_transport_is_none() {
    let volume = Volume::empty(Vec3::ZERO, Vec3::ONE, 8);
    let occluders = Occluders { volume: &volume, head: None };
    let lights = [light(Vec3::Y, 0.5), light(Vec3::X, 0.1)];
    let samples = [Vec3::ONE; 2];
    assert!(transport(&occluders, &lights, &samples, &|_| false).is_none());
    let done = transport(&occluders, &lights, &samples, &|_| true).unwrap();
    assert_eq!(done.len(), 2);
    for brought in done {
        assert_eq!((brought.samples.len(), brought.head.len()), (2, 0));
    }
}

#[test]
fn a_sampled_lobe_has_the_mean_cosine_of_its_density() {
    // Of exp(κ(cos γ − 1)): coth κ − 1/κ, κ = 2/λ².
    let exact = |lambda: f64| {
        let kappa = 2.0 / (lambda * lambda);
        1.0 / kappa.tanh() - 1.0 / kappa
    };
    for lambda in [0.02, 0.1, 0.3, 0.7, 1.5, 4.0] {
        for axis in [Vec3::Y, Vec3::new(-0.3, 0.2, -0.9)] {
            let light = light(axis, lambda);
            let mean = |directions: Vec<DVec3>| {
                let count = directions.len() as f64;
                assert!(directions.iter().all(|d| (d.length() - 1.0).abs() < 1e-12));
                directions.into_iter().sum::<DVec3>() / count
            };
            let fine = mean(sample_lobe(&light, 4096));
            // Relative to what tells lobes apart: 1 − cosine is λ²/2 for a narrow one, and the cosine itself is
            // small for a wide one.
            let spread = (1.0 - exact(lambda)).min(exact(lambda));
            let along = fine.dot(light.direction);
            assert!((along - exact(lambda)).abs() < 2e-3 * spread, "λ = {lambda}: {along}");
            assert!(fine.reject_from_normalized(light.direction).length() < 2e-3 * spread.sqrt());
            let wider = exact(1.02 * lambda);
            assert!((along - wider).abs() > 2e-3 * spread, "2 % more λ is told apart");
            // The few that transport takes: the tail costs a little.
            let few = lobe_directions(&light);
            let few_mean = mean(few.clone()).dot(light.direction);
            assert!((few_mean - exact(lambda)).abs() < 0.02, "λ = {lambda}: {few_mean}");
            assert_eq!(few.len(), ((12.0 * lambda * lambda).ceil() as usize).clamp(1, 6));
        }
    }
}

/// Parallel fibres along x, at random places of −4…4 in y and 0…1 in z, and then probes below them.
struct Fibres {
    stage: Geometry,
    /// First point of each probe.
    probes: Vec<usize>,
}

const FIBRE_DIAMETER: f32 = 0.001;

impl Fibres {
    fn new(fibres: usize, probes: usize) -> Fibres {
        let mut random = Random(4);
        let mut hair = Hair { offsets: vec![0], ..Hair::default() };
        let mut strand = |a: Vec3, b: Vec3| {
            let first = hair.points.len();
            hair.points.extend([a, b]);
            hair.offsets.push(first as u32 + 2);
            first
        };
        for _ in 0..fibres {
            let (y, z) = (random.within(-4.0, 4.0), random.unit());
            strand(Vec3::new(-4.0, y, z), Vec3::new(4.0, y, z));
        }
        let probes = (0..probes)
            .map(|_| {
                let p = Vec3::new(random.within(-1.0, 1.0), random.within(-1.0, 1.0), -0.5);
                strand(p, p + 0.001 * Vec3::X)
            })
            .collect();
        hair.thickness = Some(vec![1.0; hair.points.len()]);
        Fibres { stage: Geometry::new(hair, None, FIBRE_DIAMETER), probes }
    }

    /// T̃ by rays, and by the volume, averaged over the probes.
    fn transmittance(&self, light: &SrbfLight) -> [f64; 2] {
        let Geometry { hair, diameters, .. } = &self.stage;
        let strands = RealStrands::new(&self.stage);
        let count = self.probes.len() as f64;
        let rays = self.probes.iter().map(|&p| strands.transmittance(p, light, 16)).sum::<f64>();
        let segments = hair.offsets.windows(2).map(|ends| {
            let a = ends[0] as usize;
            (hair.points[a], hair.points[a + 1], diameters[a])
        });
        let (low, high) = hair.bounds();
        let volume = volume_of(segments, [low, high], 64);
        let occluders = Occluders { volume: &volume, head: None };
        let points: Vec<Vec3> = self.probes.iter().map(|&p| hair.points[p]).collect();
        let through = occluders.transmittance(light, &points);
        [rays / count, through.iter().map(|&t| f64::from(t)).sum::<f64>() / count]
    }
}

#[test]
fn delta_t_counts_lights_that_shine_and_tells_where_light_arrives() {
    let slab = Fibres::new(400, 600);
    let strands = RealStrands::new(&slab.stage);
    let points: Vec<u32> = (0..slab.stage.hair.points.len() as u32).collect();
    // Along the fibres all light arrives, across them part of it; the brightest light does not shine.
    let mut lights = [Vec3::X, Vec3::Z, Vec3::NEG_Z, Vec3::Y].map(|to| light(to, 0.02));
    lights[3].rgb = [0.0; 3];
    lights[1].rgb = [20.0; 3];
    // From before the sheet.
    let lens = Lens {
        eye: glam::DVec3::new(0.0, 0.0, 4.0),
        forward: glam::DVec3::NEG_Z,
        right: glam::DVec3::X,
        up: glam::DVec3::Y,
        distance: 4.0,
        size: [256, 256],
    };
    let exact = |j: usize, k: usize| strands.transmittance(points[k] as usize, &lights[j], 256);
    let of = |off: &(dyn Fn(usize, f64) -> f64 + Sync), points: &[u32]| {
        strands.delta_t(&lens, points, &lights, |j, k| off(j, exact(j, k)), 512).unwrap()
    };
    let same = of(&|_, t| t, &points);
    assert_eq!((same.mean, same.mean_abs, same.weighted_abs), (0.0, 0.0, 0.0));
    assert_eq!(same.mean_lit, Some(0.0));
    // A frame that knows nothing of the light that does not shine is as good.
    assert_eq!(of(&|j, t| if j == 3 { 0.0 } else { t }, &points), same);
    let darker = of(&|_, t| t - 0.1, &points);
    assert!((darker.mean + 0.1).abs() < 1e-6 && (darker.mean_abs - 0.1).abs() < 1e-6);
    assert!((darker.mean_lit.unwrap() + 0.1).abs() < 1e-6);
    // Light 1 has nearly all energy, but is a third of the lights that shine.
    let one = of(&|j, t| if j == 1 { t - 0.1 } else { t }, &points);
    assert!((one.mean + 0.1 / 3.0).abs() < 0.01, "{one:?}");
    assert!((one.weighted_abs / darker.weighted_abs - 20.0 / 24.0).abs() < 0.15, "{one:?}");
    assert_eq!(strands.delta_t(&lens, &points, &[lights[3]], exact, 512), None);
}

/// T̃ of each light at all points of a stage, by `times` the usual rays: on the CPU, or on the device.
fn traced(stage: &Geometry, lights: &[SrbfLight], times: f64, device: bool) -> Vec<Vec<f64>> {
    traced_by(stage, lights, times, device, false).0
}

/// The same; with `counts` the second words too.
fn traced_by(
    stage: &Geometry,
    lights: &[SrbfLight],
    times: f64,
    device: bool,
    counts: bool,
) -> (Vec<Vec<f64>>, Vec<Vec<[f32; 3]>>) {
    let fibre = FibreSpec::default().resolve();
    let method = match counts {
        true => MethodData::xu(&fibre, 4, Energies::Quadrature),
        false => MethodData::fast(&fibre, Model::Marschner, 2),
    };
    let mut renderer = Renderer::new(cpu(), &method, stage).unwrap();
    renderer.trace_on_device = device;
    renderer.set_lights(&[], lights, &[], times);
    let points: Vec<u32> = (0..stage.hair.points.len() as u32).collect();
    let rays = StrandRays::new(stage);
    let host = (!device).then_some(&rays);
    assert!(renderer.trace(stage, &points, host, &|_| true).unwrap());
    let words = renderer.traced_words(&points).unwrap();
    let share = |&[counts, _]: &[u32; 2]| {
        assert!(counts >> 16 > 0, "a pair without rays");
        f64::from(counts & 0xffff) / f64::from(counts >> 16)
    };
    let t = words.iter().map(|of| of.iter().map(share).collect()).collect();
    let means = words.iter().map(|of| of.iter().map(|w| unpack_means(w[1])).collect()).collect();
    (t, means)
}

#[test]
fn the_device_traces_what_its_twin_traces() {
    let mut scene = Scene::default();
    scene.hair.strands = 1000;
    let stage = Geometry::load(&scene).unwrap();
    let lights = [
        light(Vec3::new(0.3, 0.8, 0.5), 0.05),
        light(Vec3::new(-0.6, 0.2, 0.7), 0.36),
        light(Vec3::new(0.1, -0.9, -0.4), 0.9),
        light(Vec3::new(1.0, 0.1, 0.0), 0.01),
    ];
    for counts in [false, true] {
        let (host, host_means) = traced_by(&stage, &lights, 0.5, false, counts);
        let (device, device_means) = traced_by(&stage, &lights, 0.5, true, counts);
        let pairs = || host.iter().flatten().zip(device.iter().flatten());
        let differ = pairs().filter(|(a, b)| (**a - **b).abs() > 1e-9).count();
        let share = differ as f64 / pairs().count() as f64;
        let mean = |of: &[Vec<f64>]| of.iter().flatten().sum::<f64>() / pairs().count() as f64;
        println!(
            "counts {counts}: {share:.4} of pairs differ; T̃ {:.4} {:.4}",
            mean(&host),
            mean(&device)
        );
        // Rounding decides where a ray just misses or meets a strand.
        assert!(share < 0.02, "{share}");
        assert!((mean(&host) - mean(&device)).abs() < 1e-3);
        for k in 0..3 {
            let mean = |of: &[Vec<[f32; 3]>]| {
                let all = of.iter().flatten();
                all.map(|m| f64::from(m[k])).sum::<f64>() / pairs().count() as f64
            };
            let (a, b) = (mean(&host_means), mean(&device_means));
            println!("  moment {k}: {a:.4} {b:.4}");
            assert!((a - b).abs() < 0.01, "moment {k}: {a} {b}");
            assert!(!counts || a > 0.05);
        }
    }
    // The control: light from elsewhere.
    let host = traced(&stage, &lights[..1], 0.5, false);
    let other = traced(&stage, &[light(Vec3::new(0.8, 0.3, 0.5), 0.05)], 0.5, true);
    let differ = host[0].iter().zip(&other[0]).filter(|(a, b)| a != b).count();
    assert!(differ as f64 > 0.1 * host[0].len() as f64, "{differ}");
}

#[test]
fn transmittance_of_few_strands_is_what_geometry_says() {
    let strand = |points: &[Vec3], hair: &mut Hair| {
        hair.points.extend(points);
        hair.offsets.push(hair.points.len() as u32);
    };
    let straight =
        |a: Vec3, b: Vec3| (0..=8).map(|k| a.lerp(b, k as f32 / 8.0)).collect::<Vec<_>>();
    // A lone strand is in nobody's shade.
    let mut hair = Hair { offsets: vec![0], ..Hair::default() };
    strand(&straight(Vec3::NEG_X, Vec3::X), &mut hair);
    hair.thickness = Some(vec![1.0; hair.points.len()]);
    let lone = Geometry::new(hair.clone(), None, 0.1);
    let lights = [light(Vec3::Z, 0.01), light(Vec3::Y, 0.5), light(Vec3::X, 0.1)];
    for device in [false, true] {
        let all = traced(&lone, &lights, 1.0, device);
        assert!(all.iter().flatten().all(|&t| t == 1.0), "{device}: {all:?}");
    }
    // Another one crosses above its middle: of a segment of ¼ it shades its diameter's share, and where half of a point's
    // reach lies beneath, half of that.
    strand(&straight(Vec3::new(0.0, -1.0, 0.5), Vec3::new(0.0, 1.0, 0.5)), &mut hair);
    hair.thickness = Some(vec![1.0; hair.points.len()]);
    let crossed = Geometry::new(hair, None, 0.1);
    for device in [false, true] {
        let t = traced(&crossed, &[light(Vec3::Z, 0.001)], 40.0, device);
        let exact = |point: usize| if point == 4 { 1.0 - 0.1 / 0.25 } else { 1.0 };
        for (point, &t) in t[0][..9].iter().enumerate() {
            assert!((t - exact(point)).abs() < 0.01, "{device}, point {point}: {t}");
        }
        assert!(t[0][9..].iter().all(|&t| t == 1.0), "the upper one is in the light");
    }
}

/// Light across a sheet of parallel fibres at random places: each point of a fibre beneath sees all or nothing, e^−τ of
/// them all, so the variance from fibre to fibre is that of a coin.
#[test]
fn a_sheet_of_fibres_lets_through_the_right_mean_and_variance() {
    for tau in [0.5, 1.5] {
        let slab = Fibres::new((tau * 8.0 / FIBRE_DIAMETER) as usize, 1500);
        let exact = f64::from(-tau).exp();
        for device in [false, true] {
            let t = traced(&slab.stage, &[light(Vec3::Z, 1e-5)], 0.2, device);
            let probes: Vec<f64> = slab.probes.iter().map(|&probe| t[0][probe]).collect();
            let mean = probes.iter().sum::<f64>() / probes.len() as f64;
            let variance =
                probes.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / probes.len() as f64;
            println!("τ {tau}: {mean:.3} for {exact:.3}, variance {variance:.3}");
            assert!((mean - exact).abs() < 0.035, "{mean} for {exact}");
            assert!((variance - exact * (1.0 - exact)).abs() < 0.03, "{variance}");
        }
        // A volume has the mean, and none of the variance.
        let [_, volume] = slab.transmittance(&light(Vec3::Z, 0.001));
        assert!((volume - exact).abs() < 0.035);
    }
}

#[test]
fn rays_go_to_lights_by_their_energy() {
    let powers: Vec<f64> = [8.0, 1.0, 0.01, 0.0].into_iter().chain([0.1; 48]).collect();
    let rays = Rays::of(&powers, 48, 1.0);
    let density = |rays: &Rays| f64::from(rays.count) / f64::from(rays.points);
    let all: Vec<f64> = rays.iter().map(density).collect();
    assert!(all[0] > all[1] && all[1] > all[2] && all[2] >= all[3] && all[3] > 0.0, "{all:?}");
    assert!(rays[4..].iter().all(|other| *other == rays[4]));
    // Turned, wide light falls on other ordinates.
    let mut turned = powers.clone();
    turned[4..].iter_mut().enumerate().for_each(|(k, p)| *p = if k < 24 { 0.2 } else { 0.0 });
    assert_eq!(Rays::of(&turned, 48, 1.0), rays);
    let more: f64 = Rays::of(&powers, 48, 4.0).iter().map(density).sum();
    let ratio = more / all.iter().sum::<f64>();
    assert!((3.0..5.0).contains(&ratio), "{ratio}");
}

#[test]
fn rays_and_volume_find_the_transmittance_of_random_parallel_fibres() {
    let tau = 1.0;
    let fibres = (tau * 8.0 / FIBRE_DIAMETER) as usize;
    let slab = Fibres::new(fibres, 1500);
    // Poisson crossings: τ is fibres by area, times diameter, path, and sine to the fibres.
    for (omega, tau) in [
        (Vec3::Z, tau),
        (Vec3::new(0.0, 1.0, 1.0), tau * 2f32.sqrt()),
        (Vec3::new(1.0, 0.0, 1.0), tau),
        (Vec3::new(0.0, -1.0, 2.0), tau * 1.25f32.sqrt()),
        (Vec3::NEG_Z, 0.0),
    ] {
        let exact = f64::from((-tau).exp());
        // Some 1,500 independent places each open or shut: a standard deviation of at most 0.013.
        for (way, found) in ["rays", "volume"].iter().zip(slab.transmittance(&light(omega, 0.02))) {
            assert!((found - exact).abs() < 0.035, "{omega} by {way}: {found} for {exact}");
        }
    }
    // Forward transmittance of Poisson crossings: d_f (e^{−τ(1−ā_f)} − e^{−τ}).
    let strands = RealStrands::new(&slab.stage);
    let forward = |a_f: f64| {
        let of =
            |&p: &usize| strands.forward_transmittance(p, &light(Vec3::Z, 0.02), 16, |_| [a_f; 3]);
        slab.probes.iter().map(|p| of(p)[0]).sum::<f64>() / slab.probes.len() as f64
    };
    for a_f in [0.0, 0.5, 0.9f64] {
        let exact = D_F * (f64::exp(a_f - 1.0) - (-1f64).exp());
        let found = forward(a_f);
        assert!((found - exact).abs() < 0.025, "ā_f {a_f}: {found} for {exact}");
        assert!(
            (forward(a_f + 0.1) - exact).abs() > 0.025 || a_f < 0.5,
            "a tenth more is told apart"
        );
    }
    for found in Fibres::new(fibres * 5 / 4, 1500).transmittance(&light(Vec3::Z, 0.02)) {
        let off = (found - f64::from((-tau).exp())).abs();
        assert!(off > 0.035, "a quarter more fibres is told apart: {found}");
    }
}

/// A square floor of 2 × 2 at y = 0 whose corners alone are vertices.
fn floor() -> Head {
    let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
    Head {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        normals: vec![Vec3::Y; 4],
        triangles: vec![[0, 2, 1], [0, 3, 2]],
    }
}

#[test]
fn a_fine_head_is_the_same_surface_with_short_edges() {
    for (head, longest) in [(floor(), 0.1), (sphere(), 0.03)] {
        let fine = FineHead::new(&head, longest);
        let Head { positions, normals, triangles } = &fine.head;
        let edge = |a: u32, b: u32| positions[a as usize].distance(positions[b as usize]);
        let area = |head: &Head| -> f64 {
            let of = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|i| head.positions[i as usize].as_dvec3());
                0.5 * (b - a).cross(c - a).length()
            };
            head.triangles.iter().map(of).sum()
        };
        let mut sides = std::collections::HashMap::new();
        for t in triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                assert!(edge(a, b) <= longest * 1.0001);
                // Each side of a pair runs the other way.
                *sides.entry((a.min(b), a.max(b))).or_insert(0) += if a < b { 1 } else { -1 };
            }
        }
        let inner = sides.values().filter(|&&sum| sum == 0).count();
        assert!(inner as f64 > 0.9 * sides.len() as f64, "sides meet: {inner} of {}", sides.len());
        assert!((area(&fine.head) / area(&head) - 1.0).abs() < 1e-5);
        assert!(normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
        assert_eq!(fine.head.positions[..head.positions.len()], head.positions);
        // What is linear over the floor stays so.
        let values: Vec<Vec3> = head.positions.iter().map(|&p| 2.0 * p + Vec3::ONE).collect();
        let spread = fine.spread(&values);
        let off = spread.iter().zip(positions).map(|(v, &p)| v.distance(2.0 * p + Vec3::ONE));
        assert!(spread.len() > 4 * head.positions.len());
        assert!(off.fold(0.0, f32::max) < 1e-4);
        // The control: what there was is too long.
        assert!(head.triangles.iter().any(|t| {
            head.positions[t[0] as usize].distance(head.positions[t[1] as usize]) > longest
        }));
    }
}

/// A strand above a floor, and the light straight above: a dark line as wide as the strand. In a frame the device and its
/// twin agree.
#[test]
fn a_strand_throws_a_crisp_shadow_on_the_head() {
    let mut hair = Hair { offsets: vec![0], ..Hair::default() };
    hair.points.extend((0..=16).map(|k| Vec3::new(0.0, 0.5, k as f32 / 8.0 - 1.0)));
    hair.offsets.push(17);
    hair.thickness = Some(vec![1.0; 17]);
    let stage = Geometry::new(hair, Some(floor()), 0.2);
    let rays = StrandRays::new(&stage);
    let above = light(Vec3::Y, 0.01);
    let looked_for = HeadLight {
        light: TracedLight { rays: 16, ..TracedLight::distant(&above) },
        rgb: Vec3::ONE,
        energy: lobe_integral(above.lambda) as f32,
        wide: 0,
        pad: [0; 3],
    };
    let at = |x: f32| {
        let position = Vec3::new(x, 0.0, 0.3) - stage.center;
        let vertex = HeadVertex::new(position, Vec3::Y, 0, 1);
        rays.irradiance(&vertex, [1e-4, 0.0], &looked_for) / looked_for.energy
    };
    for x in [0.0, 0.05, -0.08] {
        assert_eq!(at(x), 0.0, "{x} lies beneath it");
    }
    for x in [0.12, -0.3, 0.9] {
        assert!((at(x) - 1.0).abs() < 1e-3, "{x}: {}", at(x));
    }
    // The same in a frame, from above; dark lights are ordinates.
    let lights = [vec![above], split_wide(&[])].concat();
    let medium = HairMedium::new(&stage, true);
    let lit = medium.bring(&stage, lights, &[0, 1, 2], &|_| true).unwrap();
    let lens = Lens {
        eye: DVec3::new(0.0, 6.0, 0.0),
        forward: DVec3::NEG_Y,
        right: 0.25 * DVec3::X,
        up: 0.25 * DVec3::NEG_Z,
        distance: 6.0,
        size: [64, 64],
    };
    let method = MethodData::fast(&FibreSpec::default().resolve(), Model::Marschner, 2);
    let frame = |device: bool| {
        let mut renderer = Renderer::new(cpu(), &method, &stage).unwrap();
        renderer.trace_on_device = device;
        let at = (&stage, &medium);
        lit.show(at, &mut renderer, &method, None, 1.0, &|_| true).unwrap();
        let parts = Parts { single: true, global: true, local: true };
        renderer.render(&lens, 4, Background::Transparent, parts).unwrap().pixels
    };
    let [host, device] = [false, true].map(frame);
    let off = host.iter().flatten().zip(device.iter().flatten()).map(|(a, b)| (a - b).abs());
    let most = host.iter().flatten().copied().fold(0.0, f32::max);
    let off = off.sum::<f32>() / (host.len() as f32 * most);
    println!("device and CPU differ by {off:.1e} of the brightest");
    assert!(off < 1e-3, "{off}");
    // Across the floor: dark where the strand's shadow is, with no more than two pixels between.
    let row: Vec<f32> = (0..64).map(|x| host[32 * 64 + x][0]).collect();
    let full = row[20];
    let middle = &row[16..48];
    let between = middle.iter().filter(|&&v| v > 0.1 * full && v < 0.9 * full).count();
    assert!(full > 0.0 && between <= 4 && row.iter().all(|&v| v >= 0.0), "{row:?}");
}
