//! Trials of a search: values and start states to be simulated.

use std::borrow::Borrow;

use super::windows::State;

/// A point, and the number of physics updates per row.
pub(super) struct Trial {
    pub(super) values: Vec<f64>,
    pub(super) states: Vec<State>,
    pub(super) updates: u32,
}

/// Trials that differ in more than their start states, and for each other trial the one that it equals.
pub(super) fn distinct(trials: &[impl Borrow<Trial>]) -> (Vec<usize>, Vec<(usize, usize)>) {
    let mut own: Vec<usize> = Vec::new();
    let mut twins = Vec::new();
    for (i, trial) in trials.iter().map(Borrow::borrow).enumerate() {
        let alike = |other: &&usize| {
            let other = trials[**other].borrow();
            other.updates == trial.updates && other.values == trial.values
        };
        match own.iter().find(alike) {
            Some(&twin) => twins.push((i, twin)),
            None => own.push(i),
        }
    }
    (own, twins)
}
