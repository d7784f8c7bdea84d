//! `dvi methods`: the choices of a specification, and the conditions of the theory for every method.

use clap::{Args, ValueEnum};
use dvi::radau::{Conditions, Vanishing};
use dvi::specification::{Catalogue, Choice, catalogue};
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::process::ExitCode;

/// List problem types, sets, methods, solvers and limits
///
/// Each Radau IIA method is listed with the conditions under which it converges with a variational
/// inequality at every stage, verified for its coefficients.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    /// The format of the list
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
}

/// A format of the list.
#[derive(Clone, Copy, ValueEnum)]
enum Format {
    /// Tables for people
    Text,
    /// All entries with the coefficients, as GET /methods returns them
    Json,
}

const HELP: &str = "\
Examples:
  dvi methods
  dvi methods --format json | less";

/// Runs `dvi methods`: prints the choices and the conditions of the methods; a closed standard output is ignored.
pub fn run(arguments: &Arguments) -> ExitCode {
    let text = match arguments.format {
        Format::Text => told(catalogue()),
        Format::Json => serde_json::to_string_pretty(catalogue()).unwrap_or_default() + "\n",
    };
    let _ = io::stdout().write_all(text.as_bytes());
    ExitCode::SUCCESS
}

const LEGEND: &str =
    "  Q = B A + A^T B - b b^T is the matrix of algebraic stability, D the diagonal b_i / c_i, alpha its coercivity,
  u^T D A^-1 u >= alpha u^T D u. Eigenvalues are the least; the number after +- bounds the rounding error.
";

fn told(catalogue: &Catalogue) -> String {
    let mut text = String::new();
    for (title, choices) in [
        ("Problems", &catalogue.problems),
        ("Sets", &catalogue.sets),
        ("Methods", &catalogue.methods),
        ("Switches", &catalogue.switches),
        ("Impacts", &catalogue.impacts),
        ("Laws of impact", &catalogue.impact_laws),
        ("Solvers of variational inequalities", &catalogue.vi_solvers),
    ] {
        list(&mut text, title, choices);
    }
    // Writing to a string cannot fail.
    let _ = writeln!(text, "Radau IIA, with the conditions verified\n");
    let heads = ["s", "step", "B(p)", "C(q)", "Q", "D A + A^T D", "alpha", "|a_s - b|", "|R(infinity)|"];
    let _ = writeln!(text, "{}", row(heads.map(str::to_owned)));
    for method in &catalogue.tableaux {
        let step = if method.adaptive { "any" } else { "fixed" };
        let _ = writeln!(text, "{}", row(figures(method.stages, step, &method.conditions)));
    }
    let _ = writeln!(text, "\n{LEGEND}\nLimits\n");
    for limit in &catalogue.limits {
        let _ = writeln!(text, "  {:<20}{:>12}  {}", limit.name, limit.value, limit.meaning);
    }
    text
}

fn list(text: &mut String, title: &str, choices: &[Choice]) {
    let _ = writeln!(text, "{title}\n");
    for choice in choices {
        let _ = writeln!(text, "  {:<20}{}", choice.name, choice.meaning);
    }
    text.push('\n');
}

fn row([s, step, b, c, q, d, alpha, a, r]: [String; 9]) -> String {
    format!("  {s:<3}{step:<7}{b:<6}{c:<6}{q:<21}{d:<21}{alpha:<8}{a:<19}{r}")
}

fn figures(s: usize, step: &str, found: &Conditions) -> [String; 9] {
    let zero = |number: &Vanishing| bounded(number.value, number.rounding);
    let none = || "none".to_owned();
    let (q, d) = (&found.algebraic_stability, found.positive_diagonal.as_ref());
    [
        s.to_string(),
        step.to_owned(),
        found.quadrature_order.order.to_string(),
        found.stage_order.order.to_string(),
        bounded(q.least_eigenvalue, q.rounding),
        d.map_or_else(none, |d| bounded(d.least_eigenvalue, d.rounding)),
        d.and_then(|d| d.coercivity).map_or_else(none, |alpha| format!("{alpha:.4}")),
        zero(&found.stiff_accuracy),
        found.damping.as_ref().map_or_else(none, zero),
    ]
}

fn bounded(value: f64, rounding: f64) -> String {
    format!("{value:.1e} +- {rounding:.0e}")
}
