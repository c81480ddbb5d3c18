//! Changed messages, lines, files and bags: each is read or refused in short time, and nothing panics.
//!
//! `cargo test` tries some hundred of each. With `FUZZ_SECONDS` or `FUZZ_INPUTS` each reader gets that many seconds or
//! inputs, whichever end first, from the seed in `FUZZ_SEED`; a line of JSON for each is appended to `FUZZ_SUMMARY`.

mod files;
mod wire;

use std::cell::Cell;
use std::fs::OpenOptions;
use std::io::Write;
use std::time::{Duration, Instant};

use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed, TestRunner};

/// Longest time for an input.
const LONGEST: Duration = Duration::from_secs(2);

/// Inputs of a round, after which the time is looked at.
const ROUND: u32 = 10_000;

/// Most memory of the whole test program (kB).
const MOST_KB: u64 = 512 * 1024;

/// What stands for a number or a name of a text in its place.
const NASTY: [&str; 37] = [
    "nan",
    "-nan",
    "inf",
    "-inf",
    "NaN",
    "Infinity",
    "null",
    "true",
    "",
    " ",
    "0",
    "-0.0",
    "-1",
    "1",
    "1e308",
    "-1e308",
    "1e-320",
    "1e999",
    "9223372036854775808",
    "99999999999999999999999999",
    "1_0",
    "\"\"",
    "\"\\u0000\"",
    "\"é\u{202e}\"",
    "'",
    "\"",
    "\u{feff}",
    "\0",
    "\n",
    "\\n",
    "\r",
    "[]",
    "{}",
    "[[]]",
    "1979-05-27",
    "[[[[[[[[[[[[[[[[[[[[[[[[",
    "=",
];

/// Numbers that a reader may well take, in place of another number.
const NUMBERS: [&str; 14] = [
    "0", "1", "-1", "0.5", "-0.3", "0.01", "1e-5", "1e-9", "3", "10", "100", "4999", "1e6", "2e-3",
];

/// Whole numbers that lie about lengths.
const LIES: [u64; 14] = [
    0,
    1,
    2,
    7,
    127,
    255,
    1 << 15,
    0xffff,
    1 << 20,
    0x7fff_ffff,
    1 << 31,
    0xffff_ffff,
    1 << 40,
    u64::MAX,
];

/// Numbers that are none, or nearly.
const FLOATS: [f64; 8] = [
    0.0,
    -1.0,
    f64::MAX,
    f64::MIN,
    f64::MIN_POSITIVE,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
];

/// Gives a reader changed files until the time is over, or it has had enough of them.
///
/// # Panics
/// If one takes too long, or `read` panics: with the fewest edits that lead there, and the file.
fn fuzz(reader: &str, seeds: &[Vec<u8>], read: impl Fn(&[u8])) {
    let variable = |name: &str| {
        let value = std::env::var(name).ok()?;
        Some(value.parse::<u64>().expect("it is a whole number"))
    };
    let (seconds, inputs) = (variable("FUZZ_SECONDS"), variable("FUZZ_INPUTS"));
    let is_long = seconds.or(inputs).is_some();
    let (begin, processor) = (Instant::now(), processor_s());
    let (count, base) = (Cell::new(0_u64), variable("FUZZ_SEED").unwrap_or(1));
    let edits = prop::collection::vec(any::<u64>(), 1..5);
    let mut failure = None;
    for round in 0.. {
        let mut config = Config {
            failure_persistence: None,
            ..Config::default()
        };
        if is_long {
            config.cases = ROUND;
            config.rng_seed = RngSeed::Fixed(base.wrapping_mul(1 << 32).wrapping_add(round));
        }
        let found = TestRunner::new(config).run(&(0..seeds.len(), &edits), |(seed, edits)| {
            count.set(count.get() + 1);
            let changed = edited(&seeds[seed], &edits);
            let is_slow = || {
                let begin = Instant::now();
                read(&changed);
                begin.elapsed() >= LONGEST
            };
            // A busy machine may leave this thread waiting for so long, but hardly three times.
            prop_assert!(
                !(is_slow() && is_slow() && is_slow()),
                "more than {LONGEST:?} for {:?}",
                String::from_utf8_lossy(&changed)
            );
            Ok(())
        });
        failure = found.err();
        let is_late = seconds.is_some_and(|seconds| begin.elapsed().as_secs() >= seconds);
        if !is_long
            || failure.is_some()
            || is_late
            || inputs.is_some_and(|inputs| count.get() >= inputs)
        {
            break;
        }
    }
    let kilobytes = memory_kb();
    assert!(kilobytes < MOST_KB, "{kilobytes} kB");
    if is_long {
        let counts = serde_json::json!({
            "language": "Rust", "reader": reader, "inputs": count.get(), "finds": u8::from(failure.is_some()),
            "processor_s": processor_s() - processor, "memory_mb": kilobytes / 1024,
        });
        println!("{counts}");
        if let Some(path) = std::env::var_os("FUZZ_SUMMARY") {
            let file = OpenOptions::new().create(true).append(true).open(path);
            writeln!(file.expect("it can be opened"), "{counts}").expect("it can be written");
        }
    }
    if let Some(error) = failure {
        panic!("after {} inputs: {error}", count.get());
    }
}

