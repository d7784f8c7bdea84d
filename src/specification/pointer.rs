//! Places in a document, written as JSON pointers (RFC 6901).

use std::fmt::{self, Display, Formatter, Write};

/// A place as a path from the root that borrows each step, so that naming one costs nothing until it is shown.
#[derive(Clone, Copy, Debug)]
pub enum Pointer<'a> {
    /// The document.
    Root,
    /// The member of that name.
    Key(&'a Pointer<'a>, &'a str),
    /// The element at that position.
    Index(&'a Pointer<'a>, usize),
}

impl<'a> Pointer<'a> {
    pub(super) fn key(&'a self, key: &'a str) -> Pointer<'a> {
        Pointer::Key(self, key)
    }

    pub(super) fn index(&'a self, index: usize) -> Pointer<'a> {
        Pointer::Index(self, index)
    }
}

impl Display for Pointer<'_> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Pointer::Root => Ok(()),
            Pointer::Key(parent, key) => {
                parent.fmt(formatter)?;
                write_key(formatter, key)
            }
            Pointer::Index(parent, index) => {
                parent.fmt(formatter)?;
                write!(formatter, "/{index}")
            }
        }
    }
}

/// One owned step of a path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Into the member of that name.
    Key(String),
    /// Into the element at that position.
    Index(usize),
}

/// The pointer of a path of steps.
pub(super) fn pointer(steps: &[Step]) -> String {
    let mut pointer = String::new();
    for step in steps {
        match step {
            Step::Key(key) => write_key(&mut pointer, key),
            Step::Index(index) => write!(pointer, "/{index}"),
        }
        .expect("writing to a string cannot fail");
    }
    pointer
}

fn write_key(out: &mut impl Write, key: &str) -> fmt::Result {
    out.write_char('/')?;
    for letter in key.chars() {
        match letter {
            '~' => out.write_str("~0")?,
            '/' => out.write_str("~1")?,
            _ => out.write_char(letter)?,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_escaped_as_rfc_6901_says() {
        let root = Pointer::Root;
        let outer = root.key("a/b");
        let middle = outer.index(3);
        assert_eq!(middle.key("m~n").to_string(), "/a~1b/3/m~0n");
        assert_eq!(pointer(&[Step::Key("a/b".into()), Step::Index(3), Step::Key("m~n".into())]), "/a~1b/3/m~0n");
        assert_eq!(root.to_string(), "");
    }
}
