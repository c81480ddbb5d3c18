//! The lab machine's ROS 2 node: plays commands on two arms, records everything, and stops safely.

#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "a NaN age counts as too old"
)]

mod backend;
mod base;
mod check;
mod clock;
mod commands;
mod config;
mod dds;
mod ending;
mod error;
mod events;
#[cfg(test)]
mod exploration;
mod frames;
#[cfg(test)]
mod fuzz;
mod labs;
#[cfg(test)]
mod long_play;
mod memory;
mod messages;
mod model;
mod motion;
mod recorder;
mod recover;
mod safety;
mod security;
mod signals;
mod station;
mod twin;
mod watch;

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use crate::commands::Commands;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::events::Level;
use crate::labs::Lab;
use crate::labs::config::{LabConfig, Setup, TwinConfig};
use crate::labs::play::{Mode, Run};
use crate::motion::Motion;
use crate::station::Station;

/// Plays commands on two arms that turn the knobs of a marble board, records everything, and stops safely.
///
/// Nothing moves without --arm. A software stop never cuts an arm's power: keep a hardware e-stop at hand.
#[derive(Parser)]
#[command(name = "rig", version, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

const EXAMPLES: &str = "Examples:
  rig twin --model model.toml             # a stand-in for arms, board and tracker, to try the rest with
  rig check                               # what is ready, and what is not
  rig home --arm                          # slowly to the level pose
  rig play suggest.csv --out bags         # dry run: everything but the motion
  rig play suggest.csv --out bags --arm
  rig twin --model model.toml --as cyberrunner # a CyberRunner's topics; tag-tcp: a TAG rig's JSON lines
  irt import bags/suggest.mcap --out my-rig";

const TWIN_EXAMPLES: &str = "Examples:
  rig twin --model model.toml                  # arms at the knobs, as rig.toml names them
  rig twin --model model.toml --as cyberrunner # its topics and messages; needs no rig.toml
  rig twin --model model.toml --as tag-tcp     # connects to a learner that listens on 127.0.0.1:5555";

#[derive(Args)]
struct Configured {
    /// Names, signs, limits, networks: see rig/README.md
    #[arg(long, value_name = "TOML", default_value = "rig.toml")]
    config: PathBuf,
}

#[derive(Subcommand)]
enum Verb {
    /// Check peers, whether they match, rates and clock offsets
    Check {
        #[command(flatten)]
        configured: Configured,
    },
    /// Move slowly to the level pose
    Home {
        #[command(flatten)]
        configured: Configured,
        /// Folder for the bag
        #[arg(long, value_name = "DIR", default_value = "bags")]
        out: PathBuf,
        /// Move the arms (default: dry run)
        #[arg(long)]
        arm: bool,
    },
    /// Play a file of commands and record everything
    Play {
        /// CSV: `knob_x_rad`, `knob_y_rad`, and `t_s` or --period; for another lab's motors `vel_1`, `vel_2` or `cmd_x`, `cmd_y`
        #[arg(value_name = "COMMANDS.csv")]
        commands: PathBuf,
        #[command(flatten)]
        configured: Configured,
        /// Folder for the bag
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
        /// Duration of a row [s], for files without stamps
        #[arg(long, value_name = "S")]
        period: Option<f64>,
        /// Move the arms (default: dry run)
        #[arg(long)]
        arm: bool,
    },
    /// Record everything and command nothing
    Listen {
        #[command(flatten)]
        configured: Configured,
        /// Folder for the bag
        #[arg(long, value_name = "DIR", default_value = "bags")]
        out: PathBuf,
        /// Duration [s] (default: until Ctrl-C)
        #[arg(long, value_name = "S")]
        seconds: Option<f64>,
    },
    /// Simulate the laboratory: arms, board, marble and tracker, or the rig of another lab
    #[command(after_help = TWIN_EXAMPLES)]
    Twin {
        #[command(flatten)]
        configured: Configured,
        /// Any model.toml of irt, effects included
        #[arg(long, value_name = "MODEL")]
        model: PathBuf,
        /// Speak another lab's interface (default: that of the configuration)
        #[arg(long = "as", value_name = "LAB")]
        lab: Option<Lab>,
        /// Seed of noise, delays and lost pictures
        #[arg(long, default_value_t = 0)]
        seed: u64,
        /// Duration [s] (default: until Ctrl-C)
        #[arg(long, value_name = "S")]
        seconds: Option<f64>,
    },
    /// Recover a truncated bag
    Recover {
        /// A bag of this program, or any other MCAP file
        #[arg(value_name = "BAG")]
        bag: PathBuf,
        /// Output file (default: BAG-recovered.mcap beside it)
        #[arg(long, value_name = "MCAP")]
        out: Option<PathBuf>,
    },
    /// Print the bill of materials of this program: the crates that are built in, as JSON
    Sbom,
}

