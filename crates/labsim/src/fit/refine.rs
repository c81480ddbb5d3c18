//! Fits without a search: local refinement of values that are nearly right, and residuals of given values.

use std::sync::atomic::AtomicBool;

use super::channels::Channels;
use super::coordinates::Coordinates;
use super::descent::{End, Pace, loss, minimise};
use super::filtered::Filtered;
use super::problem::Problem;
use super::robust;
use super::shooting::{Point, Shooting};
use super::shrinkage::evidence;
use super::slopes::Look;
use super::windows::{State, Window, Windows};
use crate::error::Result;
use crate::filter::Smoothed;
use crate::noise::Noise;

/// Number of start states that are tried with each step.
const VARIANTS: usize = 4;
/// Numbers of first rows from which start states are estimated before whole stretches, and steps for each.
const HEADS: [usize; 2] = [12, 36];
const HEAD_ITERATIONS: usize = 4;
/// Steps of start states alone over whole stretches, for descents that begin with those.
const HELD_ITERATIONS: usize = 6;

/// Result of a refinement.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// The five parameters, then those of the effects.
    pub values: Vec<f64>,
    /// Start states, as those of a [`super::Solution`].
    pub states: Vec<Option<[f64; 4]>>,
    /// Predicted minus observed for each row of each stretch (board edges); NaN without an observation.
    pub residuals: Vec<Vec<[f64; 2]>>,
    /// The same for the tilt (rad); empty if no recording has any.
    pub tilt_residuals: Vec<Vec<[f64; 2]>>,
}

