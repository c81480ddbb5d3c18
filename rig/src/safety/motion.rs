//! One joint's set point, which never leaves its limits.

use crate::config::TICK_S;

/// Limits of a joint, in its own angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Lowest angle (rad).
    pub low: f64,
    /// Highest angle (rad).
    pub high: f64,
    /// Largest rate (rad/s).
    pub velocity: f64,
    /// Largest change of the rate (rad/s²).
    pub acceleration: f64,
    /// Largest step between set points (rad).
    pub step: f64,
}

/// A joint's set point.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SetPoint {
    /// Target angle of the joint (rad).
    pub position: f64,
    /// Rate of the set point (rad/s).
    pub velocity: f64,
    /// Rate for joints that take rates (rad/s): the velocity plus the position feedback.
    pub rate: f64,
}

/// The largest rate in this tick from which a uniform slow-down comes to rest within a distance.
///
/// Slowing by h = a dt a tick from v takes n ticks and covers dt (n v - h n (n - 1) / 2).
fn approach(distance: f64, acceleration: f64) -> f64 {
    if distance <= 0.0 {
        return 0.0;
    }
    let h = acceleration * TICK_S;
    let steps = distance / TICK_S / h;
    let n = (0.5 + (0.25 + 2.0 * steps).sqrt()).floor();
    (steps * h + h * n * (n - 1.0) / 2.0) / n
}

impl SetPoint {
    /// At rest.
    pub fn at(position: f64) -> Self {
        Self {
            position,
            velocity: 0.0,
            rate: 0.0,
        }
    }

    /// The next set point on the way to a target, no faster than `fastest`; at `None` it comes to rest.
    ///
    /// NaN counts as no target.
    pub fn next(self, target: Option<f64>, fastest: f64, bounds: &Bounds) -> Self {
        let most = bounds.velocity.min(bounds.step / TICK_S);
        let wanted = match target {
            Some(target) if target.is_finite() => {
                let way = target.clamp(bounds.low, bounds.high) - self.position;
                way.signum() * approach(way.abs(), bounds.acceleration).min(fastest)
            }
            _ => 0.0,
        };
        let velocity = self.velocity + slewed(wanted - self.velocity, bounds);
        let up = approach(bounds.high - self.position, bounds.acceleration);
        let down = approach(self.position - bounds.low, bounds.acceleration);
        let velocity = velocity.clamp(-most.min(down), most.min(up));
        Self {
            position: (self.position + velocity * TICK_S).clamp(bounds.low, bounds.high),
            velocity,
            rate: self.rate,
        }
    }

    /// Adds the rate for a joint at a measured angle; without one the rate comes to rest.
    pub fn with_rate(mut self, measured: Option<f64>, gain: f64, bounds: &Bounds) -> Self {
        let last = self.rate;
        let wanted = match measured {
            Some(measured) if measured.is_finite() => {
                let wanted = self.velocity + gain * (self.position - measured);
                // A joint at the end of its window moves no further.
                let up = approach(bounds.high - measured, bounds.acceleration);
                let down = approach(measured - bounds.low, bounds.acceleration);
                wanted.clamp(-down, up)
            }
            _ => 0.0,
        };
        let rate = last + slewed(wanted - last, bounds);
        self.rate = rate.clamp(-bounds.velocity, bounds.velocity);
        self
    }

    /// Whether neither it nor its rate moves.
    pub fn is_at_rest(self) -> bool {
        self.velocity == 0.0 && self.rate == 0.0
    }
}

/// A change of rate, limited to that of one tick.
fn slewed(change: f64, bounds: &Bounds) -> f64 {
    let most = bounds.acceleration * TICK_S;
    change.clamp(-most, most)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TINY: f64 = 1e-9;

    fn targets() -> impl Strategy<Value = Vec<Option<f64>>> {
        let wild = prop_oneof![
            8 => (-4.0..4.0).prop_map(Some),
            1 => Just(Some(f64::NAN)),
            1 => Just(Some(f64::INFINITY)),
            1 => Just(None),
        ];
        let held = (wild, 1_usize..60).prop_map(|(target, ticks)| vec![target; ticks]);
        prop::collection::vec(held, 1..20).prop_map(|runs| runs.concat())
    }

    proptest! {
        /// No target moves a set point out of window, velocity, acceleration or step.
        #[test]
        fn set_points_stay_within_all_limits(
            targets in targets(),
            (low, high) in (-1.0..-0.01, 0.01..1.0),
            (velocity, acceleration) in (0.01..0.8, 0.5..20.0),
            measured in prop::collection::vec(prop_oneof![9 => -1.5..1.5, 1 => Just(f64::NAN)], 1..40),
        ) {
            let bounds = Bounds { low, high, velocity, acceleration, step: 0.6 * velocity * TICK_S };
            let mut last = SetPoint::at(0.0);
            for (i, target) in targets.into_iter().enumerate() {
                let seen = measured[i % measured.len()];
                let next = last.next(target, velocity, &bounds).with_rate(Some(seen), 2.0, &bounds);
                prop_assert!(next.position >= low && next.position <= high);
                prop_assert!(next.velocity.abs() <= velocity && next.rate.abs() <= velocity);
                prop_assert!((next.velocity - last.velocity).abs() <= acceleration * TICK_S + TINY);
                prop_assert!((next.rate - last.rate).abs() <= acceleration * TICK_S + TINY);
                prop_assert!((next.position - last.position).abs() <= bounds.step + TINY);
                prop_assert!((next.position - last.position - next.velocity * TICK_S).abs() <= TINY);
                last = next;
            }
        }

        /// Within the window a target is reached, and not overshot.
        #[test]
        fn a_target_is_reached(target in -0.5..0.5) {
            let bounds = Bounds { low: -0.6, high: 0.6, velocity: 0.35, acceleration: 4.0, step: 0.005 };
            let mut point = SetPoint::at(0.0);
            for _ in 0..300 {
                point = point.next(Some(target), 0.35, &bounds);
                prop_assert!(point.position.abs() <= target.abs() + TINY);
            }
            prop_assert!((point.position - target).abs() < 1e-6);
        }
    }
}
