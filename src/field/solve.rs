//! Sweeps along ordinates until the light between cells stands still.

use glam::{Vec3, Vec3A};
use rayon::prelude::*;

use super::exchange::{Exchange, exchanges, share};
use super::grid::Grid;
use super::{Field, SAMPLES};
use crate::scattering::fast::Fast;
use crate::srbf::{ORDINATES, SrbfLight};
use crate::stage::HEAD_ALBEDO;
use crate::transport::Transport;

/// Rounds end when all that cells send out changes by less than this share of it. White hair takes some 40.
const SETTLED: f32 = 2e-3;
const MOST_ROUNDS: usize = 200;
/// Of a cell within the head, among its neighbours: what is seen of one counts where there is no other.
const HEAD_WEIGHT: f32 = 0.01;

/// Light that has met a strand or the head, for a fibre and `lights` of which the last are the ordinates
/// (`srbf::split_wide`); `transport` is theirs, to the grid's samples and to the head, whose vertices are at `head`.
/// `progress` is told the share done; false cancels, and the result is then None.
pub fn solve(
    grid: &Grid,
    lights: &[SrbfLight],
    transport: &Transport,
    head: &[Vec3],
    fast: &Fast,
    progress: &dyn Fn(f32) -> bool,
) -> Option<Field> {
    let (narrow, ordinates) = lights.split_at(lights.len() - ORDINATES);
    let count = ORDINATES;
    let share = share(ordinates) as f32;
    let exchange = exchanges(fast, &grid.tangents, ordinates, narrow);
    let of = |hairy: usize| &exchange[grid.tangent_of[hairy] as usize];
    // T̃ of light j in a hairy cell.
    let reach = |j: usize, hairy: usize| {
        let of_samples = &transport.samples[j][SAMPLES * hairy..SAMPLES * (hairy + 1)];
        of_samples.iter().sum::<f32>() / SAMPLES as f32
    };
    // What each hairy cell makes of light that no strand has met.
    let first: Vec<Vec<Vec3A>> = (0..grid.hairy.len())
        .into_par_iter()
        .map(|hairy| {
            let Exchange { of_ordinates, of_lights } = of(hairy);
            let along: Vec<Vec3A> = (ordinates.iter().enumerate())
                .map(|(i, one)| {
                    let rgb = Vec3A::from(one.rgb.map(|c| c as f32));
                    rgb * (reach(narrow.len() + i, hairy) / share)
                })
                .collect();
            let mut sent = products(of_ordinates, &along);
            for (j, of_light) in of_lights.chunks_exact(count).enumerate() {
                let reach = reach(j, hairy);
                sent.iter_mut().zip(of_light).for_each(|(sent, &value)| *sent += reach * value);
            }
            sent
        })
        .collect();
    let glow = head_glow(grid, head, &transport.head_irradiance);

    let cells = grid.head.len();
    let sweeps: Vec<Sweep> = ordinates.par_iter().map(|one| Sweep::new(grid, one)).collect();
    // Ordinate by ordinate: what cells send out against it, and the mean of what comes along it.
    let mut sent = vec![Vec3A::ZERO; count * cells];
    let mut lit = vec![Vec3A::ZERO; count * cells];
    let set = |sent: &mut [Vec3A], cell: usize, values: &dyn Fn(usize) -> Vec3A| {
        (0..count).fold([0.0; 2], |[moved, all], o| {
            let (now, before) = (values(o), std::mem::replace(&mut sent[o * cells + cell], values(o)));
            [moved + (now - before).abs().element_sum(), all + now.element_sum()]
        })
    };
    let mut next: Vec<Vec<Vec3A>> = first.clone();
    let mut rounds = 0;
    loop {
        let (mut moved, mut all) = (0.0, 0.0);
        for (&cell, values) in grid.hairy.iter().zip(&next) {
            let [m, a] = set(&mut sent, cell as usize, &|o| values[o]);
            (moved, all) = (moved + m, all + a);
        }
        for (cell, &glow) in glow.iter().enumerate().filter(|&(cell, _)| grid.head[cell]) {
            // Half of all directions of what comes are the head's own.
            let mean = (0..count).map(|o| lit[o * cells + cell]).sum::<Vec3A>() / count.max(1) as f32;
            let albedo = Vec3A::from(HEAD_ALBEDO);
            let radiance = (glow + 2.0 * albedo * mean) / (1.0 + albedo);
            set(&mut sent, cell, &|_| radiance);
        }
        if rounds > 0 && moved <= SETTLED * all || rounds == MOST_ROUNDS {
            break;
        }
        let share_done = if all > 0.0 { (moved / all).max(SETTLED).ln() / SETTLED.ln() } else { 1.0 };
        if !progress(share_done.clamp(0.0, 1.0)) {
            return None;
        }
        lit.par_chunks_mut(cells.max(1))
            .zip(sent.par_chunks(cells.max(1)))
            .zip(&sweeps)
            .for_each(|((lit, sent), sweep)| sweep.run(grid, sent, lit));
        next = (0..grid.hairy.len())
            .into_par_iter()
            .map(|hairy| {
                let cell = grid.hairy[hairy] as usize;
                let along: Vec<Vec3A> = (0..count).map(|i| lit[i * cells + cell]).collect();
                let mut sent = products(&of(hairy).of_ordinates, &along);
                sent.iter_mut().zip(&first[hairy]).for_each(|(sent, &first)| *sent += first);
                sent
            })
            .collect();
        rounds += 1;
    }
    let radiance = (0..count * cells).map(|i| {
        (share * lit[i], if grid.head[i % cells] { HEAD_WEIGHT } else { 1.0 })
    });
    Some(Field {
        origin: grid.volume.origin,
        cell: grid.volume.cell,
        dims: grid.volume.dims,
        radiance: radiance.collect(),
        rounds,
    })
}

