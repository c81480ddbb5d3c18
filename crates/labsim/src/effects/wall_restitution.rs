//! A correction of the rim's restitution.

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
        means: "restitution of the rim minus that of the rig file",
    }],
    does: "The rim returns more or less of the normal velocity than the rig file says: hard wood, felt or rubber.",
    matters: "From the first contact with the rim on. Runs that never touch it are not affected.",
    looks: "No error before the marble meets a wall, then a lasting one: the marble stays at the rim where it should have \
            rebounded, or the reverse.",
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
