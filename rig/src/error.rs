//! The error type of the rig: one line with problem, place and advice.

/// Why a verb failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// A request that cannot be fulfilled: a file, a value, a missing peer.
    #[error("{0}")]
    Refused(String),
    /// Several mistakes in one file, a line each.
    #[error("{}", .0.join("\nrig: "))]
    Mistakes(Vec<String>),
    /// A motion was stopped, with the reason.
    #[error("stopped: {0}")]
    Stopped(String),
    /// Invalid bytes.
    #[error("{0}")]
    Broken(String),
}

impl Error {
    /// A refusal.
    pub fn refused(message: impl Into<String>) -> Self {
        Self::Refused(message.into())
    }
}

/// The rig's result.
pub type Result<T> = std::result::Result<T, Error>;
