//! Events in the bag: what happened, how bad it is, and why.

use std::time::Duration;

use crate::clock::Clock;
use crate::messages::{Log, Time};
use crate::recorder::{Channel, Queue, Recorder};

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

/// The topic of events, for any thread.
#[derive(Clone)]
pub struct Events {
    clock: Clock,
    queue: Queue,
    channel: Channel,
}

impl Events {
    /// The topic of events of a bag.
    pub fn open(recorder: &mut Recorder, clock: Clock) -> Self {
        Self {
            clock,
            channel: recorder.channel::<Log>("/rig/events"),
            queue: recorder.queue(),
        }
    }

    /// Records an event.
    pub fn note(&self, level: Level, code: &str, message: &str) {
        let now = self.clock.now().nanos;
        let log = Log {
            stamp: Time::from_nanos(now),
            level: level as u8,
            name: "rig".to_owned(),
            msg: message.to_owned(),
            function: code.to_owned(),
            ..Log::default()
        };
        self.queue.record(self.channel, now, now, &log);
    }

    /// Ends the bag after all that is queued, and waits for it, but not for ever.
    pub fn end_bag(&self, longest: Duration) {
        self.queue.end_within(longest);
    }
}
