//! Quality: from a wanted error or frame time to lights, samples, rays and what is left out; and, for any of these, the
//! error to expect of a frame against path tracing.
//!
//! The error is a relative L2 over hair, the root of the sum of squares of its causes. Each has a law of few numbers,
//! calibrated on the builtin bob, black, blond and white, under studio, sunset and overcast, path traced at 120×90
//! (tests/quality.rs: expected over measured is 0.77 to 1.81).
//!
//! - fit: the fit's own error after a blur of λ = 0.3. With ten lights instead of forty a frame of black hair under
//!   studio is 4.5 % further off, and the fit 4.0 %.
//! - integrals: of the method, tests/fast.rs. With two nodes `fast` is far below the other causes, so nodes are not
//!   among the settings.
//! - transmittance: the noise of few rays, which pixels of many strands even out, and shadows finer than a segment.
//! - multiple scattering: by the share of light that a fibre keeps alive; and the noise of the paths that gather it and the
//!   sky, by how uneven the sky is and how much of the light is narrow.
//! - points: what a strand shows between its points, which pale hair evens out.
//! - coverage: by samples, and less for wider strands.
//! - skipping: `Renderer::negligible`.
//!
//! Not among them: the parts that a wide light is split into (28 or 120: no frame differs in its error).

use std::fmt;
use std::time::Instant;

use anyhow::Result;
use serde::Serialize;

use crate::gpu::Gpu;
use crate::gpu::frame::{NEGLIGIBLE, Renderer};
use crate::gpu::method::{Integrator, MethodData, tables_over};
use crate::gpu::probe::{INPUTS, Probe};
use crate::light::PATHS_PER_POINT;
use crate::scattering::azimuthal::FitLayers;
use crate::scattering::fast::Fast;
use crate::scattering::fibre::Fibre;
use crate::scattering::model::Model;
use crate::scene::{Lens, Scene, Target};
use crate::srbf::{self, ORDINATES, SrbfLight};
use crate::transport::draws::RAYS_A_POINT;

/// What error is bought with.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// Fitted to the map.
    pub lights: u32,
    /// Of coverage a pixel.
    pub samples: u32,
    /// For T̃, times as many as are usual at 64 samples.
    pub rays: f64,
    /// `Renderer::negligible`.
    pub negligible: f64,
}

impl Settings {
    /// Those of a scene that asks for no quality.
    pub fn of(scene: &Scene) -> Settings {
        let samples = scene.render.samples.unwrap_or(64);
        Settings {
            lights: scene.environment.lights.unwrap_or(40),
            samples,
            rays: rays_for(samples),
            negligible: NEGLIGIBLE,
        }
    }
}

/// Rays of a frame, times as many as at 64 samples: they grow with the samples of a pixel, and are never fewer.
pub(crate) fn rays_for(samples: u32) -> f64 {
    f64::from(samples.max(64)) / 64.0
}

/// What is chosen from.
const LIGHTS: [u32; 8] = [4, 6, 10, 16, 24, 40, 64, 96];
const SAMPLES: [u32; 4] = [4, 16, 64, 256];
const RAYS: [f64; 4] = [0.5, 1.0, 4.0, 16.0];
const NEGLIGIBLES: [f64; 3] = [1e-3, 1e-2, 3e-2];

/// Lights of the fit that tells how hard a map is.
pub const TRIAL_LIGHTS: usize = 10;
/// By which power of its lights a fit gets better.
const FIT_POWER: f64 = 1.3;

/// A frame's error by cause, each a relative L2.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Expected {
    pub total: f64,
    pub fit: f64,
    pub integrals: f64,
    pub transmittance: f64,
    pub multiple: f64,
    pub points: f64,
    pub coverage: f64,
    pub skipping: f64,
}

impl fmt::Display for Expected {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let percent = |x: f64| format!("{:.*} %", usize::from(x < 0.0995), 100.0 * x);
        write!(
            f,
            "{} = fit {} ⊕ integrals {} ⊕ transmittance {} ⊕ multiple {} ⊕ points {} ⊕ coverage {} ⊕ skipping {}",
            percent(self.total),
            percent(self.fit),
            percent(self.integrals),
            percent(self.transmittance),
            percent(self.multiple),
            percent(self.points),
            percent(self.coverage),
            percent(self.skipping)
        )
    }
}

