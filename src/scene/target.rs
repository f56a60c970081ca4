//! What `render.quality` aims at.

use super::field::{Slot, Value};

/// A wanted error or frame time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// Relative L2 of the frame against path tracing, such as 0.1.
    Error(f64),
    FrameMs(f64),
}

impl Target {
    /// Reads `10%` or `50ms`, both above 0; None for anything else.
    pub fn parse(text: &str) -> Option<Target> {
        let of = |unit: &str| text.strip_suffix(unit)?.trim().parse().ok().filter(above_0);
        of("%").map(|x| Target::Error(0.01 * x)).or_else(|| of("ms").map(Target::FrameMs))
    }
}

fn above_0(x: &f64) -> bool {
    *x > 0.0 && x.is_finite()
}

impl Default for Target {
    fn default() -> Self {
        Target::Error(0.2)
    }
}

impl Slot for Target {
    fn value(&self) -> Value {
        Value::Text(match self {
            // Twelve digits: 0.01 · 7 · 100 is 7.000000000000001.
            Target::Error(e) => format!("{}%", (1e14 * e).round() / 1e12),
            Target::FrameMs(ms) => format!("{ms}ms"),
        })
    }
    fn assign(&mut self, value: Value) {
        let Value::Text(text) = value else { unreachable!("a checked target") };
        *self = Target::parse(&text).unwrap_or_else(|| unreachable!("a checked target"));
    }
}
