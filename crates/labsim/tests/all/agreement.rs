//! The two engines against each other: 200 random sets of parameters and excitations.

use std::f64::consts::TAU;
use std::sync::atomic::AtomicBool;

use labsim::{Batch, Engine, Falls, Maze, Parameters, PerRollout, Rig};

use crate::maze::labyrinth;

const ROLLOUTS: usize = 200;
const ROWS: usize = 100;

/// Splitmix64: as random as this needs, and the same everywhere.
struct Random(u64);

impl Random {
    fn within(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let unit = ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 53) as f64;
        low + unit * (high - low)
    }
}

/// Sums of three sinusoids of the given amplitude (rad), another one for each knob and rollout.
fn excitations(random: &mut Random, amplitude: f64) -> Vec<[f64; 2]> {
    let mut all = Vec::with_capacity(ROLLOUTS * ROWS);
    for _ in 0..ROLLOUTS {
        let waves: [[(f64, f64); 3]; 2] = std::array::from_fn(|_| {
            std::array::from_fn(|_| (random.within(0.5, 4.0), random.within(0.0, TAU)))
        });
        all.extend((0..ROWS).map(|row| {
            waves.map(|waves| {
                let sum: f64 = waves
                    .iter()
                    .map(|(periods, phase)| (TAU * periods * row as f64 / 100.0 + phase).sin())
                    .sum();
                amplitude * sum / 3.0
            })
        }));
    }
    all
}

/// Random rollouts: their parameters, and what marbles do on the bare board or in a maze.
struct Random200 {
    rig: Rig,
    parameters: Vec<Parameters>,
    commands: Vec<[f64; 2]>,
    start: Vec<[f64; 2]>,
}

impl Random200 {
    fn new(rig: &Rig, amplitude: f64, seed: u64) -> Self {
        let mut random = Random(seed);
        let parameters = (0..ROLLOUTS)
            .map(|_| {
                let mut within = |low, high| random.within(low, high);
                [
                    within(0.0, 0.1),
                    within(0.0, 0.1),
                    within(0.0, 0.001),
                    within(1.0, 50.0),
                    within(0.8, 1.2),
                ]
                .into()
            })
            .collect();
        let commands = excitations(&mut random, amplitude);
        let start = (0..ROLLOUTS)
            .map(|_| [random.within(-0.2, 0.2), random.within(-0.2, 0.2)])
            .collect();
        Self {
            rig: *rig,
            parameters,
            commands,
            start,
        }
    }

    fn run(&self, engine: Engine, maze: Option<&Maze>) -> Falls {
        self.moved(engine, maze, 0.0)
    }

    /// The same with starts moved by so much along x and back along y (board edges).
    fn moved(&self, engine: Engine, maze: Option<&Maze>, by: f64) -> Falls {
        let start: Vec<[f64; 2]> = self.start.iter().map(|[x, y]| [x + by, y - by]).collect();
        let batch = Batch {
            rig: &self.rig,
            maze,
            parameters: &self.parameters,
            rows: ROWS,
            commands: PerRollout::Each(&self.commands),
            start: PerRollout::Each(&start),
            ..Batch::new(&self.rig, &[], &[])
        };
        batch
            .run_with_falls(engine, None, &AtomicBool::new(false))
            .expect("the inputs are physical")
    }
}

/// Mean absolute difference of two paths while both marbles are there.
fn difference(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    let both = a.as_flattened().iter().zip(b.as_flattened());
    let there: Vec<f64> = both
        .map(|(a, b)| (a - b).abs())
        .filter(|apart| apart.is_finite())
        .collect();
    there.iter().sum::<f64>() / there.len() as f64
}

/// Mean absolute difference of each rollout, and whether its marble met a rim.
fn differences(rig: &Rig, amplitude: f64, seed: u64) -> Vec<(f64, bool)> {
    let all = Random200::new(rig, amplitude, seed);
    let [rolling, rapier] = [Engine::Rolling, Engine::Rapier].map(|engine| all.run(engine, None));
    (0..ROLLOUTS)
        .map(|i| {
            let rows = i * ROWS..(i + 1) * ROWS;
            let scale = all.parameters[i].observation_scale / rig.board.edge_x_m;
            let reach = rig.reach_m().map(|reach| 0.999 * reach * scale);
            let path = &rolling.marble[rows.clone()];
            let met_rim = path
                .iter()
                .any(|seen| seen[0].abs() > reach[0] || seen[1].abs() > reach[1]);
            (difference(path, &rapier.marble[rows]), met_rim)
        })
        .collect()
}