/// What the error of a frame depends on beside its settings.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Facts {
    /// Root mean square over mean of the light after a blur of λ = 0.3; 1 for even light.
    pub contrast: f64,
    /// Root mean square of the sky about its mean, over the mean of all light.
    pub sky: f64,
    /// Share of all light that narrow lights send.
    pub narrow: f64,
    /// Share of light that a fibre scatters.
    pub albedo: f64,
    /// Of a strand in the picture, at its thickest.
    pub width_px: f64,
    /// Whether light counts that more than one strand has scattered.
    #[serde(skip)]
    pub multiple: bool,
    #[serde(skip)]
    pub integrator: Integrator,
}

impl Facts {
    pub fn new(method: &MethodData, lights: &[SrbfLight], width_px: f64, multiple: bool) -> Self {
        /// Points that stand for painted hair.
        const JUDGED: usize = 64;
        let integrator = method.integrator;
        let model = match integrator {
            Integrator::Fast(model) => model,
            Integrator::Xu => Model::Marschner,
        };
        let fibres = method.fibres.sample(JUDGED);
        let tables = match &method.twin {
            Some(tables) => tables.clone(),
            None => tables_over(&FitLayers::new(method.fibres.base()), model, 2),
        };
        let albedo =
            |fibre: &Fibre| Fast::new(&fibre.passed_on(), model, &tables).albedo(MEAN_INCLINATION);
        let sum: f64 = fibres.iter().flat_map(albedo).sum();
        let albedo = sum / (3 * fibres.len()) as f64;
        let sky = &lights[lights.len().saturating_sub(ORDINATES)..];
        let [mean, root] = moments(lights, BLUR);
        let [sky_mean, sky_root] = moments(sky, 0.0);
        let contrast = if mean > 0.0 { root / mean } else { 1.0 };
        let mean = mean.max(f64::MIN_POSITIVE);
        let sky = (sky_root * sky_root - sky_mean * sky_mean).max(0.0).sqrt() / mean;
        let narrow = (1.0 - sky_mean / mean).clamp(0.0, 1.0);
        Facts { contrast, sky, narrow, albedo, width_px, multiple, integrator }
    }

    /// The error of a frame whose fit is `fit` off.
    pub fn expected(&self, settings: &Settings, fit: f64) -> Expected {
        // Pale hair evens out lights, edges and most of all shadows.
        let pale = 1.0 - 0.75 * self.albedo;
        let fit = pale * fit;
        let transmittance = pale.powf(1.5)
            * self.contrast.powf(CONTRAST_POWER)
            * RAY_ERROR
            * settings.rays.powf(-RAY_POWER);
        let kept = self.albedo * self.contrast.powf(MULTIPLE_POWER);
        let multiple = match (self.multiple, self.integrator) {
            (true, Integrator::Xu) => XU_MULTIPLE_ERROR * kept,
            (true, Integrator::Fast(_)) => MULTIPLE_ERROR * kept,
            (false, _) => 0.0,
        };
        let paths = match self.integrator {
            Integrator::Xu => 0.0,
            Integrator::Fast(_) => {
                let [sky, narrow] = PATH_ERROR;
                (sky * self.sky).hypot(narrow * self.narrow) * settings.rays.powf(-0.5)
            }
        };
        let multiple = multiple.hypot(paths);
        let points = POINT_ERROR * pale * pale;
        let thin = (0.1 / self.width_px.max(1e-3)).powf(0.8).clamp(0.1, 3.0);
        let coverage = pale * COVERAGE_ERROR * thin * f64::from(settings.samples).powf(-0.8);
        let integrals = match self.integrator {
            Integrator::Xu => 0.1,
            Integrator::Fast(_) => 0.006,
        };
        let skipping = settings.negligible;
        let causes = [fit, integrals, transmittance, multiple, points, coverage, skipping];
        let total = causes.iter().map(|e| e * e).sum::<f64>().sqrt();
        Expected { total, fit, integrals, transmittance, multiple, points, coverage, skipping }
    }
}

