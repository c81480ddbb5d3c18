//! The problem of a fit: model, free parameters, recordings.

use crate::board::Rig;
use crate::effects::{EffectSpec, Hook, Parameter};
use crate::engine::{Engine, Hold};
use crate::error::{Error, Result};
use crate::parameters::{GEAR_Y, NAMES, Parameters, TIME};

/// A parameter of the model: held or free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ParameterSpec {
    /// Held at this value.
    Held(f64),
    /// Free.
    Free {
        /// The plausible values, low and high; a fit may leave them by as much as they are wide, and magnitudes by at
        /// most a factor of three.
        range: (f64, f64),
        /// The first start value; without it any value of the range.
        start: Option<f64>,
    },
}

/// An effect whose parameters take part in a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Hypothesis {
    /// The effect.
    pub effect: &'static EffectSpec,
    /// In the order of [`EffectSpec::parameters`].
    pub values: Vec<ParameterSpec>,
}

impl Hypothesis {
    /// An effect with all parameters free over their plausible ranges; switches at their usual values, and
    /// optional parameters neutral.
    pub fn free(effect: &'static EffectSpec) -> Self {
        let free = |one: &Parameter| {
            if one.is_choice() || one.optional {
                return ParameterSpec::Held(one.neutral);
            }
            ParameterSpec::Free {
                range: one.range,
                start: None,
            }
        };
        Self {
            effect,
            values: effect.parameters.iter().map(free).collect(),
        }
    }
}

/// A recording: commands and observations.
#[derive(Debug, Clone, Copy)]
pub struct Recording<'a> {
    /// Knob angles (rad), a pair a row; command i holds from row i to row i + 1.
    pub commands: &'a [[f64; 2]],
    /// Knob angles before row 0 (rad).
    pub knobs_before: [f64; 2],
    /// Duration of each command (s), if known.
    pub durations: Option<&'a [f64]>,
    /// Positions (board edges); NaN in rows where the tracker lost the marble, in all rows without a marble.
    pub observed: &'a [[f64; 2]],
    /// Measured angles of the board about x and y (rad), if any; NaN in rows without.
    pub tilt: Option<&'a [[f64; 2]]>,
    /// Path length up to each row (board edges), if known.
    pub way: Option<&'a [f64]>,
    /// Smoothed path, one position per row (board edges), if known; without it the marble's orientation is constant.
    pub path: Option<&'a [[f64; 2]]>,
}

/// Rows of a recording that are predicted from one start state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stretch {
    /// Index of the recording.
    pub recording: usize,
    /// First row.
    pub first: usize,
    /// Number of rows.
    pub rows: usize,
    /// Whether the marble is at rest in the first row.
    pub at_rest: bool,
}

/// Free parameters, effects and the recordings to fit.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// Board and marble.
    pub rig: &'a Rig,
    /// The five parameters.
    pub parameters: [ParameterSpec; 5],
    /// The effects.
    pub effects: &'a [Hypothesis],
    /// The recordings: all with durations or none; with durations the time scale must be held.
    pub recordings: &'a [Recording<'a>],
    /// The predicted stretches.
    pub stretches: &'a [Stretch],
    /// Standard deviation of the tracker (board edges), if known: lower bound of the residuals' scale.
    pub noise: Option<f64>,
    /// Standard deviation of the tilt sensor (rad), if known.
    pub tilt_noise: Option<f64>,
    /// The engine.
    pub engine: Engine,
    /// How a command continues from its row to the next.
    pub hold: Hold,
    /// Number of threads, by default one for each core; the result does not depend on it.
    pub threads: Option<usize>,
}

/// The effect whose first two parameters differ between recordings; its third is their size.
pub(super) const LEAN: &str = "lean";

