//! What was done, to be undone and done again.

use half::f16;

use crate::live::{ScenePart, file_name};
use crate::paint::{Channel, Paint};
use crate::scene::{FIELDS, Scene};

/// Bytes that strokes may keep before the oldest steps are let go.
const MOST_BYTES: usize = 256 << 20;

/// Texels before or after a stroke: value and weight of each point.
pub type Texels = Vec<(u32, [f16; 4])>;

/// One step.
#[derive(Clone)]
pub enum Step {
    Scene { before: Box<Scene>, after: Box<Scene> },
    Stroke { label: String, channel: Channel, before: Texels, after: Texels },
}

impl Step {
    /// What it did, in few words.
    pub fn label(&self) -> String {
        match self {
            Step::Stroke { label, .. } => label.clone(),
            Step::Scene { before, after } => {
                let differs = |f: &&crate::scene::Field| f.get(before) != f.get(after);
                let name = |f: &crate::scene::Field| match f.key {
                    "hair.source" => opened(&after.hair.source),
                    "head.source" => opened(&after.head.source),
                    "environment.source" => opened(&after.environment.source),
                    key if f.group().starts_with("lamp") => key.replace(['.', '_'], " "),
                    _ => f.name().replace('_', " "),
                };
                let mut names: Vec<String> = FIELDS.iter().filter(differs).map(name).collect();
                if names.len() > 3 {
                    let more = names.len() - 2;
                    names.truncate(2);
                    names.push(format!("{more} more"));
                }
                names.join(", ")
            }
        }
    }

    fn bytes(&self) -> usize {
        match self {
            Step::Scene { .. } => 2 * size_of::<Scene>(),
            Step::Stroke { before, after, .. } => {
                (before.capacity() + after.capacity()) * size_of::<(u32, [f16; 4])>()
            }
        }
    }
}

/// Steps, of which the first `done` hold.
#[derive(Clone)]
pub struct History {
    /// Bytes that are kept at most.
    most_bytes: usize,
    steps: Vec<Step>,
    done: usize,
    bytes: usize,
    /// Steps that were let go for memory's sake.
    pub forgotten: usize,
}

impl Default for History {
    fn default() -> Self {
        Self::keeping(MOST_BYTES)
    }
}

impl History {
    /// At most so many bytes of steps; the newest is always kept.
    pub fn keeping(most_bytes: usize) -> Self {
        Self { most_bytes, steps: Vec::new(), done: 0, bytes: 0, forgotten: 0 }
    }

    pub fn push(&mut self, step: Step) {
        for undone in self.steps.drain(self.done..) {
            self.bytes -= undone.bytes();
        }
        self.bytes += step.bytes();
        self.steps.push(step);
        while self.bytes > self.most_bytes && self.steps.len() > 1 {
            self.bytes -= self.steps.remove(0).bytes();
            self.forgotten += 1;
        }
        self.done = self.steps.len();
    }

    /// Puts a part of `instead` in place of the one that was refused in all scenes. Steps that then do nothing are
    /// dropped, and so are strokes on hair that was refused.
    pub fn replace(&mut self, part: ScenePart, refused: &Scene, instead: &Scene) {
        let first = self.steps.iter().find_map(|step| match step {
            Step::Scene { before, .. } => Some((**before).clone()),
            Step::Stroke { .. } => None,
        });
        let mut now = first.unwrap_or_else(|| refused.clone());
        let (steps, done) = (std::mem::take(&mut self.steps), self.done);
        for (k, mut step) in steps.into_iter().enumerate() {
            let kept = match &mut step {
                Step::Stroke { .. } => part != ScenePart::Hair || !part.same(&now, refused),
                Step::Scene { before, after } => {
                    now = (**after).clone();
                    for scene in [&mut *before, &mut *after] {
                        if part.same(scene, refused) {
                            part.copy(instead, scene);
                        }
                    }
                    before != after
                }
            };
            if kept {
                self.steps.push(step);
            } else if k < done {
                self.done -= 1;
            }
        }
        self.bytes = self.steps.iter().map(Step::bytes).sum();
    }

    /// All steps, and how many of them hold.
    pub fn steps(&self) -> (&[Step], usize) {
        (&self.steps, self.done)
    }

    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Takes the last step back; whether there was one.
    pub fn undo(&mut self, scene: &mut Scene, paint: &mut Paint) -> bool {
        let Some(step) = self.done.checked_sub(1).map(|i| &self.steps[i]) else { return false };
        match step {
            Step::Scene { before, .. } => *scene = (**before).clone(),
            Step::Stroke { channel, before, .. } => put(paint, *channel, before),
        }
        self.done -= 1;
        true
    }

    /// Does the next step again; whether there was one.
    pub fn redo(&mut self, scene: &mut Scene, paint: &mut Paint) -> bool {
        let Some(step) = self.steps.get(self.done) else { return false };
        match step {
            Step::Scene { after, .. } => *scene = (**after).clone(),
            Step::Stroke { channel, after, .. } => put(paint, *channel, after),
        }
        self.done += 1;
        true
    }
}

/// What was done where a source became this one.
fn opened(source: &str) -> String {
    format!("Open {}", file_name(source))
}

fn put(paint: &mut Paint, channel: Channel, texels: &Texels) {
    let layer = paint.layer_mut(channel);
    for &(point, texel) in texels {
        layer.set_texel(point as usize, texel);
    }
    paint.forget_bare();
}
