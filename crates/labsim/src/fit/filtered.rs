//! Filters over whole stretches: predictions of each row from all rows before, of many candidates in one batch.

use super::channels::{MARBLE, TILT};
use super::shooting::Shooting;
use super::trial::{Trial, distinct};
use super::windows::Window;
use crate::effects::{EffectInstance, EffectSpec, effect};
use crate::engine::Engine;
use crate::error::Result;
use crate::filter::{Filter, MeasuredTilt, Rows, Smoothed};
use crate::noise::Noise;
use crate::per_rollout::PerRollout;
use crate::rollout::Batch;

/// Output of the filter for each stretch at some values.
#[derive(Debug, Clone, PartialEq)]
pub struct Filtered {
    /// Positions as predicted from all rows before (board edges), no numbers without a marble; empty if the tracker
    /// has too few rows and there is no tilt.
    pub predicted: Vec<Vec<[f64; 2]>>,
    /// Variances about them (board edges squared); NaN in first rows.
    pub variance: Vec<Vec<[f64; 2]>>,
    /// The measured tilt as predicted from all rows before (rad); empty without one.
    pub tilt: Vec<Vec<[f64; 2]>>,
    /// Variances about that (rad²).
    pub tilt_variance: Vec<Vec<[f64; 2]>>,
    /// Log-likelihoods of the observations: the marble along both axes, the tilt about both.
    pub log_likelihood: Vec<[f64; 4]>,
}

