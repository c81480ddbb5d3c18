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
    noise: None,
    equation: "height = h exp(-r²/(2 w²)), acceleration = -g grad(height)",
    parameters: &[
        Parameter::on_board("x_m", 0.138, "its centre along x"),
        Parameter::on_board("y_m", 0.1155, "its centre along y"),
        Parameter {
            name: "height_m",
            unit: "m",
            range: (-5e-4, 5e-4),
            neutral: 0.0,
            allowed: (-0.1, 0.1),
            time_power: -2,
            optional: false,
            reach: None,
            means: "height at its centre; negative for a dent",
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
            means: "w, standard deviation of its profile: distance at which the height is 61 % of that at the centre",
        },
    ],
    does: "One place of the board is raised or dented by fractions of a millimetre. It slows the marble down, speeds it up and \
           deflects it.",
    matters: "In runs that pass the place, most where the marble is slow.",
    looks: "Local and repeatable. The push is along the slope and does not depend on the marble's direction, unlike that of a \
            patch of other friction.",
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
