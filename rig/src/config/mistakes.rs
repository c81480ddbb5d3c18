//! Validation of `rig.toml`: each mistake is one line with key, value and possible values.

use super::{Config, Kind, Limits, Network, RAMP_S, Safety, TICK_S, Timeouts, Twin};

impl Config {
    /// The mistakes, one line each: key, value, possible values.
    pub fn mistakes(&self) -> Vec<String> {
        let mut found = Mistakes::default();
        found.numbers(self);
        found.network(&self.network);
        found.timeouts(&self.timeouts);
        found.safety(&self.safety);
        found.twin(&self.twin);
        found.names(self);
        let limits = &self.limits;
        let ramp = limits.velocity_rad_s / limits.acceleration_rad_s2;
        found.unless(
            ramp <= RAMP_S + 1e-9,
            "limits.acceleration_rad_s2",
            format!(
                "from {} rad/s a stop would take {ramp:.3} s; expected at least {:.3} rad/s², so that it takes {RAMP_S} s",
                limits.velocity_rad_s,
                limits.velocity_rad_s / RAMP_S
            ),
        );
        found.unless(
            limits.home_velocity_rad_s <= limits.velocity_rad_s,
            "limits.home_velocity_rad_s",
            format!("expected at most velocity_rad_s, {}", limits.velocity_rad_s),
        );
        found.unless(
            limits.step_rad >= limits.velocity_rad_s * TICK_S,
            "limits.step_rad",
            format!(
                "at {} rad/s a set point is {} rad from the last; expected at least that",
                limits.velocity_rad_s,
                limits.velocity_rad_s * TICK_S
            ),
        );
        found.0
    }
}

/// Mistakes, one line each.
#[derive(Debug, Default)]
pub struct Mistakes(pub Vec<String>);

impl Mistakes {
    /// Notes a mistake, unless the key is right.
    pub fn unless(&mut self, right: bool, key: &str, message: impl AsRef<str>) {
        if !right {
            self.0.push(format!("{key}: {}", message.as_ref()));
        }
    }

    /// Notes a number that is outside its range.
    pub fn within(&mut self, key: &str, value: f64, low: f64, high: f64) {
        self.unless(
            (low..=high).contains(&value),
            key,
            format!("expected a number from {low} to {high}, found {value}"),
        );
    }

    fn numbers(&mut self, config: &Config) {
        let Limits {
            window_rad,
            velocity_rad_s,
            acceleration_rad_s2,
            step_rad,
            tracking_error_rad,
            home_velocity_rad_s,
        } = config.limits;
        self.within("limits.window_rad", window_rad, 1e-3, 3.0);
        self.within("limits.velocity_rad_s", velocity_rad_s, 1e-3, 0.84);
        self.within(
            "limits.acceleration_rad_s2",
            acceleration_rad_s2,
            1e-2,
            50.0,
        );
        self.within("limits.step_rad", step_rad, 1e-5, 0.1);
        self.within("limits.tracking_error_rad", tracking_error_rad, 1e-3, 0.5);
        self.within(
            "limits.home_velocity_rad_s",
            home_velocity_rad_s,
            1e-4,
            0.84,
        );
        self.within("tracker.edge_x_m", config.tracker.edge_x_m, 0.01, 10.0);
        self.within(
            "tracker.fastest_edges_s",
            config.tracker.fastest_edges_s,
            0.1,
            1e3,
        );
        self.within("tracker.most_hz", config.tracker.most_hz, 1.0, 1e4);
        self.within("backend.gain_per_s", config.backend.gain_per_s, 0.0, 20.0);
        let board = &config.board;
        self.within("board.edge_y_m", board.edge_y_m, 0.01, 10.0);
        self.within("board.marble_radius_m", board.marble_radius_m, 1e-3, 0.1);
        self.within("board.gear", board.gear, -1.0, 1.0);
    }

    /// Notes what is wrong in `[timeouts]`.
    pub fn timeouts(&mut self, times: &Timeouts) {
        for (key, value) in [
            ("timeouts.tracker_s", times.tracker_s),
            ("timeouts.joints_s", times.joints_s),
            ("timeouts.tracking_error_s", times.tracking_error_s),
            ("timeouts.overrun_s", times.overrun_s),
            ("timeouts.command_s", times.command_s),
            ("timeouts.stamp_s", times.stamp_s),
        ] {
            self.within(key, value, 0.01, 2.0);
        }
        self.within("timeouts.frozen_s", times.frozen_s, 0.0, 60.0);
    }

    /// Notes what is wrong in `[network]`.
    pub fn network(&mut self, network: &Network) {
        self.within("network.match_s", network.match_s, 0.1, 60.0);
        self.within("network.domain", f64::from(network.domain), 0.0, 232.0);
        self.unless(
            !network.interfaces.is_empty(),
            "network.interfaces",
            "expected an address, such as \"127.0.0.1\"",
        );
    }

    /// Notes what is wrong in `[safety]`.
    pub fn safety(&mut self, safety: &Safety) {
        self.within("safety.hold_s", safety.hold_s, 0.1, 10.0);
        self.within("safety.memory_mb", safety.memory_mb, 100.0, 1e5);
        self.topic("safety.e_stop", &safety.e_stop);
        self.topic("safety.stop_service", &safety.stop_service);
        for name in &safety.call_on_stop {
            self.topic("safety.call_on_stop", name);
        }
    }

