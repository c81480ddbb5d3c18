//! What comes over the network: messages of all types, and lines of JSON.

use byteorder::{BigEndian, LittleEndian};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::fuzz;
use crate::config::{Config, EXAMPLE};
use crate::labs::Seen;
use crate::labs::lines::{Line, Lines, Request, answered, observation, refusal};
use crate::messages::{
    Bool, DynamixelVel, Float64MultiArray, FollowGoal, FollowResult, Header, HiwonderVel, Image,
    JointState, JointTolerance, JointTrajectory, JointTrajectoryPoint, JointVelocity, Log,
    MultiArrayDimension, MultiArrayLayout, Point, PointStamped, ResetRequest, ResetResponse,
    StateEstimate, StateEstimateSub, TagStateEstimate, Text, TfMessage, Time, TransformStamped,
    TriggerRequest, TriggerResponse,
};
use crate::twin::wrist::Wrist;
use crate::watch::{JointWatch, MarbleWatch, Moment};

/// A moment, and stamps of it.
const NOW: Moment = Moment {
    steady: 10.0,
    nanos: 1_700_000_000_000_000_000,
};

fn header() -> Header {
    Header {
        stamp: Time::from_nanos(NOW.nanos),
        frame_id: "board".to_owned(),
    }
}

fn trajectory() -> JointTrajectory {
    let point = JointTrajectoryPoint {
        positions: vec![0.1],
        velocities: vec![0.0],
        time_from_start: Time::from_seconds(0.02),
        ..JointTrajectoryPoint::default()
    };
    JointTrajectory {
        header: header(),
        joint_names: vec![config().arms.x.joint],
        points: vec![
            point.clone(),
            JointTrajectoryPoint {
                time_from_start: Time::from_seconds(0.1),
                ..point
            },
        ],
    }
}

fn config() -> Config {
    toml::from_str(EXAMPLE).expect("the example is right")
}

/// Reads changed bytes of a message in both byte orders; what can be read is taken, and can be written again.
fn message<M: Serialize + DeserializeOwned + std::fmt::Debug>(seed: &M, take: impl Fn(M)) {
    let bytes = cdr_encoding::to_vec::<M, LittleEndian>(seed).expect("it can be written");
    let name = std::any::type_name::<M>().rsplit("::").next();
    fuzz(name.expect("it has a name"), &[bytes], |bytes| {
        if let Ok((read, used)) = cdr_encoding::from_bytes::<M, BigEndian>(bytes) {
            assert!(used <= bytes.len());
            take(read);
        }
        if let Ok((read, used)) = cdr_encoding::from_bytes::<M, LittleEndian>(bytes) {
            assert!(used <= bytes.len());
            let again = cdr_encoding::to_vec::<M, LittleEndian>(&read).expect("it can be written");
            // Strings get the end that a message may lack.
            assert!(again.len() < 4 * bytes.len() + 64);
            take(read);
        }
    });
}

#[test]
fn points_of_a_marble() {
    let seed = PointStamped {
        header: header(),
        point: Point {
            x: 0.1,
            y: -0.2,
            z: 0.0,
        },
    };
    let config = config();
    message(&seed, |read| {
        let mut watch = MarbleWatch::new(config.tracker.clone(), config.timeouts, 0.0);
        let _ = watch.take(NOW, &seed, true);
        let later = Moment {
            steady: NOW.steady + 0.02,
            nanos: NOW.nanos + 20_000_000,
        };
        let _ = watch.take(later, &read, true);
        let place = watch.position().expect("the first was right");
        assert!(place.iter().all(|value| value.is_finite()) && watch.age_s(later.steady) >= 0.0);
    });
}

#[test]
fn states_of_joints() {
    let config = config();
    let seed = JointState {
        header: header(),
        name: vec!["other".to_owned(), config.arms.x.joint.clone()],
        position: vec![0.0, 0.3],
        velocity: vec![0.0, 0.1],
        effort: Vec::new(),
    };
    message(&seed, |read| {
        let mut watch = JointWatch::new(&config, 0);
        let _ = watch.take(NOW, &seed);
        let later = Moment {
            steady: NOW.steady + 0.01,
            nanos: NOW.nanos + 10_000_000,
        };
        let _ = watch.take(later, &read);
        assert!(watch.angle().is_some_and(f64::is_finite) && watch.age_s(later.steady) >= 0.0);
    });
}

/// A joint turns no faster than it can, and its angle stays a number.
fn turns(take: impl Fn(&mut Wrist)) {
    let mut wrist = Wrist::at_level(&config().arms.x);
    let mut before = wrist.step(NOW.steady, 0.01, 0.8);
    take(&mut wrist);
    for tick in 1..5 {
        let angle = wrist.step(NOW.steady + 0.01 * f64::from(tick), 0.01, 0.8);
        assert!((angle - before).abs() <= 0.0081, "{before} to {angle}");
        before = angle;
    }
}

