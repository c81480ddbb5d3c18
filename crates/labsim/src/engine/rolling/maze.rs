//! Marbles among inner walls and holes.
//!
//! A substep is first taken as on the bare board. Where its way leads into a wall, it is taken again in a frame
//! whose first axis points into the wall at the place that is met first: there the wall is a rim, and everything
//! that rims do to marbles happens, from impact and hop to a roll along it. A wall is convex and lies behind the
//! plane in which it is met, so that it is not entered at any speed. The way that this leaves ends at the next
//! obstacle, a rim among them, if there is one; what remains of the substep is lost to the marble, as it is at a rim.
//!
//! A marble whose way leads over a hole goes on in three dimensions, in [`crate::engine::hole`].
//!
//! What each lane can meet is looked up in a grid, and again when its marble has rolled so far that it could meet
//! something else. Lists never decide about a result: what is out of reach changes nothing.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use std::sync::Arc;

use pulp::Simd;

use super::contact::substep;
use super::frame::Frame;
use super::impact::meet_rim;
use crate::board::Rig;
use crate::engine::hole::{After, Around, FLIES_M_S, Sphere, pass};
use crate::engine::obstacles::{Meeting, Near, Obstacles, Walls, Way};
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push, Rims, TINY};

/// Lanes of the widest register.
const WIDEST: usize = 8;

/// Distance of the rims in a wall's frame (m): no marble comes to the other three.
const FAR_M: f64 = 64.0;

/// Where the obstacles are that a lane does not have (m).
const NOWHERE_M: f64 = 1e9;

/// What is inside of the rims for the marbles of a register.
pub(crate) struct Inside<S: Simd> {
    obstacles: Arc<Obstacles>,
    rig: Rig,
    /// How far marbles may still roll until their lists are looked up again (m).
    budget: Lanes<S>,
    walls: Vec<[[f64; WIDEST]; 5]>,
    holes: Vec<[[f64; WIDEST]; 2]>,
    /// How many walls and holes each lane has.
    counts: [[usize; 2]; WIDEST],
    /// Heights (m) and upward velocities (m/s) of marbles over holes.
    over: [Option<[f64; 2]>; WIDEST],
    /// The row in which each lane's marble fell, and through which hole.
    pub(crate) fallen: [Option<(usize, usize)>; WIDEST],
    /// 1 for each lane whose marble has fallen.
    gone: Lanes<S>,
}

impl<S: Simd> Inside<S> {
    pub(crate) fn new(simd: S, rig: &Rig, obstacles: &Arc<Obstacles>) -> Self {
        Self {
            obstacles: Arc::clone(obstacles),
            rig: *rig,
            budget: Lanes::splat(simd, 0.0),
            walls: Vec::new(),
            holes: Vec::new(),
            counts: [[0; 2]; WIDEST],
            over: [None; WIDEST],
            fallen: [None; WIDEST],
            gone: Lanes::splat(simd, 0.0),
        }
    }

    /// Puts marbles that begin in a wall beside it.
    pub(crate) fn release(&self, marbles: &mut Marbles<S>) {
        let (x, y) = (marbles.x.to_array(), marbles.y.to_array());
        let place = |lane: usize| self.obstacles.beside_walls([x[lane], y[lane]]);
        marbles.x = Lanes::from_fn(marbles.x.simd(), |lane| place(lane)[0]);
        marbles.y = Lanes::from_fn(marbles.x.simd(), |lane| place(lane)[1]);
    }

    /// Moves marbles by a substep of a row.
    #[inline(always)]
    pub(super) fn substep(
        &mut self,
        rims: &Rims<S>,
        marbles: &Marbles<S>,
        push: &Push<S>,
        row: usize,
    ) -> Marbles<S> {
        let ahead = furthest(marbles, push);
        if self.budget.lt(ahead).any() {
            self.look_up(marbles, ahead);
        }
        let mut next = substep(rims, marbles, push);
        if !self.walls.is_empty() {
            next = self.meet_walls(rims, marbles, push, &next);
        }
        if !self.holes.is_empty() {
            next = self.cross_holes(rims, marbles, push, &next, row);
        }
        let gone = self.gone.gt(self.gone.like(0.0));
        if gone.any() {
            // Whoever keeps a marble between rims would find it there.
            let nowhere = self.gone.like(f64::NAN);
            next.x = gone.select(nowhere, next.x);
            next.y = gone.select(nowhere, next.y);
        }
        self.budget = self.budget - ((next.x - marbles.x).abs() + (next.y - marbles.y).abs());
        next
    }

