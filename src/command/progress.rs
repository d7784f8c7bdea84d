//! How far a long command is: a bar on a terminal, a line for each step elsewhere.

use std::io::{self, IsTerminal, Write};

/// Characters of the bar.
const WIDTH: usize = 30;
/// Characters of what runs; a longer line would wrap.
const NAME: usize = 40;

/// So many of so many steps.
pub struct Progress {
    done: usize,
    all: usize,
    terminal: bool,
}

impl Progress {
    /// Nothing done yet of `all` steps.
    pub fn new(all: usize) -> Self {
        Self { done: 0, all, terminal: io::stderr().is_terminal() }
    }

    /// Says that the next step begins. Standard error that is closed is no reason to stop.
    pub fn next(&mut self, name: &str) {
        let mut to = io::stderr().lock();
        let _ = if self.terminal {
            let full = WIDTH * self.done / self.all.max(1);
            write!(
                to,
                "\r[{:█<full$}{:·<rest$}] {:>2}/{} {name:.NAME$}\x1b[K",
                "",
                "",
                self.done,
                self.all,
                rest = WIDTH - full
            )
        } else {
            writeln!(to, "[{:>2}/{}] {name}", self.done + 1, self.all)
        };
        let _ = to.flush();
        self.done = (self.done + 1).min(self.all);
    }

    /// Clears the bar.
    pub fn end(&self) {
        if self.terminal {
            let _ = write!(io::stderr(), "\r\x1b[K");
        }
    }
}
