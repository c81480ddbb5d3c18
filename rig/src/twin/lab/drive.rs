//! The motors of other labs: from a lab's commands to what tilts the board.

use crate::config::Twin;
use crate::labs::Lab;
use crate::model::Model;

/// The board's stops: how far the hinges let it tilt (rad).
const STOP_RAD: f64 = 8.0 * std::f64::consts::PI / 180.0;

/// Rate of a knob while a `CyberRunner` levels its board (rad/s): 80 units of 0.229 turns a minute.
const RESET_RAD_S: f64 = 80.0 * 0.229 * std::f64::consts::TAU / 60.0;

/// A TAG driver's numbers: targets, their limits, and its steps, in units of the servo's position.
const HOME: f64 = 500.0;
const SCALE: f64 = 1.5;
const TARGETS: [f64; 2] = [100.0, 900.0];
const STEP: f64 = 20.0;
const DEAD_BAND: f64 = 1.0;
/// Period of its steps, and the silence after which it goes home (s).
const PERIOD_S: f64 = 1.0 / 30.0;
const SILENCE_S: f64 = 1.0;

/// Angle of a servo over its position (rad): 240 degrees are 1000 units.
const SERVO_RAD: f64 = 0.24 * std::f64::consts::PI / 180.0;

/// Both motors, by the axis about which they tilt the board.
pub enum Drive {
    /// Currents; see [`Currents`].
    Currents(Currents),
    /// Servos; see [`Servos`].
    Servos(Servos),
}

/// Motors in current mode.
///
/// A model in angles of knobs is given knobs that turn at a rate proportional to the current beyond what friction holds:
/// without a current they stay where they are, and the lab has a reset that levels the board. A model that was fitted to currents
/// has the way from current to tilt in its gears and effects, and is given the currents themselves.
pub struct Currents {
    commands: [f64; 2],
    /// Knob angles (rad), for a model that takes them.
    knobs: Option<Knobs>,
    resets: bool,
}

struct Knobs {
    angles: [f64; 2],
    /// Angles at the board's stops (rad).
    most: [f64; 2],
    /// Rates over currents (rad/s), signed: a negative current of either motor turns alpha or beta up.
    rates: [f64; 2],
    /// Largest currents that friction holds.
    dead: [f64; 2],
}

/// Servos behind a driver that turns them step by step.
pub struct Servos {
    targets: [f64; 2],
    positions: [f64; 2],
    /// When the last command came (s), if any counts.
    heard: Option<f64>,
    next: f64,
    /// What a unit of position is to the model, with its sign.
    over: [f64; 2],
}

impl Drive {
    /// At rest on a level board.
    pub fn new(lab: Lab, twin: &Twin, model: &Model) -> Self {
        match lab {
            Lab::Cyberrunner => Self::Currents(Currents {
                commands: [0.0; 2],
                knobs: model.takes_angles().then(|| Knobs {
                    angles: [0.0; 2],
                    most: model.gears().map(|gear| STOP_RAD / gear.abs().max(1e-6)),
                    // beta is the tilt about x, alpha minus that about y.
                    rates: [-twin.current_rad_s[0], twin.current_rad_s[1]],
                    dead: twin.current_dead,
                }),
                resets: false,
            }),
            Lab::TagTcp => Self::Servos(Servos {
                targets: [HOME; 2],
                positions: [HOME; 2],
                heard: None,
                next: 0.0,
                over: if model.takes_angles() {
                    // A larger target of either servo turns beta or alpha up.
                    [SERVO_RAD, -SERVO_RAD]
                } else {
                    [1.0 / SCALE; 2]
                },
            }),
        }
    }

    /// Takes the lab's commands of the motors about x and y.
    pub fn command(&mut self, commands: [f64; 2], now: f64) {
        let commands = commands.map(|one| if one.is_finite() { one } else { 0.0 });
        match self {
            // The driver cuts off what is no whole unit, and what 16 bits do not hold.
            Self::Currents(motors) => motors.commands = commands.map(|one| f64::from(one as i16)),
            Self::Servos(servos) => {
                servos.targets =
                    commands.map(|one| (HOME + SCALE * one).round().clamp(TARGETS[0], TARGETS[1]));
                servos.heard = Some(now);
            }
        }
    }

