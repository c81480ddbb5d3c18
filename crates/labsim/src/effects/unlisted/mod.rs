//! Physics outside the catalogue: profiles over board, velocity, tilt and time, powers of the speed, a vibration mode,
//! a drive that yields at speed, a picture that turns with the tilt, and forces at the rim.

mod mode;
mod picture;
mod profile;
mod rim;
mod yielding;

use pulp::Simd;

use self::mode::Mode;
use self::picture::Picture;
use self::profile::{Profile, SADDLE};
use self::rim::Rim;
use self::yielding::Yielding;
use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::{GRAVITY, Rig};
use crate::lanes::Lanes;
use crate::motion::{Marbles, Pair, Push, Rolled, length};

/// A parameter that is neutral at zero.
const fn parameter(
    name: &'static str,
    unit: &'static str,
    range: (f64, f64),
    most: f64,
    time_power: i8,
    means: &'static str,
) -> Parameter {
    Parameter {
        name,
        unit,
        range,
        neutral: 0.0,
        allowed: (-most, most),
        time_power,
        optional: false,
        reach: None,
        means,
    }
}

const fn push(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "m/s²", (-1.0, 1.0), 100.0, -2, means)
}

const fn wave(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "rad/m", (-400.0, 400.0), 1e4, 0, means)
}

const fn swift(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "rad s/m", (-200.0, 200.0), 1e4, 1, means)
}

const fn heading(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "rad", (-10.0, 10.0), 1e4, 0, means)
}

const fn tilt(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "", (-2e3, 2e3), 1e5, 2, means)
}

const fn rate(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "rad/s", (-60.0, 60.0), 1e4, -1, means)
}

const fn phase(name: &'static str, means: &'static str) -> Parameter {
    // The phase of a narrow profile at the board's edge is many radians.
    parameter(name, "rad", (-10.0, 10.0), 200.0, 0, means)
}

const fn strength(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "m/s²", (-1.0, 1.0), 10.0, -2, means)
}

const fn gear(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "", (-1.0, 1.0), 10.0, 0, means)
}

const fn picture(name: &'static str, unit: &'static str, means: &'static str) -> Parameter {
    parameter(name, unit, (-50.0, 50.0), 1e3, 2, means)
}

const fn at_rim(
    name: &'static str,
    unit: &'static str,
    most: f64,
    time_power: i8,
    means: &'static str,
) -> Parameter {
    parameter(name, unit, (-most, most), 1e3, time_power, means)
}

/// What a yielding drive loses, and the phase of its bell.
const fn lost(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "", (-1.0, 1.0), 10.0, 0, means)
}

const fn turning(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "s", (-2e3, 2e3), 1e6, 3, means)
}

const fn power(name: &'static str, means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "",
        range: (0.0, 4.0),
        neutral: 1.0,
        allowed: (0.0, 4.0),
        time_power: 0,
        optional: false,
        reach: None,
        means,
    }
}

/// How many profiles there are, and the parameters of each.
const PROFILES: usize = 5;
const OF_PROFILE: usize = 18;
/// Those of them that scale the profile's contribution.
const SIZES: std::ops::Range<usize> = 1..6;

