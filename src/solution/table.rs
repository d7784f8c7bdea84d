//! The table of a sweep: one row per member; columns for each swept name, each collected number, and the outcome of the
//! member.
//!
//! Columns are stored compactly: eight bytes per number, at most four bytes per count or text (each distinct text is
//! stored once). A missing number is NaN in memory, and null or an empty field in every written form.

mod answer;
mod counts;
mod json;
mod lists;
mod rows;

pub use answer::{Incomplete, answer};
pub use counts::Counts;
pub use lists::Lists;

use counts::MISSING;
use json::{by_name, schema_of_columns};
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;
use utoipa::ToSchema;

/// The table of a sweep: one row for each member, in the order of members.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct Table {
    /// The columns by name: `member`, from zero; the swept names; the collected values; `status`, `trusted`, `error`,
    /// `steps`, `switches`, `residual`, `warnings`. A missing value is null.
    #[serde(with = "by_name")]
    #[schema(schema_with = schema_of_columns)]
    pub columns: Vec<Column>,
    /// Number of members of the sweep; there may be fewer rows if the sweep was stopped or the table is a part of it.
    pub members: u64,
    /// Number of failed members among the rows of the table.
    pub failed: u64,
    /// Names of the swept columns.
    #[serde(default)]
    pub swept: Vec<String>,
    /// Names of the collected columns.
    #[serde(default)]
    pub collected: Vec<String>,
    /// The times of the trajectories that were kept, in columns of lists such as `trajectory.x`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub times: Vec<f64>,
    /// The program and the specification that produced the table.
    #[serde(flatten)]
    pub provenance: TableProvenance,
}

/// The provenance of a table: parts of a sweep can be merged only if their provenance is equal.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
pub struct TableProvenance {
    /// Version of the program that made the table.
    #[serde(default, rename = "program")]
    pub version: String,
    /// The CPU instruction sets that the program uses.
    #[serde(default)]
    pub features: String,
    /// SHA-256 of the specification, independent of its layout.
    #[serde(default)]
    pub digest: String,
}

/// A named column of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// The name of the column.
    pub name: String,
    /// The values of the column, one per row.
    pub values: Values,
}

/// The values of a column, one per row.
#[derive(Clone, Debug)]
pub enum Values {
    /// Numbers; NaN if missing.
    Numbers(Vec<f64>),
    /// Counts; [`u32::MAX`] if missing.
    Counts(Counts),
    /// Truth values.
    Flags(Vec<bool>),
    /// Texts, as indices into a list of distinct texts.
    Words(Words),
    /// Lists of numbers, all of one length.
    Lists(Lists),
}

/// A column of texts in the table of a sweep, each distinct text stored once.
#[derive(Clone, Debug, Default)]
pub struct Words {
    /// For each row, the index of its text in `words`.
    places: Counts,
    words: Vec<String>,
    known: FxHashMap<String, u32>,
}

/// The reason why two tables are not parts of one sweep and cannot be merged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unmergeable(pub String);

impl fmt::Display for Unmergeable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl Words {
    /// Appends a text to the column, or a missing value.
    pub fn push(&mut self, word: Option<&str>) {
        let place = word.map_or(MISSING, |word| self.place(word));
        self.places.push(place);
    }

    fn place(&mut self, word: &str) -> u32 {
        if let Some(place) = self.known.get(word) {
            return *place;
        }
        let place = self.words.len() as u32;
        self.words.push(word.to_owned());
        self.known.insert(word.to_owned(), place);
        place
    }

    /// Returns the text in a row of the column; `None` if it is missing.
    pub fn get(&self, row: usize) -> Option<&str> {
        self.words.get(self.places.get(row)? as usize).map(String::as_str)
    }

    fn append(&mut self, other: &Self) {
        let places: Vec<u32> = other.words.iter().map(|word| self.place(word)).collect();
        for place in other.places.iter() {
            self.places.push(places.get(place as usize).copied().unwrap_or(MISSING));
        }
    }
}

impl PartialEq for Words {
    fn eq(&self, other: &Self) -> bool {
        self.places.len() == other.places.len() && (0..self.places.len()).all(|row| self.get(row) == other.get(row))
    }
}

impl PartialEq for Values {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Numbers(a), Self::Numbers(b)) => {
                a.len() == b.len()
                    && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan())
            }
            (Self::Counts(a), Self::Counts(b)) => a == b,
            (Self::Flags(a), Self::Flags(b)) => a == b,
            (Self::Words(a), Self::Words(b)) => a == b,
            (Self::Lists(a), Self::Lists(b)) => a == b,
            // A column without any value has no type in its written form, and equals any other column without values.
            (a, b) => a.len() == b.len() && (0..a.len()).all(|row| a.is_missing(row) && b.is_missing(row)),
        }
    }
}

