//! Files of commands for other labs' motors.

use std::path::Path;

use super::Lab;
use super::config::LabConfig;
use crate::commands::Commands;
use crate::error::{Error, Result};

/// Commands of motors 1 and 2, or of those about x and y, as recordings have them.
const COLUMNS: [[&str; 2]; 2] = [["vel_1", "vel_2"], ["cmd_x", "cmd_y"]];

/// Reads a CSV with `vel_1`, `vel_2` or `cmd_x`, `cmd_y`, and either `t_s` or a `period` for all rows (s). Its values
/// become those of motors 1 and 2.
///
/// # Errors
/// [`Error::Refused`] names file, row and column of what cannot be read or is beyond the limits.
pub fn read(path: &Path, period: Option<f64>, config: &LabConfig) -> Result<Commands> {
    let (mut commands, pair) = Commands::read(path, &COLUMNS, period)?;
    check(&commands, COLUMNS[pair], config)
        .map_err(|what| Error::refused(format!("{}, {what}", path.display())))?;
    if pair == 1 {
        let lab: Lab = config.backend.kind;
        for values in &mut commands.values {
            *values = lab.exchanged(*values);
        }
    }
    Ok(commands)
}

fn check(
    commands: &Commands,
    names: [&str; 2],
    config: &LabConfig,
) -> std::result::Result<(), String> {
    let limits = &config.limits;
    let mut before = [0.0; 2];
    for (row, values) in commands.values.iter().enumerate() {
        let end = commands.begins.get(row + 1).copied();
        let lasts = end.unwrap_or(commands.seconds()) - commands.begins[row];
        for (axis, (value, before)) in values.iter().zip(before).enumerate() {
            let name = names[axis];
            if value.abs() > limits.command {
                return Err(format!(
                    "row {row}, {name}: {value} is beyond limits.command, {}",
                    limits.command
                ));
            }
            let change = (value - before).abs();
            if change > limits.change_per_s * lasts + 1e-9 {
                return Err(format!(
                    "row {row}, {name}: within limits.change_per_s, {}, a change by {change} takes longer than the row's {lasts:.3} s; play it slower or smaller",
                    limits.change_per_s
                ));
            }
        }
        before = *values;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::labs::config::tests::EXAMPLES;

    fn parsed(name: &str, text: &str, example: usize) -> std::result::Result<Commands, String> {
        let folder =
            std::env::temp_dir().join(format!("rig-commands-{name}-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("it can be made");
        let path = folder.join("run.csv");
        fs::write(&path, text).expect("it can be written");
        let config: LabConfig = toml::from_str(EXAMPLES[example]).expect("it is right");
        let found = read(&path, Some(0.1), &config).map_err(|error| error.to_string());
        let _ = fs::remove_dir_all(&folder);
        found
    }

    #[test]
    fn commands_about_the_axes_go_to_the_motors_that_turn_them() {
        let values = |name, text, example| parsed(name, text, example).expect("it is right").values;
        let about = "cmd_x,cmd_y\n0,0\n10,-20\n";
        assert_eq!(
            values("x", about, 0)[1],
            [-20.0, 10.0],
            "motor 1 is about y"
        );
        assert_eq!(
            values("y", about, 1)[1],
            [10.0, -20.0],
            "servo 1 is about x"
        );
        let own = "vel_1,vel_2\n0,0\n10,-20\n";
        assert_eq!(values("own", own, 0)[1], [10.0, -20.0]);
    }

    #[test]
    fn what_is_beyond_the_limits_is_refused_with_row_and_column() {
        for (text, example, said) in [
            (
                "vel_1,vel_2\n0,0\n0,201\n",
                0,
                "row 1, vel_2: 201 is beyond limits.command",
            ),
            (
                "cmd_x,cmd_y\n0,0\n150,0\n",
                1,
                "row 1, cmd_x: within limits.change_per_s",
            ),
            (
                "knob_x_rad,knob_y_rad\n0,0\n0,0\n",
                0,
                "expected the columns vel_1, vel_2 or cmd_x, cmd_y",
            ),
            (
                "vel_1,vel_2\n0,0\n0,nan\n",
                0,
                "row 1, vel_2: expected a finite number",
            ),
        ] {
            let error = parsed("refused", text, example).expect_err(said);
            assert!(error.contains(said), "{error}");
        }
    }
}
