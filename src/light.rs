//! Light in hair: lights brought through strands, and light between them; what frames are shaded with.

use std::sync::{Arc, OnceLock};

use anyhow::{Result, bail};
use bytemuck::Zeroable as _;
use glam::Vec3;
use rayon::prelude::*;

use crate::field::{self, Field, Grid, Palette};
use crate::gpu::frame::Renderer;
use crate::gpu::gather::Gather;
use crate::gpu::head_light::SeenHead;
use crate::gpu::method::MethodData;
use crate::head::HeadRays;
use crate::lamp::Lamp;
use crate::reference::transmittance::StrandRays;
use crate::srbf::{ORDINATES, SrbfLight, lobe_integral};
use crate::stage::Geometry;
use crate::transport::draws::{HEAD_LIGHTS, HeadLight, TracedLight, Words};
use crate::transport::volume::Volume;
use crate::transport::{Brought, CELLS, Occluders, TransmittanceMoments, near, transport};

/// Rays for a vertex of the head, which stands for what is about it, of all lights but the ordinates, shared out by their
/// energy; each has one at least, and each ordinate, one of many that stand for wide lights, one.
const HEAD_RAYS: f64 = 48.0;

/// Lights wider than this have shadows on the head as soft as vertices are apart; all vertices look for others in the same
/// directions, so that their shadows are copies of each other and no noise.
const WIDE_LAMBDA: f32 = 0.1;

/// Paths that gather light between strands at a point, at 64 samples a pixel.
pub const PATHS_PER_POINT: f64 = 8.0;

/// Told the share done; false cancels.
pub type Progress<'a> = &'a (dyn Fn(f32) -> bool + Sync);

/// What hair is lit by, world frame, exposure included.
#[derive(Clone, Default)]
pub struct Lights {
    /// Those of which each place sees another lobe.
    pub lamps: Vec<Lamp>,
    /// Of which the last are the ordinates (`stage::shaded_lights`).
    pub distant: Vec<SrbfLight>,
    /// What the ordinates stand for (`stage::sky_lights`); empty where that is the ordinates themselves.
    pub sky: Vec<SrbfLight>,
}

impl From<Vec<SrbfLight>> for Lights {
    fn from(distant: Vec<SrbfLight>) -> Lights {
        Lights { distant, ..Lights::default() }
    }
}

/// The hair as a participating medium, and as rays meet it. Depends on geometry only.
pub struct HairMedium {
    volume: Volume,
    /// None without multiple scattering.
    grid: Option<Arc<Grid>>,
    /// Made for the first lamp.
    head: OnceLock<Option<HeadRays>>,
    /// Made for the first points of a CPU's adapter.
    rays: OnceLock<Arc<StrandRays>>,
}

impl HairMedium {
    /// `multiple`: whether light counts that more than one strand has scattered.
    pub fn new(stage: &Geometry, multiple: bool) -> HairMedium {
        let volume = stage.density(CELLS);
        let occluders = Occluders { volume: &volume, head: stage.head.as_ref() };
        let grid = multiple.then(|| Arc::new(Grid::new(stage, &occluders, field::CELLS)));
        HairMedium { volume, grid, head: OnceLock::new(), rays: OnceLock::new() }
    }

    /// The same, with what [`Self::rays`] will be asked for made beside it.
    pub fn with_rays(stage: &Geometry, multiple: bool, renderer: &Renderer) -> HairMedium {
        if !renderer.traces_on_cpu() {
            return Self::new(stage, multiple);
        }
        let (medium, rays) = rayon::join(|| Self::new(stage, multiple), || StrandRays::new(stage));
        HairMedium { rays: OnceLock::from(Arc::new(rays)), ..medium }
    }

