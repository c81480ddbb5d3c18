//! The picture shifts as the board tilts.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "parallax",
    stage: Stage::Sensing,
    acts: Hook::OnPicture,
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "seen = position + height × (tilt_y, -tilt_x)",
    parameters: &[Parameter {
        name: "height_m_per_rad",
        unit: "m/rad",
        range: (-0.6, 0.6),
        neutral: 0.0,
        allowed: (-100.0, 100.0),
        time_power: 2,
        optional: false,
        reach: None,
        means: "shift of the picture per radian of tilt: height of the board above its axes",
    }],
    does: "The camera stands still while the board tilts. A board above or below its axes moves sideways in the picture.",
    matters: "With a tall gimbal, or with a camera that looks from the side. The shift grows with the tilt.",
    looks: "An immediate response to the command, before the marble has moved, in the shape of the command itself.",
    references: &["Hartley, Zisserman: Multiple View Geometry, 2nd ed., sect. 6.1"],
};

#[derive(Clone)]
pub(crate) struct Parallax<S: Simd> {
    /// Board edges per rad.
    height: Lanes<S>,
}

impl<S: Simd> Effect<S> for Parallax<S> {
    fn new(_: S, rig: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            height: 1.0 / rig.board.edge_x_m * values[0],
        }
    }

    #[inline(always)]
    fn see(&self, seen: &mut Pair<S>, tilt: &Pair<S>) {
        seen[0] = seen[0] + self.height * tilt[1];
        seen[1] = seen[1] - self.height * tilt[0];
    }
}
