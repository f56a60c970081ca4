//! The path tracer: geometry by analytic cases, light by quadrature, transport by furnace and z-tests.

use std::f64::consts::TAU;
use std::sync::atomic::{AtomicU32, Ordering};

use glam::{DMat3, DVec3, Vec3};
use hairlight::environment::Environment;
use hairlight::hair::{Frames, Hair};
use hairlight::head::Head;
use hairlight::paint::Fibres;
use hairlight::reference::Models;
use hairlight::reference::model::{
    Detector, Direction, Evaluation, FibreModel, Path, Sample, Section,
};
use hairlight::reference::tracer::film::Film;
use hairlight::reference::tracer::light::Light;
use hairlight::reference::tracer::skin::Skin;
use hairlight::reference::tracer::strands::{StrandRay, Strands};
use hairlight::reference::tracer::{Sampling, TraceScene, trace};
use hairlight::scene::{FibreSpec, Lens};
use hairlight::srbf::SrbfLight;

/// Reflects as a mirror would at h, blurred by exp(κ cos) over the sphere: `albedo` leaves, whatever ω_o and h.
pub(super) struct BlurredMirror {
    kappa: f64,
    albedo: f64,
    near_field: bool,
    /// Spoils what is evaluated in this range of h.
    bad_above: f64,
}

pub(super) const MIRROR: BlurredMirror =
    BlurredMirror { kappa: 2.0, albedo: 1.0, near_field: true, bad_above: 2.0 };

impl BlurredMirror {
    fn centre(o: &Direction, h: f64) -> DVec3 {
        Direction::new(-o.theta(), o.phi - 2.0 * h.asin()).vector()
    }

    /// ∫ exp(κ(cos − 1)) over the sphere.
    fn integral(&self) -> f64 {
        -TAU * (-2.0 * self.kappa).exp_m1() / self.kappa
    }
}

impl FibreModel for BlurredMirror {
    fn lobes(&self) -> usize {
        1
    }
    fn longitudinal(&self, _: usize, _: f64, _: f64) -> f64 {
        unreachable!("not of the path tracer")
    }
    fn path(&self, _: usize, _: f64, _: &Section) -> Path {
        unreachable!("not of the path tracer")
    }
    fn detector(&self, _: usize) -> Detector {
        Detector::Uniform
    }
    fn azimuthal(&self, _: usize, _: f64, _: &Section) -> [f64; 3] {
        unreachable!("not of the path tracer")
    }
    fn evaluate(&self, o: &Direction, i: &Direction, h: f64) -> Evaluation {
        let cosine = Self::centre(o, h).dot(i.vector());
        let pdf = (self.kappa * (cosine - 1.0)).exp() / self.integral();
        let spoilt = if h > self.bad_above { f64::NAN } else { 1.0 };
        Evaluation { f_cos: [self.albedo * pdf * spoilt; 3], pdf }
    }
    fn sample(&self, o: &Direction, h: f64, u: [f64; 4]) -> Option<Sample> {
        let centre = Self::centre(o, h);
        let cos = 1.0 + (u[0] * (-2.0 * self.kappa).exp_m1()).ln_1p() / self.kappa;
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let (x, y) = centre.any_orthonormal_pair();
        let (s, c) = (TAU * u[1]).sin_cos();
        let direction = Direction::of(cos * centre + sin * (c * x + s * y));
        Some(Sample { direction, value: self.evaluate(o, &direction, h) })
    }
    fn near_field(&self) -> bool {
        self.near_field
    }
}

pub(super) fn uniform_map(rgb: [f32; 3]) -> Environment {
    Environment::new(4, 2, vec![rgb; 8])
}

/// A sky with a small sun aside, and no symmetry.
fn sunny_map() -> Environment {
    let (width, height) = (32, 16);
    let pixels = (0..width * height)
        .map(|i| {
            let (column, row) = (i % width, i / width);
            let sky = 0.2 + 0.03 * (height - row) as f32 + 0.02 * (column as f32 / 3.0).sin();
            let sun = if row == 4 && (20..22).contains(&column) { 40.0 } else { 0.0 };
            [sky + sun, sky + 0.9 * sun, 1.3 * sky + 0.7 * sun]
        })
        .collect();
    Environment::new(width, height, pixels)
}

pub(super) fn hair_of(strands: &[Vec<Vec3>]) -> Hair {
    let mut hair = Hair { offsets: vec![0], ..Hair::default() };
    for strand in strands {
        hair.points.extend(strand);
        hair.offsets.push(hair.points.len() as u32);
    }
    hair
}

