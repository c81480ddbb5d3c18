//! Levenberg-Marquardt for many candidates in lockstep.
//!
//! The loss is rough: it jumps wherever a stop or an impact moves by a physics update. Therefore steps are
//! tried with several dampings and several start states at once. Windows are independent, so each window takes
//! its best start state.

use nalgebra::{DVector, Matrix4, Vector4};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::normal::Normal;
use super::robust;
use super::shooting::{Point, Shooting};
use super::slopes::Look;
use super::windows::State;
use crate::error::Result;

/// Dampings tried at once, relative to the last one that worked.
const TRIALS: [f64; 3] = [0.01, 0.3, 10.0];
const FIRST_DAMPING: f64 = 1e-2;
const LEAST_DAMPING: f64 = 1e-9;
/// Damping above which a candidate has converged.
const STUCK: f64 = 1e3;
/// Relative gain below which a candidate has converged.
const ARRIVED: f64 = 1e-4;
/// Largest change of a coordinate in one step.
const LONGEST_STEP: f64 = 0.7;
/// Largest change of a start state in one draw (board edges, a row).
const LONGEST_DRAW: f64 = 0.01;
/// Candidates and start states drawn in each round of the search nearby.
const DRAWS: usize = 12;
const STATE_DRAWS: usize = 8;
/// Maximum distance of candidates in the search nearby, in coordinates.
const FURTHEST: f64 = 0.1;

/// Settings of a descent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    /// Maximum number of iterations.
    pub(super) iterations: usize,
    /// Method of the slopes.
    pub(super) look: Look,
    /// Number of start states that are tried with each step.
    pub(super) variants: usize,
    /// Whether only the start states move.
    pub(super) held: bool,
}

/// End point of a candidate.
#[derive(Debug, Clone)]
pub(super) struct End {
    pub(super) point: Point,
    /// Over all windows (board edges).
    pub(super) residual: Vec<f64>,
    /// Coordinates after each iteration, the start included.
    pub(super) path: Vec<Vec<f64>>,
}

/// A candidate in progress.
struct Walker {
    point: Point,
    residual: Vec<f64>,
    damping: f64,
    active: bool,
}

/// Minimises the Student-t loss of the residuals from many start points at once; the residuals' scale is
/// never taken to be smaller than `noise`.
pub(super) fn minimise(
    shooting: &Shooting<'_>,
    starts: &[Point],
    noise: f64,
    pace: Pace,
    on_iteration: &dyn Fn(usize),
) -> Result<Vec<End>> {
    let mut walkers: Vec<Walker> = starts
        .iter()
        .map(|start| Walker {
            point: Point {
                z: shooting.coordinates.clip(&start.z),
                states: start.states.clone(),
            },
            residual: Vec::new(),
            damping: FIRST_DAMPING,
            active: true,
        })
        .collect();
    let points: Vec<Point> = walkers.iter().map(|walker| walker.point.clone()).collect();
    for (walker, residual) in walkers.iter_mut().zip(shooting.residuals(&points)?) {
        walker.residual = residual;
    }
    let mut paths: Vec<Vec<Vec<f64>>> = points.into_iter().map(|point| vec![point.z]).collect();
    let mut random = ChaCha8Rng::seed_from_u64(0);
    for iteration in 0..pace.iterations {
        let mut live: Vec<&mut Walker> =
            walkers.iter_mut().filter(|walker| walker.active).collect();
        if live.is_empty() {
            break;
        }
        walk(shooting, &mut live, noise, pace, &mut random)?;
        for (path, walker) in paths.iter_mut().zip(&walkers) {
            path.push(walker.point.z.clone());
        }
        on_iteration(iteration + 1);
    }
    let ends = walkers.into_iter().zip(paths).map(|(walker, path)| End {
        point: walker.point,
        residual: walker.residual,
        path,
    });
    Ok(ends.collect())
}

