//! Clocks: a monotonic one for the loop, and the wall clock for stamps.

use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::config::TICK_S;
use crate::watch::Moment;

/// Change of the wall clock against the monotonic clock between two ticks that counts as a clock step (s).
const STEP_S: f64 = 0.02;

/// Both clocks.
#[derive(Debug, Clone, Copy)]
pub struct Clock {
    begin: Instant,
}

impl Clock {
    /// Starts now.
    pub fn new() -> Self {
        Self {
            begin: Instant::now(),
        }
    }

    /// The time of both clocks.
    pub fn now(&self) -> Moment {
        let nanos = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .map_or(0, |since| since.as_nanos() as i64);
        Moment {
            steady: self.begin.elapsed().as_secs_f64(),
            nanos,
        }
    }

    /// The time of a stamp of this machine's wall clock (ns since 1970).
    pub fn at(&self, nanos: i64) -> Moment {
        let now = self.now();
        Moment {
            steady: now.steady - (now.nanos - nanos) as f64 / 1e9,
            nanos,
        }
    }
}

/// The loop's 100 Hz: absolute deadlines without catching up.
#[derive(Debug)]
pub struct Ticker {
    clock: Clock,
    next: f64,
    /// Statistics of the ticks' lateness (s): number of ticks, number more than 2 ms late, maximum.
    pub ticks: u64,
    /// Number of ticks more than 2 ms late.
    pub late: u64,
    /// The maximum lateness (s).
    pub worst_s: f64,
    offset: Option<f64>,
}

impl Ticker {
    /// The first tick is due now.
    pub fn new(clock: Clock) -> Self {
        Self {
            clock,
            next: clock.now().steady,
            ticks: 0,
            late: 0,
            worst_s: 0.0,
            offset: None,
        }
    }

    /// Sleeps until the next tick is due; returns its time and its lateness (s).
    pub fn wait(&mut self) -> (Moment, f64) {
        let ahead = self.next - self.clock.now().steady;
        if ahead > 0.0 {
            thread::sleep(Duration::from_secs_f64(ahead));
        }
        let now = self.clock.now();
        let late = (now.steady - self.next).max(0.0);
        self.ticks += 1;
        self.late += u64::from(late > 0.002);
        self.worst_s = self.worst_s.max(late);
        self.next += TICK_S;
        // Commands go out 100 times a second or less often, never faster to catch up.
        if self.next < now.steady {
            self.next = now.steady + TICK_S;
        }
        (now, late)
    }

    /// Step of the wall clock since the last tick (s), if any.
    pub fn stepped(&mut self, now: Moment) -> Option<f64> {
        let offset = now.nanos as f64 / 1e9 - now.steady;
        let before = self.offset.replace(offset)?;
        let by = offset - before;
        (by.abs() > STEP_S).then_some(by)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_is_set_back_is_noticed_once() {
        let mut ticker = Ticker::new(Clock::new());
        let at = |steady: f64, set: i64| Moment {
            steady,
            nanos: (steady * 1e9) as i64 + set,
        };
        assert_eq!(ticker.stepped(at(1.0, 0)), None);
        assert_eq!(ticker.stepped(at(1.01, 0)), None);
        let by = ticker
            .stepped(at(1.02, -3_000_000_000))
            .expect("it was set");
        assert!((by + 3.0).abs() < 1e-3);
        assert_eq!(ticker.stepped(at(1.03, -3_000_000_000)), None);
    }

    #[test]
    fn ticks_are_never_made_up_for() {
        let clock = Clock::new();
        let mut ticker = Ticker::new(clock);
        ticker.wait();
        thread::sleep(Duration::from_millis(60));
        let (first, late) = ticker.wait();
        assert!(late > 0.04);
        let (second, _) = ticker.wait();
        assert!(second.steady - first.steady >= TICK_S);
    }
}
