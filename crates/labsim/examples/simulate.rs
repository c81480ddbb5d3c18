//! Simulates a marble under the drive of the paper and prints its path.
//!
//! `cargo run --release --package labsim --example simulate`

use std::sync::atomic::AtomicBool;

use labsim::{Batch, Engine, Parameters, Result, Rig, paper_drive};

fn main() -> Result<()> {
    let rig = Rig::default();
    // Gears about x and y, rolling friction, updates of 1/240 s a row, observed over true position.
    let parameters: [Parameters; 1] = [[0.06, 0.05, 4e-4, 24.0, 1.0].into()];
    let knobs = paper_drive(100, 0.1, false);
    let path = Batch::new(&rig, &parameters, &knobs).run(
        Engine::Rolling,
        None,
        &AtomicBool::new(false),
    )?;

    println!("   row        x        y  (board edges)");
    for (row, [x, y]) in path.iter().enumerate().step_by(10) {
        println!("{row:>6} {x:>8.4} {y:>8.4}");
    }
    Ok(())
}
