//! The rim throws the marble back more or less than the rig says.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Rims;

/// A rim that is not perfect already does not become so.
const LIVELIEST: f64 = 0.95;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "wall_restitution",
    stage: Stage::Contact,
    acts: Hook::OnRims,
    hypothesis: true,
    shrunk: false,
    equation: "v_n after = -clamp(wall_restitution + increase, 0, 0.95) × v_n before",
    parameters: &[Parameter {
        name: "increase",
        unit: "",
        range: (-0.9, 0.9),
        neutral: 0.0,
        allowed: (-1.0, 1.0),
        time_power: 0,
        optional: false,
        reach: None,
        means: "what the rim's restitution is more than the rig's",
    }],
    does: "The rim returns more or less of the normal speed than the rig says: hard wood, felt or rubber.",
    matters: "From the first contact with the rim on; runs that stay inside know nothing of it.",
    looks: "No error before the marble meets a wall, then one that stays: the marble lies at the rim where it should have come \
            back, or the other way round.",
    references: &[
        "Stronge: Impact Mechanics, Cambridge University Press, 2000",
        "Johnson: Contact Mechanics, Cambridge University Press, 1985, ch. 11 (dynamic effects and impact)",
    ],
};

#[derive(Clone)]
pub(crate) struct WallRestitution<S: Simd> {
    increase: Lanes<S>,
}

impl<S: Simd> Effect<S> for WallRestitution<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            increase: values[0],
        }
    }

    fn rims(&self, rims: &mut Rims<S>) {
        let before = rims.restitution;
        let most = before.max(before.like(LIVELIEST));
        rims.restitution = (before + self.increase).max(before.like(0.0)).min(most);
    }
}
