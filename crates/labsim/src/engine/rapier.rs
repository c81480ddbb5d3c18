//! Full 3-D rigid bodies: the reference engine, on rapier3d.
//!
//! A world holds the board, its four rim walls and up to [`GROUP`] marbles, which meet board and
//! walls but not each other. The board stays fixed; gravity turns instead, for each marble by its
//! own knobs, and acts as a force. A world steps by 1/240 s, and every marble follows its own clock:
//! it is observed and given its next command when the substeps of its row are done.
//!
//! Rapier knows no rolling resistance. Before each substep a marble's spin is changed by what the
//! resisting torque does in that time: `μ R N h`, or less if less already stops it. Contact forces
//! do not change the angular momentum about the point of contact, so the rolling velocity after
//! the substep is known before it, and a marble whose push is below the resistance rests exactly.
//!
//! A marble's bits do not depend on its company. Marbles share no contact, the solver computes its
//! SIMD lanes alike, and what remains is the order in which it solves the contacts of one marble:
//! ascending by colour. A contact takes the highest colour that its marble has free when it begins;
//! of those that begin together, the one whose bodies have the lowest indices comes first. Hence a
//! body for each wall, inserted before the marbles, and none for the board. (Walls without bodies
//! would follow the order in which the broad phase found them, and colours that 125 contacts or
//! more share would be solved first: both are matters of company.)
//!
//! The order matters for another reason. One pass over the contacts is exact for the last of them.
//! With the board last, its friction presses a marble that still spins into the wall, which then
//! throws it back; with the walls last, an impact keeps spin, restitution and hop as theory has
//! them. So marbles first touch board and walls together, in a corner: the two highest colours are
//! the walls' from then on.
//!
//! Rapier spreads an impact over the substep that brings the marble to the wall and the next, and
//! lets it bounce between the two, before friction has felt the whole of it. A marble that will
//! meet a wall within a substep is therefore put there at once, where that substep would end.

use std::sync::atomic::{AtomicBool, Ordering};

use pulp::Scalar;
use rapier3d_f64::prelude::*;

use super::Job;
use super::lanes::Lanes;
use crate::board::{BOARD_FRICTION, GRAVITY, Rig, SUBSTEP_S};

/// The most marbles to a world: enough to share its overhead, few enough to stay in the cache.
pub(crate) const GROUP: usize = 64;

/// Natural frequency of a contact (Hz). Softer contacts let the marble sink, which shortens the arm
/// of friction: rapier's 30 to 60 Hz cost 1 % of the acceleration, this costs 0.005 %.
const CONTACT_HZ: f64 = 480.0;

/// The distance at which contacts begin, in radii. Hops that stay below it keep the order of
/// contacts as it is; friction moves a marble a hundredth of it in a substep.
const FORESIGHT: f64 = 0.3;

/// Substeps longer than this many of the world's are split, since a marble sinks into the board by
/// the square of their length.
const LONGEST: f64 = 2.0;

/// Substeps shorter than this part of the world's do not move the marble.
const SHORTEST: f64 = 1e-9;

/// How near to board or wall a marble touches it, in radii; contacts settle to within 1e-3.
const TOUCH: f64 = 1e-3;

/// The gap at which an impact begins, in radii: the smallest that is surely one, since contacts
/// without a gap are soft.
const HAIR: f64 = 1e-6;

const FIXED: Group = Group::GROUP_1;
const MARBLES: Group = Group::GROUP_2;

