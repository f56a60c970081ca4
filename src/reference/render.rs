//! `hairlight reference`: a scene in, its path-traced truth out.
//!
//! The picture is an EXR file that can be gone on with: beside R, G, B, A and `hair`, which mean what they mean
//! in a captured frame, it holds `variance.R`, `.G`, `.B` (of each pixel's mean), and as attributes the number
//! of samples and what they are samples of.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};

use super::Models;
use super::tracer::film::Film;
use super::tracer::light::Light;
use super::tracer::skin::Skin;
use super::tracer::strands::Strands;
use super::tracer::{Sampling, TraceScene, trace};
use crate::environment::{Environment, LightMeter};
use crate::file::read_picture_bytes;
use crate::image::{Format, write_display};
use crate::openexr::{self, ExrFile};
use crate::paint::Fibres;
use crate::progress::{Clock, Reporting, Unfinished};
use crate::quality::Settings;
use crate::scene::{Background, FIELDS, Lens, Scene};
use crate::srbf;
use crate::stage::{Geometry, exposure_scale, load_map, place_lights};

/// Raise this whenever the same scene would get other samples.
const VERSION: u32 = 3;
const SAMPLES: &str = "hairlight.samples";
const SEGMENTS: &str = "hairlight.segments";
const IDENTITY: &str = "hairlight.identity";

/// What lights the hair, beside lamps, which are as they are either way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lighting {
    /// The environment map itself.
    Map,
    /// The SRBF lights that the renderer fits to it.
    Srbf,
}

/// What is asked of a reference beside its scene.
pub struct ReferenceOptions {
    /// Samples a pixel, all runs together.
    pub spp: u32,
    /// Most scattering events of a path; 1 is direct light alone.
    pub max_depth: u32,
    pub lighting: Lighting,
    pub sampling: Sampling,
    pub seed: u32,
    /// Go on with the picture that is there.
    pub resume: bool,
    pub reporting: Reporting<'static>,
}

/// Path traces the scene and writes what its output asks for. A cancelled run writes the samples it has, if
/// the output is an EXR.
pub fn run(scene: &Scene, options: &ReferenceOptions) -> Result<()> {
    let path = Path::new(&scene.output.path);
    let format = Format::of(path)?;
    ensure!(
        format == Format::Exr || !options.resume,
        "{}: only an .exr picture holds what --resume goes on with",
        path.display()
    );
    scene.check_outputs(&[path])?;
    let mut clock = Clock::new(options.reporting);
    let stage = Geometry::load(scene)?;
    stage.notes.iter().for_each(|line| clock.note(line));
    let map = load_map(&scene.environment, &clock)?.environment;
    let lens = stage.camera(scene)?.lens(stage.center, scene.output.size);
    let pieces = stage.pieces(&lens);
    let rotation = scene.environment.rotation_deg.to_radians();
    let gain = 2f64.powf(scene.environment.exposure);
    let fibres = stage.fibres(scene)?;
    let identity = identity(scene, options, &map, &stage, &fibres);
    let mut film = match options.resume {
        true => resume(path, scene, &map, &lens, &identity)?,
        false => Film::new(scene.output.size),
    };
    clock.step("scene")?;

    let light = match options.lighting {
        Lighting::Map => Light::map(&map, rotation, gain)?,
        Lighting::Srbf => {
            let wanted = Settings::of(scene).lights as usize;
            let fit = clock
                .watch("fitting lights", |progress| srbf::fit_cached(&map, wanted, progress))?;
            Light::lobes(&place_lights(&fit.lights, scene))?
        }
    };
    let light = light.with_lamps(&stage.lamps(scene), stage.center);
    let Geometry { hair, diameters, frames, head, head_albedo, center, .. } = &stage;
    let strands = Strands::new(hair, diameters, frames, pieces, *center);
    let skin = head.as_ref().map(|head| Skin::new(head, *head_albedo, *center));
    let models = Models::new(&scene.fibre, &fibres);
    let traced = TraceScene {
        strands: &strands,
        skin: skin.as_ref(),
        light: &light,
        models: &models,
        lens,
        max_depth: options.max_depth,
        sampling: options.sampling,
        seed: options.seed,
    };
    clock.step("build")?;

    // Samples that are there when it is cancelled are kept.
    let _unfinished = Unfinished::new();
    let (begun, had) = (Instant::now(), film.segments);
    let finished =
        clock.watch("path tracing", |progress| trace(&traced, &mut film, options.spp, progress))?;
    let seconds = begun.elapsed().as_secs_f64();

    let shot = Shot { scene, map: &map, lens: &lens };
    match format {
        Format::Exr if film.samples > 0 => shot.write_truth(path, &film, &identity)?,
        Format::Png if finished => {
            write_display(
                path,
                film.size,
                &shot.composed(&film),
                exposure_scale(scene, &LightMeter::new(&map), -lens.forward),
            )?;
        }
        _ => {}
    }
    if !finished {
        match format {
            Format::Exr if film.samples > 0 => bail!(
                "cancelled: {} holds {} of {} samples a pixel; --resume goes on with them",
                path.display(),
                film.samples,
                options.spp
            ),
            _ => bail!("cancelled"),
        }
    }
    clock.note(&format!(
        "{}: {} samples a pixel in {seconds:.1} s, {:.2} million path segments a second",
        path.display(),
        film.samples,
        (film.segments - had) as f64 / seconds.max(1e-9) / 1e6,
    ));
    Ok(())
}