/// Looks from `eye` to the origin, with y up; `half` is the image's half side at the origin.
pub(super) fn lens(eye: DVec3, half: f64) -> Lens {
    let (distance, forward) = (eye.length(), -eye.normalize());
    let right = forward.cross(DVec3::Y).normalize();
    let side = half / distance;
    let (right, up) = (side * right, side * right.cross(forward));
    Lens { eye, forward, right, up, distance, size: [0; 2] }
}

/// Crossed fibres within the unit ball, close enough that a path meets several.
pub(super) fn tuft() -> Hair {
    let strands: Vec<Vec<Vec3>> = (0..300)
        .map(|i| {
            let t = i as f32;
            let middle = 0.6 * Vec3::new((1.3 * t).sin(), (2.1 * t).sin(), (2.9 * t).sin());
            let along = Vec3::new((0.7 * t).cos(), (1.1 * t).sin(), (1.7 * t).cos()).normalize();
            let bend = 0.15 * along.any_orthonormal_vector();
            (-2..=2)
                .map(|k| k as f32 * 0.2 * along + (k * k) as f32 * 0.1 * bend + middle)
                .collect()
        })
        .collect();
    hair_of(&strands)
}

pub(super) struct Stage {
    hair: Hair,
    frames: Frames,
    diameters: Vec<f32>,
}

impl Stage {
    pub(super) fn new(hair: Hair, diameter: f32) -> Self {
        let frames = Frames::new(&hair);
        let diameters = vec![diameter; hair.points.len()];
        Self { hair, frames, diameters }
    }

    pub(super) fn strands(&self, parts: u32) -> Strands<'_> {
        Strands::new(&self.hair, &self.diameters, &self.frames, parts, Vec3::ZERO)
    }
}

/// A small render of strands alone.
#[derive(Clone, Copy)]
pub(super) struct Shot<'a> {
    pub(super) strands: &'a Strands<'a>,
    pub(super) light: &'a Light<'a>,
    pub(super) models: &'a Models<'a>,
    pub(super) lens: Lens,
    pub(super) size: [u32; 2],
    pub(super) sampling: Sampling,
    pub(super) max_depth: u32,
    pub(super) seed: u32,
}

impl<'a> Shot<'a> {
    pub(super) fn new(
        strands: &'a Strands<'a>,
        light: &'a Light<'a>,
        models: &'a Models<'a>,
    ) -> Self {
        Shot {
            strands,
            light,
            models,
            lens: lens(DVec3::new(1.0, 2.0, 5.0), 0.8),
            size: [24, 24],
            sampling: Sampling::Both,
            max_depth: u32::MAX,
            seed: 7,
        }
    }

    pub(super) fn scene(&self) -> TraceScene<'a> {
        TraceScene {
            strands: self.strands,
            skin: None,
            light: self.light,
            models: self.models,
            lens: Lens { size: self.size, ..self.lens },
            sampling: self.sampling,
            max_depth: self.max_depth,
            seed: self.seed,
        }
    }

    pub(super) fn render(&self, samples: u32) -> Film {
        let mut film = Film::new(self.size);
        assert!(trace(&self.scene(), &mut film, samples, &|_| true).unwrap());
        film
    }
}

/// Sum of a channel over the pixels that `keep` holds for, and its variance.
pub(super) fn total(film: &Film, channel: usize, keep: impl Fn(usize) -> bool) -> (f64, f64) {
    let pixels = (0..film.pixels.len()).filter(|&i| keep(i));
    pixels.fold((0.0, 0.0), |(sum, variance), i| {
        (sum + film.mean(i)[channel], variance + film.variance(i)[channel])
    })
}

/// Pixels that are covered, partly covered ones in part.
fn covered(film: &Film) -> f64 {
    (0..film.pixels.len()).map(|i| film.mean(i)[3]).sum()
}

/// The difference of two estimates in standard deviations.
pub(super) fn z_score(a: (f64, f64), b: (f64, f64)) -> f64 {
    (a.0 - b.0) / (a.1 + b.1).sqrt()
}

