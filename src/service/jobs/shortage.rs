//! Whether the system has run out of memory: how many processes it has ended for that since it started (`oom_kill` in
//! `/proc/vmstat`). What is ended from outside where it has not, was ended by somebody, and not for what it did.

use std::fs;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The length of the name of a start of the system.
const NAME: usize = 36;

/// How many processes a system has ended for want of memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Taken {
    /// The name of the start of that system.
    boot: String,
    count: u64,
}

impl Taken {
    /// Up to now; nothing where the system does not say.
    pub fn now() -> Option<Self> {
        let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id").ok()?.trim_end().to_owned();
        let figures = fs::read_to_string("/proc/vmstat").ok()?;
        let count = figures.lines().find_map(|line| line.strip_prefix("oom_kill ")?.parse().ok())?;
        (boot.len() == NAME).then_some(Self { boot, count })
    }

    /// How many more it has ended since `earlier`, as far as that is known.
    pub fn since(&self, earlier: &Self) -> u64 {
        if self.boot == earlier.boot { self.count.saturating_sub(earlier.count) } else { 0 }
    }

    /// A line of at most 68 bytes.
    pub fn line(&self) -> String {
        format!("boot {} ended {}", self.boot, self.count)
    }

    /// What such a line says.
    pub fn read(line: &str) -> Option<Self> {
        let (boot, count) = line.strip_prefix("boot ")?.split_once(" ended ")?;
        Some(Self { boot: boot.to_owned(), count: count.trim().parse().ok()? })
    }
}

/// What this process knows of it.
#[derive(Debug)]
pub struct Shortage(Mutex<Known>);

#[derive(Debug)]
struct Known {
    /// Of these it is said what they were, or they are none of ours.
    accounted: Option<Taken>,
    /// At the latest look.
    seen: Option<Taken>,
}

impl Default for Shortage {
    fn default() -> Self {
        let now = Taken::now();
        Self(Mutex::new(Known { accounted: now.clone(), seen: now }))
    }
}

impl Shortage {
    /// Whether the system has ended a process for want of memory of which this has not been said yet, once for each; and
    /// up to where it has been said.
    pub fn account(&self) -> (bool, Option<Taken>) {
        let mut known = self.lock();
        let Some((taken, now)) = known.accounted.as_mut().zip(Taken::now()) else { return (false, None) };
        let is_short = now.since(taken) > 0;
        taken.count += u64::from(is_short);
        (is_short, known.accounted.clone())
    }

    /// Looks how many there are, and takes those that there were at the look before for accounted: what was ours among them
    /// has been met since. Says up to where that is, if it has changed.
    pub fn look(&self) -> Option<Taken> {
        let mut known = self.lock();
        let seen = std::mem::replace(&mut known.seen, Taken::now());
        let is_news = seen.as_ref().zip(known.accounted.as_ref()).is_some_and(|(seen, known)| seen.since(known) > 0);
        if is_news {
            known.accounted = seen;
        }
        known.accounted.clone().filter(|_| is_news)
    }

    fn lock(&self) -> MutexGuard<'_, Known> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_read_back_and_starts_of_the_system_are_told_apart() {
        let boot = "11bdae12-ae9f-4f3d-b7b9-7b70b0f6c9ab".to_owned();
        let taken = Taken { boot: boot.clone(), count: 7 };
        assert_eq!(Taken::read(&taken.line()), Some(taken.clone()));
        assert_eq!(Taken::read(&format!("{boot}\n")), None);
        let later = Taken { count: 9, ..taken.clone() };
        assert_eq!((later.since(&taken), taken.since(&later)), (2, 0));
        assert_eq!(later.since(&Taken { boot: boot.replace("11", "22"), count: 7 }), 0);
    }
}
