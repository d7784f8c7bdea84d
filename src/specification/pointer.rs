//! Places in a document, as JSON pointers (RFC 6901).

use std::fmt::{self, Display, Formatter, Write};

/// A path from the root of a JSON document that borrows its steps, so that it costs nothing until it is formatted.
#[derive(Clone, Copy, Debug)]
pub enum Pointer<'a> {
    /// The root of the path, the document itself.
    Root,
    /// The member with the given name, in the object at the parent pointer.
    Key(&'a Pointer<'a>, &'a str),
    /// The element at the given index, in the list at the parent pointer.
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

/// One step of a path in a document, which owns its key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Step to the member of an object with the given name.
    Key(String),
    /// Step to the element of a list at the given index.
    Index(usize),
}

/// Returns the JSON pointer of a path of steps.
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
