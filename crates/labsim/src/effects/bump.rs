//! One bump or dent of the board.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Memory, Parameter, Stage};
use crate::board::{GRAVITY, Rig};
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "bump",
    stage: Stage::Board,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: true,
    shrunk: false,
    equation: "height = h exp(-r²/(2 w²)), acceleration = -g grad(height)",
    parameters: &[
        Parameter::on_board("x_m", 0.138, "where it is, along x"),
        Parameter::on_board("y_m", 0.1155, "where it is, along y"),
        Parameter {
            name: "height_m",
            unit: "m",
            range: (-5e-4, 5e-4),
            neutral: 0.0,
            allowed: (-0.1, 0.1),
            time_power: -2,
            optional: false,
            reach: None,
            means: "height at its middle; a dent's is negative",
        },
        Parameter {
            name: "width_m",
            unit: "m",
            range: (0.005, 0.04),
            neutral: 0.02,
            allowed: (1e-4, 10.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "w, the distance at which 61 % of the height are left",
        },
    ],
    does: "A place of the board stands out or is pressed in by fractions of a millimetre; the marble is slowed and sped up, and turned aside.",
    matters: "On the runs that pass it, most where the marble is slow.",
    looks: "Local and repeatable; it pushes along the slope whatever the marble's direction, which a patch of other friction does not.",
    references: &["Goldstein: Classical Mechanics, 3rd ed., sect. 1.4 (constraint to a surface)"],
};

#[derive(Clone)]
pub(crate) struct Bump<S: Simd> {
    x: Lanes<S>,
    y: Lanes<S>,
    /// 1/(2 w²)
    sharpness: Lanes<S>,
    /// g h/w²
    steepness: Lanes<S>,
}

impl<S: Simd> Effect<S> for Bump<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let [x, y, height, width] = [values[0], values[1], values[2], values[3]];
        let sharpness = x.like(0.5).over(width * width);
        Self {
            x,
            y,
            sharpness,
            steepness: 2.0 * GRAVITY * (height * sharpness),
        }
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let (dx, dy) = (marbles.x - self.x, marbles.y - self.y);
        let fall = (-((dx * dx + dy * dy) * self.sharpness)).exp_decay();
        let strength = self.steepness * fall * push.length;
        push.x = push.x + strength * dx;
        push.y = push.y + strength * dy;
    }
}
