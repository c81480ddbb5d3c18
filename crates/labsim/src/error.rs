//! The one error of the engine.

use std::fmt::Display;

/// Why a simulation could not be run.
///
/// Every message names the expected and the given value.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A physically impossible number, or a wrong shape.
    #[error("{what}: expected {expected}, got {got}")]
    Invalid {
        /// The quantity, by its public name.
        what: String,
        /// The possible values.
        expected: String,
        /// The given value.
        got: String,
    },
    /// A name that the engine does not know.
    #[error("unknown {kind} '{}' (possible: {possible})", .name.escape_debug())]
    Unknown {
        /// Engine, parameter, effect.
        kind: &'static str,
        /// The requested name.
        name: String,
        /// The names that exist, separated by commas.
        possible: String,
    },
    /// The caller asked the batch to stop.
    #[error("stopped before the batch was complete")]
    Cancelled,
}

impl Error {
    pub(crate) fn invalid(what: impl Into<String>, expected: &str, got: impl Display) -> Self {
        Self::Invalid {
            what: what.into(),
            expected: expected.to_owned(),
            got: got.to_string(),
        }
    }
}

/// The engine's result.
pub type Result<T> = std::result::Result<T, Error>;
