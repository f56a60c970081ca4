//! Long work shows how far it is, says what it noticed, and can be cancelled.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::{Result, bail};
use indicatif::{ProgressBar, ProgressStyle};

/// How many [`Unfinished`] there are.
static UNFINISHED: AtomicUsize = AtomicUsize::new(0);

/// Work that a cancelled process has to finish before it ends, for as long as this lives: a file that is being
/// written, results that are kept.
pub struct Unfinished(());

impl Unfinished {
    #[expect(clippy::new_without_default, reason = "it acts by being there")]
    pub fn new() -> Unfinished {
        UNFINISHED.fetch_add(1, Ordering::SeqCst);
        Unfinished(())
    }

    /// Whether there is any.
    pub fn any() -> bool {
        UNFINISHED.load(Ordering::SeqCst) > 0
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        UNFINISHED.fetch_sub(1, Ordering::SeqCst);
    }
}

/// How a command reports.
#[derive(Clone, Copy)]
pub struct Reporting<'a> {
    /// No progress and no notes on stderr.
    pub quiet: bool,
    /// Set to stop; the command then fails with "cancelled" and leaves no file half written.
    pub cancelled: &'a AtomicBool,
    /// Told what is being done, and the share done.
    pub told: Option<&'a (dyn Fn(&'static str, f32) + Sync)>,
}

/// Wall times of a command's steps, progress and notes.
pub struct Clock<'a> {
    reporting: Reporting<'a>,
    begun: Instant,
    last: Instant,
    /// Milliseconds.
    pub steps: BTreeMap<&'static str, f64>,
}

impl<'a> Clock<'a> {
    pub fn new(reporting: Reporting<'a>) -> Self {
        let now = Instant::now();
        Self { reporting, begun: now, last: now, steps: BTreeMap::new() }
    }

    pub fn cancelled(&self) -> bool {
        self.reporting.cancelled.load(Ordering::Relaxed)
    }

    /// Ends a step; the error is that of a cancelled command.
    pub fn step(&mut self, name: &'static str) -> Result<()> {
        self.steps.insert(name, 1e3 * self.last.elapsed().as_secs_f64());
        self.last = Instant::now();
        if self.cancelled() {
            bail!("cancelled");
        }
        Ok(())
    }

    pub fn total_ms(&self) -> f64 {
        1e3 * self.begun.elapsed().as_secs_f64()
    }

    pub fn note(&self, line: &str) {
        if !self.reporting.quiet {
            eprintln!("{line}");
        }
    }

    /// Runs work that says what share of it is done and asks whether to go on, under a bar of its own.
    pub fn watch<T>(
        &self,
        what: &'static str,
        work: impl FnOnce(&(dyn Fn(f32) -> bool + Sync)) -> T,
    ) -> T {
        let bar = self.bar(what);
        let result = work(&|done| {
            bar.set_position((f64::from(done) * 1000.0) as u64);
            if let Some(told) = self.reporting.told {
                told(what, done);
            }
            !self.cancelled()
        });
        bar.finish_and_clear();
        result
    }

    /// A bar of 1000 steps; indicatif hides it where stderr is no terminal.
    pub fn bar(&self, what: &'static str) -> ProgressBar {
        if self.reporting.quiet {
            return ProgressBar::hidden();
        }
        let bar = ProgressBar::new(1000);
        if let Ok(style) = ProgressStyle::with_template("{msg:16} {bar:40} {percent} %") {
            bar.set_style(style);
        }
        bar.set_message(what);
        bar
    }
}
