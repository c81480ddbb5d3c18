//! The catalogue entry of an effect.

use std::fmt;

use crate::error::{Error, Result};

/// Position of an effect in the chain from command to picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Between the command and the knob.
    Actuation,
    /// The times of commands and rows.
    Timing,
    /// Between the knob and the board, and the shape of the board.
    Board,
    /// Where the marble touches board and rim.
    Contact,
    /// Air resistance.
    Air,
    /// Forces at a distance.
    Field,
    /// Between the marble and the tracker's output.
    Sensing,
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Actuation => "actuation",
            Self::Timing => "timing",
            Self::Board => "board",
            Self::Contact => "contact",
            Self::Air => "air",
            Self::Field => "field",
            Self::Sensing => "sensing",
        })
    }
}

/// A size of [`crate::Noise`] that a rig has because of an effect, and not without it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum EffectNoise {
    /// [`crate::Noise::jitter`], of effects that delay commands at random.
    Jitter,
    /// [`crate::Noise::release`], of effects that hold a marble at rest more firmly than they brake a rolling one.
    Release,
}

impl fmt::Display for EffectNoise {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Jitter => "jitter",
            Self::Release => "release",
        })
    }
}

/// The place in the simulation where an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(
    clippy::enum_variant_names,
    reason = "an effect acts on the knob, on the tilt: the names say so"
)]
pub(crate) enum Hook {
    /// Arrival times of commands.
    OnArrival,
    /// Durations of rows.
    OnClock,
    /// The knob's angles; with `moves` also within a row, while the command is constant.
    OnKnob { moves: bool },
    /// The board's angles.
    OnTilt,
    /// The marble's acceleration in each substep.
    OnMarble(Memory),
    /// The marble's acceleration, which depends on the time, and the marble's position in the picture.
    OnMarbleAndPicture,
    /// The rim.
    OnRims,
    /// The board's friction against spin about the vertical.
    OnSpin,
    /// The marble's position in the picture.
    OnPicture,
    /// The time of the picture.
    OnExposure,
    /// The tilt sensor's output.
    OnGauge,
}

impl Hook {
    /// Whether the effect accelerates the marble.
    pub(crate) fn is_on_marble(self) -> bool {
        matches!(self, Self::OnMarble(_) | Self::OnMarbleAndPicture)
    }

    /// Whether the effect moves the marble in the picture.
    pub(crate) fn is_on_picture(self) -> bool {
        matches!(self, Self::OnPicture | Self::OnMarbleAndPicture)
    }
}

/// State that an effect on the marble depends on besides the marble's position and velocity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Memory {
    /// Nothing.
    None,
    /// The marble's orientation, from its path.
    Turning,
}

/// A parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Its name, with the unit where it is not obvious.
    pub name: &'static str,
    /// SI, empty for a plain number.
    pub unit: &'static str,
    /// Plausible values, in which a search draws; for a choice, the usual value twice.
    pub range: (f64, f64),
    /// The value without effect.
    pub neutral: f64,
    /// The physically possible values.
    pub allowed: (f64, f64),
    /// Power of the time scale with which it changes if the marble follows the same path more slowly under weaker
    /// accelerations: 1 for a time, -1 for a speed, -2 for an acceleration or a tilt of the board.
    pub time_power: i8,
    /// Whether it is a refinement, which a fit holds at its neutral value unless the parameter is named. Optional
    /// parameters come after all others of their effect.
    pub optional: bool,
    /// The values that a fit does not penalise; `None` for `range`. It is wider than `range` where real rigs have
    /// rare values that would make the draws of a search too coarse.
    pub reach: Option<(f64, f64)>,
    /// A short description.
    pub means: &'static str,
}

impl Parameter {
    /// A coordinate on the paper's board, along x or y.
    pub(super) const fn on_board(
        name: &'static str,
        half_edge_m: f64,
        means: &'static str,
    ) -> Self {
        Self {
            name,
            unit: "m",
            range: (-half_edge_m, half_edge_m),
            neutral: 0.0,
            allowed: (-10.0, 10.0),
            time_power: 0,
            optional: false,
            reach: None,
            means,
        }
    }