#[test]
fn trajectories() {
    message(&trajectory(), |read| {
        turns(|wrist| {
            wrist.follow(&read, NOW.steady);
        });
    });
}

#[test]
fn rates_of_joints() {
    let dim = vec![MultiArrayDimension {
        label: "joints".to_owned(),
        size: 7,
        stride: 7,
    }];
    let seed = Float64MultiArray {
        layout: MultiArrayLayout {
            dim,
            data_offset: 0,
        },
        data: vec![0.1; 7],
    };
    message(&seed, |read| {
        turns(|wrist| wrist.turn(&read, NOW.steady + 0.1));
    });
    message(&JointVelocity::of(7, 3.0), |read| {
        turns(|wrist| wrist.queue(&read));
    });
}

#[test]
fn goals_and_results() {
    let tolerance = JointTolerance {
        name: "a".to_owned(),
        ..JointTolerance::default()
    };
    let goal = FollowGoal {
        trajectory: trajectory(),
        path_tolerance: vec![tolerance.clone()],
        goal_tolerance: vec![tolerance],
        component_path_tolerance: vec!["b".to_owned()],
        ..FollowGoal::default()
    };
    message(&goal, |read| {
        turns(|wrist| {
            wrist.follow(&read.trajectory, NOW.steady);
        });
    });
    message(
        &FollowResult {
            error_code: 1,
            error_string: "late".to_owned(),
        },
        drop,
    );
}

#[test]
fn other_labs_messages() {
    let state = StateEstimate {
        x_b: 0.05,
        y_b: -0.02,
        alpha: 0.01,
        beta: -0.01,
        ..StateEstimate::default()
    };
    let subimg = Image {
        header: header(),
        height: 2,
        width: 2,
        encoding: "mono8".to_owned(),
        step: 2,
        data: vec![7; 4],
        ..Image::default()
    };
    let seen = |state: &StateEstimate| {
        let seen = Seen::from(state);
        assert_eq!(
            seen.has_marble(),
            seen.place_m.iter().all(|one| one.is_finite())
        );
    };
    message(&StateEstimateSub { state, subimg }, |read| {
        seen(&read.state);
    });
    message(&TagStateEstimate(state), |read| seen(&read.0));
    message(
        &DynamixelVel {
            vel_1: 10.0,
            vel_2: -10.0,
        },
        drop,
    );
    message(
        &HiwonderVel {
            vel_1: 10.0,
            vel_2: -10.0,
        },
        drop,
    );
}

#[test]
fn services_and_the_rest() {
    message(&TriggerRequest::default(), drop);
    message(
        &TriggerResponse {
            success: true,
            message: "stopping".to_owned(),
        },
        drop,
    );
    message(&ResetRequest { max_temp: 80 }, drop);
    message(&ResetResponse { success: 1 }, drop);
    message(&Bool { data: true }, drop);
    message(
        &Log {
            stamp: header().stamp,
            level: 20,
            msg: "begin".to_owned(),
            ..Log::default()
        },
        drop,
    );
    message(
        &Text {
            data: "<robot/>".to_owned(),
        },
        drop,
    );
    let transforms = vec![TransformStamped {
        header: header(),
        child_frame_id: "marble".to_owned(),
        ..TransformStamped::default()
    }];
    message(&TfMessage { transforms }, drop);
}

#[test]
fn requests_and_answers_in_json() {
    let seen = Seen {
        tilts: [0.01, -0.02],
        place_m: [0.05, 0.06],
    };
    let mut seeds: Vec<Vec<u8>> = [
        Request::Obs,
        Request::Reset,
        Request::Action([1.0, -2.0]),
        Request::Step([0.5, 3.0], 0.018),
    ]
    .iter()
    .map(|request| request.line().into_bytes())
    .collect();
    seeds.push(observation(&seen, &[7; 16]).into_bytes());
    fuzz("lines of JSON", &seeds, |bytes| {
        let mut lines = Lines::default();
        let found = bytes.chunks(100).flat_map(|part| lines.take(part));
        for line in found {
            let Line::Whole(line) = line else { continue };
            match Request::parse(&line) {
                Ok(Request::Action(both) | Request::Step(both, _)) => {
                    assert!(both.iter().all(|one| one.is_finite()), "{both:?}");
                }
                Ok(Request::Obs | Request::Reset) => (),
                Err(error) => assert_eq!(refusal(&error).matches('\n').count(), 1),
            }
            if let Err(error) = answered(&line) {
                assert!(!error.contains('\n'));
            }
        }
    });
}
