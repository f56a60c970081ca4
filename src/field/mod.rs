//! Light that strands have scattered, at every place of the hair and from every direction.
//!
//! A grid of cells holds hair as a medium: a ray along ω meets ρ(ω) fibres a unit length, and what it meets
//! shines with what a strand there makes of the light around it (Jakob et al. 2010, "A radiative transfer framework
//! for rendering materials with anisotropic structure", with the fibre itself as phase function):
//!
//! > dL/ds = −ρ(ω)·(L − L_s),  L_s(ω_o) = ∫ (L + L₀)(ω_i) S(ω_i, ω_o) cosθ_i dω_i,
//!
//! L₀ the light that no strand has met yet. L is sought along the ordinates of `srbf`: directions that stand for
//! lobes, so that what arrives along one is one more SRBF light at a point, and shading it is Eq 11 as for any other.
//!
//! - [`Grid`]: of geometry alone: cells, their tangents, places to ask transport for L₀.
//! - [`Palette`]: of paint: which of few fibres each cell has.
//! - `Exchange`: of a fibre: what a tangent makes of every ordinate and light.
//! - [`solve()`]: sweeps along all ordinates in turn, until what cells send out stands still.
//!
//! The medium itself, path traced with exact angles on 32 cells, is 5 to 19 % off the real strands (relative L2 of
//! 5×5 blocks, white and blond sintel and builtin bob under three maps), and 5 to 14 % on 64. Ordinates add to that:
//! see [`crate::srbf::ORDINATES`].

mod correction;
mod exchange;
mod grid;
mod palette;
mod solve;

use glam::{Vec3, Vec3A};
use half::f16;

pub use correction::{Judged, correction};
pub use grid::Grid;
pub use palette::Palette;
pub use solve::{Lit, solve};

use crate::paint::Fibres;
use crate::scattering::fast::{Fast, Tables};
use crate::scattering::fibre::Fibre;
use crate::scattering::model::Model;

/// Cells along the longest edge of the hair.
pub const CELLS: usize = 32;

/// What scatters: the fibres of a groom by `fast`, on the CPU.
#[derive(Clone, Copy)]
pub struct Twin<'a> {
    fibres: &'a Fibres,
    model: Model,
    tables: &'a Tables,
}

impl<'a> Twin<'a> {
    /// `tables` hold all of the fibres' η.
    pub fn new(fibres: &'a Fibres, model: Model, tables: &'a Tables) -> Self {
        Self { fibres, model, tables }
    }

    /// What a fibre sends on to others.
    fn of(&self, fibre: &Fibre) -> Fast<'a> {
        Fast::new(&fibre.passed_on(), self.model, self.tables)
    }
}

/// L along every ordinate.
#[derive(Clone)]
pub struct Field {
    /// Corner of cell (0, 0, 0), world frame.
    pub origin: Vec3,
    /// Edge of a cell, world units.
    pub cell: f32,
    pub dims: [usize; 3],
    /// Mean of L in each cell, RGB, ordinate by ordinate; a fourth number is the cell's weight among its
    /// neighbours.
    pub radiance: Vec<(Vec3A, f32)>,
    /// Radiance over what [`Self::radiance`] has along the ordinate that is nearest, so that lobes which overlap add up.
    pub overlap: f32,
    /// Rounds of sweeps that it took.
    pub rounds: usize,
}

impl Field {
    /// Four halves (16-bit floats) a cell, ordinate by ordinate, premultiplied by the weight, and what RGB is to be multiplied by.
    pub fn to_gpu(&self) -> (Vec<[u16; 4]>, f32) {
        let most = self.radiance.iter().map(|(l, _)| l.max_element()).fold(0.0, f32::max);
        let scale = if most > 0.0 { most } else { 1.0 };
        let texel = |&(l, weight): &(Vec3A, f32)| {
            (l * (weight / scale)).extend(weight).to_array().map(|v| f16::from_f32(v).to_bits())
        };
        (self.radiance.iter().map(texel).collect(), scale)
    }
}
