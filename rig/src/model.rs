//! `model.toml` for the simulated laboratory.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use labsim::effects::effect;
use labsim::{EffectInstance, EffectSpec, Live, Maze, Parameters, PerRollout, Rig};
use serde::Deserialize;

use crate::error::{Error, Result};

/// The unit of knobs' angles.
const RAD: &str = "rad";

/// A board to simulate.
#[derive(Debug, Clone)]
pub struct Model {
    rig: Rig,
    maze: Option<Maze>,
    /// Where the maze says that the marble begins (m).
    start: Option<[f64; 2]>,
    /// Unit of the commands.
    unit: String,
    parameters: Parameters,
    effects: Vec<(&'static EffectSpec, Vec<f64>)>,
}

#[derive(Deserialize)]
struct File {
    #[serde(default)]
    board: BTreeMap<String, f64>,
    #[serde(default)]
    marble: BTreeMap<String, f64>,
    parameters: BTreeMap<String, Value>,
    maze: Option<Inside>,
    #[serde(default)]
    commands: Spoken,
    #[serde(default)]
    effects: Vec<BTreeMap<String, toml::Value>>,
}

/// The unit of the commands; angles of knobs where there is none.
#[derive(Deserialize, Default)]
struct Spoken {
    unit: Option<String>,
}

/// What `irt` writes of a maze; path and the walls' height do not move the marble.
#[derive(Deserialize)]
struct Inside {
    start: Option<[f64; 2]>,
    #[serde(default)]
    walls: Vec<[f64; 4]>,
    wall_thickness_m: f64,
    #[serde(default)]
    holes: Vec<[f64; 2]>,
    hole_radius_m: f64,
}

#[derive(Deserialize)]
struct Value {
    value: f64,
}

impl Model {
    /// Reads a model as `irt` writes it.
    ///
    /// # Errors
    /// [`Error::Refused`] names file and key.
    pub fn read(path: &Path) -> Result<Self> {
        let shown = path.display();
        let text = fs::read_to_string(path)
            .map_err(|error| Error::refused(format!("{shown}: cannot be read: {error}")))?;
        Self::parse(&text).map_err(|what| Error::refused(format!("{shown}{what}")))
    }

    /// Reads the text of a model.
    ///
    /// # Errors
    /// The key, and what is wrong there.
    pub fn parse(text: &str) -> std::result::Result<Self, String> {
        let file: File = toml::from_str(text)
            .map_err(|error| format!(": {}", error.message().replace('\n', " ")))?;
        Self::from_file(&file).map_err(|what| format!(", {what}"))
    }

    fn from_file(file: &File) -> std::result::Result<Self, String> {
        let mut rig = Rig::default();
        for (key, &value) in &file.board {
            *match key.as_str() {
                "edge_x_m" => &mut rig.board.edge_x_m,
                "edge_y_m" => &mut rig.board.edge_y_m,
                "wall_restitution" => &mut rig.board.wall_restitution,
                "wall_friction" => &mut rig.board.wall_friction,
                "sliding_friction" => &mut rig.board.sliding_friction,
                "spinning_friction" => &mut rig.board.spinning_friction,
                _ => return Err(unknown("board: unknown key", key)),
            } = within("board", key, value, [0.0, 1000.0])?;
        }
        for (key, &value) in &file.marble {
            *match key.as_str() {
                "radius_m" => &mut rig.marble.radius_m,
                "mass_kg" => &mut rig.marble.mass_kg,
                "damping_per_s" => &mut rig.marble.damping_per_s,
                _ => return Err(unknown("marble: unknown key", key)),
            } = within("marble", key, value, [0.0, 1000.0])?;
        }
        let parameter = |name: &str, bounds: [f64; 2]| {
            let found = file.parameters.get(name).map(|one| one.value);
            let found = found.ok_or(format!("parameters: {name} is missing"))?;
            within("parameters", name, found, bounds)
        };
        let parameters = Parameters {
            gear_x: parameter("gear_x", [-100.0, 100.0])?,
            gear_y: parameter("gear_y", [-100.0, 100.0])?,
            rolling_friction: parameter("rolling_friction", [0.0, 100.0])?,
            time_scale: parameter("time_scale", [0.0, 5000.0])?,
            observation_scale: parameter("observation_scale", [0.01, 100.0])?,
        };
        let effects = file
            .effects
            .iter()
            .map(read_effect)
            .collect::<std::result::Result<_, _>>()?;
        let maze = file.maze.as_ref().map(|inside| Maze {
            walls: inside.walls.clone(),
            wall_thickness_m: inside.wall_thickness_m,
            holes: inside.holes.clone(),
            hole_radius_m: inside.hole_radius_m,
        });
        Ok(Self {
            rig,
            maze,
            start: file.maze.as_ref().and_then(|inside| inside.start),
            unit: file.commands.unit.clone().unwrap_or_else(|| RAD.to_owned()),
            parameters,
            effects,
        })
    }

