//! Least squares over rollouts: estimates the parameters, the five and those of effects, from recordings.
//!
//! Bounded, robust (Student-t) Levenberg-Marquardt from many start points at once, over windows of
//! growing length whose start states are eliminated. All columns of all Jacobians of all candidates are
//! simulated in one batch.

mod ascent;
mod axis;
mod channels;
mod coordinates;
mod cross_validation;
mod derivatives;
mod descent;
mod filtered;
mod grey_box;
mod hill;
mod information;
mod normal;
mod polish;
mod prior;
mod problem;
mod random_sizes;
mod refine;
mod robust;
mod scoring;
mod search;
mod settings;
mod shooting;
mod shrinkage;
mod slopes;
mod stages;
mod starts;
mod trial;
mod windows;

use std::sync::atomic::AtomicBool;

pub use self::ascent::Probable;
pub use self::filtered::Filtered;
pub use self::information::Information;
pub use self::problem::{Hypothesis, ParameterSpec, Problem, Recording, Stretch};
pub use self::refine::Refined;
pub use self::robust::tracker_noise;
pub use self::settings::{Progress, Settings};
pub use self::shrinkage::Shrunk;

use self::channels::{MARBLE, TILT};
use self::coordinates::Coordinates;
use self::descent::{End, Pace, minimise};
use self::search::Search;
use self::shooting::{Point, Shooting};
use self::slopes::Look;
use self::windows::Windows;
use crate::error::{Error, Result};

/// Gauss-Newton steps for the start states, where the caller does not know them.
const STATE_ITERATIONS: usize = 8;

/// Result of a start point; values are those of all parameters, the five and then the effects'.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Its end point.
    pub values: Vec<f64>,
    /// Start states there, as those of a [`Solution`].
    pub states: Vec<Option<[f64; 4]>>,
    /// Values after each iteration, the start point first; after them the leans of all recordings if estimated.
    pub path: Vec<Vec<f64>>,
}

/// The outcome of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The five parameters, then those of the effects in order of naming.
    pub values: Vec<f64>,
    /// Start state of each stretch: position (board edges) and rate (board edges per row); none if the tracker
    /// has too few rows.
    pub states: Vec<Option<[f64; 4]>>,
    /// Predicted minus observed for each row of each stretch (board edges); NaN without an observation.
    pub residuals: Vec<Vec<[f64; 2]>>,
    /// Standard deviation of the tracker (board edges), given or estimated from the recordings alone; NaN
    /// without a marble.
    pub tracker_noise: f64,
    /// Robust standard deviation of the residuals (board edges), corrected for the fitted values; NaN without a
    /// marble.
    pub noise: f64,
    /// The same along x and along y; NaN along an axis that never changes.
    pub axis_noise: [f64; 2],
    /// Residuals of the tilt, if a recording has any.
    pub tilt: Option<TiltLeft>,
    /// Negative log-likelihood of the residuals up to a constant, at a scale of `tracker_noise`, those of the
    /// tilt at the scale of its sensor.
    pub loss: f64,
    /// Information of the recordings about the values.
    pub information: Information,
    /// Sizes and coefficients of the leans of runs and of the maps of slopes.
    pub shrunk: Vec<Shrunk>,
    /// Results of all start points, the best first.
    pub estimates: Vec<Estimate>,
    /// Number of simulated windows, for all start points together.
    pub rollouts: usize,
}

/// Residuals of the tilt, about x and about y; NaN about an axis that never changes.
#[derive(Debug, Clone, PartialEq)]
pub struct TiltLeft {
    /// Predicted minus measured for each row of each stretch (rad); NaN without a measurement.
    pub residuals: Vec<Vec<[f64; 2]>>,
    /// Standard deviation of the sensor (rad), given or estimated from its changes.
    pub noise: [f64; 2],
    /// Robust standard deviation of the residuals (rad), corrected for the fitted values.
    pub scale: [f64; 2],
}

