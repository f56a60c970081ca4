//! Light in hair: lights brought through strands, and light between them; what frames are shaded with.

use std::sync::Arc;

use anyhow::{Result, bail};
use glam::Vec3;
use rayon::prelude::*;

use crate::field::{self, Field, Grid, Palette};
use crate::gpu::frame::Renderer;
use crate::gpu::method::MethodData;
use crate::srbf::SrbfLight;
use crate::stage::{Geometry, HEAD_ALBEDO};
use crate::transport::volume::Volume;
use crate::transport::{Brought, Detail, Occluders, Places, Reach, transport};

/// Told the share done; false cancels.
pub type Progress<'a> = &'a (dyn Fn(f32) -> bool + Sync);

/// Hair as light finds it: of geometry alone.
pub struct Medium {
    volume: Volume,
    /// None without multiple scattering.
    grid: Option<Arc<Grid>>,
}

impl Medium {
    pub fn new(stage: &Geometry, detail: &Detail) -> Medium {
        let volume = stage.density(detail.cells);
        let occluders = Occluders { volume: &volume, head: stage.head.as_ref() };
        let grid = detail.multiple.then(|| Arc::new(Grid::new(stage, &occluders, field::CELLS)));
        Medium { volume, grid }
    }

    /// The same with another number of cells of the density volume.
    pub fn with_cells(&self, stage: &Geometry, cells: usize) -> Medium {
        Medium { volume: stage.density(cells), grid: self.grid.clone() }
    }

    /// Brings lights (`stage::shaded_lights`) to the strand points `points`, to the grid of multiple scattering and to
    /// the head.
    ///
    /// # Errors
    /// `progress` cancelled it.
    pub fn bring(
        &self,
        stage: &Geometry,
        lights: Vec<SrbfLight>,
        points: &[u32],
        progress: Progress,
    ) -> Result<LitHair> {
        let mut lit = LitHair { points: points.to_vec(), ..LitHair::default() };
        self.relight(stage, &mut lit, lights, progress)?;
        Ok(lit)
    }

    /// Puts other lights in place of those of `lit`, at the same points. Lobes that stay where they are, such as the
    /// ordinates, are not brought again, whatever their colour.
    ///
    /// # Errors
    /// `progress` cancelled it, and `lit` is as it was.
    pub fn relight(
        &self,
        stage: &Geometry,
        lit: &mut LitHair,
        lights: Vec<SrbfLight>,
        progress: Progress,
    ) -> Result<()> {
        let dark = |light: &SrbfLight| light.rgb == [0.0; 3];
        let lobe = |light: &SrbfLight| (light.direction, light.lambda, dark(light));
        let mut free = vec![true; lit.lights.len()];
        let known: Vec<Option<usize>> = (lights.iter())
            .map(|light| {
                let same = |&at: &usize| free[at] && lobe(&lit.lights[at]) == lobe(light);
                let known = (0..lit.lights.len()).find(same);
                known.inspect(|&at| free[at] = false)
            })
            .collect();
        let pairs = lights.iter().zip(&known);
        let new: Vec<SrbfLight> =
            pairs.filter(|(_, known)| known.is_none()).map(|(light, _)| *light).collect();
        let to = Places {
            samples: self.grid.as_ref().map_or(&[][..], |grid| &grid.samples),
            head: true,
            ..Places::default()
        };
        let mut new = self.transport(stage, &new, &lit.points, to, progress)?.into_iter();
        let rough = std::mem::take(&mut lit.rough).into_iter().chain(std::iter::repeat(Vec::new()));
        let mut old: Vec<_> = std::mem::take(&mut lit.brought).into_iter().zip(rough).collect();
        for known in known {
            let (brought, rough) = match known {
                Some(at) => std::mem::take(&mut old[at]),
                None => (new.next().unwrap_or_default(), Vec::new()),
            };
            lit.brought.push(brought);
            lit.rough.push(rough);
        }
        lit.lights = lights;
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
        let more = self.transport(stage, &lit.lights, points, Places::default(), progress)?;
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
        lights: &[SrbfLight],
        points: &[u32],
        to: Places,
        progress: Progress,
    ) -> Result<Vec<Brought>> {
        let occluders = Occluders { volume: &self.volume, head: stage.head.as_ref() };
        let points: Vec<Vec3> = points.iter().map(|&i| stage.hair.points[i as usize]).collect();
        let to = Places { points: &points, beyond: self.grid.is_some(), ..to };
        let transport = transport(&occluders, lights, &to, progress);
        transport.map_or_else(|| bail!("cancelled"), Ok)
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

/// Lights, and what is known of their way through hair, whatever its colour.
#[derive(Clone, Default)]
pub struct LitHair {
    pub lights: Vec<SrbfLight>,
    pub points: Vec<u32>,
    /// Of each light, to `points`.
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

    /// Irradiance at the vertices of the head, linear RGB; empty without one.
    pub fn head_irradiance(&self) -> Vec<Vec3> {
        let vertices = self.brought.iter().map(|brought| brought.head.len()).max().unwrap_or(0);
        let mut sums = vec![Vec3::ZERO; vertices];
        for (light, brought) in self.lights.iter().zip(&self.brought) {
            let rgb = Vec3::from(light.rgb.map(|c| c as f32));
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
        let field =
            field::solve(grid, &self.lights, &self.brought, &head, &palette, &twin, progress);
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
        renderer.set_lights(&self.lights, points, &reach);
        let to_radiance = HEAD_ALBEDO / std::f32::consts::PI;
        let head: Vec<Vec3> = self.head_irradiance().iter().map(|e| *e * to_radiance).collect();
        renderer.set_head_radiance(&head);
    }
}
