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
//! A marble's bits do not depend on its neighbours in a register. Marbles share no contact, the solver computes its
//! SIMD lanes alike, and what remains is the order in which it solves the contacts of one marble:
//! ascending by colour. A contact takes the highest colour that its marble has free when it begins;
//! of those that begin together, the one whose bodies have the lowest indices comes first. Hence a
//! body for each wall, inserted before the marbles, and none for the board. (Walls without bodies
//! would follow the order in which the broad phase found them, and colours that 125 contacts or
//! more share would be solved first: both depend on the neighbours.)
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

mod marble;

use std::cmp::Ordering;

use pulp::Scalar;
use rapier3d_f64::prelude::*;

use self::marble::Marble;
use super::obstacles::Obstacles;
use super::{Job, Setup, Sink};
use crate::board::{Rig, SUBSTEP_S};
use crate::motion::{REFERENCE_M_PER_S, Restitution};

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

/// Simulates up to [`GROUP`] rollouts, in one world if their rims are alike; row i of `out[j]` becomes what
/// is observed of job j at row i.
pub(crate) fn run(setup: &Setup<'_>, jobs: &[Job<'_>], out: &mut [Sink<'_>]) {
    let mut all: Vec<(Wall, &Job<'_>, &mut Sink<'_>)> = jobs
        .iter()
        .zip(out)
        .map(|(job, out)| (Wall::of(setup, job), job, out))
        .collect();
    all.sort_by(|(a, ..), (b, ..)| a.compare(b));
    for alike in all.chunk_by_mut(|(a, ..), (b, ..)| a.compare(b).is_eq()) {
        simulate(setup, alike);
    }
}

/// Rims and inner walls as a marble meets them.
#[derive(Debug, Clone, Copy)]
struct Wall {
    restitution: Restitution<f64>,
    /// Coulomb's coefficient.
    friction: f64,
}

impl Wall {
    fn of(setup: &Setup<'_>, job: &Job<'_>) -> Self {
        let rims = setup.rims(Scalar::new(), |_| job);
        Self {
            restitution: rims.restitution.of_lane(0),
            friction: rims.friction.to_array()[0],
        }
    }

    fn compare(&self, other: &Self) -> Ordering {
        let numbers = |one: &Self| {
            let Restitution {
                at_reference,
                falloff,
            } = one.restitution;
            [at_reference, falloff, one.friction]
        };
        let pairs = numbers(self).into_iter().zip(numbers(other));
        let mut ordered = pairs.map(|(a, b)| a.total_cmp(&b));
        ordered.find(|one| one.is_ne()).unwrap_or(Ordering::Equal)
    }

    /// Friction and restitution of rapier's contacts at an approach speed (m/s).
    ///
    /// Rapier bounds friction by the impulse that stops the marble; what throws it back comes after. Coulomb's
    /// bound is for both.
    fn contact(&self, speed: f64) -> (f64, f64) {
        let restitution = self.restitution.at(speed);
        (self.friction * (1.0 + restitution), restitution)
    }

    fn surface(&self, collider: ColliderBuilder) -> ColliderBuilder {
        let (friction, restitution) = self.contact(REFERENCE_M_PER_S);
        let hooks = if self.restitution.falloff == 0.0 {
            ActiveHooks::empty()
        } else {
            ActiveHooks::MODIFY_SOLVER_CONTACTS
        };
        surface(collider, friction, restitution).active_hooks(hooks)
    }
}

/// Called for each contact of a marble with a wall whose restitution depends on the speed.
impl PhysicsHooks for Wall {
    fn modify_solver_contacts(&self, context: &mut ContactModificationContext<'_>) {
        let bodies = [context.rigid_body1, context.rigid_body2];
        let mut found = bodies.into_iter().flatten().map(|one| &context.bodies[one]);
        let Some(marble) = found.find(|one| one.is_dynamic()) else {
            return;
        };
        // Before the forces of the substep have acted.
        let velocity = marble.linvel() + marble.user_force() * (SUBSTEP_S / marble.mass());
        let pace = marble::pace(marble);
        if let Some(contacts) = context.rigid_mut() {
            let speed = velocity.dot(*contacts.normal) / pace;
            (*contacts.friction, *contacts.restitution) = self.contact(speed);
        }
    }
}

/// Simulates rollouts in one world.
fn simulate(setup: &Setup<'_>, jobs: &mut [(Wall, &Job<'_>, &mut Sink<'_>)]) {
    let wall = jobs[0].0;
    let mut world = world(setup.rig, &wall);
    if let Some(obstacles) = setup.obstacles {
        build_walls(&mut world, setup.rig, &wall, obstacles);
    }
    let mut marbles: Vec<Marble<'_>> = jobs
        .iter()
        .map(|(wall, job, _)| Marble::new(setup, job, *wall, &mut world))
        .collect();
    give_walls_the_last_word(&mut world);
    for marble in &mut marbles {
        marble.release(&mut world.bodies);
    }
    loop {
        let mut moving = false;
        for (marble, (_, _, out)) in marbles.iter_mut().zip(jobs.iter_mut()) {
            moving |= marble.prepare(&mut world.bodies, out);
        }
        if !moving || setup.is_cancelled() {
            return;
        }
        world.step_with_events(&wall, &());
    }
}

/// The board and its walls, with nothing on it yet.
fn world(rig: &Rig, wall: &Wall) -> PhysicsWorld {
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
        let side = wall.surface(ColliderBuilder::cuboid(far, far, 1000.0 * far));
        world.insert(RigidBodyBuilder::fixed().translation(centre), side);
    }
    let board = ColliderBuilder::new(SharedShape::halfspace(Vector::Z));
    world.insert_collider(surface(board, rig.board.sliding_friction, 0.0), None);
    world
}

/// Inner walls: boxes with an upright capsule at either end, as high as the rim.
fn build_walls(world: &mut PhysicsWorld, rig: &Rig, of: &Wall, obstacles: &Obstacles) {
    let half = obstacles.reach - rig.marble.radius_m;
    let high = 10.0 * (rig.board.edge_x_m + rig.board.edge_y_m);
    for wall in &obstacles.walls {
        let [x, y] = [0, 1].map(|axis| wall.begin[axis] + 0.5 * wall.length * wall.along[axis]);
        let end = |side: f64| {
            let place = Pose::translation(side * 0.5 * wall.length, 0.0, 0.0);
            (place, SharedShape::capsule_z(high, half))
        };
        let mut parts = vec![end(-1.0), end(1.0)];
        if wall.length > 0.0 {
            let side = SharedShape::cuboid(0.5 * wall.length, half, high);
            parts.push((Pose::IDENTITY, side));
        }
        let angle = wall.along[1].atan2(wall.along[0]);
        let body = RigidBodyBuilder::fixed()
            .translation(Vector::new(x, y, 0.0))
            .rotation(Vector::new(0.0, 0.0, angle));
        world.insert(body, of.surface(ColliderBuilder::compound(parts)));
    }
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