impl Problem<'_> {
    /// Fits the free parameters to the recordings.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a problem that cannot be fitted, [`Error::Cancelled`] once `cancel` is set.
    pub fn fit(
        &self,
        settings: &Settings,
        progress: Progress<'_>,
        cancel: &AtomicBool,
    ) -> Result<Solution> {
        self.fit_from(&[], settings, progress, cancel)
    }

    /// Fits the free parameters from given start points, each with values of all parameters; the gears of all
    /// must have the signs of the first ones. Without start points, the best ones of a draw are used.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn fit_from(
        &self,
        points: &[Vec<f64>],
        settings: &Settings,
        progress: Progress<'_>,
        cancel: &AtomicBool,
    ) -> Result<Solution> {
        self.check()?;
        for values in points {
            self.check_values(values)?;
        }
        if settings.starts == 0 {
            return Err(Error::invalid("starts", "at least 1", 0));
        }
        let mut search = Search::new(self, progress, cancel)?;
        let (coordinates, candidates) = search.run(points, settings)?;
        let best = &candidates[0];
        let shooting = Shooting::new(self, &coordinates, &search.whole, 1.0, cancel);
        let count = search.whole.count() as f64;
        let unknowns = (coordinates.len() + search.whole.unknowns()) as f64;
        let freed = (count / (count - unknowns).max(1.0)).sqrt();
        let common = robust::scale(&best.residual, &search.whole.known) * freed;
        let information = information::inform(&shooting, &best.point, common)?;
        let channels = search.whole.channels;
        let scale = |channels_of| search.whole.scale(&best.residual, channels_of) * freed;
        let noise_of = |channel: usize| {
            let noise = channels.noise[channel];
            if channels.active[channel] {
                noise
            } else {
                f64::NAN
            }
        };
        let has_tilt = channels.has_tilt();
        let evidence = search.evidence(&coordinates, &best.point)?;
        let shrunk = evidence.iter().enumerate();
        let shrunk = shrunk.map(|(group, one)| one.report(&coordinates, group, &best.point.z));
        let estimate = |one: &End| Estimate {
            values: coordinates
                .own(&coordinates.to_values(&one.point.z))
                .to_vec(),
            states: self.of_stretches(&search.whole, |i| one.point.states[i]),
            path: one.path.iter().map(|z| coordinates.to_values(z)).collect(),
        };
        Ok(Solution {
            values: coordinates
                .own(&coordinates.to_values(&best.point.z))
                .to_vec(),
            states: self.of_stretches(&search.whole, |i| best.point.states[i]),
            residuals: self.residuals(&search.whole, &best.residual),
            tracker_noise: if channels.has_marble() {
                self.tracker_noise()
            } else {
                f64::NAN
            },
            noise: scale(MARBLE),
            axis_noise: [scale(0..1), scale(1..2)],
            tilt: has_tilt.then(|| TiltLeft {
                residuals: self.tilt_residuals(&search.whole, &best.residual),
                noise: [noise_of(2), noise_of(3)],
                scale: [scale(2..3), scale(3..4)],
            }),
            loss: search.whole.loss(&best.residual),
            information,
            shrunk: shrunk.collect(),
            estimates: candidates.iter().map(estimate).collect(),
            rollouts: search.rollouts() + shooting.rollouts(),
        })
    }

    /// Information of the recordings about the free parameters around any values. Start states are estimated
    /// if they are not given. Residuals count with their own scale if `noise` is smaller.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn inform(
        &self,
        values: &[f64],
        states: Option<&[Option<[f64; 4]>]>,
        noise: f64,
        cancel: &AtomicBool,
    ) -> Result<Information> {
        self.check()?;
        let (mut coordinates, mut whole) = self.around(values, cancel)?;
        let least = |whole: &Windows| {
            if whole.channels.has_tilt() {
                noise.max(whole.channels.floor)
            } else {
                noise
            }
        };
        let z = coordinates.to_z(values);
        let guess = Point {
            z,
            states: whole.guesses(),
        };
        let point = if let Some(states) = states {
            Point {
                states: self.of_windows(&whole, states),
                ..guess
            }
        } else {
            let pace = Pace {
                iterations: STATE_ITERATIONS,
                look: Look::Both,
                variants: 4,
                held: true,
            };
            let shooting = Shooting::new(self, &coordinates, &whole, 1.0, cancel);
            minimise(&shooting, &[guess], least(&whole), pace, &|_| ())?
                .remove(0)
                .point
        };
        if whole.channels.has_tilt() {
            let shooting = Shooting::new(self, &coordinates, &whole, 1.0, cancel);
            let residual = shooting.residuals(std::slice::from_ref(&point))?.remove(0);
            whole.channels = whole.reweighted(&residual);
        }
        let shooting = Shooting::new(self, &coordinates, &whole, 1.0, cancel);
        let found = shrinkage::evidence(&shooting, &point, least(&whole))?;
        for (group, found) in found.iter().enumerate() {
            coordinates.resize(group, found.size(), found.repetition);
        }
        let shooting = Shooting::new(self, &coordinates, &whole, 1.0, cancel);
        information::inform(&shooting, &point, least(&whole))
    }

    /// Mean absolute error at each of some values, from given start states: of the marble (board edges), or of
    /// the tilt (rad) without a marble.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn errors(
        &self,
        values: &[Vec<f64>],
        states: &[Option<[f64; 4]>],
        cancel: &AtomicBool,
    ) -> Result<Vec<f64>> {
        self.check()?;
        let Some(first) = values.first() else {
            return Ok(Vec::new());
        };
        let (coordinates, whole) = self.around(first, cancel)?;
        let shooting = Shooting::new(self, &coordinates, &whole, 1.0, cancel);
        let point = |values: &Vec<f64>| Point {
            z: coordinates.to_z(values),
            states: self.of_windows(&whole, states),
        };
        let points: Vec<Point> = values.iter().map(point).collect();
        let channels = &whole.channels;
        let own = if channels.has_marble() { MARBLE } else { TILT };
        let places: Vec<(usize, usize)> = whole.channels_of(own).collect();
        let mean = |residual: &Vec<f64>| {
            let error =
                |&(channel, i): &(usize, usize)| (residual[i] / channels.weights[channel]).abs();
            places.iter().map(error).sum::<f64>() / places.len() as f64
        };
        Ok(shooting.residuals(&points)?.iter().map(mean).collect())
    }

    /// Coordinates around values, and all stretches uncut.
    fn around(&self, values: &[f64], cancel: &AtomicBool) -> Result<(Coordinates, Windows)> {
        self.check_values(values)?;
        let sense = |slot: usize| match self.parameters[slot] {
            ParameterSpec::Free {
                range: (_, high), ..
            } if values[slot] == 0.0 && high <= 0.0 => -1.0,
            _ if values[slot] < 0.0 => -1.0,
            _ => 1.0,
        };
        let mut coordinates = Coordinates::new(self, [sense(0), sense(1)])?;
        coordinates.take_sizes(values);
        let search = Search::new(self, &|_, _, _| (), cancel)?;
        Ok((coordinates, search.whole))
    }

    fn check_values(&self, values: &[f64]) -> Result<()> {
        let count = self.sought().count();
        // Behind them there may be the leans of all recordings.
        let leans = self.lean().map_or(0, |_| 2 * self.recordings.len());
        if (values.len() == count || values.len() == count + leans)
            && !values.iter().any(|value| value.is_nan())
        {
            return Ok(());
        }
        let expected = format!("{count} numbers");
        Err(Error::invalid("values", &expected, values.len()))
    }

    fn of_stretches<T>(&self, windows: &Windows, of: impl Fn(usize) -> T) -> Vec<Option<T>> {
        let find = |stretch: &Stretch| {
            let origin = (stretch.recording, stretch.first);
            windows
                .all
                .iter()
                .position(|window| (window.recording, window.first) == origin)
        };
        self.stretches
            .iter()
            .map(|stretch| find(stretch).map(&of))
            .collect()
    }

    fn of_windows(&self, windows: &Windows, states: &[Option<[f64; 4]>]) -> Vec<[f64; 4]> {
        let mut found = windows.guesses();
        for (i, state) in self.of_stretches(windows, |i| i).into_iter().zip(states) {
            if let (Some(i), Some(state)) = (i, state) {
                found[i] = *state;
            }
        }
        found
    }

    /// Residuals of the marble (board edges) in each stretch.
    fn residuals(&self, windows: &Windows, residual: &[f64]) -> Vec<Vec<[f64; 2]>> {
        self.residuals_of(windows, residual, MARBLE)
    }

    /// Residuals of the tilt (rad) in each stretch; empty if no recording has any.
    fn tilt_residuals(&self, windows: &Windows, residual: &[f64]) -> Vec<Vec<[f64; 2]>> {
        if !windows.channels.has_tilt() {
            return Vec::new();
        }
        self.residuals_of(windows, residual, TILT)
    }

    fn residuals_of(
        &self,
        windows: &Windows,
        residual: &[f64],
        channels: std::ops::Range<usize>,
    ) -> Vec<Vec<[f64; 2]>> {
        let weights = &windows.channels.weights[channels.clone()];
        let of_window = |i: usize| {
            let window = &windows.all[i];
            let own = if channels == MARBLE {
                window.marble()
            } else {
                window.tilt()
            };
            let seen = |i: usize| {
                if windows.known[i] {
                    residual[i] / weights[i % 2]
                } else {
                    f64::NAN
                }
            };
            own.step_by(2).map(|i| [seen(i), seen(i + 1)]).collect()
        };
        let found = self
            .of_stretches(windows, of_window)
            .into_iter()
            .zip(self.stretches);
        found
            .map(|(found, stretch)| found.unwrap_or_else(|| vec![[f64::NAN; 2]; stretch.rows]))
            .collect()
    }
}