macro_rules! parameters {
    ($($n:literal $nth:literal),*) => {
        &[
            $(
                Parameter {
                    name: concat!("shape_", $n),
                    unit: "",
                    range: (0.0, SADDLE),
                    neutral: 0.0,
                    allowed: (0.0, SADDLE),
                    time_power: 0,
                    optional: false,
                    reach: None,
                    means: concat!("of the ", $nth, " profile: 0 wave, 1 step, 2 bell, 3 ridge, 4 spot, 5 line, 6 bowl, 7 saddle"),
                },
                push(concat!("push_", $n, "_x_m_per_s2"), concat!("acceleration along x where the ", $nth, " profile is 1")),
                push(concat!("push_", $n, "_y_m_per_s2"), concat!("acceleration along y where the ", $nth, " profile is 1")),
                strength(concat!("brake_", $n, "_m_per_s2"), concat!("drag that the ", $nth, " profile adds where it is 1")),
                gear(concat!("gear_", $n, "_x"), concat!("share of the board's angle about x that the ", $nth, " profile adds where it is 1")),
                gear(concat!("gear_", $n, "_y"), concat!("share of the board's angle about y that the ", $nth, " profile adds where it is 1")),
                wave(concat!("wave_", $n, "_x_per_m"), concat!("phase of the ", $nth, " profile for each metre along x")),
                wave(concat!("wave_", $n, "_y_per_m"), concat!("phase of the ", $nth, " profile for each metre along y")),
                swift(concat!("velocity_", $n, "_x_s_per_m"), concat!("phase of the ", $nth, " profile for each m/s along x")),
                swift(concat!("velocity_", $n, "_y_s_per_m"), concat!("phase of the ", $nth, " profile for each m/s along y")),
                heading(concat!("heading_", $n, "_x"), concat!("phase of the ", $nth, " profile where the marble rolls along x")),
                heading(concat!("heading_", $n, "_y"), concat!("phase of the ", $nth, " profile where the marble rolls along y")),
                tilt(concat!("tilt_", $n, "_x_per_rad"), concat!("phase of the ", $nth, " profile for each radian about x")),
                tilt(concat!("tilt_", $n, "_y_per_rad"), concat!("phase of the ", $nth, " profile for each radian about y")),
                rate(concat!("rate_", $n, "_per_s"), concat!("phase of the ", $nth, " profile for each second since row 0")),
                wave(concat!("way_", $n, "_per_m"), concat!("phase of the ", $nth, " profile for each metre rolled since row 0")),
                phase(
                    concat!("phase_", $n, "_rad"),
                    concat!("phase of the ", $nth, " profile at rest in the centre of the level board, at row 0"),
                ),
                phase(
                    concat!("across_", $n, "_rad"),
                    concat!("phase of the ", $nth, " profile across that over board and tilt: of spot and saddle alone"),
                ),
            )*
            strength("drag_strength", "drag, deceleration at 0.1 m/s; negative drives on"),
            power("drag_power", "p, power of the speed with which the drag grows"),
            strength("side_strength", "side, acceleration to the left at 0.1 m/s"),
            power("side_power", "q, power of the speed with which the side push grows"),
            parameter("mode_gain", "", (-2.0, 2.0), 100.0, 0, "share of the mode's deviation from the board's angles that is added to them"),
            Parameter {
                name: "mode_rate_rad_per_s",
                unit: "rad/s",
                range: (2.0, 40.0),
                neutral: 10.0,
                allowed: (0.1, 1e3),
                time_power: -1,
                optional: false,
                reach: None,
                means: "undamped angular frequency of the mode",
            },
            Parameter {
                name: "mode_damping",
                unit: "",
                range: (0.0, 0.99),
                neutral: 0.2,
                allowed: (0.0, 0.99),
                time_power: 0,
                optional: false,
                reach: None,
                means: "damping ratio of the mode",
            },
            Parameter {
                name: "yield_lag_s",
                unit: "s",
                range: (0.0, 1.0),
                neutral: 0.0,
                allowed: (0.0, 1e3),
                time_power: 1,
                optional: false,
                reach: None,
                means: "time constant with which a yielding drive follows the board's angles, as a lag does",
            },
            lost("yield_x", "share of the angle about x that a drive loses while it turns fast"),
            lost("yield_y", "the same about y"),
            turning("yield_x_s_per_rad", "phase of the bell that is not lost, for each rad/s about x"),
            turning("yield_y_s_per_rad", "the same about y"),
            picture("picture_turn_x", "", "angle of the picture from x towards y for each radian of the board about x"),
            picture("picture_turn_y", "", "the same for each radian about y"),
            picture("picture_growth_x_per_rad", "1/rad", "growth of the picture for each radian of the board about x"),
            picture("picture_growth_y_per_rad", "1/rad", "the same for each radian about y"),
            at_rim("rim_hold_m_per_s2", "m/s²", 1.0, -2, "acceleration away from the rim that it holds back while the marble touches it; as all at the rim, none if negative"),
            at_rim("rim_brake_m_per_s2", "m/s²", 1.0, -2, "deceleration of a marble that touches the rim"),
            at_rim("rim_drag_per_s", "1/s", 30.0, -1, "the same for each m/s"),
        ]
    };
}

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "unlisted",
    stage: Stage::Field,
    acts: Hook::OnMarbleAndPicture,
    hypothesis: false,
    shrunk: false,
    noise: None,
    equation: "acceleration = Σ push f(s) - (drag + Σ brake f(s)) (v/0.1)^p v̂ + side (v/0.1)^q ẑ × v̂ + 5/7 g (gain (mode - angles) + Σ gear f(s) angles + drive - angles), \
               s = wave · place + swift · velocity + heading · v̂ + tilt · angles + rate t + way ℓ + phase, d²mode/dt² = rate² (angles - mode) - 2 damping rate d mode/dt, \
               drive = u (1 - yield (1 - exp(-(slowness du/dt)²/2))) for each axis, lag du/dt = angles - u, \
               seen = (1 + growth · angles) R(turn · angles) seen; at the rim: a push away less hold, and - (brake + drag v) v̂",
    parameters: parameters!["1" "first", "2" "second", "3" "third", "4" "fourth", "5" "fifth"],
    does: "A stand-in for physics that no effect of the catalogue explains, as far as recordings show it. It has up to five \
           profiles (a wave, step, bell, ridge, round spot, line, bowl or saddle) of push, of drag and of the gears. A profile \
           depends on the place, the marble's velocity and direction, the board's tilt, and the time and path length ℓ since \
           row 0. It also has a drag and a side push with any power of the speed, and a vibration mode of the board on its \
           knobs, the board may follow late and lose a share of its angle while it turns fast, and the picture may turn about its centre and grow with the tilt. A marble that touches the rim may be held there, and \
            braked. Accelerations are those of the rolling marble as observed, not 7/5 of them. The powers are constant above 1 \
           m/s; lines, bowls and saddles are constant beyond 1000 radians. A drag with the power 0 holds a resting marble as \
           friction does.",
    matters: "Where a diagnosis has learned it. It is no hypothesis of its own, because it can imitate many effects.",
    looks: "Residuals that no effect of the catalogue explains: pushes that depend on place, velocity, tilt, time, path length \
            or the history of the board's angles, pictures that turn or grow with the tilt, and late departures from the rim.",
    references: &[
        "Ljung: System Identification, 2nd ed., ch. 5 (models of nonlinear systems)",
        "Brunton, Proctor, Kutz: Discovering governing equations from data by sparse identification of nonlinear dynamical \
         systems, PNAS 113(15), 2016",
    ],
};

