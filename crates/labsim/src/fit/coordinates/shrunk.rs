//! Coordinates that are shrunk towards zero: leans of recordings, and the coefficients of maps.

use super::Coordinates;
use crate::error::Result;
use crate::fit::axis::{Axis, effect_axis};
use crate::fit::problem::{Hypothesis, LEAN, ParameterSpec, Problem};

/// Initial size of a released map, divided by the half width of its coefficients' range.
const OPEN: f64 = 0.3;
/// Precision (in coordinates) of a coefficient that is held at zero.
const HELD: f64 = 1e12;

/// Coordinates with a common normal prior about zero.
#[derive(Debug, Clone)]
pub(in crate::fit) struct Group {
    /// Their effect.
    pub(in crate::fit) effect: &'static str,
    pub(in crate::fit) axes: Vec<usize>,
    /// The prior's standard deviation, in the parameters' unit; zero holds them at zero.
    pub(in crate::fit) size: f64,
    /// Number of correlated residuals per independent one, so that residuals do not outweigh the prior.
    repetition: f64,
    /// The value that reports the size.
    slot: Option<usize>,
}

impl Coordinates {
    /// Adds a pair of coordinates for each recording: its lean.
    pub(super) fn add_leans(&mut self, problem: &Problem<'_>, slot: usize) -> Result<()> {
        for _ in problem.recordings {
            for axis in 0..2 {
                let Some((effect, parameter)) = problem.effect_parameter(slot + axis) else {
                    continue;
                };
                let place = self.held.len();
                let range = match problem.sought().nth(slot + axis) {
                    Some(ParameterSpec::Free { range, .. }) => range,
                    _ => parameter.range,
                };
                self.axes
                    .push(effect_axis(effect, parameter, place, range)?);
                self.held.push(0.0);
            }
        }
        let axes: Vec<usize> = (self.tail..self.axes.len()).collect();
        let size = axes.first().map_or(0.0, |&i| self.axes[i].half_width());
        self.groups.push(Group {
            effect: LEAN,
            axes,
            size,
            repetition: 1.0,
            slot: Some(slot + 2),
        });
        Ok(())
    }

    /// The groups that are shrunk towards zero.
    pub(in crate::fit) fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// The coordinates of each map.
    pub(in crate::fit) fn maps(&self) -> Vec<Vec<usize>> {
        let maps = self.groups.iter().filter(|group| group.is_map());
        maps.map(|group| group.axes.clone()).collect()
    }

    /// Sets the size of a group, and the number of correlated residuals per independent one.
    pub(in crate::fit) fn resize(&mut self, group: usize, size: f64, repetition: f64) {
        let group = &mut self.groups[group];
        (group.size, group.repetition) = (size, repetition);
        if let Some(slot) = group.slot {
            self.held[slot] = size;
        }
    }

    /// Sets the sizes from values: those that they report, or their root mean square.
    pub(in crate::fit) fn take_sizes(&mut self, values: &[f64]) {
        for group in &mut self.groups {
            match group.slot {
                Some(slot) if values[slot] > 0.0 => {
                    group.size = values[slot];
                    self.held[slot] = values[slot];
                }
                Some(_) => {}
                None => {
                    let squares = group
                        .axes
                        .iter()
                        .map(|&i| values[self.axes[i].slot].powi(2));
                    group.size = (squares.sum::<f64>() / group.axes.len() as f64).sqrt();
                }
            }
        }
    }

    /// Releases the maps that are held at zero, with a size that shrinks them little; false if there are none.
    pub(in crate::fit) fn open_maps(&mut self) -> bool {
        let mut opened = false;
        for group in &mut self.groups {
            if group.is_map() && group.size == 0.0 {
                group.size = OPEN * self.axes[group.axes[0]].half_width();
                opened = true;
            }
        }
        opened
    }

    /// The sizes of all groups.
    pub(in crate::fit) fn sizes(&self) -> Vec<f64> {
        self.groups.iter().map(|group| group.size).collect()
    }

    /// Coordinates, with zeros for groups of size zero.
    pub(in crate::fit) fn shrunk(&self, mut z: Vec<f64>) -> Vec<f64> {
        for group in self.groups.iter().filter(|group| group.size == 0.0) {
            for &i in &group.axes {
                z[i] = 0.0;
            }
        }
        z
    }

    /// Whether a coordinate is held at zero, because its group has size zero.
    pub(in crate::fit) fn is_held(&self, i: usize) -> bool {
        let mut groups = self.groups.iter();
        groups.any(|group| group.size == 0.0 && group.axes.contains(&i))
    }

    /// Prior precision of each coordinate; zero if it is held.
    pub(in crate::fit) fn precisions(&self) -> Vec<f64> {
        let mut precisions = vec![0.0; self.axes.len()];
        for group in &self.groups {
            for &i in &group.axes {
                if group.size > 0.0 {
                    precisions[i] = group.repetition * (self.unit(i) / group.size).powi(2);
                }
            }
        }
        precisions
    }

    /// Prior precision of each coordinate.
    pub(in crate::fit) fn known_before(&self) -> Vec<f64> {
        let mut precisions = self.precisions();
        for group in &self.groups {
            for &i in &group.axes {
                precisions[i] = if group.size > 0.0 {
                    precisions[i] / group.repetition
                } else {
                    HELD
                };
            }
        }
        precisions
    }

    pub(super) fn is_shrunk(&self, i: usize) -> bool {
        self.groups.iter().any(|group| group.axes.contains(&i))
    }

    /// Number of coordinates of a draw.
    pub(in crate::fit) fn drawn_axes(&self) -> usize {
        (0..self.len()).filter(|&i| !self.is_shrunk(i)).count()
    }
}

/// The groups of effects with shrunk parameters, one for each effect.
pub(super) fn groups_of_effects(problem: &Problem<'_>, axes: &[Axis]) -> Vec<Group> {
    let effects = problem.effects.iter().zip(problem.slots_of_effects());
    let group = |(one, slots): (&Hypothesis, std::ops::Range<usize>)| {
        let is_own = |&i: &usize| slots.contains(&axes[i].slot);
        let own: Vec<usize> = (0..axes.len()).filter(is_own).collect();
        (one.effect.shrunk && !own.is_empty()).then_some(Group {
            effect: one.effect.name,
            // A map can explain any single run, so it is held at zero until it predicts other runs.
            size: 0.0,
            axes: own,
            repetition: 1.0,
            slot: None,
        })
    };
    effects.filter_map(group).collect()
}

impl Group {
    /// Whether its coefficients are those of a map, the same in all recordings.
    pub(in crate::fit) fn is_map(&self) -> bool {
        self.slot.is_none()
    }
}
