//! Friction of the board against spin about the vertical.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "spinning_friction",
    stage: Stage::Contact,
    acts: Hook::OnSpin,
    hypothesis: false,
    shrunk: false,
    noise: None,
    equation: "dω_z/dt = -sign(ω_z) × 5/2 (spinning_friction + increase) g/r",
    parameters: &[Parameter {
        name: "increase",
        unit: "",
        range: (1e-5, 0.02),
        neutral: 0.0,
        allowed: (0.0, 1.0),
        time_power: 0,
        optional: false,
        reach: None,
        means: "increase of torque/(weight × radius) over the rig's value",
    }],
    does: "Marble and board touch in a small disc, whose friction slows down a spin about the vertical. The rim's friction \
           causes that spin. A marble that rolls along a rim spins all the time.",
    matters: "From the first contact with the rim on. Steel on wood has 0.0003 to 0.001; above 0.02 every spin ends at once.",
    looks: "No error before the marble meets a wall. After that it rolls along walls too fast, and leaves the second wall at \
            another speed and angle.",
    references: &[
        "Johnson: Contact Mechanics, Cambridge University Press, 1985, sec. 3.9 (torsion of a contact disc)",
        "Todorov: MuJoCo, Computation: contact, torsional friction",
    ],
};

#[derive(Clone)]
pub(crate) struct SpinningFriction<S: Simd> {
    increase: Lanes<S>,
}

impl<S: Simd> Effect<S> for SpinningFriction<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            increase: values[0],
        }
    }

    fn spin(&self, friction: &mut Lanes<S>) {
        *friction = *friction + self.increase;
    }
}
