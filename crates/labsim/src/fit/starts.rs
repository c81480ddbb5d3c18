//! Start points of a search, and redraws during it.

use std::cmp::Ordering;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::coordinates::Coordinates;
use super::descent::{End, loss};
use super::problem::ParameterSpec;
use super::search::{COARSENESS, Search};
use super::settings::Settings;
use super::shooting::Point;
use super::windows::Windows;
use crate::effects::Parameter;
use crate::error::Result;
use crate::parameters::{GEAR_X, GEAR_Y};

/// Rows of the windows for screening start points, and number of draws per refined start point.
const SCREEN_ROWS: usize = 24;
const SCREENED_PER_START: usize = 32;
/// Number of redrawn values of an effect, per parameter.
const REDRAWN: usize = 64;

impl Search<'_> {
    /// Draws start points over the ranges and returns the best ones.
    pub(super) fn screen(&self, settings: &Settings) -> Result<(Coordinates, Vec<Vec<f64>>)> {
        let windows = Windows::cut(self.problem, &self.whole.channels, SCREEN_ROWS);
        let mut found: Option<(f64, Coordinates, Vec<Vec<f64>>)> = None;
        for senses in self.senses() {
            let coordinates = Coordinates::new(self.problem, senses)?;
            let drawn = self.drawn(&coordinates, settings);
            let points: Vec<Point> = drawn
                .into_iter()
                .map(|z| Point {
                    z,
                    states: windows.guesses(),
                })
                .collect();
            let shooting = self.shooting(&coordinates, &windows, COARSENESS);
            let errors: Vec<f64> = self
                .counted(&shooting, |shooting| shooting.residuals(&points))?
                .iter()
                .map(|residual| residual.iter().map(|r| r.abs()).sum())
                .collect();
            let given = self.given(&coordinates).is_some();
            let mut order: Vec<usize> = (usize::from(given)..points.len()).collect();
            order.sort_by(|&a, &b| errors[a].total_cmp(&errors[b]));
            if given {
                order.insert(0, 0);
            }
            order.truncate(settings.starts);
            let least = order
                .iter()
                .map(|&i| errors[i])
                .fold(f64::INFINITY, f64::min);
            if found.as_ref().is_none_or(|(error, ..)| least < *error) {
                let best = order.iter().map(|&i| points[i].z.clone()).collect();
                found = Some((least, coordinates, best));
            }
        }
        let (_, coordinates, starts) = found.expect("a gear's range lies on a side of zero");
        Ok((coordinates, starts))
    }

    /// The signs of the gears to search.
    fn senses(&self) -> Vec<[f64; 2]> {
        let of_gear = |slot: usize| match self.problem.parameters[slot] {
            ParameterSpec::Held(value) => vec![if value < 0.0 { -1.0 } else { 1.0 }],
            ParameterSpec::Free {
                start: Some(start), ..
            } if start != 0.0 => vec![start.signum()],
            ParameterSpec::Free {
                range: (low, high), ..
            } => {
                let sides = [(high > 0.0).then_some(1.0), (low < 0.0).then_some(-1.0)];
                sides.into_iter().flatten().collect()
            }
        };
        let (x, y) = (of_gear(GEAR_X), of_gear(GEAR_Y));
        x.iter()
            .flat_map(|&x| y.iter().map(move |&y| [x, y]))
            .collect()
    }

    /// The start point, if there is one for every free parameter.
    fn given(&self, coordinates: &Coordinates) -> Option<Vec<f64>> {
        let slots = coordinates.slots();
        let value = |(slot, sought): (usize, ParameterSpec)| match sought {
            ParameterSpec::Held(value) => Some(value),
            ParameterSpec::Free { start, range } => {
                start.or((!slots.contains(&slot)).then_some(range.0))
            }
        };
        let values: Option<Vec<f64>> = self.problem.sought().enumerate().map(value).collect();
        values.map(|values| coordinates.to_z(&values))
    }

    /// Start points over the ranges: the given one first; if it fixes only some parameters, every second draw
    /// has their values.
    fn drawn(&self, coordinates: &Coordinates, settings: &Settings) -> Vec<Vec<f64>> {
        let given = self.given(coordinates);
        let count = match given {
            Some(_) => (settings.starts - 1) * SCREENED_PER_START,
            None => settings.starts * SCREENED_PER_START,
        };
        let partly = given.is_none();
        let mut points: Vec<Vec<f64>> = given.into_iter().collect();
        for (i, place) in space_filling(count, coordinates.drawn_axes(), settings.seed)
            .into_iter()
            .enumerate()
        {
            let mut values = coordinates.drawn(&place);
            for (slot, sought) in self.problem.sought().enumerate() {
                if let (
                    ParameterSpec::Free {
                        start: Some(start), ..
                    },
                    true,
                ) = (sought, partly && i % 2 == 0)
                {
                    values[slot] = start;
                }
            }
            points.push(coordinates.to_z(&values));
        }
        points
    }

    /// Replaces the worse half of the candidates by draws of effects' values around the best one.
    ///
    /// Slopes do not lead to a local effect from elsewhere on the board. But if all other values are nearly right,
    /// a draw near it has a clearly lower loss. Effects with one or two parameters, wide angles not counted,
    /// need no draws; without other effects there are none.
    pub(super) fn redrawn(
        &self,
        coordinates: &Coordinates,
        windows: &Windows,
        ends: &[End],
    ) -> Result<Option<Vec<End>>> {
        let shooting = self.shooting(coordinates, windows, COARSENESS);
        let scale = windows.smallest_scale(ends.iter().map(|end| end.residual.as_slice()));
        let mut ends = ends.to_vec();
        ends.sort_by_key(|end| Total(loss(&shooting, &end.point.z, &end.residual, scale)));
        let count = ends.len();
        let best = ends[0].clone();
        let mut found = Vec::new();
        let effects = self.problem.effects.iter();
        let effects = effects.zip(self.problem.slots_of_effects());
        for (_, slots) in effects.filter(|(one, _)| !one.effect.shrunk) {
            let free = slots.filter_map(|slot| {
                let (_, parameter) = self.problem.effect_parameter(slot)?;
                Some((coordinates.find(slot)?, parameter))
            });
            let (axes, parameters): (Vec<usize>, Vec<&Parameter>) = free.unzip();
            if parameters.iter().filter(|one| !one.is_wide()).count() < 3 {
                continue;
            }
            let drawn = space_filling(REDRAWN * axes.len(), axes.len(), 0);
            let points: Vec<Point> = drawn
                .iter()
                .map(|place| {
                    let mut point = best.point.clone();
                    for (&axis, &place) in axes.iter().zip(place) {
                        point.z[axis] = coordinates.within(axis, place);
                    }
                    point
                })
                .collect();
            let residuals = self.counted(&shooting, |shooting| shooting.residuals(&points))?;
            found.extend(points.into_iter().zip(residuals).map(|(point, residual)| {
                let mut path = best.path.clone();
                path.push(point.z.clone());
                End {
                    point,
                    residual,
                    path,
                }
            }));
        }
        if found.is_empty() {
            return Ok(None);
        }
        ends.truncate(count.div_ceil(2));
        found.sort_by_key(|end| Total(loss(&shooting, &end.point.z, &end.residual, scale)));
        ends.extend(found.into_iter().take(count));
        Ok(Some(ends))
    }
}

/// A sort key for a number.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Total(f64);

impl Eq for Total {}

impl PartialOrd for Total {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Total {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0)
    }
}

/// Points that fill the unit cube: the recurrence R of Roberts (2018), shifted.
fn space_filling(count: usize, dimensions: usize, seed: u64) -> Vec<Vec<f64>> {
    let power = 1.0 / (dimensions as f64 + 1.0);
    let ratio = (0..64).fold(1.0f64, |ratio, _| (1.0 + ratio).powf(power));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let shift: Vec<f64> = (0..dimensions)
        .map(|_| (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64)
        .collect();
    let place = |i: usize, axis: usize| {
        let step = ratio.powf(-(axis as f64 + 1.0));
        (shift[axis] + step * i as f64).fract()
    };
    (1..=count)
        .map(|i| (0..dimensions).map(|axis| place(i, axis)).collect())
        .collect()
}