/// Processor time of this thread so far (s), where the system says it.
fn processor_s() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanos = text.split(' ').next().and_then(|one| one.parse().ok());
    nanos.map_or(0.0, |nanos: f64| nanos * 1e-9)
}

/// The most memory that this program had so far (kB), where the system says it.
fn memory_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok())
        .unwrap_or(0)
}

/// Numbers that follow from one (splitmix64).
pub struct Draws(pub u64);

impl Draws {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    pub fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }

    fn of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len())]
    }
}

/// A file with edits, from each of which its choices follow. Text is taken apart into words and lines as well.
fn edited(seed: &[u8], edits: &[u64]) -> Vec<u8> {
    let mut data = seed.to_vec();
    for &edit in edits {
        let mut draws = Draws(edit);
        let is_text = !data.contains(&0) && std::str::from_utf8(&data).is_ok();
        if is_text && draws.below(5) > 0 {
            word_changed(&mut data, &mut draws);
        } else {
            bytes_changed(&mut data, &mut draws);
        }
    }
    data
}

fn word_changed(data: &mut Vec<u8>, draws: &mut Draws) {
    let is_word = |byte: u8| byte.is_ascii_alphanumeric() || b"_.+-".contains(&byte);
    let at = draws.below(data.len());
    let Some(begin) = (at..data.len()).find(|&i| is_word(data[i])) else {
        return;
    };
    let begin = (0..begin)
        .rev()
        .take_while(|&i| is_word(data[i]))
        .last()
        .unwrap_or(begin);
    let end = (begin..data.len())
        .find(|&i| !is_word(data[i]))
        .unwrap_or(data.len());
    let is_number = data[end - 1].is_ascii_digit();
    let new = if is_number && draws.below(2) == 0 {
        draws.of(&NUMBERS).as_bytes().to_vec()
    } else if draws.below(6) == 0 {
        let other = draws.below(data.len());
        data[other..]
            .iter()
            .copied()
            .take_while(|&byte| is_word(byte))
            .collect()
    } else {
        draws.of(&NASTY).as_bytes().to_vec()
    };
    data.splice(begin..end, new);
}

fn bytes_changed(data: &mut Vec<u8>, draws: &mut Draws) {
    let length = data.len();
    let part = if draws.below(2) == 0 {
        length.min(256)
    } else {
        length
    };
    let at = draws.below(part + 1);
    let overwrite = |data: &mut Vec<u8>, bytes: &[u8]| {
        let end = (at + bytes.len()).min(length);
        data.splice(at..end, bytes.iter().copied());
    };
    match draws.below(9) {
        0 | 1 if at < length => data[at] ^= 1 << draws.below(8),
        2 if at < length => data[at] = draws.next() as u8,
        3 | 4 => {
            let lie = draws.of(&LIES);
            let lie = draws.of(&[lie, length as u64, (length - at) as u64]);
            let width = draws.of(&[2, 4, 8]);
            overwrite(data, &lie.to_le_bytes()[..width]);
        }
        5 => overwrite(data, &draws.of(&FLOATS).to_le_bytes()),
        6 => drop(data.drain(at..(at + 1 + draws.below(64)).min(length))),
        7 => {
            let begin = draws.below(length);
            let copy = data[begin..(begin + 1 + draws.below(64)).min(length)].to_vec();
            data.splice(at..at, copy);
        }
        _ => data.truncate(at),
    }
}
