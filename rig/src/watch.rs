//! Plausibility checks and ages of the peers' messages.

use std::collections::VecDeque;
use std::f64::consts::TAU;

use crate::config::{Config, Timeouts, Tracker, Unit};
use crate::messages::{JointState, PointStamped};
use crate::safety::Reason;

/// A stamp may be ahead of this machine's clock by this much (s).
const AHEAD_S: f64 = 0.05;

/// Time of receipt: seconds of the monotonic clock, and nanoseconds since 1970.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Monotonic clock (s).
    pub steady: f64,
    /// Since 1970 (ns).
    pub nanos: i64,
}

/// Numbers of received and refused messages, and the age of their stamps.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tally {
    /// Number of received messages.
    pub came: u64,
    /// Number of refused messages.
    pub refused: u64,
    /// Why the last refused message was refused.
    pub why: String,
    /// Smallest age of a stamp at receipt (s): transport, and the clocks' difference.
    pub least_age_s: Option<f64>,
}

impl Tally {
    fn age(&mut self, moment: Moment, stamp: i64) -> f64 {
        let age = (moment.nanos - stamp) as f64 / 1e9;
        self.least_age_s = Some(self.least_age_s.map_or(age, |least| least.min(age)));
        age
    }

    /// Age of a message (s), if its stamp is plausible: neither too old nor in the future, and later than the previous one.
    fn fresh(
        &mut self,
        moment: Moment,
        stamp: i64,
        oldest_s: f64,
        before: Option<i64>,
    ) -> Option<f64> {
        let age = self.age(moment, stamp);
        if age > oldest_s || age < -AHEAD_S {
            self.refuse(format!(
                "its stamp is {age:.3} s old by this machine's clock"
            ));
            return None;
        }
        if before.is_some_and(|before| stamp <= before) {
            self.refuse("its stamp is not later than the one before");
            return None;
        }
        Some(age)
    }

    fn refuse(&mut self, why: impl Into<String>) {
        self.refused += 1;
        self.why = why.into();
    }
}

/// Checks the marble's points.
#[derive(Debug, Clone)]
pub struct MarbleWatch {
    tracker: Tracker,
    times: Timeouts,
    /// Shortest time between pictures (s): messages with stamps of receipt may come in bursts.
    least_s: f64,
    /// Counts of messages.
    pub tally: Tally,
    /// Time of the last valid point, by its stamp.
    seen: Option<f64>,
    last: Option<(i64, [f64; 2])>,
    /// Time since when its position has not changed by a bit.
    same_since: Option<f64>,
    jumps: VecDeque<f64>,
    arrivals: VecDeque<f64>,
}

impl MarbleWatch {
    /// No messages yet. Speeds are those over the stamps' distance, but at least over `least_s` (s).
    pub fn new(tracker: Tracker, times: Timeouts, least_s: f64) -> Self {
        Self {
            tracker,
            times,
            least_s,
            tally: Tally::default(),
            seen: None,
            last: None,
            same_since: None,
            jumps: VecDeque::new(),
            arrivals: VecDeque::new(),
        }
    }

    /// Age of the last valid point (s), by its stamp; infinite before the first.
    pub fn age_s(&self, steady: f64) -> f64 {
        self.seen.map_or(f64::INFINITY, |seen| steady - seen)
    }

    /// Last tracked position (board edges).
    pub fn position(&self) -> Option<[f64; 2]> {
        self.last.map(|(_, place)| place)
    }

    /// Checks a point; the argument says whether the knobs move.
    ///
    /// # Errors
    /// The reason to stop, if the point is impossible.
    pub fn take(
        &mut self,
        moment: Moment,
        point: &PointStamped,
        moving: bool,
    ) -> Result<(), Reason> {
        self.tally.came += 1;
        self.flood(moment.steady)?;
        let scale = match self.tracker.unit {
            Unit::Edges => 1.0,
            Unit::M => 1.0 / self.tracker.edge_x_m,
        };
        let place = [point.point.x * scale, point.point.y * scale];
        if !place.iter().all(|value| value.is_finite()) {
            self.tally.refuse("not a number");
            return Ok(());
        }
        let stamp = point.header.stamp.nanos();
        let (before, oldest_s) = (self.last, self.times.stamp_s);
        let Some(age) = self
            .tally
            .fresh(moment, stamp, oldest_s, before.map(|(at, _)| at))
        else {
            return Ok(());
        };
        self.last = Some((stamp, place));
        self.seen = Some(moment.steady - age.max(0.0));
        let Some((before, was)) = before else {
            return Ok(());
        };
        let seconds = ((stamp - before) as f64 / 1e9).max(self.least_s);
        let way = (place[0] - was[0]).hypot(place[1] - was[1]);
        self.still(moment.steady, place == was, moving)?;
        if way > self.tracker.fastest_edges_s * seconds {
            self.jumped(moment.steady, way, seconds)?;
        }
        Ok(())
    }

