//! What takes time, made on a thread.

use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use eframe::egui;

/// Something, and what it was made of.
pub struct Later<K, T> {
    made: Option<(K, T)>,
    making: Option<Receiver<(K, T)>>,
}

impl<K, T> Default for Later<K, T> {
    fn default() -> Self {
        Self { made: None, making: None }
    }
}

impl<K: Clone + PartialEq + Send + 'static, T: Send + 'static> Later<K, T> {
    /// What was made last, and whether it is of `key`; if it is not, that is being made, one at a time, and the window
    /// is woken. What takes no longer than `patience` is waited for.
    pub fn get(
        &mut self,
        ctx: &egui::Context,
        key: &K,
        patience: Duration,
        make: impl FnOnce(&K) -> T + Send + 'static,
    ) -> Option<(&T, bool)> {
        self.take(Duration::ZERO);
        let is_newest = |made: &(K, T)| made.0 == *key;
        if !self.made.as_ref().is_some_and(is_newest) && self.making.is_none() {
            let (sender, receiver) = channel();
            let (key, ctx) = (key.clone(), ctx.clone());
            std::thread::spawn(move || {
                let made = make(&key);
                // Nobody asks once the window is closed.
                let _ = sender.send((key, made));
                ctx.request_repaint();
            });
            self.making = Some(receiver);
            self.take(patience);
        }
        self.made.as_ref().map(|made| (&made.1, is_newest(made)))
    }

    fn take(&mut self, patience: Duration) {
        match self.making.as_ref().map(|making| making.recv_timeout(patience)) {
            Some(Ok(made)) => (self.made, self.making) = (Some(made), None),
            Some(Err(RecvTimeoutError::Disconnected)) => self.making = None,
            Some(Err(RecvTimeoutError::Timeout)) | None => {}
        }
    }
}
