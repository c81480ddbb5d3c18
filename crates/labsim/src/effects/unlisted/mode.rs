//! A mode in which the board swings after its knobs.

use pulp::Simd;

use crate::lanes::Lanes;
use crate::motion::Pair;

/// A board on springs: where it swings after its knobs tell it to be elsewhere.
#[derive(Clone)]
pub(super) struct Mode<S: Simd> {
    pub(super) gain: Lanes<S>,
    /// Rate times damping, and the rate at which it rings (rad/s).
    fade: Lanes<S>,
    ringing: Lanes<S>,
    natural: Lanes<S>,
    /// Angles (rad) and their rates (rad/s), once the board has some.
    state: Option<[Pair<S>; 2]>,
    /// How far the angles were from the board's in the last substep, on average (rad).
    pub(super) away: Pair<S>,
    swing: Swing<S>,
}

/// What so many seconds leave of a free swing: the decay times cosine, and times sine over the ringing.
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
        // It has long been where it settles.
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
