//! Every state that the machine reaches, with its own code on a coarse grid of set points: nothing moves unless it was armed,
//! and nothing moves again after a stop. Each planted fault is found.

mod machine;

use std::collections::BTreeSet;

use proptest::prelude::*;

use super::*;
use crate::exploration::{Broken, Explored, explore};
use machine::{FASTEST, Machine, Planted, WINDOW, inputs, is_moved};

/// Most states that a search may meet.
const MOST: usize = 100_000;

type Changes = BTreeSet<(&'static str, &'static str)>;

/// All that is reachable, and the changes of state on the way.
fn explored(
    planted: Planted,
) -> std::result::Result<(Explored, Changes, BTreeSet<String>), Broken> {
    let (mut changes, mut reasons) = (Changes::new(), BTreeSet::new());
    let found = explore(
        Machine::new(planted),
        &inputs(),
        MOST,
        Machine::key,
        |state, tick| {
            let next = state.step(tick)?;
            let (before, after) = (state.safety.state.name(), next.safety.state.name());
            if before != after {
                changes.insert((before, after));
            }
            if let State::Latched(reason) = &next.safety.state {
                reasons.insert(reason.code().to_owned());
            }
            Ok(next)
        },
    )?;
    Ok((found, changes, reasons))
}

#[test]
fn nothing_moves_after_a_stop_in_any_reachable_state() {
    let (found, changes, reasons) = match explored(Planted::Nothing) {
        Ok(found) => found,
        Err(broken) => panic!("{}\n{}", broken.rule, broken.inputs.join("\n")),
    };
    println!("{} states, {} steps", found.states, found.steps);
    assert!(found.states > 5_000, "{} states", found.states);
    // Arms at rest are stopped and latched in one tick, and arms at level are home at once.
    let known = [
        ("idle", "armed latched"),
        ("armed", "homing idle latched playing"),
        ("homing", "armed latched stopping"),
        ("playing", "armed homing latched stopping"),
        ("stopping", "latched"),
    ];
    let known = known.map(|(from, all)| all.split(' ').map(move |to| (from, to)));
    assert_eq!(changes, known.into_iter().flatten().collect());
    let known = [
        "command_expired",
        "command_refused",
        "joints_silent",
        "outside_window",
        "overrun",
        "signal",
        "tracker_silent",
        "tracking_error",
    ];
    assert_eq!(reasons.into_iter().collect::<Vec<_>>(), known);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    /// The rules hold for each step from any state, reachable or not, with any set points inside the limits.
    #[test]
    fn rules_hold_from_any_state(
        mode in 0_usize..6,
        points in prop::array::uniform2((-1.0..1.0, -1.0..1.0, -1.0..1.0)),
        tick in prop::sample::select(inputs()),
    ) {
        let mut machine = Machine::new(Planted::Nothing);

        let reason = Reason::Signal("SIGTERM");
        let state = [
            State::Idle,
            State::Armed,
            State::Homing,
            State::Playing,
            State::Stopping(reason.clone()),
            State::Latched(reason),
        ][mode].clone();
        let moving = if matches!(state, State::Latched(_)) { 0.0 } else { FASTEST };
        machine.safety.points = (state != State::Idle).then(|| {
            points.map(|(position, velocity, rate)| SetPoint {
                position: WINDOW * position,
                velocity: moving * velocity,
                rate: moving * rate,
            })
        });
        machine.armed = is_moved(&state);
        machine.safety.state = state;
        let broken = machine.step(&tick).err();
        prop_assert!(broken.is_none(), "{broken:?}");
    }
}

#[test]
fn each_planted_fault_is_found() {
    let planted = [
        (
            Planted::HomeWhileStopping,
            "nothing leads from a stop to motion",
        ),
        (Planted::ArmAfterStop, "nothing leads from a stop to motion"),
        (
            Planted::DisarmAfterStop,
            "nothing leads from a stop to motion",
        ),
        (Planted::PlayUnarmed, "only armed arms move"),
        (Planted::StopUnheardWhileHoming, "a stop is a stop at once"),
        (Planted::NanAgeIsFresh, "a stop is a stop at once"),
        (Planted::CommandNeverExpires, "a stop is a stop at once"),
        (
            Planted::RampDoesNotSlowDown,
            "a stop slows down in each tick",
        ),
        (Planted::LatchedWhileMoving, "latched arms are at rest"),
        (
            Planted::LatchedArmsDrift,
            "latched arms stay where they are",
        ),
        (Planted::LaterReasonWins, "a stop keeps its reason"),
    ];
    for (fault, rule) in planted {
        let broken = explored(fault)
            .map(|(found, ..)| found)
            .expect_err("the fault is found");
        assert!(broken.rule.starts_with(rule), "{fault:?}: {}", broken.rule);
        println!("{fault:?}: after {} ticks", broken.inputs.len());
    }
}
