//! Strands: what a groom is, wherever it comes from.

mod curve;
pub mod groom;
pub mod hair_format;
mod load;
mod mend;
mod refine;
mod reverse;
pub mod tfx_format;
mod width;

use glam::Vec3;
use std::ops::Range;

pub use curve::{Frames, normals, pieces};
pub use load::{FileDetails, LoadOptions, LoadedHair, OnHead, load, load_on};
pub use mend::{Mended, mend};
pub use refine::{Refined, refine};
pub use reverse::{is_reversed, reverse};
pub use width::{Diameter, fibre_diameter, metre, width_profile};

/// How many times the usual strand's distance and size away from the middle a strand is still part of the
/// view.
const STRAY_REACH: f32 = 8.0;

/// Strands of hair, each a polyline from root to tip.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hair {
    /// Points of all strands, strand after strand, root first.
    pub points: Vec<Vec3>,
    /// Strand `s` owns `points[offsets[s]..offsets[s + 1]]`; length: strands + 1, first 0.
    pub offsets: Vec<u32>,
    /// Thickness (a diameter, in the file's own unit) at each point, where the source has it.
    pub thickness: Option<Vec<f32>>,
    /// Colour at each point (0…1), where the source has it.
    pub color: Option<Vec<[f32; 3]>>,
    /// Transparency at each point (0…1), where the source has it.
    pub transparency: Option<Vec<f32>>,
}

impl Hair {
    pub fn strand_count(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// The range of each strand in `points` and in the other arrays.
    pub fn strands(&self) -> impl ExactSizeIterator<Item = Range<usize>> + Clone {
        self.offsets.windows(2).map(|ends| ends[0] as usize..ends[1] as usize)
    }

    /// First and last point of each point's strand.
    pub fn strand_ends(&self) -> Vec<[u32; 2]> {
        let of_strand = |points: Range<usize>| {
            let ends = [points.start as u32, (points.end.max(points.start + 1) - 1) as u32];
            std::iter::repeat_n(ends, points.len())
        };
        self.strands().flat_map(of_strand).collect()
    }

    /// The points of each strand.
    pub fn polylines(&self) -> impl ExactSizeIterator<Item = &[Vec3]> + Clone {
        self.strands().map(|range| &self.points[range])
    }

    /// Lower and upper corner of the box around all points; zero where there are none.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        bounds(&self.points)
    }

    /// A sphere around the hair to fit a camera to: centre and radius; zero where there is none.
    ///
    /// Strands that lie or reach farther from the median strand than 8 times the median strand's distance
    /// and size are strays and left out (in eight grooms the farthest strand reaches 2.9), so that one
    /// strand at 1e7 does not shrink all others to a dot.
    pub fn center_radius(&self) -> (Vec3, f32) {
        let strays = self.strays();
        let (low, high) = bounds(self.fitted(&strays));
        let center = low.midpoint(high);
        let radius = self.fitted(&strays).map(|p| p.distance(center)).fold(0.0, f32::max);
        (center, radius)
    }

    /// Corners of the box around all strands but strays.
    pub fn fitted_bounds(&self) -> (Vec3, Vec3) {
        bounds(self.fitted(&self.strays()))
    }

    fn fitted(&self, strays: &[bool]) -> impl Iterator<Item = &Vec3> {
        let strands = self.polylines().zip(strays).filter(|(_, stray)| !**stray);
        strands.flat_map(|(points, _)| points)
    }

    /// Of each strand, whether it is a stray: see [`Self::center_radius`].
    pub fn strays(&self) -> Vec<bool> {
        let boxes: Vec<(Vec3, f32)> = self
            .polylines()
            .map(bounds)
            .map(|(low, high)| (low.midpoint(high), high.distance(low) / 2.0))
            .collect();
        let (middle, distance) = median_distance(boxes.iter().map(|b| b.0));
        let size = median(boxes.iter().map(|b| b.1));
        let reach = STRAY_REACH * (distance + size);
        let held = |(center, radius): &(Vec3, f32)| center.distance(middle) + radius <= reach;
        boxes.iter().map(|of| !held(of)).collect()
    }

    /// Length of all strands together.
    pub fn total_length(&self) -> f64 {
        self.polylines().map(length).sum()
    }
}

/// Length of a polyline.
fn length(points: &[Vec3]) -> f64 {
    let step = |ends: &[Vec3]| (ends[1].as_dvec3() - ends[0].as_dvec3()).length();
    points.windows(2).map(step).sum()
}

fn bounds<'a>(points: impl IntoIterator<Item = &'a Vec3>) -> (Vec3, Vec3) {
    points
        .into_iter()
        .map(|&p| (p, p))
        .reduce(|(low, high), (p, _)| (low.min(p), high.max(p)))
        .unwrap_or_default()
}

/// The median of each coordinate, and the median distance from there.
pub(crate) fn median_distance(points: impl Iterator<Item = Vec3> + Clone) -> (Vec3, f32) {
    let axis = |i: usize| median(points.clone().map(|p| p[i]));
    let middle = Vec3::new(axis(0), axis(1), axis(2));
    let distance = median(points.clone().map(|p| p.distance(middle)));
    (middle, distance)
}

/// The (upper) median; 0 of nothing.
fn median(values: impl Iterator<Item = f32>) -> f32 {
    quantile(values, 0.5)
}

/// The value that a share `q` (0…1) of all lies below; 0 of nothing.
fn quantile(values: impl Iterator<Item = f32>, q: f64) -> f32 {
    let mut values: Vec<f32> = values.collect();
    let at = (values.len() as f64 * q) as usize;
    match values.len() {
        0 => 0.0,
        n => *values.select_nth_unstable_by(at.min(n - 1), f32::total_cmp).1,
    }
}

/// Rows of `N` little-endian floats; bytes that fill no row are left out.
fn float_rows<const N: usize>(bytes: &[u8]) -> impl Iterator<Item = [f32; N]> {
    let (floats, _) = bytes.as_chunks::<4>();
    let (rows, _) = floats.as_chunks::<N>();
    rows.iter().map(|row| row.map(f32::from_le_bytes))
}
