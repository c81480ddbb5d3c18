//! Messages of `CyberRunner` and of TAG, written from the published names and types of their fields.

use serde::{Deserialize, Serialize};

use super::{Header, Message};

/// State of board and marble, without a time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct StateEstimate {
    /// The marble's place along the long edge, from the board's centre (m); NaN where it is lost.
    pub x_b: f64,
    /// The same along the short edge (m).
    pub y_b: f64,
    /// Its velocity along the long edge (m/s).
    pub x_b_dot: f64,
    /// The same along the short edge (m/s).
    pub y_b_dot: f64,
    /// The board's rotation about y, with the opposite sign of the right-hand rule (rad).
    pub alpha: f64,
    /// The board's rotation about x (rad).
    pub beta: f64,
}

/// The same state in TAG's package.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct TagStateEstimate(pub StateEstimate);

/// A picture.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Image {
    /// When and by which camera it was taken.
    pub header: Header,
    /// Rows.
    pub height: u32,
    /// Pixels of a row.
    pub width: u32,
    /// Order and size of the channels.
    pub encoding: String,
    /// Whether numbers of several bytes begin with the highest.
    pub is_bigendian: u8,
    /// Bytes of a row.
    pub step: u32,
    /// The pixels, row by row from the top.
    pub data: Vec<u8>,
}

/// A state with the picture around the marble.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct StateEstimateSub {
    /// The state.
    pub state: StateEstimate,
    /// The picture, 64 x 64 pixels.
    pub subimg: Image,
}

/// Commands of both motors of a `CyberRunner`: currents in spite of the name.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct DynamixelVel {
    /// Of the motor that changes alpha (about 1 mA a unit).
    pub vel_1: f64,
    /// Of the motor that changes beta.
    pub vel_2: f64,
}

/// Commands of both servos of a TAG rig, in units of its own.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct HiwonderVel {
    /// Of the servo that changes beta.
    pub vel_1: f64,
    /// Of the servo that changes alpha.
    pub vel_2: f64,
}

/// Request of `DynamixelReset`: bring the board back to level.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResetRequest {
    /// Largest temperature of a motor (degrees); not used by its driver.
    pub max_temp: u16,
}

/// Response of `DynamixelReset`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResetResponse {
    /// 1 is success.
    pub success: i8,
}

ros2_messages!(ResetRequest, ResetResponse);

macro_rules! state {
    () => {
        "float64 x_b\nfloat64 y_b\nfloat64 x_b_dot\nfloat64 y_b_dot\nfloat64 alpha\nfloat64 beta\n"
    };
}

messages! {
    StateEstimate in "cyberrunner_interfaces": state!();
    StateEstimateSub in "cyberrunner_interfaces":
        "cyberrunner_interfaces/StateEstimate state\nsensor_msgs/Image subimg\n",
        part!("cyberrunner_interfaces/StateEstimate", ""), state!(),
        part!("sensor_msgs/Image",
            "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n"),
        header!();
    DynamixelVel in "cyberrunner_interfaces": "float64 vel_1\nfloat64 vel_2\n";
    HiwonderVel in "tag_interfaces": "float64 vel_1\nfloat64 vel_2\n";
}

impl Message for TagStateEstimate {
    const PACKAGE: &'static str = "tag_interfaces";
    const NAME: &'static str = "StateEstimate";
    const DEFINITION: &'static str = state!();
}

#[cfg(test)]
mod tests {
    use byteorder::LittleEndian;
    use proptest::prelude::*;

    use super::super::{TfMessage, Time, Transform, TransformStamped, Vector3, to_cdr};
    use super::*;

    fn again<M: Message>(message: &M) -> M {
        let bytes = to_cdr(message).expect("it can be written");
        let (read, used) =
            cdr_encoding::from_bytes::<M, LittleEndian>(&bytes[4..]).expect("it can be read");
        assert_eq!(used, bytes.len() - 4, "every byte is read");
        read
    }

    prop_compose! {
        fn states()(numbers in prop::array::uniform6(prop::num::f64::NORMAL | prop::num::f64::ZERO)) -> StateEstimate {
            let [x_b, y_b, x_b_dot, y_b_dot, alpha, beta] = numbers;
            StateEstimate { x_b, y_b, x_b_dot, y_b_dot, alpha, beta }
        }
    }

    proptest! {
        #[test]
        fn messages_are_read_as_they_were_written(
            state in states(),
            frame in "[a-z_]{0,9}",
            (sec, nanosec) in (any::<i32>(), 0_u32..1_000_000_000),
            data in prop::collection::vec(any::<u8>(), 0..70),
            (vel_1, vel_2) in (-300.0..300.0, -300.0..300.0),
        ) {
            let header = Header { stamp: Time { sec, nanosec }, frame_id: frame.clone() };
            let subimg = Image {
                header: header.clone(),
                height: 1,
                width: data.len() as u32,
                encoding: frame.clone(),
                is_bigendian: 0,
                step: data.len() as u32,
                data,
            };
            let sub = StateEstimateSub { state, subimg };
            prop_assert_eq!(again(&sub), sub);
            prop_assert_eq!(again(&TagStateEstimate(state)), TagStateEstimate(state));
            prop_assert_eq!(again(&DynamixelVel { vel_1, vel_2 }), DynamixelVel { vel_1, vel_2 });
            let transforms = vec![TransformStamped {
                header,
                child_frame_id: frame,
                transform: Transform {
                    translation: Vector3 { x: vel_1, y: vel_2, z: state.beta },
                    ..Transform::default()
                },
            }];
            prop_assert_eq!(again(&TfMessage { transforms: transforms.clone() }), TfMessage { transforms });
        }
    }

    #[test]
    fn a_lost_marble_stays_no_number() {
        let state = StateEstimate {
            x_b: f64::NAN,
            ..StateEstimate::default()
        };
        assert!(again(&state).x_b.is_nan());
    }
}
