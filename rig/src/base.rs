//! What every recording verb has: clocks, network, bag, events, and the ways to stop it.

use std::collections::BTreeMap;
use std::path::Path;

use crate::clock::{Clock, Ticker};
use crate::config::{Network, Reliability, Safety};
use crate::dds::{Inbox, Link, Trigger};
use crate::error::Result;
use crate::memory::resident_mb;
use crate::messages::{Bool, Log, Time};
use crate::recorder::{Attached, Channel, Recorder, fresh};
use crate::safety::Reason;
use crate::signals::Signals;
use crate::watch::Moment;

/// Severity of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// It went as it should.
    Info = 20,
    /// It may not be as it should.
    Warn = 30,
    /// It did not.
    Error = 40,
}

/// Clocks, network, bag and stops.
pub struct Base {
    /// Time.
    pub clock: Clock,
    /// The loop's ticks.
    pub ticker: Ticker,
    /// The network.
    pub link: Link,
    /// The bag.
    pub recorder: Recorder,
    e_stop: (Inbox<Bool>, Channel),
    stop: (Trigger, String),
    signals: Signals,
    memory_mb: f64,
    events: Channel,
}

impl Base {
    /// Joins the network as `rig`, and begins a bag with a name in a folder; `facts` become its metadata.
    ///
    /// # Errors
    /// [`Error::Refused`](crate::error::Error::Refused) if the network or the bag is unavailable.
    pub fn open(
        network: &Network,
        safety: &Safety,
        config: Attached<'_>,
        (folder, name): (&Path, &str),
        facts: &[(&str, String)],
    ) -> Result<Self> {
        let signals = Signals::register()?;
        let mut link = Link::open(network, "rig")?;
        let mut all: BTreeMap<String, String> = facts
            .iter()
            .map(|(key, value)| ((*key).to_owned(), value.clone()))
            .collect();
        all.insert("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned());
        let mut recorder = Recorder::create(&fresh(folder, name)?, config, all)?;
        let e_stop = link.subscribe(&safety.e_stop, Reliability::BestEffort)?;
        let clock = Clock::new();
        let base = Self {
            e_stop: (e_stop, recorder.channel::<Bool>(&safety.e_stop)),
            stop: (
                link.serve(&safety.stop_service)?,
                safety.stop_service.clone(),
            ),
            signals,
            memory_mb: safety.memory_mb,
            events: recorder.channel::<Log>("/rig/events"),
            ticker: Ticker::new(clock),
            clock,
            link,
            recorder,
        };
        let warning = unauthenticated(network);
        crate::say(&warning);
        base.event(Level::Warn, "unauthenticated", &warning);
        Ok(base)
    }

    /// All reasons to stop that come from people, from the system or from the bag.
    pub fn stops(&mut self, now: Moment) -> Vec<Reason> {
        let mut reasons = Vec::new();
        let (inbox, channel) = &self.e_stop;
        let recorder = &self.recorder;
        inbox.drain(self.clock, |moment, stop| {
            recorder.record(*channel, moment.nanos, moment.nanos, &stop);
            if stop.data {
                reasons.push(Reason::EmergencyStop(inbox.topic.clone()));
            }
        });
        if self.stop.0.asked() {
            reasons.push(Reason::EmergencyStop(self.stop.1.clone()));
        }
        reasons.extend(self.signals.caught().map(Reason::Signal));
        reasons.extend(self.ticker.stepped(now).map(Reason::ClockStepped));
        reasons.extend(self.recorder.failure().map(Reason::Recorder));
        let memory = resident_mb().filter(|&held| held > self.memory_mb);
        reasons.extend(memory.map(Reason::Memory));
        reasons
    }

    /// Records an event.
    pub fn event(&self, level: Level, code: &str, message: &str) {
        let now = self.clock.now().nanos;
        let log = Log {
            stamp: Time::from_nanos(now),
            level: level as u8,
            name: "rig".to_owned(),
            msg: message.to_owned(),
            function: code.to_owned(),
            ..Log::default()
        };
        self.recorder.record(self.events, now, now, &log);
    }
}

/// Warning about a network on which anybody may take part: DDS does not authenticate anyone here.
fn unauthenticated(network: &Network) -> String {
    let addresses: Vec<String> = network.interfaces.iter().map(ToString::to_string).collect();
    format!(
        "no peer is authenticated: every program that reaches {} can pose as tracker or arms, and can stop a run",
        addresses.join(", ")
    )
}
