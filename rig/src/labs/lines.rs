//! TAG's protocol: a line of JSON from the learner asks, a line of JSON from the rig answers.
//!
//! Requests are `{"cmd": "obs" | "action" | "step" | "reset", "vel_1", "vel_2", "timeout"}`, answers
//! `{"ok", "ball", "alpha", "beta", "x_b", "y_b", "image_b64"}`. As Python's json does, a number may be `NaN`.

use base64::prelude::{BASE64_STANDARD, Engine};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::Seen;

/// Longest line (bytes): an answer has 5.7 kB.
pub const LONGEST: usize = 1 << 16;

/// Longest wait for a new state in a step (s).
const LONGEST_WAIT_S: f64 = 1.0;

/// Wait for a new state in a step that does not say how long (s).
const WAIT_S: f64 = 0.018;

/// A request of the learner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Request {
    /// The last state.
    Obs,
    /// Commands of servos 1 and 2.
    Action([f64; 2]),
    /// Commands, answered by the next state or after a time (s) by the last one.
    Step([f64; 2], f64),
    /// Level the board, and bring the marble back.
    Reset,
}

#[derive(Deserialize)]
struct Fields {
    cmd: String,
    vel_1: Option<f64>,
    vel_2: Option<f64>,
    timeout: Option<f64>,
}

/// Reads JSON in which numbers may be `NaN` or infinite, as Python writes them; these become null.
fn json<T: DeserializeOwned>(line: &[u8]) -> Result<T, String> {
    let text = std::str::from_utf8(line).map_err(|_| "not UTF-8".to_owned())?;
    serde_json::from_str(text)
        .or_else(|error| {
            let finite = ["-Infinity", "Infinity", "NaN"]
                .iter()
                .fold(text.to_owned(), |text, word| text.replace(word, "null"));
            serde_json::from_str(&finite).map_err(|_| error)
        })
        .map_err(|error| format!("not a request in JSON: {error}"))
}

impl Request {
    /// Reads a line. Commands that are missing or no numbers are 0, as the lab's bridge has it.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(line: &[u8]) -> Result<Self, String> {
        let fields: Fields = json(line)?;
        let commands = [fields.vel_1, fields.vel_2].map(|one| one.unwrap_or(0.0));
        match fields.cmd.as_str() {
            "obs" => Ok(Self::Obs),
            "action" => Ok(Self::Action(commands)),
            "step" => {
                let wait = fields.timeout.unwrap_or(WAIT_S);
                Ok(Self::Step(commands, wait.clamp(0.0, LONGEST_WAIT_S)))
            }
            "reset" => Ok(Self::Reset),
            other => Err(format!(
                "unknown cmd \"{other}\"; expected obs, action, step or reset"
            )),
        }
    }

    /// Its line.
    pub fn line(&self) -> String {
        match self {
            Self::Obs => "{\"cmd\":\"obs\"}\n".to_owned(),
            Self::Action([a, b]) => {
                format!("{{\"cmd\":\"action\",\"vel_1\":{a:?},\"vel_2\":{b:?}}}\n")
            }
            Self::Step([a, b], wait) => format!(
                "{{\"cmd\":\"step\",\"vel_1\":{a:?},\"vel_2\":{b:?},\"timeout\":{wait:?}}}\n"
            ),
            Self::Reset => "{\"cmd\":\"reset\"}\n".to_owned(),
        }
    }
}

/// The answer that something was done.
pub fn done() -> String {
    "{\"ok\":true}\n".to_owned()
}

/// The answer that something is wrong.
pub fn refusal(error: &str) -> String {
    let error = serde_json::Value::from(error);
    format!("{{\"ok\":false,\"error\":{error}}}\n")
}

/// The answer with a state and its grey picture, 64 x 64 pixels.
pub fn observation(seen: &Seen, picture: &[u8]) -> String {
    let ([alpha, beta], [x, y]) = (seen.angles(), seen.place_m);
    format!(
        "{{\"ok\":true,\"ball\":{},\"alpha\":{alpha:?},\"beta\":{beta:?},\"x_b\":{x:?},\"y_b\":{y:?},\"image_b64\":\"{}\"}}\n",
        seen.has_marble(),
        BASE64_STANDARD.encode(picture)
    )
}

#[derive(Deserialize)]
struct Answer {
    ok: bool,
    ball: Option<bool>,
    alpha: Option<f64>,
    beta: Option<f64>,
    x_b: Option<f64>,
    y_b: Option<f64>,
}

/// Reads an answer: its state, if it has one.
///
/// # Errors
/// What is wrong with it.
pub fn answered(line: &[u8]) -> Result<Option<Seen>, String> {
    let answer: Answer = json(line)?;
    let (Some(alpha), Some(beta), true) = (answer.alpha, answer.beta, answer.ok) else {
        return Ok(None);
    };
    let lost = answer.ball == Some(false);
    let place = [answer.x_b, answer.y_b].map(|one| one.filter(|_| !lost).unwrap_or(f64::NAN));
    Ok(Some(Seen::of_angles([alpha, beta], place)))
}

