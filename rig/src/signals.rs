//! SIGINT and SIGTERM: stop the arms, then end the program.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::error::{Error, Result};

const NAMES: [(i32, &str); 3] = [(SIGINT, "SIGINT"), (SIGTERM, "SIGTERM"), (SIGHUP, "SIGHUP")];

/// The last signal that came.
#[derive(Debug, Clone)]
pub struct Signals(Arc<AtomicUsize>);

impl Signals {
    /// Installs the handlers.
    ///
    /// # Errors
    /// [`Error::Refused`] if the system does not allow it.
    pub fn register() -> Result<Self> {
        let last = Arc::new(AtomicUsize::new(0));
        for (signal, name) in NAMES {
            signal_hook::flag::register_usize(signal, Arc::clone(&last), signal as usize)
                .map_err(|error| Error::refused(format!("{name}: {error}")))?;
        }
        Ok(Self(last))
    }

    /// The name of the signal that came, once.
    pub fn caught(&self) -> Option<&'static str> {
        let signal = self.0.swap(0, Ordering::Relaxed);
        NAMES
            .iter()
            .find(|(one, _)| *one as usize == signal)
            .map(|(_, name)| *name)
    }
}
