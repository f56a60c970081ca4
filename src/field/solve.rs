//! Sweeps along ordinates until the light between cells stands still.

use glam::{DVec3, Vec3, Vec3A};
use rayon::prelude::*;

use super::exchange::{Exchange, exchanges, share};
use super::grid::Grid;
use super::palette::Palette;
use super::{Field, Twin};
use crate::lamp::Lamp;
use crate::scattering::fast::Fast;
use crate::srbf::{ORDINATES, SrbfLight, lobe_integral};
use crate::transport::Brought;

/// Rounds end when all that cells send out changes by less than this share of it. White hair takes some 40.
const SETTLED: f64 = 2e-3;
const MOST_ROUNDS: usize = 200;
/// Of a cell within the head, among its neighbours: what is seen of one counts where there is no other.
const HEAD_WEIGHT: f32 = 0.01;

/// Lights, of which the last are the ordinates (`srbf::split_wide`), and lamps near the hair, as they are brought to
/// the grid's samples: lamps come first.
pub struct Lit<'a> {
    pub lamps: &'a [Lamp],
    pub lights: &'a [SrbfLight],
    pub brought: &'a [Brought],
    /// Diffuse reflectance of the head.
    pub head_albedo: Vec3,
}

/// Light that has met a strand or the head, for the fibres that `palette` has of `twin`'s; `head` has its vertices and
/// their irradiance. `progress` is told the share done; false cancels, and the result is then None.
pub fn solve(
    grid: &Grid,
    lit: &Lit,
    head: &[(Vec3, Vec3)],
    palette: &Palette,
    twin: &Twin,
    progress: &dyn Fn(f32) -> bool,
) -> Option<Field> {
    let (narrow, ordinates) = lit.lights.split_at(lit.lights.len() - ORDINATES);
    let (near, brought) = lit.brought.split_at(lit.lamps.len());
    let count = ORDINATES;
    let share = share(ordinates) as f32;
    let fibres: Vec<Fast> = palette.fibres.iter().map(|fibre| twin.of(fibre)).collect();
    let (pairs, pair_of) = pairs(grid, palette);
    let (exchange, tables) = exchanges(&fibres, &pairs, ordinates, narrow);
    let of = |hairy: usize| &exchange[pair_of[hairy]];
    let reached: Vec<Vec<f32>> =
        brought.par_iter().map(|of_light| grid.means(&of_light.samples)).collect();
    let width = ordinates.first().map_or(1.0, |one| one.lambda);
    let lamps: Vec<(&Lamp, Vec<f32>)> = (lit.lamps.iter().zip(near))
        .map(|(lamp, brought)| {
            // What it brings per radiance, so that its nearer side of a cell counts for more.
            let own = grid.samples.iter().zip(&brought.samples);
            let brings = |(p, t): (&Vec3, &f32)| t * lamp.solid_angle(p.as_dvec3()) as f32;
            (lamp, grid.means(&own.map(brings).collect::<Vec<f32>>()))
        })
        .collect();
    // What each hairy cell makes of light that no strand has met.
    let first: Vec<Vec<Vec3A>> = (0..grid.hairy.len())
        .into_par_iter()
        .map(|hairy| {
            let Exchange { of_ordinates, of_lights, .. } = of(hairy);
            let along: Vec<Vec3A> = (ordinates.iter().enumerate())
                .map(|(i, one)| {
                    let rgb = Vec3A::from(one.rgb.map(|c| c as f32));
                    rgb * (reached[narrow.len() + i][hairy] / share)
                })
                .collect();
            let mut sent = products(of_ordinates, &along);
            for (j, of_light) in of_lights.chunks_exact(count).enumerate() {
                let reached = reached[j][hairy];
                sent.iter_mut().zip(of_light).for_each(|(sent, &value)| *sent += reached * value);
            }
            // A lamp as a lobe as wide as an ordinate's, along its direction in the cell, with its energy.
            let table = &tables[palette.of_cell[hairy] as usize];
            for (lamp, brings) in lamps.iter().filter(|(_, brings)| brings[hairy] > 0.0) {
                let light = lamp.lobe(grid.middle(grid.hairy[hairy]).as_dvec3());
                let peak = brings[hairy] / lobe_integral(width) as f32;
                let rgb = peak * Vec3A::from(lamp.radiance.map(|c| c as f32));
                of(hairy).add_lobe(table, light.direction, rgb, &mut sent);
            }
            sent.iter_mut().for_each(|sent| *sent *= palette.tint[hairy]);
            sent
        })
        .collect();
    let glow = head_glow(grid, head, lit.head_albedo);

    let cells = grid.head.len();
    let sweeps: Vec<Sweep> = ordinates.par_iter().map(|one| Sweep::new(grid, one)).collect();
    let head_cells: Vec<usize> = (0..cells).filter(|&cell| grid.head[cell]).collect();
    let albedo = Vec3A::from(lit.head_albedo);
    // Ordinate by ordinate: what cells send out against it, and the mean of what comes along it.
    let mut sent = vec![Vec3A::ZERO; count * cells];
    let mut lit = vec![Vec3A::ZERO; count * cells];
    let mut next = first.clone();
    let mut rounds = 0;
    loop {
        let mean =
            |cell: usize| (0..count).map(|o| lit[o * cells + cell]).sum::<Vec3A>() / count as f32;
        // Half of all directions that something comes from are the head's own.
        let shine: Vec<Vec3A> = head_cells
            .par_iter()
            .map(|&cell| (glow[cell] + 2.0 * albedo * mean(cell)) / (1.0 + albedo))
            .collect();
        let changes = sent.par_chunks_mut(cells).enumerate().map(|(o, sent)| {
            // In f64: the sum over all cells may be beyond f32 where each is within.
            let (mut moved, mut all) = (0.0, 0.0);
            for (&cell, values) in grid.hairy.iter().zip(&next) {
                let before = std::mem::replace(&mut sent[cell as usize], values[o]);
                moved += f64::from((values[o] - before).abs().element_sum());
                all += f64::from(values[o].element_sum());
            }
            for (&cell, &radiance) in head_cells.iter().zip(&shine) {
                sent[cell] = radiance;
            }
            (moved, all)
        });
        let (moved, all) = changes.reduce(|| (0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        if rounds > 0 && moved <= SETTLED * all || rounds == MOST_ROUNDS {
            break;
        }
        let done = if all > 0.0 { (moved / all).max(SETTLED).ln() / SETTLED.ln() } else { 1.0 };
        if !progress(done.clamp(0.0, 1.0) as f32) {
            return None;
        }
        lit.par_chunks_mut(cells)
            .zip(sent.par_chunks(cells))
            .zip(&sweeps)
            .for_each(|((lit, sent), sweep)| sweep.run(grid.volume.dims, sent, lit));
        next = (0..grid.hairy.len())
            .into_par_iter()
            .map(|hairy| {
                let cell = grid.hairy[hairy] as usize;
                let along: Vec<Vec3A> = (0..count).map(|i| lit[i * cells + cell]).collect();
                let mut sent = products(&of(hairy).of_ordinates, &along);
                let tint = palette.tint[hairy];
                let own = sent.iter_mut().zip(&first[hairy]);
                own.for_each(|(sent, &first)| *sent = tint * *sent + first);
                sent
            })
            .collect();
        rounds += 1;
    }
    let radiance = (0..count * cells)
        .map(|i| (share * lit[i], if grid.head[i % cells] { HEAD_WEIGHT } else { 1.0 }));
    Some(Field {
        origin: grid.volume.origin,
        cell: grid.volume.cell,
        dims: grid.volume.dims,
        radiance: radiance.collect(),
        overlap: share.recip(),
        rounds,
    })
}

/// The pairs of a tangent and a fibre that there are, and which each hairy cell has.
fn pairs(grid: &Grid, palette: &Palette) -> (Vec<(DVec3, usize)>, Vec<usize>) {
    let fibres = palette.fibres.len();
    let mut place = vec![None; fibres * grid.tangents.len()];
    let mut pairs = Vec::new();
    let own = grid.tangent_of.iter().zip(&palette.of_cell).map(|(&t, &f)| (t as usize, f as usize));
    let pair_of = own.map(|(tangent, fibre)| {
        *place[tangent * fibres + fibre].get_or_insert_with(|| {
            pairs.push((grid.tangents[tangent], fibre));
            pairs.len() - 1
        })
    });
    let pair_of = pair_of.collect();
    (pairs, pair_of)
}

/// A matrix of rows times a vector.
fn products(rows: &[Vec3A], along: &[Vec3A]) -> Vec<Vec3A> {
    rows.chunks_exact(along.len().max(1))
        .map(|row| row.iter().zip(along).map(|(&k, &l)| k * l).sum())
        .collect()
}

/// What direct light makes of the head's cells: the mean of its vertices there, radiance.
fn head_glow(grid: &Grid, head: &[(Vec3, Vec3)], albedo: Vec3) -> Vec<Vec3A> {
    let mut sums = vec![(Vec3A::ZERO, 0.0f32); grid.head.len()];
    for &(place, e) in head {
        grid.volume.corners(place, |cell, weight| {
            sums[cell].0 += weight * Vec3A::from(e * albedo / std::f32::consts::PI);
            sums[cell].1 += weight;
        });
    }
    sums.into_iter().map(|(sum, weight)| sum / weight.max(f32::MIN_POSITIVE)).collect()
}

/// The way of light along one ordinate through the planes of the grid.
struct Sweep {
    /// Of the light that comes to a cell, above what the cell sends out: the mean on its way through, and the rest.
    kept: Vec<[f32; 2]>,
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
        let kept = crossings.into_iter().zip(&grid.head).map(|(crossings, &head)| {
            let tau = crossings * stretch;
            match (head, tau > 0.0) {
                // It sees all that comes and lets nothing through.
                (true, _) => [1.0, 0.0],
                (false, true) => [-(-tau).exp_m1() / tau, (-tau).exp()],
                (false, false) => [1.0, 1.0],
            }
        });
        Sweep {
            kept: kept.collect(),
            axes,
            rising: way[main] > 0.0,
            back: [1, 2].map(|k| -way[axes[k]] * stretch),
        }
    }

    /// From what cells send out to the mean of what comes along.
    fn run(&self, dims: [usize; 3], sent: &[Vec3A], lit: &mut [Vec3A]) {
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
                    let above = low.lerp(high, fb) - sent[cell];
                    let [mean, rest] = self.kept[cell];
                    lit[cell] = sent[cell] + mean * above;
                    after[at] = sent[cell] + rest * above;
                }
            }
            std::mem::swap(&mut before, &mut after);
        }
    }
}
