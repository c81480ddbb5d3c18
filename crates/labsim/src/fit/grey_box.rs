//! Maximum a posteriori fits with random accelerations of the marble, and the evidence of the model.
//!
//! The likelihood is that of the filter ([`crate::filter`]); the sizes of its random quantities are estimated. Values
//! have a normal prior with the mean and the variance of their plausible ranges. The coefficients of a map have a
//! common normal prior about zero with an estimated spread (`MacKay` 1992). Fisher scoring maximises the posterior of
//! the values, the start states and the sizes together. The evidence is Laplace's approximation at the maximum, over
//! values and start states, with the sizes at their best ("Bayesian interpolation", 1992).

use std::sync::atomic::AtomicBool;

use nalgebra::{DMatrix, DVector, Matrix4, SVector};

use super::channels::MARBLE;
use super::coordinates::Coordinates;
use super::prior::Prior;
use super::problem::Problem;
use super::random_sizes::{SIZES, of_sizes, sizes, with_sizes};
use super::scoring::{Slope, Start, Step};
use super::shooting::{Filtered, Shooting, Trial};
use super::windows::State;
use crate::engine::TAIL;
use crate::error::Result;
use crate::filter::log_density;
use crate::noise::Noise;

/// Steps of the finite differences, in coordinates and in logarithms of sizes.
const STEP: f64 = 1e-4;
const SIZE_STEP: f64 = 1e-3;
/// The same in start states (board edges, board edges a row).
const STATE_STEP: f64 = 1e-5;
/// Prior standard deviations of start states: positions (board edges) about the first guess, and rates (board edges
/// per row) about rest.
const STATES: [f64; 4] = [1.0, 1.0, 0.1, 0.1];
/// Maximum change of a coordinate, and of the logarithm of a size, in one step: a needless size shrinks by many
/// powers of ten.
const FARTHEST: f64 = 0.7;
const FARTHEST_SIZE: f64 = 2.0;
/// An ascent ends where a step gains less [nats].
const LITTLE: f64 = 0.02;
/// The damping of the first step.
const DAMPING: f64 = 1e-3;
/// Dampings tried in each step, in units of the last one that helped, with shares of the step in values and states,
/// and of that in sizes.
const TRIED: [(f64, f64, f64); 5] = [
    (0.1, 1.0, 1.0),
    (10.0, 1.0, 1.0),
    (1000.0, 1.0, 1.0),
    (0.1, 1.0, 0.0),
    (0.1, 0.0, 1.0),
];
/// Fisher's information in one innovation about the logarithm of its variance.
const SPREAD: f64 = 0.5 * TAIL / (TAIL + 3.0);
/// Prior of the logarithm of a size: a standard deviation of ten, which keeps sizes without influence in place.
const KNOWN: f64 = 0.01;

/// The maximum that an ascent has reached.
#[derive(Debug, Clone, PartialEq)]
pub struct Probable {
    /// The five parameters, then those of the effects.
    pub values: Vec<f64>,
    /// Start states of the stretches, as of [`super::Refined`].
    pub states: Vec<Option<[f64; 4]>>,
    /// The sizes of the random quantities.
    pub noise: Noise,
    /// Log-likelihood of the observations [nats].
    pub log_likelihood: f64,
    /// Log evidence: marginal likelihood of the observations over all values [nats].
    pub log_evidence: f64,
    /// Places of the free parameters among all.
    pub slots: Vec<usize>,
    /// Their covariance, with the sizes marginalised.
    pub covariance: DMatrix<f64>,
}

/// Present point of an ascent.
#[derive(Clone)]
struct Place {
    z: Vec<f64>,
    states: Vec<State>,
    noise: Noise,
    /// Spreads of the coefficients of each map, in coordinates.
    spreads: Vec<f64>,
}

/// An ascent: its point, the posterior there, and its damping.
struct Ascent {
    place: Place,
    damping: f64,
    gain: f64,
}

