//! One marble of a world, through its rollout.

use pulp::Scalar;
use rapier3d_f64::prelude::*;

use super::{FIXED, HAIR, LONGEST, MARBLES, SHORTEST, TOUCH, Wall, material, meeting};
use crate::board::{Rig, SUBSTEP_S};
use crate::effects::Any;
use crate::engine::actuation::Actuation;
use crate::engine::camera::Camera;
use crate::engine::hole::{After, Around, FLIES_M_S, Sphere, pass};
use crate::engine::obstacles::Obstacles;
use crate::engine::{Job, Setup, Sink};
use crate::lanes::Lanes;
use crate::maze::Fall;
use crate::motion::{Marbles, Push};

type One = Lanes<Scalar>;

pub(super) struct Marble<'a> {
    job: &'a Job<'a>,
    rig: &'a Rig,
    wall: Wall,
    /// The row after the last observed one.
    end: usize,
    body: RigidBodyHandle,
    actuation: Actuation<Scalar>,
    camera: Camera<Scalar>,
    forces: Vec<Any<Scalar>>,
    /// The next row to begin.
    row: usize,
    /// Substeps of the present row that are done, and how many it has; each is done in equal parts.
    done: u64,
    substeps: u64,
    parts: u64,
    /// Length of the marble's substeps over that of the world's.
    ///
    /// Where it is not 1 the marble lives in a time of its own: velocities and damping rates are
    /// multiplied by it, accelerations by its square. Positions, friction cones, restitution and
    /// what a contact corrects in a substep are the same in both times, and no impulse is kept from
    /// one substep to the next: but for rounding, this is the simulation with substeps of that
    /// length.
    pace: f64,
    /// Acceleration of the marble, in its own time (m/s²).
    pull: Vector,
    /// Maximum decrease of the rolling velocity by rolling resistance in a part, in its own time (m/s).
    resistance: f64,
    /// Maximum decrease of the spin about the vertical by friction with the board in a part, in its own time (m/s).
    spinning: f64,
    /// Position and velocity before the last part.
    before: Option<Marbles<Scalar>>,
    obstacles: Option<&'a Obstacles>,
    /// How the marble moves that crosses a hole, and whether it is still over it. Its body lies on the board
    /// meanwhile, so that its contacts keep their order.
    crossing: Option<(Sphere, bool)>,
    fallen: bool,
}

impl<'a> Marble<'a> {
    /// A marble in the corner of the board.
    pub(super) fn new(
        setup: &Setup<'a>,
        job: &'a Job<'a>,
        wall: Wall,
        world: &mut PhysicsWorld,
    ) -> Self {
        let rig = setup.rig;
        let radius = rig.marble.radius_m;
        let [x, y] = rig.reach_m();
        let body = RigidBodyBuilder::dynamic()
            .translation(Vector::new(x, y, radius))
            .can_sleep(false)
            .user_data(1.0_f64.to_bits().into())
            // A sphere feels none.
            .gyroscopic_forces_enabled(false)
            // Rapier's limit of an eighth of a turn a substep is 1.3 m/s for the paper's marble.
            .allow_fast_rotation(true);
        let ball = ColliderBuilder::ball(radius).mass(rig.marble.mass_kg);
        let ball = material(ball, 1.0, 1.0).collision_groups(meeting(MARBLES, FIXED));
        let (body, _) = world.insert(body, ball);
        let simd = Scalar::new();
        let actuation = Actuation::new(simd, setup, |_| job);
        Self {
            job,
            rig,
            wall,
            end: job.first + setup.rows,
            body,
            camera: Camera::new(simd, setup, &actuation, |_| job),
            forces: setup.forces(simd, &actuation.tilt, |_| job),
            actuation,
            row: job.first,
            done: 0,
            substeps: 0,
            parts: 1,
            pace: 1.0,
            pull: Vector::ZERO,
            resistance: 0.0,
            spinning: 0.0,
            before: None,
            obstacles: setup.obstacles.map(AsRef::as_ref),
            crossing: None,
            fallen: false,
        }
    }

