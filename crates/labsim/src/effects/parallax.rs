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
        means: "shift of the picture for a radian of tilt: how high the board lies above the axes it turns about",
    }],
    does: "The camera stands still while the board tilts: a board that does not lie in its axes moves sideways in the picture.",
    matters: "With a tall gimbal or a camera that looks from the side; it grows with the tilt.",
    looks: "An answer to the command at once, before the marble has moved, with the command's own shape.",
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
