//! The log-posterior of a grey-box model ([`super::grey_box`]), its ascents and their tops.

use nalgebra::{DMatrix, DVector, Matrix4, SVector};

use super::ascent::{Ascent, DAMPING, Look, Place, Probable};
use super::coordinates::Coordinates;
use super::derivatives::{
    Derivatives, Innovation, append_innovations, log_likelihood, with_share_of_tilt,
};
use super::prior::Prior;
use super::random_sizes::{SIZES, of_sizes, sizes, with_sizes};
use super::scoring::{Slope, Start, Step};
use super::shooting::Shooting;
use super::trial::Trial;
use super::windows::State;
use crate::error::Result;
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
/// An ascent ends where a step gains less [nats]: the posterior is rough to about this where a marble may stick, or
/// touch a wall, in one row or the next.
const LITTLE: f64 = 0.1;
/// The same without a fold: the spread between folds is that of small steps.
const LITTLE_OF_FOLDS: f64 = 0.02;
/// Dampings tried in each step, in units of the last one that helped, with shares of the step in values and states,
/// and of that in sizes.
const TRIED: [(f64, f64, f64); 5] = [
    (0.1, 1.0, 1.0),
    (10.0, 1.0, 1.0),
    (1000.0, 1.0, 1.0),
    (0.1, 1.0, 0.0),
    (0.1, 0.0, 1.0),
];
/// Factor of the dampings after a step in which none has helped: the next ones begin where these end.
const RAISED: f64 = 1e4;
/// Derivatives are carried along a step that gains at least this share of what they promise.
const FOLLOWED: f64 = 0.5;
/// Prior of the logarithm of a size: a standard deviation of ten, which keeps sizes without influence in place.
const KNOWN: f64 = 0.01;

/// The log-posterior.
pub(super) struct Hill<'a> {
    shooting: &'a Shooting<'a>,
    coordinates: &'a Coordinates,
    guesses: Vec<State>,
    prior: Prior,
    /// The estimated sizes: those that are not zero everywhere.
    sizes: Vec<usize>,
    /// The fold of each window, if it has one; empty if none is left out.
    folds: Vec<Option<usize>>,
    /// Coordinates that change the tilt in steps of rows only, and steps of a row.
    of_rows: Vec<(usize, f64)>,
    /// Gain of a step at which an ascent ends [nats].
    little: f64,
}

impl<'a> Hill<'a> {
    /// The log-posterior over values, start states, and those sizes that are not zero everywhere.
    pub(super) fn new(
        shooting: &'a Shooting<'a>,
        coordinates: &'a Coordinates,
        noise: &[Noise],
    ) -> Self {
        let is_sought = |i: usize| noise.iter().any(|noise| sizes(noise)[i] > 0.0);
        Self {
            shooting,
            coordinates,
            guesses: shooting.windows.guesses(),
            prior: Prior::new(coordinates),
            sizes: (0..SIZES).filter(|&i| is_sought(i)).collect(),
            folds: Vec::new(),
            of_rows: shooting.row_steps(),
            little: LITTLE,
        }
    }

    /// The place of values, start states and sizes.
    pub(super) fn place(&self, values: &[f64], states: Vec<State>, noise: &Noise) -> Place {
        Place {
            z: self.coordinates.clip(&self.coordinates.to_z(values)),
            states,
            noise: Noise {
                start_velocity: None,
                ..*noise
            },
            spreads: self.prior.widest(),
            left_out: None,
        }
    }

    /// Ascends from a place once for each fold, without the observations of its windows; start states by stretches.
    ///
    /// All folds begin with the derivatives at the place, and the evidence has their curvatures: the tops are close
    /// to that of all observations.
    pub(super) fn leave_out(
        mut self,
        place: &Place,
        folds: &[usize],
        of_windows: Vec<Option<usize>>,
        iterations: usize,
        of_stretches: impl Fn(&[State]) -> Vec<Option<[f64; 4]>>,
    ) -> Result<Vec<Probable>> {
        self.folds = of_windows;
        self.little = LITTLE_OF_FOLDS;
        let all = self.derivatives(&[place])?.remove(0);
        let begin = |&fold: &usize| Ascent {
            place: Place {
                left_out: Some(fold),
                ..place.clone()
            },
            derivatives: all.only(|window| self.folds[window] != Some(fold)),
            look: Look::Taken,
            damping: DAMPING,
            gain: f64::INFINITY,
        };
        let mut ascents: Vec<Ascent> = folds.iter().map(begin).collect();
        let slopes: Vec<Slope> = ascents
            .iter()
            .map(|one| self.slope(&one.place, &one.derivatives))
            .collect();
        for _ in 0..iterations {
            if !self.step(&mut ascents)? {
                break;
            }
        }
        let ends: Vec<_> = ascents.iter().map(|one| self.at(&one.place)).collect();
        let found = self.innovations(&ends, ascents.iter().map(|one| one.place.left_out))?;
        let top = |(one, (slope, found)): (&Ascent, (Slope, Vec<Innovation>))| {
            let slope = Slope {
                log_likelihood: log_likelihood(&found),
                ..slope
            };
            self.top(&one.place, &slope, of_stretches(&one.place.states))
        };
        let ends = slopes.into_iter().zip(found);
        Ok(ascents.iter().zip(ends).map(top).collect())
    }

