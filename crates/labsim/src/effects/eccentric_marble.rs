//! A centre of mass that is off the marble's centre.

use std::f64::consts::FRAC_PI_2;

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Memory, Parameter, Stage};
use crate::board::{GRAVITY, Rig};
use crate::lanes::{Lanes, Mask};
use crate::motion::{Marbles, Push, Rolled, length};

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "eccentric_marble",
    stage: Stage::Contact,
    acts: Hook::OnMarble(Memory::Turning),
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "acceleration = 5/7 offset (g e + (e · v) v/R), e the horizontal part of the direction of the heavy side, \
               which turns as the marble rolls (and, once it spins about the vertical, + 5/7 offset R (ω_z² e - ω_z e_z ω)); \
               or, if it follows the path, 5/7 g offset sin(s/R + phase) v̂, s the way so far",
    parameters: &[
        Parameter {
            name: "offset",
            unit: "",
            range: (0.0, 0.01),
            neutral: 0.0,
            allowed: (0.0, 0.5),
            time_power: -2,
            optional: false,
            reach: None,
            means: "distance of the centre of mass from the marble's centre, divided by the radius",
        },
        Parameter {
            name: "phase_rad",
            unit: "rad",
            range: (0.0, std::f64::consts::TAU),
            neutral: 0.0,
            allowed: (-100.0, 100.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "initial angle of the centre of mass from the top: towards +x, or forwards if it follows the path",
        },
        Parameter {
            name: "lean_rad",
            unit: "rad",
            range: (-FRAC_PI_2, FRAC_PI_2),
            neutral: 0.0,
            allowed: (-FRAC_PI_2, FRAC_PI_2),
            time_power: 0,
            optional: false,
            reach: None,
            means: "initial angle of the centre of mass out of that plane, towards +y; ignored if it follows the path",
        },
        Parameter::choice(
            "follows_path",
            1.0,
            "1 if the heavy side stays in the plane of motion and always turns forwards; 0 if it is fixed in the rolling \
             marble and turns back with it",
        ),
    ],
    does: "The marble is heavier on one side, or out of round. Its weight drives it while the heavy side comes down and brakes \
           it while that side goes up; at speed the inertia of the heavy side adds to both. The heavy side of a rolling marble \
           turns with it in three dimensions: backwards if the marble rolls back, and out of the plane of motion where the \
           path bends. In a marble that turns about the vertical along with its path, the heavy side stays in that plane.",
    matters: "For slow marbles: once a turn the weight pushes as a tilt of offset radians does, forwards and then backwards.",
    looks: "A ripple of the speed with a wavelength of 2πR, the marble's circumference (43 mm), in any rolling direction. A \
            heavy side that is fixed in the marble is at the bottom when it rests, so the marble starts late.",
    references: &[
        "Routh: The Advanced Part of a Treatise on the Dynamics of a System of Rigid Bodies, 6th ed., Macmillan, 1905",
        "Chaplygin: On a motion of a heavy body of revolution on a horizontal plane, Regular and Chaotic Dynamics 7(2), 2002 (of 1897)",
    ],
};

#[derive(Clone)]
pub(crate) struct EccentricMarble<S: Simd> {
    /// g × offset
    weight: Lanes<S>,
    follows_path: Mask<S>,
    /// Sine and cosine of the angle from the top, for a heavy side that follows the path.
    sin: Lanes<S>,
    cos: Lanes<S>,
    /// Direction of a heavy side that is fixed in the marble.
    heavy: Vector<S>,
    /// 1/(2 R)
    half_curvature: f64,
    /// Length of the last substep (s). The marble is turned for it with its present velocity: with the velocity
    /// before, a marble that swings would gain energy.
    last: Lanes<S>,
}

type Vector<S> = [Lanes<S>; 3];

impl<S: Simd> Effect<S> for EccentricMarble<S> {
    fn new(simd: S, rig: &Rig, values: &[Lanes<S>]) -> Self {
        let (sin, cos) = values[1].sin_cos_of_any();
        let (lean, upright) = values[2].sin_cos_of_any();
        let zero = Lanes::splat(simd, 0.0);
        Self {
            weight: GRAVITY * values[0],
            follows_path: values[3].gt(zero),
            sin,
            cos,
            heavy: [sin * upright, lean, cos * upright],
            half_curvature: 0.5 / rig.marble.radius_m,
            last: zero,
        }
    }