    /// Brings lights to the inside of the hair and to the head; they are to be shown at the strand points `points`.
    ///
    /// # Errors
    /// `progress` cancelled it.
    pub fn bring(
        &self,
        stage: &Geometry,
        lights: impl Into<Lights>,
        points: &[u32],
        progress: Progress,
    ) -> Result<LitHair> {
        let mut lit = LitHair { points: points.to_vec(), ..LitHair::default() };
        self.update_lights(stage, &mut lit, lights, progress)?;
        Ok(lit)
    }

    /// Puts other lights in place of those of `lit`. Lobes and lamps that stay where they are, such as the ordinates, are
    /// not brought again, whatever their colour.
    ///
    /// # Errors
    /// `progress` cancelled it, and `lit` is as it was.
    pub fn update_lights(
        &self,
        stage: &Geometry,
        lit: &mut LitHair,
        lights: impl Into<Lights>,
        progress: Progress,
    ) -> Result<()> {
        let Lights { lamps, distant: lights, sky } = lights.into();
        let dark = |light: &SrbfLight| light.rgb == [0.0; 3];
        let lobe = |light: &SrbfLight| (light.direction, light.lambda, dark(light));
        let known_lamps = known(&lit.lamps, &lamps, |a, b| a.shape == b.shape);
        let known_lights = known(&lit.lights, &lights, |a, b| lobe(a) == lobe(b));
        let new_lamps = new(&lamps, &known_lamps);
        let new_lights = new(&lights, &known_lights);
        let mut new = self.transport(stage, &new_lamps, &new_lights, progress)?.into_iter();
        let rough = std::mem::take(&mut lit.rough).into_iter().chain(std::iter::repeat(Vec::new()));
        let mut old: Vec<_> = std::mem::take(&mut lit.brought).into_iter().zip(rough).collect();
        let after = lit.lamps.len();
        let known_lights = known_lights.into_iter().map(|known| known.map(|at| after + at));
        for known in known_lamps.into_iter().chain(known_lights) {
            let (brought, rough) = match known {
                Some(at) => std::mem::take(&mut old[at]),
                None => (new.next().unwrap_or_default(), Vec::new()),
            };
            lit.brought.push(brought);
            lit.rough.push(rough);
        }
        (lit.lamps, lit.lights, lit.sky) = (lamps, lights, sky);
        Ok(())
    }

    fn transport(
        &self,
        stage: &Geometry,
        lamps: &[Lamp],
        lights: &[SrbfLight],
        progress: Progress,
    ) -> Result<Vec<Brought>> {
        let occluders = Occluders { volume: &self.volume, head: stage.head.as_ref() };
        let samples = self.grid.as_ref().map_or(&[][..], |grid| &grid.samples);
        let of_lamps = match lamps {
            [] => Some(Vec::new()),
            lamps => {
                let head = stage.head.as_ref();
                let rays = || head.map(|head| HeadRays::new(head, stage.center));
                let head = head.zip(self.head.get_or_init(rays).as_ref());
                let between = near::Between { volume: &self.volume, head, center: stage.center };
                near::transport(&between, lamps, samples, &|| progress(0.0))
            }
        };
        let of_lights = || transport(&occluders, lights, samples, progress);
        let all = of_lamps.and_then(|lamps| Some((lamps, of_lights()?)));
        let Some((mut all, of_lights)) = all else { bail!("cancelled") };
        all.extend(of_lights);
        Ok(all)
    }

    /// Strands and head for the rays of a renderer on a CPU's adapter, which the CPU itself traces faster.
    pub fn rays(&self, stage: &Geometry, renderer: &Renderer) -> Option<&StrandRays> {
        self.shared_rays(stage, renderer).map(|rays| &**rays)
    }

    fn shared_rays(&self, stage: &Geometry, renderer: &Renderer) -> Option<&Arc<StrandRays>> {
        let rays = || self.rays.get_or_init(|| Arc::new(StrandRays::new(stage)));
        renderer.traces_on_cpu().then(rays)
    }

