//! A tilt offset that differs from run to run.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

const fn parameter(name: &'static str, range: (f64, f64), means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "rad",
        range,
        neutral: 0.0,
        allowed: (if range.0 < 0.0 { -0.5 } else { 0.0 }, 0.5),
        time_power: -2,
        optional: false,
        reach: None,
        means,
    }
}

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "lean",
    stage: Stage::Board,
    acts: Hook::OnTilt,
    hypothesis: false,
    shrunk: true,
    noise: None,
    equation: "tilt = gear × knob + lean of this run, lean ~ size × N(0, 1)",
    parameters: &[
        parameter("lean_x_rad", (-0.03, 0.03), "tilt about x in this run while the knobs are level"),
        parameter("lean_y_rad", (-0.03, 0.03), "tilt about y in this run while the knobs are level"),
        parameter(
            "size_rad",
            (0.0, 0.03),
            "standard deviation of the lean over runs, the same about x and y; a rollout does not depend on it",
        ),
    ],
    does: "The board is tilted while its knobs are level, by another angle in each run: somebody leans on the table, the rig \
           was moved between sessions, or a servo finds a new zero at each homing.",
    matters: "As soon as the lean is comparable to the rolling resistance, in rigs whose runs were recorded hours or days \
              apart. Leans of 0.05 to 0.3 degrees have been observed.",
    looks: "A constant push within each run, with a direction that changes from run to run. One constant tilt_bias fits none \
            of them.",
    references: &[
        "Gelman, Carlin, Stern, Dunson, Vehtari, Rubin: Bayesian Data Analysis, 3rd ed., ch. 5 (hierarchical models)",
    ],
};

#[derive(Clone)]
pub(crate) struct Lean<S: Simd> {
    lean: Pair<S>,
}

impl<S: Simd> Effect<S> for Lean<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            lean: [values[0], values[1]],
        }
    }

    #[inline(always)]
    fn tilt(&self, tilt: &mut Pair<S>, _: &Pair<S>) {
        for (tilt, &lean) in tilt.iter_mut().zip(&self.lean) {
            *tilt = *tilt + lean;
        }
    }
}