    fn let_go(&mut self, before: &Rolled<S>) {
        let (sin, cos) = (2.0 * self.half_curvature * before.way).sin_cos_of_any();
        (self.sin, self.cos) = (
            self.sin * cos + self.cos * sin,
            self.cos * cos - self.sin * sin,
        );
        let [x, y, z] = before.turned;
        let angle = (x * x + y * y + z * z).sqrt().to_array();
        // tan(angle/2)/angle, the factor that turns axis times angle into axis times tan(angle/2).
        let tangent = Lanes::from_fn(x.simd(), |lane| match angle[lane] {
            0.0 => 0.5,
            angle => libm::tan(0.5 * angle) / angle,
        });
        self.heavy = rotated(self.heavy, [tangent * x, tangent * y, tangent * z]);
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let (vx, vy) = (marbles.vx, marbles.vy);
        let one = vx.like(1.0);
        let (mut push_x, mut push_y) = (vx.like(0.0), vx.like(0.0));
        // In a fit all lanes have the same choice, so only that branch is computed.
        if self.follows_path.any() {
            let inverse = one.over(length(vx, vy));
            let (x, y) = (vx * inverse, vy * inverse);
            self.turn((vx * x + vy * y) * self.last);
            (push_x, push_y) = (self.sin * x, self.sin * y);
        }
        if (!self.follows_path).any() {
            self.roll(marbles);
            let [heavy_x, heavy_y, heavy_z] = self.heavy;
            // Centrifugal terms over g, of the roll and of the spin about the vertical.
            let curvature = 2.0 / GRAVITY * self.half_curvature;
            let ahead = curvature * (vx * heavy_x + vy * heavy_y);
            let spin = curvature * marbles.spin;
            let (level, tumbling) = (one + spin * marbles.spin, spin * heavy_z);
            let keeps_x = level * heavy_x + ahead * vx + tumbling * marbles.sy;
            let keeps_y = level * heavy_y + ahead * vy - tumbling * marbles.sx;
            push_x = self.follows_path.select(push_x, keeps_x);
            push_y = self.follows_path.select(push_y, keeps_y);
        }
        self.last = push.length;
        let strength = self.weight * push.length;
        push.x = push.x + strength * push_x;
        push.y = push.y + strength * push_y;
    }
}

impl<S: Simd> EccentricMarble<S> {
    /// Turns a heavy side that follows the path by a path length (m).
    #[inline(always)]
    fn turn(&mut self, way: Lanes<S>) {
        let one = way.like(1.0);
        let half = self.half_curvature * way;
        // With the tangent of half the angle, Cayley's form is a rotation by the full angle.
        let tangent = half * (one + 1.0 / 3.0 * (half * half));
        let part = (2.0 * tangent).over(one + tangent * tangent);
        let (sin, cos) = (self.sin, self.cos);
        self.sin = sin + part * (cos - tangent * sin);
        self.cos = cos - part * (sin + tangent * cos);
    }

    /// Turns a heavy side that is fixed in the marble by the marble's rotation in the last substep.
    #[inline(always)]
    fn roll(&mut self, marbles: &Marbles<S>) {
        let half = self.half_curvature * self.last;
        let (x, y, z) = (-(half * marbles.sy), half * marbles.sx, half * marbles.spin);
        // As in `turn`.
        let tangent = x.like(1.0) + 1.0 / 3.0 * (x * x + y * y + z * z);
        self.heavy = rotated(self.heavy, [tangent * x, tangent * y, tangent * z]);
    }
}

/// A vector after a rotation whose axis times the tangent of half its angle is given (Cayley's form).
#[inline(always)]
fn rotated<S: Simd>(vector: Vector<S>, half: Vector<S>) -> Vector<S> {
    let [x, y, z] = half;
    let one = x.like(1.0);
    let part = (2.0 * one).over(one + x * x + y * y + z * z);
    let [ax, ay, az] = cross(half, vector);
    let [bx, by, bz] = cross(half, [ax, ay, az]);
    let [vx, vy, vz] = vector;
    // No closures: they would not be inlined.
    [
        vx + part * (ax + bx),
        vy + part * (ay + by),
        vz + part * (az + bz),
    ]
}

#[inline(always)]
fn cross<S: Simd>([ax, ay, az]: Vector<S>, [bx, by, bz]: Vector<S>) -> Vector<S> {
    [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
}
