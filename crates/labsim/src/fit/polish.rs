//! Refinement of the best candidate: its family, its neighbourhood, a whole number of physics updates.

use rand_chacha::ChaCha8Rng;

use super::coordinates::Coordinates;
use super::descent::{End, search_nearby};
use super::search::Search;
use super::shooting::Point;
use crate::error::Result;
use crate::parameters::TIME;

pub(super) const FAMILY_ITERATIONS: usize = 6;
pub(super) const SETTLE_ITERATIONS: usize = 5;
/// Batches drawn of the best one's surroundings in each round.
const NEARBY_ROUNDS: usize = 3;
/// A whole number of physics updates is taken where the log-likelihood does not fall by more.
const TIE: f64 = 0.5;

impl Search<'_> {
    /// Refines members of a candidate's family: the same motion in other numbers of physics updates.
    ///
    /// Without walls the members differ by the length of an update alone; with them a little more. Those
    /// within the ranges come first.
    pub(super) fn family(
        &self,
        coordinates: &Coordinates,
        candidate: &End,
        count: usize,
    ) -> Result<Vec<End>> {
        let (bottom, top) = coordinates.time_scales().unwrap_or((1.0, 0.0));
        let (bottom, top) = (bottom.ceil() as usize, top.floor() as usize);
        let members = (bottom..=top).filter_map(|updates| {
            let z = coordinates.along_time(&candidate.point.z, updates as f64)?;
            is_within(coordinates, &z).then_some(z)
        });
        let mut members: Vec<Vec<f64>> = members.collect();
        let inside = |z: &Vec<f64>| coordinates.excess(z).iter().all(|excess| *excess == 0.0);
        if members.iter().any(inside) {
            members.retain(inside);
        }
        let points: Vec<Point> = members
            .into_iter()
            .map(|z| Point {
                z,
                states: candidate.point.states.clone(),
            })
            .collect();
        let shooting = self.shooting(coordinates, &self.whole, 1.0);
        let residuals = self.counted(&shooting, |shooting| shooting.residuals(&points))?;
        let member = |(point, residual): (Point, Vec<f64>)| {
            let mut path = candidate.path.clone();
            path.push(point.z.clone());
            End {
                point,
                residual,
                path,
            }
        };
        let members = points.into_iter().zip(residuals).map(member).collect();
        let mut members = self.ranked(coordinates, members);
        members.truncate(count);
        self.refined(coordinates, members, FAMILY_ITERATIONS)
    }

    /// Searches around a candidate for a better one, and refines that.
    pub(super) fn settled(
        &self,
        coordinates: &Coordinates,
        mut candidate: End,
        random: &mut ChaCha8Rng,
    ) -> Result<End> {
        let shooting = self.shooting(coordinates, &self.whole, 1.0);
        candidate.point = self.counted(&shooting, |shooting| {
            search_nearby(
                shooting,
                candidate.point.clone(),
                self.whole.channels.floor,
                NEARBY_ROUNDS,
                random,
            )
        })?;
        candidate.path.push(candidate.point.z.clone());
        Ok(self
            .refined(coordinates, vec![candidate], SETTLE_ITERATIONS)?
            .remove(0))
    }

    /// Moves to a whole number of physics updates if the likelihood allows it. There a model is the same whether
    /// the time scale is rounded, as in the paper, or not.
    pub(super) fn rounded(&self, coordinates: &Coordinates, candidate: End) -> Result<End> {
        let time_scale = coordinates.to_values(&candidate.point.z)[TIME]
            .round()
            .max(1.0);
        let Some(z) = coordinates.along_time(&candidate.point.z, time_scale) else {
            return Ok(candidate);
        };
        let point = Point {
            z: z.clone(),
            states: candidate.point.states.clone(),
        };
        let shooting = self.shooting(coordinates, &self.whole, 1.0);
        let points = std::slice::from_ref(&point);
        let residual = self
            .counted(&shooting, |shooting| shooting.residuals(points))?
            .remove(0);
        let losses = self.losses(&[&candidate.residual, &residual]);
        if losses[1] > losses[0] + TIE || !is_within(coordinates, &z) {
            return Ok(candidate);
        }
        let mut path = candidate.path;
        path.push(z);
        Ok(End {
            point,
            residual,
            path,
        })
    }
}

fn is_within(coordinates: &Coordinates, z: &[f64]) -> bool {
    let clipped = coordinates.clip(z);
    clipped
        .iter()
        .zip(z)
        .all(|(clipped, z)| (clipped - z).abs() < 1e-9)
}
