//! The rig's side of TAG's protocol, as the lab's bridge has it: it connects to the learner, and answers its requests.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::Asked;
use super::eye::Sight;
use crate::error::{Error, Result};
use crate::labs::lines::{LONGEST, Line, Lines, Request, done, observation, refusal};
use crate::labs::{Seen, TAG_LEARNER};

/// Pause between attempts to connect.
const AGAIN: Duration = Duration::from_millis(500);

/// Longest time for which a learner may take no bytes of an answer.
const PATIENCE: Duration = Duration::from_secs(1);

/// How often a silent connection looks whether the twin ends.
const GLANCE: Duration = Duration::from_millis(100);

/// A connection, on a thread of its own, so that no learner keeps the physics waiting.
pub struct Front {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    desk: Mutex<Desk>,
    came: Condvar,
    ends: AtomicBool,
}

/// What physics and learner exchange.
#[derive(Default)]
struct Desk {
    latest: Option<(Seen, Vec<u8>)>,
    /// Number of states so far.
    states: u64,
    asked: Asked,
}

impl Front {
    /// Begins to connect.
    ///
    /// # Errors
    /// [`Error::Refused`] if the system gives no thread.
    pub fn open() -> Result<Self> {
        Self::connect_to(TAG_LEARNER)
    }

    fn connect_to(learner: SocketAddr) -> Result<Self> {
        let shared = Arc::new(Shared::default());
        let thread = thread::Builder::new()
            .name("bridge".to_owned())
            .spawn({
                let shared = Arc::clone(&shared);
                move || shared.connect(learner)
            })
            .map_err(|error| Error::refused(format!("TCP {learner}: {error}")))?;
        Ok(Self {
            shared,
            thread: Some(thread),
        })
    }

    /// What came since the last tick.
    pub fn hear(&mut self) -> Asked {
        std::mem::take(&mut self.shared.desk().asked)
    }

    /// Offers what the estimator reports.
    pub fn show(&mut self, sight: &Sight) {
        let mut desk = self.shared.desk();
        desk.latest = Some((sight.seen, grey(&sight.picture)));
        desk.states += 1;
        self.shared.came.notify_all();
    }
}

impl Drop for Front {
    fn drop(&mut self) {
        self.shared.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn desk(&self) -> MutexGuard<'_, Desk> {
        self.desk.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn ends(&self) -> bool {
        self.ends.load(Ordering::Relaxed)
    }

    fn connect(&self, learner: SocketAddr) {
        while !self.ends() {
            if let Ok(stream) = TcpStream::connect(learner) {
                // A learner that goes away or takes no answers is connected to again.
                let _ = self.converse(stream);
            }
            let until = Instant::now() + AGAIN;
            while !self.ends() && Instant::now() < until {
                thread::sleep(GLANCE);
            }
        }
    }

    fn converse(&self, mut stream: TcpStream) -> std::io::Result<()> {
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(GLANCE))?;
        stream.set_write_timeout(Some(PATIENCE))?;
        let mut lines = Lines::default();
        let mut bytes = [0; 4096];
        while !self.ends() {
            let count = match stream.read(&mut bytes) {
                Ok(0) => return Ok(()),
                Ok(count) => count,
                Err(error)
                    if [
                        ErrorKind::WouldBlock,
                        ErrorKind::TimedOut,
                        ErrorKind::Interrupted,
                    ]
                    .contains(&error.kind()) =>
                {
                    continue;
                }
                Err(error) => return Err(error),
            };
            for line in lines.take(&bytes[..count]) {
                stream.write_all(self.answer(&line).as_bytes())?;
            }
        }
        Ok(())
    }

    /// Does what a line asks for; returns the answer.
    fn answer(&self, line: &Line) -> String {
        let request = match line {
            Line::Whole(bytes) => Request::parse(bytes),
            Line::TooLong => Err(format!("a line of more than {LONGEST} bytes")),
        };
        match request {
            Ok(Request::Obs) => latest(&self.desk()),
            Ok(Request::Action(commands)) => {
                self.desk().asked.commands = Some(commands);
                done()
            }
            Ok(Request::Step(commands, wait_s)) => {
                let mut desk = self.desk();
                desk.asked.commands = Some(commands);
                let before = desk.states;
                let (desk, _) = self
                    .came
                    .wait_timeout_while(desk, Duration::from_secs_f64(wait_s), |desk| {
                        desk.states == before
                    })
                    .unwrap_or_else(PoisonError::into_inner);
                latest(&desk)
            }
            Ok(Request::Reset) => {
                let mut desk = self.desk();
                desk.asked = Asked {
                    commands: None,
                    reset: true,
                };
                // What is seen from now on has no marble until it is back.
                if let Some((seen, _)) = &mut desk.latest {
                    seen.place_m = [f64::NAN; 2];
                }
                done()
            }
            Err(error) => refusal(&error),
        }
    }
}