/// What samples are samples of, as a hash: all that changes their value, but not how many there are.
fn identity(
    scene: &Scene,
    options: &ReferenceOptions,
    map: &Environment,
    stage: &Geometry,
    fibres: &Fibres,
) -> String {
    let mut scene = scene.clone();
    // These change the file or the picture past the hair alone.
    scene.output = crate::scene::OutputSpec { size: scene.output.size, ..Default::default() };
    scene.render = Default::default();
    // What is painted counts, not the name of its file.
    scene.hair.paint = None;
    let mut hasher = blake3::Hasher::new();
    let ReferenceOptions { max_depth, lighting, seed, sampling, .. } = options;
    // Fields that are as they would be anyway do not count, so that a field more in the table changes nothing.
    let usual = Scene::default();
    for field in FIELDS {
        let value = field.get(&scene);
        if value != field.get(&usual) {
            hasher.update(format!("{} = {value:?}\n", field.key).as_bytes());
        }
    }
    hasher.update(format!("{VERSION} {max_depth} {lighting:?} {seed} {sampling:?}").as_bytes());
    hasher.update(map.content_hash().as_bytes());
    hasher.update(bytemuck::cast_slice(&stage.hair.points));
    hasher.update(bytemuck::cast_slice(&stage.diameters));
    hasher.update(bytemuck::cast_slice(fibres.points()));
    if let Some(head) = &stage.head {
        hasher.update(bytemuck::cast_slice(&head.positions));
    }
    hasher.finalize().to_hex().to_string()
}

/// A variance that is not known yet is written as 0.
fn finite(variance: f64) -> f32 {
    if variance.is_finite() { variance as f32 } else { 0.0 }
}

/// A view of the scene, to put behind a film what is seen past the hair.
pub struct Shot<'a> {
    pub scene: &'a Scene,
    pub map: &'a Environment,
    pub lens: &'a Lens,
}

