//! Names with index ranges, `x[1..n]` and `x[i in 1..3, j in 0..n+1]`, and substitution of indices in texts.

use crate::error::SpecificationError;
use crate::wording::abridged;

/// Largest number of elements of all vectors of a document together: each of 100,000 variables in four places, as in
/// `variables`, in `set` and in a definition or two.
pub(super) const MOST_ELEMENTS: usize = 400_000;

/// Default names of the indices of a vector, in order.
const INDICES: [&str; 3] = ["i", "j", "k"];

/// A name with index ranges, such as `x[1..n]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Range<'t> {
    /// The name of the vector, without its index ranges.
    pub name: &'t str,
    /// The name, first value and last value of each index of the vector.
    indices: Vec<(&'t str, i64, i64)>,
}

/// The names and values of the indices of one element of a vector.
pub(super) type Values<'t> = Vec<(&'t str, i64)>;

impl<'t> Range<'t> {
    /// Parses a text; returns `None` if it has no range. `size` looks up parameters with whole values.
    ///
    /// # Errors
    /// A faulty range.
    pub(super) fn read(
        text: &'t str,
        pointer: impl Fn() -> String,
        size: impl Fn(&str) -> Option<i64>,
    ) -> Result<Option<Self>, SpecificationError> {
        let parts = text.trim().strip_suffix(']').and_then(|text| text.split_once('['));
        let Some((name, inside)) = parts.filter(|(name, _)| is_word(name)) else { return Ok(None) };
        if !inside.contains("..") {
            return Ok(Self::one(name, inside, size));
        }
        let wrong = |what: String| {
            let detail = format!("`{}`: {what}", abridged(text));
            SpecificationError::new(pointer(), "index_out_of_range", detail)
                .expected("`x[1..n]` or `x[i in 1..n]`, with whole numbers and parameters that are whole numbers")
        };
        let mut indices: Vec<(&str, i64, i64)> = Vec::new();
        for (k, part) in inside.split(',').enumerate() {
            let (index, range) = match part.split_once(" in ") {
                Some((index, range)) => (index.trim(), range),
                None => (
                    *INDICES
                        .get(k)
                        .ok_or_else(|| wrong("there are more than three indices without names".to_owned()))?,
                    part,
                ),
            };
            if !is_word(index) || indices.iter().any(|(other, ..)| *other == index) {
                return Err(wrong(format!("`{}` is not a valid name for an index", abridged(index))));
            }
            let end = |text: &str| whole(text, &size).map_err(wrong);
            let (first, last) = match range.split_once("..") {
                Some((first, last)) => (end(first)?, end(last)?),
                // The index has a single value, and another index has a range, as in `x[0, 1..n]`, the edge of a
                // grid.
                None => (end(range)?, end(range)?),
            };
            if first > last {
                return Err(wrong(format!("the range {first}..{last} is empty")));
            }
            indices.push((index, first, last));
        }
        let range = Self { name, indices };
        match range.len() {
            Some(_) => Ok(Some(range)),
            None => Err(wrong(format!("more than {MOST_ELEMENTS} elements"))),
        }
    }

    /// Returns the names of the indices of the vector.
    pub(super) fn indices(&self) -> impl Iterator<Item = &'t str> {
        self.indices.iter().map(|(name, ..)| *name)
    }

    /// Returns the range that consists of a single element, such as `x[n + 1]`; `None` if all indices are plain numbers
    /// or an index cannot be evaluated.
    fn one(name: &'t str, inside: &'t str, size: impl Fn(&str) -> Option<i64>) -> Option<Self> {
        let parts: Vec<&str> = inside.split(',').collect();
        let values: Option<Vec<i64>> = parts.iter().map(|part| whole(part, &size).ok()).collect();
        let is_plain = parts.iter().all(|part| part.parse::<i64>().is_ok());
        let indices = values?.into_iter().map(|value| ("", value, value)).collect();
        (!is_plain).then_some(Self { name, indices })
    }

    /// Returns the number of elements of the vector; `None` if there are too many.
    pub(super) fn len(&self) -> Option<usize> {
        let sizes = self.indices.iter().map(|(_, first, last)| (last - first) as usize + 1);
        sizes.into_iter().try_fold(1_usize, usize::checked_mul).filter(|&count| count <= MOST_ELEMENTS)
    }

    /// Returns the name of each element of the vector with the values of its indices; the last index varies fastest.
    pub(super) fn elements(&self) -> impl Iterator<Item = (String, Values<'t>)> {
        let count = self.len().unwrap_or(0);
        (0..count).map(move |mut place| {
            let mut values = Vec::with_capacity(self.indices.len());
            for &(index, first, last) in self.indices.iter().rev() {
                let size = (last - first) as usize + 1;
                values.push((index, first + (place % size) as i64));
                place /= size;
            }
            values.reverse();
            let shown: Vec<String> = values.iter().map(|(_, value)| value.to_string()).collect();
            (format!("{}[{}]", self.name, shown.join(",")), values)
        })
    }
}

