//! Hair density as a volume that knows direction.
//!
//! Each cell holds S = Σ d l t⊗t / V over the segments in it (diameter d, length l, unit tangent t). A ray
//! along ω meets ρ(ω) = Σ d l √(1 − (t·ω)²) / V fibres a unit length; with s = tr S we take
//! ρ(ω) = √(s² − s ωᵀSω), exact where the fibres of a cell are parallel, and 4 % high (0.816 against π/4)
//! where they point everywhere.

use std::sync::OnceLock;

use glam::Vec3;

/// A grid of cubic cells around the hair. Cell (i, j, k) is at `cells[(k * dims[1] + j) * dims[0] + i]`.
pub struct Volume {
    /// World position of the corner of cell (0, 0, 0).
    pub origin: Vec3,
    /// Edge of a cell, world units.
    pub cell: f32,
    pub dims: [usize; 3],
    /// S_xx, S_yy, S_zz, S_xy, S_xz, S_yz, per world unit of length.
    pub cells: Vec<[f32; 6]>,
    /// Places (x, y, z) of the cells with hair, in order: most have none.
    hairy: OnceLock<Vec<[u16; 3]>>,
}

/// A part of a segment, of [`Volume::pieces`].
#[derive(Clone, Copy)]
pub struct Piece {
    /// Its middle, world, and how far along the whole segment that is, 0 to 1.
    pub place: Vec3,
    pub along: f32,
    /// Length of all pieces together, world, and their number.
    pub within: f32,
    pub count: f32,
}

impl Volume {
    /// A volume over the box `min`…`max` with `resolution` cells along its longest edge.
    pub fn empty(min: Vec3, max: Vec3, resolution: usize) -> Volume {
        let size = max - min;
        // One empty cell on each side, so that trilinear splats stay inside.
        let cell = (size.max_element() / (resolution.max(3) - 2) as f32).max(f32::MIN_POSITIVE);
        let dims = size.to_array().map(|s| ((s / cell).ceil() as usize + 2).max(3));
        let origin = 0.5 * (min + max)
            - 0.5 * cell * Vec3::new(dims[0] as f32, dims[1] as f32, dims[2] as f32);
        Volume::new(origin, cell, dims, vec![[0.0; 6]; dims[0] * dims[1] * dims[2]])
    }

    /// See the fields.
    pub fn new(origin: Vec3, cell: f32, dims: [usize; 3], cells: Vec<[f32; 6]>) -> Volume {
        Volume { origin, cell, dims, cells, hairy: OnceLock::new() }
    }

    /// Adds a segment, all in world units; what lies outside the box is left out.
    pub fn splat(&mut self, a: Vec3, b: Vec3, diameter: f32) {
        let length = a.distance(b);
        if length <= 0.0 {
            return;
        }
        self.hairy.take();
        let t = (b - a) / length;
        let tensor = [t.x * t.x, t.y * t.y, t.z * t.z, t.x * t.y, t.x * t.z, t.y * t.z];
        let mut cells = std::mem::take(&mut self.cells);
        self.pieces([a, b], 2.0, |Piece { place, within, count, .. }| {
            let weight = diameter * within / count / self.cell.powi(3);
            self.corners(place, |index, share| {
                for (s, u) in cells[index].iter_mut().zip(tensor) {
                    *s += weight * share * u;
                }
            });
        });
        self.cells = cells;
    }

    /// Calls `with` for equal pieces, `fineness` or more to the cell's edge, of what a segment (world) has in the volume
    /// or within a cell of it: their number follows from the volume's size, however long the segment is.
    pub fn pieces(&self, ends: [Vec3; 2], fineness: f32, mut with: impl FnMut(Piece)) {
        let Some([begin, end]) = self.within(ends) else { return };
        let [a, b] = ends.map(Vec3::as_dvec3);
        let whole = (begin, end) == (0.0, 1.0);
        let length = ends[0].distance(ends[1]);
        let within = if whole { length } else { (a.distance(b) * (end - begin)) as f32 };
        let count = (fineness * within / self.cell).ceil().max(1.0);
        for piece in 0..count as usize {
            let share = (piece as f32 + 0.5) / count;
            // In f64, since a stray's end has no digits left for a cell.
            let (place, along) = match whole {
                true => (ends[0].lerp(ends[1], share), share),
                false => {
                    let along = begin + (end - begin) * f64::from(share);
                    (a.lerp(b, along).as_vec3(), along as f32)
                }
            };
            with(Piece { place, along, within, count });
        }
    }

    /// The part of a segment (0 to 1, from its start) that is in the volume or within a cell of it.
    fn within(&self, ends: [Vec3; 2]) -> Option<[f64; 2]> {
        let size = Vec3::from(self.dims.map(|n| n as f32));
        let [a, b] = ends.map(|p| self.to_cells(p));
        let inside = |p: Vec3| p.cmpge(Vec3::NEG_ONE).all() && p.cmple(size + 1.0).all();
        if inside(a) && inside(b) {
            return Some([0.0, 1.0]);
        }
        let (mut begin, mut end) = (0.0f64, 1.0f64);
        let (a, way) = (a.as_dvec3(), b.as_dvec3() - a.as_dvec3());
        for axis in 0..3 {
            let (low, high) = (-1.0 - a[axis], f64::from(size[axis]) + 1.0 - a[axis]);
            if way[axis] == 0.0 {
                if low > 0.0 || high < 0.0 {
                    return None;
                }
                continue;
            }
            let (low, high) = (low / way[axis], high / way[axis]);
            begin = begin.max(low.min(high));
            end = end.min(low.max(high));
        }
        (begin < end).then_some([begin, end])
    }