    /// Puts the marble at its start, inside the rims, rolling without slip, once the knobs are there.
    pub(super) fn release(&mut self, bodies: &mut RigidBodySet) {
        for row in 0..self.job.first {
            self.begin_row(row);
            let (job, substeps) = (self.job, self.job.clock.step(row).substeps);
            let length = self.actuation.length(row, |_| job);
            for substep in 0..substeps {
                self.turn(row, substep);
                for effect in &mut self.forces {
                    effect.pass(&self.actuation.tilt, length);
                }
            }
        }
        let one = |values: [f64; 2]| values.map(|value| Lanes::splat(Scalar::new(), value));
        let (place, velocity) = self.camera.place(
            one(self.job.start),
            one(self.job.start_velocity),
            &self.actuation.tilt,
        );
        let radius = self.rig.marble.radius_m;
        let ([x, y], [vx, vy]) = (place.map(number), velocity.map(number));
        let [reach_x, reach_y] = self.rig.reach_m();
        let [x, y] = [x.clamp(-reach_x, reach_x), y.clamp(-reach_y, reach_y)];
        let beside = |obstacles: &Obstacles| obstacles.beside_walls([x, y]);
        let [x, y] = self.obstacles.map_or([x, y], beside);
        let start = Vector::new(x, y, radius);
        let marble = &mut bodies[self.body];
        marble.set_translation(start, false);
        marble.set_linvel(Vector::new(vx, vy, 0.0), false);
        marble.set_angvel(Vector::new(-vy, vx, 0.0) / radius, false);
    }

    /// Brings the marble to its next substep, over the rows that end here; false after the last.
    pub(super) fn prepare(&mut self, bodies: &mut RigidBodySet, out: &mut Sink<'_>) -> bool {
        let marble = &mut bodies[self.body];
        self.go_on(marble);
        self.expose(marble, out.marble);
        while self.done == self.substeps {
            if self.row == self.end {
                return false;
            }
            self.observe(marble, out);
            if self.row + 1 == self.end {
                marble.set_enabled(false);
            } else {
                self.begin_row(self.row);
                self.keep_pace(marble);
            }
            self.row += 1;
        }
        self.act(marble);
        self.done += 1;
        if self.fallen {
            return true;
        }
        if !self.cross_hole(marble, out) {
            self.meet(marble);
            self.resist(marble);
        }
        true
    }

    /// Issues a row's command.
    fn begin_row(&mut self, row: usize) {
        let job = self.job;
        self.actuation.begin_row(row, |_| job);
        if let Some(schedule) = &mut self.camera.schedule {
            schedule.begin_row(row);
        }
    }

    fn turn(&mut self, row: usize, substep: u32) {
        if self.actuation.moves() {
            self.actuation.substep(row, substep);
        }
    }

    fn observe(&mut self, marble: &RigidBody, out: &mut Sink<'_>) {
        let row = self.row - self.job.first;
        if let Some(tilt) = out.tilt.get_mut(row) {
            *tilt = self.actuation.gauged().map(number);
        }
        if row == 0 {
            out.marble[row] = self.job.start;
        } else if self.camera.schedule.is_none() {
            let Marbles { x, y, .. } = self.motion(marble);
            out.marble[row] = self.camera.see([x, y], &self.actuation.tilt).map(number);
        }
    }

    /// Takes the pictures that were due in the last part.
    fn expose(&mut self, marble: &RigidBody, out: &mut [[f64; 2]]) {
        let Some(before) = self.before.take() else {
            return;
        };
        let parts = self.parts as f64;
        let [begin, end] = [self.done - 1, self.done].map(|done| done as f64 / parts);
        let after = self.motion(marble);
        let write = |_, row: usize, seen| out[row] = seen;
        let motion = [&before, &after];
        self.camera
            .expose(self.row - 1, [begin, end], motion, &self.actuation, write);
    }

    /// Sets the marble's time for a row.
    fn keep_pace(&mut self, marble: &mut RigidBody) {
        (self.done, self.substeps) = (0, 0);
        let job = self.job;
        let pace = number(self.actuation.length(self.row, |_| job)) / SUBSTEP_S;
        if pace < SHORTEST {
            return;
        }
        let parts = (pace / LONGEST).ceil();
        self.parts = parts as u64;
        self.substeps = u64::from(job.clock.step(self.row).substeps) * self.parts;
        let change = pace / parts / self.pace;
        if change != 1.0 {
            marble.set_linvel(marble.linvel() * change, false);
            marble.set_angvel(marble.angvel() * change, false);
        }
        self.pace = pace / parts;
        marble.user_data = self.pace.to_bits().into();
    }

    /// Applies board, gravity and effects to the marble in its next part.
    fn act(&mut self, marble: &mut RigidBody) {
        let row = self.row - 1;
        if self.done.is_multiple_of(self.parts) {
            self.turn(row, (self.done / self.parts) as u32);
        }
        if self.camera.schedule.is_some() {
            self.before = Some(self.motion(marble));
        }
        if self.done > 0 && self.forces.is_empty() && !self.actuation.moves() {
            return;
        }
        let mut push = self.part_of(self.actuation.push);
        if !self.forces.is_empty() {
            let motion = self.motion(marble);
            for effect in &mut self.forces {
                effect.pass(&self.actuation.tilt, push.length);
                effect.act(&motion, &mut push);
            }
        }
        // What acts on one that is nowhere is not a number.
        if !self.fallen {
            self.push(&push, marble);
        }
    }