impl Values {
    /// Returns the number of rows of the column.
    pub fn len(&self) -> usize {
        match self {
            Self::Numbers(values) => values.len(),
            Self::Counts(values) => values.len(),
            Self::Flags(values) => values.len(),
            Self::Words(words) => words.places.len(),
            Self::Lists(lists) => lists.len(),
        }
    }

    /// Whether the column of a table has no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether the value in a row of the column is missing.
    pub fn is_missing(&self, row: usize) -> bool {
        match self {
            Self::Numbers(values) => values.get(row).is_none_or(|value| !value.is_finite()),
            Self::Counts(values) => values.get(row).is_none_or(|value| value == MISSING),
            Self::Flags(values) => values.get(row).is_none(),
            Self::Words(words) => words.get(row).is_none(),
            Self::Lists(lists) => lists.numbers(row).is_none(),
        }
    }

    /// Returns the number or count in a row of the column; `None` if it is missing.
    pub fn number(&self, row: usize) -> Option<f64> {
        match self {
            Self::Numbers(values) => values.get(row).copied().filter(|value| value.is_finite()),
            Self::Counts(values) => values.get(row).filter(|value| *value != MISSING).map(f64::from),
            Self::Flags(_) | Self::Words(_) | Self::Lists(_) => None,
        }
    }

    /// Returns the text in a row of the column; `None` if it is missing.
    pub fn word(&self, row: usize) -> Option<&str> {
        match self {
            Self::Words(words) => words.get(row),
            Self::Numbers(_) | Self::Counts(_) | Self::Flags(_) | Self::Lists(_) => None,
        }
    }

    /// Reserves space for additional rows of the column.
    pub fn reserve(&mut self, rows: usize) {
        match self {
            Self::Numbers(values) => values.reserve_exact(rows),
            Self::Counts(values) => values.reserve(rows),
            Self::Flags(values) => values.reserve_exact(rows),
            Self::Words(words) => words.places.reserve(rows),
            Self::Lists(lists) => lists.reserve(rows),
        }
    }

    /// Appends a number to the column, or a missing value.
    pub fn push_number(&mut self, value: Option<f64>) {
        match self {
            Self::Numbers(values) => values.push(value.unwrap_or(f64::NAN)),
            Self::Counts(values) => values.push(value.map_or(MISSING, |value| value as u32)),
            Self::Flags(values) => values.push(value.is_some_and(|value| value != 0.0)),
            Self::Words(words) => words.push(None),
            Self::Lists(lists) => lists.push(&[]),
        }
    }

    /// Appends a list of numbers to the column, or a part of a list.
    pub fn push_list(&mut self, list: &[f64]) {
        match self {
            Self::Lists(lists) => lists.push(list),
            other => other.push_number(None),
        }
    }

    /// Appends a text to the column, or a missing value.
    pub fn push_word(&mut self, word: Option<&str>) {
        match self {
            Self::Words(words) => words.push(word),
            other => other.push_number(None),
        }
    }

    fn append(&mut self, other: Self) -> bool {
        let is_empty = |values: &Self| (0..values.len()).all(|row| values.is_missing(row));
        if std::mem::discriminant(self) != std::mem::discriminant(&other) {
            // A column without any value has no type in its written form: it takes the type of the other column.
            if is_empty(self) {
                let mut values = other.emptied();
                (0..self.len()).for_each(|_| values.push_number(None));
                *self = values;
            } else if is_empty(&other) {
                (0..other.len()).for_each(|_| self.push_number(None));
                return true;
            } else {
                return false;
            }
        }
        match (self, other) {
            (Self::Numbers(values), Self::Numbers(other)) => values.extend(other),
            (Self::Counts(values), Self::Counts(other)) => other.iter().for_each(|value| values.push(value)),
            (Self::Flags(values), Self::Flags(other)) => values.extend(other),
            (Self::Words(words), Self::Words(other)) => words.append(&other),
            (Self::Lists(lists), Self::Lists(other)) if lists.length() == other.length() || lists.is_empty() => {
                if lists.is_empty() {
                    lists.take_length(&other);
                }
                (0..other.len()).filter_map(|row| other.get(row)).for_each(|list| lists.push(list));
            }
            (Self::Lists(_), Self::Lists(other)) if other.is_empty() => {}
            _ => return false,
        }
        true
    }

