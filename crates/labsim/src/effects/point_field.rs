//! Attraction to a point, or repulsion from it.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Memory, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

const fn place(name: &'static str, means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "m",
        range: (-0.3, 0.3),
        neutral: 0.0,
        allowed: (-10.0, 10.0),
        time_power: 0,
        optional: false,
        reach: None,
        means,
    }
}

/// How far below the board, or above, the point lies (m).
const DEPTH_M: f64 = 0.03;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "point_field",
    stage: Stage::Field,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "acceleration = k d/(|d|² + (30 mm)²)^(3/2), d along the board from the marble to the point",
    parameters: &[
        place("x_m", "where the point is, along x"),
        place("y_m", "where the point is, along y"),
        Parameter {
            name: "strength_m3_per_s2",
            unit: "m³/s²",
            range: (-0.003, 0.003),
            neutral: 0.0,
            allowed: (-1.0, 1.0),
            time_power: -2,
            optional: false,
            reach: None,
            means: "k, force per mass times the squared distance, far away; positive attracts",
        },
    ],
    does: "A magnet, a charge or an air jet on or beside the board attracts or repels the marble with the inverse square of \
           the distance. The source is assumed to lie three centimetres below or above the board.",
    matters: "Within some centimetres of the point. Marbles with little rolling resistance are moved from farther away.",
    looks: "Forces that all point to one place and depend neither on the marble's speed nor on the command. The point may lie \
            outside the rim, where no bump of the board can.",
    references: &[
        "Griffiths: Introduction to Electrodynamics, 4th ed., sect. 2.1 (Coulomb's law)",
        "Binney, Tremaine: Galactic Dynamics, 2nd ed., sect. 2.2.2 (Plummer's softened point)",
    ],
};

#[derive(Clone)]
pub(crate) struct PointField<S: Simd> {
    x: Lanes<S>,
    y: Lanes<S>,
    strength: Lanes<S>,
}

impl<S: Simd> Effect<S> for PointField<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            x: values[0],
            y: values[1],
            strength: values[2],
        }
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let (dx, dy) = (self.x - marbles.x, self.y - marbles.y);
        let square = dx * dx + dy * dy + dx.like(DEPTH_M * DEPTH_M);
        let pull = (self.strength * push.length).over(square * square.sqrt());
        push.x = push.x + pull * dx;
        push.y = push.y + pull * dy;
    }
}