    /// Of the cell that `p` (world) lies in.
    pub fn index_of(&self, p: Vec3) -> Option<usize> {
        let q = self.to_cells(p).floor();
        let inside = (0..3).all(|axis| q[axis] >= 0.0 && q[axis] < self.dims[axis] as f32);
        let [x, y, z] = q.to_array().map(|at| at as usize);
        inside.then(|| (z * self.dims[1] + y) * self.dims[0] + x)
    }

    /// Calls `with` for the up to eight cells around `p` (world), with trilinear weights.
    pub fn corners(&self, p: Vec3, mut with: impl FnMut(usize, f32)) {
        let q = self.to_cells(p) - 0.5;
        // Farther away whole numbers end.
        if q.abs().max_element() >= 1e9 {
            return;
        }
        let base = q.floor();
        let f = q - base;
        for corner in 0..8usize {
            let [i, j, k] = [corner & 1, (corner >> 1) & 1, corner >> 2];
            let at = [
                base.x as isize + i as isize,
                base.y as isize + j as isize,
                base.z as isize + k as isize,
            ];
            if at.iter().zip(self.dims).all(|(&c, n)| c >= 0 && c < n as isize) {
                let [x, y, z] = at.map(|c| c as usize);
                let weight = [1.0 - f.x, f.x][i] * [1.0 - f.y, f.y][j] * [1.0 - f.z, f.z][k];
                with((z * self.dims[1] + y) * self.dims[0] + x, weight);
            }
        }
    }

    /// World position of the middle of a cell.
    pub fn middle(&self, index: usize) -> Vec3 {
        let [nx, ny, _] = self.dims;
        let at = [index % nx, index / nx % ny, index / nx / ny].map(|at| at as f32 + 0.5);
        self.origin + self.cell * Vec3::from(at)
    }

    /// World position to cells: the corner of cell (0, 0, 0) is the origin.
    pub fn to_cells(&self, p: Vec3) -> Vec3 {
        (p - self.origin) / self.cell
    }

    /// ρ(ω) · cell for every cell: crossings expected over one cell's edge, for unit ω.
    pub fn crossings_per_cell(&self, omega: Vec3) -> Vec<f32> {
        let mut crossings = vec![0.0; self.cells.len()];
        self.crossings(omega, |[x, y, z], c| {
            crossings[(z * self.dims[1] + y) * self.dims[0] + x] = c;
        });
        crossings
    }

    /// The same of the cells with hair alone, by their places.
    pub fn crossings(&self, omega: Vec3, mut with: impl FnMut([usize; 3], f32)) {
        let quadratic = quadratic(omega);
        let [across, down, _] = self.dims;
        let places = self.hairy.get_or_init(|| {
            let hairy = |&i: &usize| self.cells[i][..3].iter().sum::<f32>() != 0.0;
            let place = |i: usize| [i % across, i / across % down, i / across / down];
            let hairy = (0..self.cells.len()).filter(hairy);
            hairy.map(|i| place(i).map(|at| at as u16)).collect()
        });
        for place in places {
            let [x, y, z] = place.map(usize::from);
            with([x, y, z], self.of_cell(&self.cells[(z * down + y) * across + x], &quadratic));
        }
    }

    /// ρ(ω) · cell of one cell.
    fn of_cell(&self, c: &[f32; 6], quadratic: &[f32; 6]) -> f32 {
        let s = c[0] + c[1] + c[2];
        if s == 0.0 {
            return 0.0;
        }
        let along: f32 = c.iter().zip(quadratic).map(|(a, b)| a * b).sum();
        self.cell * (s * (s - along)).max(0.0).sqrt()
    }

    /// τ, the crossings expected from `p` along unit `omega` over `length`, both in cells: cell by cell on the way
    /// (Amanatides and Woo 1987).
    pub fn march(&self, p: Vec3, omega: Vec3, length: f32) -> f32 {
        let quadratic = quadratic(omega);
        // No axis is quite at a right angle, so that nothing is 0 times infinity.
        let steep = Vec3::select(omega.abs().cmplt(Vec3::splat(1e-12)), Vec3::splat(1e-12), omega);
        let inverse = steep.recip();
        let size = Vec3::from(self.dims.map(|n| n as f32));
        let (low, high) = (-p * inverse, (size - p) * inverse);
        let begin = low.min(high).max_element().max(0.0);
        let end = low.max(high).min_element().min(length);
        if begin >= end {
            return 0.0;
        }
        let first = (p + begin * steep).floor().clamp(Vec3::ZERO, size - 1.0);
        let ahead = Vec3::select(steep.cmpgt(Vec3::ZERO), first + 1.0, first);
        let mut next = ((ahead - p) * inverse).to_array();
        let each = inverse.abs().to_array();
        let mut at = first.to_array().map(|c| c as isize);
        let step = steep.to_array().map(|c| if c > 0.0 { 1 } else { -1 });
        let (mut tau, mut t) = (0.0, begin);
        loop {
            let axis = (0..3).min_by(|&a, &b| next[a].total_cmp(&next[b])).unwrap_or(0);
            let until = next[axis].min(end);
            let index = (at[2] as usize * self.dims[1] + at[1] as usize) * self.dims[0];
            let cell = &self.cells[index + at[0] as usize];
            tau += self.of_cell(cell, &quadratic) * (until - t).max(0.0);
            at[axis] += step[axis];
            if until >= end || at[axis] < 0 || at[axis] >= self.dims[axis] as isize {
                return tau;
            }
            t = until;
            next[axis] += each[axis];
        }
    }
}

/// The products of ω's parts by which S is weighted in ωᵀSω.
fn quadratic(omega: Vec3) -> [f32; 6] {
    let [x, y, z] = omega.to_array();
    [x * x, y * y, z * z, 2.0 * x * y, 2.0 * x * z, 2.0 * y * z]
}
