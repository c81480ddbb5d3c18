//! Whether a map learned in some recordings predicts the others.
//!
//! The evidence of a map supposes that nothing else is wrong with the model. On real rigs something is, and a map
//! of many coefficients explains that in a single run, where it is of no use in the next. So a map is let go only
//! where it does better than none in recordings that it was not fitted to: each half predicts the other.

use super::coordinates::Coordinates;
use super::descent::{End, Pace, minimise};
use super::problem::{Problem, Stretch};
use super::robust;
use super::search::Search;
use super::shooting::{Point, Shooting};
use super::shrinkage::evidence;
use super::slopes::Look;
use super::windows::Windows;
use crate::error::Result;

/// Steps of a fit to one half, before and after its size is estimated, and of start states in the other.
const FIT_ITERATIONS: usize = 10;
const STATE_ITERATIONS: usize = 6;
const VARIANTS: usize = 4;

impl Search<'_> {
    /// Whether maps that are held at zero at a solution predict recordings that they were not fitted to.
    pub(super) fn maps_predict(&self, coordinates: &Coordinates, best: &End) -> Result<bool> {
        let mut open = coordinates.clone();
        if !open.open_maps() {
            return Ok(false);
        }
        let Some(halves) = self.halves() else {
            return Ok(false);
        };
        let (mut with, mut without) = (0.0, 0.0);
        for (own, other) in [(0, 1), (1, 0)] {
            let train = Problem {
                stretches: &halves[own],
                ..*self.problem
            };
            let test = Problem {
                stretches: &halves[other],
                ..*self.problem
            };
            let z = self.fitted(&train, open.clone(), best)?;
            let left = [z, best.point.z.clone()].map(|z| self.left(&test, coordinates, z, best));
            let [with_map, without_map] = left;
            let (with_map, without_map) = (with_map?, without_map?);
            let scale = robust::scale(&without_map.1, &without_map.0.known);
            let scale = scale.max(self.whole.channels.floor);
            with += robust::loss(&with_map.1, scale);
            without += robust::loss(&without_map.1, scale);
        }
        Ok(with < without)
    }

    /// The stretches by turns of recordings, or of themselves where there is one recording; none of one stretch.
    fn halves(&self) -> Option<[Vec<Stretch>; 2]> {
        let stretches = self.problem.stretches;
        let first = stretches.first()?.recording;
        let alone = stretches.iter().all(|one| one.recording == first);
        let half = |side: usize| -> Vec<Stretch> {
            let all = stretches.iter().enumerate();
            let own = all.filter(|(i, one)| if alone { *i } else { one.recording } % 2 == side);
            own.map(|(_, one)| *one).collect()
        };
        let halves = [half(0), half(1)];
        let has_window = |half: &Vec<Stretch>| {
            let origins = half.iter().map(|one| (one.recording, one.first));
            let mut windows = self.whole.all.iter();
            let origins: Vec<(usize, usize)> = origins.collect();
            windows.any(|window| origins.contains(&(window.recording, window.first)))
        };
        halves.iter().all(has_window).then_some(halves)
    }

    /// Where a solution goes with its maps let go, in some of the stretches alone.
    fn fitted(&self, train: &Problem<'_>, mut open: Coordinates, best: &End) -> Result<Vec<f64>> {
        let windows = self.part(train);
        let mut point = self.inherited(&windows, best.point.z.clone(), best);
        for round in 0..2 {
            let shooting = Shooting::new(train, &open, &windows, 1.0, self.cancel);
            let points = std::slice::from_ref(&point);
            let floor = windows.channels.floor;
            let mut ends = self.counted(&shooting, |shooting| {
                minimise(
                    shooting,
                    points,
                    floor,
                    pace(FIT_ITERATIONS, false),
                    &|_| (),
                )
            })?;
            point = ends.remove(0).point;
            if round == 0 {
                let found = evidence(&shooting, &point, floor)?;
                for (group, found) in found.iter().enumerate() {
                    open.resize(group, found.size(), found.repetition);
                }
                point.z = open.shrunk(point.z);
            }
        }
        Ok(point.z)
    }

    /// What coordinates leave over in some of the stretches, where only start states are estimated.
    fn left(
        &self,
        test: &Problem<'_>,
        coordinates: &Coordinates,
        z: Vec<f64>,
        best: &End,
    ) -> Result<(Windows, Vec<f64>)> {
        let windows = self.part(test);
        let point = self.inherited(&windows, z, best);
        let shooting = Shooting::new(test, coordinates, &windows, 1.0, self.cancel);
        let points = std::slice::from_ref(&point);
        let floor = windows.channels.floor;
        let mut ends = self.counted(&shooting, |shooting| {
            minimise(
                shooting,
                points,
                floor,
                pace(STATE_ITERATIONS, true),
                &|_| (),
            )
        })?;
        Ok((windows, ends.remove(0).residual))
    }

    fn part(&self, problem: &Problem<'_>) -> Windows {
        Windows::cut(problem, &self.whole.channels, self.whole.rows)
    }

    fn inherited(&self, windows: &Windows, z: Vec<f64>, best: &End) -> Point {
        let states = windows.inherited(&self.whole, &best.point.states);
        Point { z, states }
    }
}

fn pace(iterations: usize, held: bool) -> Pace {
    Pace {
        iterations,
        look: Look::Both,
        variants: VARIANTS,
        held,
    }
}
