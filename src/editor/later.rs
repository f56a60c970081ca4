//! What takes time, made on a thread.

use std::sync::mpsc::{Receiver, TryRecvError, channel};

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
    /// is woken.
    pub fn get(
        &mut self,
        ctx: &egui::Context,
        key: &K,
        make: impl FnOnce(&K) -> T + Send + 'static,
    ) -> Option<(&T, bool)> {
        match self.making.as_ref().map(Receiver::try_recv) {
            Some(Ok(made)) => (self.made, self.making) = (Some(made), None),
            Some(Err(TryRecvError::Disconnected)) => self.making = None,
            Some(Err(TryRecvError::Empty)) | None => {}
        }
        let newest = self.made.as_ref().is_some_and(|(of, _)| of == key);
        if !newest && self.making.is_none() {
            let (sender, receiver) = channel();
            let (key, ctx) = (key.clone(), ctx.clone());
            std::thread::spawn(move || {
                let made = make(&key);
                // Nobody asks once the window is closed.
                let _ = sender.send((key, made));
                ctx.request_repaint();
            });
            self.making = Some(receiver);
        }
        self.made.as_ref().map(|(_, it)| (it, newest))
    }
}
