//! Inner walls and holes as engines look for them: which are near, and when a marble meets a wall.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use pulp::{Scalar, Simd};

use crate::board::Rig;
use crate::lanes::{Lanes, Mask};
use crate::maze::Maze;
use crate::motion::length;

/// Most cells of the grid along an edge.
const MOST_CELLS: f64 = 64.0;

/// How far a marble may roll before its neighbourhood is looked up again, in radii.
const MARGIN: f64 = 1.5;

/// A gap below which a marble leans on a wall (m): far above rounding, far below anything else.
pub(crate) const TOUCH_M: f64 = 1e-9;

/// The middle line of a wall.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wall {
    /// Where it begins (m).
    pub(crate) begin: [f64; 2],
    /// Its direction, of length 1.
    pub(crate) along: [f64; 2],
    /// How long it is (m).
    pub(crate) length: f64,
}

/// The obstacles around a place.
#[derive(Debug, Clone, Default)]
pub(crate) struct Near {
    /// Numbers of walls and of holes, ascending.
    pub(crate) walls: Vec<usize>,
    pub(crate) holes: Vec<usize>,
}

/// The inside of a maze for one rig.
#[derive(Debug)]
pub(crate) struct Obstacles {
    pub(crate) walls: Vec<Wall>,
    /// How near to a wall's middle line a marble's centre gets (m).
    pub(crate) reach: f64,
    pub(crate) holes: Vec<[f64; 2]>,
    pub(crate) hole_radius: f64,
    /// Whoever has moved by less since a lookup is still among what was found there (m).
    pub(crate) margin: f64,
    /// Half the board's edges (m).
    half: [f64; 2],
    cells: [usize; 2],
    grid: Vec<Near>,
    /// All of them, for marbles that pass many cells at once.
    pub(crate) all: Near,
}

impl Obstacles {
    /// `maze` has passed [`Maze::check`]; nothing if it is bare.
    pub(crate) fn new(maze: &Maze, rig: &Rig) -> Option<Self> {
        if maze.is_bare() {
            return None;
        }
        let radius = rig.marble.radius_m;
        let half = [rig.board.edge_x_m / 2.0, rig.board.edge_y_m / 2.0];
        let cells = half.map(|half| (2.0 * half / radius).clamp(1.0, MOST_CELLS) as usize);
        let mut obstacles = Self {
            walls: maze.walls.iter().map(Wall::new).collect(),
            reach: radius + maze.wall_thickness_m / 2.0,
            holes: maze.holes.clone(),
            hole_radius: maze.hole_radius_m,
            margin: MARGIN * radius,
            half,
            cells,
            grid: vec![Near::default(); cells[0] * cells[1]],
            all: Near {
                walls: (0..maze.walls.len()).collect(),
                holes: (0..maze.holes.len()).collect(),
            },
        };
        obstacles.fill();
        Some(obstacles)
    }

    /// Enters each obstacle into the cells from which a marble can get to it without another lookup.
    fn fill(&mut self) {
        let size = [0, 1].map(|axis| 2.0 * self.half[axis] / self.cells[axis] as f64);
        let diagonal = 0.5 * size[0].hypot(size[1]);
        let middle = |cell: [usize; 2]| {
            [0, 1].map(|axis| (cell[axis] as f64 + 0.5) * size[axis] - self.half[axis])
        };
        let mut grid = std::mem::take(&mut self.grid);
        let enter = |ends: [[f64; 2]; 2], far: f64, note: &dyn Fn([f64; 2]) -> bool| {
            let low = self.cell([0, 1].map(|axis| ends[0][axis].min(ends[1][axis]) - far));
            let high = self.cell([0, 1].map(|axis| ends[0][axis].max(ends[1][axis]) + far));
            let mut found = Vec::new();
            for x in low[0]..=high[0] {
                for y in low[1]..=high[1] {
                    if note(middle([x, y])) {
                        found.push(self.place([x, y]));
                    }
                }
            }
            found
        };
        for (number, wall) in self.walls.iter().enumerate() {
            let far = self.reach + self.margin + diagonal;
            let ends = [wall.begin, wall.at(wall.length)];
            for place in enter(ends, far, &|middle| wall.distance(middle) <= far) {
                grid[place].walls.push(number);
            }
        }
        for (number, &hole) in self.holes.iter().enumerate() {
            let far = self.hole_radius + self.margin + diagonal;
            let note = |[x, y]: [f64; 2]| (x - hole[0]).hypot(y - hole[1]) <= far;
            for place in enter([hole, hole], far, &note) {
                grid[place].holes.push(number);
            }
        }
        self.grid = grid;
    }

    fn cell(&self, place: [f64; 2]) -> [usize; 2] {
        [0, 1].map(|axis| {
            let cells = self.cells[axis];
            let part = 0.5 + 0.5 * place[axis] / self.half[axis];
            ((part * cells as f64).max(0.0) as usize).min(cells - 1)
        })
    }

    fn place(&self, [x, y]: [usize; 2]) -> usize {
        x * self.cells[1] + y
    }

