//! A board that is not flat, as a smooth map of slopes.

use std::f64::consts::{FRAC_PI_2, PI};

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Memory, Parameter, Stage};
use crate::board::{GRAVITY, Rig};
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

/// Half waves of each mode along x and along y: all that have 1 to [`HIGHEST`] together.
const MODES: [(usize, usize); 14] = [
    (1, 0),
    (0, 1),
    (2, 0),
    (1, 1),
    (0, 2),
    (3, 0),
    (2, 1),
    (1, 2),
    (0, 3),
    (4, 0),
    (3, 1),
    (2, 2),
    (1, 3),
    (0, 4),
];

/// The most half waves of a mode: four to the board are 70 mm and more, ten radii of the marble.
const HIGHEST: usize = 4;

const fn slope(name: &'static str, means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "rad",
        range: (-0.03, 0.03),
        neutral: 0.0,
        allowed: (-1.0, 1.0),
        time_power: -2,
        optional: false,
        reach: None,
        means,
    }
}

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "slope_map",
    stage: Stage::Board,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: false,
    shrunk: true,
    noise: None,
    equation: "height = Σ slope_ij n_ij cos(i π (x/edge_x + ½)) cos(j π (y/edge_y + ½)), acceleration = -g grad(height)",
    parameters: &[
        slope("slope_10", "rms slope of one half wave along x"),
        slope("slope_01", "rms slope of one half wave along y"),
        slope("slope_20", "rms slope of two half waves along x"),
        slope("slope_11", "rms slope of one half wave along x times one along y"),
        slope("slope_02", "rms slope of two half waves along y"),
        slope("slope_30", "rms slope of three half waves along x"),
        slope("slope_21", "rms slope of two half waves along x times one along y"),
        slope("slope_12", "rms slope of one half wave along x times two along y"),
        slope("slope_03", "rms slope of three half waves along y"),
        slope("slope_40", "rms slope of four half waves along x"),
        slope("slope_31", "rms slope of three half waves along x times one along y"),
        slope("slope_22", "rms slope of two half waves along x times two along y"),
        slope("slope_13", "rms slope of one half wave along x times three along y"),
        slope("slope_04", "rms slope of four half waves along y"),
    ],
    does: "The board is not flat: warped plywood, a printed plate, paper that lifts. Its height is a sum of cosines over the \
           board, so the force is conservative, like that of any smooth surface. n_ij scales each mode so that the root mean \
           square of its slope over the board equals its coefficient.",
    matters: "Where local slopes are comparable to the commanded tilts. Slopes of one degree have been observed on real \
              boards.",
    looks: "Marbles come to rest at the same places, and drift away from others while the board is level. Residuals depend on \
            the place and not on the command.",
    references: &[
        "Strang: The discrete cosine transform, SIAM Review 41(1), 1999",
        "Gelman, Carlin, Stern, Dunson, Vehtari, Rubin: Bayesian Data Analysis, 3rd ed., ch. 20 (basis functions and shrinkage)",
    ],
};

#[derive(Clone)]
pub(crate) struct SlopeMap<S: Simd> {
    /// π over the edges (1/m).
    wave_x: f64,
    wave_y: f64,
    /// Maximum acceleration of each mode along x and y (m/s²).
    modes: [[Lanes<S>; 2]; MODES.len()],
}

impl<S: Simd> Effect<S> for SlopeMap<S> {
    fn new(_: S, rig: &Rig, values: &[Lanes<S>]) -> Self {
        let (wave_x, wave_y) = (PI / rig.board.edge_x_m, PI / rig.board.edge_y_m);
        Self {
            wave_x,
            wave_y,
            modes: std::array::from_fn(|mode| {
                let (i, j) = MODES[mode];
                let (kx, ky) = (i as f64 * wave_x, j as f64 * wave_y);
                // The mean of a squared sine or cosine is a half, that of a cosine without waves is one; a
                // slope along x has a sine along x and a cosine along y.
                let mean = |waves: usize| if waves == 0 { 1.0 } else { 0.5 };
                let square = 0.5 * (kx * kx * mean(j) + ky * ky * mean(i));
                let unit = GRAVITY / square.sqrt() * values[mode];
                [kx * unit, ky * unit]
            }),
        }
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let (sin_x, cos_x) = waves(self.wave_x * marbles.x);
        let (sin_y, cos_y) = waves(self.wave_y * marbles.y);
        let zero = marbles.x.like(0.0);
        let (mut x, mut y) = (zero, zero);
        for (&(i, j), [along_x, along_y]) in MODES.iter().zip(&self.modes) {
            x = x + *along_x * (sin_x[i] * cos_y[j]);
            y = y + *along_y * (cos_x[i] * sin_y[j]);
        }
        push.x = push.x + x * push.length;
        push.y = push.y + y * push.length;
    }
}

/// Sines and cosines of the multiples of an angle that is a right angle ahead of this one, within half a turn.
#[inline(always)]
fn waves<S: Simd>(angle: Lanes<S>) -> ([Lanes<S>; HIGHEST + 1], [Lanes<S>; HIGHEST + 1]) {
    let (sin, cos) = angle.clamp(angle.like(FRAC_PI_2)).sin_cos();
    let (mut sines, mut cosines) = ([angle.like(0.0); HIGHEST + 1], [angle.like(1.0); HIGHEST + 1]);
    (sines[1], cosines[1]) = (cos, -sin);
    for n in 2..=HIGHEST {
        // sin(n a) = 2 cos(a) sin((n - 1) a) - sin((n - 2) a), and the same of cosines.
        sines[n] = 2.0 * (cosines[1] * sines[n - 1]) - sines[n - 2];
        cosines[n] = 2.0 * (cosines[1] * cosines[n - 1]) - cosines[n - 2];
    }
    (sines, cosines)
}
