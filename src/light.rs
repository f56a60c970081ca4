//! Light in hair: lights brought through strands, and light between them; what frames are shaded with.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Result, bail};
use glam::Vec3;
use rayon::prelude::*;

use crate::field::{self, Field, Grid, Palette};
use crate::gpu::frame::Renderer;
use crate::gpu::method::MethodData;
use crate::srbf::SrbfLight;
use crate::stage::{Geometry, HEAD_ALBEDO};
use crate::transport::volume::Volume;
use crate::transport::{Detail, Occluders, Reach, Transport, transport};

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
        let samples = self.grid.as_ref().map_or(&[][..], |grid| &grid.samples);
        let transport = self.transport(stage, &lights, points, samples, progress)?;
        Ok(LitHair { lights, points: points.to_vec(), transport })
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
        let more = self.transport(stage, &lit.lights, points, &[], progress)?;
        lit.transport.reach.iter_mut().zip(more.reach).for_each(|(all, more)| all.extend(more));
        lit.transport.looks += more.looks;
        lit.points.extend(points);
        Ok(())
    }

    fn transport(
        &self,
        stage: &Geometry,
        lights: &[SrbfLight],
        points: &[u32],
        samples: &[Vec3],
        progress: Progress,
    ) -> Result<Transport> {
        let occluders = Occluders { volume: &self.volume, head: stage.head.as_ref() };
        let places: Vec<Vec3> = points.iter().map(|&i| stage.hair.points[i as usize]).collect();
        let done = AtomicUsize::new(0);
        let transport =
            transport(&occluders, lights, &places, samples, self.grid.is_some(), &|| {
                progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f32 / lights.len() as f32)
            });
        transport.map_or_else(|| bail!("cancelled"), Ok)
    }

    /// The reach of the lights of `lit` at any points, as it is in cells of 1/32 of the hair's size: for frames in a
    /// hurry, of `fast`, which knows T̃ alone. Empty without multiple scattering.
    pub fn rough_reach(&self, stage: &Geometry, lit: &LitHair, points: &[u32]) -> Vec<Vec<u32>> {
        let Some(grid) = &self.grid else { return Vec::new() };
        let of_light = |of_samples: &Vec<f32>| {
            let cells = grid.spread(of_samples);
            let at = |&point: &u32| {
                let (mut sum, mut total) = (0.0, 0.0);
                grid.volume.corners(stage.hair.points[point as usize], |cell, weight| {
                    if let Some(direct) = cells[cell] {
                        sum += weight * direct;
                        total += weight;
                    }
                });
                let direct = if total > 0.0 { sum / total } else { 1.0 };
                Reach { direct, quarter: direct.powf(0.25), open: 1.0, beyond: 1.0 }.pack()
            };
            points.iter().map(at).collect()
        };
        lit.transport.samples.par_iter().map(of_light).collect()
    }
}

/// Lights, and what is known of their way through hair, whatever its colour.
#[derive(Clone)]
pub struct LitHair {
    pub lights: Vec<SrbfLight>,
    pub points: Vec<u32>,
    pub transport: Transport,
}

impl LitHair {
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
        let head = stage.head.as_ref().map_or(&[][..], |head| &head.positions);
        let field =
            field::solve(grid, &self.lights, &self.transport, head, &palette, &twin, progress);
        if field.is_none() {
            bail!("cancelled");
        }
        Ok(field)
    }

    /// The same with another reach at its points.
    pub fn with_reach(&self, reach: Vec<Vec<u32>>) -> Self {
        let transport = Transport { reach, ..self.transport.clone() };
        Self { transport, ..self.clone() }
    }

    /// Sets a method, these lights, and a field of theirs.
    pub fn show(&self, renderer: &mut Renderer, method: &MethodData, field: Option<&Field>) {
        renderer.set_method(method);
        self.show_at(renderer, &self.points, &self.transport.reach);
        match field {
            Some(field) => renderer.set_field(field),
            None => renderer.clear_field(),
        }
    }

    /// Sets these lights with a reach at points; the field stays.
    pub fn show_at(&self, renderer: &mut Renderer, points: &[u32], reach: &[Vec<u32>]) {
        renderer.set_lights(&self.lights, points, reach);
        let to_radiance = HEAD_ALBEDO / std::f32::consts::PI;
        let irradiance = &self.transport.head_irradiance;
        let head: Vec<Vec3> = irradiance.iter().map(|e| *e * to_radiance).collect();
        renderer.set_head_radiance(&head);
    }
}
