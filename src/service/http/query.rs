//! The query string of a request: parameters with values, each of which must be known and given only once.

use super::problem::{Kind, Problem};
use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use std::convert::Infallible;
use std::fmt::Display;
use std::str::FromStr;

/// The parameters of a query string; a request handler takes those that it knows.
pub struct Query {
    given: Vec<(String, String)>,
    known: Vec<&'static str>,
    wrong: Vec<String>,
}

impl Query {
    /// Takes the query parameter `name` as text, if it is given.
    pub fn text(&mut self, name: &'static str) -> Option<String> {
        self.known.push(name);
        let index = self.given.iter().position(|(given, _)| given == name)?;
        Some(self.given.remove(index).1)
    }

    /// Takes the query parameter `name` and parses it; if that fails, records an error that says what was `expected`.
    pub fn value<T: FromStr>(&mut self, name: &'static str, expected: impl Display) -> Option<T> {
        self.checked(name, expected, |text| text.parse().ok())
    }

    /// Takes the query parameter `name` and converts it by `read`; if that fails, records an error that says what was
    /// `expected`.
    pub fn checked<T>(
        &mut self,
        name: &'static str,
        expected: impl Display,
        read: impl FnOnce(&str) -> Option<T>,
    ) -> Option<T> {
        let text = self.text(name)?;
        let value = read(&text);
        if value.is_none() {
            self.wrong.push(format!("{name} is {expected}, not {text:?}"));
        }
        value
    }

    /// Takes the query parameter `name` as a finite number.
    pub fn number(&mut self, name: &'static str) -> Option<f64> {
        self.checked(name, "a finite number", |text| text.parse().ok().filter(|number: &f64| number.is_finite()))
    }

    /// Checks that all conversions succeeded, and that no query parameter is unknown or repeated.
    ///
    /// # Errors
    /// [`Kind::BadQuery`] with all errors of the query.
    pub fn end(mut self) -> Result<(), Box<Problem>> {
        let known = self.known.join(", ");
        for (name, _) in &self.given {
            self.wrong.push(if self.known.contains(&name.as_str()) {
                format!("{name} is repeated")
            } else {
                format!("{name} is not a parameter here; the parameters are {known}")
            });
        }
        if self.wrong.is_empty() { Ok(()) } else { Err(Problem::new(Kind::BadQuery, self.wrong.join("; "))) }
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Query {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        let text = parts.uri.query().unwrap_or_default();
        let given = form_urlencoded::parse(text.as_bytes()).into_owned().collect();
        Ok(Self { given, known: Vec::new(), wrong: Vec::new() })
    }
}
