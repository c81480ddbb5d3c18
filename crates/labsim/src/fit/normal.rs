//! The weighted normal equations, with the windows' start states eliminated.
//!
//! A start state touches only its own window's residuals, so the equations have an arrow's shape: small
//! diagonal blocks for the states, one dense border for the coordinates. Eliminating the blocks leaves a
//! system of the coordinates alone for any number of windows (Triggs et al. 2000, "Bundle adjustment",
//! sect. 6).

use nalgebra::{DMatrix, DVector, Dyn, Matrix4, OMatrix, SymmetricEigen, U4, Vector4};

use super::coordinates::Coordinates;
use super::robust;
use super::slopes::Linearisation;
use super::windows::Windows;

/// Relative ridge that keeps the spread of undetermined directions finite.
const RIDGE: f64 = 1e-6;
/// Minimum damping: keeps blocks of undetermined start states invertible.
const FLOOR: f64 = 1e-9;

type Border = OMatrix<f64, U4, Dyn>;

/// The blocks of the weighted normal equations at a point.
pub(super) struct Normal {
    /// Border and gradient of the coordinates.
    zz: DMatrix<f64>,
    z: DVector<f64>,
    states: Vec<Block>,
}

/// A window's contribution: block and gradient of its start state, and its coupling to the coordinates.
struct Block {
    ss: Matrix4<f64>,
    s: Vector4<f64>,
    sz: Border,
}