impl Shot<'_> {
    /// What stands behind pixel `i`: radiance and alpha.
    fn backdrop(&self, i: usize) -> [f64; 4] {
        let opaque = |[r, g, b]: [f64; 3]| [r, g, b, 1.0];
        match self.scene.output.background {
            Background::Transparent => [0.0; 4],
            Background::Color(rgb) => opaque(rgb),
            Background::Environment => {
                let width = self.lens.size[0] as usize;
                let [x, y] = [i % width, i / width].map(|at| at as f64 + 0.5);
                let turn = -self.scene.environment.rotation_deg.to_radians();
                let omega = glam::DMat3::from_rotation_y(turn) * self.lens.direction(x, y);
                let gain = 2f64.powf(self.scene.environment.exposure);
                opaque(self.map.smooth_radiance(omega.normalize()).map(|v| gain * v))
            }
        }
    }

    /// The film over its backdrop, premultiplied RGB and alpha.
    pub fn composed(&self, film: &Film) -> Vec<[f32; 4]> {
        (0..film.pixels.len())
            .map(|i| {
                let (front, back) = (film.mean(i), self.backdrop(i));
                std::array::from_fn(|c| (front[c] + (1.0 - front[3]) * back[c]) as f32)
            })
            .collect()
    }

    fn write_truth(&self, path: &Path, film: &Film, identity: &str) -> Result<()> {
        let pixels = self.composed(film);
        let count = 0..film.pixels.len();
        let mut channels: Vec<(&str, Vec<f32>)> = ["R", "G", "B", "A"]
            .into_iter()
            .enumerate()
            .map(|(c, name)| (name, pixels.iter().map(|p| p[c]).collect()))
            .collect();
        channels.push(("hair", count.clone().map(|i| film.hair_coverage(i) as f32).collect()));
        channels.push(("covered", count.clone().map(|i| film.mean(i)[3] as f32).collect()));
        for (c, name) in ["variance.R", "variance.G", "variance.B"].into_iter().enumerate() {
            channels.push((name, count.clone().map(|i| finite(film.variance(i)[c])).collect()));
        }
        let attributes = [
            (SAMPLES, film.samples.to_string()),
            (SEGMENTS, film.segments.to_string()),
            (IDENTITY, identity.to_owned()),
        ];
        openexr::write(path, film.size, channels, &attributes)
    }
}

/// The film of a picture that [`run`] wrote for the same scene and options.
fn resume(
    path: &Path,
    scene: &Scene,
    map: &Environment,
    lens: &Lens,
    identity: &str,
) -> Result<Film> {
    let attempt = || -> Result<Film> {
        let bytes = read_picture_bytes(path)?;
        ensure!(bytes.starts_with(&openexr::MAGIC), "it is no EXR file");
        let file = ExrFile::open(&bytes)?;
        let text = |name: &str| file.text(0, name);
        let count = |name: &str| text(name).and_then(|n| n.parse::<u64>().ok());
        let (Some(samples), Some(segments), Some(found)) =
            (count(SAMPLES), count(SEGMENTS), text(IDENTITY))
        else {
            bail!("`hairlight reference` did not write it");
        };
        ensure!(
            found == identity && (1..=1 << 24).contains(&samples),
            "it shows another scene, or was made with other options"
        );
        let names = ["R", "G", "B", "hair", "covered", "variance.R", "variance.G", "variance.B"];
        let channels = names.map(|name| file.channel(0, name));
        for (name, channel) in names.iter().zip(channels) {
            ensure!(channel.is_some(), "it has no {name}");
        }
        let planes = file.pixels(0, channels)?;
        for (k, name) in names.iter().enumerate() {
            let finite = planes.pixels.iter().all(|pixel| pixel[k].is_finite());
            ensure!(finite, "{name} has values that are not finite");
        }
        let mut film = Film::new(scene.output.size);
        ensure!(
            [planes.width, planes.height] == film.size.map(|n| n as usize),
            "its size is another"
        );
        (film.samples, film.segments) = (samples as u32, segments);
        let (n, shot) = (samples as f64, Shot { scene, map, lens });
        for (i, (pixel, values)) in film.pixels.iter_mut().zip(&planes.pixels).enumerate() {
            let [rgb @ .., hair, share, _, _, _] = values.map(f64::from);
            let variance = &values[5..];
            let back = shot.backdrop(i);
            for c in 0..3 {
                let mean = rgb[c] - (1.0 - share) * back[c];
                pixel.sum[c] = n * mean;
                pixel.squares[c] = n * (mean * mean + (n - 1.0) * f64::from(variance[c]));
            }
            pixel.covered = (n * share).round() as u32;
            pixel.hair = (n * hair).round() as u32;
        }
        Ok(film)
    };
    attempt().with_context(|| {
        format!("{}: cannot be gone on with; leave out --resume to begin anew", path.display())
    })
}
