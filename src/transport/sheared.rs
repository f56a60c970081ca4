//! Optical depth towards one direction, for every place at once.
//!
//! The volume's slices across the direction's main axis are sheared so that its rays become columns; a
//! running sum down the columns then holds τ on each plane between slices, and any point looks it up by
//! trilinear interpolation. One bilinear resampling is all the blur there is, and the cost is one visit a
//! cell and direction, whatever the number of points.

use glam::Vec3;

use super::volume::Volume;

/// Sheared coordinates of a direction: (column x, column y, depth towards the light), in cells.
pub struct Shear {
    /// Index of the main axis and of the two others.
    axes: [usize; 3],
    /// +1 where the light lies towards greater main coordinates.
    sign: f32,
    /// Slope of a ray: change of the other coordinates for each cell of the main one.
    slope: [f32; 2],
    /// Path length through one slice, in cells.
    pub stretch: f32,
}

impl Shear {
    pub fn new(omega: Vec3) -> Shear {
        let w = omega.to_array();
        let main = (0..3).max_by(|&a, &b| w[a].abs().total_cmp(&w[b].abs())).unwrap_or(2);
        let [a, b] = [(main + 1) % 3, (main + 2) % 3];
        Shear {
            axes: [a, b, main],
            sign: w[main].signum(),
            slope: [w[a] / w[main], w[b] / w[main]],
            stretch: 1.0 / w[main].abs(),
        }
    }

    /// A position to (column, column, depth); points of one ray share the columns, and depth grows
    /// towards the light.
    pub fn apply(&self, p: Vec3) -> [f32; 3] {
        let p = p.to_array();
        let depth = p[self.axes[2]];
        [
            p[self.axes[0]] - depth * self.slope[0],
            p[self.axes[1]] - depth * self.slope[1],
            depth * self.sign,
        ]
    }
}

/// τ on the planes between slices, over sheared columns.
pub struct OpticalDepth {
    pub shear: Shear,
    /// Least column index, so that column c of the table is c + first.
    first: [i32; 2],
    columns: [usize; 2],
    slices: usize,
    /// Plane p (0: light side) at `tau[(p * columns[1] + y) * columns[0] + x]`; slices + 1 planes.
    tau: Vec<f32>,
}

impl OpticalDepth {
    pub fn new(volume: &Volume, omega: Vec3) -> OpticalDepth {
        let shear = Shear::new(omega);
        let n = shear.axes.map(|a| volume.dims[a]);
        let extent = |axis: usize| {
            let shift = -(n[2] as f32) * shear.slope[axis];
            let first = shift.min(0.0).floor() as i32 - 1;
            (first, (n[axis] as f32 + shift.max(0.0)).ceil() as i32 - first + 2)
        };
        let ((first_x, width), (first_y, height)) = (extent(0), extent(1));
        let (width, height) = (width as usize, height as usize);
        // The slice's cells, shifted by the shear at its middle: constant weights for a whole slice.
        let slices: Vec<([usize; 2], [f32; 2])> = (0..n[2])
            .map(|slice| {
                let shift = shear.slope.map(|slope| -(slice as f32 + 0.5) * slope);
                let whole = shift.map(f32::floor);
                let to = [0, 1].map(|k| (whole[k] as i32 - [first_x, first_y][k]).max(0) as usize);
                (to, [0, 1].map(|k| shift[k] - whole[k]))
            })
            .collect();
        let mut tau = vec![0.0f32; (n[2] + 1) * width * height];
        volume.crossings(omega, |place, c| {
            let [a, b, slice] = shear.axes.map(|axis| place[axis]);
            let ([to_x, to_y], [fx, fy]) = slices[slice];
            let plane = if shear.sign > 0.0 { n[2] - 1 - slice } else { slice };
            let at = ((plane + 1) * height + b + to_y) * width + a + to_x;
            let c = c * shear.stretch;
            tau[at] += c * (1.0 - fx) * (1.0 - fy);
            tau[at + 1] += c * fx * (1.0 - fy);
            tau[at + width] += c * (1.0 - fx) * fy;
            tau[at + width + 1] += c * fx * fy;
        });
        for plane in 1..=n[2] {
            let (above, below) = tau[(plane - 1) * width * height..].split_at_mut(width * height);
            below.iter_mut().zip(above).for_each(|(below, above)| *below += *above);
        }
        OpticalDepth {
            shear,
            first: [first_x, first_y],
            columns: [width, height],
            slices: n[2],
            tau,
        }
    }

    /// τ from sheared coordinates `q` (see [`Shear::apply`]) to infinity towards the light; 0 beside the volume.
    pub fn tau(&self, q: [f32; 3]) -> f32 {
        let plane = if self.shear.sign > 0.0 { self.slices as f32 - q[2] } else { -q[2] };
        let plane = plane.clamp(0.0, self.slices as f32);
        let x = q[0] - 0.5 - self.first[0] as f32;
        let y = q[1] - 0.5 - self.first[1] as f32;
        let [w, h] = self.columns;
        if !(x >= 0.0 && y >= 0.0 && x < (w - 1) as f32 && y < (h - 1) as f32) {
            return 0.0;
        }
        let (i, j, k) = (x as usize, y as usize, (plane as usize).min(self.slices - 1));
        let (fx, fy, fz) = (x - i as f32, y - j as f32, plane - k as f32);
        let at = |k: usize| {
            let row = &self.tau[(k * h + j) * w + i..];
            let top = row[0] + fx * (row[1] - row[0]);
            let bottom = row[w] + fx * (row[w + 1] - row[w]);
            top + fy * (bottom - top)
        };
        let (near, far) = (at(k), at(k + 1));
        near + fz * (far - near)
    }
}
