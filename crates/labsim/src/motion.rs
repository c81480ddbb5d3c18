//! State and accelerations of the marbles of a register, shared by engines and effects.

use pulp::Simd;

use crate::board::Rig;
use crate::lanes::{Lanes, Mask};

/// Along x and along y, or about them.
pub(crate) type Pair<S> = [Lanes<S>; 2];

/// The rim, in metres.
#[derive(Clone, Copy)]
pub(crate) struct Rims<S: Simd> {
    /// Maximum distance of a marble's centre from the board's centre.
    pub(crate) reach_x: Lanes<S>,
    pub(crate) reach_y: Lanes<S>,
    /// Of the normal velocity.
    pub(crate) restitution: Restitution<Lanes<S>>,
    /// Coulomb's coefficient.
    pub(crate) friction: Lanes<S>,
}

impl<S: Simd> Rims<S> {
    #[inline]
    pub(crate) fn new(simd: S, rig: &Rig) -> Self {
        let [reach_x, reach_y] = rig.reach_m();
        Self {
            reach_x: Lanes::splat(simd, reach_x),
            reach_y: Lanes::splat(simd, reach_y),
            restitution: Restitution {
                at_reference: Lanes::splat(simd, rig.board.wall_restitution),
                falloff: Lanes::splat(simd, 0.0),
            },
            friction: Lanes::splat(simd, rig.board.wall_friction),
        }
    }
}

/// The approach speed at which a restitution is stated (m/s).
pub(crate) const REFERENCE_M_PER_S: f64 = 0.1;

/// No rim returns more because a marble is slow.
pub(crate) const LIVELIEST: f64 = 0.95;

/// A coefficient of restitution, which falls with a power of the approach speed
/// (Johnson: Contact Mechanics, ch. 11).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Restitution<T> {
    /// At [`REFERENCE_M_PER_S`].
    pub(crate) at_reference: T,
    /// The exponent of the inverse of the speed.
    pub(crate) falloff: T,
}

impl Restitution<f64> {
    /// The coefficient at an approach speed (m/s).
    pub(crate) fn at(&self, speed: f64) -> f64 {
        if self.falloff == 0.0 || self.at_reference <= 0.0 {
            return self.at_reference;
        }
        let power = libm::pow(speed.abs() / REFERENCE_M_PER_S, -self.falloff);
        (self.at_reference * power).min(self.most())
    }

    /// How much faster a marble leaves for each m/s with which it arrives faster, at an approach speed (m/s).
    pub(crate) fn slope_at(&self, speed: f64) -> f64 {
        let share = self.at(speed);
        if share < self.most() {
            (1.0 - self.falloff) * share
        } else {
            share
        }
    }

    fn most(&self) -> f64 {
        LIVELIEST.max(self.at_reference)
    }
}

#[expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]
impl<S: Simd> Restitution<Lanes<S>> {
    /// The coefficient of a lane.
    pub(crate) fn of_lane(&self, lane: usize) -> Restitution<f64> {
        Restitution {
            at_reference: self.at_reference.to_array()[lane],
            falloff: self.falloff.to_array()[lane],
        }
    }

    /// The coefficients at approach speeds (m/s) of marbles that meet a rim; others have any.
    #[inline(always)]
    pub(crate) fn at(&self, speed: Lanes<S>, meets: Mask<S>) -> Lanes<S> {
        self.by_lane(speed, meets, Restitution::<f64>::at)
    }

    /// How much faster marbles leave for each m/s with which they arrive faster, at approach speeds (m/s), if they meet a
    /// rim; others have any.
    #[inline(always)]
    pub(crate) fn slope_at(&self, speed: Lanes<S>, meets: Mask<S>) -> Lanes<S> {
        self.by_lane(speed, meets, Restitution::<f64>::slope_at)
    }

