//! Commands that arrive late, or follow another clock than the rows.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use pulp::Simd;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::schedule::{Moment, Timeline};
use super::{Hold, Job};
use crate::effects::Any;
use crate::lanes::Lanes;
use crate::motion::Pair;

/// The commands of the rollouts of a register, as they arrive.
pub(super) enum CommandDelay<S: Simd> {
    /// Commands of both axes arrive at the same times.
    Together(Course<S, 2>),
    /// Each axis has its own arrival times.
    Apart([Course<S, 1>; 2]),
}

impl<S: Simd> CommandDelay<S> {
    /// Commands that are `issued` when the rows of that timeline begin and come late by `late`, to the
    /// rows of another; `before` came long ago. One that goes evenly to the next one is issued in steps, one a
    /// substep.
    pub(super) fn new<'a, 'b: 'a>(
        simd: S,
        hold: Hold,
        late: &[Any<S>],
        [issued, rows]: [&Timeline; 2],
        before: Pair<S>,
        job: impl Fn(usize) -> &'a Job<'b>,
    ) -> Self {
        let [x, y] = lateness(simd, late, issued.rows(), &job);
        let steps;
        let issued = match hold {
            Hold::Zero => Issued::rows(issued),
            Hold::First => {
                steps = issued.of_substeps();
                Issued::substeps(issued, &steps)
            }
        };
        if x == y {
            return Self::Together(Course::new(hold, &x, &issued, rows, [0, 1], before, &job));
        }
        let of_axis = |late: &[[f64; 8]], axis: usize| {
            Course::new(hold, late, &issued, rows, [axis], [before[axis]], &job)
        };
        Self::Apart([of_axis(&x, 0), of_axis(&y, 1)])
    }

    /// Sets the command of a row (rad) in the first lane, before it arrives.
    pub(super) fn issue(&mut self, row: usize, command: [f64; 2]) {
        match self {
            Self::Together(both) => both.issue(row, command),
            Self::Apart([x, y]) => {
                x.issue(row, [command[0]]);
                y.issue(row, [command[1]]);
            }
        }
    }

    /// The last command that arrived (rad).
    #[inline(always)]
    pub(super) fn last(&self) -> Pair<S> {
        match self {
            Self::Together(both) => both.command,
            Self::Apart([x, y]) => [x.command[0], y.command[0]],
        }
    }

    /// The mean command of a substep, if it differs from that of the substep before.
    #[inline(always)]
    pub(super) fn substep(&mut self, row: usize, substep: u32) -> Option<Pair<S>> {
        match self {
            Self::Together(both) => both.substep(row, substep),
            Self::Apart([x, y]) => {
                let (new_x, new_y) = (x.substep(row, substep), y.substep(row, substep));
                if new_x.is_none() && new_y.is_none() {
                    return None;
                }
                let [[x], [y]] = [new_x.unwrap_or(x.command), new_y.unwrap_or(y.command)];
                Some([x, y])
            }
        }
    }
}

/// The commands of some axes that come together.
pub(super) struct Course<S: Simd, const AXES: usize> {
    /// Those of all rows, one behind the other.
    waves: Vec<Wave<AXES>>,
    /// Where in them those of each row begin, and the end of the last.
    begins: Vec<usize>,
    /// In which of them the command of each row comes in the first lane, unless a later one overtakes it.
    comes: Vec<Option<usize>>,
    /// The last commands that arrived (rad).
    command: [Lanes<S>; AXES],
    /// Whether the last substep saw more than one command.
    was_mixed: bool,
}

/// Commands as they are issued, in order.
struct Issued<'a> {
    /// When.
    times: &'a Timeline,
    /// The row that each belongs to, and which of the row's substeps.
    places: Vec<(usize, u32)>,
}

/// The n-th command of each lane that arrives in a row.
#[derive(Clone)]
struct Wave<const AXES: usize> {
    /// Arrival time (substeps after the row's beginning), infinite if none arrives.
    at: [f64; 8],
    /// What it is (rad): about each axis in each lane.
    command: [[f64; 8]; AXES],
}

