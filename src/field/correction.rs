//! What paths find where the field stands for it: by what the field is to be multiplied, place by place.
//!
//! A medium has strands that are lit everywhere in a cell; those that are seen are those that are lit. What follows from
//! that is off by a factor which varies slowly from place to place, so that few whole paths tell it.

use glam::Vec3;
use half::f16;

/// Cells of the field along an edge of a cell of the correction.
const COARSER: usize = 4;
/// A cell without paths has the mean of all; with so many its own counts as much.
const PRIOR: f64 = 64.0;

/// A path at the place where the field would have ended it.
#[derive(Clone, Copy, Debug)]
pub struct Judged {
    /// In cells of the field.
    pub cell: Vec3,
    /// What the field says, and what the path found: its part of a pixel's radiance, linear RGB.
    pub foretold: Vec3,
    pub found: Vec3,
}

/// Found over foretold on a grid over a field of `dims` cells: its dimensions, and four halves a cell.
pub fn correction(dims: [usize; 3], judged: &[Judged]) -> ([usize; 3], Vec<[u16; 4]>) {
    let coarse = dims.map(|n| n.div_ceil(COARSER).max(1));
    let [nx, ny, nz] = coarse;
    let mut sums = vec![[[0.0f64; 3]; 2]; nx * ny * nz];
    let mut whole = [[0.0f64; 3]; 2];
    for Judged { cell, foretold, found } in judged {
        let pair = [found, foretold].map(|rgb| rgb.as_dvec3().to_array());
        add(&mut whole, &pair, 1.0);
        let at: [(usize, f64); 3] = std::array::from_fn(|k| {
            let place = cell[k] / dims[k] as f32 * coarse[k] as f32 - 0.5;
            let low = place.floor().clamp(0.0, coarse[k] as f32 - 1.0);
            (low as usize, f64::from((place - low).clamp(0.0, 1.0)))
        });
        for corner in 0..8 {
            let side = |k: usize| corner >> k & 1;
            let place: [usize; 3] = std::array::from_fn(|k| (at[k].0 + side(k)).min(coarse[k] - 1));
            let weight: f64 =
                (0..3).map(|k| if side(k) == 1 { at[k].1 } else { 1.0 - at[k].1 }).product();
            add(&mut sums[(place[2] * ny + place[1]) * nx + place[0]], &pair, weight);
        }
    }
    let mean = 1.0 / judged.len().max(1) as f64;
    let texel = |sum: &[[f64; 3]; 2]| {
        let ratio = |k: usize| {
            let [found, foretold] = [0, 1].map(|i| sum[i][k] + PRIOR * mean * whole[i][k]);
            if foretold > 0.0 { found / foretold } else { 1.0 }
        };
        let [r, g, b] = [0, 1, 2].map(|k| f16::from_f64(ratio(k)).to_bits());
        [r, g, b, 0]
    };
    (coarse, sums.iter().map(texel).collect())
}

fn add(sum: &mut [[f64; 3]; 2], pair: &[[f64; 3]; 2], weight: f64) {
    for (sum, value) in sum.iter_mut().flatten().zip(pair.iter().flatten()) {
        *sum += weight * value;
    }
}
