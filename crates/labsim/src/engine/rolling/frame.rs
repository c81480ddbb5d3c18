//! The frame in which what a marble meets lies behind a plane across the first axis, as a rim does.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use pulp::Simd;

use crate::engine::obstacles::Meeting;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Pair};

/// A frame whose first axis points into what is met.
#[derive(Clone, Copy)]
pub(super) struct Frame<S: Simd> {
    axis: Pair<S>,
}

impl<S: Simd> Frame<S> {
    #[inline(always)]
    pub(super) fn into(met: &Meeting<S>) -> Self {
        Self {
            axis: met.normal.map(|normal| -normal),
        }
    }

    /// A vector of the board as the frame has it.
    #[inline(always)]
    pub(super) fn seen(&self, [x, y]: Pair<S>) -> Pair<S> {
        let [ax, ay] = self.axis;
        [ax * x + ay * y, ax * y - ay * x]
    }

    /// A vector of the frame as the board has it.
    #[inline(always)]
    pub(super) fn back(&self, [x, y]: Pair<S>) -> Pair<S> {
        let [ax, ay] = self.axis;
        [ax * x - ay * y, ay * x + ax * y]
    }

    /// Marbles at a place along the first axis.
    #[inline(always)]
    pub(super) fn enter(&self, marbles: &Marbles<S>, at: Lanes<S>) -> Marbles<S> {
        let [vx, vy] = self.seen([marbles.vx, marbles.vy]);
        let [sx, sy] = self.seen([marbles.sx, marbles.sy]);
        Marbles {
            x: at,
            y: at.like(0.0),
            vx,
            vy,
            sx,
            sy,
            ..*marbles
        }
    }

    /// The motion of marbles of the frame on the board.
    #[inline(always)]
    pub(super) fn leave(&self, marbles: &Marbles<S>) -> Marbles<S> {
        let [vx, vy] = self.back([marbles.vx, marbles.vy]);
        let [sx, sy] = self.back([marbles.sx, marbles.sy]);
        Marbles {
            vx,
            vy,
            sx,
            sy,
            ..*marbles
        }
    }
}
