//! `dvi completions`: what a shell completes of the command line.

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

/// Writes them to standard output.
pub fn run(arguments: &Arguments, mut program: Command) -> ExitCode {
    let mut text = Vec::new();
    generate(arguments.shell, &mut program, "dvi", &mut text);
    // A closed standard output wants no completions.
    let _ = io::Write::write_all(&mut io::stdout(), &text);
    ExitCode::SUCCESS
}
