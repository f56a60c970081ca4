//! The smooth surface that a head's triangles stand for.

use glam::Vec3;

use super::Head;

/// A normal at a corner lies no farther than this (as a cosine) from its triangle's: about 73°.
const LEAST_COSINE: f32 = 0.3;

/// A place on a triangle: weights of its corners, which add up to 1. Those of weight 0 are vertex 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfacePlace([(u32, f32); 3]);

impl SurfacePlace {
    pub fn vertex(vertex: u32) -> SurfacePlace {
        SurfacePlace([(vertex, 1.0), (0, 0.0), (0, 0.0)])
    }

    pub fn on(corners: [u32; 3], weights: [f32; 3]) -> SurfacePlace {
        SurfacePlace([0, 1, 2].map(|i| (corners[i], weights[i])))
    }

    /// Between places of one triangle, by weights.
    pub fn mix(parts: impl IntoIterator<Item = (f32, SurfacePlace)>) -> SurfacePlace {
        let (mut mixed, mut count) = ([(0, 0.0); 3], 0);
        for (share, place) in parts {
            for (vertex, weight) in place.0.into_iter().filter(|(_, weight)| *weight > 0.0) {
                match mixed[..count].iter_mut().find(|known| known.0 == vertex) {
                    Some(known) => known.1 += share * weight,
                    None if count < 3 => {
                        mixed[count] = (vertex, share * weight);
                        count += 1;
                    }
                    None => debug_assert!(false, "places of different triangles"),
                }
            }
        }
        SurfacePlace(mixed)
    }

    /// What vertices have, here.
    pub fn of(&self, values: &[Vec3]) -> Vec3 {
        self.0.iter().map(|&(vertex, weight)| weight * values[vertex as usize]).sum()
    }

    /// Where rays leave from on `side` (1 the outer, −1 the inner) of the smooth surface: where that bulges, above the
    /// place, by the mean of its heights below the corners' tangent planes, so that flat triangles do not shade themselves
    /// (Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, 2021).
    pub fn lifted(&self, head: &Head, side: f32) -> Vec3 {
        let place = self.of(&head.positions);
        let lift = |&(vertex, weight): &(u32, f32)| {
            let (corner, normal) = (head.positions[vertex as usize], head.normals[vertex as usize]);
            weight * (side * (corner - place).dot(normal)).max(0.0) * side * normal
        };
        place + self.0.iter().map(lift).sum::<Vec3>()
    }
}

impl Head {
    /// Gives corners whose normal turns away from their triangle's, as at the rim of an ear of few triangles, a vertex of
    /// their own with the triangle's.
    pub fn split_folds(&mut self) {
        for triangle in 0..self.triangles.len() {
            let [a, b, c] = self.triangles[triangle].map(|i| self.positions[i as usize]);
            let Some(facet) = (b - a).cross(c - a).try_normalize() else { continue };
            for corner in 0..3 {
                let vertex = self.triangles[triangle][corner] as usize;
                if self.normals[vertex].dot(facet) < LEAST_COSINE {
                    self.triangles[triangle][corner] = self.positions.len() as u32;
                    self.positions.push(self.positions[vertex]);
                    self.normals.push(facet);
                }
            }
        }
    }
}
