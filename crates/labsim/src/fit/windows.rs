//! Recordings cut into windows with separate start states.

use std::cmp::Reverse;
use std::ops::Range;

use super::channels::{CHANNELS, Channels, MARBLE};
use super::problem::{Problem, Stretch};
use super::robust::{self, median};

/// Position (board edges) and its rate (board edges a row).
pub(super) type State = [f64; 4];

/// Number of rows for the first guess of a window's start state.
const GUESS_ROWS: usize = 6;
/// Minimum number of tracked rows: fewer do not determine more than the start state.
const FEWEST: usize = 3;

/// Rows that are predicted from one start state.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    pub(super) recording: usize,
    pub(super) first: usize,
    pub(super) rows: usize,
    /// Whether the start velocity is known to be zero.
    pub(super) at_rest: bool,
    /// First guess of the start state.
    pub(super) guess: State,
    /// Index of its first residual among those of all windows, and number of residuals of the tilt.
    pub(super) offset: usize,
    pub(super) tilts: usize,
    /// Whether the marble was tracked; without it there is no start state.
    pub(super) has_marble: bool,
    /// Duration of a row (s) if the recording is stamped.
    pub(super) row_s: Option<f64>,
    /// Path length before the window (board edges).
    pub(super) rolled: f64,
}

impl Window {
    /// The marble's, then the tilt's.
    pub(super) fn residuals(&self) -> Range<usize> {
        self.offset..self.offset + 2 * self.rows + self.tilts
    }

    /// x and y by turns.
    pub(super) fn marble(&self) -> Range<usize> {
        self.offset..self.offset + 2 * self.rows
    }

    /// About x and y by turns; none where no recording has any.
    pub(super) fn tilt(&self) -> Range<usize> {
        self.marble().end..self.residuals().end
    }
}

/// Windows over all stretches.
#[derive(Debug, Clone)]
pub(super) struct Windows {
    pub(super) all: Vec<Window>,
    /// The indices of the windows of each length, those with and those without a marble.
    pub(super) lengths: Vec<((usize, bool), Vec<usize>)>,
    /// Measured positions (board edges) and tilts (rad) of each window.
    pub(super) observed: Vec<f64>,
    /// False without a measurement, and for ignored channels.
    pub(super) known: Vec<bool>,
    /// Weights of the residuals.
    pub(super) channels: Channels,
    /// The most rows a window may have.
    pub(super) rows: usize,
}

impl Windows {
    /// Cuts stretches into windows of at most `rows` rows; a stretch's last one may be shorter.
    pub(super) fn cut(problem: &Problem<'_>, channels: &Channels, rows: usize) -> Self {
        let mut windows = Self::none(channels, rows);
        for stretch in problem.stretches {
            for begin in (0..stretch.rows).step_by(rows) {
                windows.push(problem, stretch, begin, rows.min(stretch.rows - begin));
            }
        }
        windows.lengths.sort_by_key(|(kind, _)| Reverse(*kind));
        windows
    }

    /// The first rows of each stretch, at most `rows` of them.
    pub(super) fn heads(problem: &Problem<'_>, channels: &Channels, rows: usize) -> Self {
        let mut windows = Self::none(channels, rows);
        for stretch in problem.stretches {
            windows.push(problem, stretch, 0, rows.min(stretch.rows));
        }
        windows.lengths.sort_by_key(|(kind, _)| Reverse(*kind));
        windows
    }

    fn none(channels: &Channels, rows: usize) -> Self {
        Self {
            all: Vec::new(),
            lengths: Vec::new(),
            observed: Vec::new(),
            known: Vec::new(),
            channels: *channels,
            rows,
        }
    }

