//! Elements of XML with the attributes that they inherit, numbers in them, and what is wrong at which line.

use crate::wording::abridged;
use expression::nearest;
use roxmltree::Node;
use std::collections::HashMap;

/// Attributes that elements of one kind have unless they say otherwise: their values, and where these stand.
pub(super) type Defaults<'x> = HashMap<&'x str, (&'x str, usize)>;

/// A line and a column of the text, counted from 1, the column in characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub line: usize,
    pub column: usize,
}

/// What is wrong in a description.
#[derive(Clone, Debug)]
pub(super) struct DescriptionError {
    pub at: At,
    pub code: &'static str,
    pub detail: String,
    pub expected: String,
    pub did_you_mean: Option<String>,
}

/// Where it is wrong.
#[derive(Clone, Debug)]
pub(super) enum At {
    /// In the text.
    Text(Place),
    /// Beside the text, by keys of the description.
    Keys(Vec<String>),
}

/// An element, and what it inherits.
#[derive(Clone, Copy)]
pub(super) struct Element<'a, 'x> {
    pub node: Node<'a, 'x>,
    inherited: Option<&'a Defaults<'a>>,
}

impl<'a, 'x> Element<'a, 'x> {
    pub fn new(node: Node<'a, 'x>) -> Self {
        Self { node, inherited: None }
    }

    pub fn inheriting(node: Node<'a, 'x>, inherited: Option<&'a Defaults<'a>>) -> Self {
        Self { node, inherited }
    }

    /// The name of its kind.
    pub fn tag(&self) -> &'a str {
        self.node.tag_name().name()
    }

    /// Where it stands.
    pub fn start(&self) -> usize {
        self.node.range().start
    }

    /// An attribute, its own or an inherited one, and where its value stands.
    pub fn attribute(&self, name: &str) -> Option<(&'a str, usize)> {
        let own = self.node.attribute_node(name).map(|attribute| (attribute.value(), attribute.range_value().start));
        own.or_else(|| self.inherited?.get(name).copied())
    }

    /// The value of an attribute.
    pub fn get(&self, name: &str) -> Option<&'a str> {
        self.attribute(name).map(|(value, _)| value)
    }

    /// Elements within it.
    pub fn children(&self) -> impl Iterator<Item = Element<'a, 'x>> + use<'a, 'x> {
        self.node.children().filter(Node::is_element).map(Element::new)
    }

    /// The first element of that kind within it.
    pub fn child(&self, tag: &str) -> Option<Element<'a, 'x>> {
        self.children().find(|child| child.tag() == tag)
    }
}

/// What a description is read with: its lines, and what was found wrong or left out.
pub(super) struct Reader {
    starts: Vec<usize>,
    text: String,
    pub errors: Vec<DescriptionError>,
    /// What is left out, and the lines that have it.
    remarks: Vec<(String, Vec<usize>)>,
}

/// The most lines that a remark names.
const MOST_LINES: usize = 5;

impl Reader {
    pub fn new(text: &str) -> Self {
        let starts = std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect();
        Self { starts, text: text.to_owned(), errors: Vec::new(), remarks: Vec::new() }
    }

    /// Line and column of a byte.
    pub fn place(&self, byte: usize) -> Place {
        let line = self.starts.partition_point(|start| *start <= byte).max(1);
        let before = self.starts.get(line - 1).and_then(|start| self.text.get(*start..byte));
        Place { line, column: before.map_or(0, |before| before.chars().count()) + 1 }
    }

    /// Reports what is wrong at a byte.
    pub fn report(&mut self, byte: usize, code: &'static str, detail: impl Into<String>, expected: impl Into<String>) {
        let at = At::Text(self.place(byte));
        let error = DescriptionError { at, code, detail: detail.into(), expected: expected.into(), did_you_mean: None };
        self.errors.push(error);
    }

    /// Refuses an element that a scene has no counterpart of.
    pub fn refuse(&mut self, element: Element<'_, '_>, detail: impl Into<String>, expected: impl Into<String>) {
        self.report(element.start(), "unsupported_element", detail, expected);
    }

    /// Notes what is left out of an element.
    pub fn leave_out(&mut self, element: Element<'_, '_>, what: impl Into<String>) {
        let (what, line) = (what.into(), self.place(element.start()).line);
        match self.remarks.iter_mut().find(|(known, _)| *known == what) {
            Some((_, lines)) => lines.push(line),
            None => self.remarks.push((what, vec![line])),
        }
    }

