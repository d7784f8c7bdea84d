//! `dvi store`: inspection and repair of the store of a service, from outside.

use super::UNREADABLE;
use clap::{Args, Subcommand};
use dvi::service::jobs::{Inspection, Salvaged, is_sound, repair};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::{self, ExitCode};
use std::thread;

/// Check or repair the jobs and results that a service keeps on the disk
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

/// Report by the exit code whether the pages of a store are intact, for a service before it opens the store
#[derive(Args)]
struct Examine {
    #[command(flatten)]
    attended: Attended,

    /// The folder of the service
    path: PathBuf,
}

#[derive(Args)]
struct Attended {
    /// End with standard input, for a service that starts this process and may be killed
    #[arg(long, hide = true)]
    attended: bool,
}

impl Attended {
    /// Ends the process when its standard input ends, if `--attended` is given.
    fn attend(&self) {
        if self.attended {
            thread::spawn(|| {
                // Nothing is ever written to this standard input: it ends, or it cannot be read.
                let _ = io::copy(&mut io::stdin().lock(), &mut io::sink());
                process::exit(UNREADABLE.into());
            });
        }
    }
}

/// Read every job and every result of a store, and list the damaged ones
///
/// Nothing is changed, so that a copy may be read-only. The store of a running service cannot be checked: check a copy.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
struct Check {
    /// The folder of the service, or a copy of it
    path: PathBuf,
}

const HELP: &str = "\
Exit codes:
  0   nothing is damaged
  1   something is damaged: each job is listed with its damaged parts
  3   the store is absent, in use, or of a later version
  64  the command line is invalid

Examples:
  dvi store check /var/lib/dvi
  dvi store check /backup/dvi && echo intact";

/// Rebuild the database of a store from its readable entries, if a page is damaged
///
/// A service does the same when it meets a damaged page. The new database has every row, specification and result that
/// is intact; the damaged file is kept beside it, and files of results stay in place. An intact store is not changed.
#[derive(Args)]
#[command(after_help = REPAIR_HELP, verbatim_doc_comment)]
struct Repair {
    #[command(flatten)]
    attended: Attended,

    /// The folder of the service, which must not be running
    path: PathBuf,
}

const REPAIR_HELP: &str = "\
Exit codes:
  0   nothing was damaged, or everything was repaired
  1   something is lost: each job is listed with its lost parts
  3   the store is absent, in use, of another version, or cannot be read at all
  64  the command line is invalid

Examples:
  systemctl stop dvi && dvi store repair /var/lib/dvi";

/// Exit code: a part of the store is damaged or lost.
const DAMAGED: u8 = 1;

/// Runs the chosen action of `dvi store`; returns the exit code.
pub fn run(arguments: &Arguments) -> ExitCode {
    match &arguments.action {
        Action::Check(Check { path }) => check(path),
        Action::Repair(Repair { attended, path }) => {
            attended.attend();
            mend(path)
        }
        Action::Examine(Examine { attended, path }) => {
            attended.attend();
            if is_sound(path) { ExitCode::SUCCESS } else { ExitCode::from(DAMAGED) }
        }
    }
}

fn check(path: &Path) -> ExitCode {
    match Inspection::of(path) {
        Ok(found) => {
            // A write error on a closed standard output is ignored.
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
            println!("{}: intact, not changed", path.display());
            ExitCode::SUCCESS
        }
        Ok(Some(salvaged)) => {
            let is_whole = Inspection::of(path).is_ok_and(|found| found.is_whole());
            // A write error on a closed standard output is ignored.
            let _ = tell_repair(path, &salvaged, &mut io::stdout());
            if is_whole && salvaged.lost.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(DAMAGED) }
        }
        Err(error) => {
            eprintln!("dvi: cannot repair {}: {error}", path.display());
            if error.kind() == io::ErrorKind::InvalidData {
                eprintln!(
                    "Nothing of jobs.redb can be read. Restore a copy of it; or move it away: then the service starts \
                     without jobs and moves the files of `results` to `results.orphaned`."
                );
            }
            ExitCode::from(UNREADABLE)
        }
    }
}

fn tell_repair(path: &Path, salvaged: &Salvaged, out: &mut impl Write) -> io::Result<()> {
    let Salvaged { jobs, lost, aside, .. } = salvaged;
    writeln!(out, "{}: rebuilt with {jobs} jobs; {} of them have lost parts", path.display(), lost.len())?;
    writeln!(out, "  the damaged file is {}", aside.display())?;
    for (id, what) in lost {
        writeln!(out, "lost: {id}: {}", what.join(", "))?;
    }
    Ok(())
}

fn tell(path: &Path, found: &Inspection, out: &mut impl Write) -> io::Result<()> {
    let Inspection { format, jobs, ended, results, result_bytes, damaged, unreadable, lost, orphaned, is_sound } =
        found;
    let word = if found.is_whole() { "intact" } else { "damaged" };
    writeln!(out, "{}: {word}", path.display())?;
    let unsealed = if *format < 2 { ", without digests: all readable entries count as intact" } else { "" };
    writeln!(out, "  format      {format}{unsealed}")?;
    writeln!(out, "  jobs        {jobs}, of which {ended} have ended")?;
    writeln!(out, "  results     {results}, {result_bytes} bytes")?;
    writeln!(out, "  damaged     {}", damaged.len())?;
    writeln!(out, "  unreadable  {}, of another version", unreadable.len())?;
    writeln!(out, "  orphaned    {orphaned} files without a job")?;
    writeln!(out, "  pages       {}", if *is_sound { "intact" } else { "some are damaged" })?;
    for (id, what) in damaged {
        writeln!(out, "damaged: {id}: {}", what.join(", "))?;
    }
    for id in lost {
        writeln!(out, "lost: {id}: row, when the database was rebuilt")?;
    }
    for id in unreadable {
        writeln!(out, "unreadable: {id}")?;
    }
    Ok(())
}
