//! `dvi token`: the tokens that identify clients of the service.

use super::data::Data;
use super::{UNREADABLE, UNWRITABLE, USAGE};
use clap::{Args, Subcommand};
use dvi::service::access::{self, Scope};
use std::path::Path;
use std::process::ExitCode;
use std::{fs, io};

/// Create, list and revoke the tokens with which clients identify themselves to the service
///
/// A running service notices a change within a second.
#[derive(Args)]
#[command(after_help = HELP)]
pub struct Arguments {
    #[command(subcommand)]
    action: Action,

    #[command(flatten)]
    data: Data,
}

const HELP: &str = "\
Examples:
  dvi token create --name anna                    may submit and read
  dvi token create --name dashboard --scope read
  dvi token create --name guest --expires-days 7
  sudo dvi token create --name anna --data /var/lib/dvi     for a service of another user
  dvi token list
  dvi token revoke 0123456789abcdef

  curl -H \"Authorization: Bearer $TOKEN\" -d @api/examples/diode_bridge.json SERVER/solve

Exit codes:
  0   done
  1   there is no token with that number
  3   the tokens could not be read
  4   the tokens could not be written
  64  the command line is invalid";

#[derive(Subcommand)]
enum Action {
    /// Create a token and print it; it is not shown again
    Create {
        /// The owner of the token
        #[arg(long)]
        name: String,
        /// What the token allows; may be repeated
        #[arg(long = "scope", value_enum, default_values_t = [Scope::Submit, Scope::Read])]
        scopes: Vec<Scope>,
        /// Days until the token expires; without this it does not expire
        #[arg(long, value_name = "DAYS", value_parser = clap::value_parser!(u32).range(1..=36_500))]
        expires_days: Option<u32>,
    },
    /// List the tokens, without their secrets
    List,
    /// Revoke a token
    Revoke {
        /// The number of the token, its first part
        number: String,
    },
}

/// Exit code: there is no token with the given number.
const UNKNOWN: u8 = 1;

/// Runs the chosen action of `dvi token`; returns the exit code.
pub fn run(arguments: &Arguments) -> ExitCode {
    let Some(folder) = arguments.data.folder() else {
        eprintln!("dvi: there is no home directory to keep tokens in: give --data DIR");
        return ExitCode::from(USAGE);
    };
    let done = match &arguments.action {
        Action::Create { name, scopes, expires_days } => {
            let expires = expires_days.map(access::in_days);
            access::create(&folder, name, scopes, expires).map(|token| println!("{token}"))
        }
        Action::List => return list(&folder),
        Action::Revoke { number } => match access::revoke(&folder, number) {
            Ok(false) => {
                eprintln!("dvi: there is no token {number} in {}", folder.display());
                return ExitCode::from(UNKNOWN);
            }
            done => done.map(drop),
        },
    };
    told(&folder, done, UNWRITABLE)
}

fn list(folder: &Path) -> ExitCode {
    // A data folder that does not exist is more often a typing error than a folder yet to be created.
    let rows = fs::metadata(folder).and_then(|_| access::list(folder));
    let listed = rows.map(|rows| {
        if rows.is_empty() {
            eprintln!("dvi: {} has no tokens; dvi token create --name NAME creates one", folder.display());
        }
        for row in rows {
            let scopes: Vec<String> = row.scopes.iter().map(ToString::to_string).collect();
            let expires = row.expires.map_or("never ends".to_owned(), |expires| {
                format!("{} {expires:.0}", if row.has_expired() { "ended" } else { "ends" })
            });
            let (number, created, scopes, name) = (&row.number, row.created, scopes.join(","), &row.name);
            println!("{number}  {created:.0}  {expires:<25}  {scopes:<12}  {name}");
        }
    });
    told(folder, listed, UNREADABLE)
}

fn told(folder: &Path, done: io::Result<()>, code: u8) -> ExitCode {
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("dvi: the tokens of {}: {error}", folder.display());
            ExitCode::from(code)
        }
    }
}