#[test]
fn a_furnace_of_lossless_fibres_is_the_maps_colour() {
    let stage = Stage::new(tuft(), 0.06);
    let strands = stage.strands(2);
    let color = [0.5, 1.0, 2.0];
    let map = uniform_map(color.map(|c| c as f32));
    let light = Light::map(&map, 0.3, 1.0).unwrap();
    // Deviation over the pixels that hair covers whole, in shares of the colour and in standard deviations.
    let furnace = |albedo: f64| {
        let model = BlurredMirror { albedo, ..MIRROR };
        let models = Models::even(&model);
        let film = Shot::new(&strands, &light, &models).render(64);
        let whole = |i: usize| film.mean(i)[3] == 1.0;
        let count = (0..film.pixels.len()).filter(|&i| whole(i)).count() as f64;
        assert!(count > 100.0, "only {count} pixels are covered");
        let bounces = film.segments as f64 / (film.pixels.len() as f64 * 64.0);
        println!("{count} pixels, {bounces:.1} rays a sample");
        let each = [0, 1, 2].map(|c| {
            let (sum, variance) = total(&film, c, whole);
            let wanted = (count * color[c], 0.0);
            (sum / wanted.0 - 1.0, z_score((sum, variance), wanted))
        });
        let worst = |part: fn(&(f64, f64)) -> f64| each.iter().map(part).fold(0.0, f64::max);
        (worst(|e| e.0.abs()), worst(|e| e.1.abs()))
    };
    let (error, z) = furnace(1.0);
    println!("furnace: off by {error:.1e}, {z:.2} standard deviations");
    assert!(z < 4.0 && error < 0.01);
    let (error, z) = furnace(0.98);
    println!("with 2 % lost an event: off by {error:.1e}, {z:.2} standard deviations");
    assert!(z > 4.0 && error > 0.01);
}

#[test]
fn light_and_fibre_sampling_agree() {
    let stage = Stage::new(tuft(), 0.05);
    let strands = stage.strands(1);
    let map = sunny_map();
    let lights = [Light::map(&map, 0.8, 1.0).unwrap(), Light::map(&map, 0.8, 1.1).unwrap()];
    let mirror = BlurredMirror { albedo: 0.8, ..MIRROR };
    // Above 1 a lobe is another towards the eye.
    let mut tinted = FibreSpec { intensity_r: 3.0, intensity_tt: 0.0, ..FibreSpec::default() };
    (tinted.tint_trt, tinted.beta_r_deg) = ([1.0, 0.5, 0.3], 20.0);
    let fibres = Fibres::new(&tinted, None);
    for (name, models, samples) in
        [("mirror", Models::even(&mirror), 96), ("tinted", Models::new(&tinted, &fibres), 512)]
    {
        let render = |sampling, light| {
            Shot { sampling, max_depth: 4, ..Shot::new(&strands, light, &models) }.render(samples)
        };
        let by_light = render(Sampling::Light, &lights[0]);
        let worst = |other: &Film| {
            // Four quarters of the image, three channels.
            let quarter = |i: usize| 2 * (i / 288) + usize::from(i % 24 >= 12);
            let of = |film, part, c| total(film, c, |i| quarter(i) == part);
            (0..12)
                .map(|k| z_score(of(&by_light, k / 3, k % 3), of(other, k / 3, k % 3)).abs())
                .fold(0.0, f64::max)
        };
        let fibre = worst(&render(Sampling::Fibre, &lights[0]));
        let both = worst(&render(Sampling::Both, &lights[0]));
        let control = worst(&render(Sampling::Both, &lights[1]));
        println!(
            "{name}: z of light against fibre {fibre:.2}, both {both:.2}; of 10 % more light {control:.2}"
        );
        // Twelve normal deviates exceed 4 in one of 1300 cases.
        assert!(fibre < 4.0 && both < 4.0 && control > 4.0, "{name}");
    }
}

