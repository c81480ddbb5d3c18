//! Residuals of many candidates over many windows, and their slopes: each call is one batch of rollouts
//! for each length of windows.

use std::cell::Cell;
use std::sync::atomic::AtomicBool;

use super::coordinates::{Coordinates, SCALE, TIME};
use super::problem::Problem;
use super::windows::{State, Window, Windows};
use crate::board::SUBSTEP_S;
use crate::effects::Chosen;
use crate::error::Result;
use crate::parameters::Parameters;
use crate::rollout::{Batch, PerRollout, TimeBase};

/// Steps of the finite differences: in coordinates, and in start states (board edges, and board edges a
/// row). Large against the jumps of a stop that moves by one physics update, small against the
/// curvature of the motion.
const STEP: f64 = 1e-3;
const STATE_STEP: f64 = 1e-4;
/// The share of these steps with which a careful look is taken.
const FINE: f64 = 0.03;
/// Two slopes agree within this share of their sizes, or this much (edges per unit).
const AGREEMENT: f64 = 0.1;
const AGREEMENT_FLOOR: f64 = 0.01;

/// Coordinates and the start states of all windows.
#[derive(Debug, Clone)]
pub(super) struct Point {
    pub(super) z: Vec<f64>,
    pub(super) states: Vec<State>,
}

/// Residuals at a point and their slopes, a column of all residuals for each coordinate and for each
/// component of the start states; a window's state moves its own residuals only.
#[derive(Debug, Clone)]
pub(super) struct Linearisation {
    /// Predicted minus observed (board edges); zero where nothing was seen.
    pub(super) residual: Vec<f64>,
    pub(super) by_z: Vec<Vec<f64>>,
    pub(super) by_state: Vec<Vec<f64>>,
}

/// How slopes are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Look {
    /// To one side: on the way.
    Quick,
    /// To both sides, believing the gentler slope where they disagree.
    Both,
    /// With steps of two sizes as well, again believing the gentler slope: where an impact shortly
    /// before or after decides where the marble goes, a step of one size sees a cliff.
    Careful,
}

/// What a finite difference moves.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Column {
    /// A coordinate, and what moves along with it.
    Along(usize),
    /// The time scale, by a physics update a row more or less of equal length.
    Updates(usize),
    /// A component of every window's start state.
    State(usize),
}

/// What predicts windows.
pub(super) struct Shooting<'a> {
    pub(super) problem: &'a Problem<'a>,
    pub(super) coordinates: &'a Coordinates,
    pub(super) windows: &'a Windows,
    cancel: &'a AtomicBool,
    /// Physics updates this many times longer than the engine's own: for the way to a solution. Stamped
    /// recordings are simulated with the engine's own all the same.
    coarseness: f64,
    rollouts: Cell<usize>,
}

/// A point, and how many physics updates a row has.
struct Trial {
    values: Vec<f64>,
    states: Vec<State>,
    updates: u32,
}

impl<'a> Shooting<'a> {
    pub(super) fn new(
        problem: &'a Problem<'a>,
        coordinates: &'a Coordinates,
        windows: &'a Windows,
        coarseness: f64,
        cancel: &'a AtomicBool,
    ) -> Self {
        Self {
            problem,
            coordinates,
            windows,
            cancel,
            coarseness,
            rollouts: Cell::new(0),
        }
    }

    /// How many windows were simulated so far.
    pub(super) fn rollouts(&self) -> usize {
        self.rollouts.get()
    }

    /// Residuals at each point.
    pub(super) fn residuals(&self, points: &[Point]) -> Result<Vec<Vec<f64>>> {
        self.residuals_with(points, 0)
    }

    /// Residuals at each point with so many shorter physics updates a row more, or longer ones less.
    pub(super) fn residuals_with(&self, points: &[Point], more: i32) -> Result<Vec<Vec<f64>>> {
        let trials: Vec<Trial> = points
            .iter()
            .map(|point| {
                let mut trial = self.trial(&point.z, &point.states, None);
                trial.updates = trial.updates.saturating_add_signed(more).max(1);
                trial
            })
            .collect();
        self.simulate(&trials)
    }

