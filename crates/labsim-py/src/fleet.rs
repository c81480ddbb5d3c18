//! `irt._labsim.Fleet`: marbles that are stepped together, for environments.

use labsim::effects::effect;
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::{Inside, arrays, errors, inside, rig};

/// Columns of a state: seen x, y; tilt about x, y; place x, y; hole; points of the path that are passed.
const COLUMNS: usize = 8;

/// Marbles that are stepped together; see `irt.environment`.
#[pyclass(module = "irt._labsim")]
pub(crate) struct Fleet {
    fleet: labsim::Fleet,
}

#[pymethods]
impl Fleet {
    #[new]
    fn new(
        count: usize,
        rows: usize,
        row_s: f64,
        board: [f64; 6],
        marble: [f64; 3],
        maze: Option<Inside<'_>>,
        path: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Self> {
        let (maze, path) = (maze.map(inside).transpose()?, arrays::rows::<2>(&path)?);
        let rig = rig(board, marble);
        let fleet = labsim::Fleet::new(rig, maze.as_ref(), path, count, (rows, row_s));
        Ok(Self {
            fleet: fleet.map_err(errors::to_python)?,
        })
    }

    /// Adds a simulator: a board, a marble, the five parameters, effects as names and values.
    fn add(
        &mut self,
        board: [f64; 6],
        marble: [f64; 3],
        parameters: [f64; 5],
        effects: Vec<(String, Vec<f64>)>,
    ) -> PyResult<usize> {
        let found = effects
            .into_iter()
            .map(|(name, values)| Ok((effect(&name)?, values)))
            .collect::<labsim::Result<Vec<_>>>();
        let added = found.and_then(|effects| {
            self.fleet
                .add(rig(board, marble), parameters.into(), effects)
        });
        added.map_err(errors::to_python)
    }

    /// Begins an episode of some marbles: the simulator of each, where it begins (m), points of the path that lie
    /// behind it, and its seed.
    fn begin(
        &mut self,
        marbles: PyReadonlyArray1<'_, usize>,
        simulators: PyReadonlyArray1<'_, usize>,
        places: PyReadonlyArray2<'_, f64>,
        passed: PyReadonlyArray1<'_, usize>,
        seeds: PyReadonlyArray1<'_, u64>,
    ) -> PyResult<()> {
        let places = arrays::rows::<2>(&places)?;
        let (simulators, passed, seeds) =
            (simulators.as_array(), passed.as_array(), seeds.as_array());
        let each = marbles.as_array();
        let episodes = each
            .iter()
            .zip(simulators)
            .zip(places)
            .zip(passed)
            .zip(seeds);
        for ((((&marble, &simulator), place), &passed), &seed) in episodes {
            self.fleet
                .begin(marble, simulator, (place, passed), seed)
                .map_err(errors::to_python)?;
        }
        Ok(())
    }

    /// Plays a row of the active marbles, and writes the states (n, 8) of all.
    fn play(
        &mut self,
        py: Python<'_>,
        commands: PyReadonlyArray2<'_, f64>,
        active: PyReadonlyArray1<'_, bool>,
        states: PyReadwriteArray2<'_, f64>,
        threads: Option<usize>,
    ) -> PyResult<()> {
        let commands = arrays::rows::<2>(&commands)?;
        let active = active.as_array().to_vec();
        let fleet = &mut self.fleet;
        py.detach(|| fleet.play(&commands, &active, threads))
            .map_err(errors::to_python)?;
        self.states(states)
    }

    /// Writes the states (n, 8) of all marbles; not a number of those without an episode.
    fn states(&self, mut states: PyReadwriteArray2<'_, f64>) -> PyResult<()> {
        let all = self.fleet.states();
        if states.shape() != [all.len(), COLUMNS] {
            let message = format!("states: expected shape ({}, {COLUMNS})", all.len());
            return Err(PyValueError::new_err(message));
        }
        for (mut row, state) in states.as_array_mut().rows_mut().into_iter().zip(all) {
            let values = state.map_or([f64::NAN; COLUMNS], |one| {
                let hole = one.hole.map_or(-1.0, |hole| hole as f64);
                let [[a, b], [c, d], [e, f]] = [one.seen, one.tilt, one.place];
                [a, b, c, d, e, f, hole, one.passed as f64]
            });
            for (cell, value) in row.iter_mut().zip(values) {
                *cell = value;
            }
        }
        Ok(())
    }
}
