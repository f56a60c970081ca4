//! Points within a head's triangles, as dense as pixels, where its light changes faster than between vertices.

use std::collections::HashMap;

use super::{FineHead, SurfacePlace};

/// Corners of a triangle of a fine head, and how many steps of [`Detail::across`] a point is towards each.
type Steps = [(u32, u32); 3];

/// A point of a lattice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetailPoint {
    /// Of the fine head; the first that it was found in.
    triangle: u32,
    /// Towards each corner.
    steps: [u32; 3],
    /// Bit by bit, which lights differ in one of its triangles.
    pub lights: u64,
}

/// A triangular lattice in some triangles of a head; `Detail` of shaders/resolve.wgsl.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Detail {
    /// Steps along an edge.
    pub across: u32,
    /// Each once: triangles share those of their edges.
    pub points: Vec<DetailPoint>,
    /// Of each triangle: 0, or where in this list its points begin, row by row from the first edge. They count from 0 as
    /// `points` does.
    pub words: Vec<u32>,
}

impl Detail {
    /// Of the `triangles` that are wanted, each with the lights that differ in it. Others count for the points on their
    /// edges alone, so that those do not depend on what else is wanted.
    pub fn new(fine: &FineHead, across: u32, triangles: &[(u32, u64, bool)]) -> Detail {
        let all = &fine.head.triangles;
        let mut detail = Detail { across, points: Vec::new(), words: vec![0; all.len()] };
        let mut known: HashMap<Steps, u32> = HashMap::new();
        let wanted = triangles.iter().filter(|triangle| triangle.2);
        let others = triangles.iter().filter(|triangle| !triangle.2);
        for &(triangle, lights, wanted) in wanted.chain(others) {
            let [a, b, c] = all[triangle as usize];
            if wanted {
                detail.words[triangle as usize] = detail.words.len() as u32;
            }
            for j in 0..=across {
                for i in 0..=across - j {
                    let steps = [across - i - j, i, j];
                    let mut key = [(a, steps[0]), (b, i), (c, j)];
                    key.iter_mut().filter(|(_, steps)| *steps == 0).for_each(|none| *none = (0, 0));
                    key.sort_unstable();
                    let next = detail.points.len() as u32;
                    let index = match wanted {
                        true => *known.entry(key).or_insert(next),
                        false => known.get(&key).copied().unwrap_or(u32::MAX),
                    };
                    match detail.points.get_mut(index as usize) {
                        Some(point) => point.lights |= lights,
                        None if wanted => {
                            detail.points.push(DetailPoint { triangle, steps, lights });
                        }
                        None => {}
                    }
                    if wanted {
                        detail.words.push(index);
                    }
                }
            }
        }
        detail
    }

    /// The corners of a point's triangle, vertices of the fine head, with their shares of it.
    pub fn corners(&self, fine: &FineHead, point: &DetailPoint) -> [(u32, f32); 3] {
        let corners = fine.head.triangles[point.triangle as usize];
        [0, 1, 2].map(|i| (corners[i], point.steps[i] as f32 / self.across as f32))
    }

    /// Where a point lies on the head that the fine one was made of.
    pub fn place(&self, fine: &FineHead, point: &DetailPoint) -> SurfacePlace {
        let corners = self.corners(fine, point);
        SurfacePlace::mix(corners.map(|(vertex, share)| (share, fine.places[vertex as usize])))
    }
}