    /// Finds [`LitHair::rough`] at `points`, the same at each call: for frames in a hurry.
    pub fn compute_coarse(&self, stage: &Geometry, lit: &mut LitHair, points: &[u32]) {
        let Some(grid) = &self.grid else { return };
        if lit.rough.iter().all(|rough| !rough.is_empty()) {
            return;
        }
        let corners: Vec<[(u32, f32); 8]> = (points.par_iter())
            .map(|&point| {
                let (mut corners, mut count) = ([(0, 0.0); 8], 0);
                grid.volume.corners(stage.hair.points[point as usize], |cell, weight| {
                    corners[count] = (cell as u32, weight);
                    count += 1;
                });
                corners
            })
            .collect();
        let of_light = |brought: &Brought| {
            let cells = grid.spread(&brought.samples);
            let at = |corners: &[(u32, f32); 8]| {
                let (mut sum, mut total) = (0.0, 0.0);
                for &(cell, weight) in corners {
                    if let Some(direct) = cells[cell as usize] {
                        sum += weight * direct;
                        total += weight;
                    }
                }
                let t1 = if total > 0.0 { sum / total } else { 1.0f32 };
                TransmittanceMoments { t1, t_quarter: t1.sqrt().sqrt(), visibility: 1.0, back: 1.0 }
                    .words()
            };
            corners.iter().map(at).collect()
        };
        let all = lit.rough.par_iter_mut().zip(&lit.brought);
        all.filter(|(rough, _)| rough.is_empty())
            .for_each(|(rough, brought)| *rough = of_light(brought));
    }
}

/// Where each of `wanted` is among `there`, each place taken once.
fn known<T>(there: &[T], wanted: &[T], same: impl Fn(&T, &T) -> bool) -> Vec<Option<usize>> {
    let mut free = vec![true; there.len()];
    let place = |one: &T| {
        let known = (0..there.len()).find(|&at| free[at] && same(&there[at], one));
        known.inspect(|&at| free[at] = false)
    };
    wanted.iter().map(place).collect()
}

/// Those that are not known.
fn new<T: Copy>(wanted: &[T], known: &[Option<usize>]) -> Vec<T> {
    let pairs = wanted.iter().zip(known);
    pairs.filter(|(_, known)| known.is_none()).map(|(&one, _)| one).collect()
}

/// Lights, and what is known of their way through hair, whatever its colour.
#[derive(Clone, Default)]
pub struct LitHair {
    /// See [`Lights`].
    pub lamps: Vec<Lamp>,
    pub lights: Vec<SrbfLight>,
    pub sky: Vec<SrbfLight>,
    /// Strand points that they are shown at.
    pub points: Vec<u32>,
    /// Of each lamp, then of each light.
    pub brought: Vec<Brought>,
    /// T̃ of each light at other points, as it is in cells of 1/32 of the hair's size; empty before
    /// [`HairMedium::compute_coarse`].
    pub rough: Vec<Vec<Words>>,
}

impl LitHair {
    /// All lights as they are from the middle of the hair.
    pub fn lobes(&self, stage: &Geometry) -> Vec<SrbfLight> {
        let middle = stage.center.as_dvec3();
        let lamps = self.lamps.iter().map(|lamp| lamp.lobe(middle));
        lamps.chain(self.lights.iter().copied()).collect()
    }

    /// Of each light, lamps first, the rays that places on the head look for it by; 0 of those that are too faint.
    fn head_rays(&self, stage: &Geometry) -> Vec<u32> {
        let lobes = self.lobes(stage);
        let powers: Vec<f64> = lobes.iter().map(|light| light.energy().iter().sum()).collect();
        let whole: f64 = powers.iter().sum();
        let mut brightest: Vec<usize> = (0..lobes.len()).filter(|&j| powers[j] > 0.0).collect();
        brightest.sort_by(|&i, &j| powers[j].total_cmp(&powers[i]));
        let own = lobes.len() - self.ordinates();
        let mut rays = vec![0; lobes.len()];
        for j in brightest.into_iter().take(HEAD_LIGHTS) {
            let share = HEAD_RAYS * powers[j] / whole;
            rays[j] = if j < own { share.round().max(1.0) as u32 } else { 1 };
        }
        rays
    }

