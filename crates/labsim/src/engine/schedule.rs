//! Events of single rollouts of a register at times within their rows.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use pulp::Simd;

use crate::lanes::Lanes;

/// An event of a rollout.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moment {
    /// The row in which it falls.
    pub(super) row: usize,
    /// Substeps after the row's beginning.
    pub(super) at: f64,
    /// The event.
    pub(super) what: usize,
}

/// The events of each lane's rollout, in order of time.
pub(super) struct Schedule<S: Simd> {
    moments: Vec<Vec<Moment>>,
    taken: Vec<usize>,
    /// Times of the next events of this row (substeps after its beginning), infinite without one.
    next: Lanes<S>,
}

impl<S: Simd> Schedule<S> {
    pub(super) fn new(simd: S, moments: Vec<Vec<Moment>>) -> Self {
        Self {
            taken: vec![0; moments.len()],
            moments,
            next: Lanes::splat(simd, f64::INFINITY),
        }
    }

    /// Selects the events of a row.
    #[inline(always)]
    pub(super) fn begin_row(&mut self, row: usize) {
        self.next = Lanes::from_fn(self.next.simd(), |lane| self.when(lane, row));
    }

    /// Time of a lane's next event, infinite if it is not in this row.
    #[inline(always)]
    fn when(&self, lane: usize, row: usize) -> f64 {
        match self
            .moments
            .get(lane)
            .and_then(|all| all.get(self.taken[lane]))
        {
            Some(moment) if moment.row <= row => moment.at,
            _ => f64::INFINITY,
        }
    }

    /// Calls `happen` with the events up to this number of substeps of a row, the first lane first.
    #[inline(always)]
    pub(super) fn take(
        &mut self,
        row: usize,
        substeps: f64,
        mut happen: impl FnMut(usize, Moment),
    ) {
        let mut next = self.next.to_array();
        for (lane, next) in next[..self.moments.len()].iter_mut().enumerate() {
            while *next <= substeps {
                happen(lane, self.moments[lane][self.taken[lane]]);
                self.taken[lane] += 1;
                *next = self.when(lane, row);
            }
        }
        self.next = Lanes::from_fn(self.next.simd(), |lane| next[lane]);
    }

    /// Whether any lane has an event up to this number of substeps.
    #[inline(always)]
    pub(super) fn is_due(&self, substeps: f64) -> bool {
        self.next.le(self.next.like(substeps)).any()
    }
}

/// Times of the rows of a register's rollouts.
pub(super) struct Timeline {
    /// Of each row, the end of the last one behind them: a time for each lane (s).
    begins: Vec<[f64; 8]>,
    /// Of each row: the number of substeps, and how long they are in each lane (s).
    steps: Vec<(u32, [f64; 8])>,
}

impl Timeline {
    pub(super) fn new(steps: impl Iterator<Item = (u32, [f64; 8])>) -> Self {
        let steps: Vec<(u32, [f64; 8])> = steps.collect();
        let mut begins = vec![[0.0; 8]];
        for (row, (substeps, length)) in steps.iter().enumerate() {
            let ends = |lane: usize| begins[row][lane] + f64::from(*substeps) * length[lane];
            begins.push(std::array::from_fn(ends));
        }
        Self { begins, steps }
    }

    /// When a row of a lane's rollout begins (s).
    pub(super) fn begins(&self, row: usize, lane: usize) -> f64 {
        self.begins[row][lane]
    }

    /// Number of rows.
    pub(super) fn rows(&self) -> usize {
        self.steps.len()
    }

    /// Number of substeps of a row.
    pub(super) fn substeps(&self, row: usize) -> f64 {
        f64::from(self.steps[row].0)
    }

    /// One over the substeps of a row.
    pub(super) fn share(&self, row: usize) -> f64 {
        1.0 / self.substeps(row)
    }

    /// The same with a row for each substep.
    pub(super) fn of_substeps(&self) -> Self {
        let mut fine = Self::new(
            self.steps
                .iter()
                .flat_map(|&(substeps, length)| (0..substeps).map(move |_| (1, length))),
        );
        // To the last bit when the substeps of each row begin.
        let mut place = 0;
        for (row, (substeps, length)) in self.steps.iter().enumerate() {
            for substep in 0..*substeps {
                fine.begins[place] = std::array::from_fn(|lane| {
                    self.begins[row][lane] + f64::from(substep) * length[lane]
                });
                place += 1;
            }
        }
        fine
    }

    /// How long the substeps of a row are in each lane (s).
    pub(super) fn lengths(&self, row: usize) -> &[f64; 8] {
        &self.steps[row].1
    }

    /// The row of a lane's rollout in which a time falls, and how many substeps after the row's
    /// beginning; before `first` it is as if that row had begun earlier. Soon found if `near` is.
    pub(super) fn locate(&self, lane: usize, time: f64, first: usize, near: usize) -> (usize, f64) {
        let mut after = near;
        while after > 0 && self.begins[after - 1][lane] > time {
            after -= 1;
        }
        while after < self.begins.len() && self.begins[after][lane] <= time {
            after += 1;
        }
        let row = (after.max(first + 1) - 1).min(self.steps.len() - 1);
        let length = self.steps[row].1[lane];
        let at = if length > 0.0 {
            (time - self.begins[row][lane]) / length
        } else {
            0.0
        };
        (row, at.min(self.substeps(row)))
    }
}