#[test]
fn the_error_falls_as_the_root_of_the_samples() {
    let stage = Stage::new(tuft(), 0.05);
    let strands = stage.strands(1);
    let map = sunny_map();
    let light = Light::map(&map, 0.0, 1.0).unwrap();
    let model = BlurredMirror { albedo: 0.7, ..MIRROR };
    let models = Models::even(&model);
    let shot = |seed| Shot { seed, size: [10, 10], ..Shot::new(&strands, &light, &models) };
    let truth = shot(1).render(2048);
    // Root mean square error, measured and as the film itself has it.
    let errors = |samples: u32, seed: u32| {
        let film = shot(seed).render(samples);
        let (mut square, mut own) = (0.0, 0.0);
        for i in 0..film.pixels.len() {
            square += (film.mean(i)[1] - truth.mean(i)[1]).powi(2);
            own += film.variance(i)[1];
        }
        let count = film.pixels.len() as f64;
        ((square / count).sqrt(), (own / count).sqrt())
    };
    let ((coarse, coarse_own), (fine, fine_own)) = (errors(16, 2), errors(256, 2));
    let power = (coarse / fine).ln() / 16f64.ln();
    println!(
        "error {coarse:.4} → {fine:.4}, power {power:.3}; own {coarse_own:.4} → {fine_own:.4}"
    );
    // Sobol points may do better than independent ones, never worse; the rest is noise of 100 pixels.
    assert!((0.45..0.75).contains(&power));
    for (error, own) in [(coarse, coarse_own), (fine, fine_own)] {
        assert!((0.5..1.15).contains(&(error / own)), "{error} beside {own}");
    }
    // Samples of one seed again bring nothing.
    let (again, _) = errors(16, 2);
    assert!((coarse / again).ln() / 16f64.ln() < 0.45);
}

#[test]
fn threads_and_runs_do_not_change_the_image() {
    let stage = Stage::new(tuft(), 0.05);
    let strands = stage.strands(1);
    let map = sunny_map();
    let light = Light::map(&map, 0.0, 1.0).unwrap();
    let models = Models::even(&MIRROR);
    let shot = Shot { size: [37, 21], ..Shot::new(&strands, &light, &models) };
    let threads = |count: usize, render: &(dyn Fn() -> Film + Sync)| {
        rayon::ThreadPoolBuilder::new().num_threads(count).build().unwrap().install(render)
    };
    let once = threads(1, &|| shot.render(20));
    assert_eq!(once, threads(2, &|| shot.render(20)));
    let mut film = shot.render(3);
    trace(&shot.scene(), &mut film, 20, &|_| true).unwrap();
    assert_eq!(once, film);
    assert_ne!(once.pixels, Shot { seed: 8, ..shot }.render(20).pixels);

    // A render that is stopped keeps whole passes, and can go on.
    let tiles = AtomicU32::new(0);
    let mut film = Film::new(shot.size);
    let stop = |_: f32| tiles.fetch_add(1, Ordering::Relaxed) < 7;
    assert!(!trace(&shot.scene(), &mut film, 20, &stop).unwrap());
    assert!((1..20).contains(&film.samples), "{}", film.samples);
    assert_eq!(film, shot.render(film.samples));
    trace(&shot.scene(), &mut film, 20, &|_| true).unwrap();
    assert_eq!(once, film);

    let mut wrong = Film { size: [9, 9], ..Film::new([8, 8]) };
    assert!(trace(&shot.scene(), &mut wrong, 1, &|_| true).is_err());
}

#[test]
fn a_strand_covers_its_width() {
    let map = uniform_map([1.0; 3]);
    let light = Light::map(&map, 0.0, 1.0).unwrap();
    let (a, b) = (Vec3::new(-0.5, -0.3, 0.0), Vec3::new(0.4, 0.45, 0.0));
    // In pixels of a 16² image of a square of side 1.28, seen from straight before it; 0.31 pixels wide.
    let wanted = f64::from(a.distance(b)) * 0.025 / 0.08f64.powi(2);
    let off = |strand: Vec<Vec3>, width: [f32; 2], center: Vec3| {
        let strand: Vec<Vec3> = strand.iter().map(|p| p + center).collect();
        let last = strand.len() - 1;
        let mut stage = Stage::new(hair_of(&[strand]), width[0]);
        stage.diameters[last] = width[1];
        let strands = Strands::new(&stage.hair, &stage.diameters, &stage.frames, 1, center);
        let models = Models::even(&MIRROR);
        let shot = Shot {
            lens: lens(DVec3::new(0.0, 0.0, 30.0), 0.64),
            size: [16, 16],
            max_depth: 0,
            ..Shot::new(&strands, &light, &models)
        };
        let film = shot.render(2048);
        let hair: f64 = (0..film.pixels.len()).map(|i| film.hair_coverage(i)).sum();
        assert_eq!(hair, covered(&film));
        hair / wanted - 1.0
    };
    let far = Vec3::new(64.0, -128.0, 96.0);
    let middle = a.lerp(b, 0.375);
    let cases = [
        ("one segment", off(vec![a, b], [0.025; 2], Vec3::ZERO)),
        ("two segments and a point twice", off(vec![a, middle, middle, b], [0.025; 2], Vec3::ZERO)),
        ("tapered", off(vec![a, b], [0.04, 0.01], Vec3::ZERO)),
        ("far from the origin", off(vec![a, b], [0.025; 2], far)),
    ];
    for (name, error) in cases {
        println!("{name}: coverage off by {error:+.2e}");
        // Samples are too few for more: the cases differ from each other as much.
        assert!(error.abs() < 6e-3);
    }
    let wider = off(vec![a, b], [0.0253; 2], Vec3::ZERO);
    println!("1.2 % wider: {wider:+.2e}");
    assert!(wider.abs() > 6e-3);
}

