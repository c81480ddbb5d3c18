//! The board from above, a pixel a millimetre, as the cuts of learners have it.

use labsim::Scene;

use crate::model::Model;

/// Pixels to a metre.
const PER_M: f64 = 1000.0;

const WOOD: [f64; 3] = [206.0, 169.0, 120.0];
const WALL: [f64; 3] = [110.0, 74.0, 44.0];
const HOLE: [f64; 3] = [24.0, 20.0, 18.0];

/// Paints a model's board without its marble.
pub fn paint(model: &Model) -> Scene {
    let [width, height] = model.edges_m().map(|edge| (PER_M * edge).round() as usize);
    let mut pixels = Vec::with_capacity(width * height);
    for row in 0..height {
        for column in 0..width {
            let place = [
                (column as f64 + 0.5 - 0.5 * width as f64) / PER_M,
                (0.5 * height as f64 - row as f64 - 0.5) / PER_M,
            ];
            pixels.push(colour(model, place));
        }
    }
    Scene {
        pixels,
        width,
        per_m: PER_M,
        radius_m: model.radius_m(),
    }
}

/// The colour at a place (m); edges are a pixel wide.
fn colour(model: &Model, place: [f64; 2]) -> [u8; 3] {
    let mut found = WOOD;
    let mut cover = |inside_m: f64, over: [f64; 3]| {
        let part = (0.5 + PER_M * inside_m).clamp(0.0, 1.0);
        for (one, over) in found.iter_mut().zip(over) {
            *one += part * (over - *one);
        }
    };
    if let Some(maze) = model.maze() {
        for hole in &maze.holes {
            let far = (place[0] - hole[0]).hypot(place[1] - hole[1]);
            cover(maze.hole_radius_m - far, HOLE);
        }
        for wall in &maze.walls {
            cover(0.5 * maze.wall_thickness_m - from_line(place, *wall), WALL);
        }
    }
    found.map(|one| one.round() as u8)
}

/// Distance (m) from a place to a wall's middle line.
fn from_line([x, y]: [f64; 2], [x0, y0, x1, y1]: [f64; 4]) -> f64 {
    let (dx, dy) = (x1 - x0, y1 - y0);
    let length = (dx * dx + dy * dy).max(f64::MIN_POSITIVE);
    let part = (((x - x0) * dx + (y - y0) * dy) / length).clamp(0.0, 1.0);
    (x - x0 - part * dx).hypot(y - y0 - part * dy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::tests::with;

    #[test]
    fn walls_and_holes_are_where_the_model_has_them() {
        let maze = "[maze]\nwall_thickness_m = 0.006\nwall_height_m = 0.01\nwalls = [[-0.05, 0.05, 0.05, 0.05]]\nhole_radius_m = 0.0075\nholes = [[0.1, -0.05]]\n";
        let scene = paint(&with(maze));
        let at = |x: f64, y: f64| {
            let column = (x * PER_M + 0.5 * scene.width as f64) as usize;
            let height = scene.pixels.len() / scene.width;
            let row = (0.5 * height as f64 - y * PER_M) as usize;
            f64::from(scene.pixels[row * scene.width + column][0])
        };
        assert_eq!(
            [at(0.0, 0.05), at(0.0, -0.05), at(0.1, -0.05)],
            [WALL[0], WOOD[0], HOLE[0]]
        );
        // The hole's area, of how dark the board is in all.
        let dark: f64 = (0..30 * 30)
            .map(|i| {
                at(
                    0.085 + 1e-3 * f64::from(i % 30),
                    -0.065 + 1e-3 * f64::from(i / 30),
                )
            })
            .map(|red| (WOOD[0] - red) / (WOOD[0] - HOLE[0]))
            .sum();
        assert!(
            (dark - std::f64::consts::PI * 7.5_f64.powi(2)).abs() < 3.0,
            "{dark}"
        );
    }
}