    /// A switch with the values 1 (yes) and 0 (no). A fit tries both and nothing in between.
    pub(super) const fn choice(name: &'static str, usual: f64, means: &'static str) -> Self {
        Self {
            name,
            unit: "",
            range: (usual, usual),
            neutral: usual,
            allowed: (0.0, 1.0),
            time_power: 0,
            optional: false,
            reach: None,
            means,
        }
    }

    /// Optional: the value about y minus the value about x of another parameter, which is the mean of both axes.
    pub(super) const fn y_minus_x(
        name: &'static str,
        unit: &'static str,
        half_range: f64,
        most: f64,
        time_power: i8,
    ) -> Self {
        Self {
            name,
            unit,
            range: (-half_range, half_range),
            neutral: 0.0,
            allowed: (-most, most),
            time_power,
            optional: true,
            reach: None,
            means: "value about y minus value about x",
        }
    }

    /// Whether it is an angle that is searched over half a turn or more.
    pub(crate) fn is_wide(&self) -> bool {
        self.unit == "rad" && self.range.1 - self.range.0 >= std::f64::consts::PI
    }

    /// Whether it is a switch, which no fit changes continuously.
    pub fn is_choice(&self) -> bool {
        self.range.0 == self.range.1
    }
}

/// The catalogue entry of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectSpec {
    /// Its name in all files and reports.
    pub name: &'static str,
    /// Its position in the chain from command to picture.
    pub stage: Stage,
    pub(crate) acts: Hook,
    /// Whether the diagnosis tests it.
    pub hypothesis: bool,
    /// Whether a fit shrinks its parameters: they have a common normal prior about zero with an estimated size.
    pub shrunk: bool,
    /// What is random in a filter with it.
    pub noise: Option<EffectNoise>,
    /// Its equation, in one line.
    pub equation: &'static str,
    /// Its parameters, in the order of arrays.
    pub parameters: &'static [Parameter],
    /// What it does.
    pub does: &'static str,
    /// When it matters.
    pub matters: &'static str,
    /// What it looks like in data.
    pub looks: &'static str,
    /// Where to read more.
    pub references: &'static [&'static str],
}

impl EffectSpec {
    /// The values without effect.
    pub fn neutral(&self) -> Vec<f64> {
        self.parameters.iter().map(|one| one.neutral).collect()
    }

    /// Whether it depends on the marble's orientation.
    pub fn turns(&self) -> bool {
        self.acts == Hook::OnMarble(Memory::Turning)
    }

    /// Whether it changes the rim's contact law.
    pub fn is_of_rims(&self) -> bool {
        self.acts == Hook::OnRims
    }

    /// Whether it changes the measured angles of the board and nothing else.
    pub fn is_of_gauge(&self) -> bool {
        self.acts == Hook::OnGauge
    }

    /// Whether it acts between the command and the board's tilt. It has no effect where a measured tilt replaces
    /// the commands.
    pub fn moves_board(&self) -> bool {
        matches!(
            self.acts,
            Hook::OnArrival | Hook::OnKnob { .. } | Hook::OnTilt
        )
    }

    /// Refuses physically impossible values.
    pub(crate) fn check(&self, values: &[f64]) -> Result<()> {
        for (parameter, &value) in self.parameters.iter().zip(values) {
            let (low, high) = parameter.allowed;
            let between = parameter.is_choice() && value != low && value != high;
            if between || !(low..=high).contains(&value) {
                let what = format!("{} of {}", parameter.name, self.name);
                let expected = match (low.is_finite(), high.is_finite()) {
                    _ if parameter.is_choice() => format!("{low} or {high}"),
                    (true, true) => format!("a number from {low} to {high}"),
                    (true, false) => format!("a number of at least {low}"),
                    _ => "a finite number".to_owned(),
                };
                return Err(Error::invalid(what, &expected, value));
            }
        }
        Ok(())
    }
}
