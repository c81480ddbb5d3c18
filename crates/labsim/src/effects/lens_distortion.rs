//! Radial distortion of the camera's lens.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

/// Square of the distance (edges) from which on the scale stays what it is: behind the board's
/// corners, and before the strongest barrel folds the picture over at 1/(3 |k|).
const OUTSIDE: f64 = 0.5;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "lens_distortion",
    stage: Stage::Sensing,
    acts: Hook::OnPicture,
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "seen = position × (1 + k r²), r in board edges from the centre",
    parameters: &[Parameter {
        name: "k_per_edge2",
        unit: "1/edge²",
        range: (-0.5, 0.5),
        neutral: 0.0,
        allowed: (-0.6, 10.0),
        time_power: 0,
        optional: false,
        reach: None,
        means: "k, relative change of the scale at a distance of one edge; negative for a barrel",
    }],
    does: "The lens magnifies the margin of the picture more than the middle (pincushion) or less (barrel).",
    matters: "Near the rim and in the corners; in the middle the error vanishes.",
    looks: "The error is greatest at the edges and the same in all directions. Straight paths that do not pass through the \
            middle appear bent, and the board seems too small or too large.",
    references: &[
        "Hartley, Zisserman: Multiple View Geometry, 2nd ed., sect. 7.4 (radial distortion)",
        "Brown: Close-range camera calibration, Photogrammetric Engineering 37(8), 1971",
    ],
};

#[derive(Clone)]
pub(crate) struct LensDistortion<S: Simd> {
    k: Lanes<S>,
}

impl<S: Simd> Effect<S> for LensDistortion<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self { k: values[0] }
    }

    #[inline(always)]
    fn see(&self, seen: &mut Pair<S>, _: &Pair<S>) {
        let square = (seen[0] * seen[0] + seen[1] * seen[1]).min(self.k.like(OUTSIDE));
        let scale = square.like(1.0) + self.k * square;
        *seen = seen.map(|seen| seen * scale);
    }
}
