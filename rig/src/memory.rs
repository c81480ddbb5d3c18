//! The memory of this process: DDS keeps what peers send, and a flood must not take all that the machine has.

use std::fs;

/// Memory that this process holds (MB), where the system says it.
pub fn resident_mb() -> Option<f64> {
    in_status(&fs::read_to_string("/proc/self/status").ok()?)
}

fn in_status(text: &str) -> Option<f64> {
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: f64 = line.trim().strip_suffix("kB")?.trim_end().parse().ok()?;
    Some(kilobytes / 1024.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_systems_figure_is_read() {
        let text = "Name:\trig\nVmHWM:\t   99999 kB\nVmRSS:\t   20480 kB\nThreads:\t9\n";
        assert_eq!(in_status(text), Some(20.0));
        assert_eq!(in_status("Name:\trig\n"), None);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn memory_that_is_taken_is_seen() {
        let before = resident_mb().expect("Linux says it");
        // The optimiser would leave out what nothing reads.
        let taken = std::hint::black_box(vec![1_u8; 64 << 20]);
        let after = resident_mb().expect("Linux says it");
        assert!(after - before > 60.0, "{before} {after} {}", taken.len());
        std::hint::black_box(taken);
    }
}
