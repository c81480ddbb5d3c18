//! What holds for every rollout of the rigid-body engine: equal bits, symmetry, the clock, bounds.

use std::sync::atomic::AtomicBool;

use labsim::board::{GRAVITY, SUBSTEP_S};
use labsim::{Batch, Engine, Parameters, PerRollout, Rig, TimeBase};

fn run(batch: &Batch<'_>, threads: Option<usize>) -> Vec<[f64; 2]> {
    batch
        .run(Engine::Rapier, threads, &AtomicBool::new(false))
        .expect("legal inputs")
}

/// Rollouts over the paper's ranges and beyond, off the centre, each with a drive of its own.
struct Drawn {
    rig: Rig,
    parameters: Vec<Parameters>,
    commands: Vec<[f64; 2]>,
    start: Vec<[f64; 2]>,
    velocity: Vec<[f64; 2]>,
}

const ROWS: usize = 40;

impl Drawn {
    fn new(count: usize) -> Self {
        let mut state = 1_u64;
        let mut draw = |low: f64, high: f64| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            low + (high - low) * (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let mut rig = Rig::default();
        rig.board.wall_restitution = 0.5;
        let parameters = (0..count)
            .map(|_| {
                [
                    draw(0.0, 0.3),
                    draw(0.0, 0.3),
                    draw(0.0, 2e-3),
                    draw(0.0, 25.0),
                    1.0,
                ]
                .into()
            })
            .collect();
        let mut pairs = |number: usize, high: f64| -> Vec<[f64; 2]> {
            (0..number)
                .map(|_| [draw(-high, high), draw(-high, high)])
                .collect()
        };
        let mut start = pairs(count, 0.6);
        // Marbles on one another, and marbles that meet two walls at once.
        start[1] = start[0];
        start[2] = [1.0, 1.0];
        start[3] = [-1.0, 1.0];
        Self {
            rig,
            parameters,
            commands: pairs(count * ROWS, 0.3),
            start,
            velocity: pairs(count, 1.0),
        }
    }

    /// The rollouts with these numbers.
    fn paths(&self, numbers: &[usize], time: TimeBase<'_>, threads: usize) -> Vec<Vec<[f64; 2]>> {
        let pick = |all: &[[f64; 2]]| numbers.iter().map(|&i| all[i]).collect::<Vec<_>>();
        let rows = |&i: &usize| &self.commands[i * ROWS..(i + 1) * ROWS];
        let parameters: Vec<_> = numbers.iter().map(|&i| self.parameters[i]).collect();
        let batch = Batch {
            rig: &self.rig,
            parameters: &parameters,
            rows: ROWS,
            commands: PerRollout::Each(&numbers.iter().flat_map(rows).copied().collect::<Vec<_>>()),
            start: PerRollout::Each(&pick(&self.start)),
            start_velocity: PerRollout::Each(&pick(&self.velocity)),
            time,
            ..Batch::new(&self.rig, &[], &[])
        };
        run(&batch, Some(threads))
            .chunks(ROWS)
            .map(<[_]>::to_vec)
            .collect()
    }
}

/// Bits that must not depend on the neighbours: symptoms were contacts of one marble that changed order.
#[test]
fn company_and_threads_leave_every_bit() {
    let drawn = Drawn::new(130);
    for time in [TimeBase::Rounded, TimeBase::Continuous(None)] {
        let alone: Vec<_> = (0..130)
            .map(|i| drawn.paths(&[i], time, 1).remove(0))
            .collect();
        let mut backwards: Vec<usize> = (0..130).collect();
        backwards.reverse();
        let orders = [1, 2, 63, 64, 65, 130].map(|size| (0..size).collect::<Vec<_>>());
        for numbers in orders
            .into_iter()
            .chain([backwards, vec![3, 2, 1, 0], vec![2; 100]])
        {
            for threads in [1, 2, 4] {
                let together = drawn.paths(&numbers, time, threads);
                for (i, path) in numbers.iter().zip(together) {
                    let size = numbers.len();
                    assert!(
                        path == alone[*i],
                        "rollout {i} among {size} on {threads} threads"
                    );
                }
            }
        }
    }
}

#[test]
fn mirrored_commands_give_mirrored_paths() {
    let drawn = Drawn::new(40);
    let numbers: Vec<usize> = (0..40).collect();
    let paths = drawn.paths(&numbers, TimeBase::Rounded, 2);
    for mirror in [[-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]] {
        let turn = |all: &[[f64; 2]]| -> Vec<[f64; 2]> {
            all.iter()
                .map(|[x, y]| [mirror[0] * x, mirror[1] * y])
                .collect()
        };
        let mirrored = Drawn {
            rig: drawn.rig,
            parameters: drawn.parameters.clone(),
            // The knob about y moves the marble along x.
            commands: drawn
                .commands
                .iter()
                .map(|[x, y]| [mirror[1] * x, mirror[0] * y])
                .collect(),
            start: turn(&drawn.start),
            velocity: turn(&drawn.velocity),
        };
        let images = mirrored.paths(&numbers, TimeBase::Rounded, 2);
        let worst = paths
            .iter()
            .zip(&images)
            .flat_map(|(path, image)| path.iter().zip(turn(image)))
            .map(|(seen, image)| (seen[0] - image[0]).abs().max((seen[1] - image[1]).abs()))
            .fold(0.0, f64::max);
        assert!(worst < 1e-9, "mirror {mirror:?}: {worst} edges apart");
    }
}

/// A marble at rest under a steady push, by the updates it is simulated with: v += a h, x += v h.
fn expected_way(steps: &[(u32, f64)], acceleration: f64) -> Vec<f64> {
    let (mut x, mut v) = (0.0, 0.0);
    let mut rows = vec![x];
    for &(updates, length_s) in steps {
        for _ in 0..updates {
            v += acceleration * length_s;
            x += v * length_s;
        }
        rows.push(x);
    }
    rows
}

#[test]
fn updates_of_any_length_follow_the_clock() {
    let (tilt, rolling_friction) = (0.004_f64, 0.001);
    let acceleration = 5.0 / 7.0 * GRAVITY * (tilt.sin() - rolling_friction * tilt.cos());
    let rig = Rig::default();
    let way = |time: TimeBase<'_>, time_scale: f64| -> Vec<f64> {
        let batch = Batch {
            rig: &rig,
            parameters: &[[1.0, 1.0, rolling_friction, time_scale, 1.0].into()],
            rows: 9,
            commands: PerRollout::Shared(&[[0.0, tilt]; 9]),
            time,
            ..Batch::new(&rig, &[], &[])
        };
        let path = run(&batch, None);
        path.iter().map(|row| row[0] * rig.board.edge_x_m).collect()
    };
    let assert_follows = |what: &str, seen: &[f64], steps: &[(u32, f64)]| {
        for (row, (x, expected)) in seen
            .iter()
            .zip(expected_way(steps, acceleration))
            .enumerate()
        {
            let off = (x - expected).abs();
            assert!(
                off <= 2e-4 * expected,
                "{what}, row {row}: {x} m instead of {expected} m"
            );
        }
    };

