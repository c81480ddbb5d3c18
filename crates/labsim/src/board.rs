//! The rig's geometry and materials: the board, its rim, the marble.

use crate::error::{Error, Result};

/// Standard gravity (m/s²).
pub const GRAVITY: f64 = 9.81;

/// Length of a physics update (s); the paper's 4.17 ms.
pub const SUBSTEP_S: f64 = 1.0 / 240.0;

/// The board and its four rim walls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Board {
    /// Long edge, along x (m).
    pub edge_x_m: f64,
    /// Short edge, along y (m).
    pub edge_y_m: f64,
    /// Coefficient of restitution of the rim, of the normal velocity at the moment of contact.
    pub wall_restitution: f64,
    /// Coulomb coefficient between marble and rim.
    pub wall_friction: f64,
    /// Coulomb coefficient between marble and board: the product of Bullet's two defaults of 0.5.
    ///
    /// It matters only while the marble slips, which on these tilts is for some milliseconds after it
    /// has met a wall.
    pub sliding_friction: f64,
    /// Torque with which the board resists a spin about the vertical, over the marble's weight and radius.
    ///
    /// Bullet and rapier have none. By Hertz, steel on wood has 0.0003 to 0.001.
    pub spinning_friction: f64,
}

impl Default for Board {
    /// The BRIO labyrinth of the paper.
    fn default() -> Self {
        Self {
            edge_x_m: 0.276,
            edge_y_m: 0.231,
            wall_restitution: 0.0,
            wall_friction: 0.25,
            sliding_friction: 0.25,
            spinning_friction: 0.0,
        }
    }
}

/// The marble.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Marble {
    /// Radius (m).
    pub radius_m: f64,
    /// Mass (kg).
    pub mass_kg: f64,
    /// Linear and angular damping rate (1/s).
    pub damping_per_s: f64,
}

impl Default for Marble {
    /// The coloured marble of the paper, 13.7 mm across.
    fn default() -> Self {
        Self {
            radius_m: 0.00685,
            mass_kg: 0.0105,
            damping_per_s: 0.0,
        }
    }
}

/// Board and marble: the known constants of a rig.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Rig {
    /// The board.
    pub board: Board,
    /// The marble.
    pub marble: Marble,
}

impl Rig {
    /// Maximum distance of the marble's centre from the board's centre along x and y (m).
    pub fn reach_m(&self) -> [f64; 2] {
        [
            self.board.edge_x_m / 2.0 - self.marble.radius_m,
            self.board.edge_y_m / 2.0 - self.marble.radius_m,
        ]
    }

    /// Refuses physically impossible dimensions.
    ///
    /// # Errors
    /// [`Error::Invalid`] names the first quantity that is out of bounds.
    pub fn check(&self) -> Result<()> {
        let Self { board, marble } = self;
        let in_range = |what: &str, value: f64, low: f64, high: f64, expected: &str| {
            if value >= low && value <= high {
                Ok(())
            } else {
                Err(Error::invalid(what, expected, value))
            }
        };
        let tiny = f64::MIN_POSITIVE;
        in_range("edge_x_m", board.edge_x_m, tiny, 1e3, "a length above 0 m")?;
        in_range("edge_y_m", board.edge_y_m, tiny, 1e3, "a length above 0 m")?;
        in_range(
            "wall_restitution",
            board.wall_restitution,
            0.0,
            1.0,
            "a number from 0 to 1",
        )?;
        in_range(
            "wall_friction",
            board.wall_friction,
            0.0,
            1e3,
            "a number of at least 0",
        )?;
        in_range(
            "sliding_friction",
            board.sliding_friction,
            0.0,
            1e3,
            "a number of at least 0",
        )?;
        in_range(
            "spinning_friction",
            board.spinning_friction,
            0.0,
            1e3,
            "a number of at least 0",
        )?;
        in_range("mass_kg", marble.mass_kg, tiny, 1e6, "a mass above 0 kg")?;
        in_range(
            "damping_per_s",
            marble.damping_per_s,
            0.0,
            1e6,
            "a rate of at least 0 per second",
        )?;
        let room = board.edge_x_m.min(board.edge_y_m) / 2.0;
        if !(marble.radius_m > 0.0 && marble.radius_m < room) {
            let expected = format!("a radius above 0 and below half the shorter edge ({room} m)");
            return Err(Error::invalid("radius_m", &expected, marble.radius_m));
        }
        Ok(())
    }
}
