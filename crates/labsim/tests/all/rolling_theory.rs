//! The rolling engine against closed forms and symmetries.

use std::ops::Range;
use std::sync::atomic::AtomicBool;

use labsim::board::{GRAVITY, SUBSTEP_S};
use labsim::{Batch, Engine, Error, Parameters, PerRollout, Rig, TimeBase, paper_drive};
use proptest::prelude::*;

const EDGE: f64 = 0.276;

fn parameters(gear: f64, friction: f64, time_scale: f64) -> Parameters {
    Parameters::from([gear, gear, friction, time_scale, 1.0])
}

/// One rollout on the paper's board, from the centre.
fn simulate(
    rig: &Rig,
    parameters: Parameters,
    commands: &[[f64; 2]],
    velocity: [f64; 2],
) -> Vec<[f64; 2]> {
    let batch = Batch {
        rig,
        parameters: &[parameters],
        rows: commands.len(),
        commands: PerRollout::Shared(commands),
        start_velocity: PerRollout::Shared(&[velocity]),
        ..Batch::new(rig, &[], &[])
    };
    batch
        .run(Engine::Rolling, Some(1), &AtomicBool::new(false))
        .expect("the inputs are physical")
}

#[test]
fn a_tilted_board_accelerates_the_marble_by_five_sevenths_of_g_sin() {
    for tilt in [-0.004, 0.0005, 0.004] {
        let seen = simulate(
            &Rig::default(),
            parameters(1.0, 0.0, 24.0),
            &[[0.0, tilt]; 11],
            [0.0; 2],
        );
        let acceleration = 5.0 / 7.0 * GRAVITY * f64::sin(tilt);
        for (row, position) in seen.iter().enumerate() {
            let n = 24.0 * row as f64;
            let expected = acceleration * SUBSTEP_S.powi(2) * n * (n + 1.0) / 2.0 / EDGE;
            assert!(
                (position[0] - expected).abs() < 1e-12,
                "row {row} of tilt {tilt}: {position:?}"
            );
            assert_eq!(position[1], 0.0);
        }
    }
}

#[test]
fn a_knob_about_x_moves_the_marble_along_minus_y() {
    let seen = simulate(
        &Rig::default(),
        parameters(0.05, 0.0, 10.0),
        &[[0.1, 0.0]; 20],
        [0.0; 2],
    );
    assert!(seen[19][1] < -0.01, "{:?}", seen[19]);
    assert_eq!(seen[19][0], 0.0);
}

#[test]
fn the_marble_starts_to_roll_where_the_tilt_exceeds_the_rolling_friction() {
    let friction: f64 = 0.0007;
    let at = |tilt: f64| {
        simulate(
            &Rig::default(),
            parameters(1.0, friction, 25.0),
            &[[0.0, tilt]; 100],
            [0.0; 2],
        )[99][0]
    };
    assert_eq!(at(friction * (1.0 - 1e-6)), 0.0);
    assert!(at(friction * (1.0 + 1e-4)) > 0.0);
}

#[test]
fn rolling_resistance_stops_a_marble_after_its_run_out() {
    let (friction, speed) = (0.001, 0.02);
    let seen = simulate(
        &Rig::default(),
        parameters(0.0, friction, 24.0),
        &[[0.0; 2]; 60],
        [speed / EDGE, 0.0],
    );
    let run_out = speed * speed / (2.0 * 5.0 / 7.0 * friction * GRAVITY);
    assert!(
        (seen[59][0] * EDGE / run_out - 1.0).abs() < 0.01,
        "{} m, not {run_out} m",
        seen[59][0] * EDGE
    );
    assert_eq!(seen[58], seen[59]);
}

#[test]
fn damping_decays_the_speed_exponentially() {
    let mut rig = Rig::default();
    rig.marble.damping_per_s = 0.5;
    let seen = simulate(
        &rig,
        parameters(0.0, 0.0, 24.0),
        &[[0.0; 2]; 21],
        [0.1, 0.0],
    );
    let decay = (seen[20][0] - seen[19][0]) / (seen[1][0] - seen[0][0]);
    assert!(
        (decay / f64::exp(-0.5 * 1.9) - 1.0).abs() < 0.002,
        "{decay}"
    );
}

