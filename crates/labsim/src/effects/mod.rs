//! The catalogue of physical effects that a rollout may have beyond its five parameters.
//!
//! Each effect has a file: its description in `ABOUT`, its physics in an implementation of [`Effect`] for the
//! marbles of a SIMD register. Both engines run the same code. The list in [`catalogue!`](self) is in the order
//! in which effects act, from the command to the picture. A rollout does not depend on the order in which the
//! caller names them.
//!
//! The entry after `apart` is no hypothesis. It simulates what a diagnosis has learned beyond the catalogue.
//!
//! An effect with neutral parameters does not change a single bit of a rollout.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

mod spec;

use pulp::{Scalar, Simd};

pub use self::spec::{EffectNoise, EffectSpec, Parameter, Stage};
pub(crate) use self::spec::{Hook, Memory};
use crate::board::Rig;
use crate::error::{Error, Result};
use crate::lanes::Lanes;
use crate::motion::{Marbles, Pair, Push, Rims, Rolled};
use crate::per_rollout::PerRollout;

/// An effect and the values of its parameters.
#[derive(Debug, Clone, Copy)]
pub struct EffectInstance<'a> {
    /// The effect.
    pub effect: &'static EffectSpec,
    /// In the order of [`EffectSpec::parameters`].
    pub values: PerRollout<'a, f64>,
}

/// The physics of an effect for the marbles of a register, each with its own values of the parameters.
///
/// An effect acts at one [`Hook`], which its `ABOUT` names, and implements the method of that hook.
pub(crate) trait Effect<S: Simd>: Clone {
    /// `values` are in the order of [`EffectSpec::parameters`].
    fn new(simd: S, rig: &Rig, values: &[Lanes<S>]) -> Self;

    /// [`Hook::OnArrival`]: delay (s) of a command about x and about y; `draw` returns a new standard
    /// normal number for each call and rollout.
    fn late(&self, _draw: impl FnMut() -> Lanes<S>) -> Option<Pair<S>> {
        None
    }

    /// [`Hook::OnClock`]: factor of a row's duration. `part` is the row's middle minus the recording's middle, as a
    /// part of the recording. Commands keep the original clock.
    #[inline(always)]
    fn pace(&self, part: Lanes<S>) -> Lanes<S> {
        part.like(1.0)
    }

    /// [`Hook::OnKnob`]: the knob's mean angles (rad) over the next `length` seconds. The first call, of zero
    /// seconds, returns the steady state under these angles. A copy that is called with a vanishing length
    /// ([`crate::motion::PEEK_S`]) returns the knob's present angles.
    #[inline(always)]
    fn turn(&mut self, _knob: &mut Pair<S>, _length: Lanes<S>) {}

    /// [`Hook::OnTilt`]: the board's angles (rad), from those of the knob.
    #[inline(always)]
    fn tilt(&self, _tilt: &mut Pair<S>, _knob: &Pair<S>) {}

    /// [`Hook::OnMarble`]: the board's angles (rad) over the next `length` seconds. The first call, of zero seconds, is
    /// before row 0; later calls are while the marbles are held, and in each substep before [`Effect::act`].
    #[inline(always)]
    fn pass(&mut self, _tilt: &Pair<S>, _length: Lanes<S>) {}

    /// [`Hook::OnMarble`]: the marbles are released after they have rolled by `before`.
    fn let_go(&mut self, _before: &Rolled<S>) {}

    /// [`Hook::OnMarble`]: the accelerations of the marbles in the next substep.
    #[inline(always)]
    fn act(&mut self, _marbles: &Marbles<S>, _push: &mut Push<S>) {}

    /// [`Hook::OnRims`].
    #[inline(always)]
    fn rims(&self, _rims: &mut Rims<S>) {}

    /// [`Hook::OnSpin`]: the board's torque against a spin about the vertical, divided by weight and radius.
    fn spin(&self, _friction: &mut Lanes<S>) {}

    /// [`Hook::OnPicture`] and [`Hook::OnMarbleAndPicture`]: position of a marble in the picture (board edges) at the board's angles.
    #[inline(always)]
    fn see(&self, _seen: &mut Pair<S>, _tilt: &Pair<S>) {}