/// A matrix of rows times a vector.
fn products(rows: &[Vec3A], along: &[Vec3A]) -> Vec<Vec3A> {
    rows.chunks_exact(along.len().max(1))
        .map(|row| row.iter().zip(along).map(|(&k, &l)| k * l).sum())
        .collect()
}

/// What direct light makes of the head's cells: the mean of its vertices there, radiance.
fn head_glow(grid: &Grid, vertices: &[Vec3], irradiance: &[Vec3]) -> Vec<Vec3A> {
    let mut sums = vec![(Vec3A::ZERO, 0.0f32); grid.head.len()];
    for (&place, &e) in vertices.iter().zip(irradiance) {
        grid.volume.corners(place, |cell, weight| {
            sums[cell].0 += weight * Vec3A::from(e * HEAD_ALBEDO / std::f32::consts::PI);
            sums[cell].1 += weight;
        });
    }
    sums.into_iter().map(|(sum, weight)| sum / weight.max(f32::MIN_POSITIVE)).collect()
}

/// The way of light along one ordinate through the planes of the grid.
struct Sweep {
    /// ρ times the way through a cell.
    tau: Vec<f32>,
    /// Axes: the one across planes, and those within.
    axes: [usize; 3],
    /// Whether planes are passed in rising order.
    rising: bool,
    /// Where light comes from, in cells of the plane before.
    back: [f32; 2],
}

impl Sweep {
    fn new(grid: &Grid, ordinate: &SrbfLight) -> Sweep {
        // Light comes from the ordinate.
        let way = -ordinate.direction.as_vec3();
        let main = (0..3).max_by(|&a, &b| way[a].abs().total_cmp(&way[b].abs())).unwrap_or(0);
        let axes = [main, (main + 1) % 3, (main + 2) % 3];
        let stretch = way[main].abs().recip();
        let crossings = grid.volume.crossings_per_cell(way);
        Sweep {
            tau: crossings.into_iter().map(|c| c * stretch).collect(),
            axes,
            rising: way[main] > 0.0,
            back: [1, 2].map(|k| -way[axes[k]] * stretch),
        }
    }

    /// From what cells send out to the mean of what comes along.
    fn run(&self, grid: &Grid, sent: &[Vec3A], lit: &mut [Vec3A]) {
        let dims = grid.volume.dims;
        let strides = [1, dims[0], dims[0] * dims[1]];
        let [main, a, b] = self.axes;
        // A plane with a dark cell on every side.
        let width = dims[a] + 2;
        let mut before = vec![Vec3A::ZERO; width * (dims[b] + 2)];
        let mut after = before.clone();
        let whole = self.back.map(|back| back.floor().min(0.0));
        let [fa, fb] = [0, 1].map(|k| self.back[k] - whole[k]);
        let shift = whole[1] as isize * width as isize + whole[0] as isize;
        for step in 0..dims[main] {
            let plane = if self.rising { step } else { dims[main] - 1 - step };
            for y in 0..dims[b] {
                for x in 0..dims[a] {
                    let cell = plane * strides[main] + x * strides[a] + y * strides[b];
                    let at = (y + 1) * width + x + 1;
                    let from = at.wrapping_add_signed(shift);
                    let low = before[from].lerp(before[from + 1], fa);
                    let high = before[from + width].lerp(before[from + width + 1], fa);
                    let comes = low.lerp(high, fb);
                    let tau = self.tau[cell];
                    if grid.head[cell] {
                        (lit[cell], after[at]) = (comes, sent[cell]);
                    } else if tau > 0.0 {
                        // L − S falls off along the way, and so does its mean.
                        let [mean, left] = [-(-tau).exp_m1() / tau, (-tau).exp()];
                        lit[cell] = sent[cell] + mean * (comes - sent[cell]);
                        after[at] = sent[cell] + left * (comes - sent[cell]);
                    } else {
                        (lit[cell], after[at]) = (comes, comes);
                    }
                }
            }
            std::mem::swap(&mut before, &mut after);
        }
    }
}