    /// Begins to level the board.
    pub fn reset(&mut self) {
        match self {
            Self::Currents(motors) => {
                motors.commands = [0.0; 2];
                motors.resets = true;
            }
            Self::Servos(servos) => {
                servos.targets = [HOME; 2];
                servos.heard = None;
            }
        }
    }

    /// Whether the board is level, as far as the motors know.
    pub fn is_home(&self) -> bool {
        match self {
            Self::Currents(motors) => !motors.resets,
            Self::Servos(servos) => servos.positions == [HOME; 2],
        }
    }

    /// Turns for a tick (s); returns what the model takes, about x and y.
    pub fn step(&mut self, now: f64, tick: f64) -> [f64; 2] {
        match self {
            Self::Currents(motors) => motors.step(tick),
            Self::Servos(servos) => servos.step(now),
        }
    }
}

impl Currents {
    fn step(&mut self, tick: f64) -> [f64; 2] {
        let Some(knobs) = &mut self.knobs else {
            self.resets = false;
            return self.commands;
        };
        for axis in 0..2 {
            let angle = &mut knobs.angles[axis];
            let turn = if self.resets {
                let most = RESET_RAD_S * tick;
                (-*angle).clamp(-most, most)
            } else {
                let current = self.commands[axis];
                let held = current.clamp(-knobs.dead[axis], knobs.dead[axis]);
                knobs.rates[axis] * (current - held) * tick
            };
            *angle = (*angle + turn).clamp(-knobs.most[axis], knobs.most[axis]);
        }
        self.resets &= knobs.angles != [0.0; 2];
        knobs.angles
    }
}

