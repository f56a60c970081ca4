//! Which fibre the hair of each cell has: few fibres stand for all that are painted.

use glam::Vec3A;

use super::grid::PIECES;
use super::{Grid, Twin};
use crate::paint::{Numbers, PointFibre, cluster};
use crate::scattering::fibre::Fibre;
use crate::stage::Geometry;

/// Fibres at most: each costs a table and, with every tangent that it meets, a matrix.
const FIBRES: usize = 8;
/// A cell's own colour is told by what becomes of light at this inclination, radians.
const INCLINATION: f64 = 0.5;

/// The usual fibres.
pub struct Palette {
    pub(super) fibres: Vec<Fibre>,
    /// Of each hairy cell, which of them.
    pub(super) of_cell: Vec<u32>,
    /// By what that one's light is multiplied, for the cell's own colour.
    pub(super) tint: Vec<Vec3A>,
}

impl Palette {
    /// For the fibres of `twin` at the points of `stage`.
    pub fn new(grid: &Grid, stage: &Geometry, twin: &Twin) -> Palette {
        let cells = grid.hairy.len();
        if !twin.fibres.painted() {
            return Palette {
                fibres: vec![*twin.fibres.base()],
                of_cell: vec![0; cells],
                tint: vec![Vec3A::ONE; cells],
            };
        }
        let means = cell_means(grid, stage, twin.fibres.points());
        let (usual, of_cell) = cluster(&means, FIBRES);
        let fibre = |numbers: &Numbers| twin.fibres.fibre(PointFibre::from_f32(*numbers));
        let albedo = |fibre: &Fibre| {
            Vec3A::from(twin.of(fibre).albedo(INCLINATION).map(|a| a as f32)).max(LEAST)
        };
        let fibres: Vec<Fibre> = usual.iter().map(fibre).collect();
        let albedos: Vec<Vec3A> = fibres.iter().map(albedo).collect();
        let tint = means.iter().zip(&of_cell);
        let tint = tint.map(|(own, &usual)| albedo(&fibre(own)) / albedos[usual as usize]);
        Palette { tint: tint.collect(), fibres, of_cell }
    }
}

/// Black hair sends back more than this.
const LEAST: Vec3A = Vec3A::splat(1e-4);

/// The mean over the hair of each hairy cell.
fn cell_means(grid: &Grid, stage: &Geometry, points: &[PointFibre]) -> Vec<Numbers> {
    let volume = &grid.volume;
    let mut place = vec![u32::MAX; grid.head.len()];
    for (hairy, &cell) in (0..).zip(&grid.hairy) {
        place[cell as usize] = hairy;
    }
    let mut sums = vec![(Numbers::default(), 0.0f32); grid.hairy.len()];
    for strand in stage.hair.strands() {
        let ends = strand.clone().zip(strand.clone().skip(1));
        for ((from, to), (a, b, diameter)) in ends.zip(stage.segments_of(strand)) {
            volume.pieces([a, b], PIECES, |piece| {
                let index = volume.index_of(piece.place).map(|index| place[index]);
                let Some(hairy) = index.filter(|&hairy| hairy != u32::MAX) else { return };
                let weight = diameter * piece.within / piece.count;
                let (sum, total) = &mut sums[hairy as usize];
                let numbers = points[from].mix(points[to], piece.along).to_f32();
                sum.iter_mut().zip(numbers).for_each(|(sum, number)| *sum += weight * number);
                *total += weight;
            });
        }
    }
    let mean = |(sum, total): (Numbers, f32)| sum.map(|v| v / total.max(f32::MIN_POSITIVE));
    sums.into_iter().map(mean).collect()
}
