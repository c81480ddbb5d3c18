//! The search for the best values: from a draw over the ranges to the bottom of the deepest valley found.
//!
//! The way goes from short windows to whole stretches: in short ones nearly every start point finds the
//! gears; in long ones friction, walls and stops come in. All candidates move in lockstep, so that an
//! iteration is two batches of rollouts, whatever the number of candidates, recordings and parameters.

use std::cell::Cell;
use std::sync::atomic::AtomicBool;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::channels::Channels;
use super::coordinates::{Coordinates, Group, TIME};
use super::descent::{End, Pace, loss, minimise};
use super::polish::{FAMILY_ITERATIONS, SETTLE_ITERATIONS};
use super::problem::Problem;
use super::robust;
use super::shooting::{Point, Shooting};
use super::shrinkage::{Evidence, evidence, is_settled};
use super::slopes::Look;
use super::windows::{State, Windows};
use super::{Progress, Settings};
use crate::error::{Error, Result};

/// Rows of the windows, stage after stage, and iterations spent on each; whole stretches come last.
const HORIZONS: [(usize, usize); 2] = [(24, 7), (60, 6)];
const WHOLE_ITERATIONS: usize = 12;
/// How often the channels are weighted anew after the descent, at most.
const REWEIGHTS: usize = 4;
/// How often the sizes of what is shrunk are estimated after the descent, at most.
const RESIZES: usize = 4;
/// Start states tried with each step.
const VARIANTS: usize = 4;
/// So many rounds even where noise alone seems to be left.
const FEWEST_ROUNDS: usize = 2;
/// Physics updates on the way to whole stretches are this many times longer than the engine's.
pub(super) const COARSENESS: f64 = 5.0;
/// Residuals this many times the tracker's noise may be noise, which is estimated too.
const NOISE_LIKE: f64 = 1.06;
/// The search ends where noise is left and a round changes the log-likelihood by less.
const LITTLE: f64 = 3.0;

/// The recordings of one fit, and what the search has cost so far.
pub(super) struct Search<'a> {
    pub(super) problem: &'a Problem<'a>,
    pub(super) cancel: &'a AtomicBool,
    progress: Progress<'a>,
    /// All stretches uncut, and how the channels count.
    pub(super) whole: Windows,
    horizons: Vec<(usize, usize)>,
    rollouts: Cell<usize>,
    done: Cell<usize>,
    /// Iterations there are at most.
    total: Cell<usize>,
}

impl<'a> Search<'a> {
    pub(super) fn new(
        problem: &'a Problem<'a>,
        progress: Progress<'a>,
        cancel: &'a AtomicBool,
    ) -> Result<Self> {
        let longest = problem.stretches.iter().map(|stretch| stretch.rows).max();
        let whole = Windows::cut(problem, &Channels::of(problem), longest.unwrap_or(1));
        if whole.all.is_empty() {
            let expected =
                "a stretch with at least three rows in which the marble was seen, or tilt measured";
            return Err(Error::invalid("recordings", expected, "none"));
        }
        let fits = |stage: &(usize, usize)| 3 * stage.0 <= 2 * whole.rows;
        Ok(Self {
            problem,
            cancel,
            progress,
            horizons: HORIZONS.into_iter().filter(fits).collect(),
            whole,
            rollouts: Cell::new(0),
            done: Cell::new(0),
            total: Cell::new(0),
        })
    }

    /// How many windows were simulated so far.
    pub(super) fn rollouts(&self) -> usize {
        self.rollouts.get()
    }

