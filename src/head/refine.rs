//! A head's triangles fine enough for light at vertices to be crisp.

use std::collections::HashMap;

use glam::Vec3;

use super::{Head, SurfacePlace};

/// Edges are halved so often at most, and no more vertices are made than this.
const ROUNDS: usize = 8;
const MOST_VERTICES: usize = 1 << 19;

/// A head of which long edges are halved; the surface is the same.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FineHead {
    pub head: Head,
    /// Where each vertex lies on the head that this was made of.
    pub places: Vec<SurfacePlace>,
}

impl FineHead {
    /// Halves edges that are longer than `longest` (world units) until none is.
    pub fn new(head: &Head, longest: f32) -> FineHead {
        let places =
            (0..head.positions.len()).map(|vertex| SurfacePlace::vertex(vertex as u32)).collect();
        let mut fine = FineHead { head: head.clone(), places };
        for _ in 0..ROUNDS {
            if !fine.halve(longest) {
                break;
            }
        }
        fine
    }

    /// Whether there was an edge to halve.
    fn halve(&mut self, longest: f32) -> bool {
        let FineHead { head, places } = self;
        let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
        let mut triangles = Vec::with_capacity(head.triangles.len());
        for triangle in std::mem::take(&mut head.triangles) {
            let middle = [0, 1, 2].map(|i| {
                let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
                let ends = [a.min(b), a.max(b)];
                if let Some(&known) = middles.get(&ends) {
                    return Some(known);
                }
                let [p, q] = ends.map(|i| head.positions[i as usize]);
                if p.distance(q) <= longest || head.positions.len() >= MOST_VERTICES {
                    return None;
                }
                let [m, n] = ends.map(|i| head.normals[i as usize]);
                head.positions.push(0.5 * (p + q));
                head.normals.push((m + n).try_normalize().unwrap_or(m));
                places.push(SurfacePlace::mix(ends.map(|i| (0.5, places[i as usize]))));
                let place = head.positions.len() as u32 - 1;
                middles.insert(ends, place);
                Some(place)
            });
            split(triangle, middle, &mut triangles);
        }
        head.triangles = triangles;
        !middles.is_empty()
    }

    /// Values at the vertices of the head that this was made of, at all vertices.
    pub fn spread(&self, values: &[Vec3]) -> Vec<Vec3> {
        match values {
            [] => Vec::new(),
            values => self.places.iter().map(|place| place.of(values)).collect(),
        }
    }
}

/// A triangle by the middles of those of its edges that have one, in the same sense of rotation.
fn split([a, b, c]: [u32; 3], middles: [Option<u32>; 3], into: &mut Vec<[u32; 3]>) {
    match middles {
        [None, None, None] => into.push([a, b, c]),
        [Some(ab), Some(bc), Some(ca)] => {
            into.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        [Some(ab), None, None] => into.extend([[a, ab, c], [ab, b, c]]),
        [Some(ab), Some(bc), None] => into.extend([[a, ab, c], [ab, b, bc], [ab, bc, c]]),
        // Turned until the first edge has a middle, and the third none where there are two.
        [None, ..] | [Some(_), None, Some(_)] => {
            let [ab, bc, ca] = middles;
            match ab {
                None => split([b, c, a], [bc, ca, ab], into),
                Some(_) => split([c, a, b], [ca, ab, bc], into),
            }
        }
    }
}
