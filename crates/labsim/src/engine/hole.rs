//! A marble over a hole: a sphere in three dimensions that rolls and slips on the hole's edge.
//!
//! What carries the marble is the nearest place of the board: beneath its centre, or where that is over a
//! hole, the hole's edge, about which it tips. Its push against it is inelastic, as the board's, and Coulomb's
//! friction acts there, so that a slow marble pivots over the edge, leaves it where its weight no longer presses
//! it there (at cos φ = 10/17 from rest, if it does not slip) and falls; a fast one flies, and meets the far edge.
//! One whose centre is below the board has fallen.
//!
//! A substep is cut into parts in which a marble moves by a fiftieth of its radius. Walls and rims are met on
//! the way; each marble is computed by itself, in the same order of operations on every machine.

use crate::engine::obstacles::{Obstacles, TOUCH_M};
use crate::motion::Restitution;

/// Parts of a substep: at least so many, and as many as it takes to move by this many radii in each.
const LEAST_PARTS: f64 = 4.0;
const STEP: f64 = 0.02;

/// A marble this fast (m/s) falls by less than a ten-thousandth of its radius while it crosses a hole.
pub(crate) const FLIES_M_S: f64 = 40.0;

/// A marble in three dimensions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sphere {
    /// Its centre, the height above the board (m).
    pub(crate) place: [f64; 3],
    /// m/s
    pub(crate) velocity: [f64; 3],
    /// Radius × angular velocity (m/s).
    pub(crate) spin: [f64; 3],
}

/// What acts on it in a substep.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Around<'a> {
    pub(crate) obstacles: &'a Obstacles,
    /// Of the marble (m).
    pub(crate) radius: f64,
    /// How far from the board's centre a marble's centre can get (m).
    pub(crate) reach: [f64; 2],
    /// Restitution of walls and rims.
    pub(crate) restitution: Restitution<f64>,
    /// Coulomb's coefficients, of walls and rims and of the board.
    pub(crate) wall_friction: f64,
    pub(crate) sliding_friction: f64,
    /// Acceleration (m/s²).
    pub(crate) pull: [f64; 3],
    /// Length of the substep (s).
    pub(crate) length: f64,
}

/// Where a marble is after a substep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum After {
    /// On the board, or above it on its way there.
    OnBoard,
    /// Its centre is over a hole.
    OverHole,
    /// It fell through the hole of this number.
    Fallen(usize),
}

/// What a contact does.
#[derive(Debug, Clone, Copy)]
struct Contact {
    /// From the contact to the marble's centre, of length 1.
    normal: [f64; 3],
    /// m
    gap: f64,
    restitution: Option<Restitution<f64>>,
    friction: f64,
}

/// Moves a marble by a substep.
pub(crate) fn pass(marble: &mut Sphere, around: &Around<'_>) -> After {
    let speed = norm(marble.velocity) + norm(around.pull) * around.length;
    let parts = (speed * around.length / (STEP * around.radius)).max(LEAST_PARTS);
    let parts = parts.ceil();
    let length = around.length / parts;
    for _ in 0..parts as u64 {
        for axis in 0..3 {
            marble.velocity[axis] += around.pull[axis] * length;
        }
        carry(marble, around, length);
        keep_inside(marble, around, length);
        if marble.place[2] <= 0.0 {
            let [x, y, _] = marble.place;
            let nearest = over(around, [x, y]).unwrap_or_default().0;
            return After::Fallen(nearest);
        }
    }
    match over(around, [marble.place[0], marble.place[1]]) {
        Some((_, _, distance)) if distance < around.obstacles.hole_radius => After::OverHole,
        _ => After::OnBoard,
    }
}

/// The hole whose centre is nearest to a place: its number, and from its centre the direction and the distance.
fn over(around: &Around<'_>, place: [f64; 2]) -> Option<(usize, [f64; 2], f64)> {
    let near = &around.obstacles.near(place).holes;
    let from = near.iter().map(|&number| {
        let hole = around.obstacles.holes[number];
        let [x, y] = [place[0] - hole[0], place[1] - hole[1]];
        let distance = (x * x + y * y).sqrt();
        let direction = if distance > 0.0 {
            [x / distance, y / distance]
        } else {
            [1.0, 0.0]
        };
        (number, direction, distance)
    });
    from.min_by(|a, b| a.2.total_cmp(&b.2))
}

/// The board, or the edge of a hole, beneath the marble.
fn carry(marble: &mut Sphere, around: &Around<'_>, length: f64) {
    let [x, y, height] = marble.place;
    let (normal, distance) = match over(around, [x, y]) {
        Some((_, [ux, uy], from)) if from < around.obstacles.hole_radius => {
            let off = from - around.obstacles.hole_radius;
            let distance = (off * off + height * height).sqrt();
            let normal = [ux * off / distance, uy * off / distance, height / distance];
            (normal, distance)
        }
        _ => ([0.0, 0.0, 1.0], height),
    };
    let board = Contact {
        normal,
        gap: distance - around.radius,
        restitution: None,
        friction: around.sliding_friction,
    };
    push(marble, &board, length);
}

