//! Camera and estimator of another lab's rig: tilts, marble, its velocity, and the picture around it.

use std::collections::VecDeque;

use labsim::Scene;
use labsim::scene::CUT;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal, Uniform};

use super::painting::paint;
use crate::config::Twin;
use crate::error::{Error, Result};
use crate::labs::Seen;
use crate::model::Model;

/// Gains of the filter from place to velocity: of the place, and of its change from picture to picture.
const GAINS: [f64; 2] = [0.5, 0.17];

/// A jump that restarts the filter (m): a hand has put the marble elsewhere.
const JUMP_M: f64 = 0.05;

/// What the estimator reports of a picture.
#[derive(Debug, Clone)]
pub struct Sight {
    /// Tilts and marble.
    pub seen: Seen,
    /// The marble's velocity (m/s), of the filter.
    pub velocity: [f64; 2],
    /// The picture around the marble, [`CUT`] squared pixels from the top; black where it is lost.
    pub picture: Vec<[u8; 3]>,
}

/// Camera and estimator.
pub struct Eye {
    twin: Twin,
    edge_m: f64,
    scene: Scene,
    filter: Option<[[f64; 2]; 2]>,
    on_the_way: VecDeque<(f64, Sight)>,
    random: ChaCha8Rng,
}

impl Eye {
    /// Above a model's board.
    pub fn new(twin: &Twin, model: &Model, seed: u64) -> Self {
        Self {
            twin: *twin,
            edge_m: model.edges_m()[0],
            scene: paint(model),
            filter: None,
            on_the_way: VecDeque::new(),
            random: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// Takes a picture of a marble (board edges; NaN where there is none) on a board with these tilts (rad), at a time (s).
    ///
    /// # Errors
    /// [`Error::Broken`] for noise that is no number.
    pub fn look(&mut self, place: [f64; 2], tilts: [f64; 2], steady: f64) -> Result<()> {
        let twin = self.twin;
        let mut drawn = |deviation: f64| {
            Normal::new(0.0, deviation)
                .map(|normal| normal.sample(&mut self.random))
                .map_err(|error| Error::Broken(error.to_string()))
        };
        let delay = twin.delay_s + drawn(twin.delay_jitter_s)?;
        let tilts = [
            tilts[0] + drawn(twin.tilt_noise_rad)?,
            tilts[1] + drawn(twin.tilt_noise_rad)?,
        ];
        let mut place_m = [
            (place[0] + drawn(twin.noise)?) * self.edge_m,
            (place[1] + drawn(twin.noise)?) * self.edge_m,
        ];
        let sees = Uniform::new(0.0, 1.0).map_err(|error| Error::Broken(error.to_string()))?;
        if sees.sample(&mut self.random) < twin.lost {
            place_m = [f64::NAN; 2];
        }
        let seen = Seen { tilts, place_m };
        let mut picture = vec![[0; 3]; CUT * CUT];
        self.scene.cut(place_m, &mut picture);
        let sight = Sight {
            velocity: self.velocity(&seen),
            seen,
            picture,
        };
        // One picture does not overtake another.
        let last = self.on_the_way.back().map_or(0.0, |(due, _)| *due);
        let due = (steady + delay.max(0.0)).max(last);
        self.on_the_way.push_back((due, sight));
        Ok(())
    }

    /// The next picture whose estimate is there.
    pub fn due(&mut self, steady: f64) -> Option<Sight> {
        let (due, _) = self.on_the_way.front()?;
        if *due > steady {
            return None;
        }
        self.on_the_way.pop_front().map(|(_, sight)| sight)
    }

    /// The filter's velocity (m/s); while the marble is lost, the last one.
    fn velocity(&mut self, seen: &Seen) -> [f64; 2] {
        let hz = f64::from(self.twin.tracker_hz);
        let [place, rate] = self.filter.unwrap_or([seen.place_m, [0.0; 2]]);
        let ahead = [0, 1].map(|axis| place[axis] + rate[axis] / hz);
        if !seen.has_marble() {
            // A filter that has not begun does not begin here.
            self.filter = self.filter.map(|_| [ahead, rate]);
            return rate;
        }
        let off = [0, 1].map(|axis| seen.place_m[axis] - ahead[axis]);
        let next = if off[0].hypot(off[1]) > JUMP_M {
            [seen.place_m, [0.0; 2]]
        } else {
            [
                [0, 1].map(|axis| ahead[axis] + GAINS[0] * off[axis]),
                [0, 1].map(|axis| rate[axis] + GAINS[1] * hz * off[axis]),
            ]
        };
        self.filter = Some(next);
        next[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::tests::with;

    fn eye(twin: Twin) -> Eye {
        Eye::new(&twin, &with(""), 1)
    }

    fn at(tick: usize) -> f64 {
        tick as f64 / 60.0
    }

    #[test]
    fn a_velocity_is_found_and_kept_while_the_marble_is_lost() {
        let twin = Twin {
            noise: 0.0,
            lost: 0.0,
            delay_s: 0.0,
            delay_jitter_s: 0.0,
            ..Twin::default()
        };
        let mut eye = eye(twin);
        // 0.3 is the model's long edge (m).
        let mut velocity = [0.0; 2];
        for tick in 0..120 {
            let x = 0.1 * tick as f64 / 60.0 / 0.3;
            let place = if tick < 100 { [x, -0.1] } else { [f64::NAN; 2] };
            eye.look(place, [0.0; 2], at(tick)).expect("it is right");
            let sight = eye.due(at(tick)).expect("it has no delay");
            assert_eq!(sight.seen.has_marble(), tick < 100);
            assert_eq!(
                sight.picture.iter().all(|pixel| *pixel == [0; 3]),
                tick >= 100
            );
            velocity = sight.velocity;
        }
        assert!(
            (velocity[0] - 0.1).abs() < 1e-3 && velocity[1].abs() < 1e-9,
            "{velocity:?}"
        );
    }

    #[test]
    fn pictures_are_late_lost_and_noisy_as_configured() {
        let twin = Twin {
            lost: 0.2,
            noise: 0.002,
            ..Twin::default()
        };
        let mut eye = eye(twin);
        let (mut lost, mut squares, mut tilts, mut ages) = (0, 0.0, 0.0, 0.0);
        let count = 2000;
        for tick in 0..count {
            eye.look([0.1, 0.0], [0.05, 0.0], at(tick))
                .expect("it is right");
        }
        let mut found = 0;
        for tick in 0..8 * count + 99 {
            let now = tick as f64 / 480.0;
            while let Some(sight) = eye.due(now) {
                ages += now - at(found);
                found += 1;
                tilts += (sight.seen.tilts[0] - 0.05).powi(2);
                if sight.seen.has_marble() {
                    squares += (sight.seen.place_m[0] / 0.3 - 0.1).powi(2);
                } else {
                    lost += 1;
                }
            }
        }
        let n = count as f64;
        assert_eq!(found, count);
        assert!((f64::from(lost) / n - 0.2).abs() < 0.03, "{lost}");
        assert!(((squares / (n - f64::from(lost))).sqrt() - 0.002).abs() < 2e-4);
        assert!(((tilts / n).sqrt() - 0.0009).abs() < 1e-4);
        assert!((ages / n - 0.031).abs() < 0.001, "{}", ages / n);
    }
}
