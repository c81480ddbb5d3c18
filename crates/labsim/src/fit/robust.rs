//! Robust scales and weights.

/// Standard deviation of a normal variable over its median absolute deviation.
const MAD_TO_SD: f64 = 1.4826;
/// Smallest noise of a camera (board edges); keeps scales positive on simulated data without noise.
pub(super) const FINEST: f64 = 1e-6;
/// Degrees of freedom of the Student-t likelihood: rows beyond about three scales lose their
/// weight.
const TAIL: f64 = 4.0;

/// Rows on either side of five between which the marble's displacement is measured, so that its noise is independent.
const BESIDE: usize = 3;
/// Ratio of the moving rows' noise to that of all rows above which the moving rows are used, and the minimum number
/// of such rows. Without pixel quantisation the ratio is 0.9 to 1.15.
const STUCK: f64 = 1.2;
const ENOUGH: usize = 200;

/// The Student-t negative log-likelihood of residuals up to a constant: quadratic near zero,
/// logarithmic far out.
pub(super) fn loss(residuals: &[f64], scale: f64) -> f64 {
    // One logarithm for the product of many factors, each at least 1.
    let unit = 1.0 / (TAIL * scale * scale);
    let (mut sum, mut product) = (0.0, 1.0f64);
    for residual in residuals {
        product *= 1.0 + residual * residual * unit;
        if product > 1e200 {
            sum += product.ln();
            product = 1.0;
        }
    }
    0.5 * (TAIL + 1.0) * (sum + product.ln())
}

/// The weight in the normal equations: the derivative of the loss over the residual.
pub(super) fn weight(residual: f64, scale: f64) -> f64 {
    (TAIL + 1.0) / (TAIL * scale * scale + residual * residual)
}

/// Influence of a residual and its derivative; near zero both are those of least squares.
pub(super) fn influence(residual: f64, scale: f64) -> (f64, f64) {
    let ratio = (residual / scale).powi(2) / TAIL;
    (
        residual / (1.0 + ratio),
        (1.0 - ratio) / (1.0 + ratio).powi(2),
    )
}

/// The robust standard deviation of the known residuals.
pub(super) fn scale(residuals: &[f64], known: &[bool]) -> f64 {
    let seen = residuals.iter().zip(known).filter(|(_, known)| **known);
    (MAD_TO_SD * median(seen.map(|(residual, _)| residual.abs()).collect())).max(FINEST)
}

/// The standard deviation of a tracker (board edges), from recordings alone. Axes with constant values are
/// ignored.
///
/// Motion is smooth from row to row, so fourth differences are mostly noise; their standard deviation is √70
/// times the tracker's. A tracker that reads whole pixels repeats its error while the marble stays within one.
/// If the differences of moving rows are much larger than those of all rows, only the moving rows are used.
pub fn tracker_noise<'a>(recordings: impl IntoIterator<Item = &'a [[f64; 2]]>) -> f64 {
    let recordings: Vec<&[[f64; 2]]> = recordings.into_iter().collect();
    let changes = changes(&recordings);
    let axes = (0..2).filter(|&axis| changes[axis]);
    let paths: Vec<Vec<f64>> = axes
        .flat_map(|axis| {
            let path = move |rows: &&[[f64; 2]]| rows.iter().map(|row| row[axis]).collect();
            recordings.iter().map(path)
        })
        .collect();
    scatter(&paths).max(FINEST)
}

/// The standard deviation of the sensor of one signal (in the signal's unit), from its changes alone.
///
/// A signal that is held over rows is sampled at its changes. The noise is at least that of its quantisation steps.
pub(super) fn signal_noise(series: &[Vec<f64>]) -> f64 {
    let step = series
        .iter()
        .flat_map(|one| one.windows(2))
        .map(|pair| (pair[1] - pair[0]).abs())
        .filter(|change| *change > 0.0)
        .fold(f64::INFINITY, f64::min);
    let finest = if step.is_finite() {
        step / 12f64.sqrt()
    } else {
        0.0
    };
    let mut noise = scatter(series);
    if noise <= finest {
        let changed = |one: &Vec<f64>| {
            let mut one = one.clone();
            one.dedup();
            one
        };
        noise = scatter(&series.iter().map(changed).collect::<Vec<_>>());
    }
    noise.max(finest).max(FINEST)
}

/// Whether the values of each axis ever differ.
pub(super) fn changes(recordings: &[&[[f64; 2]]]) -> [bool; 2] {
    [0, 1].map(|axis| {
        let values = recordings.iter().copied().flatten().map(|row| row[axis]);
        let mut finite = values.filter(|value| value.is_finite());
        let first = finite.next();
        finite.any(|value| Some(value) != first)
    })
}

/// The standard deviation of the noise in paths, by their fourth differences.
fn scatter(paths: &[Vec<f64>]) -> f64 {
    let (mut all, mut on_the_way) = (Vec::new(), Vec::new());
    for path in paths {
        all.extend(path.windows(5).map(fourth).filter(|one| one.is_finite()));
        for rows in path.windows(5 + 2 * BESIDE) {
            let way = (rows[rows.len() - 1] - rows[0]).abs();
            let one = fourth(&rows[BESIDE..BESIDE + 5]);
            if (way + one).is_finite() {
                on_the_way.push((way, one));
            }
        }
    }
    let usual = median(on_the_way.iter().map(|(way, _)| *way).collect());
    let moving: Vec<f64> = on_the_way
        .into_iter()
        .filter_map(|(way, one)| (way > usual).then_some(one))
        .collect();
    let enough = moving.len() >= ENOUGH;
    let deviation = |differences| MAD_TO_SD * median(differences) / 70f64.sqrt();
    let (of_all, of_moving) = (deviation(all), deviation(moving));
    if enough && of_moving > STUCK * of_all {
        of_moving
    } else {
        of_all
    }
}

/// The absolute fourth difference of five values.
fn fourth(rows: &[f64]) -> f64 {
    (rows[0] - 4.0 * rows[1] + 6.0 * rows[2] - 4.0 * rows[3] + rows[4]).abs()
}

/// The median, zero of nothing.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let half = values.len() / 2;
    let even = values.len().is_multiple_of(2);
    let (below, &mut middle, _) = values.select_nth_unstable_by(half, f64::total_cmp);
    if even {
        let next = below.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        f64::midpoint(next, middle)
    } else {
        middle
    }
}