impl Problem<'_> {
    /// The slots of the lean, if it is estimated: a shrunk pair for each recording.
    pub(super) fn lean(&self) -> Option<std::ops::Range<usize>> {
        let effects = self.effects.iter().zip(self.slots_of_effects());
        let is_sought = |one: &Hypothesis| {
            let free = |sought: &ParameterSpec| matches!(sought, ParameterSpec::Free { .. });
            one.effect.name == LEAN && one.values.first().is_some_and(free)
        };
        effects
            .filter(|(one, _)| is_sought(one))
            .map(|(_, slots)| slots)
            .next()
    }

    /// All parameters, the effects' behind the five.
    pub(super) fn sought(&self) -> impl Iterator<Item = ParameterSpec> + '_ {
        let of_effects = self
            .effects
            .iter()
            .flat_map(|one| one.values.iter().copied());
        self.parameters.into_iter().chain(of_effects)
    }

    /// The places of each effect's parameters among all.
    pub(super) fn slots_of_effects(&self) -> Vec<std::ops::Range<usize>> {
        let mut end = self.parameters.len();
        let slots = |one: &Hypothesis| {
            let begin = end;
            end += one.values.len();
            begin..end
        };
        self.effects.iter().map(slots).collect()
    }

    /// The effect's name and the catalogue's parameter of a slot; none for the five.
    pub(super) fn effect_parameter(
        &self,
        slot: usize,
    ) -> Option<(&'static str, &'static Parameter)> {
        let of_effect = |one: &Hypothesis| {
            let name = one.effect.name;
            one.effect
                .parameters
                .iter()
                .map(move |parameter| (name, parameter))
        };
        let place = slot.checked_sub(self.parameters.len())?;
        self.effects.iter().flat_map(of_effect).nth(place)
    }

    pub(super) fn name(&self, slot: usize) -> String {
        match self.effect_parameter(slot) {
            Some((effect, parameter)) => format!("{} of {effect}", parameter.name),
            None => NAMES[slot].to_owned(),
        }
    }

    /// The largest angle of a knob in any recording (rad).
    pub(super) fn largest_knob(&self, axis: usize) -> f64 {
        let commands = self.recordings.iter().flat_map(|one| one.commands);
        commands.map(|knobs| knobs[axis].abs()).fold(0.0, f64::max)
    }

    /// Whether recordings have durations of rows.
    pub(super) fn is_stamped(&self) -> bool {
        self.recordings
            .first()
            .is_some_and(|one| one.durations.is_some())
    }

    /// Whether a window depends on earlier rows beyond the marble's state, path length and orientation.
    pub(super) fn remembers(&self) -> bool {
        let has_memory = |acts: Hook| {
            matches!(
                acts,
                Hook::OnArrival
                    | Hook::OnClock
                    | Hook::OnKnob { .. }
                    | Hook::OnMarbleAndPicture
                    | Hook::OnExposure
            )
        };
        self.effects.iter().any(|one| has_memory(one.effect.acts))
    }

    /// Whether an effect depends on the marble's orientation.
    pub(super) fn turns(&self) -> bool {
        self.effects.iter().any(|one| one.effect.turns())
    }

    /// Whether the camera may show a marble beyond the rim.
    pub(super) fn bends_pictures(&self) -> bool {
        self.effects
            .iter()
            .any(|one| one.effect.acts.is_on_picture() || one.effect.acts == Hook::OnExposure)
    }

    /// The tracker's standard deviation (board edges), given or estimated.
    pub(super) fn tracker_noise(&self) -> f64 {
        self.noise.unwrap_or_else(|| {
            super::robust::tracker_noise(
                self.stretches.iter().map(|stretch| self.observed(stretch)),
            )
        })
    }

    pub(super) fn observed(&self, stretch: &Stretch) -> &[[f64; 2]] {
        &self.recordings[stretch.recording].observed[stretch.first..stretch.first + stretch.rows]
    }

    /// The measured tilt of a stretch.
    pub(super) fn tilt(&self, stretch: &Stretch) -> Option<&[[f64; 2]]> {
        let tilt = self.recordings[stretch.recording].tilt?;
        Some(&tilt[stretch.first..stretch.first + stretch.rows])
    }

    /// Refuses problems that cannot be fitted.
    pub(super) fn check(&self) -> Result<()> {
        self.rig.check()?;
        for (name, noise) in [("noise", self.noise), ("tilt_noise", self.tilt_noise)] {
            if let Some(noise) = noise.filter(|noise| !(*noise > 0.0 && noise.is_finite())) {
                return Err(Error::invalid(name, "a number above 0", noise));
            }
        }
        self.check_recordings()?;
        for one in self.effects {
            let (expected, got) = (one.effect.parameters.len(), one.values.len());
            if expected != got {
                return Err(Error::invalid(
                    one.effect.name,
                    &format!("{expected} values"),
                    got,
                ));
            }
        }
        for (slot, sought) in self.sought().enumerate() {
            self.check_sought(slot, sought)?;
        }
        let mut typical = [0.0; 5];
        for (value, sought) in typical.iter_mut().zip(self.parameters) {
            *value = match sought {
                ParameterSpec::Held(value) => value,
                ParameterSpec::Free {
                    range: (low, high), ..
                } => f64::midpoint(low, high),
            };
        }
        Parameters::from(typical).check()
    }

    fn check_recordings(&self) -> Result<()> {
        for (i, one) in self.recordings.iter().enumerate() {
            let rows = one.commands.len();
            if one.durations.is_some() != self.is_stamped() {
                let what = format!("durations of recording {i}");
                let expected = "all recordings stamped, or none";
                return Err(Error::invalid(what, expected, "both"));
            }
            let lengths = [
                ("observed", Some(one.observed.len())),
                ("durations", one.durations.map(<[_]>::len)),
                ("tilt", one.tilt.map(<[_]>::len)),
                ("way", one.way.map(<[_]>::len)),
                ("path", one.path.map(<[_]>::len)),
            ];
            for (name, length) in lengths {
                if let Some(length) = length.filter(|&length| length != rows) {
                    let what = format!("{name} of recording {i}");
                    return Err(Error::invalid(what, &format!("{rows} rows"), length));
                }
            }
            if let Some(knob) = one
                .commands
                .as_flattened()
                .iter()
                .find(|knob| !knob.is_finite())
            {
                return Err(Error::invalid(
                    format!("commands of recording {i}"),
                    "finite numbers",
                    knob,
                ));
            }
        }
        for (i, stretch) in self.stretches.iter().enumerate() {
            let rows = self
                .recordings
                .get(stretch.recording)
                .map_or(0, |one| one.commands.len());
            if stretch.rows == 0 || stretch.first + stretch.rows > rows {
                let got = format!("rows {} to {}", stretch.first, stretch.first + stretch.rows);
                return Err(Error::invalid(
                    format!("stretch {i}"),
                    "rows of a recording",
                    got,
                ));
            }
        }
        Ok(())
    }

    fn check_sought(&self, slot: usize, sought: ParameterSpec) -> Result<()> {
        let name = || self.name(slot);
        match sought {
            ParameterSpec::Held(value) if !value.is_finite() => {
                let infinite = self
                    .effect_parameter(slot)
                    .is_some_and(|(_, one)| one.neutral == value);
                if infinite {
                    Ok(())
                } else {
                    Err(Error::invalid(name(), "a finite number", value))
                }
            }
            ParameterSpec::Free { .. } if slot == TIME && self.is_stamped() => Err(Error::invalid(
                name(),
                "a held value, since the recordings are stamped",
                "a free one",
            )),
            ParameterSpec::Free {
                range: (low, high),
                start,
            } => {
                let finite = low.is_finite() && high.is_finite() && low <= high;
                let below_zero = slot > GEAR_Y && slot < 5 && low < 0.0;
                if !finite || below_zero {
                    let got = format!("{low} to {high}");
                    return Err(Error::invalid(
                        format!("range of {}", name()),
                        "a low and a higher end",
                        got,
                    ));
                }
                if slot <= GEAR_Y && low == 0.0 && high == 0.0 {
                    let what = format!("range of {}", NAMES[slot]);
                    return Err(Error::invalid(what, "a range of nonzero width", "0 to 0"));
                }
                match start {
                    Some(start) if !start.is_finite() => Err(Error::invalid(
                        format!("start of {}", name()),
                        "a finite number",
                        start,
                    )),
                    _ => Ok(()),
                }
            }
            ParameterSpec::Held(_) => Ok(()),
        }
    }
}