/// Simulates up to [`GROUP`] rollouts in one world; `out[j][i]` becomes the observation of job j
/// at row i.
pub(crate) fn run(rig: &Rig, jobs: &[Job<'_>], out: &mut [&mut [[f64; 2]]], cancel: &AtomicBool) {
    let mut world = world(rig);
    let mut marbles: Vec<Marble<'_>> = jobs
        .iter()
        .map(|job| Marble::new(rig, job, &mut world))
        .collect();
    give_walls_the_last_word(&mut world);
    for marble in &marbles {
        marble.place(rig, &mut world.bodies);
    }
    loop {
        let mut moving = false;
        for (marble, out) in marbles.iter_mut().zip(out.iter_mut()) {
            moving |= marble.prepare(rig, &mut world.bodies, out);
        }
        if !moving || cancel.load(Ordering::Relaxed) {
            return;
        }
        world.step();
    }
}

/// The board and its walls, with nothing on it yet.
fn world(rig: &Rig) -> PhysicsWorld {
    let mut world = PhysicsWorld {
        gravity: Vector::ZERO,
        integration_parameters: parameters(rig),
        ..PhysicsWorld::default()
    };
    world.physics_pipeline.counters.disable();

    let [x, y] = [rig.board.edge_x_m / 2.0, rig.board.edge_y_m / 2.0];
    // Thick, overlapping at the corners and higher than any marble climbs by its spin.
    let far = 10.0 * (x + y);
    for (inner, along) in [
        (x, Vector::X),
        (-x, Vector::X),
        (y, Vector::Y),
        (-y, Vector::Y),
    ] {
        let centre = along * (inner + far.copysign(inner));
        let wall = ColliderBuilder::cuboid(far, far, 1000.0 * far);
        // Rapier bounds friction by the impulse that stops the marble; what throws it back comes
        // after. Coulomb's bound is for both.
        let friction = rig.board.wall_friction * (1.0 + rig.board.wall_restitution);
        let wall = surface(wall, friction, rig.board.wall_restitution);
        world.insert(RigidBodyBuilder::fixed().translation(centre), wall);
    }
    let board = ColliderBuilder::new(SharedShape::halfspace(Vector::Z));
    world.insert_collider(surface(board, BOARD_FRICTION, 0.0), None);
    world
}

/// Lets the marbles' contacts begin, all of them in a corner, without moving anything.
fn give_walls_the_last_word(world: &mut PhysicsWorld) {
    world.integration_parameters.dt = 0.0;
    world.step();
    world.integration_parameters.dt = SUBSTEP_S;
}

/// How rapier steps this world.
fn parameters(rig: &Rig) -> IntegrationParameters {
    // Boxes of the broad phase are 4 % of this unit larger than what they hold, so a marble rolls
    // about its radius before its box is made anew.
    let length_unit = 30.0 * rig.marble.radius_m;
    let softness = SpringCoefficients::new(CONTACT_HZ, 1.0);
    IntegrationParameters {
        dt: SUBSTEP_S,
        contact_softness: softness,
        static_contact_softness: softness,
        length_unit,
        normalized_prediction_distance: FORESIGHT * rig.marble.radius_m / length_unit,
        normalized_max_linear_velocity: f64::MAX,
        // One pass that includes friction, then the positions. A stabilising pass would change the
        // velocities after them; impulses from the last substep would outlive their cause.
        num_solver_iterations: 1,
        num_internal_pgs_iterations: 1,
        num_internal_stabilization_iterations: 0,
        warmstart_coefficient: 0.0,
        max_ccd_substeps: 0,
        contact_clustering: false,
        // A recycled contact keeps its points while the marble rolls on.
        contact_recycling: false,
        ..IntegrationParameters::default()
    }
}

/// A collider of the board or rim: its own coefficients count, since the marble's are 1.
fn surface(collider: ColliderBuilder, friction: f64, restitution: f64) -> ColliderBuilder {
    material(collider, friction, restitution).collision_groups(meeting(FIXED, MARBLES))
}

fn material(collider: ColliderBuilder, friction: f64, restitution: f64) -> ColliderBuilder {
    collider
        .friction(friction)
        .friction_combine_rule(CoefficientCombineRule::Multiply)
        .restitution(restitution)
        .restitution_combine_rule(CoefficientCombineRule::Multiply)
}

fn meeting(memberships: Group, filter: Group) -> InteractionGroups {
    InteractionGroups::new(memberships, filter, InteractionTestMode::And)
}

/// Sine and cosine with the same bits on every machine, which the system's are not.
fn sin_cos(x: f64) -> (f64, f64) {
    let x = Lanes::splat(Scalar::new(), x);
    (x.sin().to_array()[0], x.cos().to_array()[0])
}

/// A marble on its way through its rollout.
struct Marble<'a> {
    job: &'a Job<'a>,
    body: RigidBodyHandle,
    /// Observed edges a metre.
    edges_per_m: f64,
    /// The next row to observe.
    row: usize,
    /// Substeps until then.
    substeps: u64,
    /// Length of the marble's substeps over that of the world's.
    ///
    /// Where it is not 1 the marble lives in a time of its own: velocities and damping rates are
    /// multiplied by it, accelerations by its square. Positions, friction cones, restitution and
    /// what a contact corrects in a substep are the same in both times, and no impulse is kept from
    /// one substep to the next: but for rounding, this is the simulation with substeps of that
    /// length.
    pace: f64,
    /// Push of gravity in the board's frame in the marble's time (m/s²).
    gravity: Vector,
}