/// Walls and rims; then the marble moves.
fn keep_inside(marble: &mut Sphere, around: &Around<'_>, length: f64) {
    let wall = |normal: [f64; 2], gap: f64| Contact {
        normal: [normal[0], normal[1], 0.0],
        gap,
        restitution: (gap > TOUCH_M).then_some(around.restitution),
        friction: around.wall_friction,
    };
    let [x, y, _] = marble.place;
    let walls = &around.obstacles.near([x, y]).walls;
    for &number in walls {
        let (normal, gap) = around.obstacles.gap(number, [x, y]);
        push(marble, &wall(normal, gap), length);
    }
    for axis in 0..2 {
        let side = 1.0_f64.copysign(marble.place[axis]);
        let mut normal = [0.0; 2];
        normal[axis] = -side;
        let gap = around.reach[axis] - side * marble.place[axis];
        push(marble, &wall(normal, gap), length);
    }
    for axis in 0..3 {
        marble.place[axis] += marble.velocity[axis] * length;
    }
    // What two walls at an angle press into a third.
    for &number in walls {
        let place = [marble.place[0], marble.place[1]];
        let (normal, gap) = around.obstacles.gap(number, place);
        let out = (-gap).max(0.0);
        marble.place[0] += out * normal[0];
        marble.place[1] += out * normal[1];
    }
    for axis in 0..2 {
        let reach = around.reach[axis];
        marble.place[axis] = marble.place[axis].clamp(-reach, reach);
    }
}

/// A contact's impulse, for a marble that would pass it within so many seconds, and its friction.
fn push(marble: &mut Sphere, contact: &Contact, length: f64) {
    let Contact { normal, gap, .. } = *contact;
    let towards = -dot(marble.velocity, normal);
    if towards * length <= gap.max(0.0) || towards <= 0.0 {
        return;
    }
    let restitution = contact.restitution.map_or(0.0, |one| one.at(towards));
    let impulse = if restitution > 0.0 {
        (1.0 + restitution) * towards
    } else {
        towards - gap.max(0.0) / length
    };
    let surface = cross(marble.spin, normal);
    let slip: [f64; 3] = std::array::from_fn(|axis| {
        let velocity = marble.velocity[axis] + towards * normal[axis];
        velocity - surface[axis]
    });
    let speed = norm(slip);
    let part = if speed > 0.0 {
        (contact.friction * impulse / speed).min(2.0 / 7.0)
    } else {
        0.0
    };
    let turned = cross(normal, slip);
    for axis in 0..3 {
        marble.velocity[axis] += impulse * normal[axis] - part * slip[axis];
        marble.spin[axis] += 2.5 * part * turned[axis];
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::{GRAVITY, Rig, SUBSTEP_S};
    use crate::maze::Maze;

    const RADIUS: f64 = 0.00685;

    fn obstacles(hole_radius_m: f64) -> Obstacles {
        let maze = Maze {
            holes: vec![[0.0, 0.0]],
            hole_radius_m,
            ..Maze::default()
        };
        Obstacles::new(&maze, &Rig::default()).expect("it has a hole")
    }

    fn around(obstacles: &Obstacles, sliding_friction: f64) -> Around<'_> {
        Around {
            obstacles,
            radius: RADIUS,
            reach: Rig::default().reach_m(),
            restitution: Restitution {
                at_reference: 0.0,
                falloff: 0.0,
            },
            wall_friction: 0.25,
            sliding_friction,
            pull: [0.0, 0.0, -GRAVITY],
            length: 1e-3 * SUBSTEP_S,
        }
    }

    /// A marble that rolls along x, its centre `inside` m past the edge of a hole of this radius.
    fn rolling(hole_radius: f64, inside: f64, speed: f64) -> Sphere {
        Sphere {
            place: [inside - hole_radius, 0.0, RADIUS],
            velocity: [speed, 0.0, 0.0],
            spin: [0.0, speed, 0.0],
        }
    }

    fn energy(marble: &Sphere) -> f64 {
        let (v, w) = (norm(marble.velocity), norm(marble.spin));
        0.5 * v * v + 0.2 * w * w + GRAVITY * marble.place[2]
    }

    #[test]
    fn a_marble_that_tips_from_rest_leaves_the_edge_where_theory_says() {
        let obstacles = obstacles(0.05);
        let around = around(&obstacles, 100.0);
        let mut marble = rolling(0.05, 1e-6, 0.0);
        let begins = energy(&marble);
        for _ in 0..2_000_000 {
            pass(&mut marble, &around);
            let [x, _, height] = marble.place;
            let from_edge = (x + 0.05).hypot(height);
            if from_edge > RADIUS * (1.0 + 1e-6) {
                let cosine = height / from_edge;
                assert!((cosine - 10.0 / 17.0).abs() < 0.02, "{cosine}");
                assert!((energy(&marble) / begins - 1.0).abs() < 1e-3);
                return;
            }
        }
        panic!("the marble never left the edge: {marble:?}");
    }

    #[test]
    fn what_falls_and_what_flies_over() {
        let obstacles = obstacles(0.0075);
        let mut around = around(&obstacles, 0.25);
        around.length = SUBSTEP_S;
        let end = |speed: f64| {
            let mut marble = rolling(0.0075, -0.002, speed);
            for _ in 0..400 {
                let before = energy(&marble);
                let after = pass(&mut marble, &around);
                assert!(energy(&marble) <= before * (1.0 + 1e-9), "at {speed} m/s");
                if matches!(after, After::Fallen(_)) || marble.place[0] > 0.03 {
                    return after;
                }
            }
            panic!("at {speed} m/s the marble stayed: {marble:?}")
        };
        for slow in [0.01, 0.1, 0.2] {
            assert_eq!(end(slow), After::Fallen(0), "{slow}");
        }
        // Ballistic: it has sunk by g (2 r/v)²/2 at the far edge, 0.1 mm at 3 m/s.
        for fast in [3.0, 10.0, 39.0] {
            assert_eq!(end(fast), After::OnBoard, "{fast}");
        }
    }
}