    /// Those that are looked for.
    fn head_lights(&self, stage: &Geometry, rays: &[u32]) -> Vec<HeadLight> {
        let middle = stage.center.as_dvec3();
        let of_lamps = self.lamps.iter().map(|lamp| {
            let light = TracedLight::near(lamp, middle).unwrap_or(TracedLight::zeroed());
            let rgb = Vec3::from(lamp.radiance.map(|c| c as f32));
            HeadLight { light, rgb, energy: -1.0, ..HeadLight::zeroed() }
        });
        let of_lights = self.lights.iter().map(|light| HeadLight {
            light: TracedLight::distant(light),
            rgb: Vec3::from(light.rgb.map(|c| c as f32)),
            energy: lobe_integral(light.lambda) as f32,
            ..HeadLight::zeroed()
        });
        let with_rays = |(j, (one, &rays)): (usize, (HeadLight, &u32))| {
            let light = TracedLight { rays, ..one.light };
            let wide = j >= self.lamps.len() && light.lambda > WIDE_LAMBDA;
            (rays > 0).then_some(HeadLight { light, wide: u32::from(wide), ..one })
        };
        of_lamps.chain(of_lights).zip(rays).enumerate().filter_map(with_rays).collect()
    }

    /// How many of the lights are ordinates.
    fn ordinates(&self) -> usize {
        if self.lights.len() >= ORDINATES { ORDINATES } else { 0 }
    }

    /// Irradiance at the vertices of the head, linear RGB; empty without one.
    pub fn head_irradiance(&self) -> Vec<Vec3> {
        self.head_irradiance_of(|_| true)
    }

    /// The same of some of the lights, lamps first.
    fn head_irradiance_of(&self, counts: impl Fn(usize) -> bool) -> Vec<Vec3> {
        let vertices = self.brought.iter().map(|brought| brought.head.len()).max().unwrap_or(0);
        let mut sums = vec![Vec3::ZERO; vertices];
        let lamps = self.lamps.iter().map(|lamp| lamp.radiance);
        let radiances = lamps.chain(self.lights.iter().map(|light| light.rgb));
        let all = radiances.zip(&self.brought).enumerate();
        for (_, (radiance, brought)) in all.filter(|(j, _)| counts(*j)) {
            let rgb = Vec3::from(radiance.map(|c| c as f32));
            sums.iter_mut().zip(&brought.head).for_each(|(sum, &e)| *sum += e * rgb);
        }
        sums
    }

    /// What strands of a method's fibres make of each other's light; None where the method has another way.
    ///
    /// # Errors
    /// `progress` cancelled it.
    pub fn field(
        &self,
        stage: &Geometry,
        medium: &HairMedium,
        method: &MethodData,
        progress: Progress,
    ) -> Result<Option<Field>> {
        let Some((twin, grid)) = method.twin().zip(medium.grid.as_ref()) else { return Ok(None) };
        let palette = Palette::new(grid, stage, &twin);
        let vertices = stage.head.as_ref().map_or(&[][..], |head| &head.positions);
        let head: Vec<_> = vertices.iter().copied().zip(self.head_irradiance()).collect();
        let lit = field::Lit {
            lamps: &self.lamps,
            lights: &self.lights,
            brought: &self.brought,
            head_albedo: stage.head_albedo,
        };
        let field = field::solve(grid, &lit, &head, &palette, &twin, progress);
        if field.is_none() {
            bail!("cancelled");
        }
        Ok(field)
    }

    /// Sets a method, these lights, what rays find of them at the points, and a field of theirs. `rays`: times as many as
    /// at 64 samples.
    ///
    /// # Errors
    /// `progress` cancelled it, or the device was lost.
    pub fn show(
        &self,
        at: (&Geometry, &HairMedium),
        renderer: &mut Renderer,
        method: &MethodData,
        field: Option<&Field>,
        rays: f64,
        progress: Progress,
    ) -> Result<()> {
        self.show_at(at, renderer, method, field, (&self.points, None), rays, progress)
    }