/// Upper bound of the speeds in the power laws (m/s), which keeps their logarithms below zero.
const SLOWEST: f64 = 1e-9;
const FASTEST: f64 = 1.0;

/// Ratio of the force per mass through the centre to the acceleration of a rolling sphere.
const FORCE: f64 = 7.0 / 5.0;

/// An acceleration that grows with a power of the speed.
#[derive(Clone)]
struct Law<S: Simd> {
    /// Ratio of the acceleration at `FASTEST` to that at 0.1 m/s.
    growth: Lanes<S>,
    /// At `FASTEST` (m/s²).
    most: Lanes<S>,
    power: Lanes<S>,
}

#[derive(Clone)]
pub(crate) struct Unlisted<S: Simd> {
    /// Profiles with a contribution in any lane. In other lanes they add zero.
    profiles: Vec<Profile<S>>,
    brakes: bool,
    drag: Law<S>,
    side: Option<Law<S>>,
    mode: Option<Mode<S>>,
    yielding: Option<Yielding<S>>,
    picture: Option<Picture<S>>,
    rim: Option<Rim<S>>,
    /// Start of the present substep after row 0, and its length (s).
    time: Lanes<S>,
    length: Lanes<S>,
    /// Path length since row 0 (m), if a profile depends on it.
    way: Option<Lanes<S>>,
    /// The board's angles in this substep (rad).
    tilt: Option<Pair<S>>,
}

