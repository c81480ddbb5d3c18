//! Slopes of the residuals by finite differences, all columns of all candidates in one batch.

use super::shooting::{Point, Shooting};
use super::trial::Trial;
use crate::board::SUBSTEP_S;
use crate::effects::Hook;
use crate::error::Result;
use crate::parameters::TIME;

/// Steps of the finite differences: in coordinates, and in start states (board edges, and board edges a
/// row). Large against the jumps of a stop that moves by one physics update, small against the
/// curvature of the motion.
const STEP: f64 = 1e-3;
const STATE_STEP: f64 = 1e-4;
/// Share of these steps for the second, smaller step of careful slopes.
const FINE: f64 = 0.03;
/// Two slopes agree within this share of their sizes, or this much (edges per unit).
const AGREEMENT: f64 = 0.1;
const AGREEMENT_FLOOR: f64 = 0.01;

/// Residuals at a point and their slopes, one column of all residuals for each coordinate and for each
/// component of the start states; a window's state moves its own residuals only. Held coordinates have no
/// columns.
#[derive(Debug, Clone)]
pub(super) struct Linearisation {
    /// Predicted minus observed (board edges); zero without an observation.
    pub(super) residual: Vec<f64>,
    pub(super) by_z: Vec<Vec<f64>>,
    pub(super) by_state: Vec<Vec<f64>>,
}

/// Method of the slopes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Look {
    /// One-sided: during a descent.
    Quick,
    /// Two-sided; the gentler slope is used where the two disagree.
    Both,
    /// Also with steps of two sizes, and again the gentler slope: near an impact that decides the marble's
    /// direction, a step of one size sees a jump.
    Careful,
}

/// The direction of a finite difference.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Column {
    /// A coordinate, and those that move along with it.
    Along(usize),
    /// The time scale, by a physics update a row more or less of equal length.
    Updates(usize),
    /// The lean about x or y of all recordings at once: each has a coordinate of its own.
    Lean(usize),
    /// A delay, by a whole row, for its tilt.
    Row(usize),
    /// A component of every window's start state.
    State(usize),
}

