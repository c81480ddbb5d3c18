//! The safety rules of commands that are no angles, without a clock, input or output of their own.
//!
//! A stop is a command of zero at once: no current on a `CyberRunner`, the home target on a TAG rig. It is latched.

use super::config::LabLimits;
use crate::config::{TICK_S, Timeouts};
use crate::safety::Reason;

/// State of the motors.
#[derive(Debug, Clone, PartialEq)]
pub enum Phase {
    /// Zero is commanded.
    Idle,
    /// A file of commands is played.
    Playing,
    /// Zero is commanded until a new start by hand.
    Latched(Reason),
}

/// Inputs of a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inputs {
    /// Time of the monotonic clock (s).
    pub now: f64,
    /// Commands of motors 1 and 2 to play, in the lab's unit.
    pub target: Option<[f64; 2]>,
    /// The board's last measured tilts (rad).
    pub tilts: Option<[f64; 2]>,
    /// Age of the last state (s).
    pub state_age_s: f64,
    /// Age of the last state with a marble (s).
    pub marble_age_s: f64,
    /// Lateness of this tick (s).
    pub late_s: f64,
}

/// The rules.
#[derive(Debug, Clone)]
pub struct Guard {
    limits: LabLimits,
    times: Timeouts,
    phase: Phase,
    last: [f64; 2],
    no_target: Option<f64>,
}

impl Guard {
    /// At rest.
    pub fn new(limits: LabLimits, times: Timeouts) -> Self {
        Self {
            limits,
            times,
            phase: Phase::Idle,
            last: [0.0; 2],
            no_target: None,
        }
    }

    /// State of the motors.
    pub fn phase(&self) -> &Phase {
        &self.phase
    }

    /// Begins to play; not after a stop.
    pub fn play(&mut self) {
        if self.phase == Phase::Idle {
            self.phase = Phase::Playing;
            self.no_target = None;
        }
    }

    /// Ends a file that was played.
    pub fn end(&mut self) {
        if self.phase == Phase::Playing {
            self.phase = Phase::Idle;
        }
    }

    /// Stops, and stays stopped; only the first reason counts.
    pub fn stop(&mut self, reason: Reason) {
        if !matches!(self.phase, Phase::Latched(_)) {
            self.phase = Phase::Latched(reason);
        }
    }

    /// One tick of 10 ms: checks the inputs and returns the commands of motors 1 and 2.
    pub fn tick(&mut self, inputs: &Inputs) -> [f64; 2] {
        if let Some(reason) = self.fault(inputs) {
            self.stop(reason);
        }
        let target = match self.phase {
            Phase::Playing => inputs.target.unwrap_or(self.last),
            Phase::Idle | Phase::Latched(_) => [0.0; 2],
        };
        let LabLimits {
            command,
            change_per_s,
            ..
        } = self.limits;
        let step = change_per_s * TICK_S;
        for (last, target) in self.last.iter_mut().zip(target) {
            let wanted = target.clamp(-command, command);
            *last = match self.phase {
                // A stop does not wait.
                Phase::Latched(_) => 0.0,
                _ => (*last + (wanted - *last).clamp(-step, step)).clamp(-command, command),
            };
        }
        self.last
    }

    /// The fault of a tick in which a file is played.
    fn fault(&mut self, inputs: &Inputs) -> Option<Reason> {
        if self.phase != Phase::Playing {
            return None;
        }
        let times = self.times;
        if inputs.late_s > times.overrun_s {
            return Some(Reason::Overrun(inputs.late_s));
        }
        if !(inputs.state_age_s <= times.joints_s) {
            return Some(Reason::StateSilent(inputs.state_age_s));
        }
        let tilts = inputs.tilts.unwrap_or([f64::NAN; 2]);
        let steepest = tilts[0].abs().max(tilts[1].abs());
        if !(tilts.iter().all(|tilt| tilt.abs() <= self.limits.tilt_rad)) {
            return Some(Reason::BoardTilted(steepest));
        }
        if !(inputs.marble_age_s <= times.tracker_s) {
            return Some(Reason::TrackerSilent(inputs.marble_age_s));
        }
        match inputs.target {
            Some(target) if target.iter().all(|command| command.is_finite()) => {
                self.no_target = None;
                None
            }
            Some(_) => Some(Reason::CommandRefused),
            None => {
                let lasts = inputs.now - *self.no_target.get_or_insert(inputs.now);
                (lasts > times.command_s).then_some(Reason::CommandExpired(lasts))
            }
        }
    }
}