impl Servos {
    fn step(&mut self, now: f64) -> [f64; 2] {
        if self.heard.is_some_and(|heard| now - heard > SILENCE_S) {
            self.targets = [HOME; 2];
        }
        while now >= self.next {
            self.next += PERIOD_S;
            let next = [0, 1].map(|axis| {
                let way = self.targets[axis] - self.positions[axis];
                self.positions[axis] + way.clamp(-STEP, STEP)
            });
            // The driver sends both or none; on the way home it arrives.
            let moves = |axis: usize| (next[axis] - self.positions[axis]).abs() > DEAD_BAND;
            if moves(0) || moves(1) || self.targets == [HOME; 2] {
                self.positions = next;
            }
        }
        [0, 1].map(|axis| self.over[axis] * (self.positions[axis] - HOME))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::model::tests::with;

    const TICK: f64 = 1.0 / 120.0;

    fn drive(lab: Lab, unit: &str) -> Drive {
        let model = with(&format!("[commands]\nunit = \"{unit}\"\n"));
        Drive::new(lab, &Twin::default(), &model)
    }

    fn turn(drive: &mut Drive, ticks: usize, from: f64) -> [f64; 2] {
        (0..ticks).fold([0.0; 2], |_, tick| {
            drive.step(from + tick as f64 * TICK, TICK)
        })
    }

    #[test]
    fn currents_turn_knobs_until_a_reset_levels_them() {
        let mut drive = drive(Lab::Cyberrunner, "rad");
        // A learner's action of 1 is -200: beta and with it the tilt about x go up.
        drive.command([-200.0, 0.0], 0.0);
        let [x, y] = turn(&mut drive, 48, 0.0);
        assert!((x - 200.0 * 0.02 * 0.4).abs() < 1e-9 && y == 0.0, "{x} {y}");
        drive.command([0.9, -0.9], 0.5);
        assert_eq!(
            turn(&mut drive, 60, 0.5),
            [x, 0.0],
            "less than a unit is none"
        );
        drive.command([f64::NAN, f64::INFINITY], 1.0);
        assert_eq!(turn(&mut drive, 60, 1.0), [x, 0.0]);
        drive.reset();
        assert!(!drive.is_home());
        assert_eq!(turn(&mut drive, 130, 2.0), [0.0; 2]);
        assert!(drive.is_home());
        // The board's stops: 8 degrees, with gears of 0.07 and 0.06.
        drive.command([-200.0, 200.0], 4.0);
        let [x, y] = turn(&mut drive, 1200, 4.0);
        assert!((0.07 * x - STOP_RAD).abs() < 1e-9 && (0.06 * y - STOP_RAD).abs() < 1e-9);
    }

    #[test]
    fn friction_holds_a_knob_by_axis() {
        let model = with("[commands]\nunit = \"rad\"\n");
        let twin: Twin =
            toml::from_str("current_rad_s = [0.01, -0.02]\ncurrent_dead = [30, 50.0]").unwrap();
        let mut drive = Drive::new(Lab::Cyberrunner, &twin, &model);
        drive.command([-30.0, 50.0], 0.0);
        assert_eq!(turn(&mut drive, 60, 0.0), [0.0; 2]);
        drive.command([-50.0, -100.0], 0.5);
        let [x, y] = turn(&mut drive, 48, 0.5);
        assert!((x - 20.0 * 0.01 * 0.4).abs() < 1e-9, "{x}");
        assert!((y - 50.0 * 0.02 * 0.4).abs() < 1e-9, "{y}");
    }

    #[test]
    fn a_model_of_currents_is_given_currents() {
        let mut drive = drive(Lab::Cyberrunner, "motor current, about mA");
        drive.command([-120.7, 30.2], 0.0);
        assert_eq!(turn(&mut drive, 3, 0.0), [-120.0, 30.0]);
        drive.reset();
        assert_eq!(turn(&mut drive, 1, 0.1), [0.0; 2]);
        assert!(drive.is_home());
    }

    #[test]
    fn servos_go_step_by_step_and_home_after_silence() {
        let mut drive = drive(Lab::TagTcp, "servo command");
        drive.command([100.0, -1000.0], 0.0);
        // Ten steps of 20 units in a third of a second.
        let [x, y] = turn(&mut drive, 40, 0.0);
        assert!((x - 150.0 / 1.5).abs() < 1e-9, "{x}");
        assert!((y + 200.0 / 1.5).abs() < 1e-9, "{y}");
        let [_, y] = turn(&mut drive, 60, 1.0 / 3.0);
        assert!((y + 400.0 / 1.5).abs() < 1e-9, "at its end: {y}");
        assert_eq!(turn(&mut drive, 240, 1.0), [0.0; 2]);
        assert!(drive.is_home());
    }

    #[test]
    fn servos_do_not_move_for_a_unit() {
        let mut drive = drive(Lab::TagTcp, "servo command");
        drive.command([0.5, 0.5], 0.0);
        assert_eq!(turn(&mut drive, 60, 0.0), [0.0; 2]);
    }

    proptest! {
        #[test]
        fn no_command_leaves_the_stops(
            commands in prop::collection::vec(prop::array::uniform2(-1e5..1e5), 1..40),
            is_tag in any::<bool>(),
        ) {
            let lab = if is_tag { Lab::TagTcp } else { Lab::Cyberrunner };
            let mut drive = drive(lab, "rad");
            let most = if is_tag { [400.0 * SERVO_RAD; 2] } else { [STOP_RAD / 0.07, STOP_RAD / 0.06] };
            let mut last = [0.0; 2];
            for (i, &both) in commands.iter().enumerate() {
                let now = i as f64 * 0.1;
                drive.command(both, now);
                for tick in 0..12 {
                    let found = drive.step(now + f64::from(tick) * TICK, TICK);
                    for axis in 0..2 {
                        prop_assert!(found[axis].abs() <= most[axis] + 1e-9);
                        let turned: f64 = found[axis] - last[axis];
                        let steps = if is_tag { STEP * SERVO_RAD } else { 32768.0 * 0.02 * TICK };
                        prop_assert!(turned.abs() <= steps + 1e-9);
                    }
                    last = found;
                }
            }
        }
    }
}
