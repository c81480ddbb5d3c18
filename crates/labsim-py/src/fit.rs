//! Least squares over rollouts: arrays in, a dictionary of arrays out.

use labsim::effects::effect;
use labsim::error::Error;
use labsim::fit::{Hypothesis, Information, ParameterSpec, Problem, Recording, Settings, Stretch};
use labsim::{Engine, Hold, Rig};
use numpy::ndarray::{Array1, Array2};
use numpy::{IntoPyArray, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{arrays, errors, interrupt};

pub(crate) type Matrix<'py> = PyReadonlyArray2<'py, f64>;
type Vector<'py> = PyReadonlyArray1<'py, f64>;

/// A problem with Rust's own data, without Python objects.
pub(crate) struct Owned {
    rig: Rig,
    parameters: [ParameterSpec; 5],
    effects: Vec<Hypothesis>,
    recordings: Vec<OwnedRecording>,
    stretches: Vec<Stretch>,
    noise: Option<f64>,
    tilt_noise: Option<f64>,
    engine: Engine,
    hold: Hold,
    threads: Option<usize>,
}

struct OwnedRecording {
    commands: Vec<[f64; 2]>,
    knobs_before: [f64; 2],
    durations: Option<Vec<f64>>,
    observed: Vec<[f64; 2]>,
    way: Vec<f64>,
    path: Vec<[f64; 2]>,
    tilt: Option<Vec<[f64; 2]>>,
}

type AskedRecording<'py> = (
    Matrix<'py>,
    Option<Vector<'py>>,
    Matrix<'py>,
    Vector<'py>,
    Matrix<'py>,
    Option<Matrix<'py>>,
);

/// The arguments from `irt.fitting.problem`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Asked<'py> {
    board: [f64; 6],
    marble: [f64; 3],
    /// (5, 3): low, high and start of each parameter; a held one has no low end and its value as start.
    parameters: Matrix<'py>,
    /// The same of each effect's parameters.
    effects: Vec<(String, Matrix<'py>)>,
    /// Commands, durations and positions of each recording, path length and path up to each row, and tilt.
    recordings: Vec<AskedRecording<'py>>,
    knobs_before: Matrix<'py>,
    /// Recording, first row, rows, whether the marble rests.
    stretches: Vec<(usize, usize, usize, bool)>,
    noise: Option<f64>,
    tilt_noise: Option<f64>,
    engine: String,
    hold: String,
    threads: Option<usize>,
}

impl Owned {
    pub(crate) fn new(asked: &Asked<'_>) -> PyResult<Self> {
        let sought = |[low, high, start]: [f64; 3]| {
            if low.is_nan() {
                ParameterSpec::Held(start)
            } else {
                let start = Some(start).filter(|start| !start.is_nan());
                ParameterSpec::Free {
                    range: (low, high),
                    start,
                }
            }
        };
        let all = |matrix: &Matrix<'_>| -> PyResult<Vec<ParameterSpec>> {
            Ok(arrays::rows::<3>(matrix)?.into_iter().map(sought).collect())
        };
        let parameters =
            all(&asked.parameters)?
                .try_into()
                .map_err(|all: Vec<ParameterSpec>| {
                    errors::to_python(Error::Invalid {
                        what: "parameters".to_owned(),
                        expected: "5".to_owned(),
                        got: all.len().to_string(),
                    })
                })?;
        let effects = asked.effects.iter().map(|(name, values)| {
            Ok(Hypothesis {
                effect: effect(name).map_err(errors::to_python)?,
                values: all(values)?,
            })
        });
        let recordings = asked
            .recordings
            .iter()
            .zip(arrays::rows::<2>(&asked.knobs_before)?);
        let recordings = recordings.map(
            |((commands, durations, observed, way, path, tilt), knobs_before)| {
                Ok(OwnedRecording {
                    commands: arrays::rows(commands)?,
                    knobs_before,
                    durations: durations.as_ref().map(|one| one.as_array().to_vec()),
                    observed: arrays::rows(observed)?,
                    way: way.as_array().to_vec(),
                    path: arrays::rows(path)?,
                    tilt: tilt.as_ref().map(arrays::rows).transpose()?,
                })
            },
        );
        let stretches = asked
            .stretches
            .iter()
            .map(|&(recording, first, rows, at_rest)| Stretch {
                recording,
                first,
                rows,
                at_rest,
            });
        Ok(Self {
            rig: crate::rig(asked.board, asked.marble),
            parameters,
            effects: effects.collect::<PyResult<_>>()?,
            recordings: recordings.collect::<PyResult<_>>()?,
            stretches: stretches.collect(),
            noise: asked.noise,
            tilt_noise: asked.tilt_noise,
            engine: asked.engine.parse().map_err(errors::to_python)?,
            hold: asked.hold.parse().map_err(errors::to_python)?,
            threads: asked.threads,
        })
    }

    pub(crate) fn with<T>(&self, ask: impl FnOnce(&Problem<'_>) -> T) -> T {
        let recordings: Vec<Recording<'_>> = self
            .recordings
            .iter()
            .map(|one| Recording {
                commands: &one.commands,
                knobs_before: one.knobs_before,
                durations: one.durations.as_deref(),
                observed: &one.observed,
                tilt: one.tilt.as_deref(),
                way: Some(&one.way),
                path: Some(&one.path),
            })
            .collect();
        ask(&Problem {
            rig: &self.rig,
            parameters: self.parameters,
            effects: &self.effects,
            recordings: &recordings,
            stretches: &self.stretches,
            noise: self.noise,
            tilt_noise: self.tilt_noise,
            engine: self.engine,
            hold: self.hold,
            threads: self.threads,
        })
    }
}

