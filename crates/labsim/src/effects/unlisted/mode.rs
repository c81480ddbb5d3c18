//! A vibration mode of the board about the angles that its knobs command.

use pulp::Simd;

use crate::lanes::Lanes;
use crate::motion::Pair;

/// A damped oscillator per axis, driven by the board's commanded angles.
#[derive(Clone)]
pub(super) struct Mode<S: Simd> {
    pub(super) gain: Lanes<S>,
    /// Rate times damping, and the rate at which it rings (rad/s).
    fade: Lanes<S>,
    ringing: Lanes<S>,
    natural: Lanes<S>,
    /// Angles (rad) and their rates (rad/s); none before the first substep.
    state: Option<[Pair<S>; 2]>,
    /// Mean deviation of the angles from the board's in the last substep (rad).
    pub(super) away: Pair<S>,
    swing: Swing<S>,
}

/// Free oscillation over a substep: the decay times the cosine, and times the sine over the ringing rate.
#[derive(Clone)]
struct Swing<S: Simd> {
    length: Lanes<S>,
    cos: Lanes<S>,
    sin: Lanes<S>,
}

impl<S: Simd> Mode<S> {
    pub(super) fn new(gain: Lanes<S>, natural: Lanes<S>, damping: Lanes<S>) -> Self {
        let zero = gain.like(0.0);
        let left = (gain.like(1.0) - damping * damping).sqrt();
        Self {
            gain,
            fade: natural * damping,
            ringing: natural * left,
            natural,
            state: None,
            away: [zero; 2],
            swing: Swing {
                length: zero,
                cos: gain.like(1.0),
                sin: zero,
            },
        }
    }

    #[inline(always)]
    pub(super) fn pass(&mut self, tilt: &Pair<S>, length: Lanes<S>) {
        if length.ne(self.swing.length).any() {
            self.swing = self.over(length);
        }
        let zero = length.like(0.0);
        // At first the mode is at rest at the board's angles.
        let [angles, rates] = self.state.get_or_insert([*tilt, [zero; 2]]);
        for axis in 0..2 {
            let (away, rate) = (angles[axis] - tilt[axis], rates[axis]);
            let Swing { cos, sin, .. } = self.swing;
            let left = cos * away + sin * (rate + self.fade * away);
            let speed = cos * rate - sin * (self.fade * rate + self.natural * self.natural * away);
            self.away[axis] = 0.5 * (away + left);
            angles[axis] = tilt[axis] + left;
            rates[axis] = speed;
        }
    }

    #[inline(never)]
    fn over(&self, length: Lanes<S>) -> Swing<S> {
        let (sin, cos) = (self.ringing * length).sin_cos_of_any();
        let left = (-self.fade * length).exp_decay();
        Swing {
            length,
            cos: left * cos,
            sin: (left * sin).over(self.ringing),
        }
    }
}
