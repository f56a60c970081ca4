//! Light in hair: lights brought through strands, and light between them; what frames are shaded with.

use std::sync::{Arc, OnceLock};

use anyhow::{Result, bail};
use glam::Vec3;
use rayon::prelude::*;

use crate::field::{self, Field, Grid, Palette};
use crate::gpu::frame::Renderer;
use crate::gpu::method::MethodData;
use crate::head::HeadRays;
use crate::lamp::Lamp;
use crate::srbf::SrbfLight;
use crate::stage::Geometry;
use crate::transport::volume::Volume;
use crate::transport::{Brought, Detail, Occluders, Places, Reach, near, transport};

/// Told the share done; false cancels.
pub type Progress<'a> = &'a (dyn Fn(f32) -> bool + Sync);

/// What hair is lit by, world frame, exposure included.
#[derive(Clone, Default)]
pub struct Lights {
    /// Those of which each place sees another lobe.
    pub lamps: Vec<Lamp>,
    /// Of which the last are the ordinates (`stage::shaded_lights`).
    pub distant: Vec<SrbfLight>,
}

impl From<Vec<SrbfLight>> for Lights {
    fn from(distant: Vec<SrbfLight>) -> Lights {
        Lights { distant, ..Lights::default() }
    }
}

/// Hair as light finds it: of geometry alone.
pub struct Medium {
    volume: Volume,
    /// None without multiple scattering.
    grid: Option<Arc<Grid>>,
    /// Made for the first lamp.
    head: OnceLock<Option<HeadRays>>,
}

impl Medium {
    pub fn new(stage: &Geometry, detail: &Detail) -> Medium {
        let volume = stage.density(detail.cells);
        let occluders = Occluders { volume: &volume, head: stage.head.as_ref() };
        let grid = detail.multiple.then(|| Arc::new(Grid::new(stage, &occluders, field::CELLS)));
        Medium { volume, grid, head: OnceLock::new() }
    }

    /// The same with another number of cells of the density volume.
    pub fn with_cells(&self, stage: &Geometry, cells: usize) -> Medium {
        let (volume, grid) = (stage.density(cells), self.grid.clone());
        Medium { volume, grid, head: OnceLock::new() }
    }

    /// Brings lights to the strand points `points`, to the grid of multiple scattering and to the head.
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
        self.relight(stage, &mut lit, lights, progress)?;
        Ok(lit)
    }

    /// Puts other lights in place of those of `lit`, at the same points. Lobes and lamps that stay where they are, such
    /// as the ordinates, are not brought again, whatever their colour.
    ///
    /// # Errors
    /// `progress` cancelled it, and `lit` is as it was.
    pub fn relight(
        &self,
        stage: &Geometry,
        lit: &mut LitHair,
        lights: impl Into<Lights>,
        progress: Progress,
    ) -> Result<()> {
        let Lights { lamps, distant: lights } = lights.into();
        let dark = |light: &SrbfLight| light.rgb == [0.0; 3];
        let lobe = |light: &SrbfLight| (light.direction, light.lambda, dark(light));
        let known_lamps = known(&lit.lamps, &lamps, |a, b| a.shape == b.shape);
        let known_lights = known(&lit.lights, &lights, |a, b| lobe(a) == lobe(b));
        let new_lamps = new(&lamps, &known_lamps);
        let new_lights = new(&lights, &known_lights);
        let to = Places {
            samples: self.grid.as_ref().map_or(&[][..], |grid| &grid.samples),
            head: true,
            ..Places::default()
        };
        let brought = self.transport(stage, &new_lamps, &new_lights, &lit.points, to, progress)?;
        let mut new = brought.into_iter();
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
        (lit.lamps, lit.lights) = (lamps, lights);
        Ok(())
    }

    /// Brings the lights of `lit` to more points.
    ///
    /// # Errors
    /// `progress` cancelled it, and `lit` is as it was.
    pub fn extend(
        &self,
        stage: &Geometry,
        lit: &mut LitHair,
        points: &[u32],
        progress: Progress,
    ) -> Result<()> {
        let LitHair { lamps, lights, .. } = &*lit;
        let more = self.transport(stage, lamps, lights, points, Places::default(), progress)?;
        for (all, more) in lit.brought.iter_mut().zip(more) {
            all.reach.extend(more.reach);
            all.looks += more.looks;
        }
        lit.points.extend(points);
        Ok(())
    }

    fn transport(
        &self,
        stage: &Geometry,
        lamps: &[Lamp],
        lights: &[SrbfLight],
        points: &[u32],
        to: Places,
        progress: Progress,
    ) -> Result<Vec<Brought>> {
        let occluders = Occluders { volume: &self.volume, head: stage.head.as_ref() };
        let points: Vec<Vec3> = points.iter().map(|&i| stage.hair.points[i as usize]).collect();
        let to = Places { points: &points, beyond: self.grid.is_some(), ..to };
        let of_lamps = match lamps {
            [] => Some(Vec::new()),
            lamps => {
                let head = stage.head.as_ref();
                let rays = || head.map(|head| HeadRays::new(head, stage.center));
                let head = head.zip(self.head.get_or_init(rays).as_ref());
                let between = near::Between { volume: &self.volume, head, center: stage.center };
                near::transport(&between, lamps, &to, &|| progress(0.0))
            }
        };
        let all =
            of_lamps.and_then(|lamps| Some((lamps, transport(&occluders, lights, &to, progress)?)));
        let Some((mut all, of_lights)) = all else { bail!("cancelled") };
        all.extend(of_lights);
        Ok(all)
    }

    /// Finds [`LitHair::rough`] at `points`, the same at each call: for frames in a hurry, of `fast`, which knows T̃ alone.
    pub fn roughen(&self, stage: &Geometry, lit: &mut LitHair, points: &[u32]) {
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
                let direct = if total > 0.0 { sum / total } else { 1.0f32 };
                Reach { direct, quarter: direct.sqrt().sqrt(), open: 1.0, beyond: 1.0 }.pack()
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
    pub points: Vec<u32>,
    /// Of each lamp, then of each light, to `points`.
    pub brought: Vec<Brought>,
    /// Packed reach of each light at other points, as it is in cells of 1/32 of the hair's size; empty before
    /// [`Medium::roughen`].
    pub rough: Vec<Vec<u32>>,
}

