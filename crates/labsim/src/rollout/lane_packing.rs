//! Grouping of rollouts by duration and by similar motion.
//!
//! All lanes of a register pay for each substep in which one lane meets a rim or stops; lanes that move
//! alike do so in the same substeps. The order decides only which marbles share a register, never a result.

use crate::board::{Board, GRAVITY, SUBSTEP_S};
use crate::engine::Job;

/// Lanes of the widest register; smaller groups are not sorted.
pub(super) const REGISTER: usize = 8;

/// Features of a rollout without rims (board edges): its start, the displacement by its start velocity and by
/// its tilts at three rows along x and y, and the loss by friction.
type Outline = [f64; 11];

/// The rollouts' indices, the longest first, so that no thread ends with a long group.
pub(super) fn order(jobs: &[&Job<'_>], board: &Board, rows: usize) -> Vec<usize> {
    let compare = |a: &usize, b: &usize| {
        let (a, b) = (jobs[*a], jobs[*b]);
        let firsts = b.first.cmp(&a.first);
        firsts.then_with(|| b.clock.compare(&a.clock, a.first + rows))
    };
    let mut order: Vec<usize> = (0..jobs.len()).collect();
    order.sort_by(compare);
    let outlines: Vec<Outline> = jobs.iter().map(|job| outline(job, board, rows)).collect();
    for alike in order.chunk_by_mut(|a, b| compare(a, b).is_eq()) {
        split(alike, &outlines);
    }
    order
}

/// Whether two rollouts may share a group of lanes: their marbles are released at the same row and, unless they
/// are plain, all rows have the same number of substeps.
pub(super) fn may_share(a: &Job<'_>, b: &Job<'_>, rows: usize, plain: bool) -> bool {
    a.first == b.first && (plain || a.clock.compare(&b.clock, a.first + rows).is_eq())
}

fn outline(job: &Job<'_>, board: &Board, rows: usize) -> Outline {
    let seconds = job.clock.total_substeps(rows) as f64 * SUBSTEP_S;
    let edges_per_slope = 5.0 / 14.0 * GRAVITY * seconds * seconds / board.edge_x_m;
    let parameters = &job.parameters;
    let [a, b, c] = [0, rows / 3, 2 * rows / 3].map(|row| {
        let [x, y] = job.commands[job.first + row];
        [parameters.gear_x * x, parameters.gear_y * y].map(|slope| slope * edges_per_slope)
    });
    let friction = parameters.rolling_friction * edges_per_slope;
    let [x, y] = job.start;
    let [vx, vy] = job.start_velocity.map(|velocity| velocity * seconds);
    [a[0], a[1], b[0], b[1], c[0], c[1], friction, x, y, vx, vy]
}

/// Halves the rollouts where they differ most, and the halves again, down to a register.
fn split(rollouts: &mut [usize], outlines: &[Outline]) {
    if rollouts.len() <= REGISTER {
        return;
    }
    let (mut low, mut high) = (outlines[rollouts[0]], outlines[rollouts[0]]);
    for &rollout in &*rollouts {
        for (axis, &value) in outlines[rollout].iter().enumerate() {
            low[axis] = low[axis].min(value);
            high[axis] = high[axis].max(value);
        }
    }
    let width = |axis: &usize| high[*axis] - low[*axis];
    let widest = (0..low.len())
        .max_by(|a, b| width(a).total_cmp(&width(b)))
        .unwrap_or(0);
    let along = |rollout: &usize| outlines[*rollout][widest];
    let middle = (rollouts.len() / 2).next_multiple_of(REGISTER);
    rollouts.select_nth_unstable_by(middle, |a, b| along(a).total_cmp(&along(b)));
    let (low, high) = rollouts.split_at_mut(middle);
    split(low, outlines);
    split(high, outlines);
}

#[cfg(test)]
mod tests {
    use std::cmp::Reverse;

    use super::*;
    use crate::engine::{Clock, Step};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_rollout_has_one_place_and_the_longest_come_first(
            rollouts in prop::collection::vec((0_u32..4, prop::array::uniform3(-0.1..0.1)), 0..100),
        ) {
            let commands = [[0.1, -0.1]; 5];
            let jobs: Vec<Job<'_>> = rollouts
                .iter()
                .map(|&(substeps, [gear, x, y])| Job {
                    rollout: 0,
                    knobs_before: [0.0; 2],
                    first: 0,
                    seed: 0,
                    measured: None,
                    parameters: [gear, 0.05, 0.0, f64::from(substeps), 1.0].into(),
                    commands: &commands,
                    start: [x, y],
                    start_velocity: [0.0; 2],
                    rolled: 0.0,
                    turned: [0.0; 3],
                    clock: Clock::Even(Step::rounded(f64::from(substeps))),
                })
                .collect();
            let order = order(&jobs.iter().collect::<Vec<_>>(), &Board::default(), commands.len());
            prop_assert!(order.is_sorted_by_key(|&i| Reverse(rollouts[i].0)));
            let mut all = order;
            all.sort_unstable();
            prop_assert!(all.into_iter().eq(0..jobs.len()));
        }
    }
}
