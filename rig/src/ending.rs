//! The end of this program, even where a thread of the DDS library hangs.
//!
//! A packet of the network can keep the library busy for ever: it counts through the numbers that a packet names. Whoever
//! waits for that thread, as leaving the network does, waits for ever, too. A thread of its own therefore watches the loop,
//! the closing of the bag and the leaving, and ends the process once one of them takes too long.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread;
use std::time::Duration;

use signal_hook::low_level::exit;

use crate::error::{Error, Result};
use crate::events::{Events, Level};
use crate::memory::resident_mb;

/// Period of the watch (s).
const WAKE_S: f64 = 0.1;

/// Longest time without a tick of the loop (s): `timeouts.overrun_s` stops the arms long before, and commands expire.
const LOOP_S: f64 = 5.0;

/// Longest time for the bag (s): two minutes of messages may wait for a slow disk.
const BAG_S: f64 = 10.0;

/// Longest time for leaving the network (s): without a fault it takes some hundredths.
const NETWORK_S: f64 = 3.0;

/// The same for a program that holds too much memory (s): a thread that counts for ever takes up to 2 GB a second.
const FULL_S: f64 = 0.3;

/// What the arms were last commanded to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arms {
    /// Nothing.
    Uncommanded = 0,
    /// To rest.
    AtRest = 1,
    /// To move.
    Moving = 2,
}

impl Arms {
    /// Words for a log.
    pub fn words(self) -> &'static str {
        match self {
            Self::Uncommanded => "nothing was commanded",
            Self::AtRest => "the last command was to rest",
            Self::Moving => "the last command was to move",
        }
    }
}

/// How far the program is.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Phase {
    /// The loop ticks, or is about to.
    Loop,
    /// The bag is being closed.
    Bag,
    /// The network is being left, with the error that the program ends with.
    Network(Option<String>),
}

/// What takes too long.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Late {
    /// No tick for [`LOOP_S`].
    Tick,
    /// The loop goes on although a signal has asked it to end.
    Signal,
    /// The bag.
    Bag,
    /// The network.
    Network(Option<String>),
}

/// What the watch sees in a period.
#[derive(Debug, Clone, Copy)]
struct Seen<'a> {
    /// Ticks of the loop so far.
    beats: u64,
    /// Whether a signal has come.
    asked: bool,
    /// Whether the program holds too much memory.
    full: bool,
    phase: &'a Phase,
}

/// Counts of the watch: a process that is suspended does not count.
#[derive(Debug, Default)]
struct Counts {
    beats: u64,
    still: u32,
    asked: u32,
    closing: u32,
    leaving: u32,
}

impl Counts {
    /// One period of the watch: what has become too late, if anything.
    fn next(&mut self, seen: Seen<'_>, hold_s: f64) -> Option<Late> {
        match seen.phase {
            Phase::Loop => {
                // Before the first tick peers and bag are being opened.
                let stands = seen.beats > 0 && seen.beats == self.beats;
                self.still = if stands { self.still + 1 } else { 0 };
                self.beats = seen.beats;
                self.asked += u32::from(seen.asked);
                if over(self.still, LOOP_S) {
                    return Some(Late::Tick);
                }
                over(self.asked, hold_s + LOOP_S).then_some(Late::Signal)
            }
            Phase::Bag => {
                self.closing += 1;
                over(self.closing, BAG_S).then_some(Late::Bag)
            }
            Phase::Network(error) => {
                self.leaving += 1;
                let longest = if seen.full { FULL_S } else { NETWORK_S };
                over(self.leaving, longest).then(|| Late::Network(error.clone()))
            }
        }
    }
}

fn over(wakes: u32, seconds: f64) -> bool {
    f64::from(wakes) * WAKE_S > seconds
}

struct Shared {
    hold_s: f64,
    memory_mb: f64,
    beats: AtomicU64,
    asked: Arc<AtomicBool>,
    arms: AtomicU8,
    /// Memory that the program holds (MB), as bits.
    held: AtomicU64,
    phase: Mutex<Phase>,
    events: OnceLock<Events>,
}

/// The loop's end of the watch.
#[derive(Clone)]
pub struct Watch(Arc<Shared>);

impl Watch {
    /// Watches from now on; `asked` becomes true with the first signal, after which a loop may repeat its stop for some
    /// seconds. A program that holds more memory (MB) than this has less time for leaving the network.
    ///
    /// # Errors
    /// [`Error::Refused`] if the system allows no further thread.
    pub fn start(asked: Arc<AtomicBool>, hold_s: f64, memory_mb: f64) -> Result<Self> {
        let shared = Arc::new(Shared {
            hold_s,
            memory_mb,
            beats: AtomicU64::new(0),
            asked,
            arms: AtomicU8::new(Arms::Uncommanded as u8),
            held: AtomicU64::new(0.0_f64.to_bits()),
            phase: Mutex::new(Phase::Loop),
            events: OnceLock::new(),
        });
        let watched = Arc::clone(&shared);
        thread::Builder::new()
            .name("ending".to_owned())
            .spawn(move || watched.watch())
            .map_err(|error| Error::refused(format!("a thread cannot start: {error}")))?;
        Ok(Self(shared))
    }

    /// Where to record an end that comes from here.
    pub fn record_in(&self, events: &Events) {
        let _ = self.0.events.set(events.clone());
    }

    /// A tick of the loop.
    pub fn beat(&self) {
        self.0.beats.fetch_add(1, Ordering::Relaxed);
    }

    /// Notes what the arms are commanded to do.
    pub fn command(&self, arms: Arms) {
        self.0.arms.store(arms as u8, Ordering::Relaxed);
    }

    /// What the arms were last commanded to do.
    pub fn arms(&self) -> Arms {
        self.0.arms()
    }