/// Where a ray meets the strands, if it does.
fn meet(strands: &Strands, ray: &StrandRay) -> Option<DVec3> {
    assert_eq!(strands.closest(ray).is_some(), strands.occluded(ray));
    strands.closest(ray).map(|id| strands.fibre_point(id, ray).axis_point)
}

#[test]
fn joints_are_tight_ends_flat_and_fibres_have_no_inside() {
    // A right angle, drawn straight: both tangents at the ends lie along their pieces.
    let bent = vec![Vec3::new(-1.0, 0.0, 0.0), Vec3::ZERO, Vec3::new(0.0, -1.0, 0.0)];
    let stage = Stage::new(hair_of(&[bent]), 0.2);
    let strands = stage.strands(1);
    let down = |x: f32, y: f32| StrandRay::free(Vec3::new(x, y, 3.0), -Vec3::Z);
    for k in 0..64 {
        let (sin, cos) = (k as f32 / 64.0 * std::f32::consts::TAU).sin_cos();
        let around = |radius: f32| meet(&strands, &down(radius * cos, radius * sin));
        assert!(around(0.099).is_some(), "a gap at the joint, {k}");
        let outside = cos > 0.0 && sin > 0.0;
        assert_eq!(around(0.101).is_none(), outside || cos > 0.99 || sin > 0.99, "{k}");
    }
    assert!(meet(&strands, &down(-0.999, 0.05)).is_some());
    assert!(meet(&strands, &down(-1.001, 0.05)).is_none());
    assert!(meet(&strands, &down(0.05, -0.999)).is_some());
    assert!(meet(&strands, &down(0.05, -1.001)).is_none());
    let inside = StrandRay::free(Vec3::new(-0.5, 0.02, 0.01), Vec3::Z);
    assert!(meet(&strands, &inside).is_none());
    // Light that leaves a fibre misses it near by, and meets it again farther off.
    let ray = down(-0.2, 0.0);
    let point = strands.fibre_point(strands.closest(&ray).unwrap(), &ray);
    assert!(meet(&strands, &point.leave(DVec3::new(1.0, -1.0, 0.0).normalize())).is_none());
    let ray = down(-0.6, 0.0);
    let point = strands.fibre_point(strands.closest(&ray).unwrap(), &ray);
    assert!(meet(&strands, &point.leave(DVec3::new(1.0, -1.0, 0.0).normalize())).is_some());
    let free = StrandRay::free(Vec3::new(-0.2, -0.3, 0.0), Vec3::Y);
    assert!(meet(&strands, &free).is_some());
}

#[test]
fn the_tree_finds_what_a_search_finds() {
    let tuft = tuft();
    let line = (0..20_000).map(|i| Vec3::new(0.3, -1.0 + 1e-4 * i as f32, 0.4)).collect();
    let chain = |i: i32| vec![Vec3::ZERO, 2f32.powi(i) * Vec3::new(1.0, -1.0, 0.5)];
    let mut strands: Vec<Vec<Vec3>> = tuft.polylines().map(<[Vec3]>::to_vec).collect();
    strands.push(line);
    strands.extend((-60..0).map(chain));
    // Equal strands, which no plane parts.
    strands.extend(vec![strands[0].clone(); 20_000]);
    let distinct: Vec<Stage> =
        strands[..361].iter().map(|s| Stage::new(hair_of(std::slice::from_ref(s)), 0.05)).collect();
    let alone: Vec<Strands> = distinct.iter().map(|stage| stage.strands(1)).collect();
    let stage = Stage::new(hair_of(&strands), 0.05);
    let all = stage.strands(1);
    let (mut met, mut spoilt) = (0, 0);
    for k in 0..200 {
        let t = k as f32;
        let from = 3.0 * Vec3::new(t.sin(), (1.7 * t).cos(), (2.3 * t).sin()).normalize();
        let to = 0.8 * Vec3::new((3.1 * t).sin(), (4.7 * t).sin(), (5.3 * t).sin());
        let ray = StrandRay::free(from, (to - from).normalize());
        let far = |point: DVec3| point.distance(from.as_dvec3());
        let nearest = |strands: &[Strands]| {
            let hits = strands.iter().filter_map(|one| meet(one, &ray)).map(far);
            hits.fold(f64::INFINITY, f64::min)
        };
        // The nearest entry's axis may lie a radius deeper than another's.
        let differs = |d: f64| match meet(&all, &ray).map(far) {
            Some(found) => (found - d).abs() > 0.05,
            None => d.is_finite(),
        };
        assert!(!differs(nearest(&alone)), "ray {k}");
        met += u32::from(nearest(&alone).is_finite());
        spoilt += u32::from(differs(nearest(&alone[..200])));
    }
    println!("{met} of 200 rays meet a strand; {spoilt} differ from a search of a part");
    assert!(met > 50 && spoilt > 5);
}

