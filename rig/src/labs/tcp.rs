//! The learner's side of TAG's protocol: waits for the lab's bridge (or a twin), and asks it for states.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::Seen;
use super::lines::{Line, Lines, Request, answered};
use crate::clock::Clock;
use crate::error::{Error, Result};
use crate::watch::Moment;

/// Longest wait for an answer: a bridge that is slower is gone.
const ANSWER: Duration = Duration::from_millis(500);

/// Wait of the bridge for a new state in a step (s), as the lab's learner has it.
const STEP_S: f64 = 0.018;

/// Pause between requests for states without commands.
const PAUSE: Duration = Duration::from_millis(8);

/// What happened on the line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Heard {
    /// A state came.
    State(Seen),
    /// Commands of servos 1 and 2 were sent.
    Sent([f64; 2]),
}

/// A connection, on a thread of its own.
pub struct Learner {
    heard: Receiver<(Moment, Heard)>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    /// Commands to send; none asks for states alone.
    commands: Mutex<Option<[f64; 2]>>,
    bridges: AtomicUsize,
    ends: AtomicBool,
}

impl Learner {
    /// Listens at an address.
    ///
    /// # Errors
    /// [`Error::Refused`] if somebody else listens there.
    pub fn open(address: SocketAddr, clock: Clock) -> Result<Self> {
        let cannot = |error: &std::io::Error| {
            Error::refused(format!(
                "TCP {address}: {error}; end the learner that listens there"
            ))
        };
        let listener = TcpListener::bind(address).map_err(|error| cannot(&error))?;
        listener
            .set_nonblocking(true)
            .map_err(|error| cannot(&error))?;
        let (sender, heard) = channel();
        let shared = Arc::new(Shared {
            commands: Mutex::new(None),
            bridges: AtomicUsize::new(0),
            ends: AtomicBool::new(false),
        });
        let thread = thread::Builder::new()
            .name("learner".to_owned())
            .spawn({
                let shared = Arc::clone(&shared);
                move || shared.listen(&listener, clock, &sender)
            })
            .map_err(|error| cannot(&error))?;
        Ok(Self {
            heard,
            shared,
            thread: Some(thread),
        })
    }

    /// Sets the commands of servos 1 and 2, which are sent until others are set.
    pub fn command(&self, commands: [f64; 2]) {
        *self.shared.lock() = Some(commands);
    }

    /// All that has happened since the last call.
    pub fn drain(&self, mut take: impl FnMut(Moment, Heard)) {
        while let Ok((moment, heard)) = self.heard.try_recv() {
            take(moment, heard);
        }
    }

    /// Number of connected bridges.
    pub fn bridges(&self) -> usize {
        self.shared.bridges.load(Ordering::Relaxed)
    }
}

impl Drop for Learner {
    /// The last command is zero, where any was sent.
    fn drop(&mut self) {
        if let Some(commands) = self.shared.lock().as_mut() {
            *commands = [0.0; 2];
        }
        self.shared.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn lock(&self) -> std::sync::MutexGuard<'_, Option<[f64; 2]>> {
        self.commands.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn ends(&self) -> bool {
        self.ends.load(Ordering::Relaxed)
    }

    fn listen(&self, listener: &TcpListener, clock: Clock, heard: &Sender<(Moment, Heard)>) {
        while !self.ends() {
            match listener.accept() {
                Ok((stream, _)) => {
                    self.bridges.store(1, Ordering::Relaxed);
                    // A connection that breaks is seen as silence, and the bridge connects again.
                    let _ = self.converse(stream, clock, heard);
                    self.bridges.store(0, Ordering::Relaxed);
                }
                Err(_) => thread::sleep(Duration::from_millis(10)),
            }
        }
    }

    fn converse(
        &self,
        mut stream: TcpStream,
        clock: Clock,
        heard: &Sender<(Moment, Heard)>,
    ) -> std::io::Result<()> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(ANSWER))?;
        stream.set_write_timeout(Some(ANSWER))?;
        let mut lines = Lines::default();
        let mut last = None;
        while !self.ends() {
            let commands = *self.lock();
            let request = commands.map_or(Request::Obs, |both| Request::Step(both, STEP_S));
            if let Some(both) = commands {
                let _ = heard.send((clock.now(), Heard::Sent(both)));
            }
            let answer = ask(&mut stream, &mut lines, request)?;
            // An answer of the last state again is no new one: its noise would differ.
            if let Some(seen) = answer
                && last.replace(seen.tilts) != Some(seen.tilts)
            {
                let _ = heard.send((clock.now(), Heard::State(seen)));
            }
            if commands.is_none() || answer.is_none() {
                thread::sleep(PAUSE);
            }
        }
        if self.lock().is_some() {
            let _ = heard.send((clock.now(), Heard::Sent([0.0; 2])));
            ask(&mut stream, &mut lines, Request::Action([0.0; 2]))?;
        }
        Ok(())
    }
}

/// The state with which a request is answered, if it has one.
fn ask(
    stream: &mut TcpStream,
    lines: &mut Lines,
    request: Request,
) -> std::io::Result<Option<Seen>> {
    let wrong = |what: String| std::io::Error::new(ErrorKind::InvalidData, what);
    let begin = Instant::now();
    stream.write_all(request.line().as_bytes())?;
    let mut bytes = [0; 8192];
    loop {
        let count = stream.read(&mut bytes)?;
        if count == 0 {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        match lines.take(&bytes[..count]).into_iter().next() {
            Some(Line::Whole(line)) => return answered(&line).map_err(wrong),
            Some(Line::TooLong) => return Err(wrong("a line that is too long".to_owned())),
            // Bytes that drip are no answer either.
            None if begin.elapsed() > ANSWER => return Err(ErrorKind::TimedOut.into()),
            None => (),
        }
    }
}