/// The coordinates' equations once the states are eliminated.
struct Eliminated {
    inverses: Vec<Matrix4<f64>>,
    matrix: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl Normal {
    /// The equations at a linearisation, with robust weights at `scale`, the penalty outside the ranges and
    /// the priors of shrunk coordinates.
    pub(super) fn new(
        line: &Linearisation,
        windows: &Windows,
        coordinates: &Coordinates,
        z: &[f64],
        scale: f64,
    ) -> Self {
        let weights = weights(line, scale);
        let mut normal = Self::of_residuals(line, windows, coordinates, &weights);
        let (excess, slope) = (coordinates.excess(z), coordinates.excess_slope(z));
        for (excess, slope) in excess
            .iter()
            .zip(&slope)
            .filter(|(excess, _)| **excess != 0.0)
        {
            let slope = DVector::from_column_slice(slope);
            normal.z += *excess * &slope;
            normal.zz += &slope * slope.transpose();
        }
        if !coordinates.groups().is_empty() {
            for (i, precision) in coordinates.precisions().into_iter().enumerate() {
                normal.z[i] += precision * z[i];
                normal.zz[(i, i)] += precision;
            }
        }
        normal
    }

    /// Matrix and gradient of the residuals alone, each weighted by the trust in its slopes, with the start states
    /// eliminated.
    pub(super) fn likelihood(
        line: &Linearisation,
        windows: &Windows,
        coordinates: &Coordinates,
        scale: f64,
        trust: &[f64],
    ) -> (DMatrix<f64>, DVector<f64>) {
        let mut weights = weights(line, scale);
        for (weight, trust) in weights.iter_mut().zip(trust) {
            *weight *= trust;
        }
        let eliminated = Self::of_residuals(line, windows, coordinates, &weights).eliminated(0.0);
        (eliminated.matrix, eliminated.gradient)
    }

    fn of_residuals(
        line: &Linearisation,
        windows: &Windows,
        coordinates: &Coordinates,
        weights: &[f64],
    ) -> Self {
        let count = coordinates.len();
        let weighted = |column: &[f64]| -> Vec<f64> {
            column
                .iter()
                .zip(weights)
                .map(|(value, weight)| value * weight)
                .collect()
        };
        let by_z: Vec<Vec<f64>> = line.by_z.iter().map(|column| weighted(column)).collect();
        let by_state: Vec<Vec<f64>> = line
            .by_state
            .iter()
            .map(|column| weighted(column))
            .collect();
        let mut normal = Self {
            zz: DMatrix::zeros(count, count),
            z: DVector::zeros(count),
            states: Vec::with_capacity(windows.all.len()),
        };
        for (i, column) in by_z.iter().enumerate() {
            normal.z[i] = dot(column, &line.residual);
            for (j, other) in line.by_z[..=i].iter().enumerate() {
                if coordinates.are_apart(i, j) {
                    continue;
                }
                normal.zz[(i, j)] = dot(column, other);
                normal.zz[(j, i)] = normal.zz[(i, j)];
            }
        }
        for window in &windows.all {
            let own = window.marble();
            let mut block = Block {
                ss: Matrix4::zeros(),
                s: Vector4::zeros(),
                sz: Border::zeros(count),
            };
            for (i, column) in by_state.iter().enumerate() {
                let column = &column[own.clone()];
                block.s[i] = dot(column, &line.residual[own.clone()]);
                for (j, other) in line.by_state.iter().enumerate() {
                    block.ss[(i, j)] = dot(column, &other[own.clone()]);
                }
                for (j, other) in line.by_z.iter().enumerate() {
                    block.sz[(i, j)] = dot(column, &other[own.clone()]);
                }
            }
            normal.states.push(block);
        }
        normal
    }

    /// The coordinates that may move: inside their bounds, or with a step inwards.
    pub(super) fn free(&self, bounds: &[(f64, f64)], z: &[f64]) -> Vec<bool> {
        let gradient = self.eliminated(0.0).gradient;
        let may = |i: usize| {
            let (low, high) = bounds[i];
            !(z[i] <= low && gradient[i] > 0.0 || z[i] >= high && gradient[i] < 0.0)
        };
        (0..z.len()).map(may).collect()
    }

    /// The damped step of the free coordinates and of all states.
    pub(super) fn step(&self, damping: f64, free: &[bool]) -> (Vec<f64>, Vec<Vector4<f64>>) {
        let Eliminated {
            inverses,
            mut matrix,
            mut gradient,
        } = self.eliminated(damping);
        for (i, ridge) in ridge(self.zz.diagonal().as_slice(), damping)
            .into_iter()
            .enumerate()
        {
            matrix[(i, i)] += ridge;
        }
        for (i, _) in free.iter().enumerate().filter(|(_, free)| !**free) {
            matrix.row_mut(i).fill(0.0);
            matrix.column_mut(i).fill(0.0);
            matrix[(i, i)] = 1.0;
            gradient[i] = 0.0;
        }
        let dz = -solve(matrix, &gradient);
        let states = self.states.iter().zip(&inverses);
        let ds = states.map(|(block, inverse)| -(inverse * (block.s + &block.sz * &dz)));
        let ds = ds.collect();
        (dz.as_slice().to_vec(), ds)
    }

    /// A root of the coordinates' covariance, and how each state follows them.
    pub(super) fn spread(&self) -> (DMatrix<f64>, Vec<Border>) {
        let eliminated = self.eliminated(RIDGE);
        let root = inverse_root(eliminated.matrix, self.zz.diagonal().as_slice());
        let states = self.states.iter().zip(&eliminated.inverses);
        (
            root,
            states
                .map(|(block, inverse)| -(inverse * &block.sz))
                .collect(),
        )
    }

    /// A root of each start state's covariance at fixed coordinates.
    pub(super) fn loose(&self) -> Vec<Matrix4<f64>> {
        let root = |block: &Block| {
            let matrix = DMatrix::from_column_slice(4, 4, block.ss.as_slice());
            let root = inverse_root(matrix, block.ss.diagonal().as_slice());
            Matrix4::from_column_slice(root.as_slice())
        };
        self.states.iter().map(root).collect()
    }

    fn eliminated(&self, damping: f64) -> Eliminated {
        let mut eliminated = Eliminated {
            inverses: Vec::with_capacity(self.states.len()),
            matrix: self.zz.clone(),
            gradient: self.z.clone(),
        };
        for block in &self.states {
            let mut damped = block.ss;
            for (i, ridge) in ridge(block.ss.diagonal().as_slice(), damping)
                .into_iter()
                .enumerate()
            {
                damped[(i, i)] += ridge;
            }
            let inverse = damped.try_inverse().unwrap_or_else(Matrix4::zeros);
            let share = inverse * &block.sz;
            eliminated.matrix -= block.sz.tr_mul(&share);
            eliminated.gradient -= share.tr_mul(&block.s);
            eliminated.inverses.push(inverse);
        }
        eliminated
    }
}

/// Robust weights of residuals at a scale.
fn weights(line: &Linearisation, scale: f64) -> Vec<f64> {
    let weight = |&residual: &f64| robust::weight(residual, scale);
    line.residual.iter().map(weight).collect()
}

/// A root of a matrix's inverse, of which a share of `diagonal` is added to the diagonal first.
fn inverse_root(mut matrix: DMatrix<f64>, diagonal: &[f64]) -> DMatrix<f64> {
    for (i, ridge) in ridge(diagonal, RIDGE).into_iter().enumerate() {
        matrix[(i, i)] += ridge;
    }
    let eigen = SymmetricEigen::new(matrix);
    let mut root = eigen.eigenvectors;
    for (mut column, value) in root.column_iter_mut().zip(&eigen.eigenvalues) {
        column /= value.max(f64::MIN_POSITIVE).sqrt();
    }
    root
}

/// Marquardt's damping: relative to the diagonal, positive where that is zero.
fn ridge(diagonal: &[f64], damping: f64) -> Vec<f64> {
    let largest = diagonal.iter().copied().fold(0.0, f64::max);
    diagonal
        .iter()
        .map(|value| damping * value + FLOOR * largest + 1e-300)
        .collect()
}

fn solve(matrix: DMatrix<f64>, right: &DVector<f64>) -> DVector<f64> {
    if let Some(factor) = matrix.clone().cholesky() {
        return factor.solve(right);
    }
    matrix
        .lu()
        .solve(right)
        .unwrap_or_else(|| DVector::zeros(right.len()))
}

/// The scalar product, in four sums that a register holds side by side.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (whole_a, rest_a) = a.as_chunks::<8>();
    let (whole_b, rest_b) = b.as_chunks::<8>();
    for (a, b) in whole_a.iter().zip(whole_b) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    let rest: f64 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eliminating_the_states_gives_the_step_of_the_whole_system() {
        // Two windows of eight residuals, three coordinates, four components of a start state.
        let entry =
            |i: usize, j: usize| ((7 * i + 13 * j) as f64).sin() + if i == j { 2.0 } else { 0.0 };
        let dense = DMatrix::from_fn(16, 11, |i, j| match j {
            0..3 => entry(i, j),
            3..7 if i < 8 => entry(i, j),
            7.. if i >= 8 => entry(i, j),
            _ => 0.0,
        });
        let residual = DVector::from_fn(16, |i, _| (3 * i) as f64).map(f64::cos);
        let whole = dense.tr_mul(&dense);
        let pull = dense.tr_mul(&residual);
        let block = |begin: usize| Block {
            ss: whole.fixed_view::<4, 4>(begin, begin).into_owned(),
            s: pull.fixed_rows::<4>(begin).into_owned(),
            sz: Border::from_fn(3, |i, j| whole[(begin + i, j)]),
        };
        let normal = Normal {
            zz: whole.view((0, 0), (3, 3)).into_owned(),
            z: pull.rows(0, 3).into_owned(),
            states: vec![block(3), block(7)],
        };
        let (dz, ds) = normal.step(0.0, &[true; 3]);
        let step = -whole.lu().solve(&pull).unwrap();
        let found: Vec<f64> = dz.iter().chain(ds.iter().flatten()).copied().collect();
        for (found, step) in found.iter().zip(&step) {
            assert!(
                (found - step).abs() < 1e-6 * (1.0 + step.abs()),
                "{found} {step}"
            );
        }
        let (held, _) = normal.step(0.0, &[true, false, true]);
        assert!(held[1] == 0.0 && held[0] != 0.0);
        let bounds = [(-1.0, 1.0), (0.0, 1.0), (-1.0, 0.0)];
        let gradient = normal.eliminated(0.0).gradient;
        let free = normal.free(&bounds, &[0.0; 3]);
        assert_eq!(free, [true, gradient[1] < 0.0, gradient[2] > 0.0]);
    }
}
