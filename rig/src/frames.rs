//! `/tf`, `/tf_static` and `/robot_description` in bags, with which Foxglove and Rerun show board and marble in 3-D.
//!
//! Frames: `world`, `base` (the box, which stands still), `maze` (the board, tilted, with its origin at the centre of its
//! surface), `ball`.

use crate::messages::{
    Header, Quaternion, Text, TfMessage, Time, Transform, TransformStamped, Vector3,
};
use crate::recorder::{Channel, Recorder};

/// Thickness of the drawn board, and width and height of its rim (m).
const BOARD_M: f64 = 0.004;
const RIM_M: [f64; 2] = [0.005, 0.012];

/// Thickness and height of the sides of the drawn box, and their distance from the rim (m). They end at the level board's
/// surface, so that a tilt shows beside them.
const BOX_M: [f64; 2] = [0.008, 0.03];
const BOX_AWAY_M: f64 = 0.01;

/// Sizes to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Size {
    /// The board's edges along x and y (m).
    pub edges_m: [f64; 2],
    /// The marble's radius (m).
    pub radius_m: f64,
}

/// The channel of the frames.
pub struct Frames {
    channel: Channel,
    size: Size,
}

impl Frames {
    /// Records the description of a board at a time (ns since 1970).
    pub fn begin(recorder: &mut Recorder, size: Size, nanos: i64) -> Self {
        let description = recorder.channel::<Text>("/robot_description");
        let data = urdf(size);
        recorder.record(description, nanos, nanos, &Text { data });
        let fixed = recorder.channel::<TfMessage>("/tf_static");
        let transforms = vec![base(Time::from_nanos(nanos))];
        recorder.record(fixed, nanos, nanos, &TfMessage { transforms });
        Self {
            channel: recorder.channel::<TfMessage>("/tf"),
            size,
        }
    }

    /// Records the board's tilts about x and y (rad), heard at `log` (ns since 1970) and measured at `stamp`.
    pub fn board(&self, recorder: &Recorder, log: i64, stamp: Time, tilts: [f64; 2]) {
        self.record(recorder, log, board(stamp, tilts));
    }

    /// Records the marble's place (m from the board's centre); not where it is lost.
    pub fn marble(&self, recorder: &Recorder, log: i64, stamp: Time, place: [f64; 2]) {
        if place.iter().all(|value| value.is_finite()) {
            self.record(recorder, log, marble(stamp, place, self.size.radius_m));
        }
    }

    fn record(&self, recorder: &Recorder, log: i64, transform: TransformStamped) {
        let stamp = transform.header.stamp.nanos();
        let message = TfMessage {
            transforms: vec![transform],
        };
        recorder.record(self.channel, log, stamp, &message);
    }
}

/// The pose of the box's bottom in the world, whose origin is the board's centre.
fn base(stamp: Time) -> TransformStamped {
    let transform = Transform {
        translation: Vector3 {
            z: -BOX_M[1],
            ..Vector3::default()
        },
        rotation: Quaternion::default(),
    };
    named(stamp, ["world", "base"], transform)
}

/// The board's pose in the world at tilts about x and y (rad).
pub fn board(stamp: Time, tilts: [f64; 2]) -> TransformStamped {
    let ([sx, sy], [cx, cy]) = (
        tilts.map(|tilt| (0.5 * tilt).sin()),
        tilts.map(|tilt| (0.5 * tilt).cos()),
    );
    let rotation = Quaternion {
        x: sx * cy,
        y: cx * sy,
        z: sx * sy,
        w: cx * cy,
    };
    let transform = Transform {
        translation: Vector3::default(),
        rotation,
    };
    named(stamp, ["world", "maze"], transform)
}

/// The marble's pose on the board, at a place (m from its centre).
pub fn marble(stamp: Time, [x, y]: [f64; 2], radius_m: f64) -> TransformStamped {
    let transform = Transform {
        translation: Vector3 { x, y, z: radius_m },
        rotation: Quaternion::default(),
    };
    named(stamp, ["maze", "ball"], transform)
}

fn named(stamp: Time, [parent, child]: [&str; 2], transform: Transform) -> TransformStamped {
    TransformStamped {
        header: Header {
            stamp,
            frame_id: parent.to_owned(),
        },
        child_frame_id: child.to_owned(),
        transform,
    }
}