    fn flood(&mut self, now: f64) -> Result<(), Reason> {
        self.arrivals.push_back(now);
        while self
            .arrivals
            .front()
            .is_some_and(|&first| now - first > 1.0)
        {
            self.arrivals.pop_front();
        }
        if self.arrivals.len() as f64 > self.tracker.most_hz {
            let what = format!(
                "{} points in a second, more than tracker.most_hz",
                self.arrivals.len()
            );
            return Err(Reason::TrackerLies(what));
        }
        Ok(())
    }

    fn still(&mut self, now: f64, same: bool, moving: bool) -> Result<(), Reason> {
        if !same || !moving || self.times.frozen_s == 0.0 {
            self.same_since = None;
            return Ok(());
        }
        let lasts = now - *self.same_since.get_or_insert(now);
        if lasts > self.times.frozen_s {
            let what =
                format!("the same place to the last bit for {lasts:.1} s while the knobs turn");
            return Err(Reason::TrackerLies(what));
        }
        Ok(())
    }

    fn jumped(&mut self, now: f64, way: f64, seconds: f64) -> Result<(), Reason> {
        self.jumps.push_back(now);
        while self.jumps.front().is_some_and(|&first| now - first > 1.0) {
            self.jumps.pop_front();
        }
        if self.jumps.len() > self.tracker.jumps {
            let count = self.jumps.len();
            let what = format!(
                "{count} jumps in a second, the last of {way:.2} edges in {:.0} ms",
                1e3 * seconds
            );
            return Err(Reason::TrackerLies(what));
        }
        Ok(())
    }
}

/// Checks one joint.
#[derive(Debug, Clone)]
pub struct JointWatch {
    joint: String,
    fastest: f64,
    stamp_s: f64,
    /// Counts of messages.
    pub tally: Tally,
    seen: Option<f64>,
    last: Option<(i64, f64)>,
}

impl JointWatch {
    /// No messages yet; `axis` is 0 about x, 1 about y.
    pub fn new(config: &Config, axis: usize) -> Self {
        Self {
            joint: config.arms.both()[axis].1.joint.clone(),
            // Twice the commanded limit, and a margin for noise: faster motion cannot come from the rig.
            fastest: 2.0 * config.limits.velocity_rad_s + 1.0,
            stamp_s: config.timeouts.stamp_s,
            tally: Tally::default(),
            seen: None,
            last: None,
        }
    }

    /// Age of the last valid angle (s), by its stamp; infinite before the first.
    pub fn age_s(&self, steady: f64) -> f64 {
        self.seen.map_or(f64::INFINITY, |seen| steady - seen)
    }

    /// The joint's angle (rad), without jumps of a full turn.
    pub fn angle(&self) -> Option<f64> {
        self.last.map(|(_, angle)| angle)
    }

