//! What no effect of the catalogue explains: waves of push over board, velocity, tilt and time, and powers of the speed.

use pulp::Simd;

use super::{About, Acts, Effect, Memory, Parameter, Stage};
use crate::board::{GRAVITY, Rig};
use crate::lanes::Lanes;
use crate::motion::{Marbles, Pair, Push, length};

/// A parameter that is neutral at zero.
const fn parameter(
    name: &'static str,
    unit: &'static str,
    range: (f64, f64),
    most: f64,
    means: &'static str,
) -> Parameter {
    Parameter {
        name,
        unit,
        range,
        neutral: 0.0,
        allowed: (-most, most),
        means,
    }
}

const fn push(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "m/s²", (-1.0, 1.0), 100.0, means)
}

const fn wave(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "rad/m", (-400.0, 400.0), 1e4, means)
}

const fn swift(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "rad s/m", (-200.0, 200.0), 1e4, means)
}

const fn tilt(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "", (-2e3, 2e3), 1e5, means)
}

const fn rate(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "rad/s", (-60.0, 60.0), 1e4, means)
}

const fn phase(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "rad", (0.0, std::f64::consts::TAU), 100.0, means)
}

const fn strength(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "m/s²", (-1.0, 1.0), 10.0, means)
}

const fn power(name: &'static str, means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "",
        range: (0.0, 4.0),
        neutral: 1.0,
        allowed: (0.0, 4.0),
        means,
    }
}

const fn gain(name: &'static str, means: &'static str) -> Parameter {
    parameter(name, "s", (-0.1, 0.1), 10.0, means)
}

/// How many waves there are, and the parameters of each.
const WAVES: usize = 5;
const OF_WAVE: usize = 10;

macro_rules! parameters {
    ($($n:literal $nth:literal),*) => {
        &[
            $(
                push(concat!("push_", $n, "_x_m_per_s2"), concat!("acceleration along x at the crest of the ", $nth, " wave")),
                push(concat!("push_", $n, "_y_m_per_s2"), concat!("acceleration along y at the crest of the ", $nth, " wave")),
                wave(concat!("wave_", $n, "_x_per_m"), concat!("phase of the ", $nth, " wave for each metre along x")),
                wave(concat!("wave_", $n, "_y_per_m"), concat!("phase of the ", $nth, " wave for each metre along y")),
                swift(concat!("velocity_", $n, "_x_s_per_m"), concat!("phase of the ", $nth, " wave for each m/s along x")),
                swift(concat!("velocity_", $n, "_y_s_per_m"), concat!("phase of the ", $nth, " wave for each m/s along y")),
                tilt(concat!("tilt_", $n, "_x_per_rad"), concat!("phase of the ", $nth, " wave for each radian about x")),
                tilt(concat!("tilt_", $n, "_y_per_rad"), concat!("phase of the ", $nth, " wave for each radian about y")),
                rate(concat!("rate_", $n, "_per_s"), concat!("phase of the ", $nth, " wave for each second since row 0")),
                phase(
                    concat!("phase_", $n, "_rad"),
                    concat!("phase of the ", $nth, " wave at rest in the centre of the level board, at row 0"),
                ),
            )*
            strength("drag_strength", "drag, deceleration at 0.1 m/s; negative drives on"),
            power("drag_power", "p, with which power of the speed the drag grows"),
            strength("side_strength", "side, acceleration to the left at 0.1 m/s"),
            power("side_power", "q, with which power of the speed the push to the side grows"),
            gain("rate_gain_x_s", "seconds by which the push is ahead of the board's angle about x"),
            gain("rate_gain_y_s", "seconds by which the push is ahead of the board's angle about y"),
        ]
    };
}

pub(super) const ABOUT: About = About {
    name: "unlisted",
    stage: Stage::Field,
    acts: Acts::OnMarble(Memory::Time),
    equation: "acceleration = Σ push cos(wave · place + swift · velocity + tilt · angles + rate t + phase) - drag (v/0.1)^p v̂ + side (v/0.1)^q ẑ × v̂ + 5/7 g gain × d tilt/dt",
    parameters: parameters!["1" "first", "2" "second", "3" "third", "4" "fourth", "5" "fifth"],
    does: "It stands for physics that no effect of the catalogue explains, as far as recordings show it: up to five waves \
           of push over the board, the marble's velocity, the board's tilt and time, a drag and a push to the side with any \
           power of the speed, and a push with the turning of the board. Accelerations are those of the rolling marble as it \
           is seen, not 7/5 of them. Above 1 m/s the powers count as at 1 m/s; a drag with the power 0 holds a resting marble \
           as friction does.",
    matters: "Where a diagnosis has learned it; it is no hypothesis of its own, since it imitates many effects.",
    looks: "Whatever the catalogue leaves: pushes that depend on the place, on the velocity, on the tilt, on the time since the \
            beginning or on how fast the board turns.",
    references: &[
        "Ljung: System Identification, 2nd ed., ch. 5 (models of nonlinear systems)",
        "Brunton, Proctor, Kutz: Discovering governing equations from data by sparse identification of nonlinear dynamical \
         systems, PNAS 113(15), 2016",
    ],
};

