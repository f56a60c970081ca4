//! Bounding volume hierarchies: how boxes are split, and the tree that rays on the device traverse.
//!
//! Built from above by the surface area heuristic over bins (Wald 2007). `obvhs`, which builds from below, takes time
//! quadratic in the number of equal boxes and stacks them a thousand deep (8,000 equal strands: 9 s; a straight strand
//! of 60,000 equal segments: over a minute; here 0.1 s each) for a tree that is no better.

use bytemuck::{Pod, Zeroable};
use obvhs::aabb::Aabb;

/// Items of a leaf, at most.
pub const ITEMS: usize = 4;
/// Bins along an axis in which a split is looked for.
const BINS: usize = 16;
/// Levels of a tree of halves, at most: the stack of shaders/occlusion.wgsl.
const LEVELS: u32 = 32;
/// Subtrees of more items are built on two threads.
const PARALLEL: usize = 8192;
/// Children of a [`Node`].
const CHILDREN: usize = 8;

/// A box that is yet to be put in its place.
#[derive(Clone, Copy)]
pub struct Item {
    pub aabb: Aabb,
    pub index: u32,
}

/// The boxes with their places.
pub fn items(boxes: &[Aabb]) -> Vec<Item> {
    (0..).zip(boxes).map(|(index, &aabb)| Item { aabb, index }).collect()
}

pub fn union(boxes: impl Iterator<Item = Aabb>) -> Aabb {
    boxes.fold(Aabb::INVALID, |all, aabb| all.union(&aabb))
}

/// Parts two or more items in two and gives the number of the first: where that costs rays least, for leaves of up to
/// `leaf` items, or, unless `by_cost`, in the middle.
pub fn split(items: &mut [Item], by_cost: bool, leaf: usize) -> usize {
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
        let cost = |side: &(Aabb, usize)| side.0.half_area() * side.1.div_ceil(leaf) as f32;
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

/// Up to eight children with their boxes, in 8 bits a side: `Node` of shaders/occlusion.wgsl (after Ylitie et al. 2017).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Node {
    /// Corner from which the children's boxes count.
    origin: [f32; 3],
    /// Exponents of the steps along x, y and z in 8 bits each, as f32 has them; then a bit for each child that is a node.
    steps_and_nodes: u32,
    /// First of the children that are nodes, and of those that are items.
    first_node: u32,
    first_item: u32,
    /// By axis, lower and upper sides in steps, a byte a child.
    sides: [[[u8; CHILDREN]; 2]; 3],
    /// The axis that children follow each other along, and their number times 4.
    order: u32,
    pad: u32,
}

/// A tree for the device; the first node is its root.
#[derive(Clone, Default)]
pub struct Tree {
    pub nodes: Vec<Node>,
    /// The boxes' places, as the nodes count them.
    pub items: Vec<u32>,
}

impl Tree {
    pub fn new(boxes: &[Aabb]) -> Tree {
        let mut all = items(boxes);
        let mut tree = Tree { nodes: vec![Node::default()], items: Vec::with_capacity(all.len()) };
        if all.is_empty() {
            return tree;
        }
        let nothing = Child { aabb: Aabb::INVALID, at: ITEM };
        let mut halves = vec![[nothing; 2]; all.len() - 1];
        if all.len() > 1 {
            halve(&mut all, 0, 0, &mut halves, 0);
        }
        let root = match all.len() {
            1 => vec![Child { aabb: all[0].aabb, at: ITEM }],
            _ => halves[0].to_vec(),
        };
        let mut waiting = vec![(0, root)];
        while let Some((at, mut children)) = waiting.pop() {
            // The widest child is opened until there are eight.
            while children.len() < CHILDREN {
                let area = |child: &Child| child.aabb.half_area();
                let open = (0..children.len())
                    .filter(|&i| children[i].at & ITEM == 0)
                    .max_by(|&i, &j| area(&children[i]).total_cmp(&area(&children[j])));
                let Some(i) = open else { break };
                let [a, b] = halves[children[i].at as usize];
                children[i] = a;
                children.push(b);
            }
            let bounds = union(children.iter().map(|child| child.aabb));
            let centers = union(children.iter().map(|c| Aabb::from_point(c.aabb.center())));
            let spread = centers.diagonal();
            let axis = (0..3).max_by(|&a, &b| spread[a].total_cmp(&spread[b])).unwrap_or(0);
            children.sort_by(|a, b| a.aabb.center()[axis].total_cmp(&b.aabb.center()[axis]));
            let mut node = Node::new(&bounds, &children, axis);
            node.first_node = tree.nodes.len() as u32;
            node.first_item = tree.items.len() as u32;
            for child in &children {
                if child.at & ITEM != 0 {
                    tree.items.push(all[(child.at & !ITEM) as usize].index);
                } else {
                    waiting.push((tree.nodes.len(), halves[child.at as usize].to_vec()));
                    tree.nodes.push(Node::default());
                }
            }
            tree.nodes[at] = node;
        }
        tree
    }
}