impl Shooting<'_> {
    /// Predicts each row of whole stretches from all rows before, with one noise for each trial. Calls with the numbers
    /// of trial and stretch, and the rows; all trials have the same order of stretches.
    pub(super) fn predict(
        &self,
        trials: &[&Trial],
        noise: &[Noise],
        mut take: impl FnMut([usize; 2], Rows<'_>),
    ) -> Result<()> {
        self.with_filters(trials, noise, |filter, windows| {
            let rows = filter.batch.rows;
            let found = filter.run(self.problem.threads, self.cancel)?;
            for i in 0..trials.len() * windows.len() {
                let which = [i / windows.len(), windows[i % windows.len()]];
                take(which, found.of_rollout(i, rows));
            }
            Ok(())
        })
    }

    /// As [`Shooting::predict`], with the likelihoods.
    pub(super) fn filter(&self, trials: &[&Trial], noise: &[Noise]) -> Result<Vec<Filtered>> {
        let none = || vec![Vec::new(); self.windows.all.len()];
        let empty = || Filtered {
            predicted: none(),
            variance: none(),
            tilt: none(),
            tilt_variance: none(),
            log_likelihood: vec![[0.0; 4]; self.windows.all.len()],
        };
        let mut filtered: Vec<Filtered> = trials.iter().map(|_| empty()).collect();
        self.with_filters(trials, noise, |filter, windows| {
            let rows = filter.batch.rows;
            let found = filter.run(self.problem.threads, self.cancel)?;
            let likelihoods = filter.log_likelihoods(&found);
            for (i, likelihood) in likelihoods.into_iter().enumerate() {
                let (trial, window) = (i / windows.len(), windows[i % windows.len()]);
                let (all, own) = (&mut filtered[trial], found.of_rollout(i, rows));
                all.predicted[window] = own.marble.to_vec();
                all.variance[window] = own.variance.to_vec();
                all.tilt[window] = own.tilt.to_vec();
                all.tilt_variance[window] = own.tilt_variance.to_vec();
                all.log_likelihood[window] = likelihood;
            }
            Ok(())
        })?;
        Ok(filtered)
    }

    /// Smoothed random accelerations of each stretch; empty without a marble, or if the tracker has too few rows.
    pub(super) fn smooth(&self, trial: &Trial, noise: Noise) -> Result<Vec<Vec<[Smoothed; 2]>>> {
        let mut smoothed = vec![Vec::new(); self.windows.all.len()];
        self.with_filters(&[trial], &[noise], |filter, windows| {
            let found = filter.smoothed(self.problem.threads, self.cancel)?;
            for (rows, &window) in found.chunks_exact(filter.batch.rows).zip(windows) {
                smoothed[window] = rows.to_vec();
            }
            Ok(())
        })?;
        Ok(smoothed)
    }

    /// Prior standard deviations of gain and zero (rad) of the tilt sensor in each stretch, from their plausible
    /// ranges.
    ///
    /// The gain is the same in all stretches. One of its own for each with a tilt, with a deviation larger by the root
    /// of their number, says as much about the gears.
    fn sensor(&self) -> Result<[f64; 2]> {
        let parameters = effect("tilt_sensor")?.parameters;
        let deviation = |name: &str| {
            let found = parameters.iter().find(|one| one.name == name);
            found.map_or(0.0, |one| (one.range.1 - one.range.0) / 12.0_f64.sqrt())
        };
        let is_measured = |one: &&Window| self.windows.known[one.tilt()].contains(&true);
        let stretches = self.windows.all.iter().filter(is_measured).count() as f64;
        Ok([
            deviation("gain_x") * stretches.sqrt(),
            deviation("zero_x_rad"),
        ])
    }

    /// The tilt of trials over windows of the same length, trial after trial. Start states and sizes of noise change
    /// none.
    fn tilts(
        &self,
        trials: &[&Trial],
        rows: usize,
        (indices, windows): (&[usize], &[&Window]),
    ) -> Result<Vec<[f64; 2]>> {
        let (own, twins) = distinct(trials);
        let simulated: Vec<&Trial> = own.iter().map(|&i| trials[i]).collect();
        let found = self.with_batch(&simulated, rows, (indices, windows), |batch| {
            batch.run_with_tilt(Engine::Rolling, self.problem.threads, self.cancel)
        })?;
        let mut simulated: Vec<usize> = (0..trials.len()).collect();
        for (i, trial) in own.into_iter().enumerate() {
            simulated[trial] = i;
        }
        for (trial, twin) in twins {
            simulated[trial] = simulated[twin];
        }
        let rows = rows * windows.len();
        let of_trial = |i: usize| &found.tilt[i * rows..(i + 1) * rows];
        Ok(simulated.into_iter().flat_map(of_trial).copied().collect())
    }

    /// Calls with the filters of stretches of one length, trial after trial, and the numbers of these stretches.
    fn with_filters(
        &self,
        trials: &[&Trial],
        noise: &[Noise],
        mut work: impl FnMut(&Filter<'_>, &[usize]) -> Result<()>,
    ) -> Result<()> {
        let has_tilt = self.windows.channels.has_tilt();
        let sensor = has_tilt.then(|| self.sensor()).transpose()?;
        // A marble may lie where it is not seen while the board tilts.
        let counts = |((_, has_marble), _): &&((usize, bool), _)| *has_marble || has_tilt;
        for ((rows, has_marble), indices) in self.windows.lengths.iter().filter(counts) {
            let windows: Vec<&Window> = indices.iter().map(|&i| &self.windows.all[i]).collect();
            // Axes with constant positions are ignored.
            let active = &self.windows.channels.active;
            let seen: Vec<Vec<[f64; 2]>> = windows
                .iter()
                .map(|window| {
                    let seen = self.problem.recordings[window.recording].observed;
                    of_axes(&seen[window.first..window.first + rows], &active[MARBLE])
                })
                .collect();
            let tilts: Vec<Vec<[f64; 2]>> = windows
                .iter()
                .map(
                    |window| match self.problem.recordings[window.recording].tilt {
                        Some(tilt) => {
                            of_axes(&tilt[window.first..window.first + rows], &active[TILT])
                        }
                        None => vec![[f64::NAN; 2]; *rows],
                    },
                )
                .collect();
            let (observed, tilt) = (
                repeated(&seen, trials.len()),
                repeated(&tilts, trials.len()),
            );
            let noise: Vec<Noise> = noise
                .iter()
                .flat_map(|noise| {
                    windows.iter().map(|window| {
                        let start_velocity = noise.start_velocity;
                        Noise {
                            start_velocity: start_velocity
                                .map(|size| if window.at_rest { 0.0 } else { size }),
                            ..*noise
                        }
                    })
                })
                .collect();
            let swept = if *has_marble {
                None
            } else {
                Some(self.tilts(trials, *rows, (indices, &windows))?)
            };
            self.with_batch(trials, *rows, (indices, &windows), |batch| {
                let late = if has_tilt {
                    late_commands(batch)?
                } else {
                    None
                };
                let late = late.as_ref().map(LateCommands::effects);
                let mut predicted = swept;
                if late.is_some() && predicted.is_none() {
                    let threads = self.problem.threads;
                    let found = batch.run_with_tilt(Engine::Rolling, threads, self.cancel)?;
                    predicted = Some(found.tilt);
                }
                let filter = Filter {
                    batch: Batch {
                        effects: late.as_deref().unwrap_or(batch.effects),
                        ..*batch
                    },
                    observed: has_marble.then_some(PerRollout::Of(&observed)),
                    tilt: sensor.map(|[gain, zero]| MeasuredTilt {
                        rows: PerRollout::Of(&tilt),
                        predicted: predicted.as_deref(),
                        gain,
                        zero,
                    }),
                    noise: PerRollout::Each(&noise),
                };
                work(&filter, indices)
            })?;
        }
        Ok(())
    }
}

/// Effects of rollouts whose commands are late by the age of the pictures.
struct LateCommands<'a> {
    others: Vec<EffectInstance<'a>>,
    delay: &'static EffectSpec,
    /// Values of the delay in each rollout.
    values: Vec<f64>,
}