    /// Memory that the program held in the last tenth of a second (MB), if that is too much.
    pub fn too_much_memory(&self) -> Option<f64> {
        self.0.too_much_memory()
    }

    /// The loop has ended, and the bag is being closed.
    pub fn closes(&self) {
        self.0.set(Phase::Bag);
    }

    /// The bag is closed, and the network is being left; the program ends with this error, if any.
    pub fn leaves(&self, error: Option<&Error>) {
        self.0.set(Phase::Network(error.map(ToString::to_string)));
    }
}

impl Shared {
    fn set(&self, phase: Phase) {
        *self.phase.lock().unwrap_or_else(PoisonError::into_inner) = phase;
    }

    fn arms(&self) -> Arms {
        let arms = self.arms.load(Ordering::Relaxed);
        [Arms::Uncommanded, Arms::AtRest, Arms::Moving][usize::from(arms)]
    }

    fn too_much_memory(&self) -> Option<f64> {
        let held = f64::from_bits(self.held.load(Ordering::Relaxed));
        (held > self.memory_mb).then_some(held)
    }

    fn watch(&self) {
        let mut counts = Counts::default();
        loop {
            thread::sleep(Duration::from_secs_f64(WAKE_S));
            let held = resident_mb().unwrap_or(0.0);
            self.held.store(held.to_bits(), Ordering::Relaxed);
            let phase = self
                .phase
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .clone();
            let seen = Seen {
                beats: self.beats.load(Ordering::Relaxed),
                asked: self.asked.load(Ordering::Relaxed),
                full: self.too_much_memory().is_some(),
                phase: &phase,
            };
            if let Some(late) = counts.next(seen, self.hold_s) {
                self.end(&late);
            }
        }
    }

    fn end(&self, late: &Late) -> ! {
        match late {
            Late::Tick => self.abandon(&format!("the loop has stood still for {LOOP_S} s")),
            Late::Signal => self.abandon(&format!(
                "the loop goes on {} s after a signal",
                self.hold_s + LOOP_S
            )),
            Late::Bag => eprintln!(
                "rig: the bag could not be closed within {BAG_S} s, for 'rig recover'; {}",
                self.arms().words()
            ),
            Late::Network(error) => {
                eprintln!(
                    "rig: the network could not be left: other nodes may list this one for a minute"
                );
                match error {
                    Some(error) => eprintln!("rig: {error}"),
                    None => exit(0),
                }
            }
        }
        exit(1)
    }

    /// Records why the loop is given up, and closes the bag as far as that is possible.
    fn abandon(&self, why: &str) {
        let why = format!("{why}: the program was ended; {}", self.arms().words());
        if let Some(events) = self.events.get() {
            events.note(Level::Error, "abandoned", &why);
            events.end_bag(Duration::from_secs_f64(BAG_S));
        }
        eprintln!("rig: {why}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds until something is too late, and what, of a watch of at most a minute.
    fn late_after(at: impl FnMut(u64) -> (u64, bool, Phase)) -> Option<(f64, Late)> {
        late_with(false, at)
    }

    fn late_with(full: bool, mut at: impl FnMut(u64) -> (u64, bool, Phase)) -> Option<(f64, Late)> {
        let mut counts = Counts::default();
        (1..=600_u32).find_map(|wake| {
            let (beats, asked, phase) = at(u64::from(wake));
            let seen = Seen {
                beats,
                asked,
                full,
                phase: &phase,
            };
            let late = counts.next(seen, 1.0)?;
            Some((f64::from(wake) * WAKE_S, late))
        })
    }

    #[test]
    fn a_loop_that_ticks_is_let_alone() {
        assert_eq!(late_after(|wake| (10 * wake, false, Phase::Loop)), None);
        // Peers and bag are being opened.
        assert_eq!(late_after(|_| (0, false, Phase::Loop)), None);
    }

    #[test]
    fn a_loop_that_stands_still_is_given_up() {
        let (seconds, late) =
            late_after(|wake| (10 * wake.min(20), false, Phase::Loop)).expect("it stands");
        assert_eq!(late, Late::Tick);
        assert!((7.0..7.3).contains(&seconds), "{seconds}");
    }

    #[test]
    fn a_loop_that_stands_still_and_goes_on_is_let_alone() {
        let beats = |wake: u64| wake - wake % 40;
        assert_eq!(late_after(|wake| (beats(wake), false, Phase::Loop)), None);
    }

    #[test]
    fn a_loop_that_goes_on_after_a_signal_is_given_up() {
        for beats in [0, 10] {
            let (seconds, late) =
                late_after(|wake| (beats * wake, wake > 10, Phase::Loop)).expect("it goes on");
            assert_eq!(late, Late::Signal);
            assert!((7.0..7.3).contains(&seconds), "{seconds}");
        }
    }

    #[test]
    fn bag_and_network_have_limits_of_their_own() {
        let phase = |wake: u64| match wake {
            0..50 => Phase::Loop,
            50..140 => Phase::Bag,
            _ => Phase::Network(Some("why".to_owned())),
        };
        let (seconds, late) = late_after(|wake| (wake, true, phase(wake))).expect("it hangs");
        assert_eq!(late, Late::Network(Some("why".to_owned())));
        assert!((17.0..17.3).contains(&seconds), "{seconds}");
        let (seconds, _) = late_with(true, |wake| (wake, true, phase(wake))).expect("it hangs");
        assert!((14.2..14.5).contains(&seconds), "{seconds}");
        let (seconds, late) = late_after(|_| (1, true, Phase::Bag)).expect("it hangs");
        assert_eq!(late, Late::Bag);
        assert!((10.0..10.3).contains(&seconds), "{seconds}");
    }
}