impl LitHair {
    /// Those of `points` that no light was brought to.
    pub fn missing(&self, stage: &Geometry, points: &[u32]) -> Vec<u32> {
        let mut known = vec![false; stage.hair.points.len()];
        self.points.iter().for_each(|&point| known[point as usize] = true);
        points.iter().copied().filter(|&point| !known[point as usize]).collect()
    }

    /// Forgets all points but `points`.
    pub fn retain(&mut self, stage: &Geometry, points: &[u32]) {
        let mut wanted = vec![false; stage.hair.points.len()];
        points.iter().for_each(|&point| wanted[point as usize] = true);
        let keep: Vec<bool> = self.points.iter().map(|&point| wanted[point as usize]).collect();
        let mut all = self.brought.iter_mut().map(|b| &mut b.reach).chain([&mut self.points]);
        all.by_ref().for_each(|values| {
            let mut kept = keep.iter();
            values.retain(|_| kept.next() == Some(&true));
        });
    }

    /// All lights as they are from the middle of the hair.
    pub fn lobes(&self, stage: &Geometry) -> Vec<SrbfLight> {
        let middle = stage.center.as_dvec3();
        let lamps = self.lamps.iter().map(|lamp| lamp.lobe(middle));
        lamps.chain(self.lights.iter().copied()).collect()
    }

    /// Irradiance at the vertices of the head, linear RGB; empty without one.
    pub fn head_irradiance(&self) -> Vec<Vec3> {
        let vertices = self.brought.iter().map(|brought| brought.head.len()).max().unwrap_or(0);
        let mut sums = vec![Vec3::ZERO; vertices];
        let lamps = self.lamps.iter().map(|lamp| lamp.radiance);
        let radiances = lamps.chain(self.lights.iter().map(|light| light.rgb));
        for (radiance, brought) in radiances.zip(&self.brought) {
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
        medium: &Medium,
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

    /// The same with another reach at its points.
    pub fn with_reach(mut self, reach: Vec<Vec<u32>>) -> Self {
        self.brought.iter_mut().zip(reach).for_each(|(brought, reach)| brought.reach = reach);
        self
    }

    /// Sets a method, these lights, and a field of theirs.
    pub fn show(&self, renderer: &mut Renderer, method: &MethodData, field: Option<&Field>) {
        let reach = self.brought.iter().map(|brought| &brought.reach[..]).collect();
        self.show_with(renderer, method, field, &self.points, reach);
    }

    /// The same at some of the points that they were brought to.
    pub fn show_some(
        &self,
        renderer: &mut Renderer,
        method: &MethodData,
        field: Option<&Field>,
        points: &[u32],
    ) {
        let most = self.points.iter().max().map_or(0, |&most| most as usize + 1);
        let mut places = vec![0; most];
        (0..).zip(&self.points).for_each(|(place, &point)| places[point as usize] = place);
        let places: Vec<usize> = points.iter().map(|&point| places[point as usize]).collect();
        let of_light =
            |brought: &Brought| places.iter().map(|&place| brought.reach[place]).collect();
        let reach: Vec<Vec<u32>> = self.brought.par_iter().map(of_light).collect();
        let reach = reach.iter().map(|reach| &reach[..]).collect();
        self.show_with(renderer, method, field, points, reach);
    }

    fn show_with(
        &self,
        renderer: &mut Renderer,
        method: &MethodData,
        field: Option<&Field>,
        points: &[u32],
        reach: Vec<&[u32]>,
    ) {
        renderer.set_method(method);
        self.show_at(renderer, points, reach);
        match field {
            Some(field) => renderer.set_field(field),
            None => renderer.clear_field(),
        }
    }

    /// Sets these lights with their rough reach at `points`; the field stays.
    pub fn show_rough(&self, renderer: &mut Renderer, points: &[u32]) {
        self.show_at(renderer, points, self.rough.iter().map(|reach| &reach[..]).collect());
    }

    fn show_at(&self, renderer: &mut Renderer, points: &[u32], reach: Vec<&[u32]>) {
        renderer.set_lights(&self.lamps, &self.lights, points, &reach);
        renderer.set_head_irradiance(&self.head_irradiance());
    }
}