/// The inclination that stands for light from everywhere, radians.
const MEAN_INCLINATION: f64 = 0.5;
/// Of black hair under even light, of the usual rays, and how it falls with more.
const RAY_ERROR: f64 = 0.02;
const RAY_POWER: f64 = 0.4;
const CONTRAST_POWER: f64 = 0.5;
/// Of a fibre that loses nothing, under even light: by `fast` and by `xu`.
const MULTIPLE_ERROR: f64 = 0.025;
const XU_MULTIPLE_ERROR: f64 = 0.3;
/// Of the usual paths: under a sky that is off its mean by the mean of all light, and by narrow lights alone.
const PATH_ERROR: [f64; 2] = [0.08, 0.12];
/// Of hair that sends no light to other hair.
const POINT_ERROR: f64 = 0.115;
const MULTIPLE_POWER: f64 = 0.65;
/// Of black hair of a tenth of a pixel at one sample.
const COVERAGE_ERROR: f64 = 0.9;

/// A path costs as much as so many pairs of a point and a light, on lavapipe.
const PATH_PAIRS: f64 = 12.0;

/// What a frame costs on this device.
#[derive(Clone, Copy, Debug)]
pub struct Costs {
    /// Of a pair of a point and a light.
    pub pair_ns: f64,
    /// Of a path that is gathered; 0 where none is.
    pub path_ns: f64,
    /// Of finding what is seen at four samples, and the points found.
    pub visibility_ms: f64,
    pub points: usize,
    /// Lights that a fit's wide ones add by being split.
    pub split: usize,
}

impl Costs {
    /// Those of frames like the one through `lens`, in `pieces` straight pieces a segment, with the `lights` that a fit
    /// of [`TRIAL_LIGHTS`] is shaded as; from small runs.
    ///
    /// # Errors
    /// One line: what the device says is wrong.
    pub fn of_device(
        renderer: &mut Renderer,
        method: &MethodData,
        lens: &Lens,
        pieces: u32,
        lights: usize,
    ) -> Result<Costs> {
        let (visibility_ms, points) =
            quickest(|| Ok(renderer.visible_points(&[*lens], pieces, 4)?.len()))?;
        let pair_ns = measure_pair_ns(&renderer.gpu, method)?;
        let path_ns = if method.twin.is_some() { PATH_PAIRS * pair_ns } else { 0.0 };
        let split = lights.saturating_sub(TRIAL_LIGHTS);
        Ok(Costs { visibility_ms, pair_ns, path_ns, points, split })
    }

    /// Those by which [`Self::frame_ms`] of `settings` is what a frame of `points` points took: `shade_ms` of it for
    /// shading by `lights` lights, some of them parts of others, `gather_ms` for paths, and `rest_ms` for all else.
    pub fn measured(
        settings: &Settings,
        points: usize,
        lights: usize,
        [shade_ms, gather_ms, rest_ms]: [f64; 3],
    ) -> Costs {
        let split = lights.saturating_sub(settings.lights as usize);
        let one = Costs { pair_ns: 1.0, path_ns: 1.0, visibility_ms: 1.0, points, split };
        let [rest, shade, gather] = one.parts_ms(settings);
        // Of the points at four samples.
        let points = points as f64 / (f64::from(settings.samples.max(4)) / 4.0).powf(0.25);
        let more = one.points as f64 / points;
        let (pair_ns, path_ns) = (shade_ms / shade * more, gather_ms / gather * more);
        let visibility_ms = rest_ms / rest;
        Costs { pair_ns, path_ns, visibility_ms, points: points as usize, split }
    }

    fn lights(&self, settings: &Settings) -> f64 {
        f64::from(settings.lights) + self.split as f64
    }

    /// Milliseconds of a frame.
    pub fn frame_ms(&self, settings: &Settings) -> f64 {
        self.parts_ms(settings).iter().sum()
    }