    /// Returns the values of the column in the given rows.
    pub fn part(&self, rows: Range<usize>) -> Self {
        match self {
            Self::Numbers(values) => Self::Numbers(values.get(rows).unwrap_or_default().to_vec()),
            Self::Counts(values) => Self::Counts(rows.filter_map(|row| values.get(row)).collect()),
            Self::Flags(values) => Self::Flags(values.get(rows).unwrap_or_default().to_vec()),
            Self::Words(words) => {
                let mut part = Words::default();
                rows.take_while(|row| *row < words.places.len()).for_each(|row| part.push(words.get(row)));
                Self::Words(part)
            }
            Self::Lists(lists) => {
                let mut part = Lists::new(lists.length());
                rows.filter_map(|row| lists.get(row)).for_each(|list| part.push(list));
                Self::Lists(part)
            }
        }
    }

    /// Returns a column of the same type without values.
    pub fn emptied(&self) -> Self {
        match self {
            Self::Numbers(_) => Self::Numbers(Vec::new()),
            Self::Counts(_) => Self::Counts(Counts::default()),
            Self::Flags(_) => Self::Flags(Vec::new()),
            Self::Words(_) => Self::Words(Words::default()),
            Self::Lists(lists) => Self::Lists(Lists::new(lists.length())),
        }
    }

    fn reordered(&self, order: &[usize]) -> Self {
        match self {
            Self::Numbers(values) => Self::Numbers(order.iter().map(|row| values[*row]).collect()),
            Self::Counts(values) => Self::Counts(order.iter().filter_map(|row| values.get(*row)).collect()),
            Self::Flags(values) => Self::Flags(order.iter().map(|row| values[*row]).collect()),
            Self::Words(words) => {
                let mut ordered = Words::default();
                order.iter().for_each(|row| ordered.push(words.get(*row)));
                Self::Words(ordered)
            }
            Self::Lists(lists) => {
                let mut ordered = Lists::new(lists.length());
                order.iter().filter_map(|row| lists.get(*row)).for_each(|list| ordered.push(list));
                Self::Lists(ordered)
            }
        }
    }
}