    /// One step of each ascent that still gains: the best of several dampings, with and without new sizes. Returns
    /// whether there is any.
    pub(super) fn step(&self, ascents: &mut [Ascent]) -> Result<bool> {
        let mut ascents: Vec<&mut Ascent> = ascents
            .iter_mut()
            .filter(|one| one.gain > self.little)
            .collect();
        if ascents.is_empty() {
            return Ok(false);
        }
        self.look(ascents.iter_mut().map(|one| &mut **one))?;
        let mut slopes = Vec::with_capacity(ascents.len());
        let mut settled = Vec::with_capacity(ascents.len());
        for ascent in &mut ascents {
            let mut slope = self.slope(&ascent.place, &ascent.derivatives);
            let place = &mut ascent.place;
            settled.push(
                self.prior
                    .respread(&place.z, &mut place.spreads, &mut slope),
            );
            slopes.push(slope);
        }
        let mut tried = Vec::new();
        for (ascent, slope) in ascents.iter().zip(&slopes) {
            for (factor, of_values, of_sizes) in TRIED {
                let step = self.scoring(slope, ascent.damping * factor);
                tried.push(self.moved(&ascent.place, &step, of_values, of_sizes));
            }
        }
        let trials: Vec<_> = tried.iter().map(|place| self.at(place)).collect();
        let left_out = tried.iter().map(|place| place.left_out);
        let mut found = self.innovations(&trials, left_out)?;
        let posterior: Vec<f64> = tried
            .iter()
            .zip(&found)
            .map(|(place, found)| log_likelihood(found) + self.log_prior(place))
            // What is no number would count as the highest.
            .map(|one| if one.is_nan() { f64::NEG_INFINITY } else { one })
            .collect();
        for (number, (ascent, slope)) in ascents.iter_mut().zip(slopes).enumerate() {
            let own = number * TRIED.len()..(number + 1) * TRIED.len();
            let best = own.max_by(|&a, &b| posterior[a].total_cmp(&posterior[b]));
            let Some(best) = best else { continue };
            let gain = posterior[best] - slope.log_likelihood - self.log_prior(&ascent.place);
            if gain > self.little {
                let step = self.between(&ascent.place, &tried[best]);
                ascent.look = Look::Needed;
                if gain > FOLLOWED * slope.gain(&step) {
                    ascent.look = Look::Carried;
                    let there = std::mem::take(&mut found[best]);
                    ascent.derivatives.follow(there, &step, &slope);
                }
                ascent.place = tried[best].clone();
                ascent.damping = (0.2 * ascent.damping).max(1e-8);
                ascent.gain = gain;
            } else if ascent.look == Look::Carried {
                ascent.look = Look::Needed;
            } else {
                let ends = gain > 0.0 || ascent.damping > 0.1;
                ascent.damping *= RAISED;
                ascent.gain = if ends { 0.0 } else { f64::INFINITY };
            }
            if !settled[number] {
                ascent.gain = f64::INFINITY;
            }
        }
        Ok(true)
    }

    /// The tops that ascents have reached; start states by stretches.
    pub(super) fn tops(
        &self,
        ascents: &mut [Ascent],
        of_stretches: impl Fn(&[State]) -> Vec<Option<[f64; 4]>>,
    ) -> Result<Vec<Probable>> {
        for ascent in ascents.iter_mut() {
            if ascent.look == Look::Carried {
                ascent.look = Look::Needed;
            }
        }
        self.look(ascents.iter_mut())?;
        let top = |one: &Ascent| {
            let slope = self.slope(&one.place, &one.derivatives);
            self.top(&one.place, &slope, of_stretches(&one.place.states))
        };
        Ok(ascents.iter().map(top).collect())
    }

