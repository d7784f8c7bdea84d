//! Tips for errors of the command line, where the parser does not say what to write instead.

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, Command, Error};
use std::env;

/// Adds tips to an error of the command line: the environment variable that the value came from, the least number, or
/// the form of an address.
pub fn with_tips(mut error: Error, command: &Command) -> Error {
    let tips = tips(&error, command);
    if !tips.is_empty() {
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(tips.into_iter().map(Into::into).collect()));
    }
    error
}

fn tips(error: &Error, command: &Command) -> Vec<String> {
    let Some(ContextValue::String(argument)) = error.get(ContextKind::InvalidArg) else { return Vec::new() };
    let name = argument.split([' ', '=']).next().unwrap_or(argument);
    if error.kind() == ErrorKind::UnknownArgument {
        let is_address = ["--port", "--bind", "--address"].contains(&name);
        return is_address
            .then(|| "'--listen' takes address and port, as in '--listen 127.0.0.1:9000'".to_owned())
            .into_iter()
            .collect();
    }
    let Some(ContextValue::String(value)) = error.get(ContextKind::InvalidValue) else { return Vec::new() };
    let mut tips = Vec::new();
    if name == "--listen" {
        let port = value.trim_start_matches(':').parse().unwrap_or(8080_u16);
        tips.push(format!("an address and a port are expected, as in '--listen 127.0.0.1:{port}'"));
    } else if value == "0" {
        tips.push("the least value is 1".to_owned());
    }
    if let Some(variable) = variable(name, command).filter(|_| !is_written(name)) {
        tips.push(format!("the value comes from the environment variable {variable}"));
    }
    tips
}

/// Returns the name of the environment variable of a flag, if the variable is set.
fn variable(flag: &str, command: &Command) -> Option<String> {
    let is_flag = |argument: &&Arg| argument.get_long().is_some_and(|long| flag.strip_prefix("--") == Some(long));
    let arguments = command.get_subcommands().flat_map(Command::get_arguments).chain(command.get_arguments());
    let variable = arguments.filter(is_flag).find_map(Arg::get_env)?;
    env::var_os(variable).map(|_| variable.to_string_lossy().into_owned())
}

/// Whether a flag was given on the command line of this process.
fn is_written(flag: &str) -> bool {
    env::args().any(|argument| argument.split('=').next() == Some(flag))
}
