//! Conversions between numpy arrays and the engine's slices.

use labsim::PerRollout;
use labsim::error::Error;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use crate::errors;

/// The rows of a `(n, N)` array.
pub(crate) fn rows<const N: usize>(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; N]>> {
    let view = array.as_array();
    if view.ncols() != N {
        return Err(shape_error(&format!("(n, {N})"), view.shape()));
    }
    Ok(view
        .rows()
        .into_iter()
        .map(|row| std::array::from_fn(|i| row[i]))
        .collect())
}

/// The pairs of a `(n, rows, 2)` array, concatenated.
pub(crate) fn pairs_of_each(array: &PyReadonlyArray3<'_, f64>) -> PyResult<Vec<[f64; 2]>> {
    let view = array.as_array();
    if view.shape()[2] != 2 {
        return Err(shape_error("(n, rows, 2)", view.shape()));
    }
    Ok(view
        .lanes(numpy::ndarray::Axis(2))
        .into_iter()
        .map(|pair| [pair[0], pair[1]])
        .collect())
}

/// Values that all rollouts share if there are only enough for one.
pub(crate) fn shared_or_each<T>(values: &[T], length: usize, rollouts: usize) -> PerRollout<'_, T> {
    if values.len() == length && rollouts != 1 {
        PerRollout::Shared(values)
    } else {
        PerRollout::Each(values)
    }
}

/// The sequences of each rollout without their padding: shared, or one for each rollout.
pub(crate) fn beginnings<'a, T>(values: &'a [T], lengths: &Lengths) -> Vec<&'a [T]> {
    let shared = values.len() == lengths.padded;
    let own = |(rollout, &length): (usize, &usize)| {
        let begin = if shared { 0 } else { rollout * lengths.padded };
        &values[begin..begin + length]
    };
    lengths.own.iter().enumerate().map(own).collect()
}

/// Length of padded sequences, and each rollout's length without padding.
pub(crate) struct Lengths {
    padded: usize,
    own: Vec<usize>,
}

/// Checks the length of each rollout's commands without padding.
pub(crate) fn lengths(
    own: &PyReadonlyArray1<'_, usize>,
    commands: &PyReadonlyArray3<'_, f64>,
) -> PyResult<Lengths> {
    let padded = commands.as_array().shape()[1];
    let own = own.as_array().to_vec();
    match own.iter().find(|&&length| length > padded) {
        Some(&length) => Err(shape_error(
            &format!("at most {padded} commands"),
            &[length],
        )),
        None => Ok(Lengths { padded, own }),
    }
}

/// A `(rows, N)` array.
pub(crate) fn matrix<'py, const N: usize>(
    py: Python<'py>,
    rows: &[[f64; N]],
) -> Bound<'py, PyArray2<f64>> {
    let flat = rows.as_flattened().to_vec();
    Array2::from_shape_vec((rows.len(), N), flat)
        .expect("rows are of one length")
        .into_pyarray(py)
}

fn shape_error(expected: &str, got: &[usize]) -> PyErr {
    errors::to_python(Error::Invalid {
        what: "array".to_owned(),
        expected: format!("shape {expected}"),
        got: format!("{got:?}"),
    })
}