    /// The same: what is rasterised, what is shaded, and what is gathered.
    fn parts_ms(&self, settings: &Settings) -> [f64; 3] {
        let samples = f64::from(settings.samples.max(4)) / 4.0;
        // More samples find a few more points; of pairs of a point and a light 1e-3 keeps some two thirds.
        let points = self.points as f64 * samples.powf(0.25);
        let kept = 0.65 - 0.1 * (settings.negligible / NEGLIGIBLE).ln() / 10f64.ln();
        // The frame rasterises what is seen alone.
        [
            0.5 * self.visibility_ms * samples.powf(0.8),
            1e-6 * self.pair_ns * points * self.lights(settings) * kept,
            1e-6 * self.path_ns * points * PATHS_PER_POINT * settings.rays,
        ]
    }

    /// Milliseconds that rank settings: the lights are taken to stand still for thirty frames.
    fn rank(&self, settings: &Settings) -> f64 {
        // 0.3 µs a ray.
        let rays_ms = 1e-3 * 0.3 * RAYS_A_POINT * settings.rays * self.points as f64;
        self.frame_ms(settings) + rays_ms / 30.0
    }
}

/// What was picked for a target.
#[derive(Clone, Copy, Debug)]
pub struct Pick {
    pub settings: Settings,
    pub expected: Expected,
    pub frame_ms: f64,
    /// Whether the target is met.
    pub reached: bool,
}

/// The cheapest settings that reach the target, or the cheapest of those that come nearest to it; what the scene sets
/// stays. `trial` is the error of a fit of [`TRIAL_LIGHTS`].
pub fn pick(scene: &Scene, target: Target, facts: &Facts, costs: &Costs, trial: f64) -> Pick {
    let lights = scene.environment.lights.map_or(LIGHTS.to_vec(), |n| vec![n]);
    let samples = scene.render.samples.map_or(SAMPLES.to_vec(), |n| vec![n]);
    let trial = (TRIAL_LIGHTS as u32, trial);
    let mut all = choices(&lights, &samples, facts, costs, trial);
    for pick in &mut all {
        pick.reached = match target {
            Target::Error(most) => pick.expected.total <= most,
            Target::FrameMs(most) => pick.frame_ms <= most,
        };
    }
    if all.iter().any(|pick| pick.reached) {
        all.retain(|pick| pick.reached);
        if let Target::Error(_) = target {
            return cheapest(&all, costs);
        }
    } else if let Target::FrameMs(_) = target {
        return all.iter().copied().min_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms)).expect("some");
    }
    // A hundredth more error is no reason to pay.
    let least = all.iter().map(|pick| pick.expected.total).fold(f64::INFINITY, f64::min);
    all.retain(|pick| pick.expected.total <= 1.01 * least);
    cheapest(&all, costs)
}

/// All settings with these lights and samples; `fit` is a number of lights and the error of their fit.
fn choices(
    lights: &[u32],
    samples: &[u32],
    facts: &Facts,
    costs: &Costs,
    fit: (u32, f64),
) -> Vec<Pick> {
    let mut all = Vec::new();
    for &lights in lights {
        let fit = fit.1 * (f64::from(fit.0) / f64::from(lights)).powf(FIT_POWER);
        for &samples in samples {
            for rays in RAYS {
                for negligible in NEGLIGIBLES {
                    let settings = Settings { lights, samples, rays, negligible };
                    let expected = facts.expected(&settings, fit);
                    let frame_ms = costs.frame_ms(&settings);
                    all.push(Pick { settings, expected, frame_ms, reached: true });
                }
            }
        }
    }
    all
}

/// What can be had at best: settings than which no others are expected to be both faster and nearer to the truth, the
/// fastest first. `fit` is a number of lights and the error of their fit.
pub fn front(facts: &Facts, costs: &Costs, fit: (u32, f64)) -> Vec<Pick> {
    let mut all = choices(&LIGHTS, &SAMPLES, facts, costs, fit);
    all.sort_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms));
    let mut least = f64::INFINITY;
    all.retain(|pick| {
        let better = pick.expected.total < least;
        least = least.min(pick.expected.total);
        better
    });
    all
}

fn cheapest(picks: &[Pick], costs: &Costs) -> Pick {
    let rank = |pick: &Pick| costs.rank(&pick.settings);
    picks.iter().copied().min_by(|a, b| rank(a).total_cmp(&rank(b))).expect("some")
}

