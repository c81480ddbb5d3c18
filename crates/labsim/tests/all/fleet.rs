//! Marbles that are stepped together: each has the bits of a rollout by itself, for any neighbours.

use std::sync::atomic::AtomicBool;

use labsim::effects::effect;
use labsim::{
    Batch, EffectInstance, Engine, Fleet, Maze, Parameters, PerRollout, Rig, State, TimeBase,
    Tracker,
};

const ROWS: usize = 60;
const ROW_S: f64 = 0.02;
const EDGE: f64 = 0.276;

fn parameters() -> Parameters {
    [0.08, 0.07, 3e-4, 24.0, 1.05].into()
}

fn path() -> Vec<[f64; 2]> {
    (0..200)
        .map(|i| [-0.1 + 0.001 * f64::from(i), 0.0])
        .collect()
}

fn fleet(count: usize, tracker: Tracker, maze: Option<&Maze>) -> Fleet {
    Fleet::new(Rig::default(), maze, path(), tracker, count, (ROWS, ROW_S))
        .expect("a board and a path")
}

/// Marble i's command in a row.
fn command(marble: usize, row: usize) -> [f64; 2] {
    let phase = 0.1 * row as f64 + marble as f64;
    [0.1 * phase.sin(), 0.1 * (0.7 * phase).cos()]
}

fn states(fleet: &Fleet) -> Vec<State> {
    fleet
        .states()
        .map(|one| *one.expect("it has begun"))
        .collect()
}

#[test]
fn marbles_have_the_bits_of_rollouts() {
    let delay = effect("delay").expect("it is known");
    let backlash = effect("backlash").expect("it is known");
    let offset = effect("camera_offset").expect("it is known");
    let sets = [
        vec![],
        vec![(delay, vec![0.05, 0.0])],
        vec![(offset, vec![0.03, -0.02]), (backlash, vec![0.02, 0.01])],
    ];
    let rig = Rig::default();
    let mut fleet = fleet(3, Tracker::default(), None);
    for (marble, effects) in sets.iter().enumerate() {
        let simulator = fleet
            .add(rig, parameters(), effects.clone())
            .expect("it is sound");
        let place = [0.01 * marble as f64, -0.02];
        fleet
            .begin(marble, simulator, (place, 100), 7)
            .expect("it is on the board");
    }
    let mut seen = vec![states(&fleet)];
    for row in 0..ROWS - 1 {
        let commands: Vec<_> = (0..3).map(|marble| command(marble, row)).collect();
        fleet
            .play(&commands, &[true; 3], None)
            .expect("rows are left");
        seen.push(states(&fleet));
    }
    for (marble, effects) in sets.iter().enumerate() {
        let chosen: Vec<_> = effects
            .iter()
            .map(|(effect, values)| EffectInstance {
                effect,
                values: PerRollout::Shared(values),
            })
            .collect();
        let commands: Vec<_> = (0..ROWS).map(|row| command(marble, row)).collect();
        let (start, parameters) = (seen[0][marble].seen, [parameters()]);
        let batch = Batch {
            effects: &chosen,
            start: PerRollout::Shared(&[start]),
            time: TimeBase::Durations(PerRollout::Shared(&[ROW_S; ROWS])),
            ..Batch::new(&rig, &parameters, &commands)
        };
        let found = batch
            .run_with_tilt(Engine::Rolling, Some(1), &AtomicBool::new(false))
            .expect("it is sound");
        for (row, states) in seen.iter().enumerate() {
            let state = states[marble];
            // The place goes through the camera and back, which rounds.
            for axis in 0..2 {
                let off = (state.seen[axis] - found.marble[row][axis]).abs();
                assert!(off < 1e-9, "marble {marble}, row {row}: {off}");
            }
            assert_eq!(state.tilt, found.tilt[row]);
        }
    }
}

#[test]
fn neighbours_threads_and_order_change_no_bit() {
    let run = |count: usize, threads: Option<usize>| {
        let tracker = Tracker {
            noise: 0.002,
            lost: 0.2,
        };
        let mut fleet = fleet(count, tracker, None);
        let simulator = fleet
            .add(Rig::default(), parameters(), vec![])
            .expect("it is sound");
        for marble in (0..count).rev() {
            fleet
                .begin(marble, simulator, ([0.0, 0.0], 100), marble as u64)
                .expect("it is on the board");
        }
        for row in 0..ROWS - 1 {
            let commands: Vec<_> = (0..count).map(|marble| command(marble, row)).collect();
            fleet
                .play(&commands, &vec![true; count], threads)
                .expect("rows are left");
        }
        states(&fleet)
    };
    let (few, many) = (run(2, Some(1)), run(150, Some(2)));
    assert_eq!(few, many[..2]);
    assert_eq!(many, run(150, None));
}

#[test]
fn only_the_active_go_on_and_a_new_episode_begins_anew() {
    let mut fleet = fleet(2, Tracker::default(), None);
    let simulator = fleet
        .add(Rig::default(), parameters(), vec![])
        .expect("it is sound");
    for marble in 0..2 {
        fleet
            .begin(marble, simulator, ([0.0, 0.0], 100), 0)
            .expect("it is on the board");
    }
    let first = states(&fleet);
    for _ in 0..20 {
        fleet
            .play(&[[0.0, 0.1]; 2], &[true, false], None)
            .expect("rows are left");
    }
    let after = states(&fleet);
    assert_ne!(after[0], first[0]);
    assert_eq!(after[1], first[1]);
    fleet
        .begin(0, simulator, ([0.0, 0.0], 100), 0)
        .expect("it is on the board");
    assert_eq!(states(&fleet), first);
}

