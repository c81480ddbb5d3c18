//! The sizes of the random quantities in an ascent.

use crate::noise::Noise;

/// Bounds of the sizes: white error and correlated error (board edges), its correlation time (s), white acceleration
/// (m²/s³), correlated acceleration (m/s²), its correlation time (s), restitution, delay jitter (s), departure from
/// walls (s), release from rest (s), and the tilt's white error and correlated error (rad) with its correlation time
/// (s). Zero stays zero.
const SMALLEST: [f64; SIZES] = [
    1e-6, 1e-6, 0.01, 1e-10, 1e-5, 0.03, 1e-3, 1e-5, 1e-4, 1e-4, 1e-6, 1e-6, 0.01,
];
/// A restitution that is anywhere from 0 to 1 has a deviation of 0.3.
const LARGEST: [f64; SIZES] = [
    0.1, 0.1, 5.0, 0.1, 1.0, 5.0, 0.3, 1.0, 1.0, 1.0, 0.3, 0.3, 5.0,
];
/// Number of estimated sizes: all but the start velocity, the last of a [`Noise`].
pub(super) const SIZES: usize = 13;

/// The sizes that are estimated.
pub(super) fn sizes(noise: &Noise) -> [f64; SIZES] {
    let all = <[f64; SIZES + 1]>::from(*noise);
    std::array::from_fn(|i| all[i])
}

/// Noise of other sizes, each within its bounds; zero stays zero.
pub(super) fn with_sizes(noise: &Noise, sizes: [f64; SIZES]) -> Noise {
    let within = |i: usize| match sizes[i] {
        0.0 => 0.0,
        size => size.clamp(SMALLEST[i], LARGEST[i]),
    };
    of_sizes(noise, std::array::from_fn(within))
}

/// Noise of other sizes.
pub(super) fn of_sizes(noise: &Noise, sizes: [f64; SIZES]) -> Noise {
    let mut all = <[f64; SIZES + 1]>::from(*noise);
    all[..SIZES].copy_from_slice(&sizes);
    Noise::from(all)
}
