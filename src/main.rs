//! The command line of the program `dvi`, with a module for each subcommand.

mod command;

use clap::{CommandFactory, Parser, Subcommand};
use command::{
    check, completions, explain, healthcheck, man, merge, methods, report, serve, solve, store, sweep, token, usage,
    worker,
};
use mimalloc::MiMalloc;
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// Solves differential variational inequalities, with evidence.
///
///   M x' = f(t,x) + B(t,x) z,   z in K,   <G(t,x,z), z~ - z> >= 0 for all z~ in K
#[derive(Parser)]
#[command(version, about, after_help = HELP, verbatim_doc_comment)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

const HELP: &str = "\
Examples:
  dvi solve api/examples/diode_bridge.json            solve, result as JSON
  dvi solve --format csv circuit.json > circuit.csv   solve, trajectory as a table
  dvi solve --format svg circuit.json > circuit.svg   solve, trajectory as a picture
  dvi sweep -o belts.csv belts.json                   solve for many values of parameters, on all cores
  dvi solve *.json                                    several files, each result beside its specification
  dvi check circuit.json                              find all errors without solving
  dvi explain unknown_key                             explain a code of an error or a warning
  dvi methods                                         list problem types, sets, methods, solvers and limits
  dvi report                                          error against run time of every system
  dvi serve                                           serve on http://127.0.0.1:8080
  curl -d @api/examples/diode_bridge.json localhost:8080/solve";

#[derive(Subcommand)]
enum Command {
    Solve(solve::Arguments),
    Sweep(sweep::Arguments),
    Merge(merge::Arguments),
    Check(check::Arguments),
    Explain(explain::Arguments),
    Methods(methods::Arguments),
    Report(report::Arguments),
    Serve(Box<serve::Arguments>),
    Worker(worker::Arguments),
    Store(store::Arguments),
    Token(token::Arguments),
    Completions(completions::Arguments),
    Man(man::Arguments),
    Healthcheck(healthcheck::Arguments),
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            let error = usage::with_tips(error, &Cli::command());
            // If standard output is closed, a failure to print the help or the error has nowhere to be reported.
            let _ = error.print();
            return if error.use_stderr() { ExitCode::from(command::USAGE) } else { ExitCode::SUCCESS };
        }
    };
    match cli.command {
        Command::Solve(arguments) => solve::run(&arguments),
        Command::Sweep(arguments) => sweep::run(&arguments),
        Command::Merge(arguments) => merge::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Explain(arguments) => explain::run(&arguments),
        Command::Methods(arguments) => methods::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Serve(arguments) => serve::run(*arguments),
        Command::Worker(arguments) => worker::run(arguments),
        Command::Store(arguments) => store::run(&arguments),
        Command::Token(arguments) => token::run(&arguments),
        Command::Completions(arguments) => completions::run(&arguments, Cli::command()),
        Command::Man(arguments) => man::run(&arguments, Cli::command()),
        Command::Healthcheck(arguments) => healthcheck::run(&arguments),
    }
}