/// The description of box, board and marble. The joints of board and marble are free: their poses are those of `/tf`.
fn urdf(size: Size) -> String {
    let [rim, height] = RIM_M;
    let [x, y] = size.edges_m;
    let board = shape([x, y, BOARD_M], [0.0, 0.0, -BOARD_M / 2.0], "wood")
        + &sides([x, y], RIM_M, height / 2.0 - BOARD_M, "rim");
    let inner = [x, y].map(|edge| edge + 2.0 * (rim + BOX_AWAY_M));
    let sides = sides(inner, BOX_M, BOX_M[1] / 2.0, "rim");
    let (radius, down) = (size.radius_m, -BOX_M[1]);
    format!(
        "<?xml version=\"1.0\"?>\n<robot name=\"labyrinth\">\n\
         <material name=\"wood\"><color rgba=\"0.81 0.66 0.47 1\"/></material>\n\
         <material name=\"rim\"><color rgba=\"0.43 0.29 0.17 1\"/></material>\n\
         <material name=\"steel\"><color rgba=\"0.75 0.77 0.8 1\"/></material>\n\
         <link name=\"world\"/>\n<link name=\"base\">\n{sides}</link>\n<link name=\"maze\">\n{board}</link>\n\
         <link name=\"ball\"><visual><geometry><sphere radius=\"{radius}\"/></geometry><material name=\"steel\"/></visual></link>\n\
         <joint name=\"stand\" type=\"fixed\"><parent link=\"world\"/><child link=\"base\"/><origin xyz=\"0 0 {down}\"/></joint>\n\
         <joint name=\"tilt\" type=\"floating\"><parent link=\"world\"/><child link=\"maze\"/></joint>\n\
         <joint name=\"roll\" type=\"floating\"><parent link=\"maze\"/><child link=\"ball\"/><origin xyz=\"0 0 {radius}\"/></joint>\n\
         </robot>\n"
    )
}

/// Four sides about a rectangle of inner edges x and y, `thick` and `height` (m), with their middle at a height.
fn sides([x, y]: [f64; 2], [thick, height]: [f64; 2], up: f64, material: &str) -> String {
    let mut found = String::new();
    for side in [-1.0, 1.0] {
        let along_x = [x + 2.0 * thick, thick, height];
        let along_y = [thick, y, height];
        found += &shape(along_x, [0.0, side * (y + thick) / 2.0, up], material);
        found += &shape(along_y, [side * (x + thick) / 2.0, 0.0, up], material);
    }
    found
}

fn shape([x, y, z]: [f64; 3], [at_x, at_y, at_z]: [f64; 3], material: &str) -> String {
    format!(
        "<visual><origin xyz=\"{at_x} {at_y} {at_z}\"/><geometry><box size=\"{x} {y} {z}\"/></geometry><material name=\"{material}\"/></visual>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A vector of the board in the world.
    fn turned(q: Quaternion, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let (tx, ty, tz) = (
            2.0 * (q.y * z - q.z * y),
            2.0 * (q.z * x - q.x * z),
            2.0 * (q.x * y - q.y * x),
        );
        [
            x + q.w * tx + q.y * tz - q.z * ty,
            y + q.w * ty + q.z * tx - q.x * tz,
            z + q.w * tz + q.x * ty - q.y * tx,
        ]
    }

    #[test]
    fn tilts_follow_the_right_hand_rule() {
        let pose = |tilts| board(Time::default(), tilts).transform.rotation;
        // About x, the edge at +y rises; about y, the edge at +x sinks.
        let about_x = turned(pose([0.1, 0.0]), [0.0, 1.0, 0.0]);
        assert!((about_x[2] - 0.1_f64.sin()).abs() < 1e-12, "{about_x:?}");
        let about_y = turned(pose([0.0, 0.1]), [1.0, 0.0, 0.0]);
        assert!((about_y[2] + 0.1_f64.sin()).abs() < 1e-12, "{about_y:?}");
        let both = pose([0.1, -0.2]);
        let length = both.x.hypot(both.y).hypot(both.z).hypot(both.w);
        assert!((length - 1.0).abs() < 1e-12);
    }
}