#[test]
fn h_is_where_the_ray_meets_the_fibre() {
    let axis = Vec3::new(0.3, 1.0, -0.2);
    let stage = Stage::new(hair_of(&[vec![-axis, axis]]), 0.1);
    let strands = stage.strands(3);
    let mut worst = (0.0f64, 0.0f64);
    for k in 0..40 {
        let (sin, cos) = (k as f64 * 0.7).sin_cos();
        let eye = DVec3::new(3.0 * cos, 1.2 * sin, 3.0 * sin);
        let aim = DVec3::new(0.045 * (k as f64).sin(), 0.3 * cos, 0.02);
        let d = (aim - eye).normalize();
        let ray = StrandRay::free(eye.as_vec3(), d.as_vec3());
        let Some(id) = strands.closest(&ray) else { continue };
        let point = strands.fibre_point(id, &ray);
        let u = axis.as_dvec3().normalize();
        // Where the ray enters the cylinder, by its quadratic.
        let (p, q) = (eye.reject_from_normalized(u), d.reject_from_normalized(u));
        let half = p.dot(q) / q.length_squared();
        let rest = (p.length_squared() - 0.05f64.powi(2)) / q.length_squared();
        let n = (p - (half + (half * half - rest).sqrt()) * q) / 0.05;
        let mirrored = d - 2.0 * d.dot(n) * n;
        let local = |v: DVec3| Direction::of(point.frame.transpose() * v);
        let phi = local(mirrored).phi - local(-d).phi;
        let off = |h: f64| ((phi + 2.0 * h.asin()) / 2.0).sin().abs();
        worst = (worst.0.max(off(point.h)), worst.1.max(off(-point.h)));
    }
    println!("azimuth of the mirror's direction off by {:.1e}; with −h by {:.1}", worst.0, worst.1);
    assert!(worst.0 < 1e-3 && worst.1 > 0.5);
}

#[test]
fn a_model_that_fails_stops_the_render_with_its_inputs() {
    let stage = Stage::new(tuft(), 0.05);
    let strands = stage.strands(1);
    let map = uniform_map([1.0; 3]);
    let light = Light::map(&map, 0.0, 1.0).unwrap();
    let model = BlurredMirror { bad_above: 0.999, ..MIRROR };
    let models = Models::even(&model);
    let shot = Shot::new(&strands, &light, &models);
    let mut film = Film::new(shot.size);
    let error = trace(&shot.scene(), &mut film, 256, &|_| true).unwrap_err();
    let line = format!("{error:#}");
    println!("{line}");
    assert!(!line.contains('\n'));
    for part in ["pixel (", "sample ", "theta_o", "phi_o", "theta_i", "phi_i", "h 0.999", "NaN"] {
        assert!(line.contains(part), "no {part:?} in {line}");
    }
    let good = Models::even(&MIRROR);
    assert_eq!(film, Shot::new(&strands, &light, &good).render(film.samples));
}

