//! The bag: all sent and received messages in one MCAP file for ROS 2 tools, written by a separate thread.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, WriteOptions, Writer};

use crate::error::{Error, Result};
use crate::messages::{Message, to_cdr};

/// Flush period: a crash loses no more than this.
const FLUSH: Duration = Duration::from_millis(250);

/// Queue length to the disk: two minutes at a kilohertz.
const WAITING: usize = 1 << 17;

/// A message to the writing thread.
enum Item {
    Channel {
        id: u16,
        topic: String,
        kind: String,
        package_definition: &'static str,
    },
    Message {
        id: u16,
        log_nanos: i64,
        publish_nanos: i64,
        data: Vec<u8>,
        since: Instant,
    },
    #[cfg(test)]
    Flush(SyncSender<()>),
    /// The end of the bag; whoever waits for it gets word.
    End(Option<SyncSender<()>>),
}

/// The way into the bag, for any thread.
#[derive(Clone)]
pub struct Queue {
    sender: SyncSender<Item>,
    lost: Arc<AtomicU64>,
}

/// Result of a recording.
#[derive(Debug, Clone, Default)]
pub struct Written {
    /// Messages in the bag.
    pub messages: u64,
    /// Latency from the loop into the bag (µs), of the loop's own messages, sorted.
    pub latencies_us: Vec<u32>,
}

impl Written {
    /// A quantile of the latencies (ms).
    pub fn latency_ms(&self, part: f64) -> f64 {
        let last = self.latencies_us.len().saturating_sub(1);
        let index = (part * last as f64).round() as usize;
        self.latencies_us
            .get(index)
            .map_or(f64::NAN, |&us| f64::from(us) / 1e3)
    }
}

/// The loop's end of the recording.
pub struct Recorder {
    path: PathBuf,
    queue: Queue,
    thread: Option<JoinHandle<Result<Written>>>,
    failed: Arc<Mutex<Option<String>>>,
    channels: BTreeMap<String, u16>,
}

/// A configuration in a bag. `irt import` takes a bag with a `rig.toml` for one of arms at knobs.
#[derive(Debug, Clone, Copy)]
pub struct Attached<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its text.
    pub text: &'a str,
}

/// A topic of a bag.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Channel(u16);

impl Recorder {
    /// Begins a bag; `config` goes into it word for word, with these facts.
    ///
    /// # Errors
    /// [`Error::Refused`] if the file is there already or cannot be written.
    pub fn create(
        path: &Path,
        config: Attached<'_>,
        facts: BTreeMap<String, String>,
    ) -> Result<Self> {
        let cannot = |error: &dyn std::fmt::Display| {
            Error::refused(format!("{}: cannot be written: {error}", path.display()))
        };
        let file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .open(path)
            .map_err(|error| cannot(&error))?;
        let writer = begin(file, config, facts).map_err(|error| {
            let _ = fs::remove_file(path);
            cannot(&said(&error))
        })?;
        let (sender, receiver) = sync_channel(WAITING);
        let failed = Arc::new(Mutex::new(None));
        let thread = thread::Builder::new()
            .name("recorder".to_owned())
            .spawn({
                let failed = Arc::clone(&failed);
                move || {
                    write(writer, &receiver).map_err(|error| {
                        let message = said(&error);
                        *failed.lock().unwrap_or_else(PoisonError::into_inner) =
                            Some(message.clone());
                        Error::Refused(message)
                    })
                }
            })
            .map_err(|error| cannot(&error))?;
        Ok(Self {
            path: path.to_owned(),
            queue: Queue {
                sender,
                lost: Arc::new(AtomicU64::new(0)),
            },
            thread: Some(thread),
            failed,
            channels: BTreeMap::new(),
        })
    }

    /// The bag.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The channel of a topic, which is made if it is new.
    pub fn channel<M: Message>(&mut self, topic: &str) -> Channel {
        let next = self.channels.len() as u16 + 1;
        let id = *self.channels.entry(topic.to_owned()).or_insert(next);
        if id == next {
            self.queue.send(Item::Channel {
                id,
                topic: topic.to_owned(),
                kind: M::type_name(),
                package_definition: M::DEFINITION,
            });
        }
        Channel(id)
    }

    /// The way into the bag, for another thread.
    pub fn queue(&self) -> Queue {
        self.queue.clone()
    }

    /// Queues a message with the times (ns since 1970) of receipt or sending and of publication.
    pub fn record<M: Message>(
        &self,
        channel: Channel,
        log_nanos: i64,
        publish_nanos: i64,
        message: &M,
    ) {
        self.queue
            .record(channel, log_nanos, publish_nanos, message);
    }

    /// The writing thread's error, if any.
    pub fn failure(&self) -> Option<String> {
        let failed = self.failed.lock().unwrap_or_else(PoisonError::into_inner);
        let lost = self.queue.lost.load(Ordering::Relaxed);
        failed
            .clone()
            .or_else(|| (lost > 0).then(|| format!("{lost} messages were lost")))
    }

    /// Flushes all queued messages to the disk and waits for it.
    #[cfg(test)]
    pub fn flush(&self) {
        let (done, wait) = sync_channel(1);
        self.queue.send(Item::Flush(done));
        let _ = wait.recv_timeout(Duration::from_secs(1));
    }

