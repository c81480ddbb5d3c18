//! Forces at the rim.

use labsim::Rig;
use labsim::board::GRAVITY;
use proptest::prelude::*;

use super::unlisted::unlisted;
use super::{ENGINES, ROW, Trial, assert_close};

/// Farthest place of a marble's centre along x and along y (m).
fn reach() -> [f64; 2] {
    Rig::default().reach_m()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn a_rim_brakes_a_marble_that_rolls_along_it(brake in 0.0..0.03_f64, drag in 0.5..6.0_f64, far: bool) {
        let (speed, side) = (0.08, if far { 1.0 } else { -1.0 });
        let named = [("rim_brake_m_per_s2", brake), ("rim_drag_per_s", drag)];
        let rows = 8;
        let ends = f64::ln(1.0 + speed * drag / brake) / drag;
        let way = |t: f64| {
            let t = t.min(ends);
            (speed + brake / drag) * (1.0 - f64::exp(-drag * t)) / drag - brake / drag * t
        };
        for (engine, _) in ENGINES {
            let along_x = Trial { start: [-0.06, side * reach()[1]], velocity: [speed, 0.0], ..Trial::level(rows) };
            let path = unlisted(along_x, &named).run(engine);
            for (row, place) in path.iter().enumerate() {
                assert_close(place[0] + 0.06, way(ROW * row as f64), 4e-4, &format!("row {row} in {engine:?}"));
            }
            // Away from the rim nothing of it acts.
            let inside = Trial { start: [-0.06, 0.05], velocity: [speed, 0.0], ..Trial::level(rows) };
            prop_assert_eq!(unlisted(inside.clone(), &named).run(engine), inside.run(engine));
        }
    }

    #[test]
    fn a_rim_holds_back_a_marble_as_far_as_it_can(hold in 0.02..0.3_f64, less in 0.1..0.9_f64, far: bool) {
        let side = if far { 1.0 } else { -1.0 };
        let at = |pull: f64| vec![[0.0, -side * pull / (5.0 / 7.0 * GRAVITY)]; 5];
        for (engine, _) in ENGINES {
            let trial = |pull: f64| {
                let pulled = Trial { start: [side * reach()[0], 0.0], ..Trial::of(at(pull)) };
                unlisted(pulled, &[("rim_hold_m_per_s2", hold)]).run(engine)
            };
            let path = trial(less * hold);
            assert_close(path[4][0], side * reach()[0], 2e-5, &format!("it is held in {engine:?}"));
            // A stronger pull is less what holds, over the fifth of a millimetre in which the marble touches.
            let path = trial((1.0 + less) * hold);
            let way = side * (reach()[0] * side - path[4][0]);
            let free = 0.5 * (1.0 + less) * hold * (4.0 * ROW).powi(2);
            prop_assert!(way > 0.5 * less / (1.0 + less) * free - 1e-4 && way < free, "{way} of {free} in {engine:?}");
        }
    }
}
