//! Quantities of the rollouts of a batch: shared, or one each.

use crate::error::{Error, Result};

/// A quantity that every rollout shares, or of which each has its own, one behind the other.
#[derive(Debug, Clone, Copy)]
pub enum PerRollout<'a, T> {
    /// One for all.
    Shared(&'a [T]),
    /// One each, concatenated.
    Each(&'a [T]),
    /// One each, wherever it lies; several rollouts may have the same.
    Of(&'a [&'a [T]]),
}

impl<'a, T> PerRollout<'a, T> {
    /// The entries of a rollout; `length` is how many each has if they are concatenated.
    pub(crate) fn of(&self, rollout: usize, length: usize) -> &'a [T] {
        match *self {
            Self::Shared(all) => all,
            Self::Each(all) => &all[rollout * length..(rollout + 1) * length],
            Self::Of(all) => all[rollout],
        }
    }

    /// How many entries a rollout has; of those that lie apart, the fewest.
    pub(crate) fn length(&self, rollouts: usize) -> usize {
        match *self {
            Self::Shared(all) => all.len(),
            Self::Each(all) => all.len() / rollouts.max(1),
            Self::Of(all) => all.iter().map(|one| one.len()).min().unwrap_or(0),
        }
    }

    pub(crate) fn check(&self, what: &str, rollouts: usize, length: usize) -> Result<()> {
        let (expected, got) = match *self {
            Self::Shared(all) => (length, all.len()),
            Self::Each(all) => (rollouts * length, all.len()),
            Self::Of(all) if all.len() != rollouts => (rollouts, all.len()),
            Self::Of(all) => match all.iter().find(|one| one.len() != length) {
                Some(wrong) => (length, wrong.len()),
                None => return Ok(()),
            },
        };
        if expected == got {
            Ok(())
        } else {
            Err(Error::invalid(what, &format!("{expected} entries"), got))
        }
    }
}