#[test]
fn a_rebound_keeps_its_spin_until_the_board_has_taken_it() {
    // Against a smooth rim v becomes -e v and the spin stays; rolling again, w = (5 (-e) + 2) v / 7.
    let mut rig = Rig::default();
    (rig.board.wall_restitution, rig.board.wall_friction) = (0.8, 0.0);
    let seen = simulate(
        &rig,
        parameters(0.0, 0.0, 24.0),
        &[[0.0; 2]; 60],
        [0.5, 0.0],
    );
    let speed = (seen[59][0] - seen[58][0]) / 0.1;
    assert!(
        (speed / (0.5 * (2.0 - 5.0 * 0.8) / 7.0) - 1.0).abs() < 1e-9,
        "{speed}"
    );
}

#[test]
fn a_marble_that_leans_on_a_rim_rolls_on_board_and_rim() {
    // Both surfaces turn it: a push sees 1 + 2/5 + 2/5 of the mass.
    let mut commands = vec![[0.0, 0.05]; 40];
    commands.extend([[-0.002, 0.05]; 11]);
    let seen = simulate(
        &Rig::default(),
        parameters(1.0, 0.0, 24.0),
        &commands,
        [0.0; 2],
    );
    let (t, acceleration) = (1.0_f64, 5.0 / 9.0 * GRAVITY * 0.002);
    let expected = 0.5 * acceleration * t * t / EDGE;
    assert!(
        (seen[50][1] / expected - 1.0).abs() < 0.01,
        "{:?}, not {expected}",
        seen[50]
    );
}

#[test]
fn a_marble_that_spins_along_a_rim_is_resisted_by_the_board() {
    let (friction, tilt) = (0.001, 0.003);
    let mut rig = Rig::default();
    rig.board.spinning_friction = friction;
    let mut commands = vec![[0.0, 0.05]; 40];
    commands.extend([[-tilt, 0.05]; 11]);
    let seen = simulate(&rig, parameters(1.0, 0.0, 24.0), &commands, [0.0; 2]);
    let acceleration = 5.0 / 9.0 * GRAVITY * (tilt - friction);
    let expected = 0.5 * acceleration / EDGE;
    assert!(
        (seen[50][1] / expected - 1.0).abs() < 0.01,
        "{:?}, not {expected}",
        seen[50]
    );
}

#[test]
fn a_marble_at_rest_on_a_level_board_stays() {
    let seen = simulate(
        &Rig::default(),
        parameters(0.1, 0.0, 50.0),
        &[[0.0; 2]; 100],
        [0.0; 2],
    );
    assert!(seen.iter().all(|position| *position == [0.0; 2]));
}

#[test]
fn stamps_of_even_length_equal_a_time_scale() {
    let drive = paper_drive(60, 0.1, false);
    let rig = Rig::default();
    let durations = [17.3 * SUBSTEP_S; 60];
    let run = |time| {
        let parameters = [Parameters::from([0.05, 0.06, 0.0004, 17.3, 0.9])];
        let batch = Batch {
            rig: &rig,
            parameters: &parameters,
            rows: 60,
            commands: PerRollout::Shared(&drive),
            start: PerRollout::Shared(&[[0.1, -0.2]]),
            time,
            ..Batch::new(&rig, &[], &[])
        };
        batch
            .run(Engine::Rolling, None, &AtomicBool::new(false))
            .expect("the inputs are physical")
    };
    let stamped = run(TimeBase::Durations(PerRollout::Shared(&durations)));
    let continuous = run(TimeBase::Continuous(None));
    for (a, b) in stamped.as_flattened().iter().zip(continuous.as_flattened()) {
        assert!((a - b).abs() < 1e-9, "{a} and {b}");
    }
}

#[test]
fn a_cancelled_batch_says_so() {
    let rig = Rig::default();
    let parameters = [parameters(0.05, 0.0, 20.0)];
    let batch = Batch {
        rig: &rig,
        parameters: &parameters,
        rows: 2,
        commands: PerRollout::Shared(&[[0.0; 2]; 2]),
        ..Batch::new(&rig, &[], &[])
    };
    for engine in [Engine::Rolling, Engine::Rapier] {
        assert_eq!(
            batch.run(engine, None, &AtomicBool::new(true)),
            Err(Error::Cancelled)
        );
    }
}

