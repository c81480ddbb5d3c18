//! Breadth-first search of every state that a machine reaches, by its own code.

use std::collections::HashSet;
use std::fmt::Debug;
use std::hash::Hash;

/// What was seen.
#[derive(Debug)]
pub struct Explored {
    /// Number of states.
    pub states: usize,
    /// Number of steps tried: each input in each state.
    pub steps: usize,
}

/// A rule that is broken, after the fewest steps that lead there.
#[derive(Debug)]
pub struct Broken {
    /// The inputs, in order.
    pub inputs: Vec<String>,
    /// The rule.
    pub rule: String,
}

/// Tries each input in each reachable state. States with one key count as one; `step` returns the next state, or the rule
/// that it breaks.
///
/// # Errors
/// The first broken rule.
///
/// # Panics
/// If there are more than `most` states: the search would not end.
pub fn explore<S, K: Hash + Eq, I: Debug>(
    start: S,
    inputs: &[I],
    most: usize,
    key: impl Fn(&S) -> K,
    mut step: impl FnMut(&S, &I) -> Result<S, String>,
) -> Result<Explored, Broken> {
    let mut seen = HashSet::from([key(&start)]);
    // Each with the state and the input that led to it.
    let mut states: Vec<(S, Option<(usize, usize)>)> = vec![(start, None)];
    let mut next = 0;
    while next < states.len() {
        for (number, input) in inputs.iter().enumerate() {
            match step(&states[next].0, input) {
                Ok(state) => {
                    if seen.insert(key(&state)) {
                        states.push((state, Some((next, number))));
                    }
                }
                Err(rule) => {
                    let mut way = vec![format!("{input:?}")];
                    let mut at = next;
                    while let Some((before, number)) = states[at].1 {
                        way.push(format!("{:?}", inputs[number]));
                        at = before;
                    }
                    way.reverse();
                    return Err(Broken { inputs: way, rule });
                }
            }
        }
        assert!(states.len() <= most, "more than {most} states");
        next += 1;
    }
    Ok(Explored {
        states: states.len(),
        steps: states.len() * inputs.len(),
    })
}