impl Node {
    /// With so many other nodes before its tree's.
    pub fn moved(self, nodes: u32) -> Node {
        Node { first_node: self.first_node + nodes, ..self }
    }

    fn new(bounds: &Aabb, children: &[Child], axis: usize) -> Node {
        let mut node = Node { origin: bounds.min.to_array(), ..Node::default() };
        for axis in 0..3 {
            let size = bounds.max[axis] - bounds.min[axis];
            // The least power of two of which 255 span the box, rounding aside.
            let exponent = ((size * 1.0001 / 255.0).log2().ceil().max(-120.0) as i32 + 127) as u32;
            let step = f32::from_bits(exponent << 23);
            node.steps_and_nodes |= exponent << (8 * axis);
            for (slot, child) in children.iter().enumerate() {
                let low = ((child.aabb.min[axis] - bounds.min[axis]) / step).floor();
                let high = ((child.aabb.max[axis] - bounds.min[axis]) / step).ceil();
                node.sides[axis][0][slot] = low as u8;
                node.sides[axis][1][slot] = high as u8;
            }
        }
        for (slot, child) in children.iter().enumerate() {
            node.steps_and_nodes |= u32::from(child.at & ITEM == 0) << (24 + slot);
        }
        node.order = axis as u32 | (children.len() as u32) << 2;
        node
    }
}

/// Marks an item among halves.
const ITEM: u32 = 1 << 31;

/// A half of a group of boxes.
#[derive(Clone, Copy)]
struct Child {
    aabb: Aabb,
    /// Its own halves, or with [`ITEM`] the place of its only item.
    at: u32,
}

/// Halves two or more items, of which `first` come before them, until each is alone. `halves`, one fewer, are of `at` and
/// on: each before its own.
fn halve(items: &mut [Item], first: u32, depth: u32, halves: &mut [[Child; 2]], at: u32) {
    // By cost only as long as halves would still end within the levels.
    let halvings = items.len().next_power_of_two().trailing_zeros();
    let middle = split(items, depth + halvings < LEVELS - 1, 1);
    let whole = items.len();
    let (low, high) = items.split_at_mut(middle);
    let aabb = |side: &[Item]| union(side.iter().map(|item| item.aabb));
    let second = first + middle as u32;
    let [low_at, high_at] = [at + 1, at + middle as u32];
    let child = |side: &[Item], at: u32, first: u32| match side.len() {
        1 => Child { aabb: side[0].aabb, at: ITEM | first },
        _ => Child { aabb: aabb(side), at },
    };
    let (own, below) = halves.split_at_mut(1);
    own[0] = [child(low, low_at, first), child(high, high_at, second)];
    let (below_low, below_high) = below.split_at_mut(low.len() - 1);
    let mut halve_low = || {
        if low.len() > 1 {
            halve(low, first, depth + 1, below_low, low_at);
        }
    };
    let mut halve_high = || {
        if high.len() > 1 {
            halve(high, second, depth + 1, below_high, high_at);
        }
    };
    if whole > PARALLEL {
        rayon::join(halve_low, halve_high);
    } else {
        halve_low();
        halve_high();
    }
}
