//! The orientation of a marble after it has rolled along a path.

use nalgebra::{UnitQuaternion, Vector3};

/// Straight pieces per segment of the path.
const PIECES: usize = 4;

/// The rotation of a rolling sphere from the first place of a path to each of its places.
///
/// The sphere neither slips nor spins about the vertical, as after an impact. Its orientation depends
/// on the whole path, since rotations do not commute: around a small closed path of area A it turns about the
/// vertical by A over the radius squared. Therefore the path is interpolated smoothly (Catmull and Rom, 1974).
///
/// # Arguments
/// `path`: positions of the sphere's centre. `radius`: of the sphere, in the same unit.
///
/// Returns a rotation for each place, its axis times its angle (rad).
pub fn turned(path: &[[f64; 2]], radius: f64) -> Vec<[f64; 3]> {
    let mut rotation = UnitQuaternion::identity();
    let mut all = vec![[0.0; 3]; path.len().min(1)];
    for row in 1..path.len() {
        let mut before = path[row - 1];
        for piece in 1..=PIECES {
            let place = between(path, row, piece as f64 / PIECES as f64);
            let [x, y] = [0, 1].map(|axis| (place[axis] - before[axis]) / radius);
            rotation = UnitQuaternion::from_scaled_axis(Vector3::new(-y, x, 0.0)) * rotation;
            before = place;
        }
        rotation.renormalize_fast();
        all.push(rotation.scaled_axis().into());
    }
    all
}

/// The position at a part, 0 to 1, of the segment that ends at a row.
fn between(path: &[[f64; 2]], row: usize, part: f64) -> [f64; 2] {
    let of = |index: usize, axis: usize| path[index.min(path.len() - 1)][axis];
    std::array::from_fn(|axis| {
        let (from, to) = (of(row - 1, axis), of(row, axis));
        let (ahead, behind) = (of(row + 1, axis), of(row.saturating_sub(2), axis));
        let (leaving, arriving) = (0.5 * (to - behind), 0.5 * (ahead - from));
        let bend = 2.0 * (from - to) + leaving + arriving;
        let lean = 3.0 * (to - from) - 2.0 * leaving - arriving;
        from + part * (leaving + part * (lean + part * bend))
    })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    const RADIUS: f64 = 0.007;

    fn assert_turned(found: [f64; 3], expected: Vector3<f64>) {
        let apart = UnitQuaternion::from_scaled_axis(found.into())
            .angle_to(&UnitQuaternion::from_scaled_axis(expected));
        assert!(apart < 2e-3, "{found:?} and {expected:?}");
    }

    #[test]
    fn a_straight_way_turns_about_the_axis_across_it() {
        let path: Vec<[f64; 2]> = (0..20).map(|i| [0.003 * f64::from(i), 0.0]).collect();
        for (place, found) in path.iter().zip(turned(&path, RADIUS)) {
            assert_turned(found, Vector3::new(0.0, place[0] / RADIUS, 0.0));
        }
    }

    #[test]
    fn the_way_back_undoes_the_way_there() {
        let mut path: Vec<[f64; 2]> = (0..30)
            .map(|i| [0.002 * f64::from(i), 0.01 * f64::sin(0.3 * f64::from(i))])
            .collect();
        let back: Vec<_> = path.iter().rev().copied().collect();
        path.extend(back);
        assert_turned(turned(&path, RADIUS)[59], Vector3::zeros());
    }

    /// A sphere that rolls around a circle turns as a cone does that rolls on another.
    #[test]
    fn a_circle_turns_it_about_a_leaning_axis() {
        let (circle, steps) = (0.02, 200_u32);
        let path: Vec<[f64; 2]> = (0..=steps)
            .map(|i| TAU * f64::from(i) / f64::from(steps))
            .map(|angle| [circle * f64::sin(angle), circle * (1.0 - f64::cos(angle))])
            .collect();
        // In a frame that turns with the direction the sphere has a constant spin.
        let ratio = circle / RADIUS;
        let expected = UnitQuaternion::from_scaled_axis(Vector3::z() * TAU)
            * UnitQuaternion::from_scaled_axis(Vector3::new(0.0, ratio, -1.0) * TAU);
        assert_turned(
            turned(&path, RADIUS)[steps as usize],
            expected.scaled_axis(),
        );
    }

    #[test]
    fn no_path_turns_nothing() {
        assert!(turned(&[], RADIUS).is_empty());
        assert_eq!(turned(&[[0.1, 0.2]], RADIUS), vec![[0.0; 3]]);
    }
}