/// Evaluates the end of an index range, a sum of whole numbers and parameters.
fn whole(text: &str, size: &impl Fn(&str) -> Option<i64>) -> Result<i64, String> {
    let mut sum = 0_i64;
    let mut rest = text.trim();
    let mut sign = 1;
    if let Some(after) = rest.strip_prefix('-') {
        (sign, rest) = (-1, after.trim_start());
    }
    loop {
        let end = rest.find(['+', '-']).unwrap_or(rest.len());
        let word = rest[..end].trim();
        const MOST: i64 = 1_000_000_000;
        let value = match word.parse::<i64>() {
            Ok(value) if value <= MOST => value,
            _ => size(word)
                .ok_or_else(|| format!("`{}` is neither a whole number nor a parameter that is one", abridged(word)))?,
        };
        sum += sign * value;
        if end == rest.len() {
            return Ok(sum);
        }
        sign = if rest.as_bytes()[end] == b'+' { 1 } else { -1 };
        rest = &rest[end + 1..];
    }
}

/// Replaces the indices of a vector in a text by their values, where they are separate words and not called as
/// functions.
pub(super) fn replaced(text: &str, values: &Values<'_>) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(|c: char| c.is_ascii_alphanumeric() || c == '_') {
        let length = rest[at..].find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(rest.len() - at);
        let (before, word, after) = (&rest[..at], &rest[at..at + length], &rest[at + length..]);
        out.push_str(before);
        let is_part = out.ends_with('.') && !out.ends_with("..") || after.trim_start().starts_with('(');
        match values.iter().find(|(index, _)| *index == word && !is_part) {
            Some((_, value)) if *value < 0 => out.push_str(&format!("({value})")),
            Some((_, value)) => out.push_str(&value.to_string()),
            None => out.push_str(word),
        }
        rest = after;
    }
    out + rest
}

fn is_word(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Option<Range<'_>>, SpecificationError> {
        Range::read(text, String::new, |name| (name == "n").then_some(3))
    }

    #[test]
    fn ranges_have_elements() {
        let names = |text: &'static str| -> Vec<String> {
            read(text).unwrap().unwrap().elements().map(|(name, _)| name).collect()
        };
        assert_eq!(names("x[1..n]"), ["x[1]", "x[2]", "x[3]"]);
        assert_eq!(names("x[0..n-2]"), ["x[0]", "x[1]"]);
        assert_eq!(names("x[-1..0, k in 5..6]"), ["x[-1,5]", "x[-1,6]", "x[0,5]", "x[0,6]"]);
        assert_eq!(names("x[n+1]"), ["x[4]"]);
        assert_eq!(names("x[1..2, n+1]"), ["x[1,4]", "x[2,4]"]);
        for plain in ["x[3]", "x[-1,2]", "a[i]*b[n]", "x", "x[m]"] {
            assert_eq!(read(plain).unwrap(), None, "{plain}");
        }
        for wrong in ["x[1..m]", "x[3..1]", "x[1..1.5]", "x[i in 1..2, i in 1..2]", "x[1..1000000]", "x[2 in 1..2]"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn indices_are_words_of_their_own() {
        let at = |text: &str| replaced(text, &vec![("i", 3), ("j", -1)]);
        assert_eq!(at("x[i-1] + i*xi + i_1 + i(R1) + j"), "x[3-1] + 3*xi + i_1 + i(R1) + (-1)");
        assert_eq!(at("sum(x[k] for k in 1..i)"), "sum(x[k] for k in 1..3)");
    }
}
