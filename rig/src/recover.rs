//! Recovery of a truncated bag.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use mcap::Attachment;
use mcap::read::{LinearReader, Options};
use mcap::records::{MessageHeader, Record};

use crate::error::{Error, Result};
use crate::recorder;

/// Result of a recovery.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recovered {
    /// The bag that was written.
    pub path: PathBuf,
    /// Messages in it.
    pub messages: u64,
    /// Time from its first to its last message (ns).
    pub nanos: u64,
    /// Whether the bag was complete.
    pub was_whole: bool,
}

/// Copies every message, attachment and fact of a bag that can still be read into one that is whole, beside it
/// or to `out`; the bag itself is left alone.
///
/// # Errors
/// [`Error::Refused`] if it is no bag, or the copy cannot be written.
pub fn recover(bag: &Path, out: Option<&Path>) -> Result<Recovered> {
    let shown = bag.display();
    let bytes = fs::read(bag)
        .map_err(|error| Error::refused(format!("{shown}: cannot be read: {error}")))?;
    let path = out.map_or_else(|| beside(bag), Path::to_owned);
    if path.exists() {
        return Err(Error::refused(format!(
            "{}: is there already; name another file with --out",
            path.display()
        )));
    }
    let partial = path.with_extension("mcap.part");
    let found = copy(&bytes, &partial);
    let found = found.and_then(|copied| {
        fs::rename(&partial, &path).map_err(|error| format!("cannot be renamed: {error}"))?;
        Ok(copied)
    });
    let copied = found.map_err(|error| {
        let _ = fs::remove_file(&partial);
        Error::refused(format!("{shown}: {error}"))
    })?;
    Ok(Recovered {
        path,
        messages: copied.messages,
        nanos: copied.last.saturating_sub(copied.first),
        was_whole: copied.was_whole,
    })
}

fn beside(bag: &Path) -> PathBuf {
    let stem = bag.file_stem().unwrap_or_default().to_string_lossy();
    bag.with_file_name(format!("{stem}-recovered.mcap"))
}

struct Copied {
    messages: u64,
    first: u64,
    last: u64,
    was_whole: bool,
}

fn copy(bytes: &[u8], to: &Path) -> std::result::Result<Copied, String> {
    if !bytes.starts_with(mcap::MAGIC) {
        return Err("is no bag: it does not begin like an MCAP file".to_owned());
    }
    let records = LinearReader::new_with_options(bytes, Options::IgnoreEndMagic.into())
        .map_err(|error| format!("is no bag: {}", recorder::said(&error)))?;
    let file = File::create_new(to)
        .map_err(|error| format!("cannot be recovered to {}: {error}", to.display()))?;
    let mut copy = Copy {
        writer: recorder::writer(file).map_err(|error| recorder::said(&error))?,
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
        copied: Copied {
            messages: 0,
            first: u64::MAX,
            last: 0,
            was_whole: false,
        },
    };
    for record in records {
        // Data after a truncated record is lost.
        let Ok(record) = record else { break };
        match record {
            Record::Chunk { header, data } => {
                // Bags of a rig are not compressed.
                if !header.compression.is_empty() {
                    break;
                }
                // A reader with a limit to lengths: `ChunkReader` adds to one near 2^64, and overflows.
                let chunk = LinearReader::sans_magic(&data);
                for record in chunk.map_while(mcap::McapResult::ok) {
                    copy.take(record).map_err(|error| recorder::said(&error))?;
                }
            }
            record => copy.take(record).map_err(|error| recorder::said(&error))?,
        }
    }
    copy.writer
        .finish()
        .map_err(|error| recorder::said(&error))?;
    copy.copied.first = copy.copied.first.min(copy.copied.last);
    Ok(copy.copied)
}

struct Copy {
    writer: mcap::Writer<std::io::BufWriter<File>>,
    schemas: BTreeMap<u16, u16>,
    channels: BTreeMap<u16, u16>,
    copied: Copied,
}

impl Copy {
    fn take(&mut self, record: Record<'_>) -> mcap::McapResult<()> {
        match record {
            Record::Schema { header, data } => {
                let id = self
                    .writer
                    .add_schema(&header.name, &header.encoding, &data)?;
                self.schemas.insert(header.id, id);
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).copied().unwrap_or(0);
                let id = self.writer.add_channel(
                    schema,
                    &channel.topic,
                    &channel.message_encoding,
                    &channel.metadata,
                )?;
                self.channels.insert(channel.id, id);
            }
            Record::Message { header, data } => {
                if let Some(&channel_id) = self.channels.get(&header.channel_id) {
                    self.writer.write_to_known_channel(
                        &MessageHeader {
                            channel_id,
                            ..header
                        },
                        &data,
                    )?;
                    self.copied.messages += 1;
                    self.copied.first = self.copied.first.min(header.log_time);
                    self.copied.last = self.copied.last.max(header.log_time);
                }
            }
            Record::Attachment { header, data, .. } => self.writer.attach(&Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name,
                media_type: header.media_type,
                data,
            })?,
            Record::Metadata(metadata) => self.writer.write_metadata(&metadata)?,
            Record::Footer(_) => self.copied.was_whole = true,
            _ => (),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;
    use crate::messages::{Bool, Header, JointState, Time};
    use crate::recorder::{Attached, Recorder};

