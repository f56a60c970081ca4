//! Work on a thread of its own, of which only the newest counts.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError, mpsc};
use std::thread::JoinHandle;

use super::session::GoOn;
use super::{Said, Session, Wish};

/// Ends the thread in place of a wish's number.
const QUIT: u64 = u64::MAX;

struct Shared<W> {
    /// The newest wish that was not taken up yet.
    wish: Mutex<Option<W>>,
    woken: Condvar,
    /// Number of the newest wish, or [`QUIT`].
    newest: AtomicU64,
}

/// Takes up wishes one after another; of those that wait, the newest alone.
pub struct Worker<W = Wish, S = Said> {
    shared: Arc<Shared<W>>,
    said: mpsc::Receiver<(u64, S)>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// A session. `wake` is called, from the thread, when something was said.
    pub fn new(wake: impl Fn() + Send + Sync + 'static) -> Worker {
        let mut session = Session::default();
        Worker::with(wake, move |wish, go_on, say| match session.see(wish, go_on, say) {
            Ok(true) if !wish.moving => session.idle(wish, go_on, say),
            Ok(_) => {}
            Err(error) => say(session.refusal(&wish.scene, &error)),
        })
    }
}

impl<W: Send + 'static, S: Send + 'static> Worker<W, S> {
    /// `see` is called, on the thread, with each wish that is taken up.
    pub fn with(
        wake: impl Fn() + Send + Sync + 'static,
        mut see: impl FnMut(&W, GoOn, &(dyn Fn(S) + Sync)) + Send + 'static,
    ) -> Self {
        let (wish, woken, newest) = Default::default();
        let shared = Arc::new(Shared { wish, woken, newest });
        let (sender, said) = mpsc::channel();
        let own = shared.clone();
        let thread = std::thread::spawn(move || {
            while let Some((number, wish)) = own.next() {
                let sender = Mutex::new(sender.clone());
                let say = |what: S| {
                    // Nobody listens once the window is closed.
                    let _ =
                        sender.lock().unwrap_or_else(PoisonError::into_inner).send((number, what));
                    wake();
                };
                let go_on = || own.newest.load(Ordering::Relaxed) == number;
                see(&wish, &go_on, &say);
            }
        });
        Worker { shared, said, thread: Some(thread) }
    }

    /// Asks for a wish in place of all before; its number is what its pictures come with.
    pub fn ask(&self, wish: W) -> u64 {
        let mut slot = self.shared.wish.lock().unwrap_or_else(PoisonError::into_inner);
        *slot = Some(wish);
        let number = self.shared.newest.fetch_add(1, Ordering::Relaxed) + 1;
        self.shared.woken.notify_one();
        number
    }

    /// What was said since, with the number of the wish that it is about.
    pub fn said(&self) -> impl Iterator<Item = (u64, S)> + '_ {
        self.said.try_iter()
    }
}

impl<W> Shared<W> {
    /// Waits for a wish; None ends the thread.
    fn next(&self) -> Option<(u64, W)> {
        let mut slot = self.wish.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            let number = self.newest.load(Ordering::Relaxed);
            if number == QUIT {
                return None;
            }
            if let Some(wish) = slot.take() {
                return Some((number, wish));
            }
            slot = self.woken.wait(slot).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl<W, S> Drop for Worker<W, S> {
    fn drop(&mut self) {
        {
            let _slot = self.shared.wish.lock().unwrap_or_else(PoisonError::into_inner);
            self.shared.newest.store(QUIT, Ordering::Relaxed);
        }
        self.shared.woken.notify_one();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