    /// Accelerations and friction limits of a part of a substep.
    fn part_of(&self, push: Push<Scalar>) -> Push<Scalar> {
        if self.parts == 1 {
            return push;
        }
        let part = 1.0 / self.parts as f64;
        let rate = self.rig.marble.damping_per_s;
        let length = part * push.length;
        let one = length.like(1.0);
        Push {
            x: part * push.x,
            y: part * push.y,
            normal: push.normal,
            resistance: part * push.resistance,
            grip: part * push.grip,
            spinning: part * push.spinning,
            damping: one.over(one + rate * length),
            length,
        }
    }

    /// Converts them into rapier's forces, in the marble's time.
    fn push(&mut self, push: &Push<Scalar>, marble: &mut RigidBody) {
        let [x, y, normal, length] = [push.x, push.y, push.normal, push.length].map(number);
        let pace = self.pace;
        self.pull = Vector::new(x / length, y / length, -normal) * (pace * pace);
        marble.reset_forces(false);
        marble.add_force(self.pull * self.rig.marble.mass_kg, false);
        self.resistance = number(push.resistance) * pace;
        self.spinning = number(push.spinning) * pace;
        let rate = (1.0 / number(push.damping) - 1.0) / SUBSTEP_S;
        marble.set_linear_damping(rate);
        marble.set_angular_damping(rate);
    }

    /// Position and velocity of the marble, in the common time.
    fn motion(&self, marble: &RigidBody) -> Marbles<Scalar> {
        let radius = self.rig.marble.radius_m;
        let one = |value: f64| Lanes::splat(Scalar::new(), value);
        if self.fallen {
            return Marbles::at_rest([one(f64::NAN); 2]);
        }
        let (place, v, spin) = (
            marble.translation(),
            marble.linvel() / self.pace,
            marble.angvel() * (radius / self.pace),
        );
        Marbles {
            x: one(place.x),
            y: one(place.y),
            vx: one(v.x),
            vy: one(v.y),
            sx: one(spin.y),
            sy: one(-spin.x),
            spin: one(spin.z),
            air: one(0.0),
        }
    }

    /// Lets a marble that crosses a hole have the velocity that it has there.
    fn go_on(&mut self, marble: &mut RigidBody) {
        let Some((sphere, _)) = self.crossing else {
            return;
        };
        let radius = self.rig.marble.radius_m;
        let [x, y, _] = sphere.place;
        let [height, pace] = [radius, self.pace];
        marble.set_translation(Vector::new(x, y, height), false);
        marble.set_linvel(Vector::from_array(sphere.velocity) * pace, false);
        marble.set_angvel(Vector::from_array(sphere.spin) * (pace / radius), false);
        marble.reset_forces(false);
        marble.add_force(self.pull * self.rig.marble.mass_kg, false);
    }

    /// Moves a marble in its next part that is over a hole or comes to one; false for any other.
    fn cross_hole(&mut self, marble: &mut RigidBody, out: &mut Sink<'_>) -> bool {
        let Some(obstacles) = self.obstacles else {
            return false;
        };
        let (radius, pace) = (self.rig.marble.radius_m, self.pace);
        let velocity = marble.linvel() + self.pull * SUBSTEP_S;
        let [way_x, way_y, _] = (velocity * SUBSTEP_S).to_array();
        let [x, y, height] = marble.translation().to_array();
        let over = matches!(self.crossing, Some((_, true)));
        let flies = way_x.hypot(way_y) > FLIES_M_S * SUBSTEP_S * pace;
        let mut sphere = match self.crossing.take() {
            Some((sphere, _)) => sphere,
            None => Sphere {
                place: [x, y, height],
                velocity: (marble.linvel() / pace).to_array(),
                spin: (marble.angvel() * (radius / pace)).to_array(),
            },
        };
        if !over && (flies || !obstacles.crosses_hole([x, y], [way_x, way_y])) {
            let [x, y, height] = sphere.place;
            marble.set_translation(Vector::new(x, y, height), false);
            return false;
        }
        let damping = 1.0 / (1.0 + marble.linear_damping() * SUBSTEP_S);
        for velocity in sphere.velocity.iter_mut().chain(&mut sphere.spin) {
            *velocity *= damping;
        }
        let around = Around {
            obstacles,
            radius,
            reach: self.rig.reach_m(),
            restitution: self.wall.restitution,
            wall_friction: self.wall.friction,
            sliding_friction: self.rig.board.sliding_friction,
            pull: (self.pull / (pace * pace)).to_array(),
            length: pace * SUBSTEP_S,
        };
        match pass(&mut sphere, &around) {
            After::Fallen(hole) => {
                self.fallen = true;
                marble.set_enabled(false);
                if let Some(fall) = out.fall.first_mut() {
                    let row = self.row - self.job.first;
                    *fall = Some(Fall { row, hole });
                }
                return true;
            }
            after => self.crossing = Some((sphere, after == After::OverHole)),
        }
        let [x, y, _] = sphere.place;
        marble.set_translation(Vector::new(x, y, radius), false);
        marble.set_linvel(Vector::ZERO, false);
        marble.set_angvel(Vector::ZERO, false);
        let weight = Vector::new(0.0, 0.0, self.pull.z) * self.rig.marble.mass_kg;
        marble.reset_forces(false);
        marble.add_force(weight, false);
        true
    }