    /// Notes what is wrong in `[twin]`.
    pub fn twin(&mut self, twin: &Twin) {
        self.within("twin.delay_s", twin.delay_s, 0.0, 0.5);
        self.within("twin.delay_jitter_s", twin.delay_jitter_s, 0.0, 0.1);
        self.within("twin.noise", twin.noise, 0.0, 0.1);
        self.within("twin.lost", twin.lost, 0.0, 1.0);
        self.within("twin.joint_noise_rad", twin.joint_noise_rad, 0.0, 0.1);
        self.within("twin.tilt_noise_rad", twin.tilt_noise_rad, 0.0, 0.1);
        self.within("twin.velocity_rad_s", twin.velocity_rad_s, 1e-3, 10.0);
        for axis in 0..2 {
            self.within(
                "twin.current_rad_s",
                twin.current_rad_s[axis].abs(),
                1e-4,
                1.0,
            );
            self.within("twin.current_dead", twin.current_dead[axis], 0.0, 32767.0);
        }
        self.within("twin.hand_s", twin.hand_s, 0.0, 60.0);
        let hz = twin.tracker_hz;
        self.unless(
            hz == 1000 || (hz > 0 && 120 % hz == 0),
            "twin.tracker_hz",
            format!("expected a divisor of 120, or 1000, found {hz}"),
        );
    }

    /// Notes a name that is no full name of a topic or service.
    fn topic(&mut self, key: &str, name: &str) {
        let is_full = name.len() > 1
            && name.split('/').skip(1).all(|part| {
                part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
                    && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
            })
            && name.starts_with('/');
        self.unless(
            is_full,
            key,
            format!("expected a full name such as /marble/position, found {name:?}"),
        );
    }

    fn names(&mut self, config: &Config) {
        self.topic("tracker.topic", &config.tracker.topic);
        for (table, arm) in config.arms.both() {
            self.topic(&format!("{table}.joint_states"), &arm.joint_states);
            self.topic(&format!("{table}.command"), &arm.command);
            self.within(&format!("{table}.gear"), arm.gear.abs(), 1e-3, 1e3);
            self.within(&format!("{table}.level_rad"), arm.level_rad, -100.0, 100.0);
            let most = match config.backend.kind {
                Kind::Velocities => config.backend.joints,
                _ => 7,
            };
            self.unless(
                (1..=most).contains(&arm.number),
                &format!("{table}.number"),
                format!("expected a joint from 1 to {most}, found {}", arm.number),
            );
            self.unless(
                !arm.joint.is_empty(),
                &format!("{table}.joint"),
                "expected a name",
            );
        }
        let (x, y) = (&config.arms.x, &config.arms.y);
        self.unless(
            x.command != y.command,
            "arms.y.command",
            "both arms have the same; expected one for each",
        );
        self.unless(
            (&x.joint, &x.joint_states) != (&y.joint, &y.joint_states),
            "arms.y.joint",
            "both arms have the same joint; expected one for each",
        );
        self.unless(
            (1..=64).contains(&config.backend.joints),
            "backend.joints",
            "expected a number from 1 to 64",
        );
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// A rig without mistakes.
    pub const EXAMPLE: &str = include_str!("../../example/rig.toml");

    fn changed(from: &str, to: &str) -> Vec<String> {
        assert!(EXAMPLE.contains(from), "{from}");
        let config: Config = toml::from_str(&EXAMPLE.replace(from, to)).expect("its form is right");
        config.mistakes()
    }

    #[test]
    fn the_example_has_no_mistakes() {
        assert!(changed("[limits]", "[limits]").is_empty());
    }

    #[test]
    fn each_mistake_is_one_line_with_key_value_and_what_is_possible() {
        for (from, to, key) in [
            ("window_rad = 0.5", "window_rad = nan", "limits.window_rad"),
            (
                "velocity_rad_s = 0.35",
                "velocity_rad_s = 5.0",
                "limits.velocity_rad_s",
            ),
            (
                "acceleration_rad_s2 = 4.0",
                "acceleration_rad_s2 = 1.0",
                "limits.acceleration_rad_s2",
            ),
            ("step_rad = 0.005", "step_rad = 0.0001", "limits.step_rad"),
            ("gear = -1.0", "gear = 0.0", "arms.y.gear"),
            (
                "\"/right/joint_states\"",
                "\"joint states\"",
                "arms.y.joint_states",
            ),
            (
                "\"/left/joint_states\"",
                "\"/le\\nft\"",
                "arms.x.joint_states",
            ),
            ("tracker_s = 0.3", "tracker_s = 60.0", "timeouts.tracker_s"),
            (
                "interfaces = [\"127.0.0.1\"]",
                "interfaces = []",
                "network.interfaces",
            ),
            ("tracker_hz = 60", "tracker_hz = 50", "twin.tracker_hz"),
        ] {
            let found = changed(from, to);
            assert!(
                found.iter().any(|one| one.starts_with(key)),
                "{to}: {found:?}"
            );
            assert!(found.iter().all(|one| !one.contains('\n')));
        }
    }
}
