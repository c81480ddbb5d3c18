//! Many marbles whose commands come one by one: what a controller learns on.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::live::Live;
use crate::rollout::pool;

/// Marbles that one thread plays at a time, at least: handing out fewer costs more than they take.
const SHARE: usize = 32;

/// Marbles on rigs of their own, which go on row by row together.
///
/// Each has the bits of a [`Live`] by itself, for any number of threads.
pub struct Fleet {
    marbles: Vec<Option<Live>>,
    threads: Option<usize>,
}

impl Fleet {
    /// Room for so many marbles, played by so many threads: by default one for each core.
    pub fn new(count: usize, threads: Option<usize>) -> Self {
        Self {
            marbles: (0..count).map(|_| None).collect(),
            threads,
        }
    }

    /// Puts a marble in a place, where another one may have been.
    ///
    /// # Errors
    /// [`Error::Invalid`] if there is no such place.
    pub fn put(&mut self, place: usize, marble: Live) -> Result<()> {
        let count = self.marbles.len();
        let Some(here) = self.marbles.get_mut(place) else {
            let places = format!("one of {count} places, counted from 0");
            return Err(Error::invalid("index", &places, place));
        };
        *here = Some(marble);
        Ok(())
    }

    /// Plays a row of each marble that is asked to, under its command (knob angles, rad).
    ///
    /// # Errors
    /// [`Error::Invalid`] if there are not as many commands as places, or a marble has no row left.
    pub fn play(&mut self, commands: &[[f64; 2]], is_asked: &[bool]) -> Result<()> {
        let count = self.marbles.len();
        if commands.len() != count || is_asked.len() != count {
            let found = commands.len().min(is_asked.len());
            let expected = format!("{count} of them");
            return Err(Error::invalid("commands", &expected, found));
        }
        let is_spent = |one: &Option<Live>| one.as_ref().is_none_or(|one| one.left() == 0);
        let mut each = self.marbles.iter().zip(is_asked);
        if each.any(|(one, &asked)| asked && is_spent(one)) {
            return Err(Error::invalid("rows", "a row that is left", 0));
        }
        let play = |((one, &command), &asked): ((&mut Option<Live>, &[f64; 2]), &bool)| {
            if let Some(one) = one
                && asked
            {
                one.play(command);
            }
        };
        match self.threads {
            Some(1) => {
                let each = self.marbles.iter_mut().zip(commands).zip(is_asked);
                each.for_each(play);
            }
            Some(threads) => {
                let each = self.marbles.par_iter_mut().zip(commands).zip(is_asked);
                pool(threads)?.install(|| each.with_min_len(SHARE).for_each(play));
            }
            None => {
                let each = self.marbles.par_iter_mut().zip(commands).zip(is_asked);
                each.with_min_len(SHARE).for_each(play);
            }
        }
        Ok(())
    }

    /// Where each marble is seen (board edges) as its present row begins; NaN where there is none.
    pub fn seen(&self) -> Vec<[f64; 2]> {
        let seen = |one: &Option<Live>| one.as_ref().map_or([f64::NAN; 2], Live::seen);
        self.marbles.iter().map(seen).collect()
    }

    /// What each tilt sensor reads (rad) as the present row begins; NaN where there is none.
    pub fn tilt(&self) -> Vec<[f64; 2]> {
        let tilt = |one: &Option<Live>| one.as_ref().map_or([f64::NAN; 2], Live::tilt);
        self.marbles.iter().map(tilt).collect()
    }
}
