//! Inertial forces on a marble in the frame of a turning board.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use pulp::Simd;

use super::{Effect, EffectSpec, Hook, Memory, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Pair, Push};

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "inertial_forces",
    stage: Stage::Board,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: false,
    shrunk: false,
    noise: None,
    equation: "acceleration = 5/7 [ω × (r × ω)] - radius dω/dt × ẑ, dω/dt = rate × (d tilt/dt - ω), in the board's plane",
    parameters: &[Parameter {
        name: "rate_per_s",
        unit: "1/s",
        range: (2.0, 200.0),
        neutral: 0.0,
        allowed: (0.0, 1e4),
        time_power: -1,
        optional: false,
        reach: None,
        means: "rate at which the board takes a new angle: 1 over the time constant of its turn",
    }],
    does: "A turning board throws the marble away from its axis, by the square of its rate of turn (centrifugal force). Where \
           the turn begins and ends, the marble stays behind, as its centre is a radius above the axes (Euler force). The \
           board follows its angles, however they come about, with a time constant.",
    matters: "Under commands that change much and often, as those of a controller, and near the rims. Under slow commands it is \
              below the tracker's noise.",
    looks: "The marble drifts away from the board's middle, the more the commands change. Each turn shifts it uphill by its \
            radius times the change of the tilt.",
    references: &[
        "Goldstein, Poole, Safko: Classical Mechanics, 3rd ed., sec. 4.10 (forces in a rotating frame)",
        "Weltner: Central drift of freely moving balls on rotating disks, American J. Physics 47, 1979 (a ball that rolls on a \
         turning plane)",
    ],
};

#[derive(Clone)]
pub(crate) struct InertialForces<S: Simd> {
    /// Rate at which the board follows (1/s).
    rate: Lanes<S>,
    /// 7/5 of the radius (m): the force at the centre that shifts a rolling marble by the radius.
    arm: f64,
    /// The angles in the last substep (rad); none before the first.
    tilt: Option<Pair<S>>,
    /// Angular velocity of the board about x and y (rad/s), and its change in this substep.
    velocity: Pair<S>,
    change: Pair<S>,
}

impl<S: Simd> Effect<S> for InertialForces<S> {
    fn new(simd: S, rig: &Rig, values: &[Lanes<S>]) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Self {
            rate: values[0],
            arm: 7.0 / 5.0 * rig.marble.radius_m,
            tilt: None,
            velocity: [zero; 2],
            change: [zero; 2],
        }
    }

    #[inline(always)]
    fn pass(&mut self, tilt: &Pair<S>, length: Lanes<S>) {
        let before = self.tilt.replace(*tilt).unwrap_or(*tilt);
        // Implicit, and so stable for any rate.
        let follows = self.rate.over(self.rate.like(1.0) + self.rate * length);
        for axis in 0..2 {
            let turn = tilt[axis] - before[axis] - self.velocity[axis] * length;
            self.change[axis] = follows * turn;
            self.velocity[axis] = self.velocity[axis] + self.change[axis];
        }
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let [about_x, about_y] = self.velocity;
        // r × ω is vertical, and ω × (r × ω) in the board's plane, across ω.
        let along = (marbles.x * about_y - marbles.y * about_x) * push.length;
        push.x = push.x + along * about_y - self.arm * self.change[1];
        push.y = push.y - along * about_x + self.arm * self.change[0];
    }
}