/// Fits a problem; see `irt.fitting.problem`.
#[pyfunction]
#[pyo3(signature = (problem, *, points, starts, seed, rounds, progress))]
#[expect(
    clippy::needless_pass_by_value,
    reason = "the extracted views of Python's arguments are owned here"
)]
pub(crate) fn fit<'py>(
    py: Python<'py>,
    problem: Asked<'py>,
    points: Vec<Vec<f64>>,
    starts: usize,
    seed: u64,
    rounds: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let problem = Owned::new(&problem)?;
    let settings = Settings {
        starts,
        seed,
        rounds,
    };
    let report = |done: usize, total: usize, rows: usize| {
        if let Some(progress) = &progress {
            // An error of the progress callback must not end the fit.
            Python::attach(|py| {
                if let Err(error) = progress.call1(py, (done, total, rows)) {
                    error.write_unraisable(py, None);
                }
            });
        }
    };
    let (solution, errors) = interrupt::interruptible(py, |cancel| {
        problem.with(|problem| {
            let solution = problem.fit_from(&points, &settings, &report, cancel)?;
            let errors = solution.estimates.iter();
            let errors = errors.map(|one| problem.errors(&one.path, &one.states, cancel));
            let errors = errors.collect::<labsim::Result<Vec<_>>>()?;
            Ok((solution, errors))
        })
    })?;
    let result = PyDict::new(py);
    let estimates = solution.estimates.iter().zip(errors).map(|(one, errors)| {
        let count = one.values.len();
        let path: Vec<f64> = one
            .path
            .iter()
            .flat_map(|one| &one[..count])
            .copied()
            .collect();
        let path = matrix(py, path, count);
        (path, Array1::from(errors).into_pyarray(py))
    });
    result.set_item(
        "values",
        Array1::from(solution.values.clone()).into_pyarray(py),
    )?;
    result.set_item("states", states(py, &solution.states))?;
    let residuals = solution.residuals.iter().map(|one| arrays::matrix(py, one));
    result.set_item("residuals", residuals.collect::<Vec<_>>())?;
    result.set_item("tracker_noise", solution.tracker_noise)?;
    result.set_item("noise", solution.noise)?;
    let pair = |values: [f64; 2]| Array1::from(values.to_vec()).into_pyarray(py);
    result.set_item("axis_noise", pair(solution.axis_noise))?;
    let tilt = solution.tilt.as_ref();
    let none = [f64::NAN; 2];
    let residuals = tilt.map_or(&[][..], |tilt| &tilt.residuals);
    let residuals = residuals.iter().map(|one| arrays::matrix(py, one));
    result.set_item("tilt_residuals", residuals.collect::<Vec<_>>())?;
    result.set_item("tilt_noise", pair(tilt.map_or(none, |tilt| tilt.noise)))?;
    result.set_item("tilt_scale", pair(tilt.map_or(none, |tilt| tilt.scale)))?;
    result.set_item("loss", solution.loss)?;
    result.set_item("information", dictionary(py, &solution.information)?)?;
    result.set_item("estimates", estimates.collect::<Vec<_>>())?;
    let vector = |values: &[f64]| Array1::from(values.to_vec()).into_pyarray(py);
    let shrunk = solution.shrunk.iter().map(|one| {
        let group = PyDict::new(py);
        group.set_item("effect", one.effect)?;
        group.set_item("size", one.size)?;
        group.set_item("interval", (one.interval[0], one.interval[1]))?;
        group.set_item("gain", one.gain)?;
        group.set_item("effective", one.effective)?;
        group.set_item("values", vector(&one.values))?;
        group.set_item("deviations", vector(&one.deviations))?;
        Ok(group)
    });
    result.set_item("shrunk", shrunk.collect::<PyResult<Vec<_>>>()?)?;
    result.set_item("rollouts", solution.rollouts)?;
    Ok(result)
}

