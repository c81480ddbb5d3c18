//! A second-order lag of the knob.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage, by_axis};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "second_order_lag",
    stage: Stage::Actuation,
    acts: Hook::OnKnob { moves: true },
    hypothesis: false,
    shrunk: false,
    noise: None,
    equation: "T² d²θ/dt² + 2 ζ T dθ/dt + θ = command",
    parameters: &[
        Parameter {
            name: "time_constant_s",
            unit: "s",
            range: (0.01, 0.5),
            neutral: 0.0,
            allowed: (0.0, 1e3),
            time_power: 1,
            optional: false,
            reach: None,
            means: "T, inverse of the undamped angular frequency; mean of both axes",
        },
        Parameter {
            name: "damping_ratio",
            unit: "",
            range: (0.2, 2.0),
            neutral: 1.0,
            allowed: (0.05, 5.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "ζ; below 1 the knob overshoots, above 1 it does not",
        },
        Parameter::y_minus_x("y_minus_x_s", "s", 0.25, 2e3, 1),
    ],
    does: "The knob has inertia. A servo accelerates it towards its command and brakes it; with too little damping it \
           overshoots.",
    matters: "When commands change within a few time constants, and on steps.",
    looks: "Step responses begin smoothly, whereas those of a first-order lag begin with their steepest slope. They may \
            oscillate about the command before they settle. The phase falls by up to 180° with frequency; that of a \
            first-order lag by 90°.",
    references: &["Åström, Murray: Feedback Systems, 2nd ed., sect. 7.3 (second-order systems)"],
};

/// Substep over time constant below which a difference of exponentials is dominated by rounding.
const SHORT: f64 = 1e-9;
/// Squared product of frequency and time below which sine and cosine, or hyperbolic ones, are by their series.
const NEAR: f64 = 1.0;
/// Terms of these series: the next is below 1e-16 there.
const TERMS: u32 = 9;

#[derive(Clone)]
pub(crate) struct SecondOrderLag<S: Simd> {
    time: Pair<S>,
    damping: Lanes<S>,
    /// The knob's angles (rad) and their rates times the time constant (rad).
    state: Option<[Pair<S>; 2]>,
    /// Length of the substep that the steps are for.
    length: Lanes<S>,
    steps: [Step<S>; 2],
}

/// Propagation over a substep of the deviation from the command and of the rate times T.
#[derive(Clone)]
struct Step<S: Simd> {
    way: Pair<S>,
    rate: Pair<S>,
    /// Mean deviation over the substep.
    on_average: Pair<S>,
}

impl<S: Simd> Step<S> {
    /// With τ = length/T and q = 1 - ζ², `way` and `rate` change by exp(-ζ τ) times
    ///
    /// ```text
    /// [ C + ζ S      S    ]      C = cos(√q τ),  S = sin(√q τ)/√q
    /// [   -S      C - ζ S ]
    /// ```
    #[inline(always)]
    fn new(time: Lanes<S>, damping: Lanes<S>, length: Lanes<S>) -> Self {
        let (zero, one) = (time.like(0.0), time.like(1.0));
        let follows = time.gt(zero);
        let share = length.over(follows.select(time, one));
        let [c, s] = damped(share, damping);
        let (way, rate) = ([c + damping * s, s], [-s, c - damping * s]);
        // The equation of motion, integrated: (rate before - after + 2 ζ (way before - after))/τ.
        let lasts = share.gt(SHORT * one);
        let inverse = one.over(lasts.select(share, one));
        let twice = 2.0 * damping;
        let on_average = [
            ((-rate[0]) + twice * (one - way[0])) * inverse,
            ((one - rate[1]) - twice * way[1]) * inverse,
        ];
        let [of_way, of_rate] = [[one, zero], [zero, one]];
        let chosen = |of: Pair<S>, if_still: Pair<S>| {
            let of = [0, 1].map(|i| lasts.select(of[i], if_still[i]));
            of.map(|of| follows.select(of, zero))
        };
        Self {
            way: chosen(way, of_way),
            rate: chosen(rate, of_rate),
            on_average: chosen(on_average, of_way),
        }
    }
}

/// exp(-ζ τ) cos(√q τ) and exp(-ζ τ) sin(√q τ)/√q with q = 1 - ζ², hyperbolic where it is below zero.
#[inline(always)]
fn damped<S: Simd>(share: Lanes<S>, damping: Lanes<S>) -> Pair<S> {
    use std::f64::consts::FRAC_PI_2;
    let one = share.like(1.0);
    let q = one - damping * damping;
    let root = q.abs().sqrt();
    let angle = root * share;
    let near = (angle * angle).lt(one.like(NEAR));
    let decay = (-(damping * share)).exp_decay();
    let inverse = one.over(near.select(one, root));
    // Near critical damping by the series in -q τ².
    let square = -(q * share * share);
    let (mut cosine, mut sine) = (one, one);
    for term in (1..=TERMS).rev() {
        let n = f64::from(2 * term);
        cosine = one + 1.0 / (n * (n - 1.0)) * (square * cosine);
        sine = one + 1.0 / (n * (n + 1.0)) * (square * sine);
    }
    let series = [decay * cosine, decay * (share * sine)];
    // Below it the knob swings, above it two exponentials remain: -ζ ± √-q.
    let swings = [
        decay * angle.cos(),
        decay * ((angle - one.like(FRAC_PI_2)).cos() * inverse),
    ];
    let slow = (-share.over(damping + root)).exp_decay();
    let fast = (-((damping + root) * share)).exp_decay();
    let creeps = [0.5 * (slow + fast), 0.5 * ((slow - fast) * inverse)];
    let is_over = q.lt(one.like(0.0));
    [0, 1].map(|i| near.select(series[i], is_over.select(creeps[i], swings[i])))
}

impl<S: Simd> Effect<S> for SecondOrderLag<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let [time, damping, y_minus_x] = [values[0], values[1], values[2]];
        let zero = time.like(0.0);
        let time = by_axis(time, y_minus_x).map(|time| time.max(zero));
        Self {
            time,
            damping,
            state: None,
            length: zero,
            steps: time.map(|time| Step::new(time, damping, zero)),
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, length: Lanes<S>) {
        let Some([turned, rates]) = &mut self.state else {
            self.state = Some([*knob, knob.map(|knob| knob.like(0.0))]);
            return;
        };
        if length.ne(self.length).any() {
            self.length = length;
            self.steps = self
                .time
                .map(|time| Step::new(time, self.damping, length));
        }
        for axis in 0..2 {
            let (step, command) = (&self.steps[axis], knob[axis]);
            let (way, rate) = (turned[axis] - command, rates[axis]);
            let sum = |of: &Pair<S>| of[0] * way + of[1] * rate;
            turned[axis] = command + sum(&step.way);
            rates[axis] = sum(&step.rate);
            knob[axis] = command + sum(&step.on_average);
        }
    }
}