    fn config(text: &str) -> Attached<'_> {
        Attached {
            name: "rig.toml",
            text,
        }
    }

    /// A folder of its own, gone in the end.
    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("rig-{name}-{}", std::process::id()));
            fs::create_dir_all(&path).expect("it can be made");
            Self(path)
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    fn state(i: i64) -> JointState {
        JointState {
            header: Header {
                stamp: Time::from_nanos(i),
                frame_id: String::new(),
            },
            position: vec![i as f64],
            ..JointState::default()
        }
    }

    fn recorded(folder: &Folder, messages: i64) -> (PathBuf, Vec<u8>) {
        let path = folder.0.join("bag.mcap");
        let facts = BTreeMap::from([("backend".to_owned(), "trajectory".to_owned())]);
        let mut recorder =
            Recorder::create(&path, config("# the file"), facts).expect("it can be written");
        let joints = recorder.channel::<JointState>("/joint_states");
        let stop = recorder.channel::<Bool>("/rig/e_stop");
        for i in 0..messages {
            recorder.record(joints, i + 1, i, &state(i));
            if i % 100 == 99 {
                recorder.flush();
            }
        }
        recorder.record(stop, messages, messages, &Bool { data: true });
        let written = recorder.finish().expect("nothing is lost");
        assert_eq!(written.messages, messages as u64 + 1);
        assert!(written.latency_ms(0.99).is_finite());
        let bytes = fs::read(&path).expect("it is there");
        (path, bytes)
    }

    #[test]
    fn a_length_in_a_chunk_that_overflows_ends_the_chunk() {
        let folder = Folder::new("overflow");
        let (path, mut bytes) = recorded(&folder, 0);
        // The chunk's first record is the schema: its opcode, and its length behind it.
        let name = bytes
            .windows(4)
            .position(|part| part == b"std_")
            .expect("a schema is named");
        let length = name - 4 - 2 - 8;
        bytes[length..length + 8].copy_from_slice(&(u64::MAX - 3).to_le_bytes());
        fs::write(&path, bytes).expect("it can be written");
        let found = recover(&path, None).expect("the rest can be read");
        assert_eq!(found.messages, 0);
    }

    #[test]
    fn a_whole_bag_keeps_everything() {
        let folder = Folder::new("whole");
        let (path, _) = recorded(&folder, 500);
        let found = recover(&path, None).expect("it can be read");
        assert_eq!((found.messages, found.was_whole), (501, true));
        let bytes = fs::read(&found.path).expect("it was written");
        let summary = mcap::Summary::read(&bytes)
            .expect("it is whole")
            .expect("it has one");
        assert_eq!(
            summary.attachment_indexes.len() + summary.metadata_indexes.len(),
            2
        );
        assert_eq!(summary.channels.len(), 2);
        assert!(recover(&path, None).is_err());
    }

    #[test]
    fn a_bag_cut_anywhere_keeps_the_chunks_before() {
        let folder = Folder::new("cut");
        let (_, bytes) = recorded(&folder, 500);
        let mut last = 0;
        for part in [0.02, 0.3, 0.5, 0.7, 0.9, 0.99] {
            let cut = folder.0.join(format!("cut-{part}.mcap"));
            let length = (part * bytes.len() as f64) as usize;
            fs::write(&cut, &bytes[..length]).expect("it can be written");
            let found = recover(&cut, None).expect("the rest can be read");
            assert!(!found.was_whole);
            assert!(found.messages >= last, "{found:?}");
            last = found.messages;
        }
        assert!(last >= 400, "{last}");
    }

    #[test]
    fn what_is_no_bag_is_refused_and_leaves_nothing() {
        let folder = Folder::new("none");
        let path = folder.0.join("text.mcap");
        fs::write(&path, "no bag").expect("it can be written");
        assert!(recover(&path, None).is_err());
        assert_eq!(fs::read_dir(&folder.0).expect("it is there").count(), 1);
    }

    #[test]
    fn what_is_recorded_is_on_disk_within_half_a_second() {
        let folder = Folder::new("flush");
        let path = folder.0.join("bag.mcap");
        let mut recorder =
            Recorder::create(&path, config(""), BTreeMap::new()).expect("it can be written");
        let joints = recorder.channel::<JointState>("/joint_states");
        recorder.record(joints, 1, 1, &state(1));
        let begin = Instant::now();
        loop {
            std::thread::sleep(Duration::from_millis(50));
            let copy = folder.0.join("copy.mcap");
            fs::copy(&path, &copy).expect("it can be copied");
            let out = folder.0.join("out.mcap");
            let found = recover(&copy, Some(&out)).expect("it can be read").messages;
            fs::remove_file(out).expect("it was written");
            if found == 1 {
                break;
            }
            assert!(begin.elapsed() < Duration::from_secs(10));
        }
        recorder.finish().expect("nothing is lost");
    }
}