    for substeps in [6, 11, 12, 13, 40] {
        let steps = [(substeps, 12.3 * SUBSTEP_S / f64::from(substeps)); 8];
        let time = TimeBase::Continuous(Some(&[substeps]));
        // Six updates of 2.05/240 s are simulated as twelve.
        let steps = if substeps == 6 {
            [(12, steps[0].1 / 2.0); 8]
        } else {
            steps
        };
        assert_follows(&format!("{substeps} updates"), &way(time, 12.3), &steps);
    }
    let seconds: [f64; 9] = [0.05, 0.0, 0.021, 0.0001, 0.1, 0.033, 1e-13, 0.2, 7.0];
    let steps = seconds[..8].iter().map(|s| {
        let updates = (s * 240.0).round().max(1.0);
        (updates as u32, if *s < 1e-11 { 0.0 } else { s / updates })
    });
    let time = TimeBase::Durations(PerRollout::Shared(&seconds));
    assert_follows("stamps", &way(time, 0.0), &steps.collect::<Vec<_>>());

    let still = way(TimeBase::Rounded, 0.4);
    assert!(
        still.iter().all(|x| *x == 0.0),
        "moves without an update: {still:?}"
    );
}

/// Steeper tilts and faster marbles than any rig has, from the centre, beyond a corner and at a wall.
#[test]
fn extremes_stay_finite_and_on_the_board() {
    let (mut tilts, mut starts, mut velocities) = (vec![], vec![], vec![]);
    for tilt in [[1.5, 1.5], [-1.5, 0.0], [-0.3, -0.3], [0.0, 0.0]] {
        for start in [[0.0, 0.0], [10.0, -10.0], [0.4, 0.36], [-0.475_18, 0.0]] {
            for speed in [0.0, 4.0, 150.0] {
                tilts.extend([tilt; ROWS]);
                starts.push(start);
                velocities.push([speed, -0.7 * speed]);
            }
        }
    }
    for (restitution, friction, damping) in [
        (0.0, 0.25, 0.0),
        (0.9, 0.25, 0.0),
        (1.0, 0.0, 0.0),
        (0.9, 5.0, 3.0),
    ] {
        let mut rig = Rig::default();
        rig.board.wall_restitution = restitution;
        rig.board.wall_friction = friction;
        rig.marble.damping_per_s = damping;
        let parameters = vec![[1.0, 1.0, 0.01, 30.0, 1.0].into(); starts.len()];
        let batch = Batch {
            rig: &rig,
            parameters: &parameters,
            rows: ROWS,
            commands: PerRollout::Each(&tilts),
            start: PerRollout::Each(&starts),
            start_velocity: PerRollout::Each(&velocities),
            ..Batch::new(&rig, &[], &[])
        };
        let bounds = rig
            .reach_m()
            .map(|reach| (reach + rig.marble.radius_m) / rig.board.edge_x_m);
        for (i, path) in run(&batch, None).chunks(ROWS).enumerate() {
            for (row, seen) in path.iter().enumerate().skip(1) {
                let inside = seen[0].abs() < bounds[0] && seen[1].abs() < bounds[1];
                assert!(
                    inside,
                    "restitution {restitution}, rollout {i}, row {row}: {seen:?}"
                );
            }
        }
    }
}
