//! The board is a shallow bowl, saddle or twist.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Memory, Parameter, Stage};
use crate::board::{GRAVITY, Rig};
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

const fn parameter(name: &'static str, means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "1/m",
        range: (-0.15, 0.15),
        neutral: 0.0,
        allowed: (-100.0, 100.0),
        time_power: -2,
        optional: false,
        reach: None,
        means,
    }
}

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "board_warp",
    stage: Stage::Board,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "height = (c_xx x² + 2 c_xy x y + c_yy y²)/2, acceleration = -g grad(height)",
    parameters: &[
        parameter("curvature_xx_per_m", "c_xx, curvature along x; positive as in a bowl"),
        parameter("curvature_xy_per_m", "c_xy, twist; positive where the corners with x y > 0 stand up"),
        parameter("curvature_yy_per_m", "c_yy, curvature along y; positive as in a bowl"),
    ],
    does: "The board has bent under its weight or with the weather, so that its slope changes in proportion to the distance \
           from its centre. A curvature of 0.1 1/m lifts the ends of the paper's board by a millimetre.",
    matters: "In runs that leave the middle, and in slow ones: at the edge, 0.1 1/m equals a tilt of 14 mrad.",
    looks: "A force linear in the position and independent of the command. In a bowl the marble oscillates about the middle \
            with the frequency √(5/7 g c)/2π; from a dome it rolls away. A model without the warp fits a rolling friction that \
            is too high or too low.",
    references: &[
        "do Carmo: Differential Geometry of Curves and Surfaces, 1976, ch. 3 (the second fundamental form)",
        "Goldstein: Classical Mechanics, 3rd ed., ch. 6 (oscillations)",
    ],
};

#[derive(Clone)]
pub(crate) struct BoardWarp<S: Simd> {
    /// g times each curvature (1/s²).
    xx: Lanes<S>,
    xy: Lanes<S>,
    yy: Lanes<S>,
}

impl<S: Simd> Effect<S> for BoardWarp<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            xx: GRAVITY * values[0],
            xy: GRAVITY * values[1],
            yy: GRAVITY * values[2],
        }
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let (x, y) = (marbles.x, marbles.y);
        push.x = push.x - (self.xx * x + self.xy * y) * push.length;
        push.y = push.y - (self.xy * x + self.yy * y) * push.length;
    }
}
