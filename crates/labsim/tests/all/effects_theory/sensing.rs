//! What the camera makes of where the marble is, in board edges.

use labsim::Engine;
use nalgebra::{Rotation3, Unit, Vector3};
use proptest::prelude::*;

use super::{EDGE, ENGINES, Trial, angles, assert_close};

type Place = [f64; 2];

fn perspective([x, y]: Place, [px, py]: [f64; 2]) -> Place {
    let distance = 1.0 + px * x + py * y;
    [x / distance, y / distance]
}

/// What a pinhole sees at distance `d` (edges) from the board's centre after a turn about a horizontal axis, so that
/// distances grow by `p` per edge; scaled so that the centre keeps its scale.
fn through_a_tilted_pinhole([x, y]: Place, p: [f64; 2], d: f64) -> Place {
    // The camera looks along -z, turned about `axis`; its own axes turn with it.
    let sines = p.map(|slope| d * slope);
    let sine = sines[0].hypot(sines[1]);
    let axis = Unit::new_normalize(Vector3::new(sines[1], -sines[0], 0.0));
    let camera = Rotation3::from_axis_angle(&axis, sine.asin());
    let eye = camera * Vector3::new(0.0, 0.0, d);
    let point = camera.inverse() * (Vector3::new(x, y, 0.0) - eye);
    [0, 1].map(|i| d * point[i] / -point.z)
}

fn distorted([x, y]: Place, k: f64) -> Place {
    let scale = 1.0 + k * (x * x + y * y);
    [x * scale, y * scale]
}

fn rotated([x, y]: Place, angle: f64) -> Place {
    let (sin, cos) = angle.sin_cos();
    [x * cos - y * sin, x * sin + y * cos]
}

