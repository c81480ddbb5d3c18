//! Long computations without the GIL that Ctrl-C can stop.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;

use crate::errors;

/// Interval at which Python is asked for signals.
const PATIENCE: Duration = Duration::from_millis(50);

/// Runs brief `work` without the GIL in this thread, and Ctrl-C waits for it: to start another takes as long as a small
/// batch, and far longer on a busy machine.
pub(crate) fn brief<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> labsim::Result<T> + Send,
) -> PyResult<T> {
    py.detach(|| work(&AtomicBool::new(false)).map_err(errors::to_python))
}

/// Runs `work` without the GIL; on Ctrl-C sets its flag, waits for it and raises `KeyboardInterrupt`.
#[expect(
    clippy::redundant_closure_for_method_calls,
    reason = "`Python::check_signals` is of one lifetime, `attach` asks for any"
)]
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> labsim::Result<T> + Send,
) -> PyResult<T> {
    let cancel = &AtomicBool::new(false);
    py.detach(|| {
        thread::scope(|scope| {
            let (done, waiting) = sync_channel(1);
            let worker = scope.spawn(move || {
                let result = work(cancel);
                // The receiver lives until this thread has ended.
                let _ = done.send(());
                result
            });
            while waiting.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout) {
                if let Err(signal) = Python::attach(|py| py.check_signals()) {
                    cancel.store(true, Ordering::Relaxed);
                    let _ = worker.join();
                    return Err(signal);
                }
            }
            match worker.join() {
                Ok(result) => result.map_err(errors::to_python),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        })
    })
}
