use proptest::prelude::*;

use super::*;

fn config() -> Config {
    toml::from_str(crate::config::EXAMPLE).expect("the example is right")
}

fn healthy(now: f64, measured: [f64; 2]) -> Inputs {
    Inputs {
        now,
        target: Some([0.1, -0.1]),
        measured: Some(measured),
        ..Inputs::default()
    }
}

/// What may happen in a tick.
#[derive(Debug, Clone)]
enum Happens {
    Nothing,
    Event(Event),
}

fn happens() -> impl Strategy<Value = Happens> {
    let angle = prop_oneof![6 => -0.3..0.3, 1 => 6.0..6.6, 1 => Just(f64::NAN)];
    prop_oneof![
        12 => Just(Happens::Nothing),
        2 => (angle.clone(), angle).prop_map(|(x, y)| Happens::Event(Event::Arm([x, y]))),
        2 => Just(Happens::Event(Event::Home)),
        2 => Just(Happens::Event(Event::Play)),
        1 => Just(Happens::Event(Event::Disarm)),
        1 => Just(Happens::Event(Event::Stop(Reason::Signal("SIGINT")))),
    ]
}

fn ages(longest: f64) -> impl Strategy<Value = f64> {
    prop_oneof![60 => 0.0..0.05, 1 => 0.0..longest, 1 => Just(f64::INFINITY), 1 => Just(f64::NAN)]
}

fn ticks() -> impl Strategy<Value = Vec<(Happens, Inputs)>> {
    let angle = || prop_oneof![30 => -0.6..0.6, 1 => -1e9..1e9, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY)];
    let pair = move || (angle(), angle()).prop_map(|(x, y)| [x, y]);
    let target = prop::option::weighted(0.9, pair());
    let off = (-0.04..0.04, -0.04..0.04);
    let inputs = (
        target,
        off,
        prop::option::weighted(0.02, pair()),
        ages(0.4),
        ages(1.0),
        ages(0.2),
    );
    let one =
        (happens(), inputs).prop_map(|(happens, (target, off, wild, joints, tracker, late))| {
            let inputs = Inputs {
                now: 0.0,
                target,
                // Measured angles: near the set point (at this distance), or arbitrary.
                measured: Some(wild.unwrap_or([off.0, off.1])),
                joints_age_s: joints,
                tracker_age_s: tracker,
                late_s: late,
            };
            (happens, inputs)
        });
    prop::collection::vec(one, 1..400)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// For any events: outputs stay within every limit, are numbers, come only from an armed rig; a stop
    /// brings both arms to rest in time, and nothing moves after it.
    #[test]
    fn no_sequence_of_events_leaves_the_limits_or_moves_after_a_stop(ticks in ticks()) {
        let config = config();
        let mut safety = Safety::new(&config, false);
        let mut last: Option<[SetPoint; 2]> = None;
        let mut stopped_at: Option<usize> = None;
        for (i, (happens, mut inputs)) in ticks.into_iter().enumerate() {
            inputs.now = i as f64 * TICK_S;
            if let (Some(points), Some(measured)) = (last, &mut inputs.measured)
                && measured[0].abs() < 0.05
            {
                *measured = [points[0].position + measured[0], points[1].position + measured[1]];
            }
            if let Happens::Event(event) = happens {
                let _ = safety.handle(event);
            }
            let output = safety.tick(&inputs);
            if matches!(safety.state(), State::Stopping(_) | State::Latched(_)) {
                stopped_at.get_or_insert(i);
            }
            match safety.state() {
                State::Idle => prop_assert!(output.set_points.is_none()),
                State::Armed | State::Homing | State::Playing => prop_assert!(output.set_points.is_some()),
                State::Stopping(_) | State::Latched(_) => (),
            }
            let Some(points) = output.set_points else { last = None; continue };
            for axis in 0..2 {
                let (bounds, point) = (safety.bounds(axis), points[axis]);
                prop_assert!(point.position.is_finite() && point.rate.is_finite());
                let before = last.map_or(SetPoint::at(point.position), |all| all[axis]);
                prop_assert!(point.position >= bounds.low && point.position <= bounds.high);
                prop_assert!(point.velocity.abs() <= bounds.velocity && point.rate.abs() <= bounds.velocity);
                let most = bounds.acceleration * TICK_S + 1e-9;
                prop_assert!((point.velocity - before.velocity).abs() <= most);
                prop_assert!((point.rate - before.rate).abs() <= most);
                prop_assert!((point.position - before.position).abs() <= bounds.step + 1e-9);
            }
            if let Some(at) = stopped_at {
                prop_assert!(output.stopped);
                if (i - at) as f64 * TICK_S >= 0.13 {
                    prop_assert!(points.iter().all(|point| point.is_at_rest()));
                    prop_assert!(matches!(safety.state(), State::Latched(_)));
                    prop_assert_eq!(Some(points.map(|one| one.position)), last.map(|all| all.map(|one| one.position)));
                }
            }
            last = Some(points);
        }
    }
}