/// The answer with the last state.
fn latest(desk: &Desk) -> String {
    match &desk.latest {
        Some((seen, picture)) => observation(seen, picture),
        None => refusal("no state yet"),
    }
}

/// A grey picture, by the mean of the colours.
fn grey(picture: &[[u8; 3]]) -> Vec<u8> {
    picture
        .iter()
        .map(|pixel| (pixel.iter().map(|&one| u16::from(one)).sum::<u16>() / 3) as u8)
        .collect()
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead, BufReader};
    use std::net::TcpListener;

    use serde_json::Value;

    use super::*;

    fn sight(x: f64) -> Sight {
        Sight {
            seen: Seen {
                tilts: [0.01, -0.02],
                place_m: [x, 0.0],
            },
            velocity: [0.0; 2],
            picture: vec![[3, 5, 7]; 64 * 64],
        }
    }

    fn learner() -> (Front, BufReader<TcpStream>) {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port is free");
        let address = listener.local_addr().expect("it has an address");
        let front = Front::connect_to(address).expect("it begins");
        let (stream, _) = listener.accept().expect("it connects");
        (front, BufReader::new(stream))
    }

    fn ask(stream: &mut BufReader<TcpStream>, request: &[u8]) -> Value {
        stream.get_mut().write_all(request).expect("it is taken");
        let mut line = String::new();
        stream.read_line(&mut line).expect("it is answered");
        serde_json::from_str(&line.replace("NaN", "null")).expect("it is JSON")
    }

    #[test]
    fn requests_are_answered_and_what_is_wrong_is_said() {
        let (mut front, mut stream) = learner();
        assert_eq!(
            ask(&mut stream, b"{\"cmd\":\"obs\"}\n")["error"],
            "no state yet"
        );
        front.show(&sight(0.05));
        let seen = ask(&mut stream, b"{\"cmd\":\"obs\"}\n");
        assert_eq!(
            (&seen["ok"], &seen["ball"]),
            (&Value::from(true), &Value::from(true))
        );
        assert_eq!(
            (&seen["alpha"], &seen["beta"]),
            (&Value::from(0.02), &Value::from(0.01))
        );
        assert_eq!(seen["image_b64"].as_str().map(str::len), Some(5464));
        let answer = ask(
            &mut stream,
            b"{\"cmd\":\"action\",\"vel_1\":50,\"vel_2\":-20.5}\n",
        );
        assert_eq!(answer["ok"], true);
        assert_eq!(front.hear().commands, Some([50.0, -20.5]));
        assert_eq!(front.hear(), Asked::default());
        for wrong in [&b"nonsense\n"[..], b"{\"cmd\":7}\n", b"\xff\xfe\n", b"\n"] {
            let answer = ask(&mut stream, wrong);
            assert_eq!(answer["ok"], false);
            assert!(answer["error"].is_string());
        }
        let mut long = vec![b'x'; 3 * LONGEST];
        long.push(b'\n');
        assert!(
            ask(&mut stream, &long)["error"]
                .as_str()
                .is_some_and(|error| error.contains("65536"))
        );
        // After all of that it still answers.
        assert_eq!(ask(&mut stream, b"{\"cmd\":\"reset\"}\n")["ok"], true);
        assert!(front.hear().reset);
        assert_eq!(
            ask(&mut stream, b"{\"cmd\":\"obs\"}\n")["ball"],
            false,
            "the hand has it"
        );
    }

    #[test]
    fn a_step_waits_for_the_next_state() {
        let (mut front, mut stream) = learner();
        front.show(&sight(0.01));
        let shower = thread::spawn(move || {
            while front.hear().commands.is_none() {
                thread::sleep(Duration::from_millis(1));
            }
            front.show(&sight(0.02));
            front
        });
        let seen = ask(
            &mut stream,
            b"{\"cmd\":\"step\",\"vel_1\":1,\"vel_2\":2,\"timeout\":1.0}\n",
        );
        assert_eq!(seen["x_b"], 0.02);
        let _front = shower.join().expect("it ends");
        // Without a new state it is the last one.
        let seen = ask(
            &mut stream,
            b"{\"cmd\":\"step\",\"vel_1\":1,\"vel_2\":2,\"timeout\":0.01}\n",
        );
        assert_eq!(seen["x_b"], 0.02);
    }

    #[test]
    fn a_learner_that_takes_no_answers_keeps_nothing_waiting() {
        let (mut front, mut stream) = learner();
        front.show(&sight(0.0));
        let begin = Instant::now();
        // Answers of 5.6 kB fill every buffer.
        let requests = b"{\"cmd\":\"obs\"}\n".repeat(2000);
        let _ = stream.get_mut().set_write_timeout(Some(PATIENCE));
        let _ = stream.get_mut().write_all(&requests);
        for tick in 0..100 {
            front.show(&sight(0.001 * f64::from(tick)));
            front.hear();
        }
        drop(front);
        assert!(
            begin.elapsed() < Duration::from_secs(4),
            "{:?}",
            begin.elapsed()
        );
    }
}
