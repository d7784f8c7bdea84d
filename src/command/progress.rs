//! The progress of a long command: a bar on a terminal, one line per step elsewhere.

use std::io::{self, IsTerminal, Write};

/// Width of the progress bar, in characters.
const WIDTH: usize = 30;
/// The largest width of the name of a step of the command, in characters; a longer line would wrap on a terminal.
const NAME: usize = 40;

/// The progress of a long command: the number of its steps done, out of all steps.
pub struct Progress {
    done: usize,
    all: usize,
    terminal: bool,
}

impl Progress {
    /// Creates the progress of a command with `all` steps, none of them done.
    pub fn new(all: usize) -> Self {
        Self { done: 0, all, terminal: io::stderr().is_terminal() }
    }

    /// Reports that the next step of the command begins. A closed standard error is ignored.
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

    /// Clears the progress bar, if standard error is a terminal.
    pub fn end(&self) {
        if self.terminal {
            let _ = write!(io::stderr(), "\r\x1b[K");
        }
    }
}
