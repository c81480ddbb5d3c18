//! The command line of the binary, for verbs that need no peers.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn rig(folder: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rig"))
        .args(words)
        .current_dir(folder)
        .output()
        .expect("the binary runs")
}

/// An empty folder of this test's own.
fn folder(name: &str) -> std::path::PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a folder can be made");
    folder
}

/// The one line with which a command is refused.
fn refusal(out: &Output) -> String {
    assert_eq!(out.status.code(), Some(1), "{out:?}");
    let err = String::from_utf8(out.stderr.clone()).expect("it is text");
    assert_eq!(err.lines().count(), 1, "{err}");
    err
}

#[test]
fn help_names_every_verb_and_shows_examples() {
    let out = rig(&folder("help"), &["--help"]);
    let text = String::from_utf8(out.stdout).expect("it is text");
    assert!(out.status.success());
    for verb in ["check", "home", "play", "listen", "twin", "recover", "sbom"] {
        assert!(text.contains(&format!("\n  {verb} ")), "{verb}: {text}");
    }
    assert!(text.contains("rig play suggest.csv --out bags --arm"));
}

#[test]
fn the_binary_carries_its_bill_of_materials() {
    let out = rig(&folder("sbom"), &["sbom"]);
    assert!(out.status.success());
    let bill: serde_json::Value = serde_json::from_slice(&out.stdout).expect("it is JSON");
    let own = &bill["metadata"]["component"];
    assert_eq!(own["name"], "rig");
    assert_eq!(own["version"], env!("CARGO_PKG_VERSION"));
    let crates = bill["components"].as_array().expect("it is a list");
    assert!(crates.iter().any(|one| one["name"] == "rustdds"));
}

#[test]
fn a_rig_of_another_lab_is_checked_before_anything_is_sent() {
    let here = folder("labs");
    let example = include_str!("../example/cyberrunner.toml");
    fs::write(here.join("rig.toml"), example).expect("it can be written");
    let err = refusal(&rig(&here, &["home", "--arm"]));
    assert!(err.contains("rig home is for arms"), "{err}");
    fs::write(here.join("run.csv"), "t_s,vel_1,vel_2\n0,0,0\n0.1,0,-260\n")
        .expect("it can be written");
    let err = refusal(&rig(&here, &["play", "run.csv", "--out", "bags", "--arm"]));
    assert!(
        err.contains("run.csv, row 1, vel_2: -260 is beyond limits.command"),
        "{err}"
    );
    fs::write(here.join("run.csv"), "t_s,vel_1,vel_2\n0,0,0\n0.1,0,-160\n")
        .expect("it can be written");
    let err = refusal(&rig(&here, &["play", "run.csv", "--out", "bags", "--arm"]));
    assert!(err.contains("allow_arming is false"), "{err}");
    assert!(!here.join("bags").exists(), "a refusal writes nothing");
    let other = example.replace("\"cyberrunner\"", "\"cyber\"");
    fs::write(here.join("rig.toml"), other).expect("it can be written");
    let err = refusal(&rig(&here, &["listen"]));
    assert!(
        err.contains("backend.kind: expected trajectory, ")
            && err.contains("tag_tcp, found \"cyber\""),
        "{err}"
    );
}

#[test]
fn a_twin_of_a_lab_names_what_is_wrong_with_its_files() {
    let here = folder("twin-labs");
    let twin = ["twin", "--as", "tag-tcp", "--model", "model.toml"];
    let err = refusal(&rig(&here, &twin));
    assert!(err.contains("model.toml: cannot be read"), "{err}");
    let err = refusal(&rig(
        &here,
        &[&twin[..], &["--config", "other.toml"]].concat(),
    ));
    assert!(err.contains("other.toml: cannot be read"), "{err}");
    fs::write(here.join("rig.toml"), "[twin]\ntracker_hz = 50\n").expect("it can be written");
    let err = refusal(&rig(&here, &twin));
    assert!(
        err.contains("rig.toml, twin.tracker_hz: expected a divisor of 120"),
        "{err}"
    );
    let out = rig(&here, &["twin", "--as", "robot", "--model", "model.toml"]);
    assert_eq!(out.status.code(), Some(2), "wrong usage");
}

#[test]
fn the_example_is_taken_and_its_mistakes_are_named() {
    let here = folder("mistakes");
    let example = include_str!("../example/rig.toml");
    let faster = example.replace("velocity_rad_s = ", "velocity_rad_s = 1");
    assert_ne!(faster, example);
    fs::write(here.join("rig.toml"), faster).expect("it can be written");
    fs::write(
        here.join("run.csv"),
        "t_s,knob_x_rad,knob_y_rad\n0.0,0.0,0.0\n",
    )
    .expect("it can be written");
    let out = rig(&here, &["play", "run.csv", "--out", "bags"]);
    let err = String::from_utf8(out.stderr).expect("it is text");
    assert_eq!(out.status.code(), Some(1));
    assert!(
        err.contains("rig.toml") && err.contains("velocity_rad_s"),
        "{err}"
    );
    assert!(!here.join("bags").exists(), "a refusal writes nothing");
}

#[test]
fn a_file_that_is_missing_is_one_line_that_says_what_to_do() {
    let here = folder("missing");
    let err = refusal(&rig(&here, &["check"]));
    assert!(
        err.contains("rig.toml: cannot be read") && err.contains("--config"),
        "{err}"
    );
    let err = refusal(&rig(&here, &["recover", "no.mcap"]));
    assert!(err.contains("no.mcap: cannot be read"), "{err}");
}

#[test]
fn what_is_no_bag_is_refused_and_left_alone() {
    let here = folder("no-bag");
    fs::write(here.join("a.mcap"), "not a bag").expect("it can be written");
    let err = refusal(&rig(&here, &["recover", "a.mcap"]));
    assert!(err.contains("a.mcap"), "{err}");
    assert_eq!(fs::read_dir(&here).expect("it is there").count(), 1);
}