/// Plays until the arms move, and returns the rig and the moment.
fn moving() -> (Safety, f64) {
    let mut safety = Safety::new(&config(), false);
    safety
        .handle(Event::Arm([0.0; 2]))
        .expect("the arms are level");
    safety.handle(Event::Play).expect("nothing is refused");
    let mut measured = [0.0; 2];
    for i in 0..12 {
        let output = safety.tick(&healthy(f64::from(i) * TICK_S, measured));
        measured = output
            .set_points
            .expect("it is armed")
            .map(|point| point.position);
    }
    assert!(measured[0] > 0.01, "{measured:?}");
    (safety, 12.0 * TICK_S)
}

#[test]
fn each_fault_stops_for_its_own_reason() {
    type Change = fn(&mut Inputs);
    let faults: [(&str, Change); 8] = [
        ("tracker_silent", |inputs| inputs.tracker_age_s = 0.31),
        ("tracker_silent", |inputs| inputs.tracker_age_s = f64::NAN),
        ("joints_silent", |inputs| inputs.joints_age_s = 0.11),
        ("joints_silent", |inputs| inputs.measured = None),
        ("outside_window", |inputs| {
            inputs.measured = Some([f64::NAN, 0.0]);
        }),
        ("outside_window", |inputs| {
            inputs.measured = Some([0.0, 0.56]);
        }),
        ("overrun", |inputs| inputs.late_s = 0.06),
        ("command_refused", |inputs| {
            inputs.target = Some([0.0, f64::NAN]);
        }),
    ];
    for (code, change) in faults {
        let (mut safety, now) = moving();
        let mut inputs = healthy(
            now,
            safety.points.expect("armed").map(|point| point.position),
        );
        change(&mut inputs);
        safety.tick(&inputs);
        let State::Stopping(reason) = safety.state() else {
            panic!("{code}: {:?}", safety.state());
        };
        assert_eq!(reason.code(), code);
    }
}

#[test]
fn what_lasts_stops_only_when_it_has_lasted() {
    type Change = fn(&mut Inputs);
    let faults: [(&str, Change); 2] = [
        ("tracking_error", |inputs| {
            inputs.measured = inputs.measured.map(|[x, y]| [x - 0.06, y]);
        }),
        ("command_expired", |inputs| inputs.target = None),
    ];
    for (code, change) in faults {
        let (mut safety, begin) = moving();
        for i in 0..=11 {
            assert_eq!(*safety.state(), State::Playing, "{code} after {i} ticks");
            let now = begin + f64::from(i) * TICK_S;
            let mut inputs = healthy(
                now,
                safety.points.expect("armed").map(|point| point.position),
            );
            change(&mut inputs);
            safety.tick(&inputs);
            if *safety.state() != State::Playing {
                assert!(i >= 10, "{code} after {i} ticks");
                break;
            }
        }
        // Without a command the set point has come to rest before it is stopped.
        let (State::Stopping(reason) | State::Latched(reason)) = safety.state() else {
            panic!("{code}: {:?}", safety.state());
        };
        assert_eq!(reason.code(), code);
    }
}

#[test]
fn a_wrist_that_has_turned_round_is_taken_in_its_own_turn() {
    let mut safety = Safety::new(&config(), false);
    let turn = std::f64::consts::TAU;
    safety
        .handle(Event::Arm([3.0 * turn + 0.01, -turn]))
        .expect("it is level but for turns");
    assert_eq!(safety.level(), [3.0 * turn, -turn]);
}

#[test]
fn arms_away_from_their_window_are_not_taken() {
    let mut safety = Safety::new(&config(), false);
    assert!(safety.handle(Event::Arm([0.0, 0.51])).is_err());
    assert_eq!(*safety.state(), State::Idle);
    assert!(safety.tick(&healthy(0.0, [0.0; 2])).set_points.is_none());
}

#[test]
fn home_is_reached_slowly_and_then_held() {
    let mut safety = Safety::new(&config(), false);
    safety
        .handle(Event::Arm([0.2, -0.1]))
        .expect("inside the window");
    safety.handle(Event::Home).expect("nothing is refused");
    let mut measured = [0.2, -0.1];
    for i in 0..260 {
        let output = safety.tick(&healthy(f64::from(i) * TICK_S, measured));
        let points = output.set_points.expect("it is armed");
        assert!(
            points
                .iter()
                .all(|point| point.velocity.abs() <= 0.1 + 1e-12)
        );
        measured = points.map(|point| point.position);
    }
    assert_eq!(*safety.state(), State::Armed);
    assert!(safety.is_home());
}
