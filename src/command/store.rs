//! `dvi store`: inspection and repair of the store of a service, from outside.

use super::UNREADABLE;
use clap::{Args, Subcommand};
use dvi::service::jobs::{Inspection, Salvaged, is_sound, repair};
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
    Repair(Repair),
    #[command(hide = true)]
    Examine(Examine),
}

/// Tell by the exit code whether the pages of a store are sound, as a service asks before it opens one
#[derive(Args)]
struct Examine {
    /// The folder of the service
    path: PathBuf,
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

/// Build the database of a store anew from what can be read, where a page of it is damaged
///
/// A service does the same by itself when such a page is in its way. Every row, specification and result that is as it was
/// written is in the new file; the damaged one stays beside it, and files of results stay where they are. A store that is
/// whole is left alone.
#[derive(Args)]
#[command(after_help = REPAIR_HELP, verbatim_doc_comment)]
struct Repair {
    /// The folder of the service, which is not running
    path: PathBuf,
}

const REPAIR_HELP: &str = "\
Exit codes:
  0   nothing was damaged, or all that was is mended
  1   something is lost: each job is named, with what of it
  3   the store is absent, in use, of another version, or cannot be read at all
  64  the command line makes no sense

Examples:
  systemctl stop dvi && dvi store repair /var/lib/dvi";

/// Something is damaged.
const DAMAGED: u8 = 1;

/// Runs the action; returns the exit code.
pub fn run(arguments: &Arguments) -> ExitCode {
    match &arguments.action {
        Action::Check(Check { path }) => check(path),
        Action::Repair(Repair { path }) => mend(path),
        Action::Examine(Examine { path }) if is_sound(path) => ExitCode::SUCCESS,
        Action::Examine(_) => ExitCode::from(DAMAGED),
    }
}

fn check(path: &Path) -> ExitCode {
    match Inspection::of(path) {
        Ok(found) => {
            // A closed standard output is ignored.
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

fn mend(path: &Path) -> ExitCode {
    match repair(path) {
        Ok(None) => {
            println!("{}: whole, and left as it is", path.display());
            ExitCode::SUCCESS
        }
        Ok(Some(salvaged)) => {
            let is_whole = Inspection::of(path).is_ok_and(|found| found.is_whole());
            // A closed standard output is ignored.
            let _ = tell_repair(path, &salvaged, &mut io::stdout());
            if is_whole && salvaged.lost.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(DAMAGED) }
        }
        Err(error) => {
            eprintln!("dvi: cannot repair {}: {error}", path.display());
            if error.kind() == io::ErrorKind::InvalidData {
                eprintln!(
                    "Nothing of jobs.redb can be read. Put back a copy of it; or move it away, and the service starts \
                     with no jobs and keeps what is in results in results.orphaned."
                );
            }
            ExitCode::from(UNREADABLE)
        }
    }
}

fn tell_repair(path: &Path, salvaged: &Salvaged, out: &mut impl Write) -> io::Result<()> {
    let Salvaged { jobs, lost, aside, .. } = salvaged;
    writeln!(out, "{}: built anew with {jobs} jobs; {} have lost something", path.display(), lost.len())?;
    writeln!(out, "  the damaged file is {}", aside.display())?;
    for (id, what) in lost {
        writeln!(out, "lost: {id}: {}", what.join(", "))?;
    }
    Ok(())
}

fn tell(path: &Path, found: &Inspection, out: &mut impl Write) -> io::Result<()> {
    let Inspection { format, jobs, ended, results, result_bytes, damaged, unreadable, lost, orphaned, is_sound } =
        found;
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
    for id in lost {
        writeln!(out, "lost: {id}: row, when the database was built anew")?;
    }
    for id in unreadable {
        writeln!(out, "unreadable: {id}")?;
    }
    Ok(())
}