impl Table {
    /// Returns the number of rows of the table.
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |column| column.values.len())
    }

    /// Reserves space for additional rows of the table.
    pub fn reserve(&mut self, rows: usize) {
        self.columns.iter_mut().for_each(|column| column.values.reserve(rows));
    }

    /// Returns the column of the table with the given name.
    pub fn column(&self, name: &str) -> Option<&Values> {
        self.columns.iter().find(|column| column.name == name).map(|column| &column.values)
    }

    /// Returns the number of columns of the table after the swept and collected ones.
    pub fn own(&self) -> usize {
        self.columns.len().saturating_sub(1 + self.swept.len() + self.collected.len())
    }

    /// Whether the table has a column of the given name after the swept and collected ones.
    pub fn has(&self, name: &str) -> bool {
        self.columns[self.columns.len() - self.own()..].iter().any(|column| column.name == name)
    }

    /// Returns a table with the same columns, without rows.
    pub fn emptied(&self) -> Self {
        let emptied = |column: &Column| Column { name: column.name.clone(), values: column.values.emptied() };
        Self { columns: self.columns.iter().map(emptied).collect(), failed: 0, ..self.clone_heads() }
    }

    fn clone_heads(&self) -> Self {
        Self {
            columns: Vec::new(),
            members: self.members,
            failed: self.failed,
            swept: self.swept.clone(),
            collected: self.collected.clone(),
            times: self.times.clone(),
            provenance: self.provenance.clone(),
        }
    }

    /// Appends the rows of another part of the same sweep.
    ///
    /// # Errors
    /// The parts do not belong to the same sweep.
    pub fn append(&mut self, part: Self) -> Result<(), Unmergeable> {
        let refuse = |what: &str, this: &str, other: &str| {
            Err(Unmergeable(format!("the parts differ in {what}: {this} and {other}")))
        };
        let (this, other) = (&self.provenance, &part.provenance);
        if this.digest != other.digest {
            return refuse("their specification (SHA-256)", &this.digest, &other.digest);
        }
        if this.version != other.version {
            return refuse("the version of the program", &this.version, &other.version);
        }
        if this.features != other.features {
            return refuse("the instructions of their machines", &this.features, &other.features);
        }
        let names =
            |table: &Self| table.columns.iter().map(|column| column.name.as_str()).collect::<Vec<_>>().join(", ");
        if self.members != part.members || names(self) != names(&part) {
            return refuse("their columns or members", &names(self), &names(&part));
        }
        self.failed += part.failed;
        for (column, other) in self.columns.iter_mut().zip(part.columns) {
            if !column.values.append(other.values) {
                return Err(Unmergeable(format!("the values of `{}` are of different kinds", column.name)));
            }
        }
        Ok(())
    }

    /// Sorts the rows by member.
    ///
    /// # Errors
    /// A member occurs in two rows.
    pub fn sort(&mut self) -> Result<(), Unmergeable> {
        let members: Vec<u64> =
            (0..self.rows()).map(|row| self.columns[0].values.number(row).unwrap_or(0.0) as u64).collect();
        if members.windows(2).all(|pair| pair[0] < pair[1]) {
            return Ok(());
        }
        let mut order: Vec<usize> = (0..members.len()).collect();
        order.sort_by_key(|row| members[*row]);
        if let Some(pair) = order.windows(2).find(|pair| members[pair[0]] == members[pair[1]]) {
            return Err(Unmergeable(format!("member {} has a row in two parts", members[pair[0]])));
        }
        for column in &mut self.columns {
            column.values = column.values.reordered(&order);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(all: &[Option<&str>]) -> Values {
        let mut words = Words::default();
        all.iter().for_each(|word| words.push(*word));
        Values::Words(words)
    }

    fn table(members: &[u32], numbers: &[f64], errors: &[Option<&str>]) -> Table {
        let column = |name: &str, values: Values| Column { name: name.to_owned(), values };
        Table {
            columns: vec![
                column("member", Values::Counts(members.iter().copied().collect())),
                column("x", Values::Numbers(numbers.to_vec())),
                column("error", words(errors)),
            ],
            members: 4,
            failed: errors.iter().flatten().count() as u64,
            swept: vec!["x".to_owned()],
            collected: Vec::new(),
            times: Vec::new(),
            provenance: TableProvenance { version: "1".to_owned(), ..TableProvenance::default() },
        }
    }

    #[test]
    fn what_is_missing_is_null_and_reads_back() {
        let table = table(&[0, 1, 2], &[1.5, f64::NAN, 3.0], &[None, Some("a"), None]);
        let json = serde_json::to_string(&table).unwrap();
        assert!(json.contains(r#""x":[1.5,null,3.0],"error":[null,"a",null]"#), "{json}");
        assert_eq!(serde_json::from_str::<Table>(&json).unwrap(), table);
    }

    #[test]
    fn parts_in_any_order_are_the_whole() {
        let whole = table(&[0, 1, 2, 3], &[0.5, 1.5, 2.5, 3.5], &[None, Some("b"), Some("a"), Some("b")]);
        let mut merged = table(&[1, 3], &[1.5, 3.5], &[Some("b"), Some("b")]);
        merged.append(table(&[0, 2], &[0.5, 2.5], &[None, Some("a")])).unwrap();
        merged.sort().unwrap();
        assert_eq!(merged, whole);
        assert_eq!(serde_json::to_string(&merged).unwrap(), serde_json::to_string(&whole).unwrap());
        // A column without any value has no type in its written form, and merges with a column of texts.
        let text = serde_json::to_string(&table(&[0, 2], &[0.5, 2.5], &[None, None])).unwrap();
        let mut merged: Table = serde_json::from_str(&text).unwrap();
        merged.append(table(&[1], &[1.5], &[Some("b")])).unwrap();
        merged.sort().unwrap();
        assert_eq!(merged, table(&[0, 1, 2], &[0.5, 1.5, 2.5], &[None, Some("b"), None]));
    }

    #[test]
    fn many_words_are_told_apart() {
        let mut words = Words::default();
        for k in 0..1000 {
            words.push(if k % 7 == 0 { None } else { Some("a") });
            words.push(Some(&format!("word {}", k % 300)));
        }
        for k in 0..1000 {
            assert_eq!(words.get(2 * k), if k % 7 == 0 { None } else { Some("a") });
            assert_eq!(words.get(2 * k + 1), Some(format!("word {}", k % 300).as_str()));
        }
        assert_eq!(words.get(2000), None);
    }

    #[test]
    fn mixtures_are_refused() {
        let whole = || table(&[0], &[0.5], &[None]);
        let refused = |part: Table| whole().append(part).unwrap_err().0;
        let mut part = whole();
        part.provenance.version = "2".to_owned();
        assert!(refused(part).contains("version"));
        let mut part = whole();
        part.provenance.digest = "f".to_owned();
        assert!(refused(part).contains("specification"));
        let mut twice = whole();
        twice.append(whole()).unwrap();
        assert!(twice.sort().unwrap_err().0.contains("member 0"));
    }
}