    /// Refines given start points, or where there are none the best ones of a draw; returns what the
    /// coordinates mean and where the start points led, the best first.
    pub(super) fn run(
        &mut self,
        points: &[Vec<f64>],
        settings: &Settings,
    ) -> Result<(Coordinates, Vec<End>)> {
        let (mut coordinates, starts) = match points.first() {
            Some(first) => {
                let (coordinates, _) = self.problem.around(first, self.cancel)?;
                let starts = points
                    .iter()
                    .map(|values| coordinates.to_z(values))
                    .collect();
                (coordinates, starts)
            }
            None => self.screen(settings)?,
        };
        self.total.set(self.total(&coordinates, settings.rounds));
        let keeps = !points.is_empty() && settings.rounds > 0;
        let mut candidates = self.descend(&coordinates, starts, keeps)?;
        for _ in 0..REWEIGHTS {
            if !self.reweight(&mut candidates) {
                break;
            }
            let best = vec![candidates.remove(0)];
            candidates.splice(0..0, self.refined(&coordinates, best, SETTLE_ITERATIONS)?);
        }
        let mut best = candidates.remove(0);
        if self.maps_predict(&coordinates, &best)? {
            coordinates.open_maps();
            // From short windows on: over whole stretches nothing leads from no map to the right one.
            let start = vec![best.point.z.clone()];
            best = self.descend(&coordinates, start, true)?.remove(0);
        }
        for _ in 0..RESIZES {
            if self.resize(&mut coordinates, &mut best)? {
                break;
            }
            best = self
                .refined(&coordinates, vec![best], SETTLE_ITERATIONS)?
                .remove(0);
            self.reweight(std::slice::from_mut(&mut best));
        }
        let mut random = ChaCha8Rng::seed_from_u64(settings.seed);
        // With effects a fit is one of many, and each member takes more slopes.
        let members = settings.starts / (1 + usize::from(!self.problem.effects.is_empty()));
        for round in 1..=settings.rounds {
            let before = best.clone();
            if self.is_time_free(&coordinates) {
                let mut members = self.family(&coordinates, &best, members.max(1))?;
                members.insert(0, best);
                best = self.ranked(&coordinates, members).remove(0);
            }
            best = self.settled(&coordinates, best, &mut random)?;
            self.reweight(std::slice::from_mut(&mut best));
            if !self.resize(&mut coordinates, &mut best)? {
                best = self
                    .refined(&coordinates, vec![best], SETTLE_ITERATIONS)?
                    .remove(0);
            }
            let little = self.gain(&best, &before) < LITTLE;
            if round >= FEWEST_ROUNDS && little && self.is_explained(&best) {
                break;
            }
        }
        if self.is_time_free(&coordinates) {
            best = self.rounded(&coordinates, best)?;
        }
        let total = self.total.get();
        (self.progress)(total, total, self.whole.rows);
        candidates.insert(0, best);
        Ok((coordinates, candidates))
    }

    /// Whether what a candidate leaves over is no more than the tracker's noise.
    fn is_explained(&self, candidate: &End) -> bool {
        let channels = &self.whole.channels;
        channels.is_noise(&self.whole, &candidate.residual, NOISE_LIKE)
    }

    /// By how much the log-likelihood of one candidate exceeds that of another.
    fn gain(&self, one: &End, other: &End) -> f64 {
        let losses = self.losses(&[&one.residual, &other.residual]);
        losses[1] - losses[0]
    }

    /// Refines start points in longer and longer windows, and the better half in whole stretches.
    ///
    /// There the start points as they were count as well if it `keeps` them: short windows may lead away from
    /// where a fit has led before.
    fn descend(
        &mut self,
        coordinates: &Coordinates,
        starts: Vec<Vec<f64>>,
        keeps: bool,
    ) -> Result<Vec<End>> {
        let mut shorter: Option<Windows> = None;
        let count = starts.len();
        let begin = |point: Point| End {
            path: vec![point.z.clone()],
            point,
            residual: Vec::new(),
        };
        let mut ends: Vec<End> = starts
            .iter()
            .map(|z| {
                begin(Point {
                    z: z.clone(),
                    states: Vec::new(),
                })
            })
            .collect();
        let longer = |windows: &Windows, shorter: &Option<Windows>, states: &[State]| match shorter
        {
            Some(shorter) => windows.inherited(shorter, states),
            None => windows.guesses(),
        };
        for &(rows, iterations) in &self.horizons {
            let windows = Windows::cut(self.problem, &self.whole.channels, rows);
            for end in &mut ends {
                end.point.states = longer(&windows, &shorter, &end.point.states);
            }
            let pace = Pace {
                iterations,
                look: Look::Quick,
                variants: VARIANTS,
                held: false,
            };
            ends = self.minimised(coordinates, &windows, ends, pace, COARSENESS)?;
            if let Some(redrawn) = self.redrawn(coordinates, &windows, &ends)? {
                ends = self.minimised(coordinates, &windows, redrawn, pace, COARSENESS)?;
            }
            if windows.channels.has_tilt() {
                let best = self.ranked_in(&windows, coordinates, &ends)[0];
                let channels = windows.channels.reweighted(&windows, &ends[best].residual);
                self.whole.channels = channels;
            }
            shorter = Some(windows);
        }
        if self.horizons.is_empty() {
            // No windows have found start states on the way, and from guesses a joint descent leads astray.
            let begun = ends.iter().map(|end| end.point.z.clone()).collect();
            let begun = self
                .problem
                .begun(coordinates, &self.whole, begun, self.cancel)?;
            for (end, point) in ends.iter_mut().zip(begun) {
                end.point = point;
            }
        } else {
            for end in &mut ends {
                end.point.states = longer(&self.whole, &shorter, &end.point.states);
            }
            if keeps {
                let begun = self
                    .problem
                    .begun(coordinates, &self.whole, starts, self.cancel)?;
                ends.extend(begun.into_iter().map(begin));
            }
        }
        let points: Vec<Point> = ends.iter().map(|end| end.point.clone()).collect();
        let shooting = self.shooting(coordinates, &self.whole, 1.0);
        let residuals = self.counted(&shooting, |shooting| shooting.residuals(&points))?;
        for (end, residual) in ends.iter_mut().zip(residuals) {
            end.residual = residual;
        }
        let mut candidates = self.ranked(coordinates, ends);
        let extra = usize::from(keeps);
        candidates.truncate(count + extra);
        let better = (count.div_ceil(2) + extra).min(candidates.len());
        let rest = candidates.split_off(better);
        let mut candidates = self.refined(coordinates, candidates, WHOLE_ITERATIONS)?;
        candidates.extend(rest);
        Ok(self.ranked(coordinates, candidates))
    }