/// One iteration of all walkers in progress.
fn walk(
    shooting: &Shooting<'_>,
    live: &mut [&mut Walker],
    noise: f64,
    pace: Pace,
    random: &mut ChaCha8Rng,
) -> Result<()> {
    let points: Vec<Point> = live.iter().map(|walker| walker.point.clone()).collect();
    let lines = shooting.linearise(&points, pace.look, pace.held)?;
    let mut trials = Vec::new();
    let mut befores = Vec::new();
    for (walker, line) in live.iter().zip(&lines) {
        let z = &walker.point.z;
        let scale = robust::scale(&line.residual, &shooting.windows.known).max(noise);
        let normal = Normal::new(line, shooting.windows, shooting.coordinates, z, scale);
        let mut free = normal.free(&shooting.coordinates.bounds(z), z);
        for (i, free) in free.iter_mut().enumerate() {
            *free &= !pace.held && !shooting.coordinates.is_held(i);
        }
        let loose = normal.loose();
        for factor in TRIALS {
            let (dz, ds) = normal.step(walker.damping * factor, &free);
            let moved = moved(shooting, &walker.point, &dz, &ds);
            trials.push(varied(moved, &loose, pace.variants, random));
        }
        befores.push((scale, loss(shooting, z, &line.residual, scale)));
    }
    let scales: Vec<f64> = befores
        .iter()
        .flat_map(|(scale, _)| [*scale; TRIALS.len()])
        .collect();
    let mut trials = suited(shooting, trials, &scales)?.into_iter();
    for (walker, (_, before)) in live.iter_mut().zip(befores) {
        let (mut best, mut chosen) = (before, 3.0 * TRIALS[TRIALS.len() - 1]);
        for (factor, (point, residual, loss)) in TRIALS.into_iter().zip(trials.by_ref()) {
            if loss < best {
                (walker.point, walker.residual) = (point, residual);
                (best, chosen) = (loss, factor);
            }
        }
        walker.damping = (walker.damping * chosen).max(LEAST_DAMPING);
        walker.active = if best < before {
            before - best > ARRIVED * (before + 1.0)
        } else {
            walker.damping < STUCK
        };
    }
    Ok(())
}

/// Searches around a solution for a better one, where the loss is too rough for slopes: each round draws
/// candidates from the normal distribution of the normal equations, and start states for each of them.
pub(super) fn search_nearby(
    shooting: &Shooting<'_>,
    mut point: Point,
    noise: f64,
    rounds: usize,
    random: &mut ChaCha8Rng,
) -> Result<Point> {
    for _ in 0..rounds {
        let line = shooting
            .linearise(std::slice::from_ref(&point), Look::Both, false)?
            .remove(0);
        let scale = robust::scale(&line.residual, &shooting.windows.known).max(noise);
        let normal = Normal::new(
            &line,
            shooting.windows,
            shooting.coordinates,
            &point.z,
            scale,
        );
        let ((spread, follow), loose) = (normal.spread(), normal.loose());
        let mut trials = Vec::new();
        for draw in 0..DRAWS {
            let drawn = DVector::from_fn(point.z.len(), |_, _| StandardNormal.sample(random));
            let mut step: DVector<f64> = &spread * drawn;
            step.apply(|step| *step = step.clamp(-FURTHEST, FURTHEST));
            if draw == 0 {
                step.fill(0.0);
            }
            for (i, step) in step.iter_mut().enumerate() {
                if shooting.coordinates.is_held(i) {
                    *step = 0.0;
                }
            }
            let aim: Vec<f64> = point
                .z
                .iter()
                .zip(&step)
                .map(|(z, step)| z + step)
                .collect();
            let z = shooting.coordinates.clip(&aim);
            let dz = DVector::from_fn(z.len(), |i, _| z[i] - point.z[i]);
            let ds: Vec<Vector4<f64>> = follow.iter().map(|follow| follow * &dz).collect();
            let states = shifted(&point.states, &ds, 1.0);
            trials.push(varied(Point { z, states }, &loose, STATE_DRAWS, random));
        }
        let found = suited(shooting, trials, &[scale; DRAWS])?;
        let best = found.into_iter().min_by(|a, b| a.2.total_cmp(&b.2));
        if let Some((better, _, _)) = best {
            point = better;
        }
    }
    Ok(point)
}