    /// Powers are slow, and few marbles meet a rim at a time.
    #[inline(always)]
    fn by_lane(
        &self,
        speed: Lanes<S>,
        meets: Mask<S>,
        of: fn(&Restitution<f64>, f64) -> f64,
    ) -> Lanes<S> {
        let zero = speed.like(0.0);
        let falls = meets & self.falloff.ne(zero);
        if !falls.any() {
            return self.at_reference;
        }
        let falls = falls.select(speed.like(1.0), zero).to_array();
        let (at_reference, speed) = (self.at_reference.to_array(), speed.to_array());
        Lanes::from_fn(self.falloff.simd(), |lane| {
            if falls[lane] > 0.0 {
                of(&self.of_lane(lane), speed[lane])
            } else {
                at_reference[lane]
            }
        })
    }
}

/// Positions and velocities of the marbles of a register (m, m/s).
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Marbles<S: Simd> {
    pub(crate) x: Lanes<S>,
    pub(crate) y: Lanes<S>,
    pub(crate) vx: Lanes<S>,
    pub(crate) vy: Lanes<S>,
    /// Velocity at which the present spin would be a pure roll.
    pub(crate) sx: Lanes<S>,
    pub(crate) sy: Lanes<S>,
    /// Radius × angular velocity about the vertical.
    pub(crate) spin: Lanes<S>,
    /// Time until a hop ends (s).
    pub(crate) air: Lanes<S>,
}

#[expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]
impl<S: Simd> Marbles<S> {
    /// Marbles at rest at these places (m).
    #[inline(always)]
    pub(crate) fn at_rest([x, y]: Pair<S>) -> Self {
        let zero = x.like(0.0);
        Self {
            x,
            y,
            vx: zero,
            vy: zero,
            sx: zero,
            sy: zero,
            spin: zero,
            air: zero,
        }
    }

    #[inline(always)]
    pub(crate) fn select(mask: Mask<S>, if_true: &Self, if_false: &Self) -> Self {
        Self {
            x: mask.select(if_true.x, if_false.x),
            y: mask.select(if_true.y, if_false.y),
            vx: mask.select(if_true.vx, if_false.vx),
            vy: mask.select(if_true.vy, if_false.vy),
            sx: mask.select(if_true.sx, if_false.sx),
            sy: mask.select(if_true.sy, if_false.sy),
            spin: mask.select(if_true.spin, if_false.spin),
            air: mask.select(if_true.air, if_false.air),
        }
    }

    /// The rolling velocity w = (5 v + 2 s)/7, which no contact force changes.
    #[inline(always)]
    pub(crate) fn rolling(&self) -> Pair<S> {
        [
            5.0 / 7.0 * self.vx + 2.0 / 7.0 * self.sx,
            5.0 / 7.0 * self.vy + 2.0 / 7.0 * self.sy,
        ]
    }
}

/// Path of marbles before their release.
pub(crate) struct Rolled<S: Simd> {
    /// Path length (m).
    pub(crate) way: Lanes<S>,
    /// Rotation along this path: axis times angle (rad).
    pub(crate) turned: [Lanes<S>; 3],
}

/// Accelerations and friction limits of a substep.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Push<S: Simd> {
    /// Impulse over mass of the forces through the marble's centre (m/s).
    pub(crate) x: Lanes<S>,
    pub(crate) y: Lanes<S>,
    /// Push of gravity towards the board (m/s²).
    pub(crate) normal: Lanes<S>,
    /// Maximum decrease of the rolling velocity by rolling resistance (m/s).
    pub(crate) resistance: Lanes<S>,
    /// Maximum change of the velocity by friction with the board (m/s).
    pub(crate) grip: Lanes<S>,
    /// Maximum decrease of the spin about the vertical by friction with the board (m/s).
    pub(crate) spinning: Lanes<S>,
    /// Damping factor of every velocity.
    pub(crate) damping: Lanes<S>,
    /// Length of the substep (s).
    pub(crate) length: Lanes<S>,
}

/// A vanishing time (s), to ask an effect for the knob's present angles.
pub(crate) const PEEK_S: f64 = 1e-12;

/// Square of a negligible speed (m/s); keeps the inverse of a zero speed finite.
pub(crate) const TINY: f64 = 1e-280;

/// Length of a vector, never quite zero.
#[expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]
#[inline(always)]
pub(crate) fn length<S: Simd>(x: Lanes<S>, y: Lanes<S>) -> Lanes<S> {
    (x * x + y * y + x.like(TINY)).sqrt()
}