    /// Renews the lists of the lanes whose budget no longer covers how far they may roll.
    fn look_up(&mut self, marbles: &Marbles<S>, ahead: Lanes<S>) {
        let [x, y, way, mut budget] =
            [marbles.x, marbles.y, ahead, self.budget].map(Lanes::to_array);
        let obstacles = Arc::clone(&self.obstacles);
        for lane in 0..S::F64_LANES {
            // Not a number where the marble has fallen.
            if budget[lane] < way[lane] {
                let near = obstacles.within([x[lane], y[lane]], way[lane]);
                self.enter(lane, near);
                budget[lane] = if way[lane] <= obstacles.margin {
                    obstacles.margin
                } else {
                    0.0
                };
            }
        }
        self.budget = Lanes::load(marbles.x.simd(), &budget);
        let most = |of: usize| (0..S::F64_LANES).map(|lane| self.counts[lane][of]).max();
        let (walls, holes) = (most(0).unwrap_or(0), most(1).unwrap_or(0));
        self.walls.truncate(walls);
        self.holes.truncate(holes);
    }

    /// Gives a lane these obstacles.
    fn enter(&mut self, lane: usize, near: &Near) {
        let (walls, holes) = (near.walls.len(), near.holes.len());
        if self.walls.len() < walls {
            self.walls.resize(walls, nowhere());
        }
        if self.holes.len() < holes {
            self.holes.resize(holes, [[NOWHERE_M; WIDEST]; 2]);
        }
        for (slot, entry) in self.walls.iter_mut().enumerate() {
            let numbers =
                near.walls
                    .get(slot)
                    .map_or([NOWHERE_M, NOWHERE_M, 1.0, 0.0, 0.0], |&number| {
                        let wall = &self.obstacles.walls[number];
                        let ([x, y], [ux, uy]) = (wall.begin, wall.along);
                        [x, y, ux, uy, wall.length]
                    });
            for (array, number) in entry.iter_mut().zip(numbers) {
                array[lane] = number;
            }
        }
        for (slot, entry) in self.holes.iter_mut().enumerate() {
            let [x, y] = near
                .holes
                .get(slot)
                .map_or([NOWHERE_M; 2], |&number| self.obstacles.holes[number]);
            (entry[0][lane], entry[1][lane]) = (x, y);
        }
        self.counts[lane] = [walls, holes];
    }

    /// What marbles meet first on their way, but for the wall of these numbers.
    #[inline(always)]
    fn first_met(&self, way: &Way<S>, but: Lanes<S>) -> Meeting<S> {
        let simd = but.simd();
        let reach = Lanes::splat(simd, self.obstacles.reach);
        let mut first = Meeting::none(but);
        for (slot, entry) in self.walls.iter().enumerate() {
            let [x, y, ux, uy, length] = entry.each_ref().map(|array| Lanes::load(simd, array));
            let walls = Walls {
                begin: [x, y],
                along: [ux, uy],
                length,
            };
            let number = Lanes::splat(simd, slot as f64);
            first = first.or_walls(way, &walls, reach, (number, number.ne(but)));
        }
        first
    }

    #[inline(always)]
    fn meet_walls(
        &self,
        rims: &Rims<S>,
        marbles: &Marbles<S>,
        push: &Push<S>,
        next: &Marbles<S>,
    ) -> Marbles<S> {
        let from = [marbles.x, marbles.y];
        let way = Way {
            from,
            by: [next.x - marbles.x, next.y - marbles.y],
        };
        let nobody = marbles.x.like(-1.0);
        let first = self.first_met(&way, nobody);
        let meets = first.hits();
        if !meets.any() {
            return *next;
        }
        let (zero, far) = (marbles.x.like(0.0), marbles.x.like(FAR_M));
        let frame = Frame::into(&first);
        let leans = first.leans();
        let gap = leans.select(zero, first.part * first.against);
        let local = frame.enter(marbles, far - gap);
        let [push_x, push_y] = frame.seen([push.x, push.y]);
        let local_push = Push {
            x: push_x,
            y: push_y,
            ..*push
        };
        let behind = Rims {
            reach_x: far,
            reach_y: far,
            ..*rims
        };
        let moved = substep(&behind, &local, &local_push);
        // What rounding has put into the wall, or off it, is taken back.
        let off = leans.select(first.gap, zero);
        let from = [0, 1].map(|axis| from[axis] - off * first.normal[axis]);
        let by = frame.back([moved.x - local.x, moved.y]);
        let met = self.meet_next(
            rims,
            push,
            &frame.leave(&moved),
            &Way { from, by },
            first.number,
        );
        Marbles::select(meets, &met, next)
    }