    /// Puts a marble that will meet a wall or the board in this substep there.
    fn meet(&self, marble: &mut RigidBody) {
        let radius = self.rig.marble.radius_m;
        let mut position = marble.translation().to_array();
        let way = ((marble.linvel() + self.pull * SUBSTEP_S) * SUBSTEP_S).to_array();
        let mut meets = false;
        let mut meet = |axis: usize, side: f64, reach: f64| {
            let gap = reach - position[axis] * side;
            if gap > TOUCH * radius && gap < way[axis] * side {
                position[axis] = side * (reach - HAIR * radius);
                meets = true;
            }
        };
        let [reach_x, reach_y] = self.rig.reach_m();
        meet(0, way[0].signum(), reach_x);
        meet(1, way[1].signum(), reach_y);
        meet(2, -1.0, -radius);
        let met = |obstacles: &Obstacles| {
            let [x, y, _] = marble.translation().to_array();
            obstacles.meeting([x, y], [way[0], way[1]])
        };
        if let Some((normal, gap)) = self.obstacles.and_then(met)
            && gap > TOUCH * radius
        {
            for axis in 0..2 {
                position[axis] -= (gap - HAIR * radius) * normal[axis];
            }
            meets = true;
        }
        if meets {
            marble.set_translation(Vector::from_array(position), false);
        }
    }

    /// Rolling resistance of a substep, as a change of spin.
    ///
    /// A torque impulse L changes the velocity of a rolling sphere by L / (7/5 m R) and, before
    /// friction has shared it out, the spin alone by L / (2/5 m R²).
    fn resist(&self, marble: &mut RigidBody) {
        let radius = self.rig.marble.radius_m;
        let near = TOUCH * radius;
        let position = marble.translation();
        if position.z > radius + near {
            return;
        }
        let (v, spin) = (marble.linvel() + self.pull * SUBSTEP_S, marble.angvel());
        // A wall that holds the marble leaves no rolling towards it to resist.
        let free = |position: f64, velocity: f64, reach: f64| {
            let held = position.abs() >= reach - near && velocity * position > 0.0;
            if held { 0.0 } else { velocity }
        };
        let [reach_x, reach_y] = self.rig.reach_m();
        let mut x = free(
            position.x,
            (5.0 * v.x + 2.0 * radius * spin.y) / 7.0,
            reach_x,
        );
        let mut y = free(
            position.y,
            (5.0 * v.y - 2.0 * radius * spin.x) / 7.0,
            reach_y,
        );
        if let Some(obstacles) = self.obstacles {
            let place = [position.x, position.y];
            for &number in &obstacles.near(place).walls {
                let ([nx, ny], gap) = obstacles.gap(number, place);
                let towards = if gap < near {
                    (-(x * nx + y * ny)).max(0.0)
                } else {
                    0.0
                };
                (x, y) = (x + towards * nx, y + towards * ny);
            }
        }
        let speed = (x * x + y * y).sqrt();
        let taken = if speed > 0.0 {
            self.resistance.min(speed) / speed
        } else {
            0.0
        };
        let most = self.spinning / radius;
        let rolling = Vector::new(y, -x, 0.0) * (3.5 * taken / radius);
        let spinning = Vector::new(0.0, 0.0, spin.z.clamp(-most, most));
        marble.set_angvel(spin + rolling - spinning, false);
    }
}

/// Length of a marble's substeps over that of the world's.
pub(super) fn pace(marble: &RigidBody) -> f64 {
    f64::from_bits(marble.user_data as u64)
}

fn number(one: One) -> f64 {
    one.to_array()[0]
}