    /// Takes new derivatives where they are needed.
    fn look<'b>(&self, ascents: impl Iterator<Item = &'b mut Ascent>) -> Result<()> {
        let mut needed: Vec<&mut Ascent> = ascents.filter(|one| one.look == Look::Needed).collect();
        let places: Vec<&Place> = needed.iter().map(|one| &one.place).collect();
        let derivatives = self.derivatives(&places)?;
        for (ascent, derivatives) in needed.iter_mut().zip(derivatives) {
            ascent.derivatives = derivatives;
            ascent.look = Look::Taken;
        }
        Ok(())
    }

    /// The place after a share of a step in values and states, and another of that in sizes.
    fn moved(&self, here: &Place, step: &Step, of_values: f64, of_sizes: f64) -> Place {
        let count = self.coordinates.len();
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
        Place {
            z: self.coordinates.clip(&moved),
            states,
            noise: with_sizes(&here.noise, sizes),
            spreads: here.spreads.clone(),
            left_out: here.left_out,
        }
    }

    /// The step between two places.
    fn between(&self, from: &Place, to: &Place) -> Step {
        let of_values = to.z.iter().zip(&from.z).map(|(to, from)| to - from);
        let (after, before) = (sizes(&to.noise), sizes(&from.noise));
        let of_sizes = self.sizes.iter().map(|&i| (after[i] / before[i]).ln());
        let of_states = to.states.iter().zip(&from.states);
        Step {
            common: of_values.chain(of_sizes).collect(),
            states: of_states
                .map(|(to, from)| std::array::from_fn(|c| to[c] - from[c]))
                .collect(),
        }
    }

    /// Derivatives of the innovations at each place, by finite differences.
    fn derivatives(&self, places: &[&Place]) -> Result<Vec<Derivatives>> {
        let count = self.coordinates.len();
        let mut trials = Vec::new();
        let mut left_out = Vec::new();
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
            for &(i, step) in &self.of_rows {
                let mut z = place.z.clone();
                z[i] += step;
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
            left_out.resize(trials.len(), place.left_out);
        }
        let mut found = self.innovations(&trials, left_out.into_iter())?.into_iter();
        let mut next = || found.next().unwrap_or_default();
        let mut of_place = || {
            let here = next();
            let mut values = (0..count).map(|_| (next(), STEP)).collect::<Vec<_>>();
            for &(i, step) in &self.of_rows {
                let (moved, farther) = (&values[i].0, next());
                values[i].0 = with_share_of_tilt(&here, moved, &farther, STEP / step);
            }
            let sizes = self.sizes.iter().map(|_| (next(), SIZE_STEP));
            let common: Vec<_> = values.into_iter().chain(sizes).collect();
            let states = std::array::from_fn(|_| (next(), STATE_STEP));
            Derivatives::of(here, &common, &states)
        };
        Ok(places.iter().map(|_| of_place()).collect())
    }

    /// Slope and curvature of the log-posterior at a place.
    fn slope(&self, place: &Place, derivatives: &Derivatives) -> Slope {
        let mut slope = derivatives.slope(place.states.len());
        let pairs = place.states.iter().zip(&self.guesses);
        for (start, (state, guess)) in slope.starts.iter_mut().zip(pairs) {
            for (c, size) in STATES.iter().enumerate() {
                start.curvature[(c, c)] += size.powi(-2);
                start.uphill[c] -= (state[c] - middle(guess)[c]) * size.powi(-2);
            }
        }
        let prior = self.prior.of(&place.spreads);
        for (a, (mean, deviation)) in prior.iter().enumerate() {
            slope.curvature[(a, a)] += deviation.powi(-2);
            slope.uphill[a] -= (place.z[a] - mean) * deviation.powi(-2);
        }
        for a in prior.len()..slope.uphill.len() {
            slope.curvature[(a, a)] += KNOWN;
        }
        slope
    }

    fn scoring(&self, slope: &Slope, damping: f64) -> Step {
        let (curvature, uphill, inverses) = slope.without_starts(damping);
        let step = curvature.cholesky().map(|one| one.solve(&uphill));
        // Derivatives beyond all numbers lead nowhere.
        let step = step.filter(|step| step.iter().all(|one| one.is_finite()));
        let step = step.unwrap_or_else(|| DVector::zeros(uphill.len()));
        self.with_states(slope, step, &inverses)
    }

    /// A step in values and sizes, and the best in the start states beside it, each at most the longest that is made.
    fn with_states(
        &self,
        slope: &Slope,
        mut step: DVector<f64>,
        inverses: &[Matrix4<f64>],
    ) -> Step {
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
            std::array::from_fn(|c| {
                match own[c].clamp(-FARTHEST * STATES[c], FARTHEST * STATES[c]) {
                    step if step.is_nan() => 0.0,
                    step => step,
                }
            })
        };
        let states = slope.starts.iter().zip(inverses).map(of_start).collect();
        Step {
            common: step.as_slice().to_vec(),
            states,
        }
    }

    fn top(&self, place: &Place, slope: &Slope, states: Vec<Option<[f64; 4]>>) -> Probable {
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
            states,
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

    /// Innovations of each observation, without those of a fold.
    fn innovations(
        &self,
        trials: &[(Trial, Noise)],
        left_out: impl Iterator<Item = Option<usize>>,
    ) -> Result<Vec<Vec<Innovation>>> {
        let noise: Vec<Noise> = trials.iter().map(|(_, noise)| *noise).collect();
        let left_out: Vec<Option<usize>> = left_out.collect();
        let trials: Vec<&Trial> = trials.iter().map(|(trial, _)| trial).collect();
        let windows = self.shooting.windows;
        let most = windows.known.iter().filter(|known| **known).count();
        let mut innovations: Vec<Vec<Innovation>> =
            trials.iter().map(|_| Vec::with_capacity(most)).collect();
        self.shooting
            .predict(&trials, &noise, |[trial, window], rows| {
                if left_out[trial].is_none_or(|fold| self.folds[window] != Some(fold)) {
                    append_innovations(&mut innovations[trial], windows, window, rows);
                }
            })?;
        Ok(innovations)
    }
}

/// Prior mean of a start state: the observed position, at rest.
fn middle(guess: &State) -> State {
    [guess[0], guess[1], 0.0, 0.0]
}
