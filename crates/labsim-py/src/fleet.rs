//! `irt._labsim.Fleet`: marbles that are stepped together, for environments.

use labsim::Scene;
use labsim::effects::effect;
use numpy::{
    PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2, PyReadwriteArray4,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::{Inside, arrays, errors, inside, rig};

/// Columns of a state: seen x, y; the same a row before; tilt about x, y; place x, y; hole; points of the path that
/// are passed.
const COLUMNS: usize = 10;

/// Marbles that are stepped together; see `irt.environment`.
#[pyclass(module = "irt._labsim")]
pub(crate) struct Fleet {
    fleet: labsim::Fleet,
}

#[pymethods]
#[expect(
    clippy::needless_pass_by_value,
    reason = "the extracted views of Python's arguments are owned here"
)]
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
        noise: f64,
        lost: f64,
    ) -> PyResult<Self> {
        let (maze, path) = (maze.map(inside).transpose()?, arrays::rows::<2>(&path)?);
        let (rig, tracker) = (rig(board, marble), labsim::Tracker { noise, lost });
        let fleet = labsim::Fleet::new(rig, maze.as_ref(), path, tracker, count, (rows, row_s));
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

    /// Plays a row of the active marbles, and writes the states (n, 10) of all.
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

    /// Paints what is around each marble into `pictures` (n, 64, 64, 3), cut from a scene (h, w, 3).
    fn pictures(
        &self,
        py: Python<'_>,
        scene: PyReadonlyArray3<'_, u8>,
        per_m: f64,
        radius_m: f64,
        mut pictures: PyReadwriteArray4<'_, u8>,
        threads: Option<usize>,
    ) -> PyResult<()> {
        let shown = scene.as_array();
        let flat = |message: &str| PyValueError::new_err(message.to_owned());
        let pixels = shown.as_slice().filter(|_| shown.shape()[2] == 3);
        let (pixels, _) = pixels
            .ok_or_else(|| flat("scene: expected a contiguous array (h, w, 3)"))?
            .as_chunks::<3>();
        let scene = Scene {
            pixels: pixels.to_vec(),
            width: shown.shape()[1],
            per_m,
            radius_m,
        };
        let mut out = pictures.as_array_mut();
        let out = out.as_slice_mut();
        let (out, _) = out
            .ok_or_else(|| flat("pictures: expected a contiguous array"))?
            .as_chunks_mut::<3>();
        py.detach(|| self.fleet.pictures(&scene, out, threads))
            .map_err(errors::to_python)
    }

    /// Writes the states (n, 10) of all marbles; not a number of those without an episode.
    fn states(&self, mut states: PyReadwriteArray2<'_, f64>) -> PyResult<()> {
        let all = self.fleet.states();
        if states.shape() != [all.len(), COLUMNS] {
            let message = format!("states: expected shape ({}, {COLUMNS})", all.len());
            return Err(PyValueError::new_err(message));
        }
        for (mut row, state) in states.as_array_mut().rows_mut().into_iter().zip(all) {
            let values = state.map_or([f64::NAN; COLUMNS], |one| {
                let hole = one.hole.map_or(-1.0, |hole| hole as f64);
                let pairs = [one.seen, one.before, one.tilt, one.place];
                let [[a, b], [c, d], [e, f], [g, h]] = pairs;
                [a, b, c, d, e, f, g, h, hole, one.passed as f64]
            });
            for (cell, value) in row.iter_mut().zip(values) {
                *cell = value;
            }
        }
        Ok(())
    }
}
