//! Whom the DDS library refuses: it says so in its log alone.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

use log::{LevelFilter, Log, Metadata, Record};

/// Most refusals that are recorded: a flood of them must not fill the memory.
const MOST: usize = 1000;

/// The part of the library that decides who may take part.
const DECIDES: &str = "rustdds::discovery::secure_discovery";

/// What the library says of a refused peer (rustdds 0.15.1); its other warnings are also about peers that are let in.
const REFUSALS: [&str; 6] = [
    "not matching with it",
    "Rejecting",
    "Failed to validate the identity",
    "handshake request failed",
    "handshake reply message failed",
    "final handshake message failed",
];

/// Refusals that are not recorded yet, and all that were ever seen.
static REFUSED: Mutex<(Vec<String>, BTreeSet<String>)> = Mutex::new((Vec::new(), BTreeSet::new()));

/// What the library has refused since the last call, each once.
pub fn refusals() -> Vec<String> {
    let mut refused = REFUSED.lock().unwrap_or_else(PoisonError::into_inner);
    std::mem::take(&mut refused.0)
}

/// Starts the log of this program, and listens to that of the library.
pub fn start_log(environment: env_logger::Env<'_>) {
    let shown = env_logger::Builder::from_env(environment).build();
    let level = shown.filter().max(LevelFilter::Info);
    if log::set_boxed_logger(Box::new(Listener(shown))).is_ok() {
        log::set_max_level(level);
    }
}

struct Listener(env_logger::Logger);

impl Log for Listener {
    fn enabled(&self, _: &Metadata<'_>) -> bool {
        true
    }

    fn log(&self, record: &Record<'_>) {
        let decides = record.target().starts_with(DECIDES);
        let text = if decides {
            record.args().to_string()
        } else {
            String::new()
        };
        if is_refusal(&text) {
            let mut refused = REFUSED.lock().unwrap_or_else(PoisonError::into_inner);
            if refused.1.len() < MOST && refused.1.insert(text.clone()) {
                refused.0.push(text);
            }
        }
        self.0.log(record);
    }

    fn flush(&self) {
        self.0.flush();
    }
}

/// Whether the library says that somebody may not take part.
fn is_refusal(text: &str) -> bool {
    REFUSALS.iter().any(|words| text.contains(words))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_is_no_other_message_of_the_library() {
        assert!(is_refusal(
            "Remote participant has incompatible Security, not matching with it. Remote guid: GUID {}"
        ));
        assert!(!is_refusal(
            "Failed to set remote writer GUID {} crypto tokens. Storing them & trying again later."
        ));
        assert!(!is_refusal(""));
    }
}