#[test]
fn what_no_physics_allows_is_refused_with_its_place() {
    let rig = Rig::default();
    let run = |parameters: Parameters, knob: f64| {
        let batch = Batch {
            rig: &rig,
            parameters: &[self::parameters(0.05, 0.0, 20.0), parameters],
            rows: 2,
            commands: PerRollout::Shared(&[[knob, 0.0]; 2]),
            ..Batch::new(&rig, &[], &[])
        };
        batch
            .run(Engine::Rolling, None, &AtomicBool::new(false))
            .expect_err("refused")
            .to_string()
    };
    let wrong = |name: &str, parameters: [f64; 5]| {
        let message = run(parameters.into(), 0.1);
        assert!(
            message.starts_with(&format!("{name} of rollout 1: expected")),
            "{message}"
        );
    };
    wrong("gear_x", [f64::NAN, 0.1, 0.0, 20.0, 1.0]);
    wrong("rolling_friction", [0.1, 0.1, -0.1, 20.0, 1.0]);
    wrong("time_scale", [0.1, 0.1, 0.0, -1.0, 1.0]);
    wrong("observation_scale", [0.1, 0.1, 0.0, 20.0, 0.0]);
    assert!(run(parameters(0.05, 0.0, 20.0), f64::INFINITY).starts_with("commands of rollout 0"));
    assert!(run(parameters(20.0, 0.0, 20.0), 0.1).contains("tilts by less than π/2, got 2"));
}

fn any_commands() -> impl Strategy<Value = Vec<[f64; 2]>> {
    prop::collection::vec(prop::array::uniform2(-0.3..0.3), 2..60)
}

fn any_parameters() -> impl Strategy<Value = Parameters> {
    (-0.2..0.2, -0.2..0.2, 0.0..0.002, 0.0..50.0, 0.7..1.3).prop_map(
        |(gear_x, gear_y, friction, time, scale)| [gear_x, gear_y, friction, time, scale].into(),
    )
}

fn any_rig() -> impl Strategy<Value = Rig> {
    (0.0..0.95, 0.0..1.0, 0.0..0.5).prop_map(|(restitution, friction, damping)| {
        let mut rig = Rig::default();
        (rig.board.wall_restitution, rig.board.wall_friction) = (restitution, friction);
        rig.marble.damping_per_s = damping;
        rig
    })
}

proptest! {
    #[test]
    fn mirrored_commands_give_mirrored_paths(
        rig in any_rig(), parameters in any_parameters(), commands in any_commands(), v in prop::array::uniform2(-0.5..0.5),
    ) {
        let mirrored: Vec<[f64; 2]> = commands.iter().map(|knobs| knobs.map(|knob| -knob)).collect();
        let seen = simulate(&rig, parameters, &commands, v);
        let other = simulate(&rig, parameters, &mirrored, v.map(|v: f64| -v));
        for (a, b) in seen.as_flattened().iter().zip(other.as_flattened()) {
            prop_assert_eq!(*a, -*b);
        }
    }

    #[test]
    fn the_marble_never_leaves_the_board(
        rig in any_rig(), parameters in any_parameters(), commands in any_commands(), v in prop::array::uniform2(-3.0..3.0),
    ) {
        let reach = rig.reach_m().map(|reach| reach / EDGE * parameters.observation_scale * (1.0 + 1e-12));
        for position in simulate(&rig, parameters, &commands, v) {
            prop_assert!(position[0].abs() <= reach[0] && position[1].abs() <= reach[1], "{:?}", position);
        }
    }

}

proptest! {
    // Each case simulates hundreds of rollouts.
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn bits_do_not_depend_on_threads_or_company(
        rig in any_rig(),
        parameters in prop::collection::vec(any_parameters(), 1..80),
        commands in any_commands(),
        stamped in any::<bool>(),
    ) {
        let rows = commands.len();
        // Rows of 0 to 12 substeps, in another order for each rollout.
        let durations: Vec<f64> = (0..parameters.len() * rows)
            .map(|i| (i * i % 13) as f64 * SUBSTEP_S)
            .collect();
        let run = |rollouts: Range<usize>, threads| {
            let durations = &durations[rollouts.start * rows..rollouts.end * rows];
            let batch = Batch {
                rig: &rig,
                parameters: &parameters[rollouts],
                rows,
                commands: PerRollout::Shared(&commands),
                start: PerRollout::Shared(&[[0.01, 0.02]]),
                start_velocity: PerRollout::Shared(&[[0.1, 0.0]]),
                time: if stamped {
                    TimeBase::Durations(PerRollout::Each(durations))
                } else {
                    TimeBase::Rounded
                },
                ..Batch::new(&rig, &[], &[])
            };
            batch.run(Engine::Rolling, Some(threads), &AtomicBool::new(false)).expect("the inputs are physical")
        };
        let together = run(0..parameters.len(), 1);
        for threads in [2, 4] {
            prop_assert_eq!(&run(0..parameters.len(), threads), &together);
        }
        for i in 0..parameters.len() {
            prop_assert_eq!(&run(i..i + 1, 2)[..], &together[i * rows..(i + 1) * rows]);
        }
    }
}