    /// What a marble can meet that moves by at most a margin from this place.
    pub(crate) fn near(&self, place: [f64; 2]) -> &Near {
        &self.grid[self.place(self.cell(place))]
    }

    /// What a marble can meet within so many metres of this place.
    pub(crate) fn within(&self, place: [f64; 2], way: f64) -> &Near {
        if way <= self.margin {
            self.near(place)
        } else {
            &self.all
        }
    }

    /// The nearest place outside of walls, if one of them holds this one.
    pub(crate) fn beside_walls(&self, place: [f64; 2]) -> [f64; 2] {
        self.near(place).walls.iter().fold(place, |place, &number| {
            let ([nx, ny], gap) = self.gap(number, place);
            let out = (-gap).max(0.0);
            [place[0] + out * nx, place[1] + out * ny]
        })
    }

    /// The wall that a marble meets first on its way: the direction from it, and the gap along that (m).
    pub(crate) fn meeting(&self, place: [f64; 2], by: [f64; 2]) -> Option<([f64; 2], f64)> {
        let one = |value: f64| Lanes::splat(Scalar::new(), value);
        let way = Way {
            from: place.map(one),
            by: by.map(one),
        };
        let always = one(0.0).le(one(0.0));
        let mut first = Meeting::none(one(0.0));
        for &number in &self.within(place, by[0].hypot(by[1])).walls {
            let wall = &self.walls[number];
            let walls = Walls {
                begin: wall.begin.map(one),
                along: wall.along.map(one),
                length: one(wall.length),
            };
            let counts = (one(number as f64), always);
            first = first.or_walls(&way, &walls, one(self.reach), counts);
        }
        let number = |one: Lanes<Scalar>| one.to_array()[0];
        let gap = number(first.part * first.against);
        first.hits().any().then(|| (first.normal.map(number), gap))
    }

    /// Whether a way leads over a hole.
    pub(crate) fn crosses_hole(&self, [x, y]: [f64; 2], by: [f64; 2]) -> bool {
        let square = by[0] * by[0] + by[1] * by[1];
        let holes = &self.within([x, y], square.sqrt()).holes;
        holes.iter().any(|&number| {
            let [cx, cy] = self.holes[number];
            let (rx, ry) = (x - cx, y - cy);
            let part = if square > 0.0 {
                (-(rx * by[0] + ry * by[1]) / square).clamp(0.0, 1.0)
            } else {
                0.0
            };
            (rx + part * by[0]).hypot(ry + part * by[1]) < self.hole_radius
        })
    }

    /// The direction from a wall to a marble's centre, of length 1, and the gap between the two (m).
    pub(crate) fn gap(&self, wall: usize, [x, y]: [f64; 2]) -> ([f64; 2], f64) {
        let wall = &self.walls[wall];
        let [rx, ry] = [x - wall.begin[0], y - wall.begin[1]];
        let along = (rx * wall.along[0] + ry * wall.along[1]).clamp(0.0, wall.length);
        let off = [rx - along * wall.along[0], ry - along * wall.along[1]];
        let distance = (off[0] * off[0] + off[1] * off[1]).sqrt();
        let direction = if distance > 0.0 {
            off.map(|off| off / distance)
        } else {
            [-wall.along[1], wall.along[0]]
        };
        (direction, distance - self.reach)
    }
}

impl Wall {
    fn new(&[x0, y0, x1, y1]: &[f64; 4]) -> Self {
        let [x, y] = [x1 - x0, y1 - y0];
        let length = (x * x + y * y).sqrt();
        // A wall without length is a post.
        let along = if length > 0.0 {
            [x / length, y / length]
        } else {
            [1.0, 0.0]
        };
        Self {
            begin: [x0, y0],
            along,
            length,
        }
    }

    fn at(&self, along: f64) -> [f64; 2] {
        [0, 1].map(|axis| self.begin[axis] + along * self.along[axis])
    }

    fn distance(&self, [x, y]: [f64; 2]) -> f64 {
        let [rx, ry] = [x - self.begin[0], y - self.begin[1]];
        let along = (rx * self.along[0] + ry * self.along[1]).clamp(0.0, self.length);
        let [nx, ny] = self.at(along);
        (x - nx).hypot(y - ny)
    }
}

/// One wall for each lane.
#[derive(Clone, Copy)]
pub(crate) struct Walls<S: Simd> {
    pub(crate) begin: [Lanes<S>; 2],
    pub(crate) along: [Lanes<S>; 2],
    pub(crate) length: Lanes<S>,
}

/// A way of marbles in a substep (m).
#[derive(Clone, Copy)]
pub(crate) struct Way<S: Simd> {
    pub(crate) from: [Lanes<S>; 2],
    pub(crate) by: [Lanes<S>; 2],
}