impl<'a> Marble<'a> {
    /// A marble in the corner of the board.
    fn new(rig: &Rig, job: &'a Job<'a>, world: &mut PhysicsWorld) -> Self {
        let radius = rig.marble.radius_m;
        let [x, y] = rig.reach_m();
        let body = RigidBodyBuilder::dynamic()
            .translation(Vector::new(x, y, radius))
            .can_sleep(false)
            // A sphere feels none.
            .gyroscopic_forces_enabled(false)
            // Rapier's limit of an eighth of a turn a substep is 1.3 m/s for the paper's marble.
            .allow_fast_rotation(true);
        let ball = ColliderBuilder::ball(radius).mass(rig.marble.mass_kg);
        let ball = material(ball, 1.0, 1.0).collision_groups(meeting(MARBLES, FIXED));
        let (body, _) = world.insert(body, ball);
        Self {
            job,
            body,
            edges_per_m: job.parameters.observation_scale / rig.board.edge_x_m,
            row: 0,
            substeps: 0,
            pace: 1.0,
            gravity: Vector::ZERO,
        }
    }

    /// Puts the marble at its start, inside the rims, rolling without slip.
    fn place(&self, rig: &Rig, bodies: &mut RigidBodySet) {
        let radius = rig.marble.radius_m;
        let [reach_x, reach_y] = rig.reach_m();
        let [x, y] = self.job.start.map(|edges| edges / self.edges_per_m);
        let [vx, vy] = self
            .job
            .start_velocity
            .map(|edges| edges / self.edges_per_m);
        let start = Vector::new(
            x.clamp(-reach_x, reach_x),
            y.clamp(-reach_y, reach_y),
            radius,
        );
        let marble = &mut bodies[self.body];
        marble.set_translation(start, false);
        marble.set_linvel(Vector::new(vx, vy, 0.0), false);
        marble.set_angvel(Vector::new(-vy, vx, 0.0) / radius, false);
    }

    /// Brings the marble to its next substep, over the rows that end here; false after the last.
    fn prepare(&mut self, rig: &Rig, bodies: &mut RigidBodySet, out: &mut [[f64; 2]]) -> bool {
        while self.substeps == 0 {
            if self.row == out.len() {
                return false;
            }
            let marble = &mut bodies[self.body];
            out[self.row] = self.observe(marble);
            if self.row + 1 == out.len() {
                marble.set_enabled(false);
            } else {
                self.command(rig, marble);
            }
            self.row += 1;
        }
        self.substeps -= 1;
        let marble = &mut bodies[self.body];
        self.meet(rig, marble);
        self.resist(rig, marble);
        true
    }

    fn observe(&self, marble: &RigidBody) -> [f64; 2] {
        let position = marble.translation();
        match self.row {
            0 => self.job.start,
            _ => [position.x * self.edges_per_m, position.y * self.edges_per_m],
        }
    }

