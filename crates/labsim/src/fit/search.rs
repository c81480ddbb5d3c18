//! The simulations of a search: candidates, their residuals and losses, and the number of windows.

use std::cell::Cell;
use std::sync::atomic::AtomicBool;

use super::channels::Channels;
use super::coordinates::Coordinates;
use super::descent::{End, Pace, loss, minimise};
use super::problem::Problem;
use super::robust;
use super::settings::Progress;
use super::shooting::{Point, Shooting};
use super::shrinkage::{Evidence, evidence};
use super::slopes::Look;
use super::windows::Windows;

use crate::error::{Error, Result};

/// Rows of the windows of the first stage; those of each later stage are 5/2 as long, and whole stretches come last.
/// Over many impacts the loss has many minima, and one step from short windows to a long run ends in one of them.
const SHORTEST: usize = 24;
/// Iterations on the first windows, and on each of the longer ones.
const ITERATIONS: [usize; 2] = [7, 6];
/// Number of start states that are tried with each step.
pub(super) const VARIANTS: usize = 4;
/// Length of physics updates in the stages before whole stretches, relative to the engine's.
pub(super) const COARSENESS: f64 = 5.0;

/// The recordings of one fit, and the number of windows simulated so far.
pub(super) struct Search<'a> {
    pub(super) problem: &'a Problem<'a>,
    pub(super) cancel: &'a AtomicBool,
    pub(super) progress: Progress<'a>,
    /// All stretches uncut, and the channels' weights.
    pub(super) whole: Windows,
    /// Rows of the windows, stage after stage, and iterations spent on each.
    pub(super) horizons: Vec<(usize, usize)>,
    rollouts: Cell<usize>,
    pub(super) done: Cell<usize>,
    /// Maximum number of iterations.
    pub(super) total: Cell<usize>,
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
                "a stretch with at least three rows of tracked positions or measured tilt";
            return Err(Error::invalid("recordings", expected, "none"));
        }
        let horizons = std::iter::successors(Some(SHORTEST), |rows| Some(5 * rows / 2))
            .take_while(|rows| 3 * rows <= 2 * whole.rows)
            .enumerate()
            .map(|(stage, rows)| (rows, ITERATIONS[stage.min(1)]));
        Ok(Self {
            problem,
            cancel,
            progress,
            horizons: horizons.collect(),
            whole,
            rollouts: Cell::new(0),
            done: Cell::new(0),
            total: Cell::new(0),
        })
    }

    /// Number of windows simulated so far.
    pub(super) fn rollouts(&self) -> usize {
        self.rollouts.get()
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

    /// Evidence of the sizes of shrunk groups.
    pub(super) fn evidence(
        &self,
        coordinates: &Coordinates,
        point: &Point,
    ) -> Result<Vec<Evidence>> {
        let shooting = self.shooting(coordinates, &self.whole, 1.0);
        let floor = self.whole.channels.floor;
        self.counted(&shooting, |shooting| evidence(shooting, point, floor))
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
        self.whole.smallest_scale(residuals.iter().copied())
    }

    pub(super) fn shooting<'b>(
        &'b self,
        coordinates: &'b Coordinates,
        windows: &'b Windows,
        coarseness: f64,
    ) -> Shooting<'b> {
        Shooting::new(self.problem, coordinates, windows, coarseness, self.cancel)
    }

    /// Runs simulations and counts their windows.
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

    pub(super) fn minimised(
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
