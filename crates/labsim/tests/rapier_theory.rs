//! The rigid-body engine against what theory says of a rolling sphere.

use std::sync::atomic::AtomicBool;

use labsim::board::{BOARD_FRICTION, GRAVITY, SUBSTEP_S};
use labsim::{Batch, Engine, Parameters, PerRollout, Rig, TimeBase};

/// One marble under a command that does not change, observed after each update, in metres.
struct Run {
    rig: Rig,
    rolling_friction: f64,
    /// Tilt of the board about x and y (rad).
    tilt: [f64; 2],
    start_m: [f64; 2],
    velocity_m_per_s: [f64; 2],
    rows: usize,
    /// Updates a row.
    updates: u32,
}

impl Default for Run {
    fn default() -> Self {
        Self {
            rig: Rig::default(),
            rolling_friction: 0.0,
            tilt: [0.0; 2],
            start_m: [0.0; 2],
            velocity_m_per_s: [0.0; 2],
            rows: 101,
            updates: 1,
        }
    }
}

impl Run {
    fn simulate(&self) -> Vec<[f64; 2]> {
        let edge = self.rig.board.edge_x_m;
        let parameters = [
            1.0,
            1.0,
            self.rolling_friction,
            f64::from(self.updates),
            1.0,
        ];
        let batch = Batch {
            rig: &self.rig,
            parameters: &[Parameters::from(parameters)],
            rows: self.rows,
            commands: PerRollout::Shared(&vec![self.tilt; self.rows]),
            start: PerRollout::Shared(&[self.start_m.map(|m| m / edge)]),
            start_velocity: PerRollout::Shared(&[self.velocity_m_per_s.map(|m| m / edge)]),
            time: TimeBase::Rounded,
        };
        let observed = run(&batch, None);
        observed
            .iter()
            .map(|row| row.map(|edges| edges * edge))
            .collect()
    }
}

fn run(batch: &Batch<'_>, threads: Option<usize>) -> Vec<[f64; 2]> {
    batch
        .run(Engine::Rapier, threads, &AtomicBool::new(false))
        .expect("legal inputs")
}

/// Acceleration along an axis from the first, middle and last row (m/s²).
fn acceleration(path: &[[f64; 2]], axis: usize, row_s: f64) -> f64 {
    let middle = (path.len() - 1) / 2;
    let difference = path[2 * middle][axis] - 2.0 * path[middle][axis] + path[0][axis];
    difference / (middle as f64 * row_s).powi(2)
}

/// Velocity along an axis between two neighbouring rows (m/s).
fn velocity(path: &[[f64; 2]], axis: usize, row: usize) -> f64 {
    (path[row + 1][axis] - path[row][axis]) / SUBSTEP_S
}

fn assert_near(what: &str, value: f64, expected: f64, relative: f64) {
    let off = (value / expected - 1.0).abs();
    assert!(
        off <= relative,
        "{what}: {value} instead of {expected} ({:.3} % off)",
        100.0 * off
    );
}

#[test]
fn pure_roll_accelerates_by_five_sevenths() {
    for tilt in [0.0005, 0.001, 0.002, 0.005, 0.01] {
        for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
            let mut tilts = [0.0; 2];
            // A tilt about y moves the marble along x, one about x against y.
            tilts[1 - axis] = if axis == 0 { sign * tilt } else { -sign * tilt };
            let path = Run {
                tilt: tilts,
                rows: 121,
                ..Run::default()
            }
            .simulate();
            let expected = sign * 5.0 / 7.0 * GRAVITY * tilt.sin();
            let what = format!("axis {axis}, tilt {tilt}");
            assert_near(
                &what,
                acceleration(&path, axis, SUBSTEP_S),
                expected,
                0.0005,
            );
            assert!(
                path.iter().all(|row| row[1 - axis].abs() < 1e-12),
                "{what}: drifts sideways"
            );
        }
    }
}

#[test]
fn tilt_about_x_comes_before_tilt_about_y() {
    let tilt: [f64; 2] = [0.2, 0.3];
    let path = Run {
        tilt,
        rows: 41,
        ..Run::default()
    }
    .simulate();
    let along_y = -5.0 / 7.0 * GRAVITY * tilt[0].sin() * tilt[1].cos();
    assert_near(
        "along x",
        acceleration(&path, 0, SUBSTEP_S),
        5.0 / 7.0 * GRAVITY * tilt[1].sin(),
        0.001,
    );
    assert_near("along y", acceleration(&path, 1, SUBSTEP_S), along_y, 0.001);
}