/// A line of a stream.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Line {
    /// Its bytes.
    Whole(Vec<u8>),
    /// It is longer than [`LONGEST`], and skipped.
    TooLong,
}

/// The lines of a stream, whose memory does not grow.
#[derive(Debug, Default)]
pub struct Lines {
    buffer: Vec<u8>,
    skips: bool,
}

impl Lines {
    /// Takes bytes of the stream; returns the lines that they end.
    pub fn take(&mut self, bytes: &[u8]) -> Vec<Line> {
        let mut found = Vec::new();
        let mut parts = bytes.split(|&byte| byte == b'\n').peekable();
        while let Some(part) = parts.next() {
            let ends = parts.peek().is_some();
            if !self.skips {
                self.buffer.extend_from_slice(part);
                if self.buffer.len() > LONGEST {
                    self.buffer = Vec::new();
                    self.skips = true;
                    found.push(Line::TooLong);
                }
            }
            if ends && !std::mem::take(&mut self.skips) {
                found.push(Line::Whole(std::mem::take(&mut self.buffer)));
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn requests_of_the_labs_learner_are_read() {
        let parse = |text: &str| Request::parse(text.as_bytes());
        assert_eq!(parse("{\"cmd\":\"obs\"}"), Ok(Request::Obs));
        assert_eq!(
            parse("{\"cmd\":\"step\",\"vel_1\":-180.0,\"vel_2\":3,\"timeout\":0.018}\r"),
            Ok(Request::Step([-180.0, 3.0], 0.018))
        );
        assert_eq!(
            parse("{\"cmd\":\"action\",\"vel_1\":NaN,\"vel_2\":-Infinity}"),
            Ok(Request::Action([0.0; 2]))
        );
        assert_eq!(
            parse("{\"cmd\":\"step\",\"timeout\":1e9}"),
            Ok(Request::Step([0.0; 2], LONGEST_WAIT_S))
        );
        for (text, said) in [
            ("{", "not a request in JSON"),
            ("[1, 2]", "not a request in JSON"),
            ("{\"cmd\":\"stop\"}", "unknown cmd \"stop\""),
            ("{\"vel_1\":1}", "cmd"),
            ("{\"cmd\":\"step\",\"vel_1\":\"fast\"}", "fast"),
        ] {
            let error = parse(text).expect_err(said);
            assert!(error.contains(said), "{error}");
            let line = refusal(&error);
            let answer: serde_json::Value = serde_json::from_str(&line).expect("it is JSON");
            assert_eq!(answer["ok"], false);
            assert_eq!(answer["error"], error);
        }
        assert!(Request::parse(&[0xff, b'{']).is_err());
    }

    proptest! {
        #[test]
        fn requests_and_answers_are_read_as_they_were_written(
            (vel_1, vel_2) in (-300.0..300.0, -300.0..300.0),
            wait in 0.0..1.0,
            tilts in prop::array::uniform2(-0.3..0.3),
            place_m in prop::array::uniform2(-0.2..0.2),
            lost in any::<bool>(),
        ) {
            for request in [
                Request::Obs,
                Request::Reset,
                Request::Action([vel_1, vel_2]),
                Request::Step([vel_1, vel_2], wait),
            ] {
                let line = request.line();
                prop_assert_eq!(Request::parse(line.trim_end().as_bytes()), Ok(request));
            }
            let place_m = if lost { [f64::NAN; 2] } else { place_m };
            let seen = Seen { tilts, place_m };
            let line = observation(&seen, &[7; 64 * 64]);
            prop_assert!(line.len() < LONGEST && line.ends_with('\n'));
            let read = answered(line.trim_end().as_bytes()).expect("it is right").expect("it has a state");
            prop_assert_eq!(read.tilts, tilts);
            prop_assert_eq!(read.has_marble(), !lost);
            prop_assert!(lost || read.place_m == place_m);
        }

        /// However a stream arrives, its lines are the same, and those that are too long are skipped.
        #[test]
        fn lines_do_not_depend_on_how_they_arrive(
            lengths in prop::collection::vec(prop_oneof![4 => 0..300_usize, 1 => LONGEST - 2..LONGEST + 3], 1..6),
            piece in 1..40_000_usize,
        ) {
            let mut stream = Vec::new();
            for (i, &length) in lengths.iter().enumerate() {
                stream.resize(stream.len() + length, b'a' + i as u8);
                stream.push(b'\n');
            }
            let mut lines = Lines::default();
            let found: Vec<Line> = stream.chunks(piece).flat_map(|part| lines.take(part)).collect();
            let expected: Vec<Line> = lengths.iter().enumerate().map(|(i, &length)| {
                if length > LONGEST { Line::TooLong } else { Line::Whole(vec![b'a' + i as u8; length]) }
            }).collect();
            prop_assert_eq!(found, expected);
            prop_assert!(lines.buffer.is_empty());
        }
    }
}
