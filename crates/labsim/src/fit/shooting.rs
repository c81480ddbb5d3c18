//! Residuals of many candidates over many windows: each call is one batch of rollouts for each length of
//! windows.

use std::cell::Cell;
use std::collections::HashMap;
use std::sync::atomic::AtomicBool;

use super::channels::MARBLE;
use super::coordinates::Coordinates;
use super::problem::{LEAN, Problem};
use super::trial::{Trial, distinct};
use super::windows::{State, Window, Windows};
use crate::board::SUBSTEP_S;
use crate::effects::EffectInstance;
use crate::engine::Hold;
use crate::error::Result;
use crate::orientation::turned;
use crate::parameters::{Parameters, SCALE, TIME};
use crate::per_rollout::PerRollout;
use crate::rollout::{Batch, Observed, TimeBase};

/// Coordinates and the start states of all windows.
#[derive(Debug, Clone)]
pub(super) struct Point {
    pub(super) z: Vec<f64>,
    pub(super) states: Vec<State>,
}

/// The predictor of windows.
pub(super) struct Shooting<'a> {
    pub(super) problem: &'a Problem<'a>,
    pub(super) coordinates: &'a Coordinates,
    pub(super) windows: &'a Windows,
    pub(super) cancel: &'a AtomicBool,
    /// Length of physics updates relative to the engine's own, for the stages before a solution. Stamped
    /// recordings always use the engine's own.
    coarseness: f64,
    rollouts: Cell<usize>,
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

    /// Number of windows simulated so far.
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

    pub(super) fn trial(&self, z: &[f64], states: &[State], updates: Option<u32>) -> Trial {
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

    /// A start state between the walls, and at rest if the recording is.
    pub(super) fn within(&self, values: &[f64], window: &Window, mut state: State) -> State {
        if !self.problem.bends_pictures() {
            let reach = self.problem.rig.reach_m();
            for (place, reach) in state.iter_mut().zip(reach) {
                let reach = values[SCALE] * reach / self.problem.rig.board.edge_x_m;
                *place = place.clamp(-reach, reach);
            }
        }
        for (axis, active) in self.windows.channels.active[MARBLE].iter().enumerate() {
            if !active {
                state[axis] = window.guess[axis];
            }
            if !active || window.at_rest {
                state[2 + axis] = 0.0;
            }
        }
        state
    }

    /// Residuals of trials, simulated in one batch for each length of windows.
    pub(super) fn simulate(&self, trials: &[Trial]) -> Result<Vec<Vec<f64>>> {
        let mut residuals = vec![vec![0.0; self.windows.len()]; trials.len()];
        for ((rows, has_marble), indices) in &self.windows.lengths {
            let windows: Vec<&Window> = indices.iter().map(|&i| &self.windows.all[i]).collect();
            let (own, twins) = if *has_marble {
                ((0..trials.len()).collect(), Vec::new())
            } else {
                distinct(trials)
            };
            let simulated: Vec<&Trial> = own.iter().map(|&i| &trials[i]).collect();
            let observed = self.observe(&simulated, *rows, indices, &windows)?;
            self.rollouts
                .set(self.rollouts.get() + simulated.len() * windows.len());
            let mut marbles = observed.marble.chunks_exact(*rows);
            let mut tilts = observed.tilt.chunks_exact(*rows);
            for &trial in &own {
                for window in &windows {
                    let marble = marbles.next().unwrap_or_default();
                    self.compare(window.marble(), 0, marble, &mut residuals[trial]);
                    let tilt = tilts.next().unwrap_or_default();
                    self.compare(window.tilt(), MARBLE.end, tilt, &mut residuals[trial]);
                }
            }
            for (trial, twin) in twins {
                for window in &windows {
                    let found = residuals[twin][window.residuals()].to_vec();
                    residuals[trial][window.residuals()].copy_from_slice(&found);
                }
            }
        }
        Ok(residuals)
    }

    /// Residuals from predictions, with the first channel given.
    fn compare(
        &self,
        places: std::ops::Range<usize>,
        channel: usize,
        predicted: &[[f64; 2]],
        residual: &mut [f64],
    ) {
        let observed = &self.windows.observed[places.clone()];
        let known = &self.windows.known[places.clone()];
        let weights = &self.windows.channels.weights[channel..channel + 2];
        for (i, residual) in residual[places].iter_mut().enumerate() {
            if known[i] {
                *residual = weights[i % 2] * (predicted.as_flattened()[i] - observed[i]);
            }
        }
    }

    fn observe(
        &self,
        trials: &[&Trial],
        rows: usize,
        indices: &[usize],
        windows: &[&Window],
    ) -> Result<Observed> {
        self.with_batch(trials, rows, (indices, windows), |batch| self.run(batch))
    }

    /// Calls a function with the rollouts of trials over windows of the same length, trial after trial.
    pub(super) fn with_batch<T>(
        &self,
        trials: &[&Trial],
        rows: usize,
        (indices, windows): (&[usize], &[&Window]),
        work: impl FnOnce(&Batch<'_>) -> Result<T>,
    ) -> Result<T> {
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
        let effects = self.effects(trials, windows);
        let (mut start, mut start_velocity) =
            (Vec::with_capacity(count), Vec::with_capacity(count));
        let (mut rolled, mut updates) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for trial in trials {
            let base = &trial.values[..5];
            let base = Parameters::from(std::array::from_fn::<f64, 5, _>(|i| base[i]));
            let edge = self.edge_m(trial);
            for (&index, window) in indices.iter().zip(windows) {
                let state = self.within(&trial.values, window, trial.states[index]);
                let row_s = window.row_s.unwrap_or(base.time_scale * SUBSTEP_S);
                parameters.push(base);
                start.push([state[0], state[1]]);
                start_velocity.push([state[2] / row_s, state[3] / row_s]);
                rolled.push(window.rolled * edge);
                updates.push(trial.updates);
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
            .map(|window| self.before(window, begin(window)))
            .collect();
        let (commands, durations) = (
            commands.repeat(trials.len()),
            durations.repeat(trials.len()),
        );
        let knobs = knobs.repeat(trials.len());
        let chosen: Vec<EffectInstance<'_>> = problem
            .effects
            .iter()
            .zip(&effects)
            .map(|(one, values)| EffectInstance {
                effect: one.effect,
                values: PerRollout::Each(values),
            })
            .collect();
        let batch = Batch {
            rig: problem.rig,
            maze: None,
            parameters: &parameters,
            effects: &chosen,
            rows,
            commands: PerRollout::Of(&commands),
            hold: problem.hold,
            knobs_before: PerRollout::Each(&knobs),
            first: PerRollout::Each(&first),
            start: PerRollout::Each(&start),
            start_velocity: PerRollout::Each(&start_velocity),
            rolled: PerRollout::Each(&rolled),
            turned: PerRollout::Each(&self.turned(trials, windows)),
            time: if problem.is_stamped() {
                TimeBase::Durations(PerRollout::Of(&durations))
            } else {
                TimeBase::Continuous(Some(&updates))
            },
            seeds: PerRollout::Each(&seeds),
        };
        work(&batch)
    }

    /// Simulates a batch, with the tilt if it is in use.
    fn run(&self, batch: &Batch<'_>) -> Result<Observed> {
        let (engine, threads) = (self.problem.engine, self.problem.threads);
        if self.windows.channels.has_tilt() {
            return batch.run_with_tilt(engine, threads, self.cancel);
        }
        Ok(Observed {
            marble: batch.run(engine, threads, self.cancel)?,
            tilt: Vec::new(),
        })
    }

    /// The commands before those of a window, which begin at a row of its recording (knob angles, rad).
    fn before(&self, window: &Window, begin: usize) -> [f64; 2] {
        let recording = &self.problem.recordings[window.recording];
        if begin == 0 || window.tilts == 0 {
            return recording.knobs_before;
        }
        // The tilt of a row is that of the previous command, or of its own for commands that ramp to it.
        recording.commands[begin - usize::from(self.problem.hold == Hold::Zero)]
    }

    /// The values of each effect's parameters for all windows, trial after trial.
    fn effects(&self, trials: &[&Trial], windows: &[&Window]) -> Vec<Vec<f64>> {
        let problem = self.problem;
        let mut effects: Vec<Vec<f64>> = vec![Vec::new(); problem.effects.len()];
        for trial in trials {
            for window in windows {
                let mut rest = &trial.values[5..];
                let lean = self.coordinates.lean(window.recording);
                for (values, one) in effects.iter_mut().zip(problem.effects) {
                    let (own, others) = rest.split_at(one.values.len());
                    match lean.clone().filter(|_| one.effect.name == LEAN) {
                        Some(lean) => {
                            values.extend_from_slice(&trial.values[lean]);
                            values.extend_from_slice(&own[2..]);
                        }
                        None => values.extend_from_slice(own),
                    }
                    rest = others;
                }
            }
        }
        effects
    }

    /// True displacement per observed board edge (m).
    fn edge_m(&self, trial: &Trial) -> f64 {
        self.problem.rig.board.edge_x_m / trial.values[SCALE]
    }

    /// Orientations of the marbles of all windows at their release, trial after trial.
    fn turned(&self, trials: &[&Trial], windows: &[&Window]) -> Vec<[f64; 3]> {
        let (turns, radius_m) = (self.problem.turns(), self.problem.rig.marble.radius_m);
        // Most trials share one observation scale.
        let mut known: HashMap<(usize, u64), Vec<[f64; 3]>> = HashMap::new();
        let mut all = Vec::with_capacity(trials.len() * windows.len());
        for trial in trials {
            let edge_m = self.edge_m(trial);
            for window in windows {
                let path = self.problem.recordings[window.recording].path;
                all.push(match path {
                    Some(path) if turns && window.first > 0 => known
                        .entry((window.recording, edge_m.to_bits()))
                        .or_insert_with(|| turned(path, radius_m / edge_m))[window.first],
                    _ => [0.0; 3],
                });
            }
        }
        all
    }
}