#[test]
fn rests_below_the_threshold_and_rolls_above_it() {
    for rolling_friction in [1e-4_f64, 1e-3, 1e-2] {
        for direction in [0.0_f64, 0.7, 2.0, 4.0] {
            let threshold = rolling_friction.atan();
            let at = |tilt: f64| Run {
                rolling_friction,
                tilt: [tilt * direction.cos(), tilt * direction.sin()],
                rows: 21,
                updates: 240,
                ..Run::default()
            };
            let rests = at(0.99 * threshold).simulate();
            let crept = rests
                .iter()
                .flatten()
                .fold(0.0, |most: f64, x| most.max(x.abs()));
            assert!(
                crept < 1e-6,
                "friction {rolling_friction}: crept {crept} m in 20 s"
            );

            let rolls = Run {
                rows: 3,
                ..at(1.01 * threshold)
            }
            .simulate();
            let rolled = rolls[2][0].hypot(rolls[2][1]);
            let excess = GRAVITY * ((1.01 * threshold).sin() - rolling_friction);
            assert_near("rolled in 2 s", rolled, 5.0 / 7.0 * excess * 2.0, 0.05);
        }
    }
}

#[test]
fn rolls_out_by_five_sevenths_of_friction() {
    let rolling_friction = 1e-3;
    let deceleration = 5.0 / 7.0 * rolling_friction * GRAVITY;
    for velocity_m_per_s in [[0.03, 0.0], [0.0, -0.03], [0.02, 0.02]] {
        let speed = f64::hypot(velocity_m_per_s[0], velocity_m_per_s[1]);
        let path = Run {
            rolling_friction,
            velocity_m_per_s,
            rows: 1500,
            ..Run::default()
        }
        .simulate();
        let way = |row: &[f64; 2]| row[0].hypot(row[1]);
        let slowing = [0, 240, 480].map(|row| way(&path[row]));
        assert_near(
            "deceleration",
            2.0 * slowing[1] - slowing[0] - slowing[2],
            deceleration,
            0.01,
        );
        let last = path.last().expect("rows");
        assert_near("way", way(last), speed * speed / (2.0 * deceleration), 0.01);
    }
}

/// A marble that rolls to the wall at positive x, and the row at which it touches it.
fn impact(restitution: f64, friction: f64, speed: f64) -> (Vec<[f64; 2]>, usize) {
    let mut rig = Rig::default();
    (rig.board.wall_restitution, rig.board.wall_friction) = (restitution, friction);
    let [reach, _] = rig.reach_m();
    let path = Run {
        rig,
        start_m: [reach - 0.0301, 0.0],
        velocity_m_per_s: [speed, 0.0],
        rows: 480,
        ..Run::default()
    }
    .simulate();
    let deepest = path
        .iter()
        .map(|row| row[0] - reach)
        .fold(f64::MIN, f64::max);
    assert!(
        deepest < 1e-5,
        "restitution {restitution}, {speed} m/s: {deepest} m in the wall"
    );
    let touch = path.iter().position(|row| row[0] > reach - 1e-5);
    (path, touch.expect("the marble reaches the wall"))
}

#[test]
fn walls_return_their_part_of_the_normal_velocity() {
    for speed in [0.05, 0.2, 0.8, 2.0] {
        for restitution in [0.3, 0.6, 0.9] {
            let (path, touch) = impact(restitution, 0.0, speed);
            // It still spins forwards, so the board brakes it from the first update on.
            let braking = BOARD_FRICTION * GRAVITY * SUBSTEP_S;
            let what = format!("restitution {restitution} at {speed} m/s");
            let returned = velocity(&path, 0, touch) - braking;
            assert_near(&what, returned, -restitution * speed, 0.002);
        }
    }
}

/// Friction at the board shares what it cannot change: 5 v + 2 s, where s is spin times radius.
#[test]
fn spin_outlives_an_impact() {
    let speed = 0.2;
    for restitution in [0.6, 0.9] {
        let (path, touch) = impact(restitution, 0.0, speed);
        let expected = (2.0 - 5.0 * restitution) / 7.0 * speed;
        let what = format!("restitution {restitution}");
        assert_near(&what, velocity(&path, 0, touch + 40), expected, 0.002);
    }
}

/// Rapier solves contacts in an order that, left to itself, lets the board throw back a marble that
/// still spins when a wall without restitution has stopped it.
#[test]
fn walls_without_restitution_keep_the_marble() {
    for speed in [0.05, 0.2, 0.8] {
        for friction in [0.0, 0.25] {
            let (path, touch) = impact(0.0, friction, speed);
            let left = path
                .iter()
                .skip(touch)
                .map(|row| path[touch][0] - row[0])
                .fold(0.0, f64::max);
            assert!(
                left < 1e-5,
                "friction {friction}, {speed} m/s: {left} m off the wall"
            );
        }
    }
}