impl Problem<'_> {
    /// Ascends from values and sizes of the random quantities, all in lockstep; start states begin at those of the
    /// stretches, if given.
    ///
    /// The gears of all values must have the signs of the first ones.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn ascend(
        &self,
        values: &[Vec<f64>],
        noise: &[Noise],
        states: Option<&[Vec<Option<[f64; 4]>>]>,
        iterations: usize,
        cancel: &AtomicBool,
    ) -> Result<Vec<Probable>> {
        self.check()?;
        let Some(first) = values.first() else {
            return Ok(Vec::new());
        };
        let (coordinates, whole) = self.around(first, cancel)?;
        let shooting = Shooting::new(self, &coordinates, &whole, 1.0, cancel);
        let hill = Hill {
            shooting: &shooting,
            coordinates: &coordinates,
            guesses: whole.guesses(),
            prior: Prior::new(&coordinates),
            sizes: (0..SIZES)
                .filter(|&i| noise.iter().any(|noise| sizes(noise)[i] > 0.0))
                .collect(),
        };
        let mut ascents = Vec::with_capacity(values.len());
        for (i, (values, noise)) in values.iter().zip(noise).enumerate() {
            self.check_values(values)?;
            let z = coordinates.clip(&coordinates.to_z(values));
            let noise = Noise {
                start_velocity: None,
                ..*noise
            };
            let states = self.of_windows(&whole, states.map_or(&[], |states| &states[i]));
            let place = Place {
                z,
                states,
                noise,
                spreads: hill.prior.widest(),
            };
            ascents.push(Ascent {
                place,
                damping: DAMPING,
                gain: f64::INFINITY,
            });
        }
        for _ in 0..iterations {
            let mut climbing: Vec<&mut Ascent> =
                ascents.iter_mut().filter(|one| one.gain > LITTLE).collect();
            if climbing.is_empty() {
                break;
            }
            hill.step(&mut climbing)?;
        }
        let places: Vec<&Place> = ascents.iter().map(|one| &one.place).collect();
        let slopes = hill.slopes(&places)?;
        Ok(places
            .into_iter()
            .zip(slopes)
            .map(|(place, slope)| {
                hill.top(place, &slope, |states| {
                    self.of_stretches(&whole, |i| states[i])
                })
            })
            .collect())
    }
}

/// The log-posterior.
struct Hill<'a> {
    shooting: &'a Shooting<'a>,
    coordinates: &'a Coordinates,
    guesses: Vec<State>,
    prior: Prior,
    /// The estimated sizes: those that are not zero everywhere.
    sizes: Vec<usize>,
}