    fn push(&mut self, problem: &Problem<'_>, stretch: &Stretch, begin: usize, rows: usize) {
        let observed = problem.observed(stretch);
        let own = &observed[begin..begin + rows];
        let has_marble = own.iter().filter(|seen| is_seen(seen)).count() >= FEWEST;
        let tilt = problem.tilt(stretch).filter(|_| self.channels.has_tilt());
        let tilt = tilt.map(|tilt| &tilt[begin..begin + rows]);
        let is_measured = |row: &&[f64; 2]| row.iter().any(|angle| angle.is_finite());
        let measured = tilt.map_or(0, |tilt| tilt.iter().filter(is_measured).count());
        if !has_marble && measured < FEWEST {
            return;
        }
        let at_rest = stretch.at_rest && begin == 0;
        let durations = problem.recordings[stretch.recording].durations;
        let first = stretch.first + begin;
        let kind = (rows, has_marble);
        match self.lengths.iter_mut().find(|(other, _)| *other == kind) {
            Some((_, windows)) => windows.push(self.all.len()),
            None => self.lengths.push((kind, vec![self.all.len()])),
        }
        self.all.push(Window {
            recording: stretch.recording,
            first,
            rows,
            at_rest,
            guess: guess(observed, begin, at_rest),
            offset: self.observed.len(),
            tilts: if self.channels.has_tilt() {
                2 * rows
            } else {
                0
            },
            has_marble,
            row_s: durations.map(|seconds| median(seconds[first..first + rows].to_vec())),
            rolled: problem.recordings[stretch.recording]
                .way
                .map_or(0.0, |way| way[first]),
        });
        let active = self.channels.active;
        for seen in own {
            let known = has_marble && is_seen(seen);
            self.known.extend([0, 1].map(|axis| known && active[axis]));
            self.observed.extend(if known { *seen } else { [0.0; 2] });
        }
        if self.channels.has_tilt() {
            for row in 0..rows {
                for axis in 0..2 {
                    let angle = tilt.map_or(f64::NAN, |tilt| tilt[row][axis]);
                    let known = active[2 + axis] && angle.is_finite();
                    self.known.push(known);
                    self.observed.push(if known { angle } else { 0.0 });
                }
            }
        }
    }