impl<S: Simd> Effect<S> for Unlisted<S> {
    fn new(simd: S, rig: &Rig, values: &[Lanes<S>]) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        let (profiles, rest) = values.split_at(PROFILES * OF_PROFILE);
        let any = |one: Lanes<S>| one.ne(zero).any();
        let (drag, side) = (Law::new(rest[0], rest[1]), Law::new(rest[2], rest[3]));
        let profiles: Vec<_> = profiles
            .chunks_exact(OF_PROFILE)
            .filter(|one| one[SIZES].iter().any(|&amplitude| any(amplitude)))
            .map(|one| Profile::new(one, drag.growth))
            .collect();
        Self {
            way: profiles.iter().any(|one| one.way.is_some()).then_some(zero),
            brakes: any(drag.most) || profiles.iter().any(|one| one.brake.is_some()),
            profiles,
            drag,
            side: any(side.most).then_some(side),
            mode: any(rest[4]).then(|| Mode::new(rest[4], rest[5], rest[6])),
            yielding: rest[7..10]
                .iter()
                .any(|&one| any(one))
                .then(|| Yielding::new(rest[7], [rest[8], rest[9]], [rest[10], rest[11]])),
            picture: rest[12..16]
                .iter()
                .any(|&one| any(one))
                .then(|| Picture::new([rest[12], rest[13]], [rest[14], rest[15]])),
            rim: rest[16..19]
                .iter()
                .any(|&one| any(one))
                .then(|| Rim::new(rig, [rest[16], rest[17], rest[18]])),
            time: zero,
            length: zero,
            tilt: None,
        }
    }

    #[inline(always)]
    fn pass(&mut self, tilt: &Pair<S>, length: Lanes<S>) {
        self.time = self.time + self.length;
        self.length = length;
        self.tilt = Some(*tilt);
        if let Some(mode) = &mut self.mode {
            mode.pass(tilt, length);
        }
        if let Some(drive) = &mut self.yielding {
            drive.pass(tilt, length);
        }
    }

    fn let_go(&mut self, before: &Rolled<S>) {
        self.way = self.way.map(|_| before.way);
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let (zero, one) = (push.length.like(0.0), push.length.like(1.0));
        let (mut x, mut y, mut drag) = (zero, zero, self.drag.most);
        for profile in &self.profiles {
            let at = profile.at(marbles, push, self);
            let impulse = FORCE * (at * push.length);
            x = x + impulse * profile.push[0];
            y = y + impulse * profile.push[1];
            if let Some(brake) = profile.brake {
                drag = drag + brake * at;
            }
            if let (Some(gear), Some(tilt)) = (profile.gear, self.tilt) {
                let pull = GRAVITY * (at * push.length);
                x = x + pull * (gear[1] * tilt[1]);
                y = y - pull * (gear[0] * tilt[0]);
            }
        }
        if let Some(way) = &mut self.way {
            *way = *way + length(marbles.vx, marbles.vy) * push.length;
        }
        if let Some(mode) = &self.mode {
            let pull = GRAVITY * (mode.gain * push.length);
            x = x + pull * mode.away[1];
            y = y - pull * mode.away[0];
        }
        if let Some(drive) = &self.yielding {
            let pull = GRAVITY * push.length;
            x = x + pull * drive.away[1];
            y = y - pull * drive.away[0];
        }
        if self.brakes || self.side.is_some() {
            // The rolling velocity after the pushes: a drag stops a slow marble and does not reverse it.
            let [wx, wy] = marbles.rolling();
            let (wx, wy) = (
                wx + 1.0 / FORCE * (push.x + x),
                wy + 1.0 / FORCE * (push.y + y),
            );
            let speed = length(wx, wy);
            let ln = speed
                .max(speed.like(SLOWEST))
                .min(speed.like(FASTEST))
                .ln_of_part();
            if let Some(law) = &self.side {
                // Cayley's form of a rotation, as in `side_force`.
                let half = 0.5 * (law.at(ln) * push.length).over(speed);
                let part = (2.0 * FORCE * half).over(one + half * half);
                x = x - part * (wy + half * wx);
                y = y + part * (wx - half * wy);
            }
            if self.brakes {
                let change = drag * (self.drag.power * ln).exp_decay() * push.length;
                // The law's solution up to the third power of the relative loss q: v (1 - q + p/2 q² - ...).
                let (slows, drives) = (change.max(zero), change.min(zero));
                let share = 0.5 * (self.drag.power * slows).over(speed);
                push.resistance = push.resistance + slows.over(one + share);
                let drives = FORCE * drives.over(speed);
                x = x - drives * wx;
                y = y - drives * wy;
            }
        }
        push.x = push.x + x;
        push.y = push.y + y;
        if let Some(rim) = &self.rim {
            rim.act(marbles, push);
        }
    }

    #[inline(always)]
    fn see(&self, seen: &mut Pair<S>, tilt: &Pair<S>) {
        if let Some(picture) = &self.picture {
            picture.see(seen, tilt);
        }
    }
}

impl<S: Simd> Law<S> {
    fn new(strength: Lanes<S>, power: Lanes<S>) -> Self {
        let powers = power.to_array();
        let growth = Lanes::from_fn(power.simd(), |lane| libm::pow(FASTEST / 0.1, powers[lane]));
        Self {
            growth,
            most: strength * growth,
            power,
        }
    }

    /// Acceleration (m/s²) at a speed (m/s) of this logarithm.
    #[inline(always)]
    fn at(&self, ln: Lanes<S>) -> Lanes<S> {
        self.most * (self.power * ln).exp_decay()
    }
}