/// What marbles meet first on their way.
#[derive(Clone, Copy)]
pub(crate) struct Meeting<S: Simd> {
    /// Part of the way until then; above 1 where nothing is met.
    pub(crate) part: Lanes<S>,
    /// From the obstacle to the marble, of length 1.
    pub(crate) normal: [Lanes<S>; 2],
    /// The gap along the normal as the way begins (m); not above zero where the marble leans on what it meets.
    pub(crate) gap: Lanes<S>,
    /// How far the whole way leads against the normal (m).
    pub(crate) against: Lanes<S>,
    /// The number of what is met.
    pub(crate) number: Lanes<S>,
}

impl<S: Simd> Meeting<S> {
    /// Nothing.
    #[inline(always)]
    pub(crate) fn none(like: Lanes<S>) -> Self {
        let (zero, one) = (like.like(0.0), like.like(1.0));
        Self {
            part: like.like(2.0),
            normal: [one, zero],
            gap: one,
            against: zero,
            number: like.like(-1.0),
        }
    }

    #[inline(always)]
    pub(crate) fn hits(&self) -> Mask<S> {
        self.part.le(self.part.like(1.0))
    }

    /// Whether the marble leans on what it meets.
    #[inline(always)]
    pub(crate) fn leans(&self) -> Mask<S> {
        self.gap.le(self.gap.like(TOUCH_M))
    }

    /// Keeps what is met first; of two at once, what the way leads against more.
    #[inline(always)]
    pub(crate) fn or(self, other: &Self, counts: Mask<S>) -> Self {
        let first =
            other.part.lt(self.part) | other.part.le(self.part) & other.against.gt(self.against);
        let takes = counts & first;
        let take = |theirs: Lanes<S>, ours: Lanes<S>| takes.select(theirs, ours);
        Self {
            part: take(other.part, self.part),
            normal: [0, 1].map(|axis| take(other.normal[axis], self.normal[axis])),
            gap: take(other.gap, self.gap),
            against: take(other.against, self.against),
            number: take(other.number, self.number),
        }
    }

    /// Adds the straight sides and the round ends of walls, which have these numbers.
    #[inline(always)]
    pub(crate) fn or_walls(
        self,
        way: &Way<S>,
        walls: &Walls<S>,
        reach: Lanes<S>,
        (number, counts): (Lanes<S>, Mask<S>),
    ) -> Self {
        let ([x, y], [ux, uy]) = (way.from, walls.along);
        let (rx, ry) = (x - walls.begin[0], y - walls.begin[1]);
        let (along, across) = (rx * ux + ry * uy, ry * ux - rx * uy);
        let (dx, dy) = (
            way.by[0] * ux + way.by[1] * uy,
            way.by[1] * ux - way.by[0] * uy,
        );
        let zero = along.like(0.0);
        // What is further away than the way is long is not met.
        let beyond = along - along.max(zero).min(walls.length);
        let room = reach + length(dx, dy);
        let near = counts & (beyond * beyond + across * across).le(room * room);
        if !near.any() {
            return self;
        }
        let met = Self::side(along, across, [dx, dy], walls.length, reach)
            .or_end([along, across], [dx, dy], reach)
            .or_end([along - walls.length, across], [dx, dy], reach);
        let [na, nc] = met.normal;
        let met = Self {
            normal: [na * ux - nc * uy, na * uy + nc * ux],
            number,
            ..met
        };
        self.or(&met, near)
    }

    /// The straight side of walls that begin at the origin and lead along the first axis.
    #[inline(always)]
    fn side(
        along: Lanes<S>,
        across: Lanes<S>,
        [dx, dy]: [Lanes<S>; 2],
        end: Lanes<S>,
        reach: Lanes<S>,
    ) -> Self {
        let (zero, one) = (along.like(0.0), along.like(1.0));
        let side = across.lt(zero).select(-one, one);
        let (gap, against) = (side * across - reach, -(side * dy));
        let part = gap.max(zero).over(against);
        let at = along + part * dx;
        // Behind an end a marble may be lower than the side is high; there it meets the end.
        let meets = against.gt(zero) & gap.gt(-0.5 * reach) & at.ge(zero) & at.le(end);
        Self {
            part: meets.select(part, zero.like(2.0)),
            normal: [zero, side],
            gap,
            against,
            number: zero,
        }
    }

    /// Adds a round end, as seen from which the marbles lie at `from`.
    #[inline(always)]
    fn or_end(self, from: [Lanes<S>; 2], by: [Lanes<S>; 2], reach: Lanes<S>) -> Self {
        let zero = reach.like(0.0);
        let a = by[0] * by[0] + by[1] * by[1];
        let b = from[0] * by[0] + from[1] * by[1];
        let c = from[0] * from[0] + from[1] * from[1] - reach * reach;
        let root = b * b - a * c.max(zero);
        let part = c.max(zero).over(root.max(zero).sqrt() - b);
        let at = [0, 1].map(|axis| from[axis] + part * by[axis]);
        let across = length(at[0], at[1]);
        let normal = at.map(|at| at.over(across));
        let other = Self {
            part,
            normal,
            gap: (0.5 * c).over(reach),
            against: -(normal[0] * by[0] + normal[1] * by[1]),
            number: zero,
        };
        self.or(&other, b.lt(zero) & root.ge(zero))
    }
}
