//! The engine's catalogue of effects as plain Python values.

use labsim::EffectInstance;
use labsim::effects::{apart, effect, effects};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

use crate::arrays;
use crate::errors;

/// Name, unit, plausible low and high, neutral, allowed low and high, power of the time scale, meaning, whether
/// it is optional, and the reach of a fit.
type Parameter = (
    &'static str,
    &'static str,
    f64,
    f64,
    f64,
    f64,
    f64,
    i8,
    &'static str,
    bool,
    (f64, f64),
);

/// Whether it is in the catalogue, depends on the marble's orientation, is tested by the diagnosis, has shrunk
/// parameters, acts between command and tilt, and changes the rim's contact law.
type Flags = (bool, bool, bool, bool, bool, bool);

/// Name, stage, equation, parameters, what it does, when it matters, what it looks like, references, flags, and what
/// is random with it.
type EffectSpec = (
    &'static str,
    String,
    &'static str,
    Vec<Parameter>,
    &'static str,
    &'static str,
    &'static str,
    Vec<&'static str>,
    Flags,
    Option<String>,
);

/// The catalogue of effects in the order in which they act, then the effects that are no hypotheses; see `irt.effects`.
#[pyfunction(name = "effects")]
pub(crate) fn catalogue() -> Vec<EffectSpec> {
    let listed = effects().iter().map(|about| (about, true));
    let apart = apart().iter().map(|about| (about, false));
    listed
        .chain(apart)
        .map(|(about, is_listed)| {
            let parameters = about.parameters.iter().map(|one| {
                let ((low, high), (least, most)) = (one.range, one.allowed);
                (
                    one.name,
                    one.unit,
                    low,
                    high,
                    one.neutral,
                    least,
                    most,
                    one.time_power,
                    one.means,
                    one.optional,
                    one.reach.unwrap_or(one.range),
                )
            });
            (
                about.name,
                about.stage.to_string(),
                about.equation,
                parameters.collect(),
                about.does,
                about.matters,
                about.looks,
                about.references.to_vec(),
                (
                    is_listed,
                    about.turns(),
                    about.hypothesis,
                    about.shrunk,
                    about.moves_board(),
                    about.is_of_rims(),
                ),
                about.noise.map(|one| one.to_string()),
            )
        })
        .collect()
}

/// Effects by name with the values of their parameters, `(1 or n, p)` each.
pub(crate) struct Values(Vec<(&'static labsim::EffectSpec, Vec<f64>)>);

impl Values {
    pub(crate) fn new(named: &[(String, PyReadonlyArray2<'_, f64>)]) -> PyResult<Self> {
        let of_one = |(name, values): &(String, PyReadonlyArray2<'_, f64>)| {
            let about = effect(name).map_err(errors::to_python)?;
            Ok((about, values.as_array().iter().copied().collect()))
        };
        named.iter().map(of_one).collect::<PyResult<_>>().map(Self)
    }

    pub(crate) fn chosen(&self, rollouts: usize) -> Vec<EffectInstance<'_>> {
        self.0
            .iter()
            .map(|(effect, values)| EffectInstance {
                effect,
                values: arrays::shared_or_each(values, effect.parameters.len(), rollouts),
            })
            .collect()
    }
}