#[test]
fn one_fibre_far_away_scatters_what_quadrature_says() {
    let axis = Vec3::new(0.3, 1.0, 0.4).normalize();
    let stage = Stage::new(hair_of(&[vec![-axis, axis]]), 0.4);
    let strands = stage.strands(1);
    let map = sunny_map();
    let rotation = 1.9;
    let light = Light::map(&map, rotation, 1.0).unwrap();
    let eye = 2000.0 * DVec3::new(0.4, 0.1, 1.0).normalize();
    let u = axis.as_dvec3();
    let frame = DMat3::from_cols(u, u.any_orthonormal_pair().0, u.any_orthonormal_pair().1);
    let o = Direction::of(frame.transpose() * eye.normalize());
    for near_field in [true, false] {
        let model = BlurredMirror { albedo: 0.7, kappa: 1.5, near_field, ..MIRROR };
        let models = Models::even(&model);
        // ½∫∫ f_cos L dω dh over 8 × 8 places of every pixel of the map.
        let fine = Environment::new(256, 128, Vec::new());
        let turn = DMat3::from_rotation_y(rotation);
        let mut truth = 0.0;
        for place in 0..256 * 128 {
            let (column, row) = (place % 256, place / 256);
            let i = Direction::of(frame.transpose() * (turn * fine.pixel_direction(column, row)));
            let radiance = f64::from(map.pixels[row / 8 * map.width + column / 8][0]);
            for k in 0..32 {
                let f_cos = model.evaluate(&o, &i, (k as f64 - 15.5) / 16.0).f_cos[0];
                truth += fine.solid_angle(row) * radiance / 32.0 * f_cos;
            }
        }
        // The fibre leaves the image above and below, so that every h is seen alike.
        let film = Shot {
            lens: lens(eye, 0.6),
            size: [8, 8],
            max_depth: 1,
            ..Shot::new(&strands, &light, &models)
        }
        .render(2048);
        let covered = covered(&film);
        let (sum, variance) = total(&film, 0, |_| true);
        let z = |truth: f64| z_score((sum, variance), (covered * truth, 0.0));
        println!("{:.4}, by quadrature {truth:.4}: z {:.2}", sum / covered, z(truth));
        println!("of 3 % more: z {:.2}", z(1.03 * truth));
        assert!(z(truth).abs() < 4.0 && z(1.03 * truth).abs() > 4.0);
    }
}

#[test]
fn a_convex_head_reflects_its_albedo() {
    // An octahedron with flat faces.
    let sign = |bit: usize| if bit == 0 { 1.0 } else { -1.0 };
    let mut head = Head::default();
    for k in 0..8 {
        let corner = Vec3::new(sign(k & 1), sign(k & 2), sign(k & 4));
        head.positions.extend([Vec3::X, Vec3::Y, Vec3::Z].map(|axis| corner * axis));
        head.normals.extend([corner.normalize(); 3]);
        head.triangles.push([0, 1, 2].map(|i| 3 * k as u32 + i));
    }
    let albedo = Vec3::new(0.2, 0.5, 0.9);
    let skin = Skin::new(&head, albedo, Vec3::ZERO);
    let hairs = |count: usize| {
        let strand = |i: usize| {
            let side = Vec3::new((i as f32).cos(), (1.7 * i as f32).sin(), (2.3 * i as f32).sin());
            vec![side.normalize(), 1.4 * side.normalize()]
        };
        Stage::new(hair_of(&(0..count).map(strand).collect::<Vec<_>>()), 0.05)
    };
    let map = uniform_map([2.0; 3]);
    let light = Light::map(&map, 0.0, 1.0).unwrap();
    let render = |stage: &Stage, sampling| {
        let strands = stage.strands(1);
        let models = Models::even(&MIRROR);
        let shot = Shot { sampling, ..Shot::new(&strands, &light, &models) };
        let scene = TraceScene {
            skin: Some(&skin),
            lens: Lens { size: shot.size, ..lens(DVec3::new(3.0, 2.0, 5.0), 1.2) },
            ..shot.scene()
        };
        let mut film = Film::new(shot.size);
        trace(&scene, &mut film, 64, &|_| true).unwrap();
        film
    };
    let film = render(&hairs(0), Sampling::Both);
    let covered = covered(&film);
    for (c, albedo) in albedo.as_dvec3().to_array().into_iter().enumerate() {
        let z = |wanted: f64| z_score(total(&film, c, |_| true), (2.0 * wanted * covered, 0.0));
        println!("albedo {albedo:.1}: z {:.2}; of 3 % more: {:.1}", z(albedo), z(1.03 * albedo));
        assert!(z(albedo).abs() < 4.0 && z(1.03 * albedo).abs() > 4.0);
    }
    // Hair before and behind: two ways to sample, one picture.
    let stage = hairs(300);
    let [light, fibre] = [Sampling::Light, Sampling::Fibre].map(|s| render(&stage, s));
    let z = z_score(total(&light, 1, |_| true), total(&fibre, 1, |_| true));
    let bare = z_score(total(&light, 1, |_| true), total(&film, 1, |_| true));
    println!("light against fibre: z {z:.2}; against the bare head {bare:.1}");
    assert!(z.abs() < 4.0 && bare.abs() > 4.0);
}

