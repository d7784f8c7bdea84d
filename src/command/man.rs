//! `dvi man`: manual pages with the texts of `--help`.

use super::{UNWRITABLE, USAGE};
use clap::{Args, Command};
use clap_mangen::{Man, generate_to};
use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

/// Write a manual page
///
/// Without a subcommand, write the page of the program.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    /// The subcommand whose page is written
    #[arg(conflicts_with = "folder")]
    subcommand: Option<String>,

    /// Write all pages (dvi.1, dvi-solve.1, ...) to this folder
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,
}

const HELP: &str = "\
Examples:
  dvi man | man -l -
  dvi man solve | man -l -
  dvi man --folder ~/.local/share/man/man1";

/// Runs `dvi man`: writes one page to standard output, or all pages to a folder; returns the exit code.
pub fn run(arguments: &Arguments, mut program: Command) -> ExitCode {
    if let Some(folder) = &arguments.folder {
        let written = std::fs::create_dir_all(folder).and_then(|()| generate_to(program, folder));
        return finished(
            written.map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", folder.display()))),
        );
    }
    program.build();
    let page = match &arguments.subcommand {
        None => program,
        Some(name) => match program.find_subcommand(name) {
            Some(found) => found.clone(),
            None => {
                eprintln!("dvi: there is no subcommand `{name}`: `dvi --help` lists all subcommands");
                return ExitCode::from(USAGE);
            }
        },
    };
    let mut text = Vec::new();
    finished(Man::new(page).render(&mut text).and_then(|()| io::stdout().write_all(&text)))
}

fn finished(written: io::Result<()>) -> ExitCode {
    match written {
        // A broken pipe is not reported: the reader of the page, such as a pager, has closed its end early.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            eprintln!("dvi: cannot write the page: {error}");
            ExitCode::from(UNWRITABLE)
        }
        _ => ExitCode::SUCCESS,
    }
}
