//! The rigid-body engine against what theory says of a rolling sphere.

use std::sync::atomic::AtomicBool;

use labsim::board::{GRAVITY, SUBSTEP_S};
use labsim::{Batch, Engine, Parameters, PerRollout, Rig};

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
            ..Batch::new(&self.rig, &[], &[])
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
            let braking = Rig::default().board.sliding_friction * GRAVITY * SUBSTEP_S;
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