    /// The same at other points, and what is seen of the head.
    ///
    /// # Errors
    /// See [`Self::show`].
    #[allow(clippy::too_many_arguments)]
    pub fn show_at(
        &self,
        (stage, medium): (&Geometry, &HairMedium),
        renderer: &mut Renderer,
        method: &MethodData,
        field: Option<&Field>,
        (points, head): (&[u32], Option<&SeenHead>),
        rays: f64,
        progress: Progress,
    ) -> Result<()> {
        self.set(renderer, method, rays);
        self.set_between((stage, medium), renderer, field, rays);
        let go_on = || progress(0.0);
        let lit = self.light_head((stage, medium), renderer, head, &go_on)?;
        if !lit || !renderer.trace(stage, points, medium.rays(stage, renderer), progress)? {
            bail!("cancelled");
        }
        Ok(())
    }

    /// Lights the head by rays, at what is `seen` of it or at all vertices.
    fn light_head(
        &self,
        (stage, medium): (&Geometry, &HairMedium),
        renderer: &mut Renderer,
        seen: Option<&SeenHead>,
        go_on: &dyn Fn() -> bool,
    ) -> Result<bool> {
        let mut rays = self.head_rays(stage);
        // A gather looks for the ordinates itself.
        let own = if renderer.gathers() { rays.len() - self.ordinates() } else { rays.len() };
        rays[own..].fill(0);
        let rest = self.head_irradiance_of(|j| j < own && rays[j] == 0);
        let host = medium.rays(stage, renderer);
        renderer.light_head(stage, &rest, &self.head_lights(stage, &rays), seen, host, go_on)
    }

    /// [`Self::show_at`] with T̃ that is known at [`Self::points`]: `words[j][k]` is light j at point k.
    ///
    /// # Errors
    /// The device was lost.
    pub fn show_known(
        &self,
        at: (&Geometry, &HairMedium),
        renderer: &mut Renderer,
        method: &MethodData,
        field: Option<&Field>,
        head: Option<&SeenHead>,
        words: &[Vec<Words>],
    ) -> Result<()> {
        self.set(renderer, method, 1.0);
        self.set_between(at, renderer, field, 1.0);
        self.light_head(at, renderer, head, &|| true)?;
        renderer.upload(&self.points, words);
        Ok(())
    }

    /// Sets these lights with their rough T̃ at `points`; method and field stay.
    ///
    /// # Errors
    /// The device was lost.
    pub fn show_coarse(
        &self,
        stage: &Geometry,
        renderer: &mut Renderer,
        points: &[u32],
    ) -> Result<()> {
        renderer.set_gather(stage, None);
        renderer.set_lights(&self.lamps, &self.lights, &self.sky, 1.0);
        renderer.light_head(stage, &self.head_irradiance(), &[], None, None, &|| true)?;
        renderer.upload(points, &self.rough);
        Ok(())
    }

    fn set(&self, renderer: &mut Renderer, method: &MethodData, rays: f64) {
        renderer.set_method(method);
        renderer.set_lights(&self.lamps, &self.lights, &self.sky, rays);
    }

    /// Light of the sky and between strands: gathered, with the field for what two strands or more have scattered.
    fn set_between(
        &self,
        (stage, medium): (&Geometry, &HairMedium),
        renderer: &mut Renderer,
        field: Option<&Field>,
        rays: f64,
    ) {
        match field {
            Some(field) => renderer.set_field(field),
            None => renderer.clear_field(),
        }
        if !renderer.can_gather() || self.ordinates() == 0 {
            return;
        }
        let paths = (PATHS_PER_POINT * rays).round().max(1.0) as u32;
        let rays = medium.shared_rays(stage, renderer).cloned();
        let gather = Gather::new(&renderer.gpu, paths, rays);
        renderer.set_gather(stage, Some(gather));
    }
}
