//! The engine's error as the package's one exception.

use labsim::Error;
use pyo3::prelude::*;

mod python {
    pyo3::import_exception!(irt.errors, IrtError);
}

/// The exception for an error of the engine.
#[expect(
    clippy::needless_pass_by_value,
    reason = "the signature that map_err expects"
)]
pub(crate) fn to_python(error: Error) -> PyErr {
    python::IrtError::new_err(error.to_string())
}
