//! The threads that a computation was asked to take.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};

/// As many threads as were asked for, or one for each core.
pub(crate) struct Threads {
    pub(crate) count: usize,
    /// `None` for rayon's own pool.
    pool: Option<Arc<ThreadPool>>,
}

impl Threads {
    /// # Errors
    /// [`Error::Invalid`] for no thread or too many.
    pub(crate) fn new(asked: Option<usize>) -> Result<Self> {
        Ok(Self {
            count: asked.unwrap_or_else(rayon::current_num_threads),
            pool: asked.map(pool).transpose()?,
        })
    }

    /// Does the work for each piece.
    ///
    /// A single thread or piece is this thread's: to wake another takes as long as a small batch, and a hundred times
    /// longer on a busy machine.
    pub(crate) fn each<T: Send>(&self, pieces: Vec<T>, work: impl Fn(T) + Send + Sync) {
        if self.count == 1 || pieces.len() < 2 {
            pieces.into_iter().for_each(work);
        } else if let Some(pool) = &self.pool {
            pool.install(|| pieces.into_par_iter().for_each(work));
        } else {
            pieces.into_par_iter().for_each(work);
        }
    }
}

/// The pool of that many threads; kept, since starting one takes longer than a small batch.
fn pool(threads: usize) -> Result<Arc<ThreadPool>> {
    static POOLS: OnceLock<Mutex<HashMap<usize, Arc<ThreadPool>>>> = OnceLock::new();
    if threads == 0 || threads > 1024 {
        return Err(Error::invalid("threads", "1 to 1024", threads));
    }
    let pools = POOLS.get_or_init(Mutex::default);
    let mut pools = pools.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(pool) = pools.get(&threads) {
        return Ok(Arc::clone(pool));
    }
    let pool = ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| Error::invalid("threads", "as many as the system can start", error))?;
    let pool = Arc::new(pool);
    pools.insert(threads, Arc::clone(&pool));
    Ok(pool)
}
