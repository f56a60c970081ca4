//! The head's shadow along one direction: a depth map in the sheared coordinates of `sheared`.

use glam::Vec3;

use super::sheared::Shear;

/// Greatest depth towards the light at which the head stands over each texel.
pub struct HeadShadow {
    first: [f32; 2],
    /// Texels per cell.
    scale: f32,
    size: [usize; 2],
    /// −∞ where nothing stands.
    depth: Vec<f32>,
    /// How much deeper than the map a point must lie to be in shadow, in cells.
    bias: f32,
}

/// Texels along the longer side of a shadow map. 192 resolves 1.5 mm on a head.
const RESOLUTION: f32 = 192.0;

impl HeadShadow {
    /// `vertices` in cells. Triangles shade from either side. `bias` in cells.
    pub fn new(vertices: &[Vec3], triangles: &[[u32; 3]], shear: &Shear, bias: f32) -> HeadShadow {
        let sheared: Vec<[f32; 3]> = vertices.iter().map(|&v| shear.apply(v)).collect();
        let mut min = [f32::INFINITY; 2];
        let mut max = [f32::NEG_INFINITY; 2];
        for q in &sheared {
            for axis in 0..2 {
                min[axis] = min[axis].min(q[axis]);
                max[axis] = max[axis].max(q[axis]);
            }
        }
        let extent = (max[0] - min[0]).max(max[1] - min[1]).max(1e-6);
        let scale = RESOLUTION / extent;
        let size = [0, 1].map(|a| ((max[a] - min[a]) * scale).ceil() as usize + 3);
        let mut map = HeadShadow {
            first: [min[0] - 1.0 / scale, min[1] - 1.0 / scale],
            scale,
            size,
            depth: vec![f32::NEG_INFINITY; size[0] * size[1]],
            bias,
        };
        for t in triangles {
            map.draw(t.map(|v| sheared[v as usize]));
        }
        map
    }

    fn draw(&mut self, corners: [[f32; 3]; 3]) {
        let p = corners.map(|c| {
            [(c[0] - self.first[0]) * self.scale, (c[1] - self.first[1]) * self.scale, c[2]]
        });
        let area =
            (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (p[1][1] - p[0][1]);
        if area.abs() < 1e-12 {
            return;
        }
        let range = |axis: usize| {
            let low = p.iter().map(|q| q[axis]).fold(f32::INFINITY, f32::min);
            let high = p.iter().map(|q| q[axis]).fold(f32::NEG_INFINITY, f32::max);
            let first = (low - 0.5).ceil().max(0.0) as usize;
            let end = ((high - 0.5).floor() + 1.0).clamp(0.0, self.size[axis] as f32) as usize;
            first..end
        };
        for y in range(1) {
            for x in range(0) {
                let c = [x as f32 + 0.5, y as f32 + 0.5];
                let edge = |a: [f32; 3], b: [f32; 3]| {
                    ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])) / area
                };
                let w = [edge(p[1], p[2]), edge(p[2], p[0]), edge(p[0], p[1])];
                if w.iter().all(|&w| w >= -1e-4) {
                    let depth = w[0] * p[0][2] + w[1] * p[1][2] + w[2] * p[2][2];
                    let texel = &mut self.depth[y * self.size[0] + x];
                    *texel = texel.max(depth);
                }
            }
        }
    }

    /// Depth towards the light of the head's surface in the column of sheared coordinates `q`, where it lies no
    /// higher than `q`: what a ray away from the light meets.
    pub fn below(&self, q: [f32; 3]) -> Option<f32> {
        let x = (q[0] - self.first[0]) * self.scale;
        let y = (q[1] - self.first[1]) * self.scale;
        let [w, h] = self.size;
        let inside = x >= 0.0 && y >= 0.0 && x < w as f32 && y < h as f32;
        let depth =
            if inside { self.depth[y as usize * w + x as usize] } else { f32::NEG_INFINITY };
        (depth > f32::NEG_INFINITY && depth <= q[2] + self.bias).then_some(depth.min(q[2]))
    }

    /// Visibility (0…1) of the light from sheared coordinates `q`: four comparisons, bilinear.
    pub fn visibility(&self, q: [f32; 3]) -> f32 {
        let x = (q[0] - self.first[0]) * self.scale - 0.5;
        let y = (q[1] - self.first[1]) * self.scale - 0.5;
        let [w, h] = self.size;
        if !(x >= 0.0 && y >= 0.0 && x < (w - 1) as f32 && y < (h - 1) as f32) {
            return 1.0;
        }
        let (i, j) = (x as usize, y as usize);
        let (fx, fy) = (x - i as f32, y - j as f32);
        let open = |i: usize, j: usize| f32::from(self.depth[j * w + i] <= q[2] + self.bias);
        let top = open(i, j) * (1.0 - fx) + open(i + 1, j) * fx;
        let bottom = open(i, j + 1) * (1.0 - fx) + open(i + 1, j + 1) * fx;
        top * (1.0 - fy) + bottom * fy
    }
}