    /// Ends the way of marbles that have met a wall where they meet something else.
    #[inline(always)]
    fn meet_next(
        &self,
        rims: &Rims<S>,
        push: &Push<S>,
        marbles: &Marbles<S>,
        way: &Way<S>,
        but: Lanes<S>,
    ) -> Marbles<S> {
        let zero = but.like(0.0);
        let mut second = self.first_met(way, but);
        let reaches = [rims.reach_x, rims.reach_y];
        for axis in 0..2 {
            let side = way.by[axis].lt(zero).select(but.like(-1.0), but.like(1.0));
            let (gap, against) = (reaches[axis] - side * way.from[axis], side * way.by[axis]);
            let mut normal = [zero; 2];
            normal[axis] = -side;
            let rim = Meeting {
                part: gap.max(zero).over(against),
                normal,
                gap,
                against,
                number: but,
            };
            second = second.or(&rim, against.gt(gap) & against.gt(zero));
        }
        let meets = second.hits();
        let part = meets.select(second.part, but.like(1.0));
        let place = [0, 1].map(|axis| (way.from[axis] + part * way.by[axis]).clamp(reaches[axis]));
        let mut end = Marbles {
            x: place[0],
            y: place[1],
            ..*marbles
        };
        if meets.any() {
            let frame = Frame::into(&second);
            let far = but.like(FAR_M);
            // Barely before the plane, so that the marble meets it and does not lean on it.
            let before = far.like(FAR_M * (1.0 - f64::EPSILON));
            let local = frame.enter(&end, second.leans().select(far, before));
            let struck = frame.leave(&meet_rim(rims, far, push, &local));
            let struck = Marbles {
                x: end.x,
                y: end.y,
                ..struck
            };
            end = Marbles::select(meets, &struck, &end);
        }
        end
    }

    #[inline(always)]
    fn cross_holes(
        &mut self,
        rims: &Rims<S>,
        marbles: &Marbles<S>,
        push: &Push<S>,
        next: &Marbles<S>,
        row: usize,
    ) -> Marbles<S> {
        let simd = marbles.x.simd();
        let (zero, one) = (marbles.x.like(0.0), marbles.x.like(1.0));
        let by = [next.x - marbles.x, next.y - marbles.y];
        let square = by[0] * by[0] + by[1] * by[1] + marbles.x.like(TINY);
        let radius = self.obstacles.hole_radius;
        let room = square.sqrt() + zero.like(radius);
        let mut crosses = zero;
        for entry in &self.holes {
            let [x, y] = entry.each_ref().map(|array| Lanes::load(simd, array));
            let (rx, ry) = (marbles.x - x, marbles.y - y);
            // What is further away than the way is long is not crossed.
            if !(rx * rx + ry * ry).le(room * room).any() {
                continue;
            }
            let part = (-(rx * by[0] + ry * by[1])).over(square).max(zero).min(one);
            let (nx, ny) = (rx + part * by[0], ry + part * by[1]);
            let inside = (nx * nx + ny * ny).lt(zero.like(radius * radius));
            crosses = inside.select(one, crosses);
        }
        if !crosses.gt(zero).any() && self.over.iter().all(Option::is_none) {
            return *next;
        }
        self.fall(rims, marbles, push, next, (crosses, row))
    }

