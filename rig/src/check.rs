//! The table of `rig check`: peers, matches, rates, clock offsets.

use crate::backend::command_topic;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::motion::silence;
use crate::station::Station;
use crate::watch::Tally;

/// Duration for which messages are counted (s).
const COUNT_S: f64 = 2.0;

/// A line of the table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Line {
    /// The checked item.
    pub what: String,
    /// Its topic or subject.
    pub of: String,
    /// The result.
    pub found: String,
    /// Whether it is ready.
    pub ready: bool,
}

/// Checks every peer for some seconds.
pub fn lines(station: &mut Station) -> Vec<Line> {
    let counted = listen_for(station, station.config.network.match_s.min(2.0));
    let begin = tallies(station);
    let seconds = listen_for(station, COUNT_S);
    let end = tallies(station);
    let config = station.config.clone();
    let mut lines = vec![Line {
        what: "network".to_owned(),
        of: format!("domain {}", config.network.domain),
        found: format!(
            "on {:?}, watched for {:.1} s",
            config.network.interfaces,
            counted + seconds
        ),
        ready: true,
    }];
    let now = station.base.clock.now().steady;
    for (axis, (table, arm)) in config.arms.both().into_iter().enumerate() {
        let watch = &station.joints[axis];
        let inbox = station
            .joint_inboxes
            .iter()
            .find(|(inbox, _)| inbox.topic == arm.joint_states);
        let heard = inbox.map_or(0, |(inbox, _)| station.base.link.heard(inbox));
        let there = station.base.link.publishers(&arm.joint_states);
        let rate = (end[axis].came - begin[axis].came) as f64 / seconds;
        let ready = watch.age_s(now) <= config.timeouts.joints_s;
        let mut found = peer(rate, there, heard, &watch.tally, ready);
        if let Some(angle) = watch.angle() {
            found = format!("{found}; at {angle:.4} rad");
        }
        lines.push(Line {
            what: format!("{table} joint"),
            of: format!("{} {}", arm.joint_states, arm.joint),
            found,
            ready,
        });
        lines.push(command(station, &config, axis));
    }
    let topic = &config.tracker.topic;
    let (there, heard) = (
        station.base.link.publishers(topic),
        station.base.link.heard(&station.marble_inbox.0),
    );
    let ready = station.marble.age_s(now) <= config.timeouts.tracker_s;
    let rate = (end[2].came - begin[2].came) as f64 / seconds;
    let mut found = peer(rate, there, heard, &station.marble.tally, ready);
    if let Some([x, y]) = station.marble.position() {
        found = format!("{found}; at {x:.3}, {y:.3}");
    }
    lines.push(Line {
        what: "tracker".to_owned(),
        of: topic.clone(),
        found,
        ready,
    });
    lines.push(Line {
        what: "arming".to_owned(),
        of: "safety.allow_arming".to_owned(),
        found: if config.safety.allow_arming {
            "allowed"
        } else {
            "not allowed: dry runs only"
        }
        .to_owned(),
        ready: true,
    });
    lines
}

fn command(station: &Station, config: &Config, axis: usize) -> Line {
    let (table, arm) = config.arms.both()[axis];
    let kind = config.backend.kind;
    let topic = command_topic(kind, &arm.command);
    let action = kind == crate::config::Kind::Action;
    let (publishers, subscriptions) = (
        station.base.link.publishers(&topic),
        station.base.link.subscriptions(&topic),
    );
    let (listening, others) = if action {
        (publishers, 0)
    } else {
        (subscriptions, publishers)
    };
    Line {
        what: format!("{table} driver"),
        of: format!("{} ({kind:?})", arm.command).to_lowercase(),
        found: match (listening, others) {
            (0, _) => "nobody listens".to_owned(),
            (n, 0) => format!("{n} listening, nobody else commands"),
            (_, others) => format!("{others} other publishers: the rig commands arms alone"),
        },
        ready: listening > 0 && others == 0,
    }
}

fn peer(rate: f64, there: usize, heard: usize, tally: &Tally, ready: bool) -> String {
    if !ready {
        return silence(there, heard, tally);
    }
    let age = tally.least_age_s.map_or(String::new(), |age| {
        format!(", stamps {:+.1} ms old at least", 1e3 * age)
    });
    let refused = if tally.refused > 0 {
        format!(", {} refused: {}", tally.refused, tally.why)
    } else {
        String::new()
    };
    format!("{heard} of {there} publishers heard, {rate:.1} Hz{age}{refused}")
}

fn tallies(station: &Station) -> [Tally; 3] {
    let [x, y] = &station.joints;
    [
        x.tally.clone(),
        y.tally.clone(),
        station.marble.tally.clone(),
    ]
}

fn listen_for(station: &mut Station, seconds: f64) -> f64 {
    let begin = station.base.clock.now().steady;
    loop {
        let (now, _) = station.base.ticker.wait();
        if station.hear(now, false).is_some() || now.steady - begin >= seconds {
            return now.steady - begin;
        }
    }
}

/// The table as it is printed.
///
/// # Errors
/// [`Error::Refused`] counts what is not ready.
pub fn table(lines: &[Line], mut print: impl FnMut(String)) -> Result<()> {
    let width =
        |part: fn(&Line) -> &String| lines.iter().map(|line| part(line).len()).max().unwrap_or(0);
    let (what, of) = (width(|line| &line.what), width(|line| &line.of));
    for line in lines {
        let mark = if line.ready { "ready" } else { "NOT READY" };
        print(format!(
            "{:<9}  {:<what$}  {:<of$}  {}",
            mark, line.what, line.of, line.found
        ));
    }
    match lines.iter().filter(|line| !line.ready).count() {
        0 => Ok(()),
        count => Err(Error::refused(format!(
            "{count} of {} are not ready",
            lines.len()
        ))),
    }
}
