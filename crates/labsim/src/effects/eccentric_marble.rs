//! The marble's centre of mass is not in its middle.

use pulp::Simd;

use super::{About, Acts, Effect, Parameter, Stage};
use crate::board::{GRAVITY, Rig};
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push, length};

pub(super) const ABOUT: About = About {
    name: "eccentric_marble",
    stage: Stage::Contact,
    acts: Acts::OnMarble { timed: false },
    equation: "acceleration along the motion = 5/7 g × offset × sin(s/R + phase), s the way so far",
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
            means: "angle of the centre of mass before the top when the marble is let go",
        },
    ],
    does: "The marble is heavier on one side, or out of round. Its weight drives it on while the heavy side comes down and holds \
           it back while that goes up again. The heavy side is taken to lie in the plane of the motion, which is true of straight \
           paths.",
    matters: "For slow marbles: the weight is worth a tilt of offset radians, forth and back once a turn.",
    looks: "A ripple of the speed with a wavelength of 2πR, the marble's circumference (43 mm), in whatever direction it rolls.",
    references: &[
        "Routh: The Advanced Part of a Treatise on the Dynamics of a System of Rigid Bodies, 6th ed., Macmillan, 1905",
        "Chaplygin: On a motion of a heavy body of revolution on a horizontal plane, Regular and Chaotic Dynamics 7(2), 2002 (of 1897)",
    ],
};

pub(crate) struct EccentricMarble<S: Simd> {
    /// g × offset
    weight: Lanes<S>,
    /// Sine and cosine of the angle of the heavy side from the top.
    sin: Lanes<S>,
    cos: Lanes<S>,
    /// 1/(2 R)
    half_curvature: f64,
    /// Speed times length of the last substep, on which the marble has not been turned yet (m).
    way: Lanes<S>,
}

impl<S: Simd> Effect<S> for EccentricMarble<S> {
    fn new(simd: S, rig: &Rig, values: &[Lanes<S>]) -> Self {
        let phase = values[1].to_array();
        Self {
            weight: GRAVITY * values[0],
            sin: Lanes::from_fn(simd, |lane| libm::sin(phase[lane])),
            cos: Lanes::from_fn(simd, |lane| libm::cos(phase[lane])),
            half_curvature: 0.5 / rig.marble.radius_m,
            way: Lanes::splat(simd, 0.0),
        }
    }

    fn let_go(&mut self, rolled: Lanes<S>) {
        let angles = (2.0 * self.half_curvature * rolled).to_array();
        let simd = rolled.simd();
        let sin = Lanes::from_fn(simd, |lane| libm::sin(angles[lane]));
        let cos = Lanes::from_fn(simd, |lane| libm::cos(angles[lane]));
        (self.sin, self.cos) = (
            self.sin * cos + self.cos * sin,
            self.cos * cos - self.sin * sin,
        );
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let (vx, vy) = (marbles.vx, marbles.vy);
        let one = vx.like(1.0);
        let inverse = one.over(length(vx, vy));
        let (x, y) = (vx * inverse, vy * inverse);
        let speed = vx * x + vy * y;
        self.turn(speed * push.length);
        let strength = self.weight * self.sin * push.length;
        push.x = push.x + strength * x;
        push.y = push.y + strength * y;
    }
}

#[expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]
impl<S: Simd> EccentricMarble<S> {
    /// Turns the heavy side by the way that the marble has rolled in the last substep.
    #[inline(always)]
    fn turn(&mut self, next: Lanes<S>) {
        let one = next.like(1.0);
        let half = self.half_curvature * self.way;
        // The tangent of half the angle makes Cayley's form a rotation by the whole of it.
        let tangent = half * (one + 1.0 / 3.0 * (half * half));
        let part = (2.0 * tangent).over(one + tangent * tangent);
        let (sin, cos) = (self.sin, self.cos);
        self.sin = sin + part * (cos - tangent * sin);
        self.cos = cos - part * (sin + tangent * cos);
        self.way = next;
    }
}
