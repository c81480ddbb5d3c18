//! A camera that is rotated about its line of sight.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "camera_rotation",
    stage: Stage::Sensing,
    acts: Hook::OnPicture,
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "seen = (x cos a - y sin a, x sin a + y cos a)",
    parameters: &[Parameter {
        name: "angle_rad",
        unit: "rad",
        range: (-0.1745, 0.1745),
        neutral: 0.0,
        allowed: (-100.0, 100.0),
        time_power: 0,
        optional: false,
        reach: None,
        means: "a, angle of the picture about the board's centre, from x towards y",
    }],
    does: "The camera is rotated about its line of sight, so that the picture's axes are not the board's.",
    matters: "In every run: the error is the angle times the distance from the board's centre.",
    looks: "The whole picture is rotated by the same angle at all times. Each knob seems to move the marble along both axes. \
            The rims appear rotated too, which they do not with cross_coupling.",
    references: &["Hartley, Zisserman: Multiple View Geometry, 2nd ed., sect. 2.4 (isometries)"],
};

#[derive(Clone)]
pub(crate) struct CameraRotation<S: Simd> {
    cos: Lanes<S>,
    sin: Lanes<S>,
}

impl<S: Simd> Effect<S> for CameraRotation<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let (sin, cos) = values[0].sin_cos_of_any();
        Self { cos, sin }
    }

    #[inline(always)]
    fn see(&self, seen: &mut Pair<S>, _: &Pair<S>) {
        let [x, y] = *seen;
        *seen = [
            x * self.cos - y * self.sin,
            x * self.sin + y * self.cos,
        ];
    }
}
