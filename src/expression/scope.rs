//! The scope of an expression: names bound to nodes and tables.

use super::function::Function;
use super::graph::{Graph, Node};
use super::table::Table;
use rustc_hash::FxHashMap;
use strsim::osa_distance;

/// The name of the predefined constant pi in expressions.
pub(super) const PI: &str = "pi";

/// The keywords that join conditions.
pub(super) const WORDS: [&str; 3] = ["and", "or", "not"];

/// Names bound to nodes, in the order of binding.
#[derive(Clone, Debug, Default)]
pub struct Scope {
    names: Vec<String>,
    nodes: FxHashMap<String, Node>,
    /// The index of the first input that is an unknown (state or variable); `None` if there are no unknowns.
    unknowns: Option<usize>,
    tables: FxHashMap<String, Table>,
    /// The elements of vectors, in the order of binding.
    vectors: FxHashMap<String, Vec<Node>>,
}

/// The reason why a name cannot be bound in a scope.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NameError {
    /// The name is malformed.
    #[error("`{}` is not a valid name: write a letter or `_`, then letters, digits and `_`, all ASCII", excerpt(.name))]
    Malformed {
        /// The malformed name.
        name: String,
    },
    /// The name is reserved by the language.
    #[error("`{name}` is a reserved word: `pi`, `and`, `or`, `not` and the functions of the language cannot be names")]
    Reserved {
        /// The reserved name.
        name: String,
    },
    /// The name is already bound.
    #[error("the name `{}` is in use already", excerpt(.name))]
    Bound {
        /// The name that is already bound.
        name: String,
    },
}

impl Scope {
    /// Creates a scope without names.
    pub fn new() -> Self {
        Self::default()
    }

    /// Binds `name` to `node`.
    ///
    /// # Errors
    /// Fails if the name is malformed, reserved or already bound.
    pub fn bind(&mut self, name: &str, node: Node) -> Result<(), NameError> {
        self.claim(name)?;
        self.insert(name, node);
        Ok(())
    }

    fn insert(&mut self, name: &str, node: Node) {
        if let Some(vector) = vector_of(name) {
            self.vectors.entry(vector.to_owned()).or_default().push(node);
        }
        self.nodes.insert(name.to_owned(), node);
        self.names.push(name.to_owned());
    }

    /// Returns the elements of a vector, in the order of binding; empty if there is no such vector.
    pub(super) fn vector(&self, name: &str) -> &[Node] {
        self.vectors.get(name).map_or(&[], Vec::as_slice)
    }

    /// Returns the names of the vectors.
    pub(super) fn vectors(&self) -> impl Iterator<Item = &str> {
        self.vectors.keys().map(String::as_str)
    }

    /// Binds `name` to a table, which is called as a function of one argument.
    ///
    /// # Errors
    /// Fails if the name is malformed, already bound, or the name of a function.
    pub fn bind_table(&mut self, name: &str, table: Table) -> Result<(), NameError> {
        if Function::named(name).is_some() {
            return Err(NameError::Reserved { name: name.to_owned() });
        }
        self.claim(name)?;
        self.tables.insert(name.to_owned(), table);
        Ok(())
    }

    /// Checks that a name can be bound.
    fn claim(&self, name: &str) -> Result<(), NameError> {
        let owned = || name.to_owned();
        let name_or_vector = vector_of(name).unwrap_or(name);
        if !is_name(name_or_vector) {
            return Err(NameError::Malformed { name: owned() });
        }
        let name = name_or_vector;
        if name == PI || WORDS.contains(&name) || Function::named(name).is_some_and(Function::is_reserved) {
            return Err(NameError::Reserved { name: owned() });
        }
        if self.nodes.contains_key(&owned()) || self.tables.contains_key(name) {
            return Err(NameError::Bound { name: owned() });
        }
        Ok(())
    }

    /// Declares the inputs from the index `first` on as unknowns. Discontinuous functions and comparisons of unknowns
    /// are rejected, because steps cannot end at their jumps.
    pub fn solve_for(&mut self, first: usize) {
        self.unknowns = Some(first);
    }

    /// Returns the index of the first input that is an unknown (state or variable).
    pub(super) fn unknowns(&self) -> Option<usize> {
        self.unknowns
    }

    /// Returns the name that the scope binds to an input, such as a state.
    pub(super) fn name_of_input(&self, graph: &Graph, input: usize) -> &str {
        let is_it = |name: &&str| self.get(name).is_some_and(|node| graph.is_input(node, |index| index == input));
        self.names().find(is_it).unwrap_or("?")
    }

    /// Binds the name of an output to `node`: a name, names joined by dots, or the form `v(R1)`.
    ///
    /// # Errors
    /// Fails if the name is malformed, reserved or already bound.
    pub fn bind_output(&mut self, name: &str, node: Node) -> Result<(), NameError> {
        let parts = name.strip_suffix(')').and_then(|call| call.split_once('('));
        let (first, second) = parts.unwrap_or((name, "_"));
        let first = vector_of(first).unwrap_or(first);
        if !(first.split('.').all(is_name) && second.split('.').all(is_part)) {
            return Err(NameError::Malformed { name: name.to_owned() });
        }
        let is_of_language = name == PI || Function::named(name).is_some_and(Function::is_reserved);
        if self.nodes.contains_key(name) || self.tables.contains_key(name) || is_of_language {
            return Err(NameError::Bound { name: name.to_owned() });
        }
        self.insert(name, node);
        Ok(())
    }