/// The effects of a batch with a latency of its pictures as a delay of its commands; none without a latency.
///
/// In both the marble is seen at the same places. A filter takes an observation for one of the present, and only
/// with late commands it is. The tilt is not late with a latency.
fn late_commands<'a>(batch: &Batch<'a>) -> Result<Option<LateCommands<'a>>> {
    let rollouts = batch.parameters.len();
    let named = |name: &str| batch.effects.iter().find(|one| one.effect.name == name);
    let Some(latency) = named("latency") else {
        return Ok(None);
    };
    let spec = effect("delay")?;
    let count = spec.parameters.len();
    let mut values = Vec::with_capacity(rollouts * count);
    for rollout in 0..rollouts {
        let first = values.len();
        match named("delay") {
            Some(delay) => values.extend_from_slice(delay.values.of(rollout, count)),
            None => values.extend(spec.parameters.iter().map(|one| one.neutral)),
        }
        values[first] += latency.values.of(rollout, 1)[0];
    }
    let others = batch.effects.iter().copied();
    let others = others.filter(|one| !["latency", "delay"].contains(&one.effect.name));
    Ok(Some(LateCommands {
        others: others.collect(),
        delay: spec,
        values,
    }))
}

impl LateCommands<'_> {
    fn effects(&self) -> Vec<EffectInstance<'_>> {
        let delay = EffectInstance {
            effect: self.delay,
            values: PerRollout::Each(&self.values),
        };
        self.others.iter().copied().chain([delay]).collect()
    }
}

/// Rows with no number along axes that are ignored.
fn of_axes(rows: &[[f64; 2]], active: &[bool]) -> Vec<[f64; 2]> {
    let known = |axis: usize, value: f64| if active[axis] { value } else { f64::NAN };
    rows.iter()
        .map(|row| std::array::from_fn(|axis| known(axis, row[axis])))
        .collect()
}

/// The rows of all windows, once for each trial.
fn repeated(all: &[Vec<[f64; 2]>], trials: usize) -> Vec<&[[f64; 2]]> {
    let one: Vec<&[[f64; 2]]> = all.iter().map(Vec::as_slice).collect();
    one.repeat(trials)
}