impl Shooting<'_> {
    /// Residuals and slopes at each point; with `held`, slopes by start states alone.
    pub(super) fn linearise(
        &self,
        points: &[Point],
        look: Look,
        held: bool,
    ) -> Result<Vec<Linearisation>> {
        let columns = self.columns(look, held);
        let mut lines = self.slopes(points, look, &columns, 1.0)?;
        if look == Look::Careful {
            let fine = self.slopes(points, look, &columns, FINE)?;
            for (line, fine) in lines.iter_mut().zip(fine) {
                for (slope, fine) in line.by_z.iter_mut().zip(fine.by_z) {
                    believe_gentler(slope, &fine);
                }
                for (slope, fine) in line.by_state.iter_mut().zip(fine.by_state) {
                    believe_gentler(slope, &fine);
                }
            }
        }
        for (line, point) in lines.iter_mut().zip(points) {
            self.unwind(&point.z, &mut line.by_z);
        }
        Ok(lines)
    }

    /// Slopes along the coordinates' directions become slopes by the coordinates.
    fn unwind(&self, z: &[f64], by_z: &mut [Vec<f64>]) {
        for i in 0..by_z.len() {
            for (other, rate) in self.coordinates.along(z, i) {
                let (slope, moved) = if i < other {
                    let (head, tail) = by_z.split_at_mut(other);
                    (&mut head[i], &tail[0])
                } else {
                    let (head, tail) = by_z.split_at_mut(i);
                    (&mut tail[0], &head[other])
                };
                for (slope, moved) in slope.iter_mut().zip(moved) {
                    *slope -= rate * moved;
                }
            }
        }
    }

    /// Slopes along directions. The number of physics updates is the centre's for every column: one that
    /// rounded to another number would jump. But then a change of the time scale also changes the length of an
    /// update, on which impacts depend slightly. Therefore this column is computed a second time, with one
    /// update more or less of equal length.
    fn slopes(
        &self,
        points: &[Point],
        look: Look,
        columns: &[Column],
        fineness: f64,
    ) -> Result<Vec<Linearisation>> {
        let sides: &[f64] = if look == Look::Quick {
            &[1.0]
        } else {
            &[1.0, -1.0]
        };
        let mut trials = Vec::new();
        let mut steps = Vec::new();
        for point in points {
            let centre = self.trial(&point.z, &point.states, None);
            let z = self.coordinates.clip(&point.z);
            for side in sides {
                for &column in columns {
                    let (trial, step) =
                        self.moved(&centre, &z, column, side * fineness, look == Look::Quick);
                    trials.push(trial);
                    steps.push(step);
                }
            }
            trials.push(centre);
        }
        let mut residuals = self.simulate(&trials)?.into_iter();
        let mut each = trials.chunks(sides.len() * columns.len() + 1);
        let mut steps = steps.chunks((sides.len() * columns.len()).max(1));
        let line = |_| {
            let count = sides.len() * columns.len();
            let moved: Vec<Vec<f64>> = residuals.by_ref().take(count).collect();
            let residual = residuals.next().unwrap_or_default();
            let (trials, steps) = (each.next().unwrap_or(&[]), steps.next().unwrap_or(&[]));
            let sided: Vec<Vec<f64>> = (0..count)
                .map(|i| {
                    let of_window = |window: usize| match columns[i % columns.len()] {
                        Column::State(component) => {
                            let place = |trial: &Trial| trial.states[window][component];
                            place(&trials[i]) - place(&trials[count])
                        }
                        _ => steps[i],
                    };
                    self.one_sided(&trials[i], &moved[i], &residual, of_window)
                })
                .collect();
            let (ahead, behind) = sided.split_at(columns.len());
            let slopes = (0..columns.len()).map(|i| agreed(&ahead[i], behind.get(i)));
            self.sorted(columns, slopes.collect(), residual)
        };
        Ok(points.iter().map(line).collect())
    }

    fn columns(&self, look: Look, held: bool) -> Vec<Column> {
        let states = (0..self.windows.components()).map(Column::State);
        if held {
            return states.collect();
        }
        let time = self.coordinates.find(TIME);
        let twice = time.filter(|_| look != Look::Quick);
        let tail = self.coordinates.tail();
        let along = (0..tail).map(Column::Along);
        let leans = (tail..self.coordinates.len()).take(2);
        let leans = leans.map(|i| Column::Lean(i - tail));
        let delays = match look {
            Look::Careful => Vec::new(),
            _ => self.stepped_delays(),
        };
        let delays = delays.into_iter().map(Column::Row);
        along
            .chain(leans)
            .chain(delays)
            .chain(twice.map(Column::Updates))
            .chain(states)
            .collect()
    }

    /// Coordinates of delays that change the tilt in steps of rows only, because the knob follows a command
    /// at once. A finite difference of less than a row sees no change along them.
    fn stepped_delays(&self) -> Vec<usize> {
        let problem = self.problem;
        let moves = |acts: Hook| acts == Hook::OnKnob { moves: true };
        if !self.windows.channels.has_tilt()
            || problem.effects.iter().any(|one| moves(one.effect.acts))
        {
            return Vec::new();
        }
        let effects = problem.effects.iter().zip(problem.slots_of_effects());
        effects
            .filter(|(one, _)| one.effect.acts == Hook::OnArrival)
            .flat_map(|(_, slots)| slots)
            .filter_map(|slot| self.coordinates.find(slot))
            .collect()
    }

    /// Steps of a row along those coordinates, if recordings are stamped.
    pub(super) fn row_steps(&self) -> Vec<(usize, f64)> {
        let Some(row_s) = self.row_s() else {
            return Vec::new();
        };
        let of_delay = |i| (i, self.coordinates.per_unit(i, row_s));
        self.stepped_delays().into_iter().map(of_delay).collect()
    }

    /// Duration of a row (s) if recordings are stamped.
    fn row_s(&self) -> Option<f64> {
        self.windows.all.first().and_then(|window| window.row_s)
    }

    /// A trial with a step along one direction, and the step's length: zero where bounds forbid it. The `free`
    /// side is the one that leads inwards.
    fn moved(
        &self,
        centre: &Trial,
        z: &[f64],
        column: Column,
        fineness: f64,
        free: bool,
    ) -> (Trial, f64) {
        match column {
            Column::Along(i) => {
                let step = STEP * fineness;
                let sides: &[f64] = if free { &[1.0, -1.0] } else { &[1.0] };
                for side in sides {
                    let z = self.coordinates.shifted(z, i, side * step);
                    if self.is_inside(&z) {
                        return (
                            self.trial(&z, &centre.states, Some(centre.updates)),
                            side * step,
                        );
                    }
                }
                (
                    self.trial(z, &centre.states, Some(centre.updates)),
                    f64::NAN,
                )
            }
            Column::Updates(i) => {
                let updates = if fineness > 0.0 {
                    centre.updates + 1
                } else {
                    centre.updates.max(2) - 1
                };
                let step = (f64::from(updates) / f64::from(centre.updates)).ln();
                let z = self.coordinates.shifted(z, i, step);
                let inside = step != 0.0 && self.is_inside(&z);
                let trial = self.trial(&z, &centre.states, Some(updates));
                (trial, if inside { step } else { f64::NAN })
            }
            Column::Lean(axis) => {
                let step = STEP * fineness;
                let sides: &[f64] = if free { &[1.0, -1.0] } else { &[1.0] };
                for side in sides {
                    let mut z = z.to_vec();
                    let own = z.iter_mut().skip(self.coordinates.tail() + axis);
                    own.step_by(2).for_each(|z| *z += side * step);
                    if self.is_inside(&z) {
                        let trial = self.trial(&z, &centre.states, Some(centre.updates));
                        return (trial, side * step);
                    }
                }
                (
                    self.trial(z, &centre.states, Some(centre.updates)),
                    f64::NAN,
                )
            }
            Column::Row(i) => {
                let row_s = self.row_s().unwrap_or(centre.values[TIME] * SUBSTEP_S);
                let step = fineness.signum() * self.coordinates.per_unit(i, row_s);
                let mut z = z.to_vec();
                z[i] += step;
                let inside = self.is_inside(&z);
                let trial = self.trial(&z, &centre.states, Some(centre.updates));
                (trial, if inside { step } else { f64::NAN })
            }
            Column::State(component) => {
                let step = STATE_STEP * fineness;
                let mut states = centre.states.clone();
                for state in &mut states {
                    // Towards the centre is away from the walls.
                    let outwards = free && component < 2 && state[component] > 0.0;
                    state[component] += if outwards { -step } else { step };
                }
                let trial = Trial {
                    values: centre.values.clone(),
                    states,
                    updates: centre.updates,
                };
                (trial, step)
            }
        }
    }

    /// Slopes sorted into the columns of their directions.
    fn sorted(
        &self,
        columns: &[Column],
        slopes: Vec<Vec<f64>>,
        residual: Vec<f64>,
    ) -> Linearisation {
        let mut line = Linearisation {
            residual,
            by_z: Vec::new(),
            by_state: Vec::new(),
        };
        let tail = self.coordinates.tail();
        for (column, slope) in columns.iter().zip(slopes) {
            match column {
                Column::Along(_) => line.by_z.push(slope),
                Column::Lean(axis) => {
                    let empty = vec![0.0; slope.len()];
                    line.by_z.resize(self.coordinates.len(), empty);
                    for window in &self.windows.all {
                        let own = window.residuals();
                        let column = &mut line.by_z[tail + 2 * window.recording + axis];
                        column[own.clone()].copy_from_slice(&slope[own]);
                    }
                }
                Column::Updates(i) => believe_gentler(&mut line.by_z[*i], &slope),
                Column::Row(i) => {
                    for window in &self.windows.all {
                        let tilt = window.tilt();
                        line.by_z[*i][tilt.clone()].copy_from_slice(&slope[tilt]);
                    }
                }
                Column::State(_) => line.by_state.push(slope),
            }
        }
        line
    }

    fn is_inside(&self, z: &[f64]) -> bool {
        let clipped = self.coordinates.clip(z);
        clipped
            .iter()
            .zip(z)
            .all(|(clipped, z)| (clipped - z).abs() < 1e-12)
    }

    /// Difference quotients; NaN outside the bounds, beyond the walls and where a marble at rest would move.
    fn one_sided(
        &self,
        trial: &Trial,
        moved: &[f64],
        centre: &[f64],
        step: impl Fn(usize) -> f64,
    ) -> Vec<f64> {
        let mut slope = vec![f64::NAN; moved.len()];
        for (index, (window, state)) in self.windows.all.iter().zip(&trial.states).enumerate() {
            if self.within(&trial.values, window, *state) == *state {
                let step = step(index);
                for i in window.residuals() {
                    slope[i] = (moved[i] - centre[i]) / step;
                }
            }
        }
        slope
    }
}

