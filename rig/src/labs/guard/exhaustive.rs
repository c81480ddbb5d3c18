//! Every state that the rules reach, with their own code on a coarse grid of commands. Each planted fault is found.

use super::*;
use crate::exploration::{Broken, Explored, explore};

const LIMITS: LabLimits = LabLimits {
    command: 3.0,
    change_per_s: 1.0 / TICK_S,
    tilt_rad: 0.2,
};

/// Most states that a search may meet.
const MOST: usize = 10_000;

/// A mistake in the rules, which the search has to find.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Planted {
    Nothing,
    PlayAfterStop,
    EndAfterStop,
    StopUnheard,
    StopSlowsDown,
    CommandNeverExpires,
    NanTiltIsLevel,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Event {
    Nothing,
    Play,
    End,
    Stop,
}

/// The rules, their planted fault, and the ticks in a row in which a file was played without commands.
#[derive(Debug, Clone)]
struct Rules {
    guard: Guard,
    planted: Planted,
    silent: usize,
}

fn inputs() -> Vec<(Event, Inputs)> {
    let good = Inputs {
        now: 0.0,
        target: Some([9.0, -9.0]),
        tilts: Some([0.01, -0.02]),
        state_age_s: 0.02,
        marble_age_s: 0.02,
        late_s: 0.0,
    };
    let target = |target| Inputs { target, ..good };
    let tilts = |tilts| Inputs { tilts, ..good };
    let age = |state_age_s| Inputs {
        state_age_s,
        ..good
    };
    let marble = |marble_age_s| Inputs {
        marble_age_s,
        ..good
    };
    let ticks = [
        good,
        target(Some([-9.0, 1.0])),
        target(Some([1.0, 9.0])),
        target(Some([0.0, 0.0])),
        target(Some([f64::NAN, 1.0])),
        target(None),
        tilts(Some([f64::NAN, 0.0])),
        tilts(Some([0.0, 0.3])),
        tilts(None),
        age(9.0),
        age(f64::NAN),
        marble(9.0),
        marble(f64::NAN),
        Inputs {
            late_s: 0.2,
            ..good
        },
    ];
    let events = [Event::Nothing, Event::Play, Event::End, Event::Stop];
    let with = |event| ticks.map(|tick| (event, tick));
    events.into_iter().flat_map(with).collect()
}

/// Whether it must stop a file that is played.
fn is_fault(inputs: &Inputs) -> bool {
    let times = Timeouts::default();
    let is_bad = |both: [f64; 2]| !both.iter().all(|value| value.is_finite());
    !inputs
        .tilts
        .is_some_and(|both| both.iter().all(|tilt| tilt.abs() <= LIMITS.tilt_rad))
        || !(inputs.state_age_s <= times.joints_s)
        || !(inputs.marble_age_s <= times.tracker_s)
        || inputs.late_s > times.overrun_s
        || inputs.target.is_some_and(is_bad)
}

impl Rules {
    fn new(planted: Planted) -> Self {
        let times = Timeouts {
            command_s: 2.5 * TICK_S,
            ..Timeouts::default()
        };
        Self {
            guard: Guard::new(LIMITS, times),
            planted,
            silent: 0,
        }
    }

    fn key(&self) -> impl Eq + std::hash::Hash + use<> {
        let Guard {
            phase,
            last,
            no_target,
            ..
        } = &self.guard;
        let phase = match phase {
            Phase::Idle => "idle",
            Phase::Playing => "playing",
            Phase::Latched(reason) => reason.code(),
        };
        let playing = self.guard.phase == Phase::Playing;
        let ticks = no_target.map(|since| (since / TICK_S).round() as i64);
        (
            phase,
            last.map(|command| command as i64),
            ticks.filter(|_| playing),
            self.silent,
        )
    }