#[test]
fn progress_follows_the_path_and_not_what_is_off_it() {
    let mut fleet = fleet(1, Tracker::default(), None);
    let simulator = fleet
        .add(Rig::default(), parameters(), vec![])
        .expect("it is sound");
    fleet
        .begin(0, simulator, ([0.0, 0.0], 100), 0)
        .expect("it is on the board");
    for _ in 0..ROWS - 1 {
        fleet
            .play(&[[0.0, 0.2]], &[true], None)
            .expect("rows are left");
        let state = states(&fleet)[0];
        let expected = (1000.0 * (state.place[0] + 0.1)).round().min(199.0);
        assert!((state.passed as f64 - expected).abs() <= 1.0, "{state:?}");
    }
    assert!(states(&fleet)[0].passed > 120);
    // Off the path by more than half a corridor, nothing is gained.
    fleet
        .begin(0, simulator, ([0.0, 0.05], 100), 0)
        .expect("it is on the board");
    for _ in 0..ROWS - 1 {
        fleet
            .play(&[[0.0, 0.2]], &[true], None)
            .expect("rows are left");
    }
    assert_eq!(states(&fleet)[0].passed, 100);
}

#[test]
fn a_hole_is_named_and_the_tracker_keeps_the_last_place() {
    let maze = Maze {
        holes: vec![[-0.05, 0.05], [0.03, 0.0]],
        hole_radius_m: 0.0075,
        ..Maze::default()
    };
    let mut fleet = fleet(1, Tracker::default(), Some(&maze));
    let simulator = fleet
        .add(Rig::default(), parameters(), vec![])
        .expect("it is sound");
    fleet
        .begin(0, simulator, ([0.0, 0.0], 100), 0)
        .expect("it is on the board");
    let fell = (0..ROWS - 1).any(|_| {
        fleet
            .play(&[[0.0, 0.3]], &[true], None)
            .expect("rows are left");
        states(&fleet)[0].hole.is_some()
    });
    assert!(fell);
    let state = states(&fleet)[0];
    assert_eq!(state.hole, Some(1));
    assert!(state.seen[0].is_finite());
    assert!((state.seen[0] * EDGE / 1.05 - 0.03).abs() < 0.02);
}

#[test]
fn the_tracker_has_its_noise_and_loses_its_share() {
    let tracker = Tracker {
        noise: 0.004,
        lost: 0.25,
    };
    let mut fleet = fleet(400, tracker, None);
    let simulator = fleet
        .add(Rig::default(), parameters(), vec![])
        .expect("it is sound");
    for marble in 0..400 {
        fleet
            .begin(marble, simulator, ([0.0, 0.0], 100), marble as u64)
            .expect("it is there");
    }
    let (mut square, mut kept) = (0.0, 0);
    for _ in 0..25 {
        fleet
            .play(&[[0.0; 2]; 400], &[true; 400], None)
            .expect("rows are left");
        for state in states(&fleet) {
            square += f64::midpoint(state.seen[0].powi(2), state.seen[1].powi(2));
            kept += usize::from(state.seen == state.before);
        }
    }
    let (noise, share) = ((square / 1e4_f64).sqrt(), kept as f64 / 1e4);
    assert!((noise - 0.004).abs() < 2e-4, "{noise}");
    assert!((share - 0.25).abs() < 0.03, "{share}");
}

#[test]
fn what_cannot_be_is_refused() {
    let rig = Rig::default();
    let new = |path: Vec<[f64; 2]>, tracker: Tracker, rows: usize, row_s: f64| {
        Fleet::new(rig, None, path, tracker, 1, (rows, row_s)).map(|_| ())
    };
    let plain = Tracker::default();
    for (found, what) in [
        (new(vec![], plain, 5, 0.01), "path"),
        (new(vec![[f64::NAN, 0.0]], plain, 5, 0.01), "path"),
        (new(path(), plain, 1, 0.01), "rows"),
        (new(path(), plain, 5, 0.0), "row_s"),
        (
            new(
                path(),
                Tracker {
                    noise: -1.0,
                    lost: 0.0,
                },
                5,
                0.01,
            ),
            "noise",
        ),
        (
            new(
                path(),
                Tracker {
                    noise: 0.0,
                    lost: 1.0,
                },
                5,
                0.01,
            ),
            "lost",
        ),
    ] {
        assert!(found.expect_err(what).to_string().contains(what));
    }
    let mut fleet = fleet(1, plain, None);
    let mut other = rig;
    other.marble.radius_m = 0.006;
    assert!(fleet.add(other, parameters(), vec![]).is_err());
    let drift = effect("clock_drift").expect("it is known");
    assert!(
        fleet
            .add(rig, parameters(), vec![(drift, vec![0.1])])
            .is_err()
    );
    let simulator = fleet.add(rig, parameters(), vec![]).expect("it is sound");
    assert!(fleet.play(&[[0.0; 2]], &[true], None).is_err());
    assert!(fleet.begin(1, simulator, ([0.0; 2], 0), 0).is_err());
    assert!(fleet.begin(0, 1, ([0.0; 2], 0), 0).is_err());
    assert!(fleet.begin(0, simulator, ([0.0; 2], 200), 0).is_err());
    assert!(fleet.begin(0, simulator, ([0.14, 0.0], 0), 0).is_err());
    fleet
        .begin(0, simulator, ([0.0; 2], 0), 0)
        .expect("it is on the board");
    assert!(fleet.play(&[[0.0; 2]; 2], &[true], None).is_err());
    assert!(fleet.play(&[[f64::NAN, 0.0]], &[true], None).is_err());
    for _ in 0..ROWS - 1 {
        fleet
            .play(&[[0.0; 2]], &[true], None)
            .expect("rows are left");
    }
    assert!(fleet.play(&[[0.0; 2]], &[true], None).is_err());
}