    /// Whether its commands are angles of knobs (rad); otherwise they are in a unit of the rig's own.
    pub fn takes_angles(&self) -> bool {
        self.unit == RAD
    }

    /// The board's tilts over the commands.
    pub fn gears(&self) -> [f64; 2] {
        [self.parameters.gear_x, self.parameters.gear_y]
    }

    /// Edges of the board (m).
    pub fn edges_m(&self) -> [f64; 2] {
        [self.rig.board.edge_x_m, self.rig.board.edge_y_m]
    }

    /// Radius of the marble (m).
    pub fn radius_m(&self) -> f64 {
        self.rig.marble.radius_m
    }

    /// Inner walls and holes.
    pub fn maze(&self) -> Option<&Maze> {
        self.maze.as_ref()
    }

    /// The maze's start as it is observed (board edges).
    pub fn start(&self) -> Option<[f64; 2]> {
        let over = self.parameters.observation_scale / self.rig.board.edge_x_m;
        self.start.map(|place| place.map(|value| value * over))
    }

    /// Largest observed position (board edges), along x and y.
    pub fn reach(&self) -> [f64; 2] {
        self.rig
            .reach_m()
            .map(|reach| reach / self.rig.board.edge_x_m * self.parameters.observation_scale)
    }

    /// The marble at rest at a position (board edges), for `rows` rows of `row_s` seconds.
    ///
    /// # Errors
    /// [`Error::Refused`] if the engine refuses the values.
    pub fn live(&self, start: [f64; 2], rows: (usize, f64), seed: u64) -> Result<Live> {
        let effects: Vec<EffectInstance<'_>> = self
            .effects
            .iter()
            .map(|(effect, values)| EffectInstance {
                effect,
                values: PerRollout::Shared(values),
            })
            .collect();
        let maze = self.maze.as_ref();
        Live::new(
            &self.rig,
            maze,
            self.parameters,
            &effects,
            start,
            rows,
            seed,
        )
        .map_err(|error| Error::refused(error.to_string()))
    }
}

/// A number within what `irt` allows at all; the engine refuses more.
fn within(
    table: &str,
    key: &str,
    value: f64,
    [low, high]: [f64; 2],
) -> std::result::Result<f64, String> {
    if (low..=high).contains(&value) {
        return Ok(value);
    }
    Err(format!(
        "{table}: {key}: expected a number from {low} to {high}, found {value:?}"
    ))
}

/// A message about a key that may have line breaks, on one line.
fn unknown(what: &str, key: &str) -> String {
    format!("{what} '{}'", key.escape_debug())
}

fn read_effect(
    table: &BTreeMap<String, toml::Value>,
) -> std::result::Result<(&'static EffectSpec, Vec<f64>), String> {
    let name = table
        .get("name")
        .and_then(toml::Value::as_str)
        .ok_or("effects: a name is missing")?;
    let about = effect(name).map_err(|error| format!("effects: {error}"))?;
    let mut values = about.neutral();
    for (key, value) in table.iter().filter(|(key, _)| *key != "name") {
        let place = about.parameters.iter().position(|one| one.name == key);
        let place =
            place.ok_or_else(|| unknown(&format!("effects, {name}: unknown parameter"), key))?;
        let table = value.get("value").unwrap_or(value);
        let number = table
            .as_float()
            .or_else(|| table.as_integer().map(|whole| whole as f64));
        values[place] = number.ok_or_else(|| {
            // TOML writes a text that has line breaks on several lines.
            let found = table.to_string().replace('\n', "\\n");
            format!("effects, {name}, {key}: expected a number, found {found}")
        })?;
    }
    Ok((about, values))
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// A model without effects.
    pub const PLAIN: &str = "format = 1\n[board]\nedge_x_m = 0.3\n[parameters]\ngear_x = { value = 0.07, low = 0.06, high = 0.08, range = [0.0, 0.1] }\ngear_y = { value = 0.06 }\nrolling_friction = { value = 3e-4 }\ntime_scale = { value = 24 }\nobservation_scale = { value = 1.0 }\n";

    /// A model with further tables.
    pub fn with(tables: &str) -> Model {
        Model::parse(&format!("{PLAIN}{tables}")).expect("it is right")
    }

    #[test]
    fn a_model_is_read_with_its_effects() {
        let text = format!("{PLAIN}[[effects]]\nname = \"backlash\"\nwidth_x_rad = 0.03\n");
        let model = Model::parse(&text).expect("it is right");
        assert_eq!(model.rig.board.edge_x_m, 0.3);
        assert_eq!(model.effects[0].1, [0.03, 0.0]);
        let mut live = model
            .live([0.1, 0.0], (10, 1.0 / 120.0), 0)
            .expect("it is physical");
        assert_eq!(live.play([0.0, 0.1])[1], 0.0);
    }

    #[test]
    fn a_marble_of_a_model_with_a_maze_falls_through_its_hole() {
        let maze = "[maze]\nwall_thickness_m = 0.005\nwall_height_m = 0.012\nhole_radius_m = 0.0075\nholes = [\n    [0.05, 0.0],\n]\n";
        let model = Model::parse(&format!("{PLAIN}{maze}")).expect("it is right");
        let mut live = model
            .live([0.0; 2], (400, 1.0 / 120.0), 0)
            .expect("it is physical");
        while live.left() > 0 && live.fall().is_none() {
            live.play([0.0, 0.5]);
        }
        assert_eq!(live.fall().map(|fall| fall.hole), Some(0));
        assert!(live.seen()[0].is_nan());
    }

    #[test]
    fn names_with_line_breaks_were_refused_on_several_lines() {
        let effect = "[[effects]]\nname = \"backlash\"\n";
        let board = PLAIN.replace("edge_x_m", "\"edge\\nx\"");
        let marble = format!("{PLAIN}[marble]\n\"radius\\nm\" = 0.01\n");
        for (text, said) in [
            (
                format!("{PLAIN}[[effects]]\nname = \"back\\nlash\"\n"),
                "unknown effect 'back\\nlash'",
            ),
            (
                format!("{PLAIN}{effect}\"width\\nx\" = 1\n"),
                "unknown parameter 'width\\nx'",
            ),
            (
                format!("{PLAIN}{effect}width_x_rad = \"0\\n1\"\n"),
                "found \"\"\"\\n0\\n1\"\"\"",
            ),
            (board, "board: unknown key 'edge\\nx'"),
            (marble, "marble: unknown key 'radius\\nm'"),
        ] {
            let error = Model::parse(&text).expect_err(said);
            assert!(error.contains(said) && !error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (change, said) in [
            ("[[effects]]\nname = \"backslash\"\n", "unknown effect"),
            (
                "[[effects]]\nname = \"backlash\"\nwidth = 1\n",
                "unknown parameter 'width'",
            ),
        ] {
            let error = Model::parse(&format!("{PLAIN}{change}")).expect_err(said);
            assert!(error.contains(said), "{error}");
        }
        let error =
            Model::parse(&PLAIN.replace("gear_y", "gear_z")).expect_err("a gear is missing");
        assert!(error.contains("gear_y is missing"), "{error}");
    }
}
