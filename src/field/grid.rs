//! The hair as a medium of few cells.

use glam::{DVec3, Mat3, Vec3};
use rayon::prelude::*;

use crate::stage::Geometry;
use crate::transport::Occluders;
use crate::transport::volume::{Piece, Volume};

/// Tangents that stand for all: half of them are within 6° of the next.
const TANGENTS: usize = 256;
/// Pieces of a segment to the edge of a cell.
pub(super) const PIECES: f32 = 4.0;
/// A cell is the head's where less than this share of all directions is open.
const OPEN: f32 = 0.25;

/// What is hair, what head, and how strands lie.
pub struct Grid {
    /// Of S, as [`Volume`] has it, each segment in its own cell alone: what shines and what takes is the same hair.
    pub volume: Volume,
    /// Indices of the cells with hair.
    pub hairy: Vec<u32>,
    /// A place on a strand for each eighth of a cell that has hair, world frame, and the hair that it stands for.
    pub samples: Vec<Vec3>,
    sample_weights: Vec<f32>,
    /// The usual tangents, root to tip, and which of them each hairy cell has.
    pub(super) tangents: Vec<DVec3>,
    pub(super) tangent_of: Vec<u32>,
    /// Cells within the head.
    pub(super) head: Vec<bool>,
}

/// What the segments of a cell add up to.
#[derive(Clone)]
struct Heap {
    tensor: Mat3,
    tangent: Vec3,
    /// Their number, and the last of them.
    strands: f32,
    strand: u32,
    /// Each eighth's hair, and a place on some of it.
    eighths: [(f32, Vec3); 8],
}

impl Grid {
    /// `cells` along the longest edge; `occluders` tell where the head is.
    pub fn new(stage: &Geometry, occluders: &Occluders, cells: usize) -> Grid {
        let empty = stage.empty_volume(cells);
        let Volume { cell, dims, .. } = empty;
        let nothing = Heap {
            tensor: Mat3::ZERO,
            tangent: Vec3::ZERO,
            strands: 0.0,
            strand: u32::MAX,
            eighths: [(0.0, Vec3::ZERO); 8],
        };
        let mut heaps = vec![nothing; dims[0] * dims[1] * dims[2]];
        let mut number = 1;
        for (strand, points) in (0..).zip(stage.hair.strands()) {
            for segment in stage.segments_of(points) {
                add(&mut heaps, &empty, strand, segment, &mut number);
            }
        }
        let tensors = heaps.iter().map(|heap| {
            // Alone, a strand meets nothing. To leave each out of what it meets where there are more makes frames of
            // sintel 3 % darker, and no better.
            let others = if heap.strands > 1.0 { cell.powi(-3) } else { 0.0 };
            let [x, y, z] = (heap.tensor * others).to_cols_array_2d();
            [x[0], y[1], z[2], x[1], x[2], y[2]]
        });
        let volume = Volume::new(empty.origin, cell, dims, tensors.collect());
        let head = inside_head(&volume, occluders);
        let has_hair = |heap: &Heap| heap.eighths.iter().any(|eighth| eighth.0 > 0.0);
        let hairy: Vec<u32> = (0..heaps.len())
            .filter(|&i| has_hair(&heaps[i]) && !head[i])
            .map(|i| i as u32)
            .collect();
        let eighths = hairy.iter().flat_map(|&i| heaps[i as usize].eighths);
        let (sample_weights, samples) = eighths.filter(|&(hair, _)| hair > 0.0).unzip();
        let (tangents, tangent_of) = usual_tangents(hairy.iter().map(|&i| &heaps[i as usize]));
        Grid { samples, sample_weights, volume, hairy, tangents, tangent_of, head }
    }
}

impl Grid {
    /// World position of the middle of a cell.
    pub(super) fn middle(&self, cell: u32) -> Vec3 {
        self.volume.middle(cell as usize)
    }

    /// Means over each hairy cell of what is known at [`Self::samples`]: those around count as well, the less the
    /// farther they are, or the noise of a few samples would show as spots.
    pub(super) fn means(&self, of_samples: &[f32]) -> Vec<f32> {
        let mut sums = vec![[0.0f32; 2]; self.head.len()];
        for ((&place, hair), value) in self.samples.iter().zip(&self.sample_weights).zip(of_samples)
        {
            self.volume.corners(place, |cell, weight| {
                sums[cell][0] += weight * hair * value;
                sums[cell][1] += weight * hair;
            });
        }
        let mean =
            |&cell: &u32| sums[cell as usize][0] / sums[cell as usize][1].max(f32::MIN_POSITIVE);
        self.hairy.iter().map(mean).collect()
    }
}

