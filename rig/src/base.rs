//! What every recording verb has: clocks, network, bag, events, and the ways to stop it.

use std::collections::BTreeMap;
use std::path::Path;

use crate::clock::{Clock, Ticker};
use crate::config::{Network, Reliability, Safety};
use crate::dds::{Inbox, Link, Trigger};
use crate::ending::Watch;
use crate::error::Result;
use crate::events::{Events, Level};
use crate::messages::Bool;
use crate::recorder::{Attached, Channel, Recorder, Written, fresh};
use crate::safety::Reason;
use crate::security::{Protection, refusals};
use crate::signals::Signals;
use crate::watch::Moment;

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
    /// The watch over the end of the program.
    pub watch: Watch,
    signals: Signals,
    events: Events,
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
        let watch = Watch::start(signals.any(), safety.hold_s, safety.memory_mb)?;
        let mut link = Link::open(network, "rig")?;
        let mut all: BTreeMap<String, String> = facts
            .iter()
            .map(|(key, value)| ((*key).to_owned(), value.clone()))
            .collect();
        all.insert("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned());
        let mut recorder = Recorder::create(&fresh(folder, name)?, config, all)?;
        let clock = Clock::new();
        let events = Events::open(&mut recorder, clock);
        watch.record_in(&events);
        let e_stop = link.subscribe(&safety.e_stop, Reliability::BestEffort)?;
        let base = Self {
            e_stop: (e_stop, recorder.channel::<Bool>(&safety.e_stop)),
            stop: (
                link.serve(&safety.stop_service)?,
                safety.stop_service.clone(),
            ),
            watch,
            signals,
            events,
            ticker: Ticker::new(clock),
            clock,
            link,
            recorder,
        };
        let (level, code, what) = protection(network, &base.link.protection);
        crate::say(&what);
        base.event(level, code, &what);
        Ok(base)
    }

    /// All reasons to stop that come from people, from the system or from the bag.
    pub fn stops(&mut self, now: Moment) -> Vec<Reason> {
        self.watch.beat();
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
        reasons.extend(self.watch.too_much_memory().map(Reason::Memory));
        for refusal in refusals() {
            self.event(Level::Warn, "refused_peer", &refusal);
        }
        reasons
    }

    /// Records an event.
    pub fn event(&self, level: Level, code: &str, message: &str) {
        self.events.note(level, code, message);
    }

    /// Closes the bag of a run with this outcome. From here on the process ends within seconds, even if the network cannot be
    /// left.
    ///
    /// # Errors
    /// [`Error::Refused`](crate::error::Error::Refused) if something of the bag is lost.
    pub fn close(&mut self, outcome: &Result<()>) -> Result<Written> {
        self.watch.closes();
        let written = self.recorder.finish();
        let error = outcome.as_ref().err().or(written.as_ref().err());
        self.watch.leaves(error);
        written
    }
}

/// Who may take part in a run, as an event.
fn protection(network: &Network, protection: &Protection) -> (Level, &'static str, String) {
    let addresses: Vec<String> = network.interfaces.iter().map(ToString::to_string).collect();
    match protection {
        Protection::Off(why) => (
            Level::Warn,
            "unauthenticated",
            format!(
                "no peer is authenticated: every program that reaches {} can pose as tracker or arms, can command the arms itself, and can stop a run ({why})",
                addresses.join(", ")
            ),
        ),
        Protection::Enclave(folder) => (
            Level::Info,
            "authenticated",
            format!(
                "peers are authenticated by {}: nobody else takes part",
                folder.display()
            ),
        ),
    }
}
