//! Cross-validation of maps: whether a map that is fitted to some recordings predicts the others.
//!
//! The evidence of a map assumes that the rest of the model is right. On real rigs it is not, and a map of many
//! coefficients absorbs other errors of a single run without predicting the next. Therefore a map is released only
//! if it improves the prediction of recordings that it was not fitted to: each half predicts the other.

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

    /// Two halves of the stretches, alternating by recording, or by stretch if there is one recording; none for one
    /// stretch.
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

    /// A solution refined with released maps on some of the stretches.
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

    /// Residuals at coordinates in some of the stretches, with only the start states estimated.
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