impl Grid {
    /// [`Self::means`] in all cells, None where there is no hair.
    pub fn spread(&self, of_samples: &[f32]) -> Vec<Option<f32>> {
        let mut cells = vec![None; self.head.len()];
        for (&cell, mean) in self.hairy.iter().zip(self.means(of_samples)) {
            cells[cell as usize] = Some(mean);
        }
        cells
    }
}

fn add(
    heaps: &mut [Heap],
    volume: &Volume,
    strand: u32,
    (a, b, diameter): (Vec3, Vec3, f32),
    number: &mut u32,
) {
    let length = a.distance(b);
    if length <= 0.0 {
        return;
    }
    let t = (b - a) / length;
    volume.pieces([a, b], PIECES, |Piece { place: p, within, count, .. }| {
        let Some(index) = volume.index_of(p) else { return };
        let weight = diameter * within / count;
        let heap = &mut heaps[index];
        heap.tensor += Mat3::from_cols(weight * t.x * t, weight * t.y * t, weight * t.z * t);
        heap.tangent += weight * t;
        if heap.strand != strand {
            heap.strand = strand;
            heap.strands += 1.0;
        }
        let within = (volume.to_cells(p).fract() * 2.0).floor();
        let (hair, place) =
            &mut heap.eighths[(within.x + 2.0 * within.y + 4.0 * within.z) as usize & 7];
        *hair += weight;
        // A piece is kept by its share of the hair so far (Chao 1982), with numbers that do not change.
        let chance = *number as f32 / 2f32.powi(32);
        *number = number.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        if chance * *hair < weight {
            *place = p;
        }
    });
}

/// Of each cell the axis that most hair lies along, on the side that it grows to, as one of few.
fn usual_tangents<'a>(heaps: impl Iterator<Item = &'a Heap>) -> (Vec<DVec3>, Vec<u32>) {
    let lattice = crate::srbf::lattice(TANGENTS);
    let heaps: Vec<&Heap> = heaps.collect();
    let nearest: Vec<usize> = heaps
        .par_iter()
        .map(|heap| {
            let t = main_axis(heap.tensor);
            let t = if t.dot(heap.tangent) < 0.0 { -t } else { t }.as_dvec3();
            let closer = |&a: &usize, &b: &usize| lattice[a].dot(t).total_cmp(&lattice[b].dot(t));
            (0..TANGENTS).max_by(closer).unwrap_or(0)
        })
        .collect();
    let mut place = [None; TANGENTS];
    let mut tangents = Vec::new();
    let tangent_of = nearest.iter().map(|&i| {
        *place[i].get_or_insert_with(|| {
            tangents.push(lattice[i]);
            tangents.len() as u32 - 1
        })
    });
    let tangent_of = tangent_of.collect();
    (tangents, tangent_of)
}

/// The eigenvector of the greatest eigenvalue of a symmetric matrix that has no negative one, by squaring it.
fn main_axis(tensor: Mat3) -> Vec3 {
    let mut power = tensor;
    for _ in 0..8 {
        let trace = power.x_axis.x + power.y_axis.y + power.z_axis.z;
        power *= trace.max(f32::MIN_POSITIVE).recip();
        power = power * power;
    }
    let columns = [power.x_axis, power.y_axis, power.z_axis];
    let longest = columns.into_iter().max_by(|a, b| a.length().total_cmp(&b.length()));
    longest.and_then(Vec3::try_normalize).unwrap_or(Vec3::Y)
}

fn inside_head(volume: &Volume, occluders: &Occluders) -> Vec<bool> {
    let [nx, ny, nz] = volume.dims;
    if occluders.head.is_none() {
        return vec![false; nx * ny * nz];
    }
    let places: Vec<Vec3> = (0..nx * ny * nz).map(|i| volume.middle(i)).collect();
    occluders.openness(&places).into_iter().map(|open| open < OPEN).collect()
}