    /// Residuals and slopes at each point.
    pub(super) fn linearise(&self, points: &[Point], look: Look) -> Result<Vec<Linearisation>> {
        let mut lines = self.slopes(points, look, 1.0)?;
        if look == Look::Careful {
            for (line, fine) in lines.iter_mut().zip(self.slopes(points, look, FINE)?) {
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
    /// rounded to another number would jump. But then a change of the time scale also changes how long an
    /// update is, and what impacts do depends on that a little; so this column is taken a second time,
    /// with one update more or less of equal length.
    fn slopes(&self, points: &[Point], look: Look, fineness: f64) -> Result<Vec<Linearisation>> {
        let columns = self.columns(look);
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
                for &column in &columns {
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
        let mut steps = steps.chunks(sides.len() * columns.len());
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
            self.sorted(&columns, slopes.collect(), residual)
        };
        Ok(points.iter().map(line).collect())
    }

    fn columns(&self, look: Look) -> Vec<Column> {
        let time = self.coordinates.find(TIME);
        let twice = time.filter(|_| look != Look::Quick);
        let along = (0..self.coordinates.len()).map(Column::Along);
        let states = (0..self.windows.components()).map(Column::State);
        along
            .chain(twice.map(Column::Updates))
            .chain(states)
            .collect()
    }

    /// A trial with one thing moved, and how far: not at all where bounds forbid it. A side that is `free`
    /// is that which leads inwards.
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

    fn is_inside(&self, z: &[f64]) -> bool {
        let clipped = self.coordinates.clip(z);
        clipped
            .iter()
            .zip(z)
            .all(|(clipped, z)| (clipped - z).abs() < 1e-12)
    }

    /// Difference quotients; not a number where there is none: outside the bounds, beyond the walls, and
    /// where a marble at rest would move.
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
        for (column, slope) in columns.iter().zip(slopes) {
            match column {
                Column::Along(_) => line.by_z.push(slope),
                Column::Updates(i) => believe_gentler(&mut line.by_z[*i], &slope),
                Column::State(_) => line.by_state.push(slope),
            }
        }
        line
    }

    fn trial(&self, z: &[f64], states: &[State], updates: Option<u32>) -> Trial {
        let values = self.coordinates.to_values(z);
        let own = (values[TIME] / self.coarseness).round().max(1.0) as u32;
        let states = if updates.is_some() {
            states.to_vec()
        } else {
            let windows = self.windows.all.iter().zip(states);
            windows
                .map(|(window, state)| self.within(&values, window, *state))
                .collect()
        };
        Trial {
            values,
            states,
            updates: updates.unwrap_or(own),
        }
    }

    /// A start state between the walls, and at rest where the recording says so.
    fn within(&self, values: &[f64], window: &Window, mut state: State) -> State {
        if !self.problem.bends_pictures() {
            let reach = self.problem.rig.reach_m();
            for (place, reach) in state.iter_mut().zip(reach) {
                let reach = values[SCALE] * reach / self.problem.rig.board.edge_x_m;
                *place = place.clamp(-reach, reach);
            }
        }
        if window.at_rest {
            state[2..].fill(0.0);
        }
        state
    }

    /// Residuals of trials, simulated in one batch for each length of windows.
    fn simulate(&self, trials: &[Trial]) -> Result<Vec<Vec<f64>>> {
        let mut residuals = vec![vec![0.0; self.windows.len()]; trials.len()];
        for (rows, indices) in &self.windows.lengths {
            let windows: Vec<&Window> = indices.iter().map(|&i| &self.windows.all[i]).collect();
            let observations = self.observe(trials, *rows, indices, &windows)?;
            self.rollouts
                .set(self.rollouts.get() + trials.len() * windows.len());
            let mut observations = observations.chunks_exact(*rows);
            for residual in &mut residuals {
                for (window, seen) in windows.iter().zip(&mut observations) {
                    let places = window.residuals();
                    let observed = &self.windows.observed[places.clone()];
                    let known = &self.windows.known[places.clone()];
                    for (i, residual) in residual[places].iter_mut().enumerate() {
                        if known[i] {
                            *residual = seen.as_flattened()[i] - observed[i];
                        }
                    }
                }
            }
        }
        Ok(residuals)
    }

    fn observe(
        &self,
        trials: &[Trial],
        rows: usize,
        indices: &[usize],
        windows: &[&Window],
    ) -> Result<Vec<[f64; 2]>> {
        let problem = self.problem;
        let remembers = problem.remembers();
        let begin = |window: &Window| if remembers { 0 } else { window.first };
        let end = |window: &Window| {
            if remembers {
                usize::MAX
            } else {
                window.first + rows
            }
        };
        let count = trials.len() * windows.len();
        let mut parameters = Vec::with_capacity(count);
        let mut effects: Vec<Vec<f64>> = vec![Vec::new(); problem.effects.len()];
        let (mut start, mut start_velocity) =
            (Vec::with_capacity(count), Vec::with_capacity(count));
        let mut updates = Vec::with_capacity(count);
        for trial in trials {
            let (base, of_effects) = trial.values.split_at(5);
            let base = Parameters::from(std::array::from_fn::<f64, 5, _>(|i| base[i]));
            for (&index, window) in indices.iter().zip(windows) {
                let state = self.within(&trial.values, window, trial.states[index]);
                let row_s = window.row_s.unwrap_or(base.time_scale * SUBSTEP_S);
                parameters.push(base);
                start.push([state[0], state[1]]);
                start_velocity.push([state[2] / row_s, state[3] / row_s]);
                updates.push(trial.updates);
                let mut rest = of_effects;
                for (values, one) in effects.iter_mut().zip(problem.effects) {
                    let (own, others) = rest.split_at(one.values.len());
                    values.extend_from_slice(own);
                    rest = others;
                }
            }
        }
        let each = |of: &dyn Fn(&Window) -> usize| -> Vec<usize> {
            let of_windows: Vec<usize> = windows.iter().map(|window| of(window)).collect();
            of_windows.repeat(trials.len())
        };
        let first = each(&|window| window.first - begin(window));
        let seeds: Vec<u64> = each(&|window| window.recording)
            .iter()
            .map(|&i| i as u64)
            .collect();
        let recording = |window: &Window| &problem.recordings[window.recording];
        let commands: Vec<&[[f64; 2]]> = windows
            .iter()
            .map(|window| {
                let all = recording(window).commands;
                &all[begin(window)..end(window).min(all.len())]
            })
            .collect();
        let durations: Vec<&[f64]> = windows
            .iter()
            .filter_map(|window| {
                let all = recording(window).durations?;
                Some(&all[begin(window)..end(window).min(all.len())])
            })
            .collect();
        let knobs: Vec<[f64; 2]> = windows
            .iter()
            .map(|window| recording(window).knobs_before)
            .collect();
        let (commands, durations) = (
            commands.repeat(trials.len()),
            durations.repeat(trials.len()),
        );
        let knobs = knobs.repeat(trials.len());
        let chosen: Vec<Chosen<'_>> = problem
            .effects
            .iter()
            .zip(&effects)
            .map(|(one, values)| Chosen {
                effect: one.effect,
                values: PerRollout::Each(values),
            })
            .collect();
        let batch = Batch {
            rig: problem.rig,
            parameters: &parameters,
            effects: &chosen,
            rows,
            commands: PerRollout::Of(&commands),
            knobs_before: PerRollout::Each(&knobs),
            first: PerRollout::Each(&first),
            start: PerRollout::Each(&start),
            start_velocity: PerRollout::Each(&start_velocity),
            time: if problem.is_stamped() {
                TimeBase::Durations(PerRollout::Of(&durations))
            } else {
                TimeBase::Continuous(Some(&updates))
            },
            seeds: PerRollout::Each(&seeds),
        };
        batch.run(problem.engine, problem.threads, self.cancel)
    }
}

/// The mean of two one-sided slopes, or the gentler one where they disagree; one that is not a number is
/// left to the other.
///
/// They disagree where a stop or an impact lies on one side: such an event moves by whole physics
/// updates, a jump that a finite difference takes for a cliff.
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