    /// The channel and the place of every known residual of some channels.
    pub(super) fn channels_of(
        &self,
        channels: Range<usize>,
    ) -> impl Iterator<Item = (usize, usize)> + '_ {
        let of_window = |window: &Window| {
            let marble = window.marble().map(|i| (i % 2, i));
            marble.chain(window.tilt().map(|i| (CHANNELS / 2 + i % 2, i)))
        };
        let all = self.all.iter().flat_map(of_window);
        all.filter(move |(channel, i)| channels.contains(channel) && self.known[*i])
    }

    /// Weights by the scales of residuals: no channel's is smaller than its sensor's noise.
    pub(super) fn reweighted(&self, residual: &[f64]) -> Channels {
        let channels = &self.channels;
        if !channels.has_tilt() {
            return *channels;
        }
        let scales: [f64; CHANNELS] = std::array::from_fn(|channel| {
            let scale = self.scale(residual, channel..channel + 1);
            scale.max(channels.noise[channel])
        });
        let common = if channels.has_marble() {
            let marble = self.scale(residual, MARBLE);
            marble.max(channels.common(channels.noise))
        } else {
            channels.common(scales)
        };
        channels.weighted(common, scales)
    }

    /// The robust standard deviation of the residuals of some channels, in their own unit; NaN without
    /// measurements.
    pub(super) fn scale(&self, residual: &[f64], channels: Range<usize>) -> f64 {
        let found = self.in_own_units(residual, channels);
        if found.is_empty() {
            return f64::NAN;
        }
        robust::scale(&found, &vec![true; found.len()])
    }

    /// The scale of those residuals that fit best, no smaller than the sensors' noise.
    pub(super) fn smallest_scale<'a>(&self, residuals: impl Iterator<Item = &'a [f64]>) -> f64 {
        residuals
            .map(|residual| robust::scale(residual, &self.known))
            .fold(f64::INFINITY, f64::min)
            .max(self.channels.floor)
    }

    /// Updates the channels' weights and the residuals.
    pub(super) fn rescale(&mut self, after: Channels, residuals: &mut [&mut [f64]]) {
        for residual in residuals {
            for (channel, i) in self.channels_of(0..CHANNELS) {
                residual[i] *= after.weights[channel] / self.channels.weights[channel];
            }
        }
        self.channels = after;
    }

    /// Whether residuals are no more than their sensors' noise, or so many times that.
    pub(super) fn is_noise(&self, residual: &[f64], times: f64) -> bool {
        let channels = &self.channels;
        if !channels.has_tilt() {
            return robust::scale(residual, &self.known) < times * channels.floor;
        }
        let is_noise = |channel: usize| {
            let scale = self.scale(residual, channel..channel + 1);
            !channels.active[channel] || scale < times * channels.noise[channel]
        };
        (0..CHANNELS).all(is_noise)
    }

    /// The negative log-likelihood of residuals up to a constant, each at its sensor's noise.
    pub(super) fn loss(&self, residual: &[f64]) -> f64 {
        let channels = &self.channels;
        if !channels.has_tilt() {
            return robust::loss(residual, channels.floor);
        }
        let of_channel = |channel: usize| {
            let own = self.in_own_units(residual, channel..channel + 1);
            robust::loss(&own, channels.noise[channel])
        };
        (0..CHANNELS).map(of_channel).sum()
    }

    fn in_own_units(&self, residual: &[f64], channels: Range<usize>) -> Vec<f64> {
        self.channels_of(channels)
            .map(|(channel, i)| residual[i] / self.channels.weights[channel])
            .collect()
    }

    /// Number of components of all start states.
    pub(super) fn unknowns(&self) -> usize {
        let axes = self.channels.marble_axes();
        self.with_marble()
            .map(|window| if window.at_rest { axes } else { 2 * axes })
            .sum()
    }

    /// Those with a start state.
    fn with_marble(&self) -> impl Iterator<Item = &Window> {
        self.all.iter().filter(|window| window.has_marble)
    }

    /// Number of free components of a start state: 0 without a marble, 2 if every window starts at rest, else 4.
    pub(super) fn components(&self) -> usize {
        if self.with_marble().next().is_none() {
            0
        } else if self.with_marble().all(|window| window.at_rest) {
            2
        } else {
            4
        }
    }

    /// Number of residuals.
    pub(super) fn len(&self) -> usize {
        self.observed.len()
    }

    /// Number of known residuals.
    pub(super) fn count(&self) -> usize {
        self.known.iter().filter(|known| **known).count()
    }

    /// First guesses of all start states.
    pub(super) fn guesses(&self) -> Vec<State> {
        self.all.iter().map(|window| window.guess).collect()
    }

    /// Start states from shorter windows that begin in the same rows, else the guesses.
    pub(super) fn inherited(&self, shorter: &Self, states: &[State]) -> Vec<State> {
        let found = |window: &Window| {
            let origin = (window.recording, window.first);
            let same = |one: &Window| (one.recording, one.first) == origin;
            shorter
                .all
                .iter()
                .position(same)
                .map_or(window.guess, |i| states[i])
        };
        self.all.iter().map(found).collect()
    }
}

fn is_seen(place: &[f64; 2]) -> bool {
    place.iter().all(|coordinate| coordinate.is_finite())
}

/// Position and rate at a row, from medians over the nearest tracked rows, robust against one outlier.
fn guess(observed: &[[f64; 2]], first: usize, at_rest: bool) -> State {
    let mut near: Vec<usize> = (0..observed.len())
        .filter(|&row| is_seen(&observed[row]))
        .collect();
    near.sort_by_key(|row| row.abs_diff(first));
    near.truncate(if at_rest { FEWEST } else { GUESS_ROWS });
    let mut state = [0.0; 4];
    for axis in 0..2 {
        let mut rates = Vec::new();
        if !at_rest {
            for (i, &a) in near.iter().enumerate() {
                for &b in &near[i + 1..] {
                    rates.push((observed[b][axis] - observed[a][axis]) / (b as f64 - a as f64));
                }
            }
        }
        let rate = median(rates);
        let places = near
            .iter()
            .map(|&row| observed[row][axis] - (row as f64 - first as f64) * rate);
        state[axis] = median(places.collect());
        state[2 + axis] = rate;
    }
    state
}