    /// Checks a joint state, which may be of other joints.
    ///
    /// # Errors
    /// The reason to stop, if the motion is impossible.
    pub fn take(&mut self, moment: Moment, state: &JointState) -> Result<(), Reason> {
        let Some(index) = state.name.iter().position(|name| *name == self.joint) else {
            return Ok(());
        };
        self.tally.came += 1;
        let Some(&angle) = state.position.get(index).filter(|angle| angle.is_finite()) else {
            self.tally.refuse("not a number");
            return Ok(());
        };
        let stamp = state.header.stamp.nanos();
        let before = self.last;
        let Some(age) = self
            .tally
            .fresh(moment, stamp, self.stamp_s, before.map(|(at, _)| at))
        else {
            return Ok(());
        };
        let was = before.map_or(angle, |(_, was)| was);
        let angle = angle + TAU * ((was - angle) / TAU).round();
        self.last = Some((stamp, angle));
        self.seen = Some(moment.steady - age.max(0.0));
        let Some((before, _)) = before else {
            return Ok(());
        };
        let seconds = (stamp - before) as f64 / 1e9;
        let way = (angle - was).abs();
        if way > self.fastest * seconds.max(crate::config::TICK_S) {
            let what = format!(
                "{} turned {way:.3} rad in {:.0} ms",
                self.joint,
                1e3 * seconds
            );
            return Err(Reason::JointsLie(what));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Header, Point, Time};

    fn config() -> Config {
        toml::from_str(crate::config::EXAMPLE).expect("the example is right")
    }

    fn point(seconds: f64, x: f64) -> (Moment, PointStamped) {
        let moment = Moment {
            steady: seconds,
            nanos: 1_000_000_000_000 + (seconds * 1e9) as i64,
        };
        let header = Header {
            stamp: Time::from_nanos(moment.nanos - 20_000_000),
            ..Header::default()
        };
        (
            moment,
            PointStamped {
                header,
                point: Point { x, y: 0.0, z: 0.0 },
            },
        )
    }

    /// Feeds 60 points a second for some seconds; returns why it stopped.
    fn feed(
        seconds: f64,
        change: impl Fn(usize, &mut Moment, &mut PointStamped),
    ) -> (MarbleWatch, Option<Reason>) {
        let mut watch = MarbleWatch::new(config().tracker, config().timeouts, 0.0);
        for i in 0..(60.0 * seconds) as usize {
            let (mut moment, mut one) = point(i as f64 / 60.0, 0.001 * (i as f64 * 0.7).sin());
            change(i, &mut moment, &mut one);
            if let Err(reason) = watch.take(moment, &one, true) {
                return (watch, Some(reason));
            }
        }
        (watch, None)
    }

    #[test]
    fn a_good_tracker_is_believed_and_its_delay_measured() {
        let (watch, reason) = feed(3.0, |_, _, _| ());
        assert_eq!(reason, None);
        assert_eq!((watch.tally.came, watch.tally.refused), (180, 0));
        assert!((watch.tally.least_age_s.expect("points came") - 0.02).abs() < 1e-6);
        assert!((watch.age_s(3.0) - (3.0 - 179.0 / 60.0 + 0.02)).abs() < 1e-6);
    }

    #[test]
    fn some_wild_points_pass_and_many_stop() {
        assert_eq!(
            feed(3.0, |i, _, one| if i == 30 {
                one.point.x = 0.4;
            })
            .1,
            None
        );
        let reason = feed(3.0, |i, _, one| {
            if i > 60 && i % 6 == 0 {
                one.point.x = 0.4;
            }
        })
        .1;
        assert!(matches!(reason, Some(Reason::TrackerLies(what)) if what.contains("jumps")));
    }

    #[test]
    fn bursts_of_points_without_stamps_of_their_own_are_no_jumps() {
        for (least_s, expected) in [(0.0, true), (1.0 / 60.0, false)] {
            let mut watch = MarbleWatch::new(config().tracker, config().timeouts, least_s);
            let stopped = (0..60).any(|i| {
                // Six at a time, 10 us apart.
                let at = f64::from(i / 6 * 6) / 60.0 + 1e-5 * f64::from(i % 6);
                let (moment, mut one) = point(at, 0.002 * f64::from(i));
                one.header.stamp = Time::from_nanos(moment.nanos);
                watch.take(moment, &one, true).is_err()
            });
            assert_eq!(stopped, expected, "{least_s}");
        }
    }

    #[test]
    fn a_frozen_picture_stops() {
        let reason = feed(4.0, |i, _, one| {
            if i > 30 {
                one.point.x = 0.25;
            }
        })
        .1;
        assert!(matches!(reason, Some(Reason::TrackerLies(what)) if what.contains("same place")));
    }

    #[test]
    fn a_flood_stops() {
        let reason = feed(30.0, |i, moment, one| {
            let (at, _) = point(i as f64 / 1500.0, 0.0);
            *moment = at;
            one.header.stamp = Time::from_nanos(at.nanos);
        })
        .1;
        assert!(
            matches!(reason, Some(Reason::TrackerLies(what)) if what.contains("points in a second"))
        );
    }

    #[test]
    fn numbers_that_are_none_and_stamps_that_are_wrong_do_not_count() {
        for change in [
            (|_, one| one.point.x = f64::NAN) as fn(i64, &mut PointStamped),
            |nanos, one| one.header.stamp = Time::from_nanos(nanos - 2_000_000_000),
            |nanos, one| one.header.stamp = Time::from_nanos(nanos + 2_000_000_000),
        ] {
            let (watch, reason) = feed(2.0, |i, moment, one| {
                if i > 60 {
                    change(moment.nanos, one);
                }
            });
            assert_eq!(reason, None);
            assert_eq!(watch.tally.refused, 59);
            assert!(watch.age_s(2.0) > 0.9);
        }
    }

    #[test]
    fn a_joint_is_followed_through_full_turns_but_not_through_jumps() {
        let mut watch = JointWatch::new(&config(), 0);
        let mut state = JointState {
            name: vec!["other".to_owned(), "left_j2s7s300_joint_7".to_owned()],
            ..JointState::default()
        };
        let mut take = |i: i64, angle: f64| {
            let moment = Moment {
                steady: i as f64 / 100.0,
                nanos: i * 10_000_000,
            };
            state.header.stamp = Time::from_nanos(moment.nanos);
            state.position = vec![0.0, angle];
            watch.take(moment, &state).map(|()| watch.angle())
        };
        assert_eq!(take(0, 3.1), Ok(Some(3.1)));
        let after = take(1, -3.18).expect("it went on").expect("it was seen");
        assert!((after - (TAU - 3.18)).abs() < 1e-12);
        assert!(matches!(take(2, -2.5), Err(Reason::JointsLie(_))));
    }
}
