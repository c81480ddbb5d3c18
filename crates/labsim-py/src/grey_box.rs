//! Fits with a random push of the marble: arrays in, dictionaries of arrays out.

use labsim::Noise;
use labsim::filter::Smoothed;
use labsim::fit::Probable;
use numpy::IntoPyArray;
use numpy::ndarray::{Array1, Array2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::fit::{self, Asked, Matrix, Owned};
use crate::{arrays, interrupt};

/// One-step predictions at some values; see `irt.fitting.problem`.
#[pyfunction]
#[pyo3(signature = (problem, values, noise, states=None))]
#[expect(
    clippy::needless_pass_by_value,
    reason = "the extracted views of Python's arguments are owned here"
)]
pub(crate) fn filtered<'py>(
    py: Python<'py>,
    problem: Asked<'py>,
    values: Vec<Vec<f64>>,
    noise: Matrix<'py>,
    states: Option<Vec<Matrix<'py>>>,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let problem = Owned::new(&problem)?;
    let (noise, states) = (noises(&noise)?, given_states(states)?);
    let filtered = interrupt::interruptible(py, |cancel| {
        problem.with(|problem| problem.filter(&values, &noise, states.as_deref(), cancel))
    })?;
    let results = filtered.iter().map(|one| {
        let result = PyDict::new(py);
        let all = |rows: &[Vec<[f64; 2]>]| -> Vec<_> {
            rows.iter().map(|one| arrays::matrix(py, one)).collect()
        };
        result.set_item("predicted", all(&one.predicted))?;
        result.set_item("variance", all(&one.variance))?;
        result.set_item("tilt", all(&one.tilt))?;
        result.set_item("tilt_variance", all(&one.tilt_variance))?;
        result.set_item("log_likelihood", arrays::matrix(py, &one.log_likelihood))?;
        Ok(result)
    });
    results.collect()
}

/// Smoothed random accelerations in each row, given all rows; see `irt.fitting.problem`.
#[pyfunction]
#[pyo3(signature = (problem, values, noise, states))]
#[expect(
    clippy::needless_pass_by_value,
    reason = "the extracted views of Python's arguments are owned here"
)]
pub(crate) fn smoothed<'py>(
    py: Python<'py>,
    problem: Asked<'py>,
    values: Vec<f64>,
    noise: Matrix<'py>,
    states: Matrix<'py>,
) -> PyResult<Bound<'py, PyDict>> {
    let problem = Owned::new(&problem)?;
    let (noise, states) = (noises(&noise)?[0], of_segments(&states)?);
    let smoothed = interrupt::interruptible(py, |cancel| {
        problem.with(|problem| problem.smooth(&values, noise, &states, cancel))
    })?;
    let result = PyDict::new(py);
    let all = |of: fn(&Smoothed) -> f64| -> Vec<_> {
        let rows = |one: &Vec<[Smoothed; 2]>| -> Vec<[f64; 2]> {
            one.iter().map(|row| [of(&row[0]), of(&row[1])]).collect()
        };
        smoothed
            .iter()
            .map(|one| arrays::matrix(py, &rows(one)))
            .collect()
    };
    result.set_item("push", all(|one| one.push.mean))?;
    result.set_item("push_deviation", all(|one| one.push.deviation))?;
    result.set_item("lasting", all(|one| one.lasting.mean))?;
    result.set_item("lasting_deviation", all(|one| one.lasting.deviation))?;
    Ok(result)
}

/// Maximises the posterior from values and noise; see `irt.fitting.problem`.
#[pyfunction]
#[pyo3(signature = (problem, values, noise, states=None, *, iterations))]
#[expect(
    clippy::needless_pass_by_value,
    reason = "the extracted views of Python's arguments are owned here"
)]
pub(crate) fn ascend<'py>(
    py: Python<'py>,
    problem: Asked<'py>,
    values: Vec<Vec<f64>>,
    noise: Matrix<'py>,
    states: Option<Vec<Matrix<'py>>>,
    iterations: usize,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let problem = Owned::new(&problem)?;
    let (noise, given) = (noises(&noise)?, given_states(states)?);
    let tops = interrupt::interruptible(py, |cancel| {
        problem
            .with(|problem| problem.ascend(&values, &noise, given.as_deref(), iterations, cancel))
    })?;
    all_probable(py, &tops)
}

/// Maximises the posterior without each fold of the stretches; see `irt.fitting.problem`.
#[pyfunction]
#[pyo3(signature = (problem, values, noise, states, *, folds, iterations))]
#[expect(
    clippy::needless_pass_by_value,
    reason = "the extracted views of Python's arguments are owned here"
)]
pub(crate) fn leave_out<'py>(
    py: Python<'py>,
    problem: Asked<'py>,
    values: Vec<f64>,
    noise: Matrix<'py>,
    states: Matrix<'py>,
    folds: Vec<Option<usize>>,
    iterations: usize,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let problem = Owned::new(&problem)?;
    let (noise, states) = (noises(&noise)?, of_segments(&states)?);
    let [noise] = noise.as_slice() else {
        return Err(PyValueError::new_err("noise: expected one row"));
    };
    let tops = interrupt::interruptible(py, |cancel| {
        problem
            .with(|problem| problem.leave_out(&values, noise, &states, &folds, iterations, cancel))
    })?;
    all_probable(py, &tops)
}

fn all_probable<'py>(py: Python<'py>, tops: &[Probable]) -> PyResult<Vec<Bound<'py, PyDict>>> {
    tops.iter().map(|one| probable(py, one)).collect()
}

fn probable<'py>(py: Python<'py>, one: &Probable) -> PyResult<Bound<'py, PyDict>> {
    let result = PyDict::new(py);
    let vector = |values: Vec<f64>| Array1::from(values).into_pyarray(py);
    let mut covariance = Array2::<f64>::zeros((one.values.len(), one.values.len()));
    for (i, &slot) in one.slots.iter().enumerate() {
        for (j, &other) in one.slots.iter().enumerate() {
            covariance[[slot, other]] = one.covariance[(i, j)];
        }
    }
    let deviations = covariance.diag().mapv(f64::sqrt).to_vec();
    let sizes = <[f64; 14]>::from(one.noise);
    result.set_item("values", vector(one.values.clone()))?;
    result.set_item("deviations", vector(deviations))?;
    result.set_item("covariance", covariance.into_pyarray(py))?;
    result.set_item("states", fit::states(py, &one.states))?;
    result.set_item("noise", vector(sizes.to_vec()))?;
    result.set_item("log_likelihood", one.log_likelihood)?;
    result.set_item("log_evidence", one.log_evidence)?;
    Ok(result)
}

/// The start state of each stretch; none if it is unknown.
type States = Vec<Option<[f64; 4]>>;

/// Start states of all stretches for each of some values, a row each; NaN without a marble.
fn given_states(states: Option<Vec<Matrix<'_>>>) -> PyResult<Option<Vec<States>>> {
    states
        .map(|states| states.iter().map(of_segments).collect())
        .transpose()
}

fn of_segments(all: &Matrix<'_>) -> PyResult<States> {
    let known = |state: [f64; 4]| state.iter().all(|one| one.is_finite()).then_some(state);
    Ok(arrays::rows::<4>(all)?.into_iter().map(known).collect())
}

fn noises(noise: &Matrix<'_>) -> PyResult<Vec<Noise>> {
    Ok(arrays::rows::<14>(noise)?
        .into_iter()
        .map(Noise::from)
        .collect())
}
