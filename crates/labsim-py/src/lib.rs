//! The Python extension module `irt._labsim`: arrays in, arrays out; no physics.

mod arrays;
mod catalogue;
mod errors;
mod fit;
mod fleet;
mod grey_box;
mod interrupt;

use std::sync::atomic::AtomicBool;

use labsim::board::{Board, Marble, Rig, SUBSTEP_S};
use labsim::{Batch, Engine, Fall, Hold, Maze, Parameters, PerRollout, TimeBase};
use numpy::ndarray::{Array2, Array3};
use numpy::{
    IntoPyArray, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
};
use pyo3::prelude::*;

/// The labyrinth engine behind `irt.rollouts`; this module only converts arrays.
#[pymodule]
mod _labsim {
    #[pymodule_export]
    use super::catalogue::catalogue;
    #[pymodule_export]
    use super::fit::{fit, inform, refine, tracker_noise};
    #[pymodule_export]
    use super::fleet::Fleet;
    #[pymodule_export]
    use super::grey_box::{ascend, filtered, leave_out, smoothed};
    #[pymodule_export]
    use super::{paper_drive, rollouts, seen, turned};

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add(
            "ENGINES",
            labsim::Engine::ALL.map(|(name, _)| name).to_vec(),
        )?;
        module.add("PARAMETERS", labsim::parameters::NAMES.to_vec())?;
        module.add("GRAVITY", labsim::board::GRAVITY)?;
        module.add("SUBSTEP_S", labsim::board::SUBSTEP_S)
    }
}

/// Time that the rollouts of a brief batch simulate, all together [s]: 0.2 s of work for rapier, 3 ms for the rolling engine.
const BRIEF_S: f64 = 200.0;

/// Simulates a batch of rollouts; see `irt.rollouts`.
///
/// Arrays whose first axis has length 1 are shared by all rollouts.
#[pyfunction]
#[pyo3(signature = (
    parameters, commands, start, start_velocity, rolled, turned, *, rows, first, issued, knobs_before, effects, seeds, board, marble, maze,
    engine, continuous, substeps, durations, hold, tilt, threads
))]
#[expect(
    clippy::too_many_arguments,
    reason = "one flat call; irt.rollouts gives it names and defaults"
)]
#[expect(
    clippy::needless_pass_by_value,
    reason = "the extracted views of Python's arguments are owned here"
)]
fn rollouts<'py>(
    py: Python<'py>,
    parameters: PyReadonlyArray2<'py, f64>,
    commands: PyReadonlyArray3<'py, f64>,
    start: PyReadonlyArray2<'py, f64>,
    start_velocity: PyReadonlyArray2<'py, f64>,
    rolled: PyReadonlyArray1<'py, f64>,
    turned: PyReadonlyArray2<'py, f64>,
    rows: usize,
    first: PyReadonlyArray1<'py, usize>,
    issued: PyReadonlyArray1<'py, usize>,
    knobs_before: PyReadonlyArray2<'py, f64>,
    effects: Vec<(String, PyReadonlyArray2<'py, f64>)>,
    seeds: PyReadonlyArray1<'py, u64>,
    board: [f64; 6],
    marble: [f64; 3],
    maze: Option<Inside<'py>>,
    engine: &str,
    continuous: bool,
    substeps: Option<PyReadonlyArray1<'py, u32>>,
    durations: Option<PyReadonlyArray2<'py, f64>>,
    hold: &str,
    tilt: bool,
    threads: Option<usize>,
) -> PyResult<Results<'py>> {
    let engine: Engine = engine.parse().map_err(errors::to_python)?;
    let hold: Hold = hold.parse().map_err(errors::to_python)?;
    let rig = rig(board, marble);
    let maze = maze.map(inside).transpose()?;
    let parameters: Vec<Parameters> = arrays::rows::<5>(&parameters)?
        .into_iter()
        .map(Parameters::from)
        .collect();
    let issued = arrays::lengths(&issued, &commands)?;
    let effects = catalogue::Values::new(&effects)?;
    let commands = arrays::pairs_of_each(&commands)?;
    let commands = arrays::beginnings(&commands, &issued);
    let start = arrays::rows::<2>(&start)?;
    let start_velocity = arrays::rows::<2>(&start_velocity)?;
    let knobs_before = arrays::rows::<2>(&knobs_before)?;
    let rolled = rolled.as_array().to_vec();
    let turned = arrays::rows::<3>(&turned)?;
    let (first, seeds) = (first.as_array().to_vec(), seeds.as_array().to_vec());
    let substeps = substeps.map(|each| each.as_array().to_vec());
    let durations = durations.map(|each| each.as_array().iter().copied().collect::<Vec<f64>>());
    let durations = durations
        .as_ref()
        .map(|each| arrays::beginnings(each, &issued));
    let count = parameters.len();
    let batch = Batch {
        rig: &rig,
        maze: maze.as_ref(),
        parameters: &parameters,
        effects: &effects.chosen(count),
        rows,
        commands: PerRollout::Of(&commands),
        hold,
        knobs_before: arrays::shared_or_each(&knobs_before, 1, count),
        first: arrays::shared_or_each(&first, 1, count),
        start: arrays::shared_or_each(&start, 1, count),
        start_velocity: arrays::shared_or_each(&start_velocity, 1, count),
        rolled: arrays::shared_or_each(&rolled, 1, count),
        turned: arrays::shared_or_each(&turned, 1, count),
        time: match durations.as_deref() {
            Some(durations) => TimeBase::Durations(PerRollout::Of(durations)),
            None if continuous => TimeBase::Continuous(substeps.as_deref()),
            None => TimeBase::Rounded,
        },
        seeds: arrays::shared_or_each(&seeds, 1, count),
    };
    let work = |cancel: &AtomicBool| {
        if maze.is_some() {
            let found = batch.run_with_falls(engine, threads, cancel)?;
            return Ok((found.marble, tilt.then_some(found.tilt), found.falls));
        }
        if tilt {
            let observed = batch.run_with_tilt(engine, threads, cancel)?;
            return Ok((observed.marble, Some(observed.tilt), Vec::new()));
        }
        Ok((batch.run(engine, threads, cancel)?, None, Vec::new()))
    };
    let lasting = match durations.as_deref() {
        Some(durations) => durations.iter().copied().flatten().sum(),
        None if substeps.is_some() => f64::INFINITY,
        None => {
            let each = parameters.iter().zip(&commands);
            each.map(|(one, issued)| SUBSTEP_S * one.time_scale * issued.len() as f64)
                .sum()
        }
    };
    let observed = if lasting <= BRIEF_S {
        interrupt::brief(py, work)?
    } else {
        interrupt::interruptible(py, work)?
    };
    let array = |rows_of_all: Vec<[f64; 2]>| {
        Array3::from_shape_vec((count, rows, 2), rows_of_all.into_flattened())
            .expect("the engine fills every row")
            .into_pyarray(py)
    };
    let (marble, tilt, falls) = observed;
    let fallen = Array2::from_shape_fn((count, 2), |(rollout, which)| {
        let fall: Option<Fall> = falls.get(rollout).copied().flatten();
        fall.and_then(|fall| i64::try_from([fall.row, fall.hole][which]).ok())
            .unwrap_or(-1)
    });
    Ok((array(marble), tilt.map(array), fallen.into_pyarray(py)))
}