    /// Refines candidates over whole stretches.
    pub(super) fn refined(
        &self,
        coordinates: &Coordinates,
        candidates: Vec<End>,
        iterations: usize,
    ) -> Result<Vec<End>> {
        let pace = Pace {
            iterations,
            look: Look::Both,
            variants: VARIANTS,
            held: false,
        };
        self.minimised(coordinates, &self.whole, candidates, pace, 1.0)
    }

    /// Weights the channels by what the first of some candidates leaves over; false where they have settled.
    fn reweight(&mut self, candidates: &mut [End]) -> bool {
        let before = self.whole.channels;
        let after = before.reweighted(&self.whole, &candidates[0].residual);
        for candidate in candidates {
            after.rescale(&before, &self.whole, &mut candidate.residual);
        }
        self.whole.channels = after;
        !after.is_settled(&before)
    }

    /// Estimates the sizes of what is shrunk anew; true where they have settled.
    fn resize(&self, coordinates: &mut Coordinates, best: &mut End) -> Result<bool> {
        let before = coordinates.sizes();
        let found = self.evidence(coordinates, &best.point)?;
        for (group, found) in found.iter().enumerate() {
            let own = &coordinates.groups()[group];
            if !own.is_map() || own.size > 0.0 {
                coordinates.resize(group, found.size(), found.repetition);
            }
        }
        let settled = is_settled(&before, &coordinates.sizes());
        best.point.z = coordinates.shrunk(std::mem::take(&mut best.point.z));
        if !settled {
            let shooting = self.shooting(coordinates, &self.whole, 1.0);
            let points = std::slice::from_ref(&best.point);
            let residuals = self.counted(&shooting, |shooting| shooting.residuals(points))?;
            best.residual = residuals.into_iter().next().unwrap_or_default();
        }
        Ok(settled)
    }

    /// What the recordings say of the sizes of what is shrunk.
    pub(super) fn evidence(
        &self,
        coordinates: &Coordinates,
        point: &Point,
    ) -> Result<Vec<Evidence>> {
        let shooting = self.shooting(coordinates, &self.whole, 1.0);
        let floor = self.whole.channels.floor;
        self.counted(&shooting, |shooting| evidence(shooting, point, floor))
    }

    /// The candidates' places by their losses over windows, the best first.
    fn ranked_in(&self, windows: &Windows, coordinates: &Coordinates, ends: &[End]) -> Vec<usize> {
        let shooting = self.shooting(coordinates, windows, COARSENESS);
        let scales = ends
            .iter()
            .map(|end| robust::scale(&end.residual, &windows.known));
        let scale = scales
            .fold(f64::INFINITY, f64::min)
            .max(windows.channels.floor);
        let losses: Vec<f64> = ends
            .iter()
            .map(|end| loss(&shooting, &end.point.z, &end.residual, scale))
            .collect();
        let mut order: Vec<usize> = (0..ends.len()).collect();
        order.sort_by(|&a, &b| losses[a].total_cmp(&losses[b]));
        order
    }