    /// [`Hook::OnExposure`]: age of a picture (s) at its row's time.
    #[inline(always)]
    fn age(&self) -> Option<Lanes<S>> {
        None
    }

    /// [`Hook::OnGauge`]: the board's angles (rad) as the tilt sensor reports them.
    #[inline(always)]
    fn gauge(&self, _tilt: &mut Pair<S>) {}
}

macro_rules! catalogue {
    ($($module:ident: $Type:ident),* ; apart: $($apart:ident: $Apart:ident),*) => {
        static CATALOGUE: &[&EffectSpec] = &[$(&$module::ABOUT),*];
        static APART: &[&EffectSpec] = &[$(&$apart::ABOUT),*];

        any! { $($module: $Type,)* $($apart: $Apart),* }
    };
}

macro_rules! any {
    ($($module:ident: $Type:ident),*) => {
        $(mod $module;)*

        /// Any effect of the engine.
        #[derive(Clone)]
        pub(crate) enum Any<S: Simd> {
            $($Type($module::$Type<S>)),*
        }

        impl<S: Simd> Any<S> {
            fn new(simd: S, rig: &Rig, about: &EffectSpec, values: &[Lanes<S>]) -> Self {
                $(if about.name == $module::ABOUT.name {
                    return Self::$Type($module::$Type::new(simd, rig, values));
                })*
                unreachable!("{} is known", about.name)
            }

            pub(crate) fn late(&self, draw: impl FnMut() -> Lanes<S>) -> Option<Pair<S>> {
                match self { $(Self::$Type(effect) => effect.late(draw)),* }
            }

            #[inline(always)]
            pub(crate) fn pace(&self, part: Lanes<S>) -> Lanes<S> {
                match self { $(Self::$Type(effect) => effect.pace(part)),* }
            }

            #[inline(always)]
            pub(crate) fn turn(&mut self, knob: &mut Pair<S>, length: Lanes<S>) {
                match self { $(Self::$Type(effect) => effect.turn(knob, length)),* }
            }

            #[inline(always)]
            pub(crate) fn tilt(&self, tilt: &mut Pair<S>, knob: &Pair<S>) {
                match self { $(Self::$Type(effect) => effect.tilt(tilt, knob)),* }
            }

            #[inline(always)]
            pub(crate) fn pass(&mut self, tilt: &Pair<S>, length: Lanes<S>) {
                match self { $(Self::$Type(effect) => effect.pass(tilt, length)),* }
            }

            pub(crate) fn let_go(&mut self, before: &Rolled<S>) {
                match self { $(Self::$Type(effect) => effect.let_go(before)),* }
            }

            #[inline(always)]
            pub(crate) fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
                match self { $(Self::$Type(effect) => effect.act(marbles, push)),* }
            }

            pub(crate) fn rims(&self, rims: &mut Rims<S>) {
                match self { $(Self::$Type(effect) => effect.rims(rims)),* }
            }

            pub(crate) fn spin(&self, friction: &mut Lanes<S>) {
                match self { $(Self::$Type(effect) => effect.spin(friction)),* }
            }

            #[inline(always)]
            pub(crate) fn see(&self, seen: &mut Pair<S>, tilt: &Pair<S>) {
                match self { $(Self::$Type(effect) => effect.see(seen, tilt)),* }
            }

            pub(crate) fn age(&self) -> Option<Lanes<S>> {
                match self { $(Self::$Type(effect) => effect.age()),* }
            }

            #[inline(always)]
            pub(crate) fn gauge(&self, tilt: &mut Pair<S>) {
                match self { $(Self::$Type(effect) => effect.gauge(tilt)),* }
            }
        }
    };
}

