//! `dvi completions`: completion of the command line by a shell.

use clap::{Args, Command};
use clap_complete::{Shell, generate};
use std::io;
use std::process::ExitCode;

/// Write completions for a shell
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    /// The shell
    shell: Shell,
}

const HELP: &str = "\
Examples:
  dvi completions bash > ~/.local/share/bash-completion/completions/dvi
  dvi completions zsh > ~/.zfunc/_dvi                 with fpath+=~/.zfunc before compinit
  dvi completions fish > ~/.config/fish/completions/dvi.fish";

/// Runs `dvi completions`: writes the completion script for a shell to standard output; returns the exit code.
pub fn run(arguments: &Arguments, mut program: Command) -> ExitCode {
    let mut text = Vec::new();
    generate(arguments.shell, &mut program, "dvi", &mut text);
    // A write error on a closed standard output is ignored.
    let _ = io::Write::write_all(&mut io::stdout(), &text);
    ExitCode::SUCCESS
}