    /// Whether the first symmetry holds until a wall is met: neither stamps nor damping forbid it.
    fn is_time_free(&self, coordinates: &Coordinates) -> bool {
        coordinates.find(TIME).is_some() && self.problem.rig.marble.damping_per_s == 0.0
    }

    pub(super) fn ranked(&self, coordinates: &Coordinates, candidates: Vec<End>) -> Vec<End> {
        let residuals: Vec<&[f64]> = candidates
            .iter()
            .map(|one| one.residual.as_slice())
            .collect();
        let scale = self.best_scale(&residuals);
        let shooting = self.shooting(coordinates, &self.whole, 1.0);
        let mut ranked: Vec<(f64, End)> = candidates
            .into_iter()
            .map(|one| (loss(&shooting, &one.point.z, &one.residual, scale), one))
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked.into_iter().map(|(_, one)| one).collect()
    }

    /// The losses of residuals, at the scale of those that fit best.
    pub(super) fn losses(&self, residuals: &[&[f64]]) -> Vec<f64> {
        let scale = self.best_scale(residuals);
        residuals
            .iter()
            .map(|residual| robust::loss(residual, scale))
            .collect()
    }

    fn best_scale(&self, residuals: &[&[f64]]) -> f64 {
        let scales = residuals
            .iter()
            .map(|residual| robust::scale(residual, &self.whole.known));
        scales
            .fold(f64::INFINITY, f64::min)
            .max(self.whole.channels.floor)
    }

    pub(super) fn shooting<'b>(
        &'b self,
        coordinates: &'b Coordinates,
        windows: &'b Windows,
        coarseness: f64,
    ) -> Shooting<'b> {
        Shooting::new(self.problem, coordinates, windows, coarseness, self.cancel)
    }

    /// Runs what simulates, and adds up what it cost.
    pub(super) fn counted<T>(
        &self,
        shooting: &Shooting<'_>,
        work: impl FnOnce(&Shooting<'_>) -> T,
    ) -> T {
        let before = shooting.rollouts();
        let result = work(shooting);
        self.rollouts
            .set(self.rollouts.get() + shooting.rollouts() - before);
        result
    }

    /// How many iterations there are at most.
    fn total(&self, coordinates: &Coordinates, rounds: usize) -> usize {
        let times = 1 + usize::from(!self.problem.effects.is_empty());
        let descent =
            times * self.horizons.iter().map(|stage| stage.1).sum::<usize>() + WHOLE_ITERATIONS;
        let groups = coordinates.groups();
        let has_tilt = self.whole.channels.has_tilt();
        descent
            + usize::from(groups.iter().any(Group::is_map)) * descent
            + usize::from(has_tilt) * REWEIGHTS * SETTLE_ITERATIONS
            + usize::from(!groups.is_empty()) * (RESIZES + rounds) * SETTLE_ITERATIONS
            + rounds
                * (FAMILY_ITERATIONS * usize::from(self.is_time_free(coordinates))
                    + SETTLE_ITERATIONS)
    }

    fn minimised(
        &self,
        coordinates: &Coordinates,
        windows: &Windows,
        ends: Vec<End>,
        pace: Pace,
        coarseness: f64,
    ) -> Result<Vec<End>> {
        let total = self.total.get();
        let report =
            |iteration: usize| (self.progress)(self.done.get() + iteration, total, windows.rows);
        let starts: Vec<Point> = ends.iter().map(|end| end.point.clone()).collect();
        let shooting = self.shooting(coordinates, windows, coarseness);
        let mut minimised = self.counted(&shooting, |shooting| {
            minimise(shooting, &starts, windows.channels.floor, pace, &report)
        })?;
        report(pace.iterations);
        self.done.set(self.done.get() + pace.iterations);
        for (end, before) in minimised.iter_mut().zip(ends) {
            let walked = std::mem::replace(&mut end.path, before.path);
            end.path.extend(walked);
        }
        Ok(minimised)
    }
}
