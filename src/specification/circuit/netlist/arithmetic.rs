//! Constant expressions of a netlist, in braces or quotes: `{2*pi*f}`, `'r1 + 4.7k'`. Numbers take the suffixes of
//! [`value`](super::value); names are defined by `.param`.

use super::value::scaled;
use std::collections::HashMap;
use std::f64::consts::{E, PI};

/// Values of the parameters defined by `.param`, by name in lower case.
pub(super) type Scope = HashMap<String, f64>;

/// Maximum nesting depth of brackets, signs and powers in a constant expression of a netlist.
const DEEPEST: usize = 64;

/// Evaluates an expression.
///
/// # Errors
/// The first fault of the expression, in words.
pub(super) fn evaluate(text: &str, scope: &Scope) -> Result<f64, String> {
    let mut parser = Parser { rest: text.trim_start(), scope, depth: 0 };
    let value = parser.sum()?;
    match parser.rest.chars().next() {
        Some(other) => Err(format!("`{other}` is not understood in an expression")),
        None if value.is_finite() => Ok(value),
        None => Err("the value is not finite".to_owned()),
    }
}

struct Parser<'t> {
    rest: &'t str,
    scope: &'t Scope,
    depth: usize,
}

impl<'t> Parser<'t> {
    /// Consumes a symbol and the blanks after it, if the rest of the expression begins with the symbol.
    fn takes(&mut self, symbol: &str) -> bool {
        let Some(rest) = self.rest.strip_prefix(symbol) else { return false };
        self.rest = rest.trim_start();
        true
    }

    /// Consumes the longest prefix of the rest of the expression whose characters satisfy `is`.
    fn while_is(&mut self, is: impl Fn(char) -> bool) -> &'t str {
        let end = self.rest.find(|c| !is(c)).unwrap_or(self.rest.len());
        let (taken, rest) = self.rest.split_at(end);
        self.rest = rest;
        taken
    }

    fn sum(&mut self) -> Result<f64, String> {
        let mut value = self.product()?;
        loop {
            value = match () {
                () if self.takes("+") => value + self.product()?,
                () if self.takes("-") => value - self.product()?,
                () => return Ok(value),
            };
        }
    }

    fn product(&mut self) -> Result<f64, String> {
        let mut value = self.signed()?;
        loop {
            value = match () {
                () if self.takes("*") => value * self.signed()?,
                () if self.takes("/") => value / self.signed()?,
                () => return Ok(value),
            };
        }
    }

    fn signed(&mut self) -> Result<f64, String> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(format!("the expression is more than {DEEPEST} levels deep"));
        }
        let value = match () {
            () if self.takes("-") => -self.signed()?,
            () if self.takes("+") => self.signed()?,
            () => self.power()?,
        };
        self.depth -= 1;
        Ok(value)
    }

    fn power(&mut self) -> Result<f64, String> {
        let base = self.atom()?;
        // `**` is a power; a single `*` is consumed by the function `product`, which reads products.
        Ok(if self.takes("**") || self.takes("^") { base.powf(self.signed()?) } else { base })
    }

    fn atom(&mut self) -> Result<f64, String> {
        if self.takes("(") {
            let value = self.sum()?;
            return if self.takes(")") { Ok(value) } else { Err("`)` is missing".to_owned()) };
        }
        match self.rest.chars().next() {
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_alphabetic() || c == '_' => self.name(),
            Some(c) => Err(format!("found `{c}` where a value is expected")),
            None => Err("a value is missing at the end".to_owned()),
        }
    }

    fn number(&mut self) -> Result<f64, String> {
        let start = self.rest;
        self.while_is(|c| c.is_ascii_digit() || c == '.');
        let tail = self.rest.strip_prefix(['e', 'E']).map(|tail| tail.strip_prefix(['+', '-']).unwrap_or(tail));
        if let Some(tail) = tail.filter(|tail| tail.starts_with(|c: char| c.is_ascii_digit())) {
            self.rest = tail;
            self.while_is(|c| c.is_ascii_digit());
        }
        let digits = &start[..start.len() - self.rest.len()];
        let letters = self.while_is(char::is_alphabetic);
        self.rest = self.rest.trim_start();
        let number: f64 = digits.parse().map_err(|_| format!("`{digits}` is not a number"))?;
        Ok(scaled(number, letters))
    }

    fn name(&mut self) -> Result<f64, String> {
        let name = self.while_is(|c| c.is_alphanumeric() || c == '_' || c == '.').to_lowercase();
        self.rest = self.rest.trim_start();
        if !self.takes("(") {
            let known = self.scope.get(&name).copied();
            return match (known, name.as_str()) {
                (Some(value), _) => Ok(value),
                (None, "pi") => Ok(PI),
                (None, "e") => Ok(E),
                (None, _) => Err(format!("there is no parameter `{name}`: define it by .param")),
            };
        }
        let mut arguments = vec![self.sum()?];
        while self.takes(",") {
            arguments.push(self.sum()?);
        }
        if !self.takes(")") {
            return Err("`)` is missing".to_owned());
        }
        Ok(match (name.as_str(), arguments.as_slice()) {
            ("sqrt", [x]) => x.sqrt(),
            ("abs", [x]) => x.abs(),
            ("exp", [x]) => x.exp(),
            ("ln" | "log", [x]) => x.ln(),
            ("log10", [x]) => x.log10(),
            ("sin", [x]) => x.sin(),
            ("cos", [x]) => x.cos(),
            ("tan", [x]) => x.tan(),
            ("atan" | "arctan", [x]) => x.atan(),
            ("int", [x]) => x.trunc(),
            ("floor", [x]) => x.floor(),
            ("ceil", [x]) => x.ceil(),
            ("min", [x, y]) => x.min(*y),
            ("max", [x, y]) => x.max(*y),
            ("pow" | "pwr", [x, y]) => x.powf(*y),
            _ => return Err(format!("there is no function `{name}` of {} values in a netlist", arguments.len())),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Result<f64, String> {
        evaluate(text, &Scope::from([("r".to_owned(), 100.0), ("f0".to_owned(), 50.0)]))
    }

    #[test]
    fn operators_bind_as_in_mathematics() {
        let known = [
            ("1+2*3", 7.0),
            ("(1+2)*3", 9.0),
            ("2**3**2", 512.0),
            ("-2^2", -4.0),
            ("2^-1", 0.5),
            ("10u*R", 1e-3),
            ("2*pi*f0", 100.0 * PI),
            ("8/4/2", 1.0),
            ("1-2-3", -4.0),
            (" max( 1k , 2 ) ", 1000.0),
            ("1e3", 1e3),
            ("1e-3", 1e-3),
            ("4.7kOhm", 4700.0),
            ("1Meg", 1e6),
            ("sqrt(r)", 10.0),
            ("--1", 1.0),
        ];
        for (text, value) in known {
            assert_eq!(of(text), Ok(value), "{text}");
        }
    }

    #[test]
    fn what_is_no_expression_is_refused_and_nothing_is_too_deep() {
        let deep = ["(".repeat(100_000), "-".repeat(100_000), "2^".repeat(100_000), "sin(".repeat(100_000)];
        let plain = ["", "1+", "(1", "1)", "x", "f(1)", "1 2", "1..2", "1/0", "1>2", "$", "max(1)", "\u{b5}"];
        for text in plain.iter().copied().chain(deep.iter().map(String::as_str)) {
            assert!(of(text).is_err(), "{text}");
        }
    }
}