impl<S: Simd, const AXES: usize> Course<S, AXES> {
    fn new<'a, 'b: 'a>(
        hold: Hold,
        late: &[[f64; 8]],
        issued: &Issued<'_>,
        rows: &Timeline,
        axes: [usize; AXES],
        before: [Lanes<S>; AXES],
        job: impl Fn(usize) -> &'a Job<'b>,
    ) -> Self {
        let moments: Vec<Vec<Moment>> = (0..S::F64_LANES)
            .map(|lane| issued.moments(rows, lane, late))
            .collect();
        let of_one_row = |a: &Moment, b: &Moment| a.row == b.row;
        let mut begins = vec![0; rows.rows() + 1];
        for row in moments.iter().flat_map(|all| all.chunk_by(of_one_row)) {
            let end = &mut begins[row[0].row + 1];
            *end = row.len().max(*end);
        }
        for row in 1..begins.len() {
            begins[row] += begins[row - 1];
        }
        let none = Wave {
            at: [f64::INFINITY; 8],
            command: [[0.0; 8]; AXES],
        };
        let mut waves = vec![none; begins[rows.rows()]];
        let mut comes = vec![None; issued.places.len()];
        for (lane, all) in moments.iter().enumerate() {
            for row in all.chunk_by(of_one_row) {
                let begin = begins[row[0].row];
                for (number, moment) in row.iter().enumerate() {
                    let wave = &mut waves[begin + number];
                    if lane == 0 {
                        comes[moment.what] = Some(begin + number);
                    }
                    let (row, substep) = issued.places[moment.what];
                    let command = match hold {
                        Hold::Zero => job(lane).commands[row],
                        Hold::First => {
                            let part = (f64::from(substep) + 0.5) * rows.share(row);
                            let [from, to] = [row, row + 1].map(|row| job(lane).command(row));
                            [0, 1].map(|axis| from[axis] + part * (to[axis] - from[axis]))
                        }
                    };
                    wave.at[lane] = moment.at;
                    for (came, axis) in wave.command.iter_mut().zip(axes) {
                        came[lane] = command[axis];
                    }
                }
            }
        }
        Self {
            waves,
            begins,
            comes,
            command: before,
            was_mixed: false,
        }
    }

    fn issue(&mut self, row: usize, command: [f64; AXES]) {
        if let Some(wave) = self.comes[row] {
            for (came, command) in self.waves[wave].command.iter_mut().zip(command) {
                came[0] = command;
            }
        }
    }

    #[inline(always)]
    fn substep(&mut self, row: usize, substep: u32) -> Option<[Lanes<S>; AXES]> {
        let simd = self.command[0].simd();
        let load = |values: &[f64; 8]| Lanes::load(simd, values);
        let one = Lanes::splat(simd, 1.0);
        // What comes just as a row begins belongs to its first substep, as there is none before.
        let begin = match substep {
            0 => f64::NEG_INFINITY,
            _ => f64::from(substep),
        };
        let end = f64::from(substep) + 1.0;
        let mut average = self.command;
        let mut changes = std::mem::take(&mut self.was_mixed);
        for wave in &self.waves[self.begins[row]..self.begins[row + 1]] {
            let at = load(&wave.at);
            let comes = at.gt(at.like(begin)) & at.le(at.like(end));
            if !comes.any() {
                continue;
            }
            changes = true;
            // The command that came replaces the last one for the rest of the substep.
            let rest = at.like(end) - at;
            let at_once = rest.ge(one);
            self.was_mixed |= (comes & !at_once).any();
            let command = self.command.iter_mut().zip(&wave.command);
            for (average, (last, came)) in average.iter_mut().zip(command) {
                let came = load(came);
                let mixed = *average + rest * (came - *last);
                *average = comes.select(at_once.select(came, mixed), *average);
                *last = comes.select(came, *last);
            }
        }
        changes.then_some(average)
    }
}

/// Delay (s) of each command in each lane, about x and about y.
fn lateness<'a, 'b: 'a, S: Simd>(
    simd: S,
    late: &[Any<S>],
    commands: usize,
    job: impl Fn(usize) -> &'a Job<'b>,
) -> [Vec<[f64; 8]>; 2] {
    let mut random: Vec<ChaCha8Rng> = (0..S::F64_LANES)
        .map(|lane| ChaCha8Rng::seed_from_u64(job(lane).seed))
        .collect();
    let mut draw = || Lanes::from_fn(simd, |lane| StandardNormal.sample(&mut random[lane]));
    let zero = Lanes::splat(simd, 0.0);
    let (mut x, mut y) = (Vec::with_capacity(commands), Vec::with_capacity(commands));
    for _ in 0..commands {
        let late = late.iter().filter_map(|effect| effect.late(&mut draw));
        let sum = |[x, y]: Pair<S>, [late_x, late_y]: Pair<S>| [x + late_x, y + late_y];
        let late = late.fold([zero; 2], sum);
        x.push(late[0].max(zero).to_array());
        y.push(late[1].max(zero).to_array());
    }
    [x, y]
}

impl<'a> Issued<'a> {
    /// One command a row.
    fn rows(times: &'a Timeline) -> Self {
        Self {
            times,
            places: (0..times.rows()).map(|row| (row, 0)).collect(),
        }
    }

    /// One command a substep, each of which is a row of `times`.
    fn substeps(rows: &Timeline, times: &'a Timeline) -> Self {
        let of_row = |row: usize| (0..rows.substeps(row) as u32).map(move |substep| (row, substep));
        Self {
            times,
            places: (0..rows.rows()).flat_map(of_row).collect(),
        }
    }

    /// When the commands of a lane's rollout come, those of a row all so late; one that a later command has
    /// overtaken does not.
    fn moments(&self, rows: &Timeline, lane: usize, late: &[[f64; 8]]) -> Vec<Moment> {
        let mut soonest = f64::INFINITY;
        let mut moments: Vec<Moment> = Vec::with_capacity(self.places.len());
        for (what, &(own, substep)) in self.places.iter().enumerate().rev() {
            let time = self.times.begins(what, lane) + late[own][lane];
            if time < soonest {
                soonest = time;
                let in_time = rows.begins(own, lane) + f64::from(substep) * rows.lengths(own)[lane];
                let (row, at) = if time == in_time {
                    (own, f64::from(substep))
                } else {
                    let near = moments.last().map_or(own, |later| later.row);
                    rows.locate(lane, time, 0, near)
                };
                moments.push(Moment { row, at, what });
            }
        }
        moments.reverse();
        moments
    }
}
