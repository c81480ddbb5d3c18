//! Many marbles whose commands come one by one, for `irt.engine.Fleet`.

use labsim::{Live, Parameters};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::{arrays, catalogue, errors, rig};

/// Places (board edges) and tilts (rad) of all marbles, `(n, 2)` each.
type Rows<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Marbles that go on row by row; see `irt.engine.Fleet`.
#[pyclass]
pub(crate) struct Fleet(labsim::Fleet);

#[pymethods]
impl Fleet {
    #[new]
    fn new(count: usize, threads: Option<usize>) -> Self {
        Self(labsim::Fleet::new(count, threads))
    }

    /// Puts a marble at rest in a place.
    #[pyo3(signature = (place, parameters, start, *, effects, board, marble, rows, row_s, seed))]
    #[expect(
        clippy::too_many_arguments,
        reason = "one flat call; irt.engine.Fleet gives it names"
    )]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "the extracted views of Python's arguments are owned here"
    )]
    fn begin(
        &mut self,
        place: usize,
        parameters: [f64; 5],
        start: [f64; 2],
        effects: Vec<(String, PyReadonlyArray2<'_, f64>)>,
        board: [f64; 6],
        marble: [f64; 3],
        rows: usize,
        row_s: f64,
        seed: u64,
    ) -> PyResult<()> {
        let effects = catalogue::Values::new(&effects)?;
        let live = Live::new(
            &rig(board, marble),
            Parameters::from(parameters),
            &effects.chosen(1),
            start,
            (rows, row_s),
            seed,
        );
        live.and_then(|live| self.0.put(place, live))
            .map_err(errors::to_python)
    }

    /// Plays a row of the marbles that are asked to.
    #[expect(
        clippy::needless_pass_by_value,
        reason = "the extracted views of Python's arguments are owned here"
    )]
    fn play(
        &mut self,
        py: Python<'_>,
        commands: PyReadonlyArray2<'_, f64>,
        is_asked: PyReadonlyArray1<'_, bool>,
    ) -> PyResult<()> {
        let commands = arrays::rows::<2>(&commands)?;
        let is_asked = is_asked.as_array().to_vec();
        py.detach(|| self.0.play(&commands, &is_asked))
            .map_err(errors::to_python)
    }

    /// Where marbles are seen, and how boards are tilted, as the present row begins.
    fn rows<'py>(&self, py: Python<'py>) -> Rows<'py> {
        let array = |rows: Vec<[f64; 2]>| {
            Array2::from_shape_vec((rows.len(), 2), rows.into_flattened())
                .expect("pairs")
                .into_pyarray(py)
        };
        (array(self.0.seen()), array(self.0.tilt()))
    }
}