    /// What was left out, in sentences.
    pub fn remarks(self) -> Vec<String> {
        let sentence = |(what, mut lines): (String, Vec<usize>)| {
            lines.dedup();
            let more = if lines.len() > MOST_LINES { ", .." } else { "" };
            let shown: Vec<String> = lines.iter().take(MOST_LINES).map(ToString::to_string).collect();
            let word = if lines.len() == 1 { "line" } else { "lines" };
            format!("{what} ({word} {}{more})", shown.join(", "))
        };
        self.remarks.into_iter().map(sentence).collect()
    }

    /// An element that is not known here: refused where it is nearly a known one, else left out.
    pub fn unknown(&mut self, element: Element<'_, '_>, known: &[&str]) {
        let tag = abridged(element.tag());
        if element.node.tag_name().namespace().is_some_and(|namespace| namespace.contains("xacro")) {
            let detail = format!("<xacro:{tag}> makes a description, and is none");
            return self.refuse(element, detail, "what the program xacro makes of it: xacro robot.xacro > robot.urdf");
        }
        match nearest(element.tag(), known.iter().copied()) {
            Some(near) => {
                self.refuse(element, format!("there is no element <{tag}> here"), format!("<{}>", known.join(">, <")));
                if let Some(error) = self.errors.last_mut() {
                    error.did_you_mean = Some(near.to_owned());
                }
            }
            None => self.leave_out(element, format!("<{tag}> has no meaning here and is passed over")),
        }
    }

    /// The name of an element, which it must have.
    pub fn name<'a>(&mut self, element: Element<'a, '_>) -> Option<&'a str> {
        self.required(element, "name")
    }

    /// An attribute that an element must have.
    pub fn required<'a>(&mut self, element: Element<'a, '_>, name: &str) -> Option<&'a str> {
        let found = element.get(name);
        if found.is_none() {
            let detail = format!("<{}> has no `{name}`", element.tag());
            self.report(element.start(), "missing_key", detail, format!("{name}=\"..\""));
        }
        found
    }

    /// The numbers of an attribute, where it has one; those that are none are reported.
    pub fn list(&mut self, element: Element<'_, '_>, name: &str) -> Option<Vec<f64>> {
        let (text, at) = element.attribute(name)?;
        let mut numbers = Vec::new();
        for word in text.split_whitespace() {
            match word.parse::<f64>() {
                Ok(number) if number.is_finite() => numbers.push(number),
                _ => {
                    let detail = format!("`{}` is no number", abridged(word));
                    self.report(at, "malformed_number", detail, "numbers such as 0.5, with blanks between them");
                    return None;
                }
            }
        }
        Some(numbers)
    }

    /// So many numbers.
    pub fn numbers<const N: usize>(&mut self, element: Element<'_, '_>, name: &str) -> Option<[f64; N]> {
        let found = self.list(element, name)?;
        let count = found.len();
        let array = <[f64; N]>::try_from(found).ok();
        if array.is_none() {
            let at = element.attribute(name).map_or(element.start(), |(_, at)| at);
            let detail = format!("`{name}` has {count} numbers");
            self.report(at, "wrong_count", detail, format!("{N} numbers"));
        }
        array
    }

    /// One number.
    pub fn number(&mut self, element: Element<'_, '_>, name: &str) -> Option<f64> {
        self.numbers::<1>(element, name).map(|[number]| number)
    }

    /// One number that an element must have.
    pub fn required_number(&mut self, element: Element<'_, '_>, name: &str) -> Option<f64> {
        self.required(element, name)?;
        self.number(element, name)
    }

    /// A length above zero that an element must have.
    pub fn length(&mut self, element: Element<'_, '_>, name: &str) -> Option<f64> {
        let length = self.required_number(element, name)?;
        self.above_zero(element, name, length)
    }

    /// A number of an attribute, if it is above zero.
    pub fn above_zero(&mut self, element: Element<'_, '_>, name: &str, value: f64) -> Option<f64> {
        if value > 0.0 {
            return Some(value);
        }
        let at = element.attribute(name).map_or(element.start(), |(_, at)| at);
        self.report(at, "out_of_range", format!("`{name}` is {value}"), "above 0");
        None
    }
}