fn main() -> ExitCode {
    security::start_log(env_logger::Env::default().default_filter_or("off"));
    match run(Cli::parse().verb) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("rig: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(verb: Verb) -> Result<()> {
    match verb {
        Verb::Check { configured } => run_check(&configured.config),
        Verb::Home {
            configured,
            out,
            arm,
        } => {
            let (config, text) = arms(&configured.config, "home")?;
            let motion = Motion::open(&config, &text, (&out, "home"), arm)?;
            finished(motion, arm, Motion::home)
        }
        Verb::Play {
            commands,
            configured,
            out,
            period,
            arm,
        } => run_play(&commands, &configured.config, &out, period, arm),
        Verb::Listen {
            configured,
            out,
            seconds,
        } => match Setup::read(&configured.config)? {
            (Setup::Arms(config), text) => run_listen(&config, &text, &out, seconds),
            (Setup::Lab(config), text) => {
                let mut run = Run::open(&config, &text, (&out, "listen"), Mode::Listen)?;
                let outcome = run.listen(seconds);
                finished_lab(run, outcome)
            }
        },
        Verb::Twin {
            configured,
            model,
            lab,
            seed,
            seconds,
        } => run_twin(&configured.config, &model, lab, seed, seconds),
        Verb::Sbom => {
            let bill = if cfg!(feature = "security") {
                include_str!("../rig-security.cdx.json")
            } else {
                include_str!("../rig.cdx.json")
            };
            say(bill.trim_end());
            Ok(())
        }
        Verb::Recover { bag, out } => {
            let found = recover::recover(&bag, out.as_deref())?;
            let was = if found.was_whole {
                "was whole"
            } else {
                "was cut short"
            };
            say(&format!(
                "{was}: {} messages over {:.2} s are in {}",
                found.messages,
                found.nanos as f64 / 1e9,
                found.path.display()
            ));
            Ok(())
        }
    }
}

fn finished(
    mut motion: Motion,
    arm: bool,
    act: impl FnOnce(&mut Motion) -> Result<()>,
) -> Result<()> {
    let path = motion.station.base.recorder.path().to_owned();
    let outcome = act(&mut motion);
    let summary = motion.finish(outcome).inspect_err(|_| {
        eprintln!("rig: what happened is in {}", path.display());
    })?;
    let (ticks, late, worst) = summary.loop_ticks;
    say(&format!(
        "{}: {} messages; {late} of {ticks} ticks more than 2 ms late, the worst {:.1} ms; into the bag within {:.2} ms (p50), {:.2} ms (p99)",
        path.display(),
        summary.written.messages,
        1e3 * worst,
        summary.written.latency_ms(0.5),
        summary.written.latency_ms(0.99),
    ));
    if !arm {
        say("dry run: nothing was moved; --arm moves the arms");
    }
    Ok(())
}

fn finished_lab(run: Run, outcome: Result<()>) -> Result<()> {
    let path = run.base.recorder.path().to_owned();
    let finished = run.finish(outcome).inspect_err(|_| {
        eprintln!("rig: what happened is in {}", path.display());
    })?;
    let (ticks, late, worst) = finished.loop_ticks;
    say(&format!(
        "{}: {} messages, {} states; {late} of {ticks} ticks more than 2 ms late, the worst {:.1} ms",
        path.display(),
        finished.written.messages,
        finished.states,
        1e3 * worst,
    ));
    Ok(())
}

/// The configuration of arms, for a verb that other labs' rigs do not have.
fn arms(path: &Path, verb: &str) -> Result<(Config, String)> {
    match Setup::read(path)? {
        (Setup::Arms(config), text) => Ok((*config, text)),
        (Setup::Lab(_), _) => Err(Error::refused(format!(
            "{}: rig {verb} is for arms at the knobs; 'rig listen' records the rig of another lab, and its own reset levels it",
            path.display()
        ))),
    }
}

fn run_play(
    commands: &Path,
    config: &Path,
    out: &Path,
    period: Option<f64>,
    arm: bool,
) -> Result<()> {
    let name = commands
        .file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    match Setup::read(config)? {
        (Setup::Arms(config), text) => {
            let (played, _) = Commands::read(commands, &[commands::KNOBS], period)?;
            played
                .check(&config)
                .map_err(|error| Error::refused(format!("{}, {error}", commands.display())))?;
            let motion = Motion::open(&config, &text, (out, &name), arm)?;
            let mut bar = Bar::new(played.seconds());
            finished(motion, arm, |motion| {
                let outcome = motion.play(&played, &name, |part| bar.show(part));
                bar.clear();
                outcome
            })
        }
        (Setup::Lab(config), text) => {
            let played = labs::commands::read(commands, period, &config)?;
            play_lab(&config, &text, &played, (out, &name), arm)
        }
    }
}

fn play_lab(
    config: &LabConfig,
    text: &str,
    played: &Commands,
    (out, name): (&Path, &str),
    arm: bool,
) -> Result<()> {
    let mode = if arm { Mode::Armed } else { Mode::DryRun };
    let mut run = Run::open(config, text, (out, name), mode)?;
    let mut bar = Bar::new(played.seconds());
    let outcome = run.play(played, name, |part| bar.show(part));
    bar.clear();
    finished_lab(run, outcome)?;
    if !arm {
        say("dry run: nothing was commanded; --arm commands the motors");
    }
    Ok(())
}

fn run_twin(
    config: &Path,
    model: &Path,
    lab: Option<Lab>,
    seed: u64,
    seconds: Option<f64>,
) -> Result<()> {
    let lab = match lab {
        Some(lab) => lab,
        None => match Setup::read(config)? {
            (Setup::Lab(config), _) => config.backend.kind,
            (Setup::Arms(config), _) => {
                return twin::run(&config, model, seed, seconds, || {
                    say("the twin is ready; Ctrl-C ends it");
                });
            }
        },
    };
    twin::lab::run(
        lab,
        &TwinConfig::read(config)?,
        model,
        seed,
        seconds,
        || {
            say(&match lab {
                Lab::Cyberrunner => "the twin of a CyberRunner is ready; Ctrl-C ends it".to_owned(),
                Lab::TagTcp => format!(
                    "the twin of a TAG rig connects to the learner at {}; Ctrl-C ends it",
                    labs::TAG_LEARNER
                ),
            });
        },
    )
}

fn run_check(path: &Path) -> Result<()> {
    let (config, text) = arms(path, "check")?;
    let folder = std::env::temp_dir().join(format!("rig-check-{}", std::process::id()));
    let mut station = Station::open(&config, &text, &folder, "check", &[])?;
    let lines = check::lines(&mut station);
    let mut printed = Vec::new();
    let outcome = check::table(&lines, |line| printed.push(line));
    let _ = station.base.close(&outcome);
    let _ = std::fs::remove_dir_all(&folder);
    for line in &printed {
        say(line);
    }
    outcome
}

fn run_listen(config: &Config, text: &str, out: &Path, seconds: Option<f64>) -> Result<()> {
    let mut station = Station::open(
        config,
        text,
        out,
        "listen",
        &[("verb", "listen".to_owned())],
    )?;
    station.base.event(Level::Info, "begin", "listening");
    let bag = station.base.recorder.path().to_owned();
    let begin = station.base.clock.now().steady;
    let ended = loop {
        let (now, _) = station.base.ticker.wait();
        match station.hear(now, false) {
            Some(safety::Reason::Signal(_)) => break Ok(()),
            Some(reason) if reason.ends_recording() => {
                break Err(Error::refused(reason.to_string()));
            }
            // Reasons that would stop arms are only recorded.
            Some(reason) => station
                .base
                .event(Level::Error, reason.code(), &reason.to_string()),
            None => (),
        }
        if seconds.is_some_and(|seconds| now.steady - begin >= seconds) {
            break Ok(());
        }
    };
    station
        .base
        .event(Level::Info, "end", station.base.watch.arms().words());
    let (points, x, y) = (
        station.marble.tally.came,
        station.joints[0].tally.came,
        station.joints[1].tally.came,
    );
    let written = station.base.close(&ended);
    ended?;
    say(&format!(
        "{}: {} messages; {points} points, {x} and {y} joint states",
        bag.display(),
        written?.messages
    ));
    Ok(())
}

fn say(line: &str) {
    // A closed standard output does not stop the rig.
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// Progress of a file of commands, on a terminal.
struct Bar {
    seconds: f64,
    shown: Option<u64>,
}

impl Bar {
    fn new(seconds: f64) -> Self {
        Self {
            seconds,
            shown: None,
        }
    }

    fn show(&mut self, part: f64) {
        let percent = (100.0 * part) as u64;
        if self.shown == Some(percent) || !std::io::stderr().is_terminal() {
            return;
        }
        self.shown = Some(percent);
        eprint!("\r{percent:3} % of {:.0} s", self.seconds);
    }

    fn clear(&self) {
        if self.shown.is_some() {
            eprint!("\r\x1b[K");
        }
    }
}