    /// Returns the longest output name at the beginning of a text, unless it is a plain name.
    pub(super) fn output_at<'t>(&self, text: &'t str) -> Option<&'t str> {
        let plain = text.bytes().position(|byte| !is_letter(byte)).unwrap_or(text.len());
        let mut end = plain;
        let mut found = None;
        while let Some(byte @ (b'.' | b'(')) = text.as_bytes().get(end) {
            let length = text[end + 1..].bytes().position(|byte| !(is_letter(byte) || byte == b'.'));
            let rest = end + 1 + length.unwrap_or(text.len() - end - 1);
            end = if *byte == b'(' { rest + 1 } else { rest };
            let candidate = text.get(..end)?;
            found = self.nodes.contains_key(candidate).then_some(candidate).or(found);
        }
        found
    }

    /// Returns the node bound to `name`.
    pub fn get(&self, name: &str) -> Option<Node> {
        self.nodes.get(name).copied()
    }

    /// Returns a scope with only the tables of this scope.
    pub fn with_tables_alone(&self) -> Self {
        Self { tables: self.tables.clone(), ..Self::default() }
    }

    /// Returns the table of this name.
    pub(super) fn table(&self, name: &str) -> Option<&Table> {
        self.tables.get(name)
    }

    /// Returns the names of the tables.
    pub(super) fn tables(&self) -> impl Iterator<Item = &str> {
        self.tables.keys().map(String::as_str)
    }

    /// Returns the names bound to nodes, in the order of binding.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(String::as_str)
    }
}

/// Returns the vector of an element name: `x` for `x[3]` or `x[1,-2]`.
fn vector_of(name: &str) -> Option<&str> {
    let (vector, indices) = name.strip_suffix(']')?.split_once('[')?;
    let is_whole = |text: &str| {
        let digits = text.strip_prefix('-').unwrap_or(text);
        !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit())
    };
    indices.split(',').all(is_whole).then_some(vector)
}

fn is_name(name: &str) -> bool {
    name.bytes().next().is_some_and(|first| !first.is_ascii_digit()) && is_part(name)
}

fn is_part(part: &str) -> bool {
    !part.is_empty() && part.bytes().all(is_letter)
}

fn is_letter(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_'
}

/// Returns the beginning of a possibly long text, for messages.
pub(super) fn excerpt(text: &str) -> String {
    const LONGEST: usize = 40;
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}

/// Returns the candidate name that is closest to `name` in spelling, if it is close: a third of the letters may differ.
pub fn nearest<'a>(name: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    const LONGEST: usize = 64;
    let allowed = (name.len() / 3).max(1);
    if name.len() > LONGEST {
        return None;
    }
    let folded = name.to_ascii_lowercase();
    candidates
        .filter(|candidate| candidate.len().abs_diff(name.len()) <= allowed)
        .map(|candidate| (osa_distance(&folded, &candidate.to_ascii_lowercase()), candidate))
        // Names of one letter are not corrected to another letter.
        .filter(|&(distance, _)| distance == 0 || name.len() > 1 && distance <= allowed)
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, candidate)| candidate)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_kept_in_the_order_of_binding() {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        for (index, name) in ["z", "a_1", "_", "e", "t"].into_iter().enumerate() {
            scope.bind(name, graph.input(index)).unwrap();
        }
        assert_eq!(scope.names().collect::<Vec<_>>(), ["z", "a_1", "_", "e", "t"]);
        assert_eq!(scope.get("a_1"), Some(graph.input(1)));
        assert_eq!(scope.get("b"), None);
    }

    #[test]
    fn a_name_that_cannot_be_bound_says_why() {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        let node = graph.input(0);
        scope.bind("x", node).unwrap();
        for name in ["", "1x", "a-b", "a b", "\u{3bc}"] {
            assert_eq!(scope.bind(name, node), Err(NameError::Malformed { name: name.to_owned() }));
        }
        for name in ["pi", "sin", "heaviside", "pow"] {
            assert_eq!(scope.bind(name, node), Err(NameError::Reserved { name: name.to_owned() }));
        }
        assert_eq!(scope.bind("x", node), Err(NameError::Bound { name: "x".to_owned() }));
        assert_eq!(
            scope.bind("1x", node).unwrap_err().to_string(),
            "`1x` is not a valid name: write a letter or `_`, then letters, digits and `_`, all ASCII"
        );
    }

    #[test]
    fn only_a_close_spelling_is_suggested() {
        let names = || ["position", "velocity", "x", "X2"].into_iter();
        assert_eq!(nearest("velocty", names()), Some("velocity"));
        assert_eq!(nearest("psoition", names()), Some("position"));
        assert_eq!(nearest("X", names()), Some("x"));
        assert_eq!(nearest("y", names()), None);
        assert_eq!(nearest("temperature", names()), None);
    }
}