impl Hill<'_> {
    /// One step of each ascent: the best of several dampings, with and without new sizes.
    fn step(&self, ascents: &mut [&mut Ascent]) -> Result<()> {
        let places: Vec<&Place> = ascents.iter().map(|one| &one.place).collect();
        let mut slopes = self.slopes(&places)?;
        let mut settled = Vec::with_capacity(slopes.len());
        for (ascent, slope) in ascents.iter_mut().zip(&mut slopes) {
            let place = &mut ascent.place;
            settled.push(self.prior.respread(&place.z, &mut place.spreads, slope));
        }
        let mut tried = Vec::new();
        let count = self.coordinates.len();
        for (ascent, slope) in ascents.iter().zip(&slopes) {
            let here = &ascent.place;
            for (factor, of_values, of_sizes) in TRIED {
                let step = self.scoring(slope, ascent.damping * factor);
                let moved: Vec<f64> = here
                    .z
                    .iter()
                    .zip(&step.common)
                    .map(|(z, step)| z + of_values * step)
                    .collect();
                let mut sizes = sizes(&here.noise);
                for (&i, step) in self.sizes.iter().zip(&step.common[count..]) {
                    sizes[i] *= (of_sizes * step).exp();
                }
                let mut states = here.states.clone();
                let all = states.iter_mut().zip(&step.states);
                for (state, step) in all.flat_map(|(state, step)| state.iter_mut().zip(step)) {
                    *state += of_values * step;
                }
                tried.push(Place {
                    z: self.coordinates.clip(&moved),
                    states,
                    noise: with_sizes(&here.noise, sizes),
                    spreads: here.spreads.clone(),
                });
            }
        }
        let found = self.filtered(&tried.iter().map(|place| self.at(place)).collect::<Vec<_>>())?;
        let each = tried.len() / ascents.len();
        let posterior = |i: usize| self.log_likelihood(&found[i]) + self.log_prior(&tried[i]);
        for (number, (ascent, slope)) in ascents.iter_mut().zip(slopes).enumerate() {
            let own = number * each..(number + 1) * each;
            let best = own.max_by(|&a, &b| posterior(a).total_cmp(&posterior(b)));
            let here = slope.log_likelihood + self.log_prior(&ascent.place);
            let Some(best) = best else { continue };
            let gain = posterior(best) - here;
            if gain > 0.0 {
                ascent.place = tried[best].clone();
                ascent.damping = (0.2 * ascent.damping).max(1e-8);
                ascent.gain = gain;
            } else {
                ascent.damping *= 10.0;
                ascent.gain = if ascent.damping > 1.0 {
                    0.0
                } else {
                    f64::INFINITY
                };
            }
            if !settled[number] {
                ascent.gain = f64::INFINITY;
            }
        }
        Ok(())
    }

    /// Curvature and slope of the log-posterior at each place.
    fn slopes(&self, places: &[&Place]) -> Result<Vec<Slope>> {
        let count = self.coordinates.len();
        let mut trials = Vec::new();
        for place in places {
            let here = self.at(place);
            let updates = here.0.updates;
            let states = here.0.states.clone();
            trials.push(here);
            for i in 0..count {
                let mut z = place.z.clone();
                z[i] += STEP;
                let trial = self.shooting.trial(&z, &states, Some(updates));
                trials.push((trial, place.noise));
            }
            for &i in &self.sizes {
                let mut sizes = sizes(&place.noise);
                sizes[i] *= SIZE_STEP.exp();
                let trial = self.shooting.trial(&place.z, &states, Some(updates));
                trials.push((trial, of_sizes(&place.noise, sizes)));
            }
            for i in 0..STATES.len() {
                let mut states = states.clone();
                for state in &mut states {
                    state[i] += STATE_STEP;
                }
                let trial = self.shooting.trial(&place.z, &states, Some(updates));
                trials.push((trial, place.noise));
            }
        }
        let filtered = self.filtered(&trials)?;
        let each = trials.len() / places.len();
        let of_place = |(place, found): (&&Place, &[Filtered])| self.slope(place, found);
        Ok(places
            .iter()
            .zip(filtered.chunks_exact(each))
            .map(of_place)
            .collect())
    }

    /// Fisher's scoring: of predictions and of the logarithms of their variances.
    fn slope(&self, place: &Place, found: &[Filtered]) -> Slope {
        let count = self.coordinates.len();
        let all = count + self.sizes.len();
        let (here, rest) = (&found[0], &found[1..=all]);
        let of_states = &found[1 + all..];
        let mut curvature = DMatrix::zeros(all, all);
        let mut uphill = DVector::zeros(all);
        let (mut of_mean, mut of_spread) = (vec![0.0; all], vec![0.0; all]);
        let no_start = Start {
            curvature: Matrix4::zeros(),
            cross: DMatrix::zeros(all, 4),
            uphill: SVector::zeros(),
        };
        let mut starts = vec![no_start; place.states.len()];
        let mut log_likelihood = 0.0;
        self.each_innovation(here, |window, i, axis, off, variance| {
            log_likelihood += log_density(off, variance);
            let predicted = here.predicted[window][i][axis];
            for (a, moved) in rest.iter().enumerate() {
                let step = if a < count { STEP } else { SIZE_STEP };
                of_mean[a] = (moved.predicted[window][i][axis] - predicted) / step;
                of_spread[a] = (moved.variance[window][i][axis] / variance).ln() / step;
            }
            // The derivatives of Student's t: over the innovation, and over the logarithm of the variance.
            let weight = (TAIL + 1.0) / (TAIL * variance + off * off);
            let wider = 0.5 * (weight * off * off - 1.0);
            for a in 0..all {
                uphill[a] += weight * off * of_mean[a] + wider * of_spread[a];
                for b in 0..=a {
                    curvature[(a, b)] +=
                        weight * of_mean[a] * of_mean[b] + SPREAD * of_spread[a] * of_spread[b];
                }
            }
            let start = &mut starts[window];
            let of_state = SVector::<f64, 4>::from_fn(|c, _| {
                (of_states[c].predicted[window][i][axis] - predicted) / STATE_STEP
            });
            start.uphill += weight * off * of_state;
            start.curvature += weight * of_state * of_state.transpose();
            for (a, of_mean) in of_mean.iter().enumerate() {
                for c in 0..4 {
                    start.cross[(a, c)] += weight * of_mean * of_state[c];
                }
            }
        });
        for (start, (state, guess)) in starts
            .iter_mut()
            .zip(place.states.iter().zip(&self.guesses))
        {
            for (c, size) in STATES.iter().enumerate() {
                start.curvature[(c, c)] += size.powi(-2);
                start.uphill[c] -= (state[c] - middle(guess)[c]) * size.powi(-2);
            }
        }
        for a in 0..all {
            for b in 0..a {
                curvature[(b, a)] = curvature[(a, b)];
            }
        }
        for (a, (mean, deviation)) in self.prior.of(&place.spreads).iter().enumerate() {
            curvature[(a, a)] += deviation.powi(-2);
            uphill[a] -= (place.z[a] - mean) * deviation.powi(-2);
        }
        for a in count..all {
            curvature[(a, a)] += KNOWN;
        }
        Slope {
            log_likelihood,
            curvature,
            uphill,
            starts,
        }
    }

    fn scoring(&self, slope: &Slope, damping: f64) -> Step {
        let (curvature, uphill, inverses) = slope.without_starts(damping);
        let step = curvature.cholesky().map(|one| one.solve(&uphill));
        let mut step = step.unwrap_or_else(|| DVector::zeros(uphill.len()));
        for (i, step) in step.iter_mut().enumerate() {
            let farthest = if i < self.coordinates.len() {
                FARTHEST
            } else {
                FARTHEST_SIZE
            };
            *step = step.clamp(-farthest, farthest);
        }
        let of_start = |(start, inverse): (&Start, &Matrix4<f64>)| {
            let rest = start.cross.transpose() * &step;
            let own =
                inverse * (start.uphill - SVector::<f64, 4>::from_column_slice(rest.as_slice()));
            std::array::from_fn(|c| own[c].clamp(-FARTHEST * STATES[c], FARTHEST * STATES[c]))
        };
        let states = slope.starts.iter().zip(&inverses).map(of_start).collect();
        Step {
            common: step.as_slice().to_vec(),
            states,
        }
    }

    fn top(
        &self,
        place: &Place,
        slope: &Slope,
        of_stretches: impl Fn(&[State]) -> Vec<Option<[f64; 4]>>,
    ) -> Probable {
        let count = self.coordinates.len();
        let (curvature, _, _) = slope.without_starts(0.0);
        let of_values = curvature.view((0, 0), (count, count)).into_owned();
        let factor = of_values.cholesky();
        let log_volume: f64 = factor.as_ref().map_or(f64::NAN, |one| {
            one.l_dirty().diagonal().iter().map(|one| one.ln()).sum()
        });
        let of_states: f64 = slope
            .starts
            .iter()
            .map(|start| 0.5 * start.curvature.determinant().ln())
            .sum();
        let prior = self.prior.of(&place.spreads);
        let log_width: f64 = prior.iter().map(|(_, deviation)| deviation.ln()).sum();
        let rows = self.coordinates.derivative(&place.z);
        let by_z = DMatrix::from_fn(count, count, |i, j| rows[i][j]);
        let covariance = curvature.cholesky().map_or_else(
            || DMatrix::from_element(count, count, f64::NAN),
            |one| &by_z * one.inverse().view((0, 0), (count, count)) * by_z.transpose(),
        );
        Probable {
            values: self
                .coordinates
                .own(&self.coordinates.to_values(&place.z))
                .to_vec(),
            states: of_stretches(&place.states),
            noise: place.noise,
            log_likelihood: slope.log_likelihood,
            log_evidence: slope.log_likelihood + self.log_prior(place)
                - log_volume
                - of_states
                - log_width,
            slots: self.coordinates.slots(),
            covariance,
        }
    }

    /// Log prior up to the terms of its widths alone.
    fn log_prior(&self, place: &Place) -> f64 {
        let square = |(z, (mean, deviation)): (&f64, &(f64, f64))| ((z - mean) / deviation).powi(2);
        let of_values: f64 = place
            .z
            .iter()
            .zip(&self.prior.of(&place.spreads))
            .map(square)
            .sum();
        let pairs = place.states.iter().zip(&self.guesses);
        let of_states: f64 = pairs
            .map(|(state, guess)| {
                let off = |c: usize| (state[c] - middle(guess)[c]) / STATES[c];
                (0..4).map(|c| off(c).powi(2)).sum::<f64>()
            })
            .sum();
        -0.5 * (of_values + of_states)
    }

    fn at(&self, place: &Place) -> (Trial, Noise) {
        (
            self.shooting.trial(&place.z, &place.states, None),
            place.noise,
        )
    }

    fn filtered(&self, trials: &[(Trial, Noise)]) -> Result<Vec<Filtered>> {
        let noise: Vec<Noise> = trials.iter().map(|(_, noise)| *noise).collect();
        let trials: Vec<&Trial> = trials.iter().map(|(trial, _)| trial).collect();
        self.shooting.filter(&trials, &noise)
    }

    fn log_likelihood(&self, found: &Filtered) -> f64 {
        let mut sum = 0.0;
        self.each_innovation(found, |_, _, _, off, variance| {
            sum += log_density(off, variance);
        });
        sum
    }

    /// Calls with window, row, axis, innovation and variance of each observation, along axes that change.
    fn each_innovation(&self, found: &Filtered, mut of: impl FnMut(usize, usize, usize, f64, f64)) {
        let active = &self.shooting.windows.channels.active[MARBLE];
        for (number, window) in self.shooting.windows.all.iter().enumerate() {
            let known = &self.shooting.windows.known[window.marble()];
            let observed = &self.shooting.windows.observed[window.marble()];
            for (row, (mean, variance)) in found.predicted[number]
                .iter()
                .zip(&found.variance[number])
                .enumerate()
            {
                for axis in (0..2).filter(|&axis| active[axis]) {
                    if known[2 * row + axis] && variance[axis].is_finite() {
                        of(
                            number,
                            row,
                            axis,
                            observed[2 * row + axis] - mean[axis],
                            variance[axis],
                        );
                    }
                }
            }
        }
    }
}

/// Prior mean of a start state: the observed position, at rest.
fn middle(guess: &State) -> State {
    [guess[0], guess[1], 0.0, 0.0]
}
