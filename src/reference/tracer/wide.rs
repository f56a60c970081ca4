//! A BVH of eight children a node and four items a leaf, so that a ray meets boxes and its owner items four
//! at a time, as wide as the vectors of every CPU are.
//!
//! Built from above by the surface area heuristic over bins (Wald 2007). `obvhs`, which builds from below, takes
//! time quadratic in the number of equal boxes and stacks them a thousand deep (8,000 equal strands: 9 s; a
//! straight strand of 60,000 equal segments: over a minute; here 0.1 s each) for a tree that is no better: sintel
//! takes 2.6 µs a ray with either.

use std::ops::Range;

use glam::{Vec3A, Vec4};
use obvhs::{aabb::Aabb, ray::Ray};

/// Items of a leaf.
pub const ITEMS: usize = 4;
/// A place in a leaf that no item takes.
pub const NO_ITEM: u32 = u32::MAX;
/// Children of a node.
const CHILDREN: usize = 8;
/// Marks the index of a leaf among those of nodes.
const LEAF: u32 = 1 << 31;
/// From this depth on items are halved by number, so that no groom makes the tree deep.
const DEPTH: usize = 16;
/// Nodes and leaves that may wait while others are visited: 7 a level, and fewer than 30 halvings below DEPTH.
const STACK: usize = 7 * (DEPTH + 30) + 1;
/// Bins along an axis in which a split is looked for.
const BINS: usize = 16;

/// Children and their boxes.
#[derive(Clone, Copy)]
#[repr(align(128))]
struct Node {
    /// Axis by axis, lower and upper sides of all boxes.
    sides: [[[Vec4; 2]; 2]; 3],
    children: [u32; CHILDREN],
}

/// What rays traverse.
pub struct WideBvh {
    nodes: Vec<Node>,
    /// Around all items.
    pub bounds: Aabb,
    /// The items of each leaf, or [`NO_ITEM`].
    pub leaves: Vec<[u32; ITEMS]>,
}

/// A box that is yet to be put in its place.
#[derive(Clone, Copy)]
struct Item {
    aabb: Aabb,
    index: u32,
}

/// Items of one child.
struct Group {
    items: Range<usize>,
    aabb: Aabb,
}

impl Group {
    fn new(items: &[Item], range: Range<usize>) -> Group {
        Group { aabb: union(items[range.clone()].iter().map(|item| item.aabb)), items: range }
    }
}

fn union(boxes: impl Iterator<Item = Aabb>) -> Aabb {
    boxes.fold(Aabb::INVALID, |all, aabb| all.union(&aabb))
}

impl WideBvh {
    pub fn new(boxes: &[Aabb]) -> WideBvh {
        let item = |(index, &aabb): (usize, &Aabb)| Item { aabb, index: index as u32 };
        let mut items: Vec<Item> = boxes.iter().enumerate().map(item).collect();
        let all = Group::new(&items, 0..items.len());
        let mut bvh = WideBvh { nodes: Vec::new(), bounds: all.aabb, leaves: Vec::new() };
        if boxes.is_empty() {
            return bvh;
        }
        bvh.nodes.push(Node::EMPTY);
        // Depth first, so that what is near in space is near in memory.
        let mut waiting = vec![(0, 0, all)];
        while let Some((at, depth, group)) = waiting.pop() {
            let mut groups = vec![group];
            while groups.len() < CHILDREN {
                let area = |group: &Group| group.aabb.half_area();
                let widest = (0..groups.len())
                    .filter(|&i| groups[i].items.len() > ITEMS)
                    .max_by(|&i, &j| area(&groups[i]).total_cmp(&area(&groups[j])));
                let Some(i) = widest else { break };
                let range = groups[i].items.clone();
                let middle = range.start + split(&mut items[range.clone()], depth < DEPTH);
                groups[i] = Group::new(&items, range.start..middle);
                groups.push(Group::new(&items, middle..range.end));
            }
            let mut node = Node::EMPTY;
            for (lane, group) in groups.into_iter().enumerate() {
                for axis in 0..3 {
                    node.sides[axis][0][lane / 4][lane % 4] = group.aabb.min[axis];
                    node.sides[axis][1][lane / 4][lane % 4] = group.aabb.max[axis];
                }
                if group.items.len() <= ITEMS {
                    node.children[lane] = LEAF | bvh.leaves.len() as u32;
                    let mut leaf = [NO_ITEM; ITEMS];
                    for (place, item) in leaf.iter_mut().zip(&items[group.items]) {
                        *place = item.index;
                    }
                    bvh.leaves.push(leaf);
                } else {
                    node.children[lane] = bvh.nodes.len() as u32;
                    waiting.push((bvh.nodes.len(), depth + 1, group));
                    bvh.nodes.push(Node::EMPTY);
                }
            }
            bvh.nodes[at] = node;
        }
        bvh
    }

