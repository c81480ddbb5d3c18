//! `rig.toml` of a rig with another lab's interface, and which kind a file is.

use std::path::Path;

use serde::Deserialize;

use super::Lab;
use crate::config::{
    self, Config, Mistakes, Network, Safety, TICK_S, Timeouts, Tracker, Twin, Unit,
};
use crate::error::{Error, Result};

/// Kinds of backends: of arms at the knobs, and of other labs.
const ARMS: [&str; 4] = ["trajectory", "velocities", "kinova", "action"];
const LABS: [&str; 2] = ["cyberrunner", "tag_tcp"];

/// A configuration.
#[derive(Debug, Clone, PartialEq)]
pub enum Setup {
    /// Arms at the knobs.
    Arms(Box<Config>),
    /// The interface of another lab.
    Lab(Box<LabConfig>),
}

/// The whole file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabConfig {
    /// Where DDS may send.
    #[serde(default)]
    pub network: Network,
    /// The interface.
    pub backend: LabBackend,
    /// Limits of commands.
    pub limits: LabLimits,
    /// Timeouts.
    #[serde(default)]
    pub timeouts: Timeouts,
    /// Arming and stops.
    #[serde(default)]
    pub safety: Safety,
    /// The simulated rig.
    #[serde(default)]
    pub twin: Twin,
}

/// The interface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabBackend {
    /// Whose it is.
    pub kind: Lab,
}

/// Limits of commands, in the unit of the lab's commands.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabLimits {
    /// Largest command, in both directions.
    pub command: f64,
    /// Largest change of a command per second.
    pub change_per_s: f64,
    /// Largest measured tilt of the board (rad).
    pub tilt_rad: f64,
}

/// The tables of any configuration that a twin needs.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
pub struct TwinConfig {
    /// Where DDS may send.
    #[serde(default)]
    pub network: Network,
    /// The simulated rig.
    #[serde(default)]
    pub twin: Twin,
}

#[derive(Deserialize, Default)]
struct Kinds {
    #[serde(default)]
    backend: Kind,
}

#[derive(Deserialize, Default)]
struct Kind {
    kind: Option<String>,
}

impl Setup {
    /// Reads and validates a file; `backend.kind` says which it is.
    ///
    /// # Errors
    /// [`Error::Refused`] or [`Error::Mistakes`].
    pub fn read(path: &Path) -> Result<(Self, String)> {
        let text = config::text(path)?;
        // A text of another form is refused with its line where it is read in full.
        let kinds: Kinds = toml::from_str(&text).unwrap_or_default();
        let kind = kinds.backend.kind.unwrap_or_default();
        if LABS.contains(&kind.as_str()) {
            let lab = config::parse(path, &text, LabConfig::mistakes)?;
            return Ok((Self::Lab(Box::new(lab)), text));
        }
        if !kind.is_empty() && !ARMS.contains(&kind.as_str()) {
            return Err(Error::refused(format!(
                "{}, backend.kind: expected {} or {}, found {kind:?}",
                path.display(),
                ARMS.join(", "),
                LABS.join(", ")
            )));
        }
        let arms = config::parse(path, &text, Config::mistakes)?;
        Ok((Self::Arms(Box::new(arms)), text))
    }
}

impl LabConfig {
    /// The tracker: places in metres.
    pub fn tracker(&self) -> Tracker {
        Tracker {
            unit: Unit::M,
            edge_x_m: self.backend.kind.size().edges_m[0],
            ..Tracker::default()
        }
    }

    /// The mistakes, one line each: key, value, possible values.
    pub fn mistakes(&self) -> Vec<String> {
        let mut found = Mistakes::default();
        // The largest that the drivers take: 16 bits of current; the ends of a servo's way.
        let most = match self.backend.kind {
            Lab::Cyberrunner => 1000.0,
            Lab::TagTcp => 267.0,
        };
        let limits = &self.limits;
        found.within("limits.command", limits.command, 1.0, most);
        found.within(
            "limits.change_per_s",
            limits.change_per_s,
            1.0,
            most / TICK_S,
        );
        found.within("limits.tilt_rad", limits.tilt_rad, 0.01, 0.5);
        found.network(&self.network);
        found.timeouts(&self.timeouts);
        found.safety(&self.safety);
        found.unless(
            self.safety.call_on_stop.is_empty(),
            "safety.call_on_stop",
            "expected none: a stop is a command of zero here, and a reset would move the board",
        );
        found.twin(&self.twin);
        found.0
    }
}

impl TwinConfig {
    /// Reads the tables of a file; a `rig.toml` that is not there leaves the defaults.
    ///
    /// # Errors
    /// [`Error::Refused`] or [`Error::Mistakes`].
    pub fn read(path: &Path) -> Result<Self> {
        if !path.exists() && path == Path::new("rig.toml") {
            return Ok(Self::default());
        }
        config::parse(path, &config::text(path)?, |read: &Self| {
            let mut found = Mistakes::default();
            found.network(&read.network);
            found.twin(&read.twin);
            found.0
        })
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// Rigs without mistakes.
    pub const EXAMPLES: [&str; 2] = [
        include_str!("../../example/cyberrunner.toml"),
        include_str!("../../example/tag.toml"),
    ];

    #[test]
    fn the_examples_have_no_mistakes() {
        for (text, lab) in EXAMPLES.into_iter().zip([Lab::Cyberrunner, Lab::TagTcp]) {
            let config: LabConfig = toml::from_str(text).expect("its form is right");
            assert_eq!(config.backend.kind, lab);
            assert_eq!(config.mistakes(), Vec::<String>::new());
        }
    }

    #[test]
    fn each_mistake_is_one_line_with_key_and_range() {
        for (from, to, key) in [
            ("command = 200.0", "command = 4000.0", "limits.command"),
            ("command = 200.0", "command = nan", "limits.command"),
            ("tilt_rad = 0.2", "tilt_rad = 2.0", "limits.tilt_rad"),
            (
                "hold_s = 1.0",
                "call_on_stop = [\"/reset\"]",
                "safety.call_on_stop",
            ),
        ] {
            assert!(EXAMPLES[0].contains(from), "{from}");
            let config: LabConfig =
                toml::from_str(&EXAMPLES[0].replace(from, to)).expect("its form is right");
            let found = config.mistakes();
            assert!(
                found.len() == 1 && found[0].starts_with(key),
                "{to}: {found:?}"
            );
        }
    }
}
