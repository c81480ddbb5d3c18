//! The search for the best values: from draws over the ranges to the deepest minimum found.
//!
//! Stages go from short windows to whole stretches. In short windows nearly every start point finds the gears;
//! in long ones friction, walls and stops matter. All candidates move in lockstep, so that an iteration is two
//! batches of rollouts for any number of candidates, recordings and parameters.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::coordinates::{Coordinates, Group};
use super::descent::{End, Pace, loss};
use super::polish::{FAMILY_ITERATIONS, SETTLE_ITERATIONS};
use super::search::{COARSENESS, Search, VARIANTS};
use super::settings::Settings;
use super::shooting::Point;
use super::shrinkage::is_settled;
use super::slopes::Look;
use super::windows::{State, Windows};
use crate::error::Result;
use crate::parameters::TIME;

const WHOLE_ITERATIONS: usize = 12;
/// Maximum number of updates of the channels' weights after the descent.
const REWEIGHTS: usize = 4;
/// Maximum number of updates of the shrunk groups' sizes after the descent.
const RESIZES: usize = 4;
/// Minimum number of rounds, even if the residuals seem to be noise.
const FEWEST_ROUNDS: usize = 2;
/// Residuals up to this many times the tracker's noise may be noise, because that noise is estimated too.
const NOISE_LIKE: f64 = 1.06;
/// The search ends when the residuals are noise and a round changes the log-likelihood by less than this.
const LITTLE: f64 = 3.0;

impl Search<'_> {
    /// Refines given start points, or without any the best ones of a draw; returns the coordinates' map and the
    /// results of the start points, the best first.
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
            // From short windows on: over whole stretches no descent leads from no map to the right one.
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
        // A fit with effects is one of many, and each family member takes more slopes.
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

    /// Whether a candidate's residuals are no more than the tracker's noise.
    fn is_explained(&self, candidate: &End) -> bool {
        self.whole.is_noise(&candidate.residual, NOISE_LIKE)
    }

    /// By how much the log-likelihood of one candidate exceeds that of another.
    fn gain(&self, one: &End, other: &End) -> f64 {
        let losses = self.losses(&[&one.residual, &other.residual]);
        losses[1] - losses[0]
    }

    /// Refines start points in longer and longer windows, and the better half in whole stretches.
    ///
    /// With `keeps`, the original start points compete there as well: short windows may lead away from the result
    /// of an earlier fit.
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
                let channels = windows.reweighted(&ends[best].residual);
                self.whole.channels = channels;
            }
            shorter = Some(windows);
        }
        if self.horizons.is_empty() {
            // Without short windows there are no estimated start states, and a joint descent from guesses fails.
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

    /// Weights the channels by the residuals of the first candidate; false once they have converged.
    fn reweight(&mut self, candidates: &mut [End]) -> bool {
        let before = self.whole.channels;
        let after = self.whole.reweighted(&candidates[0].residual);
        let mut residuals: Vec<&mut [f64]> = candidates
            .iter_mut()
            .map(|one| one.residual.as_mut_slice())
            .collect();
        self.whole.rescale(after, &mut residuals);
        !after.is_settled(&before)
    }

    /// Updates the sizes of shrunk groups; true once they have converged.
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

    /// The candidates' indices by their losses over windows, the best first.
    fn ranked_in(&self, windows: &Windows, coordinates: &Coordinates, ends: &[End]) -> Vec<usize> {
        let shooting = self.shooting(coordinates, windows, COARSENESS);
        let scale = windows.smallest_scale(ends.iter().map(|end| end.residual.as_slice()));
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

    /// Maximum number of iterations.
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
}
