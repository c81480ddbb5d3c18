//! A camera that views the board at an angle.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

/// A place comes no nearer to the camera than this part of the centre's distance.
const NEAREST: f64 = 0.05;

/// Square of the sine of the largest tilt, 60 degrees: the picture of a board that is seen edge-on has no inverse.
const STEEPEST: f64 = 0.75;

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
    equation: "seen = (q - (1 - cos t) (q · p) p/|p|²)/(1 + p · q), sin t = d |p|, q: position in board edges from the centre",
    parameters: &[
        parameter(
            "slope_x",
            "p_x, relative growth of the distance to the camera per edge along x",
        ),
        parameter(
            "slope_y",
            "p_y, relative growth of the distance to the camera per edge along y",
        ),
        Parameter {
            name: "distance_edges",
            unit: "edge",
            range: (0.0, 4.0),
            neutral: 0.0,
            allowed: (0.0, 100.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "d, distance of the camera from the board's centre, which with p gives the tilt t (at most 60 degrees); 0 for a picture \
                    that is not foreshortened",
        },
    ],
    does: "The camera looks at an angle: one side of the board is farther away than the other and looks smaller, and the \
           board looks shorter along the tilt.",
    matters: "Away from the board's centre: the error grows with the square of the distance from it, and for large tilts with \
              the distance.",
    looks: "The scale changes linearly across the board. Straight paths stay straight, but motion at constant speed seems to \
            slow down or speed up.",
    references: &["Hartley, Zisserman: Multiple View Geometry, 2nd ed., sect. 6.1 and 8.1 (the camera model; its action on planes)"],
};

#[derive(Clone)]
pub(crate) struct Perspective<S: Simd> {
    slope: Pair<S>,
    /// (1 - cos t)/|p|² (edge²).
    shorter: Lanes<S>,
}

impl<S: Simd> Effect<S> for Perspective<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let (slope, distance) = ([values[0], values[1]], values[2]);
        let one = distance.like(1.0);
        let steepness = slope[0] * slope[0] + slope[1] * slope[1];
        let square = (distance * distance).min(one.like(STEEPEST).over(steepness));
        // (1 - cos t)/|p|² = d²/(1 + cos t), which holds without a tilt, too.
        let cos = (one - square * steepness).sqrt();
        Self {
            slope,
            shorter: square.over(one + cos),
        }
    }

    #[inline(always)]
    fn see(&self, seen: &mut Pair<S>, _: &Pair<S>) {
        let one = seen[0].like(1.0);
        let along = self.slope[0] * seen[0] + self.slope[1] * seen[1];
        let distance = (one + along).max(one.like(NEAREST));
        let shorter = self.shorter * along;
        *seen = [0, 1].map(|axis| (seen[axis] - shorter * self.slope[axis]).over(distance));
    }
}