/// Linearised information of the recordings at some values; see `irt.fitting.problem`.
#[pyfunction]
#[pyo3(signature = (problem, values, *, noise))]
#[expect(
    clippy::needless_pass_by_value,
    reason = "the extracted views of Python's arguments are owned here"
)]
pub(crate) fn inform<'py>(
    py: Python<'py>,
    problem: Asked<'py>,
    values: Vec<f64>,
    noise: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let problem = Owned::new(&problem)?;
    let information = interrupt::interruptible(py, |cancel| {
        problem.with(|problem| problem.inform(&values, None, noise, cancel))
    })?;
    dictionary(py, &information)
}

/// Refines values without a search; see `irt.fitting.problem`.
#[pyfunction]
#[pyo3(signature = (problem, values, *, iterations, held))]
#[expect(
    clippy::needless_pass_by_value,
    reason = "the extracted views of Python's arguments are owned here"
)]
pub(crate) fn refine<'py>(
    py: Python<'py>,
    problem: Asked<'py>,
    values: Vec<Vec<f64>>,
    iterations: usize,
    held: bool,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let problem = Owned::new(&problem)?;
    let refined = interrupt::interruptible(py, |cancel| {
        problem.with(|problem| problem.refine(&values, iterations, held, cancel))
    })?;
    let results = refined.iter().map(|one| {
        let result = PyDict::new(py);
        let residuals = one.residuals.iter().map(|one| arrays::matrix(py, one));
        result.set_item("values", Array1::from(one.values.clone()).into_pyarray(py))?;
        result.set_item("states", states(py, &one.states))?;
        result.set_item("residuals", residuals.collect::<Vec<_>>())?;
        let residuals = one.tilt_residuals.iter().map(|one| arrays::matrix(py, one));
        result.set_item("tilt_residuals", residuals.collect::<Vec<_>>())?;
        Ok(result)
    });
    results.collect()
}

/// Standard deviation of the tracker (board edges) from `(n, 2)` recordings alone.
#[pyfunction]
#[expect(
    clippy::needless_pass_by_value,
    reason = "the extracted views of Python's arguments are owned here"
)]
pub(crate) fn tracker_noise(observed: Vec<Matrix<'_>>) -> PyResult<f64> {
    let observed = observed
        .iter()
        .map(arrays::rows::<2>)
        .collect::<PyResult<Vec<_>>>()?;
    Ok(labsim::fit::tracker_noise(
        observed.iter().map(Vec::as_slice),
    ))
}

fn dictionary<'py>(py: Python<'py>, information: &Information) -> PyResult<Bound<'py, PyDict>> {
    let result = PyDict::new(py);
    let count = information.free.len();
    let directions = matrix(py, information.directions.concat(), count);
    result.set_item("free", information.free.clone())?;
    result.set_item("directions", directions)?;
    let vector = |values: &[f64]| Array1::from(values.to_vec()).into_pyarray(py);
    result.set_item("singular", vector(&information.singular))?;
    result.set_item("deviation", vector(&information.deviation))?;
    result.set_item("offset", vector(&information.offset))?;
    result.set_item("degrees_of_freedom", information.degrees_of_freedom)?;
    result.set_item("scale", information.scale)?;
    Ok(result)
}

pub(crate) fn states<'py>(
    py: Python<'py>,
    states: &[Option<[f64; 4]>],
) -> Bound<'py, numpy::PyArray2<f64>> {
    let known = states.iter().map(|one| one.unwrap_or([f64::NAN; 4]));
    arrays::matrix(py, &known.collect::<Vec<_>>())
}

fn matrix(py: Python<'_>, values: Vec<f64>, columns: usize) -> Bound<'_, numpy::PyArray2<f64>> {
    let rows = values.len() / columns.max(1);
    Array2::from_shape_vec((rows, columns), values)
        .expect("every row has its columns")
        .into_pyarray(py)
}
