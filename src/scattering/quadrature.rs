//! Gauss–Legendre rules, the one way this room integrates.

use std::f64::consts::PI;

/// Nodes and weights of an n-point Gauss–Legendre rule on [−1, 1], exact to degree 2n−1.
#[derive(Clone, Debug)]
pub struct GaussLegendre {
    nodes: Vec<(f64, f64)>,
}

impl GaussLegendre {
    /// The rule with `n` ≥ 1 nodes, by Newton's method on P_n.
    pub fn new(n: usize) -> Self {
        let nodes = (0..n)
            .map(|i| {
                let mut x = (PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
                let mut slope = 1.0;
                for _ in 0..8 {
                    let (mut p, mut previous) = (1.0, 0.0);
                    for k in 0..n {
                        let k = k as f64;
                        (p, previous) = (((2.0 * k + 1.0) * x * p - k * previous) / (k + 1.0), p);
                    }
                    slope = n as f64 * (x * p - previous) / (x * x - 1.0);
                    x -= p / slope;
                }
                (x, 2.0 / ((1.0 - x * x) * slope * slope))
            })
            .collect();
        Self { nodes }
    }

    /// The nodes and weights carried to [a, b].
    pub fn on(&self, a: f64, b: f64) -> impl Iterator<Item = (f64, f64)> {
        let (centre, half) = (0.5 * (a + b), 0.5 * (b - a));
        self.nodes.iter().map(move |&(x, w)| (centre + half * x, half * w))
    }

    /// ∫_a^b f.
    pub fn integrate(&self, a: f64, b: f64, f: impl Fn(f64) -> f64) -> f64 {
        self.on(a, b).map(|(x, w)| w * f(x)).sum()
    }
}