    /// Visits the leaves whose boxes the ray meets before the bound, nearer boxes first. `visit` takes a leaf
    /// and the bound and gives the new one: the distance of a hit, or −∞ to end.
    #[inline(always)]
    pub fn traverse(&self, ray: &Ray, mut visit: impl FnMut(usize, f32) -> f32) {
        let mut bound = ray.tmax;
        if self.nodes.is_empty() {
            return;
        }
        let splat = |v: Vec3A| [Vec4::splat(v.x), Vec4::splat(v.y), Vec4::splat(v.z)];
        let (origin, inverse) = (splat(ray.origin), splat(ray.inv_direction));
        let near_side = [0, 1, 2].map(|axis| usize::from(ray.inv_direction[axis] < 0.0));
        let mut stack = [(0u32, 0f32); STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (at, t) = stack[top];
            if t > bound {
                continue;
            }
            if at & LEAF != 0 {
                bound = visit((at & !LEAF) as usize, bound);
                continue;
            }
            let node = &self.nodes[at as usize];
            let mut near = [Vec4::ZERO; 2];
            let mut far = [Vec4::splat(bound); 2];
            for axis in 0..3 {
                let sides = &node.sides[axis];
                let side = near_side[axis] & 1;
                for four in 0..2 {
                    let to = |side: usize| (sides[side][four] - origin[axis]) * inverse[axis];
                    near[four] = near[four].max(to(side));
                    far[four] = far[four].min(to(side ^ 1));
                }
            }
            let met = |four: usize| near[four].cmple(far[four]).bitmask();
            let mut met = met(0) | met(1) << 4;
            let near: [f32; CHILDREN] = bytemuck::cast(near);
            let base = top;
            while met != 0 {
                let lane = met.trailing_zeros() as usize % CHILDREN;
                met &= met - 1;
                // The nearest ends on top.
                let mut place = top;
                while place > base && stack[place - 1].1 < near[lane] {
                    stack[place] = stack[place - 1];
                    place -= 1;
                }
                stack[place] = (node.children[lane], near[lane]);
                top += 1;
            }
        }
    }
}

impl Node {
    /// No ray meets its boxes.
    const EMPTY: Node = Node {
        sides: [[[Vec4::INFINITY; 2], [Vec4::NEG_INFINITY; 2]]; 3],
        children: [0; CHILDREN],
    };
}

/// Parts two or more items in two and gives the number of the first: where that costs rays least or, unless
/// `by_cost`, in the middle.
fn split(items: &mut [Item], by_cost: bool) -> usize {
    let middle = items.len() / 2;
    let centers = union(items.iter().map(|item| Aabb::from_point(item.aabb.center())));
    let (low, scale) = (centers.min, BINS as f32 / centers.diagonal());
    let bin = |item: &Item| {
        ((item.aabb.center() - low) * scale).to_array().map(|b| (b as usize).min(BINS - 1))
    };
    let mut bins = [[(Aabb::INVALID, 0); BINS]; 3];
    for item in items.iter() {
        for (bins, at) in bins.iter_mut().zip(bin(item)) {
            bins[at] = (bins[at].0.union(&item.aabb), bins[at].1 + 1);
        }
    }
    let mut best = (f32::INFINITY, 0, 0);
    for (axis, bins) in bins.iter().enumerate() {
        let join = |a: &(Aabb, usize), b: &(Aabb, usize)| (a.0.union(&b.0), a.1 + b.1);
        let cost = |side: &(Aabb, usize)| side.0.half_area() * side.1.div_ceil(ITEMS) as f32;
        let mut above = [(Aabb::INVALID, 0); BINS];
        for at in (1..BINS).rev() {
            above[at - 1] = join(&above[at], &bins[at]);
        }
        let mut below = (Aabb::INVALID, 0);
        for at in 0..BINS - 1 {
            below = join(&below, &bins[at]);
            let sum = cost(&below) + cost(&above[at]);
            if below.1 > 0 && above[at].1 > 0 && sum < best.0 {
                best = (sum, axis, at);
            }
        }
    }
    let (cost, axis, last) = best;
    if !by_cost || cost == f32::INFINITY {
        let axis = (0..3).max_by(|&a, &b| centers.diagonal()[a].total_cmp(&centers.diagonal()[b]));
        let along = |item: &Item| item.aabb.center()[axis.unwrap_or(0)];
        items.select_nth_unstable_by(middle, |a, b| along(a).total_cmp(&along(b)));
        return middle;
    }
    let mut first = 0;
    for i in 0..items.len() {
        if bin(&items[i])[axis] <= last {
            items.swap(first, i);
            first += 1;
        }
    }
    first
}