impl Pick {
    /// What was picked, on one line.
    pub fn line(&self, target: Target) -> String {
        let Settings { lights, samples, rays, negligible } = self.settings;
        let wanted = match target {
            Target::Error(e) => format!("an error of {:.1} %", 100.0 * e),
            Target::FrameMs(ms) => format!("{ms} ms"),
        };
        let short = match target {
            _ if self.reached => "",
            Target::Error(_) => {
                "; that is out of a frame's reach: `hairlight reference` gets there"
            }
            Target::FrameMs(_) => "; that is out of this device's reach",
        };
        format!(
            "for {wanted}: {lights} lights, {samples} samples, {rays} × rays, {:.1} % negligible; expecting {:.0} ms \
             and {}{short}",
            100.0 * negligible,
            self.frame_ms,
            self.expected
        )
    }
}

/// Bandwidth by which hair blurs what it sees.
const BLUR: f64 = 0.3;

/// Mean and root mean square over directions of what lights send, its channels together, blurred by this bandwidth.
fn moments(lights: &[SrbfLight], blur: f64) -> [f64; 2] {
    const DIRECTIONS: usize = 512;
    let blurred: Vec<SrbfLight> = lights
        .iter()
        .map(|light| {
            let lambda = light.lambda.hypot(blur);
            let scale = srbf::lobe_integral(light.lambda) / srbf::lobe_integral(lambda);
            SrbfLight { lambda, rgb: light.rgb.map(|c| c * scale), ..*light }
        })
        .collect();
    let even = SrbfLight { direction: glam::DVec3::Y, lambda: 1e4, rgb: [1.0; 3] };
    let (mut sum, mut squares) = (0.0, 0.0);
    for omega in srbf::sample_lobe(&even, DIRECTIONS) {
        let radiance = srbf::radiance(&blurred, omega).iter().sum::<f64>();
        sum += radiance;
        squares += radiance * radiance;
    }
    [sum / DIRECTIONS as f64, (squares / DIRECTIONS as f64).sqrt()]
}

/// Nanoseconds of a pair of a point and a light on this device, from one small run.
fn measure_pair_ns(gpu: &Gpu, method: &MethodData) -> Result<f64> {
    const POINTS: usize = 2048;
    const PAIRS: usize = 16;
    let statement = format!(
        "let strand = strand_at(fibre, x[0].x);
        for (var k = 0u; k < {PAIRS}u; k++) {{
            let arrival = Arrival(x[0].y, x[0].z - 0.2 * f32(k), x[0].w, 0.4, 0.5, vec3f(1.0), 0.0,
                TransmittanceMoments(0.3, 0.74, 1.0, 0.5), vec3f(0.1));
            y[0] += vec4f(light_scattering(fibre, strand, arrival, PARTS), 0.0);
        }}"
    );
    let spread = |i: usize, a: f64| ((i as f64 * a).fract() * 2.0 - 1.0) as f32;
    let inputs: Vec<[f32; INPUTS]> = (0..POINTS)
        .map(|i| {
            let (theta_o, theta_j) = (1.2 * spread(i, 0.7549), 1.2 * spread(i, 0.5698));
            [theta_o, theta_j, 3.1 * spread(i, 0.6180), spread(i, 0.4142), 0.0, 0.0, 0.0, 0.0]
        })
        .collect();
    let probe = Probe::new(gpu, &statement, method, &inputs)?;
    let (ms, ()) = quickest(|| {
        probe.dispatch();
        gpu.wait()
    })?;
    Ok(1e6 * ms / (POINTS * PAIRS) as f64)
}

/// Milliseconds of the quickest of three runs, and its result; the first compiles.
fn quickest<T>(mut run: impl FnMut() -> Result<T>) -> Result<(f64, T)> {
    let mut timed = || {
        let begun = Instant::now();
        let result = run()?;
        anyhow::Ok((1e3 * begun.elapsed().as_secs_f64(), result))
    };
    let mut best = timed()?;
    for _ in 0..2 {
        let next = timed()?;
        if next.0 < best.0 {
            best = next;
        }
    }
    Ok(best)
}
