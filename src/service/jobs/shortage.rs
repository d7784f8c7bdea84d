//! Detection of a memory shortage by the number of processes that the kernel has killed for lack of memory since it
//! booted (`oom_kill` in `/proc/vmstat`). If a process is killed while this number stays, something else has killed
//! it, and the kill is no evidence against its job.

use std::fs;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The length of the boot id of a Linux system, in characters.
const NAME: usize = 36;

/// The number of processes that the kernel has killed for lack of memory since it booted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Taken {
    /// The id of the boot of the system, at which the count of kills began at zero.
    boot: String,
    count: u64,
}

impl Taken {
    /// Returns the current count of kills for lack of memory; `None` if the system does not report it.
    pub fn now() -> Option<Self> {
        let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id").ok()?.trim_end().to_owned();
        let figures = fs::read_to_string("/proc/vmstat").ok()?;
        let count = figures.lines().find_map(|line| line.strip_prefix("oom_kill ")?.parse().ok())?;
        (boot.len() == NAME).then_some(Self { boot, count })
    }

    /// Returns the number of kills for lack of memory since `earlier`; zero if the system has rebooted in between.
    pub fn since(&self, earlier: &Self) -> u64 {
        if self.boot == earlier.boot { self.count.saturating_sub(earlier.count) } else { 0 }
    }

    /// Returns the count of kills for lack of memory, with the boot id, as a line of at most 68 bytes.
    pub fn line(&self) -> String {
        format!("boot {} ended {}", self.boot, self.count)
    }

    /// Parses a count of kills for lack of memory from a line written by [`Taken::line`].
    pub fn read(line: &str) -> Option<Self> {
        let (boot, count) = line.strip_prefix("boot ")?.split_once(" ended ")?;
        Some(Self { boot: boot.to_owned(), count: count.trim().parse().ok()? })
    }
}

/// The kills for lack of memory that this process has attributed to a cause.
#[derive(Debug)]
pub struct Shortage(Mutex<Known>);

#[derive(Debug)]
struct Known {
    /// The count up to which kills for lack of memory are attributed: to workers of this service, or to processes of
    /// others.
    accounted: Option<Taken>,
    /// The count of kills for lack of memory at the latest call of [`Shortage::look`].
    seen: Option<Taken>,
}

impl Default for Shortage {
    fn default() -> Self {
        let now = Taken::now();
        Self(Mutex::new(Known { accounted: now.clone(), seen: now }))
    }
}

impl Shortage {
    /// Returns whether the kernel has killed a process for lack of memory that is not attributed yet, and attributes
    /// one such kill; also returns the attributed count.
    pub fn account(&self) -> (bool, Option<Taken>) {
        let mut known = self.lock();
        let Some((taken, now)) = known.accounted.as_mut().zip(Taken::now()) else { return (false, None) };
        let is_short = now.since(taken) > 0;
        taken.count += u64::from(is_short);
        (is_short, known.accounted.clone())
    }

    /// Reads the count of kills for lack of memory, and treats the kills up to the previous reading as attributed,
    /// since the loss of a worker among them has been noticed meanwhile. Returns the attributed count if it has
    /// changed.
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