    fn act(&mut self, event: Event, inputs: &Inputs) -> [f64; 2] {
        let was_latched = matches!(self.guard.phase, Phase::Latched(_));
        let before = self.guard.last;
        match (self.planted, event) {
            (Planted::PlayAfterStop, Event::Play) => self.guard.phase = Phase::Playing,
            (Planted::EndAfterStop, Event::End) => self.guard.phase = Phase::Idle,
            (Planted::StopUnheard, Event::Stop) if self.guard.phase == Phase::Playing => (),
            (_, Event::Nothing) => (),
            (_, Event::Play) => self.guard.play(),
            (_, Event::End) => self.guard.end(),
            (_, Event::Stop) => self.guard.stop(Reason::Signal("SIGTERM")),
        }
        let mut inputs = *inputs;
        match (self.planted, &mut inputs.tilts) {
            (Planted::NanTiltIsLevel, Some(tilts)) => *tilts = tilts.map(|tilt| tilt.max(0.0)),
            (Planted::CommandNeverExpires, _) => self.guard.no_target = None,
            _ => (),
        }
        let commands = self.guard.tick(&inputs);
        let latched = matches!(self.guard.phase, Phase::Latched(_));
        if self.planted == Planted::StopSlowsDown && latched && !was_latched {
            self.guard.last = before.map(|command| 0.5 * command);
            return self.guard.last;
        }
        commands
    }

    /// The next state; time 0 stays the time of the next tick.
    fn step(&self, (event, inputs): &(Event, Inputs)) -> Result<Self, String> {
        let mut next = self.clone();
        let latched = |rules: &Self| matches!(rules.guard.phase, Phase::Latched(_));
        let played = match event {
            Event::Nothing => self.guard.phase == Phase::Playing,
            Event::Play => !latched(self),
            Event::End | Event::Stop => false,
        };
        let commands = next.act(*event, inputs);
        next.guard.no_target = next.guard.no_target.map(|since| since - TICK_S);
        let went_on = self.guard.phase == Phase::Playing;
        let before = if went_on { self.silent } else { 0 };
        next.silent = if played && inputs.target.is_none() {
            before + 1
        } else {
            0
        };
        let must_stop = *event == Event::Stop || played && (is_fault(inputs) || next.silent > 3);
        if latched(&next) {
            next.silent = 0;
        }
        let within = |command: &f64| command.abs() <= LIMITS.command;
        let changed = commands.iter().zip(self.guard.last);
        let smooth = changed
            .clone()
            .all(|(new, old)| (new - old).abs() <= 1.0 + 1e-9);
        let falls = changed.clone().all(|(new, old)| new.abs() <= old.abs());
        let rules = [
            (
                "nothing leads from a stop",
                !latched(self) || self.guard.phase == next.guard.phase,
            ),
            ("a stop is a stop at once", !must_stop || latched(&next)),
            ("a stop is zero", !latched(&next) || commands == [0.0; 2]),
            (
                "commands stay within their limits",
                commands.iter().all(within),
            ),
            ("commands change slowly", latched(&next) || smooth),
            (
                "only a file moves the motors",
                next.guard.phase == Phase::Playing || falls,
            ),
        ];
        match rules.iter().find(|(_, holds)| !holds) {
            Some((rule, _)) => Err((*rule).to_owned()),
            None => Ok(next),
        }
    }
}

fn explored(planted: Planted) -> Result<Explored, Broken> {
    explore(
        Rules::new(planted),
        &inputs(),
        MOST,
        Rules::key,
        Rules::step,
    )
}

#[test]
fn nothing_is_commanded_after_a_stop_in_any_reachable_state() {
    match explored(Planted::Nothing) {
        Ok(found) => {
            println!("{} states, {} steps", found.states, found.steps);
            assert!(found.states > 50, "{} states", found.states);
        }
        Err(broken) => panic!("{}\n{}", broken.rule, broken.inputs.join("\n")),
    }
}

#[test]
fn each_planted_fault_is_found() {
    for (fault, rule) in [
        (Planted::PlayAfterStop, "nothing leads from a stop"),
        (Planted::EndAfterStop, "nothing leads from a stop"),
        (Planted::StopUnheard, "a stop is a stop at once"),
        (Planted::StopSlowsDown, "a stop is zero"),
        (Planted::CommandNeverExpires, "a stop is a stop at once"),
        (Planted::NanTiltIsLevel, "a stop is a stop at once"),
    ] {
        let broken = explored(fault).expect_err("the fault is found");
        assert_eq!(broken.rule, rule, "{fault:?}: {:?}", broken.inputs);
    }
}