    /// Tilts the board by the command of this row and sets the marble's time.
    fn command(&mut self, rig: &Rig, marble: &mut RigidBody) {
        let step = self.job.clock.step(self.row);
        let pace = step.length_s / SUBSTEP_S;
        if pace < SHORTEST {
            return;
        }
        let parts = (pace / LONGEST).ceil();
        self.substeps = u64::from(step.substeps) * parts as u64;
        self.keep_pace(pace / parts, rig, marble);

        let [knob_x, knob_y] = self.job.commands[self.row];
        let (sin_x, cos_x) = sin_cos(self.job.parameters.gear_x * knob_x);
        let (sin_y, cos_y) = sin_cos(self.job.parameters.gear_y * knob_y);
        // The board turned about x first, then about y.
        let down = Vector::new(sin_y, -sin_x * cos_y, -cos_x * cos_y);
        self.gravity = down * (GRAVITY * self.pace * self.pace);
        marble.reset_forces(false);
        marble.add_force(self.gravity * rig.marble.mass_kg, false);
    }

    fn keep_pace(&mut self, pace: f64, rig: &Rig, marble: &mut RigidBody) {
        let change = pace / self.pace;
        if change != 1.0 {
            marble.set_linvel(marble.linvel() * change, false);
            marble.set_angvel(marble.angvel() * change, false);
        }
        self.pace = pace;
        marble.set_linear_damping(rig.marble.damping_per_s * pace);
        marble.set_angular_damping(rig.marble.damping_per_s * pace);
    }

    /// Puts a marble that will meet a wall or the board in this substep there.
    fn meet(&self, rig: &Rig, marble: &mut RigidBody) {
        let radius = rig.marble.radius_m;
        let mut position = marble.translation().to_array();
        let way = ((marble.linvel() + self.gravity * SUBSTEP_S) * SUBSTEP_S).to_array();
        let mut meets = false;
        let mut meet = |axis: usize, side: f64, reach: f64| {
            let gap = reach - position[axis] * side;
            if gap > TOUCH * radius && gap < way[axis] * side {
                position[axis] = side * (reach - HAIR * radius);
                meets = true;
            }
        };
        let [reach_x, reach_y] = rig.reach_m();
        meet(0, way[0].signum(), reach_x);
        meet(1, way[1].signum(), reach_y);
        meet(2, -1.0, -radius);
        if meets {
            marble.set_translation(Vector::from_array(position), false);
        }
    }

    /// Rolling resistance of a substep, as a change of spin.
    ///
    /// A torque impulse L changes the velocity of a rolling sphere by L / (7/5 m R) and, before
    /// friction has shared it out, the spin alone by L / (2/5 m R²).
    fn resist(&self, rig: &Rig, marble: &mut RigidBody) {
        let radius = rig.marble.radius_m;
        let near = TOUCH * radius;
        let position = marble.translation();
        if position.z > radius + near {
            return;
        }
        let (v, spin) = (marble.linvel() + self.gravity * SUBSTEP_S, marble.angvel());
        // A wall that holds the marble leaves no rolling towards it to resist.
        let free = |position: f64, velocity: f64, reach: f64| {
            let held = position.abs() >= reach - near && velocity * position > 0.0;
            if held { 0.0 } else { velocity }
        };
        let [reach_x, reach_y] = rig.reach_m();
        let x = free(
            position.x,
            (5.0 * v.x + 2.0 * radius * spin.y) / 7.0,
            reach_x,
        );
        let y = free(
            position.y,
            (5.0 * v.y - 2.0 * radius * spin.x) / 7.0,
            reach_y,
        );
        let speed = (x * x + y * y).sqrt();
        let resistance =
            5.0 / 7.0 * self.job.parameters.rolling_friction * -self.gravity.z * SUBSTEP_S;
        if speed > 0.0 {
            let taken = resistance.min(speed) / speed;
            marble.set_angvel(
                spin + Vector::new(y, -x, 0.0) * (3.5 * taken / radius),
                false,
            );
        }
    }
}
