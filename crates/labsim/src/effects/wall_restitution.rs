//! The law of impacts with the rim: restitution and friction.

use pulp::Simd;

use super::{Effect, EffectSpec, Hook, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{LIVELIEST, Rims};

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "wall_restitution",
    stage: Stage::Contact,
    acts: Hook::OnRims,
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "v_n after = -e v_n before, e = clamp(wall_restitution + increase, 0, 0.95) × (|v_n| before / 0.1 m/s)^-falloff, at \
               most 0.95; friction ≤ max(0, wall_friction + friction_increase) × normal impulse",
    parameters: &[
        Parameter {
            name: "increase",
            unit: "",
            range: (-0.9, 0.9),
            neutral: 0.0,
            allowed: (-1.0, 1.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "restitution of the rim at 0.1 m/s minus that of the rig file",
        },
        Parameter {
            name: "falloff",
            unit: "",
            range: (0.0, 1.0),
            neutral: 0.0,
            allowed: (-1.0, 1.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "exponent with which the restitution falls as the approach speed rises: 0 at the same restitution for all \
                    speeds, 1/4 for plastic impacts, more for damped contacts",
        },
        Parameter {
            name: "friction_increase",
            unit: "",
            range: (-0.5, 0.75),
            neutral: 0.0,
            allowed: (-10.0, 10.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "Coulomb's coefficient of the rim minus that of the rig file",
        },
    ],
    does: "The rim returns more or less of the normal velocity than the rig file says, and rubs more or less: hard wood, felt \
           or rubber. Most rims return a larger share of a slow marble's speed than of a fast one's.",
    matters: "From the first contact with the rim on. Runs that never touch it are not affected.",
    looks: "No error before the marble meets a wall, then a lasting one: the marble stays at the rim where it should have \
            rebounded, or the reverse.",
    references: &[
        "Stronge: Impact Mechanics, Cambridge University Press, 2000",
        "Johnson: Contact Mechanics, Cambridge University Press, 1985, ch. 11 (dynamic effects and impact)",
        "Hunt, Crossley: Coefficient of restitution interpreted as damping in vibroimpact, J. Applied Mechanics 42(2), 1975",
    ],
};

#[derive(Clone)]
pub(crate) struct WallRestitution<S: Simd> {
    increase: Lanes<S>,
    falloff: Lanes<S>,
    friction_increase: Lanes<S>,
}

impl<S: Simd> Effect<S> for WallRestitution<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            increase: values[0],
            falloff: values[1],
            friction_increase: values[2],
        }
    }

    fn rims(&self, rims: &mut Rims<S>) {
        let before = rims.restitution.at_reference;
        let zero = before.like(0.0);
        // A rim that is perfect stays so, and no other becomes so.
        let most = before.max(before.like(LIVELIEST));
        rims.restitution.at_reference = (before + self.increase).max(zero).min(most);
        rims.restitution.falloff = self.falloff;
        rims.friction = (rims.friction + self.friction_increase).max(zero);
    }
}
