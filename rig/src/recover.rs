//! Recovery of a truncated bag.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{Attachment, McapError, McapResult, parse_record};

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
    // Data after a truncated record is lost.
    for record in Records::after_magic(&bytes[mcap::MAGIC.len()..]).map_while(McapResult::ok) {
        match record {
            Record::Chunk { header, data } => {
                // Bags of a rig are not compressed.
                if !header.compression.is_empty() {
                    break;
                }
                for record in Records::after_magic(&data).map_while(McapResult::ok) {
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

/// The records of a bag or of a chunk. The library's own readers in memory panic on attachments without a checksum.
struct Records<'a> {
    unread: &'a [u8],
    reader: LinearReader,
}

impl<'a> Records<'a> {
    /// Of bytes without magic at their begin; it may be missing at their end.
    fn after_magic(bytes: &'a [u8]) -> Self {
        Self {
            unread: bytes,
            reader: LinearReader::new_with_options(
                LinearReaderOptions::default()
                    // Without a limit, a sum with a length near 2^64 overflows.
                    .with_record_length_limit(bytes.len())
                    .with_skip_start_magic(true)
                    .with_skip_end_magic(true)
                    .with_emit_chunks(true),
            ),
        }
    }
}

impl Iterator for Records<'_> {
    type Item = McapResult<Record<'static>>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            match self.reader.next_event()? {
                Ok(LinearReadEvent::ReadRequest(wanted)) => {
                    let (part, rest) = self.unread.split_at(wanted.min(self.unread.len()));
                    self.reader.insert(part.len()).copy_from_slice(part);
                    self.reader.notify_read(part.len());
                    self.unread = rest;
                }
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    if opcode == op::ATTACHMENT && !is_long_enough(data) {
                        return Some(Err(McapError::UnexpectedEof));
                    }
                    return Some(parse_record(opcode, data).map(Record::into_owned));
                }
                Err(error) => return Some(Err(error)),
            }
        }
    }
}

/// Whether an attachment has a checksum (4 bytes) behind its header: two times and the data's length (8 bytes each), and two
/// strings with their lengths (4 bytes). `parse_record` takes that for granted.
fn is_long_enough(attachment: &[u8]) -> bool {
    let string = |at: usize| {
        let length = attachment.get(at..)?.first_chunk()?;
        (at + 4).checked_add(u32::from_le_bytes(*length) as usize)
    };
    let strings = string(16).and_then(string);
    strings.is_some_and(|end| end.saturating_add(8 + 4) <= attachment.len())
}

struct Copy {
    writer: mcap::Writer<std::io::BufWriter<File>>,
    schemas: BTreeMap<u16, u16>,
    channels: BTreeMap<u16, u16>,
    copied: Copied,
}

impl Copy {
    fn take(&mut self, record: Record<'_>) -> McapResult<()> {
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
    fn an_attachment_without_place_for_its_checksum_was_a_panic() {
        let folder = Folder::new("attachment");
        let (path, bytes) = recorded(&folder, 100);
        let name = bytes
            .windows(8)
            .position(|part| part == b"rig.toml")
            .expect("the attachment is named");
        // Opcode, length of the record, and two times are before the name's length.
        let begin = name - 4 - 16 - 8 - 1;
        assert_eq!(bytes[begin], op::ATTACHMENT);
        let length = u64::from_le_bytes(*bytes[begin + 1..].first_chunk().expect("it is whole"));
        // The name reaches to 8 + 4 + `behind` bytes from the record's end, so that only these follow the header.
        for behind in 0..4 {
            let mut changed = bytes.clone();
            let long = u32::try_from(length - 16 - 4 - 4 - 8 - behind).expect("it is short");
            changed[name - 4..name].copy_from_slice(&long.to_le_bytes());
            let media = name + long as usize;
            changed[media..media + 4].copy_from_slice(&[0; 4]);
            fs::write(&path, &changed).expect("it can be written");
            let out = folder.0.join(format!("out-{behind}.mcap"));
            let found = recover(&path, Some(&out)).expect("it begins like a bag");
            assert!(!found.was_whole, "{behind}");
        }
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