/// Rolls a marble over a tilted board from `place` at `velocity` (edges, edges/s), and once more with the observed
/// start state; compares the observed path with the map of the true one.
fn assert_seen(
    effects: &[(&'static str, &[f64])],
    place: Place,
    velocity: [f64; 2],
    map: impl Fn(Place) -> Place,
) {
    let at = |t: f64| map([place[0] + t * velocity[0], place[1] + t * velocity[1]]);
    let (ahead, behind) = (at(1e-5), at(-1e-5));
    let seen_velocity = [0, 1].map(|axis| (ahead[axis] - behind[axis]) / 2e-5);
    let rolls = |start: Place, velocity: [f64; 2]| Trial {
        start: start.map(|x| x * EDGE),
        velocity: velocity.map(|v| v * EDGE),
        ..Trial::of(vec![[0.003, 0.004]; 10])
    };
    for (engine, _) in ENGINES {
        let plain = rolls(place, velocity).run(engine);
        let trial = effects
            .iter()
            .fold(rolls(map(place), seen_velocity), |trial, (name, values)| {
                trial.with(name, values)
            });
        let path = trial.run(engine);
        let start = trial.start.map(|x| x / EDGE * EDGE);
        assert_eq!(path[0], start, "row 0 is the start");
        for (row, (seen, place)) in path.iter().zip(&plain).enumerate() {
            let expected = map(place.map(|x| x / EDGE));
            for axis in 0..2 {
                let what = format!("{effects:?}, row {row} in {engine:?}");
                assert_close(seen[axis] / EDGE, expected[axis], 1e-8, &what);
            }
        }
    }
}

prop_compose! {
    fn slope()(pair in prop::array::uniform2(-0.3..0.3)) -> [f64; 2] { pair }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn perspective_divides_by_the_distance(
        slope in slope(), place in prop::array::uniform2(-0.2..0.2), velocity in prop::array::uniform2(-0.15..0.15),
    ) {
        assert_seen(&[("perspective", &[slope[0], slope[1], 0.0])], place, velocity, |seen| perspective(seen, slope));
    }

    #[test]
    fn a_tilted_pinhole_foreshortens(
        slope in slope(), d in 0.5..2.0_f64,
        place in prop::array::uniform2(-0.2..0.2), velocity in prop::array::uniform2(-0.15..0.15),
    ) {
        let values = [slope[0], slope[1], d];
        assert_seen(&[("perspective", &values)], place, velocity, |seen| through_a_tilted_pinhole(seen, slope, d));
    }

    #[test]
    fn a_lens_distorts_by_the_square_of_the_distance(
        k in -0.5..0.5_f64, place in prop::array::uniform2(-0.2..0.2), velocity in prop::array::uniform2(-0.15..0.15),
    ) {
        assert_seen(&[("lens_distortion", &[k])], place, velocity, |seen| distorted(seen, k));
    }

    #[test]
    fn a_turned_camera_turns_the_picture(
        angle in -0.1745..0.1745_f64, place in prop::array::uniform2(-0.2..0.2), velocity in prop::array::uniform2(-0.15..0.15),
    ) {
        assert_seen(&[("camera_rotation", &[angle])], place, velocity, |seen| rotated(seen, angle));
    }

    #[test]
    fn the_cameras_faults_follow_one_another(
        slope in slope(), k in -0.4..0.4_f64, angle in -0.17..0.17_f64, offset in prop::array::uniform2(-0.1..0.1),
        place in prop::array::uniform2(-0.2..0.2), velocity in prop::array::uniform2(-0.15..0.15),
    ) {
        let effects: [(&'static str, &[f64]); 4] = [
            ("camera_offset", &offset),
            ("camera_rotation", &[angle]),
            ("lens_distortion", &[k]),
            ("perspective", &[slope[0], slope[1], 0.0]),
        ];
        assert_seen(&effects, place, velocity, |seen| {
            let [x, y] = rotated(distorted(perspective(seen, slope), k), angle);
            [x + offset[0], y + offset[1]]
        });
    }

    #[test]
    fn parallax_shows_the_tilt_before_the_marble_moves(x in -0.12..0.12_f64, y in -0.12..0.12_f64, height in -0.6..0.6_f64) {
        for (engine, _) in ENGINES {
            // `angles` shows an edge for each radian; this height comes on top.
            let seen = angles(engine, &[("parallax", &[height])], vec![[x, y]; 2])[1];
            let per_rad = 1.0 + height / EDGE;
            let within = if engine == Engine::Rolling { 1e-12 } else { 1e-5 };
            assert_close(seen[0], per_rad * x, within, "about x");
            assert_close(seen[1], per_rad * y, within, "about y");
        }
    }
}

#[test]
fn with_an_offset_the_rims_are_seen_shifted() {
    for (engine, _) in ENGINES {
        for side in [-1.0, 1.0] {
            let trial = Trial {
                velocity: [0.2 * side, 0.0],
                ..Trial::level(30)
            };
            let reach = trial.rig.reach_m()[0];
            let path = trial.with("camera_offset", &[0.05, 0.0]).run(engine);
            assert_close(
                path[29][0],
                side * reach + 0.05 * EDGE,
                1e-5,
                &format!("{engine:?}"),
            );
        }
    }
}

#[test]
fn a_picture_that_no_place_gives_starts_the_marble_somewhere_on_the_board() {
    // A barrel of -0.5 shows nothing that far out in a direction; nor does a perspective behind the camera.
    for effect in [
        ("lens_distortion", vec![-0.6]),
        ("perspective", vec![0.9, 0.9]),
    ] {
        for (engine, _) in ENGINES {
            let trial = Trial {
                start: [5.0 * EDGE, -5.0 * EDGE],
                velocity: [0.1, 0.1],
                ..Trial::level(10)
            };
            let path = trial.with(effect.0, &effect.1).run(engine);
            assert!(
                path.as_flattened().iter().all(|x| x.is_finite()),
                "{effect:?} in {engine:?}"
            );
        }
    }
}
