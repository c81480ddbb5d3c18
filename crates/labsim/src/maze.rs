//! The inside of a labyrinth: walls between which a marble rolls, and holes that it falls through.

use crate::board::Rig;
use crate::error::{Error, Result};

/// Inner walls and holes, in metres from the board's centre.
///
/// Walls have rounded ends and the rim's restitution and friction. A marble does not climb over them, so that
/// they have no height here.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Maze {
    /// The walls' middle lines: from x0, y0 to x1, y1 (m).
    pub walls: Vec<[f64; 4]>,
    /// Thickness of each wall (m).
    pub wall_thickness_m: f64,
    /// Centres of the holes (m).
    pub holes: Vec<[f64; 2]>,
    /// Radius of each hole (m), larger than the marble's.
    pub hole_radius_m: f64,
}

/// Where a marble fell through the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fall {
    /// The first row, counted from the first observed one, at which it was gone.
    pub row: usize,
    /// Which of [`Maze::holes`] it fell through.
    pub hole: usize,
}

/// Coordinates are rounded: so much further than the rim is still at the rim.
const ROUNDING: f64 = 1.0 + 1e-9;

impl Maze {
    /// Whether there is neither wall nor hole.
    pub fn is_bare(&self) -> bool {
        self.walls.is_empty() && self.holes.is_empty()
    }

    /// Refuses walls and holes that leave the board, holes that are too small for the marble or that overlap.
    ///
    /// # Errors
    /// [`Error::Invalid`] names the first wall or hole, counted from 1, that is wrong.
    pub fn check(&self, rig: &Rig) -> Result<()> {
        let half = [rig.board.edge_x_m / 2.0, rig.board.edge_y_m / 2.0];
        let on_board = |place: [f64; 2], room: f64| {
            (0..2).all(|axis| place[axis].abs() + room <= half[axis] * ROUNDING)
        };
        let is_length = |value: f64, above: f64| value > above && value < 1e3;
        if !self.walls.is_empty() && !is_length(self.wall_thickness_m, 0.0) {
            let expected = "a length above 0 m";
            return Err(Error::invalid(
                "wall_thickness_m",
                expected,
                self.wall_thickness_m,
            ));
        }
        for (i, &[x0, y0, x1, y1]) in self.walls.iter().enumerate() {
            if !(on_board([x0, y0], 0.0) && on_board([x1, y1], 0.0)) {
                let got = format!("{x0} {y0} to {x1} {y1}");
                return Err(Error::invalid(
                    format!("wall {}", i + 1),
                    "a wall on the board",
                    got,
                ));
            }
        }
        let radius = self.hole_radius_m;
        let marble = rig.marble.radius_m;
        if !self.holes.is_empty() && !is_length(radius, marble) {
            let expected = format!("more than the marble's radius, {marble} m");
            return Err(Error::invalid("hole_radius_m", &expected, radius));
        }
        for (i, &hole) in self.holes.iter().enumerate() {
            let [x, y] = hole;
            let refused = |expected: &str| {
                let got = format!("its centre at {x} {y}");
                Err(Error::invalid(format!("hole {}", i + 1), expected, got))
            };
            if !on_board(hole, radius) {
                return refused("a hole on the board");
            }
            let room = radius + self.wall_thickness_m / 2.0;
            if self.walls.iter().any(|&wall| distance(wall, hole) < room) {
                return refused("a hole beside the walls");
            }
            let near = |other: &[f64; 2]| (other[0] - x).hypot(other[1] - y) < 2.0 * radius;
            if self.holes[..i].iter().any(near) {
                return refused("holes beside one another");
            }
        }
        Ok(())
    }
}

/// Distance of a place from a wall's middle line.
fn distance([x0, y0, x1, y1]: [f64; 4], [x, y]: [f64; 2]) -> f64 {
    let (along_x, along_y) = (x1 - x0, y1 - y0);
    let square = along_x * along_x + along_y * along_y;
    let part = if square > 0.0 {
        (((x - x0) * along_x + (y - y0) * along_y) / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (x - x0 - part * along_x).hypot(y - y0 - part * along_y)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn maze() -> Maze {
        Maze {
            walls: vec![[0.0, 0.0, 0.1, 0.0]],
            wall_thickness_m: 0.005,
            holes: vec![[0.0, 0.05]],
            hole_radius_m: 0.0075,
        }
    }

    type Change = fn(&mut Maze);

    #[test]
    fn what_no_maze_can_be_is_named() {
        let rig = Rig::default();
        assert_eq!(maze().check(&rig), Ok(()));
        assert_eq!(Maze::default().check(&rig), Ok(()));
        let changes: [(Change, &str); 8] = [
            (|maze| maze.walls.push([0.0, 0.0, 0.139, 0.0]), "wall 2"),
            (|maze| maze.walls[0][2] = f64::NAN, "wall 1"),
            (|maze| maze.wall_thickness_m = 0.0, "wall_thickness_m"),
            (|maze| maze.hole_radius_m = 0.0068, "hole_radius_m"),
            (|maze| maze.hole_radius_m = f64::NAN, "hole_radius_m"),
            (|maze| maze.holes.push([0.0, 0.11]), "hole 2"),
            (|maze| maze.holes.push([0.05, -0.0099]), "beside the walls"),
            (|maze| maze.holes.push([0.01, 0.06]), "beside one another"),
        ];
        for (change, said) in changes {
            let mut wrong = maze();
            change(&mut wrong);
            let error = wrong.check(&rig).expect_err(said).to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