/// What the speeds of the power laws are bounded by (m/s): their logarithms are those of parts of one.
const SLOWEST: f64 = 1e-9;
const FASTEST: f64 = 1.0;

/// Force through the centre over the acceleration of a rolling sphere.
const FORCE: f64 = 7.0 / 5.0;

struct Wave<S: Simd> {
    push: Pair<S>,
    /// Radians a metre along x and y.
    vector: Pair<S>,
    /// Radians for each m/s along x and y, and for each radian about x and y, where any lane has some.
    swift: Option<Pair<S>>,
    tilt: Option<Pair<S>>,
    rate: Lanes<S>,
    phase: Lanes<S>,
}

/// An acceleration that grows with a power of the speed.
struct Law<S: Simd> {
    /// At `FASTEST` (m/s²).
    most: Lanes<S>,
    power: Lanes<S>,
}

pub(crate) struct Unlisted<S: Simd> {
    /// Those that push in any lane: in the others they add nothing to a sum that begins at zero.
    waves: Vec<Wave<S>>,
    drag: Option<Law<S>>,
    side: Option<Law<S>>,
    /// g times the gains about x and y.
    gain: Pair<S>,
    /// When the present substep began, after row 0, and how long it is (s).
    time: Lanes<S>,
    length: Lanes<S>,
    /// The board's angles in this substep, and how much they were others in the last (rad).
    tilt: Option<Pair<S>>,
    turned: Pair<S>,
}

impl<S: Simd> Effect<S> for Unlisted<S> {
    fn new(simd: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        let (waves, rest) = values.split_at(WAVES * OF_WAVE);
        let used = |pair: Pair<S>| (pair[0].ne(zero) | pair[1].ne(zero)).any().then_some(pair);
        let waves = waves.chunks_exact(OF_WAVE).map(|one| Wave {
            push: [one[0], one[1]],
            vector: [one[2], one[3]],
            swift: used([one[4], one[5]]),
            tilt: used([one[6], one[7]]),
            rate: one[8],
            phase: one[9],
        });
        let law = |strength: Lanes<S>, power: Lanes<S>| {
            let powers = power.to_array();
            let growth =
                Lanes::from_fn(simd, |lane| libm::pow(FASTEST / 0.1, powers[lane]));
            strength.ne(zero).any().then_some(Law {
                most: strength * growth,
                power,
            })
        };
        Self {
            waves: waves.filter(|one| used(one.push).is_some()).collect(),
            drag: law(rest[0], rest[1]),
            side: law(rest[2], rest[3]),
            gain: [GRAVITY * rest[4], GRAVITY * rest[5]],
            time: zero,
            length: zero,
            tilt: None,
            turned: [zero; 2],
        }
    }

    #[inline(always)]
    fn pass(&mut self, tilt: &Pair<S>, length: Lanes<S>) {
        self.time = self.time + self.length;
        self.length = length;
        if let Some(before) = self.tilt.replace(*tilt) {
            self.turned = [tilt[0] - before[0], tilt[1] - before[1]];
        }
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let (zero, one) = (push.length.like(0.0), push.length.like(1.0));
        let (mut x, mut y) = (zero, zero);
        for term in &self.waves {
            let mut angle = term.vector[0] * marbles.x + term.vector[1] * marbles.y;
            if let Some(swift) = term.swift {
                let [wx, wy] = marbles.rolling();
                angle = angle + swift[0] * wx + swift[1] * wy;
            }
            if let (Some(by), Some(tilt)) = (term.tilt, self.tilt) {
                angle = angle + by[0] * tilt[0] + by[1] * tilt[1];
            }
            let impulse = FORCE * ((angle + term.rate * self.time + term.phase).cos() * push.length);
            x = x + impulse * term.push[0];
            y = y + impulse * term.push[1];
        }
        x = x + self.gain[1] * self.turned[1];
        y = y - self.gain[0] * self.turned[0];
        if self.drag.is_some() || self.side.is_some() {
            // The rolling velocity after the pushes: what is slower than they are is held, not reversed.
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
            if let Some(law) = &self.drag {
                let change = law.at(ln) * push.length;
                // The law's own solution but for third powers of what is lost: v (1 - q + p/2 q² - ...).
                let (slows, drives) = (change.max(zero), change.min(zero));
                let share = 0.5 * (law.power * slows).over(speed);
                push.resistance = push.resistance + slows.over(one + share);
                let drives = FORCE * drives.over(speed);
                x = x - drives * wx;
                y = y - drives * wy;
            }
        }
        push.x = push.x + x;
        push.y = push.y + y;
    }
}

impl<S: Simd> Law<S> {
    /// Acceleration (m/s²) at a speed (m/s) of this logarithm.
    #[inline(always)]
    fn at(&self, ln: Lanes<S>) -> Lanes<S> {
        self.most * (self.power * ln).exp_decay()
    }
}