/// Mean and median.
fn centre(mut values: Vec<f64>) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    (
        values.iter().sum::<f64>() / values.len() as f64,
        values[values.len() / 2],
    )
}

#[test]
fn engines_agree_where_no_rim_is_met() {
    let free: Vec<f64> = differences(&Rig::default(), 0.02, 1)
        .into_iter()
        .filter_map(|(difference, met_rim)| (!met_rim).then_some(difference))
        .collect();
    assert!(
        free.len() > 100,
        "only {} rollouts stay off the rim",
        free.len()
    );
    let (mean, median) = centre(free);
    println!("free of the rim: mean {mean:.6}, median {median:.6}");
    assert!(mean < 0.0005, "mean {mean} of an edge");
}

#[test]
fn engines_agree_over_impacts() {
    for (restitution, friction, spinning) in [
        (0.0, 0.0, 0.0),
        (0.0, 0.25, 0.0),
        (0.0, 1.0, 0.0),
        (0.5, 0.25, 0.0),
        (0.9, 0.25, 0.0),
        (0.0, 0.25, 0.0005),
        (0.5, 0.25, 0.02),
    ] {
        let mut rig = Rig::default();
        rig.board.spinning_friction = spinning;
        rig.board.wall_restitution = restitution;
        rig.board.wall_friction = friction;
        let met: Vec<f64> = differences(&rig, 0.1, 2)
            .into_iter()
            .filter_map(|(difference, met_rim)| met_rim.then_some(difference))
            .collect();
        assert!(met.len() > 20, "only {} rollouts meet a rim", met.len());
        let (mean, median) = centre(met);
        let what = format!("rim of restitution {restitution}, frictions {friction}, {spinning}");
        println!("{what}: mean {mean:.5}, median {median:.5}");
        assert!(median < 0.001, "{what}: median {median} of an edge");
        assert!(mean < 0.002, "{what}: mean {mean} of an edge");
    }
}

#[test]
fn engines_agree_among_walls_and_holes() {
    for (restitution, holes) in [(0.0, false), (0.5, false), (0.9, false), (0.0, true)] {
        let mut rig = Rig::default();
        rig.board.wall_restitution = restitution;
        let mut maze = labyrinth();
        if !holes {
            maze.holes.clear();
        }
        let all = Random200::new(&rig, 0.1, 3);
        let bare = all.run(Engine::Rolling, None);
        let [rolling, rapier] =
            [Engine::Rolling, Engine::Rapier].map(|engine| all.run(engine, Some(&maze)));
        let nudged = all.moved(Engine::Rolling, Some(&maze), 1e-4);
        let of = |found: &Falls, i: usize| found.marble[i * ROWS..(i + 1) * ROWS].to_vec();
        let met: Vec<usize> = (0..ROLLOUTS)
            .filter(|&i| of(&rolling, i) != of(&bare, i))
            .collect();
        assert!(met.len() > 60, "only {} rollouts meet a wall", met.len());
        let apart = |other: &Falls| {
            let of_one = |&i: &usize| difference(&of(&rolling, i), &of(other, i));
            centre(met.iter().map(of_one).collect())
        };
        let ((mean, median), (nudged_mean, nudged_median)) = (apart(&rapier), apart(&nudged));
        let fell = |found: &Falls, i: usize| found.falls[i].map(|fall| fall.hole);
        let fallen = met.iter().filter(|&&i| fell(&rolling, i).is_some()).count();
        let alike = |other: &Falls| {
            let same = |&&i: &&usize| fell(&rolling, i) == fell(other, i);
            met.iter().filter(same).count()
        };
        let (alike, nudged_alike) = (alike(&rapier), alike(&nudged));
        let what = format!("restitution {restitution}, holes {holes}");
        println!(
            "{what}: {} met, mean {mean:.5}, median {median:.5}, {fallen} fell, {alike} alike; starts moved by 0.0001: \
             mean {nudged_mean:.5}, median {nudged_median:.5}, {nudged_alike} alike",
            met.len()
        );
        // Round ends of walls scatter: what engines differ by at rims is some ten times more behind one.
        assert!(median < 0.001, "{what}: median {median} of an edge");
        assert!(mean < 0.02, "{what}: mean {mean} of an edge");
        assert!(
            10 * alike >= 9 * met.len(),
            "{what}: {alike} of {}",
            met.len()
        );
        assert_eq!(fallen > 10, holes, "{fallen} fell");
    }
}