/// ∫ of radiance times 1, x, y and z of the world over the sphere, by a fine grid and by the light's own samples.
fn moments(light: &Light) -> [[f64; 4]; 2] {
    let grid = Environment::new(512, 256, Vec::new());
    let mut sums = [[0.0; 4]; 2];
    let mut total_pdf = 0.0;
    for place in 0..512 * 256 {
        let (column, row) = (place % 512, place / 512);
        let omega = grid.pixel_direction(column, row);
        let radiance = light.radiance(omega);
        total_pdf += grid.solid_angle(row) * light.pdf(radiance);
        for (k, factor) in [1.0, omega.x, omega.y, omega.z].into_iter().enumerate() {
            sums[0][k] += grid.solid_angle(row) * radiance.x * factor;
        }
    }
    assert!((total_pdf - 1.0).abs() < 2e-3, "∫pdf = {total_pdf}");
    let count = 1u32 << 16;
    for i in 0..count {
        let u =
            [(f64::from(i) + 0.5) / f64::from(count), f64::from(i.reverse_bits()) / 2f64.powi(32)];
        let Some(sample) = light.sample(u) else { continue };
        assert!((sample.direction.length() - 1.0).abs() < 1e-9);
        let factors = [1.0, sample.direction.x, sample.direction.y, sample.direction.z];
        for (k, factor) in factors.into_iter().enumerate() {
            sums[1][k] += sample.radiance.x / sample.pdf * factor / f64::from(count);
        }
    }
    sums
}

#[test]
fn lights_are_sampled_as_they_shine() {
    let map = sunny_map();
    let lobe = |x: f64, y: f64, lambda: f64, red: f64| SrbfLight {
        direction: DVec3::new(x, y, 0.4).normalize(),
        lambda,
        rgb: [red, 0.5, 0.1],
    };
    let lobes = [lobe(1.0, 0.2, 0.15, 8.0), lobe(-0.3, 0.8, 0.9, 1.0), lobe(0.1, -1.0, 2.5, 0.3)];
    let lights =
        [("map", Light::map(&map, 0.9, 1.7).unwrap()), ("lobes", Light::lobes(&lobes).unwrap())];
    for (name, light) in lights {
        let [grid, drawn] = moments(&light);
        let error = |k: usize| ((grid[k] - drawn[k]) / grid[0]).abs();
        let worst = (0..4).map(error).fold(0.0, f64::max);
        println!("{name}: moments {grid:.3?}, drawn {drawn:.3?}: off by {worst:.1e}");
        assert!(worst < 3e-3);
        assert!((1..4).any(|k| grid[k].abs() > 0.02 * grid[0]), "nothing to tell apart");
    }
    let energy: f64 = lobes.iter().map(|light| light.energy()[0]).sum();
    let [grid, _] = moments(&Light::lobes(&lobes).unwrap());
    assert!((grid[0] / energy - 1.0).abs() < 1e-3);

    // One bright pixel stands where the rotation turns it, whichever way it is asked for.
    let mut one = uniform_map([0.0; 3]);
    one.pixels[2] = [1.0, 2.0, 3.0];
    let light = Light::map(&one, 0.7, 2.0).unwrap();
    let turn = DMat3::from_rotation_y(0.7);
    assert_eq!(light.radiance(turn * one.pixel_direction(2, 0)), DVec3::new(2.0, 4.0, 6.0));
    assert_eq!(light.radiance(turn * one.pixel_direction(1, 0)), DVec3::ZERO);
    let drawn = light.sample([0.5, 0.5]).unwrap();
    assert!((drawn.pdf * one.solid_angle(0) - 1.0).abs() < 1e-6);
    assert!((turn.transpose() * drawn.direction).dot(one.pixel_direction(2, 0)) > 0.9);

    let black = uniform_map([0.0; 3]);
    let black = Light::map(&black, 0.0, 1.0).unwrap();
    assert!(black.sample([0.3, 0.7]).is_none() && black.pdf(black.radiance(DVec3::X)) == 0.0);
    assert!(Light::lobes(&[]).unwrap().sample([0.3, 0.7]).is_none());
    assert!(Light::map(&uniform_map([f32::NAN; 3]), 0.0, 1.0).is_err());
}
