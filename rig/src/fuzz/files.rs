//! What comes from disks: configurations, models, commands and bags.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use labsim::effects::effects;

use super::fuzz;
use crate::commands::{self, Commands};
use crate::config::{self, Config, EXAMPLE};
use crate::labs::config::LabConfig;
use crate::labs::config::tests::EXAMPLES;
use crate::messages::{Bool, JointState};
use crate::model::Model;
use crate::model::tests::PLAIN;
use crate::recorder::{Attached, Recorder};
use crate::recover::recover;

fn texts(texts: &[&str]) -> Vec<Vec<u8>> {
    texts.iter().map(|text| text.as_bytes().to_vec()).collect()
}

#[test]
fn configurations() {
    let path = Path::new("rig.toml");
    let mut seeds = texts(&[EXAMPLE]);
    seeds.extend(texts(&EXAMPLES));
    fuzz("rig.toml", &seeds, |bytes| {
        let text = String::from_utf8_lossy(bytes);
        let arms = config::parse(path, &text, Config::mistakes);
        let lab = config::parse(path, &text, LabConfig::mistakes);
        let errors = arms.err().into_iter().chain(lab.err());
        for error in errors {
            let lines = error.to_string();
            assert!(
                lines.split("\nrig: ").all(|line| !line.contains('\n')),
                "{lines}"
            );
        }
    });
}

#[test]
fn commands_to_play() {
    let config: Config = toml::from_str(EXAMPLE).expect("the example is right");
    let seeds = texts(&[
        "step,t_s,knob_x_rad,knob_y_rad,marble_x,marble_y\n0,5,0,0,0.1,-0.2\n1,5.1,0.01,0,,\n2,5.25,0,0.02,,\n",
        "knob_x_rad,knob_y_rad\n0,0\n0.01,-0.02\n0,0\n",
    ]);
    fuzz("commands to play", &seeds, |bytes| {
        let text = String::from_utf8_lossy(bytes);
        for period in [None, Some(0.1)] {
            match Commands::parse(&text, &[commands::KNOBS], period) {
                Ok((commands, _)) => {
                    assert!(commands.seconds().is_finite());
                    let _ = commands.check(&config);
                }
                Err(error) => assert!(!error.contains('\n'), "{error}"),
            }
        }
    });
}

/// A model with each effect, in the middle of what is searched for.
fn models() -> Vec<Vec<u8>> {
    let maze = "[maze]\nwall_thickness_m = 0.005\nhole_radius_m = 0.0075\nwalls = [[-0.05, -0.1, -0.05, 0.02]]\nholes = [[0.05, 0.0]]\n";
    let mut found = vec![PLAIN.to_owned(), format!("{PLAIN}{maze}")];
    for effect in effects() {
        let mut text = format!("{PLAIN}[[effects]]\nname = \"{}\"\n", effect.name);
        for one in effect.parameters {
            let middle = 0.5 * (one.range.0 + one.range.1);
            writeln!(text, "{} = {middle:?}", one.name).expect("it is a text");
        }
        found.push(text);
    }
    found.into_iter().map(String::into_bytes).collect()
}

/// A model that is taken can be simulated: the marble is somewhere on the board, or has fallen.
#[test]
fn models_to_simulate() {
    fuzz("model.toml", &models(), |bytes| {
        let text = String::from_utf8_lossy(bytes);
        let model = match Model::parse(&text) {
            Ok(model) => model,
            Err(error) => return assert!(!error.contains('\n'), "{error}"),
        };
        let start = model.start().unwrap_or([0.0; 2]);
        let Ok(mut live) = model.live(start, (8, 1.0 / 120.0), 0) else {
            return;
        };
        for row in 0..7 {
            let seen = live.play([0.02, -0.01 * f64::from(row)]);
            assert!(
                live.fall().is_some() || seen.iter().all(|one| one.is_finite()),
                "row {row}: {seen:?}"
            );
        }
    });
}

/// A folder in memory where there is one, gone in the end.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        let memory = Path::new("/dev/shm");
        let base = if memory.is_dir() {
            memory.to_owned()
        } else {
            std::env::temp_dir()
        };
        let path = base.join(format!("rig-fuzz-{}", std::process::id()));
        fs::create_dir_all(&path).expect("it can be made");
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// From any bag, however broken, a whole bag is recovered, or nothing is written.
#[test]
fn bags_to_recover() {
    let folder = Folder::new();
    let (bag, out) = (folder.0.join("bag.mcap"), folder.0.join("out.mcap"));
    let config = Attached {
        name: "rig.toml",
        text: EXAMPLE,
    };
    let facts = BTreeMap::from([("backend".to_owned(), "trajectory".to_owned())]);
    let mut recorder = Recorder::create(&bag, config, facts).expect("it can be written");
    let joints = recorder.channel::<JointState>("/joint_states");
    let stop = recorder.channel::<Bool>("/rig/e_stop");
    for nanos in 0..20 {
        recorder.record(
            joints,
            nanos,
            nanos,
            &JointState {
                position: vec![0.5],
                ..JointState::default()
            },
        );
        recorder.record(stop, nanos, nanos, &Bool { data: true });
    }
    recorder.finish().expect("nothing is lost");
    let seed = fs::read(&bag).expect("it was written");
    fuzz("bags to recover", &[seed], |bytes| {
        let _ = fs::remove_file(&out);
        fs::write(&bag, bytes).expect("it can be written");
        match recover(&bag, Some(&out)) {
            Ok(found) => {
                let copy = fs::read(&out).expect("it was written");
                let whole = mcap::MessageStream::new(&copy).expect("it is a bag");
                let messages = whole.collect::<mcap::McapResult<Vec<_>>>();
                let messages = messages.expect("it is whole").len();
                assert_eq!(messages as u64, found.messages);
                fs::remove_file(&out).expect("it was written");
            }
            Err(error) => assert!(!error.to_string().contains('\n'), "{error}"),
        }
        assert_eq!(fs::read_dir(&folder.0).expect("it is there").count(), 1);
    });
}
