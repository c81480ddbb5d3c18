//! Placeholder for the lab machine's ROS 2 node: it says that it is one, and exits with failure.

use std::process::ExitCode;

fn main() -> ExitCode {
    eprintln!(
        "rig: the ROS 2 node is not built yet; record with your own tools and give irt the CSV files"
    );
    ExitCode::FAILURE
}