/// Positions and, if requested, tilts, `(n, rows, 2)` each; the first row after a marble fell and its hole,
/// `(n, 2)`, -1 for marbles that did not fall.
type Results<'py> = (
    Bound<'py, PyArray3<f64>>,
    Option<Bound<'py, PyArray3<f64>>>,
    Bound<'py, PyArray2<i64>>,
);

/// Walls (n, 4), their thickness, holes (m, 2), their radius.
type Inside<'py> = (
    PyReadonlyArray2<'py, f64>,
    f64,
    PyReadonlyArray2<'py, f64>,
    f64,
);

fn inside((walls, wall_thickness_m, holes, hole_radius_m): Inside<'_>) -> PyResult<Maze> {
    Ok(Maze {
        walls: arrays::rows::<4>(&walls)?,
        wall_thickness_m,
        holes: arrays::rows::<2>(&holes)?,
        hole_radius_m,
    })
}

/// The rotation (rad) of a marble from the first position of its path to each position; see `labsim::turned`.
#[pyfunction]
#[expect(
    clippy::needless_pass_by_value,
    reason = "the extracted view of Python's argument is owned here"
)]
fn turned<'py>(
    py: Python<'py>,
    path: PyReadonlyArray2<'py, f64>,
    radius: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    Ok(arrays::matrix(
        py,
        &labsim::turned(&arrays::rows::<2>(&path)?, radius),
    ))
}

/// Where a camera sees places on the level board `(n, 2)`, both in board edges; see `labsim::seen`.
///
/// Each effect has one row of values.
#[pyfunction]
#[expect(
    clippy::needless_pass_by_value,
    reason = "the extracted views of Python's arguments are owned here"
)]
fn seen<'py>(
    py: Python<'py>,
    places: PyReadonlyArray2<'py, f64>,
    effects: Vec<(String, PyReadonlyArray2<'py, f64>)>,
    board: [f64; 6],
    marble: [f64; 3],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let effects = catalogue::Values::new(&effects)?;
    let places = arrays::rows::<2>(&places)?;
    let seen = labsim::seen(&rig(board, marble), &effects.chosen(1), &places);
    Ok(arrays::matrix(py, &seen))
}

/// Knob angles of the paper's drive (rad), `(steps, 2)`; see `irt.paper_drive`.
#[pyfunction]
fn paper_drive(
    py: Python<'_>,
    steps: usize,
    amplitude: f64,
    literal: bool,
) -> Bound<'_, PyArray2<f64>> {
    let knobs = labsim::paper_drive(steps, amplitude, literal);
    arrays::matrix(py, &knobs)
}

/// Board and marble from their dimensions, in the order of their fields.
fn rig(board: [f64; 6], marble: [f64; 3]) -> Rig {
    let [
        edge_x_m,
        edge_y_m,
        wall_restitution,
        wall_friction,
        sliding_friction,
        spinning_friction,
    ] = board;
    let [radius_m, mass_kg, damping_per_s] = marble;
    Rig {
        board: Board {
            edge_x_m,
            edge_y_m,
            wall_restitution,
            wall_friction,
            sliding_friction,
            spinning_friction,
        },
        marble: Marble {
            radius_m,
            mass_kg,
            damping_per_s,
        },
    }
}
