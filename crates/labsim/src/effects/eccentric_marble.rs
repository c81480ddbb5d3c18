//! The marble's centre of mass is not in its middle.

use pulp::Simd;

use super::{About, Acts, Effect, Parameter, Stage};
use crate::board::{GRAVITY, Rig};
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

pub(super) const ABOUT: About = About {
    name: "eccentric_marble",
    stage: Stage::Contact,
    acts: Acts::OnMarble,
    equation: "acceleration = offset [(g + ω²R) u - R ω (ω · u)] along the board, du/dt = ω × u",
    parameters: &[
        Parameter {
            name: "offset",
            unit: "",
            range: (0.0, 0.01),
            neutral: 0.0,
            allowed: (0.0, 0.5),
            means: "distance of the centre of mass from the marble's middle, over the radius",
        },
        Parameter {
            name: "phase_rad",
            unit: "rad",
            range: (0.0, std::f64::consts::TAU),
            neutral: 0.0,
            allowed: (-100.0, 100.0),
            means: "angle of the centre of mass from the top at the start, towards x = y",
        },
    ],
    does: "The marble is heavier on one side, or out of round. Its weight drives it on while the heavy side comes down and holds \
           it back while that goes up again; the faster it rolls, the more the heavy side also throws it about.",
    matters: "For slow marbles: the weight is worth a tilt of offset radians. One at rest creeps until its heavy side is down.",
    looks: "A ripple of the speed with a wavelength of 2πR, the marble's circumference (43 mm), in whatever direction it rolls; \
            its phase is another in each run.",
    references: &[
        "Routh: The Advanced Part of a Treatise on the Dynamics of a System of Rigid Bodies, 6th ed., Macmillan, 1905",
        "Chaplygin: On a motion of a heavy body of revolution on a horizontal plane, Regular and Chaotic Dynamics 7(2), 2002 (of 1897)",
    ],
};

type Vector<S> = [Lanes<S>; 3];

pub(crate) struct EccentricMarble<S: Simd> {
    offset: Lanes<S>,
    /// Towards the centre of mass.
    heavy: Vector<S>,
    /// 1/R
    curvature: f64,
    /// Length of the last substep (s).
    length: Lanes<S>,
}

impl<S: Simd> Effect<S> for EccentricMarble<S> {
    fn new(simd: S, rig: &Rig, values: &[Lanes<S>]) -> Self {
        let phase = values[1].to_array();
        let aside = std::f64::consts::FRAC_1_SQRT_2
            * Lanes::from_fn(simd, |lane| libm::sin(phase[lane]));
        Self {
            offset: values[0],
            heavy: [
                aside,
                aside,
                Lanes::from_fn(simd, |lane| libm::cos(phase[lane])),
            ],
            curvature: 1.0 / rig.marble.radius_m,
            length: Lanes::splat(simd, 0.0),
        }
    }

    /// To first order in the offset, of the equations of Newton and Euler for a sphere that rolls:
    /// the centre of mass e = offset R u pulls by its weight at an arm, m g e, and by its inertia as
    /// it goes round, -m ω × (ω × e).
    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        // ω R
        let turning = [-marbles.sy, marbles.sx, marbles.spin];
        self.turn(turning);
        self.length = push.length;
        let u = self.heavy;
        let inertia = self.curvature * dot(turning, turning);
        let weight = u[0].like(GRAVITY) + inertia;
        let along = self.curvature * dot(turning, u);
        let strength = self.offset * push.length;
        push.x = push.x + strength * (weight * u[0] - along * turning[0]);
        push.y = push.y + strength * (weight * u[1] - along * turning[1]);
    }
}

#[expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]
impl<S: Simd> EccentricMarble<S> {
    /// Turns the heavy side with the marble, as it has turned during the last substep.
    #[inline(always)]
    fn turn(&mut self, turning: Vector<S>) {
        let one = self.length.like(1.0);
        let half = turning.map(|rate| 0.5 * self.curvature * rate * self.length);
        // The tangent of half the angle makes Cayley's form a rotation by the whole of it.
        let tangent = one + 1.0 / 3.0 * dot(half, half);
        let a = half.map(|half| half * tangent);
        let part = (2.0 * one).over(one + dot(a, a));
        let across = cross(a, self.heavy);
        let twice = cross(a, across);
        for axis in 0..3 {
            self.heavy[axis] = self.heavy[axis] + part * (across[axis] + twice[axis]);
        }
    }
}

#[expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]
#[inline(always)]
fn dot<S: Simd>(a: Vector<S>, b: Vector<S>) -> Lanes<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]
#[inline(always)]
fn cross<S: Simd>(a: Vector<S>, b: Vector<S>) -> Vector<S> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