/// The mean of two one-sided slopes, or the gentler one where they disagree; if one is NaN, the other one.
///
/// They disagree where a stop or an impact lies on one side: such an event moves by whole physics
/// updates, and a finite difference sees the jump as a steep slope.
fn agreed(ahead: &[f64], behind: Option<&Vec<f64>>) -> Vec<f64> {
    let behind = behind.map_or(ahead, Vec::as_slice);
    let one = |(&ahead, &behind): (&f64, &f64)| {
        let ahead = if ahead.is_nan() { behind } else { ahead };
        let behind = if behind.is_nan() { ahead } else { behind };
        if ahead.is_nan() {
            return 0.0;
        }
        let allowed = AGREEMENT * (ahead.abs() + behind.abs()) + AGREEMENT_FLOOR;
        if (ahead - behind).abs() <= allowed {
            f64::midpoint(ahead, behind)
        } else {
            gentler(ahead, behind)
        }
    };
    ahead.iter().zip(behind).map(one).collect()
}

fn believe_gentler(slope: &mut [f64], other: &[f64]) {
    for (slope, &other) in slope.iter_mut().zip(other) {
        *slope = gentler(*slope, other);
    }
}

fn gentler(one: f64, other: f64) -> f64 {
    if one.abs() < other.abs() { one } else { other }
}
