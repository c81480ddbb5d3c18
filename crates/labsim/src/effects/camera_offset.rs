//! A camera that is not centred on the board.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

const fn parameter(name: &'static str, means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "edge",
        range: (-0.1, 0.1),
        neutral: 0.0,
        allowed: (-10.0, 10.0),
        time_power: 0,
        optional: false,
        reach: None,
        means,
    }
}

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "camera_offset",
    stage: Stage::Sensing,
    acts: Hook::OnPicture,
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "seen = position + offset",
    parameters: &[
        parameter("x_edges", "tracked position of the board's centre along x"),
        parameter("y_edges", "tracked position of the board's centre along y"),
    ],
    does: "The tracker's zero is not the board's centre: the camera is off-centre, or was calibrated for another position.",
    matters: "At the rims, and together with effects that depend on the place. Elsewhere a shifted marble rolls like any \
              other.",
    looks: "A constant shift from row 0 on. Since a rollout starts at the tracked position, the shift shows only at the rims: \
            they are met too early on one side and too late on the other.",
    references: &["Hartley, Zisserman: Multiple View Geometry, 2nd ed., sect. 6.1 (principal point offset)"],
};

#[derive(Clone)]
pub(crate) struct CameraOffset<S: Simd> {
    offset: Pair<S>,
}

impl<S: Simd> Effect<S> for CameraOffset<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            offset: [values[0], values[1]],
        }
    }

    #[inline(always)]
    fn see(&self, seen: &mut Pair<S>, _: &Pair<S>) {
        for (seen, &offset) in seen.iter_mut().zip(&self.offset) {
            *seen = *seen + offset;
        }
    }
}