#[cfg(test)]
mod exhaustive;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: LabLimits = LabLimits {
        command: 200.0,
        change_per_s: 12_000.0,
        tilt_rad: 0.2,
    };

    fn good(tick: usize) -> Inputs {
        Inputs {
            now: tick as f64 * TICK_S,
            target: Some([150.0, -90.0]),
            tilts: Some([0.01, -0.02]),
            state_age_s: 0.02,
            marble_age_s: 0.02,
            late_s: 0.0,
        }
    }

    fn playing() -> Guard {
        let mut guard = Guard::new(LIMITS, Timeouts::default());
        guard.play();
        for tick in 0..10 {
            guard.tick(&good(tick));
        }
        assert_eq!(guard.last, [150.0, -90.0]);
        guard
    }

    #[test]
    fn each_fault_ends_in_its_stop_and_zero_at_once() {
        type Change = fn(&mut Inputs);
        let faults: [(&str, Change); 7] = [
            ("overrun", |inputs| inputs.late_s = 0.2),
            ("state_silent", |inputs| inputs.state_age_s = 0.3),
            ("state_silent", |inputs| inputs.state_age_s = f64::NAN),
            ("board_tilted", |inputs| inputs.tilts = Some([0.0, -0.25])),
            ("board_tilted", |inputs| inputs.tilts = None),
            ("tracker_silent", |inputs| inputs.marble_age_s = 0.5),
            ("command_refused", |inputs| {
                inputs.target = Some([f64::NAN, 0.0]);
            }),
        ];
        for (code, change) in faults {
            let mut guard = playing();
            let mut inputs = good(10);
            change(&mut inputs);
            assert_eq!(guard.tick(&inputs), [0.0; 2], "{code}");
            let Phase::Latched(reason) = guard.phase() else {
                panic!("{code}: it goes on")
            };
            assert_eq!(reason.code(), code);
            // Nothing leads back to motion.
            guard.play();
            guard.end();
            assert_eq!(guard.tick(&good(11)), [0.0; 2]);
        }
    }

    #[test]
    fn commands_expire() {
        let mut guard = playing();
        let silent = |tick| Inputs {
            target: None,
            ..good(tick)
        };
        assert_eq!(guard.tick(&silent(10)), [150.0, -90.0]);
        for tick in 11..=21 {
            guard.tick(&silent(tick));
        }
        assert!(matches!(
            guard.phase(),
            Phase::Latched(Reason::CommandExpired(_))
        ));
    }

    proptest! {
        /// No input takes a command out of its limits, and after a stop it is zero for ever.
        #[test]
        fn commands_stay_within_their_limits(
            targets in prop::collection::vec(
                prop_oneof![
                    8 => (-900.0..900.0, -900.0..900.0).prop_map(|(a, b)| Some([a, b])),
                    1 => Just(Some([f64::NAN, f64::INFINITY])),
                    1 => Just(None),
                ],
                1..200,
            ),
            ages in prop::collection::vec(prop_oneof![30 => 0.0..0.1, 1 => Just(9.0)], 1..200),
            stop_at in 0_usize..300,
        ) {
            let mut guard = Guard::new(LIMITS, Timeouts::default());
            guard.play();
            let mut last = [0.0; 2];
            for (tick, &target) in targets.iter().enumerate() {
                if tick == stop_at {
                    guard.stop(Reason::Signal("SIGTERM"));
                }
                let was_latched = matches!(guard.phase(), Phase::Latched(_));
                let inputs = Inputs { target, state_age_s: ages[tick % ages.len()], ..good(tick) };
                let commands = guard.tick(&inputs);
                let latched = matches!(guard.phase(), Phase::Latched(_));
                prop_assert!(!was_latched || latched);
                for (command, last) in commands.iter().zip(last) {
                    prop_assert!(command.abs() <= LIMITS.command);
                    let most = LIMITS.change_per_s * TICK_S + 1e-9;
                    let is_smooth = (command - last).abs() <= most;
                    prop_assert!(*command == 0.0 || !latched);
                    prop_assert!(latched || is_smooth);
                }
                last = commands;
            }
        }
    }
}
