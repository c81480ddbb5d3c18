//! What the catalogue says of an effect.

use std::fmt;

use crate::error::{Error, Result};

/// Where in the way from command to picture an effect sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Between the command and the knob.
    Actuation,
    /// When things happen.
    Timing,
    /// Between the knob and the board, and the shape of the board.
    Board,
    /// Where the marble touches board and rim.
    Contact,
    /// The air around it.
    Air,
    /// Forces at a distance.
    Field,
    /// Between the marble and what the tracker reports.
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

/// The place in the simulation where an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(
    clippy::enum_variant_names,
    reason = "an effect acts on the knob, on the tilt: so it is said"
)]
pub(crate) enum Hook {
    /// When commands arrive.
    OnArrival,
    /// How long a row lasts.
    OnClock,
    /// The knob's angles; within a row too if it moves while the command holds still.
    OnKnob { moves: bool },
    /// The board's angles.
    OnTilt,
    /// What acts on the marble in each substep.
    OnMarble(Memory),
    /// The rim.
    OnRims,
    /// How the board resists a spin about the vertical.
    OnSpin,
    /// Where the camera sees the marble.
    OnPicture,
    /// When the picture was taken.
    OnExposure,
    /// What the tilt sensor reports.
    OnGauge,
}

/// What an effect on the marble depends on besides where the marble is and how it moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Memory {
    /// Nothing.
    None,
    /// How late it is, and how the board turns.
    Time,
    /// How the marble has been turned by its path.
    Turning,
}

/// A parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Its name; it carries the unit where that could be doubted.
    pub name: &'static str,
    /// SI, empty for a plain number.
    pub unit: &'static str,
    /// The plausible values: where a search looks; of a choice the usual answer twice.
    pub range: (f64, f64),
    /// The value without effect.
    pub neutral: f64,
    /// The values that physics allows.
    pub allowed: (f64, f64),
    /// With which power of the time scale it changes where all of the motion runs slower under weaker pushes,
    /// along the same path: 1 of a time, -1 of a speed, -2 of a push, or of a tilt of the board.
    pub time_power: i8,
    /// Whether it refines the effect: every fit holds it at its neutral value unless it is named. Optional
    /// parameters come after all others of their effect.
    pub optional: bool,
    /// The values that a fit may take without a price; `None` for those of `range`. It is wider where real
    /// rigs have values that a search seldom needs, which would make its draws too coarse.
    pub reach: Option<(f64, f64)>,
    /// What it is, in a few words.
    pub means: &'static str,
}

impl Parameter {
    /// A place on the paper's board, along x or along y.
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

    /// A question that is answered by 1 (yes) or 0 (no): both are tried, and nothing between them.
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

    /// Optional: by how much another parameter of the effect, the mean of both axes, is larger about y than about x.
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
            means: "its value about y minus that about x",
        }
    }

    /// Whether it is an angle that is looked for half-way round or farther.
    pub(crate) fn is_wide(&self) -> bool {
        self.unit == "rad" && self.range.1 - self.range.0 >= std::f64::consts::PI
    }

    /// Whether it is a question of yes or no, which no fit slides along.
    pub fn is_choice(&self) -> bool {
        self.range.0 == self.range.1
    }
}

/// What the catalogue says of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectSpec {
    /// Its name in every file and report.
    pub name: &'static str,
    /// Where it sits.
    pub stage: Stage,
    pub(crate) acts: Hook,
    /// Whether today's diagnosis tries it.
    pub hypothesis: bool,
    /// Whether its parameters are drawn from one normal distribution about zero, whose size is estimated: a fit
    /// shrinks them.
    pub shrunk: bool,
    /// The physics, in one line.
    pub equation: &'static str,
    /// Its parameters, in the order in which arrays hold them.
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

    /// Whether it matters how the marble has been turned by its path.
    pub fn turns(&self) -> bool {
        self.acts == Hook::OnMarble(Memory::Turning)
    }

    /// Whether it is a law of the rim: how a marble leaves it.
    pub fn is_of_rims(&self) -> bool {
        self.acts == Hook::OnRims
    }

    /// Whether it changes what is measured of the board's angles, and nothing else.
    pub fn is_of_gauge(&self) -> bool {
        self.acts == Hook::OnGauge
    }

    /// Whether it acts between the command and the board's tilt: none of it is left where a measured tilt is
    /// played in the place of the commands.
    pub fn moves_board(&self) -> bool {
        matches!(
            self.acts,
            Hook::OnArrival | Hook::OnKnob { .. } | Hook::OnTilt
        )
    }

    /// Refuses values that no physics allows.
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