/// Along a wall that holds it by friction a marble also spins about the vertical: 1 + 2/5 + 2/5.
#[test]
fn rolls_along_a_wall_at_five_ninths() {
    let rolling_friction = 1e-3;
    let rig = Rig::default();
    let [reach, _] = rig.reach_m();
    let along = |tilt_x: f64, rows: usize| {
        let run = Run {
            rolling_friction,
            tilt: [-tilt_x, 0.01],
            start_m: [reach, -0.05],
            rows,
            ..Run::default()
        };
        run.simulate()
    };
    let push = 0.003_f64.sin() - rolling_friction * 0.003_f64.cos();
    let path = along(0.003, 361);
    let expected = 5.0 / 9.0 * GRAVITY * push * 0.01_f64.cos();
    assert_near(
        "along the wall",
        acceleration(&path, 1, SUBSTEP_S),
        expected,
        0.001,
    );
    assert!(
        path.iter().all(|row| (row[0] - reach).abs() < 1e-6),
        "stays at the wall"
    );

    let crept = along(0.99 * rolling_friction, 2400)[2399][1] + 0.05;
    assert!(
        crept.abs() < 1e-6,
        "the wall's push moved the marble by {crept} m"
    );
}

#[test]
fn rests_in_a_corner() {
    let [reach_x, reach_y] = Rig::default().reach_m();
    let run = Run {
        tilt: [-0.02, 0.03],
        start_m: [0.12, 0.09],
        rows: 1200,
        ..Run::default()
    };
    for row in &run.simulate()[600..] {
        let [x, y] = [row[0] - reach_x, row[1] - reach_y];
        assert!(
            x.abs() < 2e-6 && y.abs() < 2e-6,
            "{x} m, {y} m from the corner"
        );
    }
}

#[test]
fn damping_takes_its_part_of_every_velocity() {
    let mut rig = Rig::default();
    rig.marble.damping_per_s = 0.5;
    let path = Run {
        rig,
        velocity_m_per_s: [0.04, 0.03],
        rows: 482,
        ..Run::default()
    }
    .simulate();
    let left = (1.0 + 0.5 * SUBSTEP_S).powi(-480);
    for axis in [0, 1] {
        let expected = velocity(&path, axis, 0) * left;
        assert_near("after 2 s", velocity(&path, axis, 480), expected, 0.001);
    }
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
    fn of(&self, numbers: &[usize], time: TimeBase<'_>, threads: usize) -> Vec<Vec<[f64; 2]>> {
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
        };
        run(&batch, Some(threads))
            .chunks(ROWS)
            .map(<[_]>::to_vec)
            .collect()
    }
}

/// Bits that must not depend on company: symptoms were contacts of one marble that changed order.
#[test]
fn company_and_threads_leave_every_bit() {
    let drawn = Drawn::new(130);
    for time in [TimeBase::Rounded, TimeBase::Continuous(None)] {
        let alone: Vec<_> = (0..130)
            .map(|i| drawn.of(&[i], time, 1).remove(0))
            .collect();
        let mut backwards: Vec<usize> = (0..130).collect();
        backwards.reverse();
        let orders = [1, 2, 63, 64, 65, 130].map(|size| (0..size).collect::<Vec<_>>());
        for numbers in orders
            .into_iter()
            .chain([backwards, vec![3, 2, 1, 0], vec![2; 100]])
        {
            for threads in [1, 2, 4] {
                let together = drawn.of(&numbers, time, threads);
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
    let paths = drawn.of(&numbers, TimeBase::Rounded, 2);
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
        let images = mirrored.of(&numbers, TimeBase::Rounded, 2);
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
            start: PerRollout::Shared(&[[0.0; 2]]),
            start_velocity: PerRollout::Shared(&[[0.0; 2]]),
            time,
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

#[test]
fn extremes_stay_finite_and_on_the_board() {
    let materials = [
        (0.0, 0.25, 0.0),
        (0.9, 0.25, 0.0),
        (1.0, 0.0, 0.0),
        (0.9, 5.0, 3.0),
    ];
    let tilts = [[1.5, 1.5], [-1.5, 0.0], [-0.3, -0.3], [0.0, 0.0]];
    // The centre, beyond a corner, near one, at a wall (m).
    let starts = [[0.0, 0.0], [3.0, -3.0], [0.11, 0.1], [-0.131_15, 0.0]];
    for (restitution, friction, damping) in materials {
        for (tilt, start_m) in tilts
            .into_iter()
            .flat_map(|tilt| starts.map(|start| (tilt, start)))
        {
            for speed in [0.0, 1.0, 40.0] {
                let mut rig = Rig::default();
                (rig.board.wall_restitution, rig.board.wall_friction) = (restitution, friction);
                rig.marble.damping_per_s = damping;
                let run = Run {
                    rig,
                    rolling_friction: 0.01,
                    tilt,
                    start_m,
                    velocity_m_per_s: [speed, -0.7 * speed],
                    rows: 30,
                    updates: 30,
                };
                for row in &run.simulate()[1..] {
                    for (x, reach) in row.iter().zip(rig.reach_m()) {
                        let what = format!("restitution {restitution}, {speed} m/s, tilt {tilt:?}");
                        // Steeper than any rig and faster than any marble, still within a radius.
                        assert!(
                            x.abs() < reach + rig.marble.radius_m,
                            "{what}: at {row:?} m"
                        );
                    }
                }
            }
        }
    }
}
