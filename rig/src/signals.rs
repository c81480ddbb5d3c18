//! SIGINT and SIGTERM: stop the arms, then end the program.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::error::{Error, Result};

const NAMES: [(i32, &str); 3] = [(SIGINT, "SIGINT"), (SIGTERM, "SIGTERM"), (SIGHUP, "SIGHUP")];

/// The last signal that came.
#[derive(Debug, Clone)]
pub struct Signals {
    last: Arc<AtomicUsize>,
    any: Arc<AtomicBool>,
}

impl Signals {
    /// Installs the handlers.
    ///
    /// # Errors
    /// [`Error::Refused`] if the system does not allow it.
    pub fn register() -> Result<Self> {
        let last = Arc::new(AtomicUsize::new(0));
        let any = Arc::new(AtomicBool::new(false));
        for (signal, name) in NAMES {
            signal_hook::flag::register_usize(signal, Arc::clone(&last), signal as usize)
                .and_then(|_| signal_hook::flag::register(signal, Arc::clone(&any)))
                .map_err(|error| Error::refused(format!("{name}: {error}")))?;
        }
        Ok(Self { last, any })
    }

    /// Whether any signal has come, for another thread.
    pub fn any(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.any)
    }

    /// The name of the signal that came, once.
    pub fn caught(&self) -> Option<&'static str> {
        let signal = self.last.swap(0, Ordering::Relaxed);
        NAMES
            .iter()
            .find(|(one, _)| *one as usize == signal)
            .map(|(_, name)| *name)
    }
}