impl Problem<'_> {
    /// Refines values over whole stretches, all of them in lockstep; with `held`, only start states are
    /// estimated.
    ///
    /// The gears of all values must have the signs of the first ones.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn refine(
        &self,
        values: &[Vec<f64>],
        iterations: usize,
        held: bool,
        cancel: &AtomicBool,
    ) -> Result<Vec<Refined>> {
        self.check()?;
        let Some(first) = values.first() else {
            return Ok(Vec::new());
        };
        let (mut coordinates, mut whole) = self.around(first, cancel)?;
        let mut begun = Vec::with_capacity(values.len());
        for values in values {
            self.check_values(values)?;
            begun.push(coordinates.to_z(values));
        }
        let mut starts = self.begun(&coordinates, &whole, begun, cancel)?;
        if whole.channels.has_tilt() {
            whole.channels = self.weighted(&coordinates, &whole, &starts, cancel)?;
        }
        let minimised = |coordinates: &Coordinates, starts: &[Point], iterations, held| {
            let shooting = Shooting::new(self, coordinates, &whole, 1.0, cancel);
            let pace = Pace {
                iterations,
                look: Look::Both,
                variants: VARIANTS,
                held,
            };
            minimise(&shooting, starts, whole.channels.floor, pace, &|_| ())
        };
        if !held {
            // Wrong start states mislead the parameters, and fitted ones may hold them at the start point: the
            // better of two descents is used.
            let settled = minimised(&coordinates, &starts, HELD_ITERATIONS, true)?;
            starts.extend(settled.into_iter().map(|end| end.point));
        }
        let mut ends = minimised(&coordinates, &starts, iterations, held)?;
        let shooting = Shooting::new(self, &coordinates, &whole, 1.0, cancel);
        for (i, other) in ends.split_off(values.len()).into_iter().enumerate() {
            if is_better(&shooting, &other, &ends[i]) {
                ends[i] = other;
            }
        }
        if !held && !coordinates.groups().is_empty() {
            let found = evidence(&shooting, &ends[0].point, whole.channels.floor)?;
            for (group, found) in found.iter().enumerate() {
                coordinates.resize(group, found.size(), found.repetition);
            }
            let again = ends.into_iter().map(|end| Point {
                z: coordinates.shrunk(end.point.z),
                ..end.point
            });
            ends = minimised(&coordinates, &again.collect::<Vec<_>>(), iterations, held)?;
        }
        let refined = ends.into_iter().map(|end| Refined {
            values: coordinates
                .own(&coordinates.to_values(&end.point.z))
                .to_vec(),
            states: self.of_stretches(&whole, |i| end.point.states[i]),
            residuals: self.residuals(&whole, &end.residual),
            tilt_residuals: self.tilt_residuals(&whole, &end.residual),
        });
        Ok(refined.collect())
    }

    /// Predicts each row of whole stretches from all rows before, at values and with noise, one for each of them.
    ///
    /// The marble starts in the given states of the stretches for each of the values, else at the first observed
    /// position, at rest on average. The gears of all values must have the signs of the first ones.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn filter(
        &self,
        values: &[Vec<f64>],
        noise: &[Noise],
        states: Option<&[Vec<Option<[f64; 4]>>]>,
        cancel: &AtomicBool,
    ) -> Result<Vec<Filtered>> {
        self.check()?;
        let Some(first) = values.first() else {
            return Ok(Vec::new());
        };
        let (coordinates, whole) = self.around(first, cancel)?;
        let shooting = Shooting::new(self, &coordinates, &whole, 1.0, cancel);
        let seen = self.filter_states(&whole);
        let known = |noise: &Noise| Noise {
            start_velocity: noise.start_velocity.filter(|_| states.is_none()),
            ..*noise
        };
        let noise: Vec<Noise> = noise.iter().map(known).collect();
        let mut trials = Vec::with_capacity(values.len());
        for (i, values) in values.iter().enumerate() {
            self.check_values(values)?;
            let given = states.map(|states| self.of_windows(&whole, &states[i]));
            let begun = given.as_ref().unwrap_or(&seen);
            trials.push(shooting.trial(&coordinates.to_z(values), begun, None));
        }
        shooting.filter(&trials.iter().collect::<Vec<_>>(), &noise)
    }

    /// Smoothed random acceleration in each row, given all rows of its stretch, at values with given start states.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn smooth(
        &self,
        values: &[f64],
        noise: Noise,
        states: &[Option<[f64; 4]>],
        cancel: &AtomicBool,
    ) -> Result<Vec<Vec<[Smoothed; 2]>>> {
        self.check()?;
        self.check_values(values)?;
        let (coordinates, whole) = self.around(values, cancel)?;
        let shooting = Shooting::new(self, &coordinates, &whole, 1.0, cancel);
        let begun = self.of_windows(&whole, states);
        let trial = shooting.trial(&coordinates.to_z(values), &begun, None);
        let noise = Noise {
            start_velocity: None,
            ..noise
        };
        shooting.smooth(&trial, noise)
    }

    /// Start state of a filter: the first observed position, at rest.
    pub(super) fn filter_states(&self, whole: &Windows) -> Vec<State> {
        let start = |window: &Window| {
            let seen = self.recordings[window.recording].observed[window.first];
            let place = if seen[0].is_finite() && seen[1].is_finite() {
                seen
            } else {
                [window.guess[0], window.guess[1]]
            };
            [place[0], place[1], 0.0, 0.0]
        };
        whole.all.iter().map(start).collect()
    }

    /// The channels weighted by the residuals of the best of some points.
    fn weighted(
        &self,
        coordinates: &Coordinates,
        whole: &Windows,
        points: &[Point],
        cancel: &AtomicBool,
    ) -> Result<Channels> {
        let shooting = Shooting::new(self, coordinates, whole, 1.0, cancel);
        let residuals = shooting.residuals(points)?;
        let loss = |residual: &Vec<f64>| whole.loss(residual);
        let best = residuals.iter().min_by(|a, b| loss(a).total_cmp(&loss(b)));
        Ok(best.map_or(whole.channels, |best| whole.reweighted(best)))
    }

    /// Points with start states from the first rows, then from more rows: a slightly wrong guess may end at the
    /// rim in a stretch that never meets it, where no slope leads away.
    pub(super) fn begun(
        &self,
        coordinates: &Coordinates,
        whole: &Windows,
        values: Vec<Vec<f64>>,
        cancel: &AtomicBool,
    ) -> Result<Vec<Point>> {
        let with = |z, states| Point { z, states };
        let mut points: Vec<Point> = values
            .into_iter()
            .map(|z| with(z, whole.guesses()))
            .collect();
        if whole.components() <= 2 {
            return Ok(points);
        }
        let pace = Pace {
            iterations: HEAD_ITERATIONS,
            look: Look::Both,
            variants: VARIANTS,
            held: true,
        };
        let first = HEADS.into_iter().filter(|rows| *rows < whole.rows);
        // If no stretch is longer than the first rows, whole stretches replace them.
        let own = (whole.rows <= HEADS[0]).then_some(whole.rows);
        for rows in first.chain(own) {
            let heads = Windows::heads(self, &whole.channels, rows);
            let shooting = Shooting::new(self, coordinates, &heads, 1.0, cancel);
            let starts: Vec<Point> = points
                .into_iter()
                .map(|point| with(point.z, heads.inherited(whole, &point.states)))
                .collect();
            let ends = minimise(&shooting, &starts, heads.channels.floor, pace, &|_| ())?;
            points = ends
                .into_iter()
                .map(|end| with(end.point.z, whole.inherited(&heads, &end.point.states)))
                .collect();
        }
        Ok(points)
    }
}

/// Whether one end point of a descent has a lower loss than another.
fn is_better(shooting: &Shooting<'_>, one: &End, other: &End) -> bool {
    let scale = |end: &End| robust::scale(&end.residual, &shooting.windows.known);
    let floor = shooting.windows.channels.floor;
    let scale = scale(one).min(scale(other)).max(floor);
    let loss = |end: &End| loss(shooting, &end.point.z, &end.residual, scale);
    loss(one) < loss(other)
}
