//! Quantities of the rollouts of a batch: shared, or one each.

use crate::error::{Error, Result};

/// A quantity that is shared by all rollouts, or has one entry for each.
#[derive(Debug, Clone, Copy)]
pub enum PerRollout<'a, T> {
    /// One for all.
    Shared(&'a [T]),
    /// One each, concatenated.
    Each(&'a [T]),
    /// One each, as references; several rollouts may share one.
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

    /// Number of entries of a rollout; for references the smallest number.
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