/// The loss of residuals at coordinates, and the penalty outside the ranges.
pub(super) fn loss(shooting: &Shooting<'_>, z: &[f64], residual: &[f64], scale: f64) -> f64 {
    robust::loss(residual, scale) + outside(shooting, z)
}

/// The penalty outside the ranges, and the prior of shrunk coordinates.
fn outside(shooting: &Shooting<'_>, z: &[f64]) -> f64 {
    let coordinates = shooting.coordinates;
    let excess = coordinates.excess(z);
    let beyond = 0.5 * excess.iter().map(|excess| excess * excess).sum::<f64>();
    if coordinates.groups().is_empty() {
        return beyond;
    }
    let far = coordinates.precisions().into_iter().zip(z);
    beyond + 0.5 * far.map(|(precision, z)| precision * z * z).sum::<f64>()
}

/// A point after a step, shortened where it is too long.
fn moved(shooting: &Shooting<'_>, point: &Point, dz: &[f64], ds: &[Vector4<f64>]) -> Point {
    let longest = dz
        .iter()
        .fold(LONGEST_STEP, |longest, dz| longest.max(dz.abs()));
    let share = LONGEST_STEP / longest;
    let aim: Vec<f64> = point
        .z
        .iter()
        .zip(dz)
        .map(|(z, dz)| z + share * dz)
        .collect();
    Point {
        z: shooting.coordinates.clip(&aim),
        states: shifted(&point.states, ds, share),
    }
}

fn shifted(states: &[State], ds: &[Vector4<f64>], share: f64) -> Vec<State> {
    let shifted =
        |(state, ds): (&State, &Vector4<f64>)| std::array::from_fn(|i| state[i] + share * ds[i]);
    states.iter().zip(ds).map(shifted).collect()
}

/// A point and draws of its start states around it, given roots of their covariance.
fn varied(
    point: Point,
    loose: &[Matrix4<f64>],
    count: usize,
    random: &mut ChaCha8Rng,
) -> Vec<Point> {
    let mut variants = vec![point];
    for _ in 1..count {
        let vary = |(state, loose): (&State, &Matrix4<f64>)| {
            let draw = Vector4::from_fn(|_, _| StandardNormal.sample(random));
            let step: Vector4<f64> = loose * draw;
            std::array::from_fn(|i| state[i] + step[i].clamp(-LONGEST_DRAW, LONGEST_DRAW))
        };
        let states = variants[0].states.iter().zip(loose).map(vary).collect();
        variants.push(Point {
            z: variants[0].z.clone(),
            states,
        });
    }
    variants
}

/// Simulates candidates from variants of their start states; each window takes its best one. Returns point,
/// residuals and loss of each candidate.
fn suited(
    shooting: &Shooting<'_>,
    candidates: Vec<Vec<Point>>,
    scales: &[f64],
) -> Result<Vec<(Point, Vec<f64>, f64)>> {
    let counts: Vec<usize> = candidates.iter().map(Vec::len).collect();
    let points: Vec<Point> = candidates.into_iter().flatten().collect();
    let residuals = shooting.residuals(&points)?;
    let (mut points, mut residuals) = (points.into_iter(), residuals.into_iter());
    let mut best_of = |count: usize, scale: f64| {
        let variants: Vec<(Point, Vec<f64>)> = points
            .by_ref()
            .take(count)
            .zip(residuals.by_ref())
            .collect();
        let (mut best, mut residual) = variants[0].clone();
        let mut total = outside(shooting, &best.z);
        for (i, window) in shooting.windows.all.iter().enumerate() {
            let own = window.residuals();
            let of_variant =
                |(_, residual): &(Point, Vec<f64>)| robust::loss(&residual[own.clone()], scale);
            let losses: Vec<f64> = variants.iter().map(of_variant).collect();
            let least = (0..count)
                .min_by(|&a, &b| losses[a].total_cmp(&losses[b]))
                .unwrap_or(0);
            best.states[i] = variants[least].0.states[i];
            residual[own.clone()].copy_from_slice(&variants[least].1[own.clone()]);
            total += losses[least];
        }
        (best, residual, total)
    };
    Ok(counts
        .into_iter()
        .zip(scales)
        .map(|(count, &scale)| best_of(count, scale))
        .collect())
}
