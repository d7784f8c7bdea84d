//! XML elements of robot descriptions with inherited attributes, numbers in attributes, and errors with line and
//! column.

use crate::wording::abridged;
use expression::nearest;
use roxmltree::Node;
use std::collections::HashMap;

/// Default attributes of XML elements of one kind: value, and byte offset of the value, by attribute name.
pub(super) type Defaults<'x> = HashMap<&'x str, (&'x str, usize)>;

/// A line and a column of a robot description, counted from 1, the column in characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub line: usize,
    pub column: usize,
}

/// An error in a robot description.
#[derive(Clone, Debug)]
pub(super) struct DescriptionError {
    pub at: At,
    pub code: &'static str,
    pub detail: String,
    pub expected: String,
    pub did_you_mean: Option<String>,
}

/// The location of an error in a robot description.
#[derive(Clone, Debug)]
pub(super) enum At {
    /// Line and column in the text of the robot description.
    Text(Place),
    /// Keys of the JSON object that contains the robot description.
    Keys(Vec<String>),
}

/// An XML element of a robot description, with the default attributes that it inherits.
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

    /// Tag name of the XML element.
    pub fn tag(&self) -> &'a str {
        self.node.tag_name().name()
    }

    /// Byte offset of the XML element in the robot description.
    pub fn start(&self) -> usize {
        self.node.range().start
    }

    /// Returns the value of an attribute of the XML element, own or inherited, and the byte offset of the value.
    pub fn attribute(&self, name: &str) -> Option<(&'a str, usize)> {
        let own = self.node.attribute_node(name).map(|attribute| (attribute.value(), attribute.range_value().start));
        own.or_else(|| self.inherited?.get(name).copied())
    }

    /// Returns the value of an attribute of the XML element, own or inherited.
    pub fn get(&self, name: &str) -> Option<&'a str> {
        self.attribute(name).map(|(value, _)| value)
    }

    /// Returns the child elements of the XML element.
    pub fn children(&self) -> impl Iterator<Item = Element<'a, 'x>> + use<'a, 'x> {
        self.node.children().filter(Node::is_element).map(Element::new)
    }

    /// Returns the first child element of the XML element with the given tag.
    pub fn child(&self, tag: &str) -> Option<Element<'a, 'x>> {
        self.children().find(|child| child.tag() == tag)
    }
}

/// Reader of a robot description: offsets of its lines, and the errors and remarks on parts left out found so far.
pub(super) struct Reader {
    starts: Vec<usize>,
    text: String,
    pub errors: Vec<DescriptionError>,
    /// Messages about parts of the robot description that are left out, each with the lines on which the parts begin.
    remarks: Vec<(String, Vec<usize>)>,
}

/// Largest number of lines that a remark on parts left out lists.
const MOST_LINES: usize = 5;

impl Reader {
    pub fn new(text: &str) -> Self {
        let starts = std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect();
        Self { starts, text: text.to_owned(), errors: Vec::new(), remarks: Vec::new() }
    }

    /// Returns line and column of a byte offset in the robot description.
    pub fn place(&self, byte: usize) -> Place {
        let line = self.starts.partition_point(|start| *start <= byte).max(1);
        let before = self.starts.get(line - 1).and_then(|start| self.text.get(*start..byte));
        Place { line, column: before.map_or(0, |before| before.chars().count()) + 1 }
    }

    /// Reports an error at a byte offset in the robot description.
    pub fn report(&mut self, byte: usize, code: &'static str, detail: impl Into<String>, expected: impl Into<String>) {
        let at = At::Text(self.place(byte));
        let error = DescriptionError { at, code, detail: detail.into(), expected: expected.into(), did_you_mean: None };
        self.errors.push(error);
    }

    /// Reports an error for an XML element that has no counterpart in a rigid-body scene.
    pub fn refuse(&mut self, element: Element<'_, '_>, detail: impl Into<String>, expected: impl Into<String>) {
        self.report(element.start(), "unsupported_element", detail, expected);
    }

    /// Adds a remark that a part of an XML element is left out.
    pub fn leave_out(&mut self, element: Element<'_, '_>, what: impl Into<String>) {
        let (what, line) = (what.into(), self.place(element.start()).line);
        match self.remarks.iter_mut().find(|(known, _)| *known == what) {
            Some((_, lines)) => lines.push(line),
            None => self.remarks.push((what, vec![line])),
        }
    }

    /// Returns the remarks about parts of the robot description that were left out, as sentences.
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

    /// Handles an XML element of unknown kind: an error if its tag is close to a known one, else a remark that it is
    /// left out.
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

    /// Returns the name of an XML element; a missing name is an error.
    pub fn name<'a>(&mut self, element: Element<'a, '_>) -> Option<&'a str> {
        self.required(element, "name")
    }

    /// Returns the value of an attribute of an XML element; a missing attribute is an error.
    pub fn required<'a>(&mut self, element: Element<'a, '_>, name: &str) -> Option<&'a str> {
        let found = element.get(name);
        if found.is_none() {
            let detail = format!("<{}> has no `{name}`", element.tag());
            self.report(element.start(), "missing_key", detail, format!("{name}=\"..\""));
        }
        found
    }

    /// Returns the numbers of an attribute of an XML element, if the element has the attribute; malformed numbers are
    /// errors.
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

    /// Returns the `N` numbers of an attribute of an XML element; any other count is an error.
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

    /// Returns the single number of an attribute of an XML element, if the element has the attribute.
    pub fn number(&mut self, element: Element<'_, '_>, name: &str) -> Option<f64> {
        self.numbers::<1>(element, name).map(|[number]| number)
    }

    /// Returns the single number of an attribute of an XML element; a missing attribute is an error.
    pub fn required_number(&mut self, element: Element<'_, '_>, name: &str) -> Option<f64> {
        self.required(element, name)?;
        self.number(element, name)
    }

    /// Returns a length from an attribute of an XML element, which must be present and above zero.
    pub fn length(&mut self, element: Element<'_, '_>, name: &str) -> Option<f64> {
        let length = self.required_number(element, name)?;
        self.above_zero(element, name, length)
    }

    /// Returns `value`, the number of an attribute of an XML element, if it is above zero, and reports an error
    /// otherwise.
    pub fn above_zero(&mut self, element: Element<'_, '_>, name: &str, value: f64) -> Option<f64> {
        if value > 0.0 {
            return Some(value);
        }
        let at = element.attribute(name).map_or(element.start(), |(_, at)| at);
        self.report(at, "out_of_range", format!("`{name}` is {value}"), "above 0");
        None
    }
}
