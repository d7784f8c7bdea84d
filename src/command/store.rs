//! `dvi store`: what a service keeps on the disk, looked at from outside.

use super::UNREADABLE;
use clap::{Args, Subcommand};
use dvi::service::jobs::Inspection;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Check what a service keeps on the disk
#[derive(Args)]
pub struct Arguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    Check(Check),
}

/// Read every job and every result of a store, and tell which are not as they were written
///
/// Nothing is changed, so that a copy may be read-only. The store of a service that runs is left alone: check a copy.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
struct Check {
    /// The folder of the service, or a copy of it
    path: PathBuf,
}

const HELP: &str = "\
Exit codes:
  0   all is as it was written
  1   something is damaged: each job is named, with what of it
  3   the store is absent, in use, or of a later version
  64  the command line makes no sense

Examples:
  dvi store check /var/lib/dvi
  dvi store check /backup/dvi && echo whole";

/// Something is damaged.
const DAMAGED: u8 = 1;

/// Does what is asked; the exit code says how it went.
pub fn run(arguments: &Arguments) -> ExitCode {
    let Action::Check(Check { path }) = &arguments.action;
    match Inspection::of(path) {
        Ok(found) => {
            // A closed standard output wants no answer.
            let _ = tell(path, &found, &mut io::stdout());
            if found.is_whole() { ExitCode::SUCCESS } else { ExitCode::from(DAMAGED) }
        }
        Err(error) => {
            let copy = if error.kind() == io::ErrorKind::ResourceBusy { "; check a copy of it" } else { "" };
            eprintln!("dvi: cannot check {}: {error}{copy}", path.display());
            ExitCode::from(UNREADABLE)
        }
    }
}

fn tell(path: &Path, found: &Inspection, out: &mut impl Write) -> io::Result<()> {
    let Inspection { format, jobs, ended, results, result_bytes, damaged, unreadable, orphaned, is_sound } = found;
    let word = if found.is_whole() { "whole" } else { "damaged" };
    writeln!(out, "{}: {word}", path.display())?;
    let unsealed = if *format < 2 { ", which has no digests: what can be read counts as whole" } else { "" };
    writeln!(out, "  format      {format}{unsealed}")?;
    writeln!(out, "  jobs        {jobs}, of which {ended} have ended")?;
    writeln!(out, "  results     {results}, {result_bytes} bytes")?;
    writeln!(out, "  damaged     {}", damaged.len())?;
    writeln!(out, "  unreadable  {}, of another version", unreadable.len())?;
    writeln!(out, "  orphaned    {orphaned} files that no job names")?;
    writeln!(out, "  pages       {}", if *is_sound { "as they were written" } else { "not all as they were written" })?;
    for (id, what) in damaged {
        writeln!(out, "damaged: {id}: {}", what.join(", "))?;
    }
    for id in unreadable {
        writeln!(out, "unreadable: {id}")?;
    }
    Ok(())
}