catalogue! {
    delay: Delay,
    delay_jitter: DelayJitter,
    command_quantisation: CommandQuantisation,
    dead_band: DeadBand,
    slew_limit: SlewLimit,
    lag: Lag,
    second_order_lag: SecondOrderLag,
    backlash: Backlash,
    spring_hysteresis: SpringHysteresis,
    gear_nonlinearity: GearNonlinearity,
    gear_asymmetry: GearAsymmetry,
    clock_drift: ClockDrift,
    gear_matrix: GearMatrix,
    cross_coupling: CrossCoupling,
    tilt_bias: TiltBias,
    lean: Lean,
    board_warp: BoardWarp,
    inertial_forces: InertialForces,
    slope_map: SlopeMap,
    bump: Bump,
    point_field: PointField,
    eccentric_marble: EccentricMarble,
    side_force: SideForce,
    stribeck: Stribeck,
    friction_patch: FrictionPatch,
    friction_strip: FrictionStrip,
    frame_friction: FrameFriction,
    static_friction: StaticFriction,
    anisotropic_friction: AnisotropicFriction,
    viscous_drag: ViscousDrag,
    quadratic_drag: QuadraticDrag,
    wall_restitution: WallRestitution,
    spinning_friction: SpinningFriction,
    latency: Latency,
    parallax: Parallax,
    perspective: Perspective,
    lens_distortion: LensDistortion,
    camera_rotation: CameraRotation,
    camera_offset: CameraOffset,
    tilt_sensor: TiltSensor;
    apart: unlisted: Unlisted
}

/// The catalogue, in the order in which effects act: the hypotheses about a rig.
pub fn effects() -> &'static [&'static EffectSpec] {
    CATALOGUE
}

/// Effects that are no hypotheses; each acts after those of the catalogue at its hook.
pub fn apart() -> &'static [&'static EffectSpec] {
    APART
}

/// All effects of the engine, in the order in which they act.
pub fn known() -> impl Iterator<Item = &'static EffectSpec> + Clone {
    CATALOGUE.iter().chain(APART).copied()
}

/// The effect of a name.
///
/// # Errors
/// [`Error::Unknown`] lists the names that exist.
pub fn effect(name: &str) -> Result<&'static EffectSpec> {
    let found = known().find(|about| about.name == name);
    found.ok_or_else(|| Error::Unknown {
        kind: "effect",
        name: name.to_owned(),
        possible: known()
            .map(|about| about.name)
            .collect::<Vec<_>>()
            .join(", "),
    })
}

/// Where a camera sees places on the level board: both in board edges along x, from the board's centre.
///
/// `chosen` are effects with one set of values, which act in the order of the catalogue. Those that act on more than
/// the picture are ignored, and so is `observation_scale`.
pub fn seen(rig: &Rig, chosen: &[EffectInstance<'_>], places: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let on_picture = |acts| acts == Hook::OnPicture;
    let camera = acting(Scalar, rig, &in_order(chosen), on_picture, |_| 0);
    let level = [Lanes::splat(Scalar, 0.0); 2];
    let see = |place: &[f64; 2]| {
        let mut seen = place.map(|value| Lanes::splat(Scalar, value));
        for effect in &camera {
            effect.see(&mut seen, &level);
        }
        seen.map(|value| value.to_array()[0])
    };
    places.iter().map(see).collect()
}

/// The values about x and y, from their mean and their difference y minus x.
#[inline(always)]
fn by_axis<S: Simd>(mean: Lanes<S>, y_minus_x: Lanes<S>) -> Pair<S> {
    let half = 0.5 * y_minus_x;
    [mean - half, mean + half]
}

/// Effects in the order in which they act.
pub(crate) fn in_order<'a>(chosen: &[EffectInstance<'a>]) -> Vec<EffectInstance<'a>> {
    let place = |one: &EffectInstance<'_>| known().position(|about| about.name == one.effect.name);
    let mut sorted = chosen.to_vec();
    sorted.sort_by_key(place);
    sorted
}

/// The effects of some hooks, for the marbles of a register; `rollout` maps a lane to its rollout.
pub(crate) fn acting<S: Simd>(
    simd: S,
    rig: &Rig,
    chosen: &[EffectInstance<'_>],
    places: impl Fn(Hook) -> bool,
    rollout: impl Fn(usize) -> usize,
) -> Vec<Any<S>> {
    let of_place = chosen.iter().filter(|one| places(one.effect.acts));
    of_place
        .map(|one| {
            let count = one.effect.parameters.len();
            let values: Vec<Lanes<S>> = (0..count)
                .map(|i| Lanes::from_fn(simd, |lane| one.values.of(rollout(lane), count)[i]))
                .collect();
            Any::new(simd, rig, one.effect, &values)
        })
        .collect()
}