    /// Moves the marbles that cross holes, lane by lane.
    fn fall(
        &mut self,
        rims: &Rims<S>,
        marbles: &Marbles<S>,
        push: &Push<S>,
        next: &Marbles<S>,
        (crosses, row): (Lanes<S>, usize),
    ) -> Marbles<S> {
        let simd = marbles.x.simd();
        let crosses = crosses.to_array();
        let before = Columns::of(marbles);
        let mut after = Columns::of(next);
        let pushes = [push.x, push.y, push.normal, push.damping, push.length].map(Lanes::to_array);
        let wall_friction = rims.friction.to_array();
        let (reach_x, reach_y) = (rims.reach_x.to_array(), rims.reach_y.to_array());
        for lane in 0..S::F64_LANES {
            let [x, y, vx, vy, sx, sy, spin, air] = before.0.map(|column| column[lane]);
            let [push_x, push_y, normal, damping, length] = pushes.map(|column| column[lane]);
            let flies = vx.hypot(vy) > FLIES_M_S;
            if self.over[lane].is_none() && (crosses[lane] == 0.0 || flies)
                || self.fallen[lane].is_some()
            {
                continue;
            }
            let radius = self.rig.marble.radius_m;
            // A marble that hops lands when its time is up.
            let [height, up] = self.over[lane].unwrap_or([radius, 0.5 * normal * air]);
            let mut sphere = Sphere {
                place: [x, y, height],
                velocity: [vx, vy, up].map(|velocity| velocity * damping),
                spin: [-sy, sx, spin].map(|velocity| velocity * damping),
            };
            let around = Around {
                obstacles: &self.obstacles,
                radius,
                reach: [reach_x[lane], reach_y[lane]],
                restitution: rims.restitution.of_lane(lane),
                wall_friction: wall_friction[lane],
                sliding_friction: self.rig.board.sliding_friction,
                pull: [push_x / length, push_y / length, -normal],
                length,
            };
            let outcome = pass(&mut sphere, &around);
            let ([x, y, height], [vx, vy, up]) = (sphere.place, sphere.velocity);
            let [wx, wy, wz] = sphere.spin;
            let mut air = 0.0;
            self.over[lane] = None;
            match outcome {
                After::OverHole => self.over[lane] = Some([height, up]),
                After::OnBoard => air = air_time(&sphere, radius, normal),
                After::Fallen(hole) => {
                    self.fallen[lane] = Some((row, hole));
                    after.set(lane, [0.0; 8]);
                    continue;
                }
            }
            after.set(lane, [x, y, vx, vy, wy, -wx, wz, air]);
        }
        self.gone = Lanes::from_fn(simd, |lane| {
            f64::from(u8::from(self.fallen[lane].is_some()))
        });
        after.load(simd)
    }
}

/// A wall that no marble meets, in every lane.
fn nowhere() -> [[f64; WIDEST]; 5] {
    [NOWHERE_M, NOWHERE_M, 1.0, 0.0, 0.0].map(|number| [number; WIDEST])
}

/// How long a marble above the board takes to land (s).
fn air_time(sphere: &Sphere, radius: f64, normal: f64) -> f64 {
    let (height, up) = (sphere.place[2] - radius, sphere.velocity[2]);
    if height <= 0.0 || normal <= 0.0 {
        return 0.0;
    }
    (up + (up * up + 2.0 * normal * height).sqrt()) / normal
}

/// The most that marbles can move in a substep (m), into a wall and back: by all their energy.
#[inline(always)]
fn furthest<S: Simd>(marbles: &Marbles<S>, push: &Push<S>) -> Lanes<S> {
    let (vx, vy) = (
        marbles.vx.abs() + push.x.abs(),
        marbles.vy.abs() + push.y.abs(),
    );
    let Marbles { sx, sy, spin, .. } = *marbles;
    let turning = sx * sx + sy * sy + spin * spin;
    let square = vx * vx + vy * vy + 0.4 * turning;
    2.0 * (push.length * square.sqrt())
}

/// The numbers of marbles, for what is done lane by lane.
struct Columns([[f64; WIDEST]; 8]);

impl Columns {
    fn of<S: Simd>(marbles: &Marbles<S>) -> Self {
        let Marbles {
            x,
            y,
            vx,
            vy,
            sx,
            sy,
            spin,
            air,
        } = *marbles;
        Self([x, y, vx, vy, sx, sy, spin, air].map(Lanes::to_array))
    }

    fn set(&mut self, lane: usize, numbers: [f64; 8]) {
        for (column, number) in self.0.iter_mut().zip(numbers) {
            column[lane] = number;
        }
    }

    fn load<S: Simd>(&self, simd: S) -> Marbles<S> {
        let [x, y, vx, vy, sx, sy, spin, air] =
            self.0.each_ref().map(|column| Lanes::load(simd, column));
        Marbles {
            x,
            y,
            vx,
            vy,
            sx,
            sy,
            spin,
            air,
        }
    }
}
