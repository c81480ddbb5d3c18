//! A camera that views the board at an angle.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

/// A place comes no nearer to the camera than this part of the centre's distance.
const NEAREST: f64 = 0.05;

const fn parameter(name: &'static str, means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "1/edge",
        range: (-0.3, 0.3),
        neutral: 0.0,
        allowed: (-0.9, 0.9),
        time_power: 0,
        optional: false,
        reach: None,
        means,
    }
}

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "perspective",
    stage: Stage::Sensing,
    acts: Hook::OnPicture,
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "seen = position/(1 + p · position), in board edges from the centre",
    parameters: &[
        parameter(
            "slope_x",
            "p_x, relative growth of the distance to the camera per edge along x",
        ),
        parameter(
            "slope_y",
            "p_y, relative growth of the distance to the camera per edge along y",
        ),
    ],
    does: "One side of the board is farther from the camera than the other and looks smaller.",
    matters: "Away from the board's centre: the error grows with the square of the distance from it.",
    looks: "The scale changes linearly across the board. Straight paths stay straight, but motion at constant speed seems to \
            slow down or speed up.",
    references: &["Hartley, Zisserman: Multiple View Geometry, 2nd ed., sect. 2.4 (projective transformations)"],
};

#[derive(Clone)]
pub(crate) struct Perspective<S: Simd> {
    slope: Pair<S>,
}

impl<S: Simd> Effect<S> for Perspective<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            slope: [values[0], values[1]],
        }
    }

    #[inline(always)]
    fn see(&self, seen: &mut Pair<S>, _: &Pair<S>) {
        let one = seen[0].like(1.0);
        let distance = one + self.slope[0] * seen[0] + self.slope[1] * seen[1];
        let distance = distance.max(one.like(NEAREST));
        *seen = seen.map(|seen| seen.over(distance));
    }
}