    /// Ends the bag.
    ///
    /// # Errors
    /// [`Error::Refused`] if something of it is lost.
    pub fn finish(&mut self) -> Result<Written> {
        // A full queue is waited for; a thread that has failed takes nothing more.
        let _ = self.queue.sender.send(Item::End(None));
        let shown = self.path.display().to_string();
        let written = match self.thread.take().map(JoinHandle::join) {
            Some(Ok(written)) => written,
            _ => Err(Error::refused("the recorder's thread is gone")),
        };
        match (written, self.failure()) {
            (Ok(written), None) => Ok(written),
            (Err(error), _) => Err(Error::refused(format!("{shown}: {error}"))),
            (_, Some(failure)) => Err(Error::refused(format!("{shown}: {failure}"))),
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        if self.thread.is_some() {
            self.queue.send(Item::End(None));
        }
    }
}

impl Queue {
    /// Queues a message, as [`Recorder::record`] does.
    pub fn record<M: Message>(
        &self,
        channel: Channel,
        log_nanos: i64,
        publish_nanos: i64,
        message: &M,
    ) {
        match to_cdr(message) {
            Ok(data) => self.send(Item::Message {
                id: channel.0,
                log_nanos,
                publish_nanos,
                data,
                since: Instant::now(),
            }),
            Err(_) => {
                self.lost.fetch_add(1, Ordering::Relaxed);
            }
        }
    }

    fn send(&self, item: Item) {
        // The loop never waits for the disk.
        if let Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) =
            self.sender.try_send(item)
        {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Ends the bag after all that is queued, and waits for it no longer than this.
    pub fn end_within(&self, longest: Duration) {
        let (done, wait) = sync_channel(1);
        self.send(Item::End(Some(done)));
        let _ = wait.recv_timeout(longest);
    }
}

/// Writes the configuration and the facts, before all messages.
fn begin(
    file: File,
    config: Attached<'_>,
    facts: BTreeMap<String, String>,
) -> mcap::McapResult<Writer<BufWriter<File>>> {
    let mut writer = writer(file)?;
    writer.attach(&Attachment {
        log_time: 0,
        create_time: 0,
        name: config.name.to_owned(),
        media_type: "application/toml".to_owned(),
        data: config.text.as_bytes().into(),
    })?;
    writer.write_metadata(&Metadata {
        name: "rig".to_owned(),
        metadata: facts,
    })?;
    writer.flush()?;
    Ok(writer)
}

/// The text of an error of the file system or of MCAP.
pub fn said(error: &mcap::McapError) -> String {
    match error {
        mcap::McapError::Io(error) => error.to_string(),
        error => error.to_string(),
    }
}

/// A writer of bags as ROS 2 reads them: plain chunks, each written at once, so that a truncated bag keeps the ones before.
pub fn writer(file: File) -> mcap::McapResult<Writer<BufWriter<File>>> {
    WriteOptions::new()
        .profile("ros2")
        .library(concat!("rig ", env!("CARGO_PKG_VERSION")))
        .compression(None)
        .disable_seeking(true)
        .create(BufWriter::new(file))
}

/// Writes until the end of the bag, or until a write fails.
fn write(
    mut writer: Writer<BufWriter<File>>,
    receiver: &Receiver<Item>,
) -> mcap::McapResult<Written> {
    let (written, waits) = take(&mut writer, receiver)?;
    writer.finish()?;
    if let Some(waits) = waits {
        let _ = waits.send(());
    }
    Ok(written)
}

fn take(
    writer: &mut Writer<BufWriter<File>>,
    receiver: &Receiver<Item>,
) -> mcap::McapResult<(Written, Option<SyncSender<()>>)> {
    let mut written = Written::default();
    let mut waits = None;
    let mut channels = BTreeMap::new();
    let mut sequences: BTreeMap<u16, u32> = BTreeMap::new();
    let mut flushed = Instant::now();
    loop {
        match receiver.recv_timeout(FLUSH.saturating_sub(flushed.elapsed())) {
            Ok(Item::Channel {
                id,
                topic,
                kind,
                package_definition,
            }) => {
                let schema = writer.add_schema(&kind, "ros2msg", package_definition.as_bytes())?;
                channels.insert(
                    id,
                    writer.add_channel(schema, &topic, "cdr", &BTreeMap::new())?,
                );
            }
            Ok(Item::Message {
                id,
                log_nanos,
                publish_nanos,
                data,
                since,
            }) => {
                let sequence = sequences.entry(id).or_default();
                *sequence += 1;
                let header = MessageHeader {
                    channel_id: channels[&id],
                    sequence: *sequence,
                    log_time: log_nanos.max(0) as u64,
                    publish_time: publish_nanos.max(0) as u64,
                };
                writer.write_to_known_channel(&header, &data)?;
                written.messages += 1;
                let us = since.elapsed().as_micros();
                written
                    .latencies_us
                    .push(us.min(u128::from(u32::MAX)) as u32);
            }
            #[cfg(test)]
            Ok(Item::Flush(done)) => {
                writer.flush()?;
                flushed = Instant::now();
                let _ = done.send(());
            }
            Err(RecvTimeoutError::Timeout) => (),
            Ok(Item::End(word)) => {
                waits = word;
                break;
            }
            Err(RecvTimeoutError::Disconnected) => break,
        }
        if flushed.elapsed() >= FLUSH {
            writer.flush()?;
            flushed = Instant::now();
        }
    }
    written.latencies_us.sort_unstable();
    Ok((written, waits))
}

/// An unused path in a folder: `name.mcap`, `name-2.mcap`, and so on.
///
/// # Errors
/// [`Error::Refused`] if the folder cannot be made.
pub fn fresh(folder: &Path, name: &str) -> Result<PathBuf> {
    fs::create_dir_all(folder).map_err(|error| {
        Error::refused(format!(
            "{}: the folder cannot be made: {error}",
            folder.display()
        ))
    })?;
    let paths = (1..).map(|i| match i {
        1 => folder.join(format!("{name}.mcap")),
        _ => folder.join(format!("{name}-{i}.mcap")),
    });
    paths
        .into_iter()
        .find(|path| !path.exists())
        .ok_or_else(|| Error::refused("no name is free"))
}
