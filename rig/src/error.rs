//! The one error of the rig: each is one line that says what is wrong, where, and what to do.

/// Why a verb could not do what it was asked for.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// Something that was asked for cannot be: a file, a value, a peer that is not there.
    #[error("{0}")]
    Refused(String),
    /// Several mistakes in one file, a line each.
    #[error("{}", .0.join("\nrig: "))]
    Mistakes(Vec<String>),
    /// A motion was stopped, and why.
    #[error("stopped: {0}")]
    Stopped(String),
    /// Bytes that make no sense.
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
