//! Matrices, dense or sparse, with entries that are constant expressions.

use super::error::SpecificationError;
use super::expression::Expression;
use super::lowering::{Constant, Lowering};
use super::pointer::Pointer;
use expression::{Assumption, Node};
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, Error, IntoDeserializer, MapAccess, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Serialize};
use std::fmt;
use utoipa::PartialSchema;
use utoipa::ToSchema;
use utoipa::openapi::schema::{ArrayBuilder, OneOfBuilder, Schema};
use utoipa::openapi::{Ref, RefOr};

/// A matrix of constant expressions in a specification, dense or sparse.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum Matrix {
    /// A dense matrix: the list of its rows.
    Dense(Vec<Vec<Expression>>),
    /// A sparse matrix: the list of its nonzero entries.
    Sparse(SparseMatrix),
}

/// A matrix given by its nonzero entries.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SparseMatrix {
    /// Number of rows and number of columns of the matrix.
    pub shape: (usize, usize),
    /// Entries `[row, column, value]`, counted from 0; repeated entries are added.
    pub entries: Vec<(usize, usize, Expression)>,
}

/// The nonzero entries of a matrix of constants, sorted, without repetition.
#[derive(Debug, Default)]
pub(super) struct Entries {
    /// The nonzero entries as `(row, column, value)`.
    pub values: Vec<(usize, usize, f64)>,
    /// The graph nodes of those matrix entries that depend on parameters.
    pub terms: Vec<(usize, usize, Node)>,
}

impl Matrix {
    /// The number of rows of the matrix, as the user has written it.
    pub(super) fn rows(&self) -> usize {
        match self {
            Matrix::Dense(rows) => rows.len(),
            Matrix::Sparse(sparse) => sparse.shape.0,
        }
    }

    /// The number of columns of the matrix, from the shape or the first row.
    pub(super) fn columns(&self) -> usize {
        match self {
            Matrix::Dense(rows) => rows.first().map_or(0, Vec::len),
            Matrix::Sparse(sparse) => sparse.shape.1,
        }
    }

    /// Returns the nonzero entries of the matrix as `(row, column, value)`, sorted, without repetition; parameters in
    /// the entries keep their values.
    pub(super) fn entries(
        &self,
        shape: (usize, usize),
        place: &Pointer<'_>,
        lowering: &mut Lowering,
    ) -> Vec<(usize, usize, f64)> {
        let Entries { values, terms } = self.parametric(shape, place, lowering);
        terms.into_iter().for_each(|(.., node)| lowering.graph.assume(node, Assumption::Value));
        values
    }

    /// Returns the entries of the matrix that are not [absent](expression::Graph::is_absent), with the graph nodes of
    /// those that depend on parameters.
    pub(super) fn parametric(&self, shape: (usize, usize), place: &Pointer<'_>, lowering: &mut Lowering) -> Entries {
        let mut entries: Vec<(usize, usize, Constant)> = Vec::new();
        self.for_each(shape, place, lowering, |i, j, value, place, lowering| {
            let constant = lowering.parametric(value, place).unwrap_or(Constant { value: 0.0, node: None });
            entries.push((i, j, constant));
        });
        entries.sort_by_key(|&(i, j, _)| (i, j));
        entries.dedup_by(|next, kept| {
            let same = (next.0, next.1) == (kept.0, kept.1);
            if same {
                kept.2 = lowering.sum(kept.2, next.2);
            }
            same
        });
        entries.retain(|(.., constant)| match constant.node {
            Some(node) => !lowering.graph.is_absent(node),
            None => constant.value != 0.0,
        });
        let values = entries.iter().map(|&(i, j, constant)| (i, j, constant.value)).collect();
        let terms = entries.iter().filter_map(|&(i, j, constant)| Some((i, j, constant.node?))).collect();
        Entries { values, terms }
    }

    /// Returns all entries of the matrix row by row, as expressions that may vary in time.
    pub(super) fn nodes(&self, shape: (usize, usize), place: &Pointer<'_>, lowering: &mut Lowering) -> Vec<Node> {
        let (rows, columns) = shape;
        let mut nodes = vec![lowering.graph.constant(0.0); rows * columns];
        self.for_each(shape, place, lowering, |i, j, value, place, lowering| {
            if i < rows
                && j < columns
                && let Some(node) = lowering.node(value, place)
            {
                nodes[i * columns + j] = lowering.graph.add(nodes[i * columns + j], node);
            }
        });
        nodes
    }

    /// Checks the shape of the matrix, and calls `visit` for each of its entries.
    fn for_each(
        &self,
        (rows, columns): (usize, usize),
        place: &Pointer<'_>,
        lowering: &mut Lowering,
        mut visit: impl FnMut(usize, usize, &Expression, &Pointer<'_>, &mut Lowering),
    ) {
        match self {
            // Accept a column in place of a row: some programs write vectors without an orientation.
            Matrix::Dense(lines)
                if rows == 1 && columns > 1 && lines.len() == columns && lines.iter().all(|line| line.len() == 1) =>
            {
                for (j, value) in lines.iter().flatten().enumerate() {
                    visit(0, j, value, &place.index(j), lowering);
                }
            }
            Matrix::Dense(lines) => {
                if lines.len() != rows {
                    let detail = format!("expected {rows} rows, got {}", lines.len());
                    wrong_shape(place, detail, rows, columns, lowering);
                }
                for (i, line) in lines.iter().enumerate() {
                    let place = place.index(i);
                    if line.len() != columns {
                        let detail = format!("expected {columns} entries in this row, got {}", line.len());
                        wrong_shape(&place, detail, rows, columns, lowering);
                    }
                    for (j, value) in line.iter().enumerate() {
                        visit(i, j, value, &place.index(j), lowering);
                    }
                }
            }
            Matrix::Sparse(sparse) => {
                let (found_rows, found_columns) = sparse.shape;
                if sparse.shape != (rows, columns) {
                    let detail = format!("expected {rows} x {columns}, got {found_rows} x {found_columns}");
                    wrong_shape(&place.key("shape"), detail, rows, columns, lowering);
                }
                let place = place.key("entries");
                for (k, &(i, j, ref value)) in sparse.entries.iter().enumerate() {
                    let place = place.index(k);
                    if i >= found_rows || j >= found_columns {
                        let detail = format!("({i}, {j}) is outside a matrix of {found_rows} x {found_columns}");
                        lowering.errors.push(
                            SpecificationError::new(place.to_string(), "index_out_of_range", detail)
                                .expected("rows and columns counted from 0"),
                        );
                    }
                    visit(i, j, value, &place.index(2), lowering);
                }
            }
        }
    }
}

fn wrong_shape(place: &Pointer<'_>, detail: String, rows: usize, columns: usize, lowering: &mut Lowering) {
    let error = SpecificationError::new(place.to_string(), "wrong_shape", detail);
    let row = format!("[{}]", vec![".."; columns.min(SHOWN)].join(", "));
    let shown = format!("[{}]", vec![row; rows.min(SHOWN)].join(", "));
    let example = if rows.max(columns) <= SHOWN { format!(", as `{shown}`") } else { String::new() };
    lowering.errors.push(error.expected(format!("{rows} x {columns}{example}")));
}

impl PartialSchema for Matrix {
    fn schema() -> RefOr<Schema> {
        let row = ArrayBuilder::new().items(Ref::from_schema_name("Expression"));
        OneOfBuilder::new()
            .item(ArrayBuilder::new().items(row))
            .item(Ref::from_schema_name("SparseMatrix"))
            .description(Some(
                "Dense as a list of rows, or sparse as `{\"shape\": [r, c], \"entries\": [[i, j, value], ...]}`.",
            ))
            .into()
    }
}

impl ToSchema for Matrix {
    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.push((SparseMatrix::name().into_owned(), SparseMatrix::schema()));
        SparseMatrix::schemas(schemas);
    }
}

impl<'de> Deserialize<'de> for Matrix {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(MatrixVisitor)
    }
}

struct MatrixVisitor;

/// Largest number of rows and columns of the example of a matrix that an error message shows.
const SHOWN: usize = 4;

/// Reads a scalar in place of a matrix as a matrix of one entry.
fn alone<'de, E: Error>(entry: impl Deserializer<'de, Error = E>) -> Result<Matrix, E> {
    Expression::deserialize(entry).map(|entry| Matrix::Dense(vec![vec![entry]]))
}

impl<'de> Visitor<'de> for MatrixVisitor {
    type Value = Matrix;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a matrix: a list of rows, or {\"shape\": [r, c], \"entries\": [[i, j, value], ...]}")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Matrix, E> {
        alone(value.into_deserializer())
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Matrix, E> {
        alone(value.into_deserializer())
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Matrix, E> {
        alone(value.into_deserializer())
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Matrix, E> {
        match text.trim_start().starts_with(['[', '{']) {
            true => Err(E::invalid_type(Unexpected::Str(text), &self)),
            false => alone(text.into_deserializer()),
        }
    }

    fn visit_seq<A: SeqAccess<'de>>(self, access: A) -> Result<Matrix, A::Error> {
        Vec::deserialize(SeqAccessDeserializer::new(access)).map(Matrix::Dense)
    }

    fn visit_map<A: MapAccess<'de>>(self, access: A) -> Result<Matrix, A::Error> {
        SparseMatrix::deserialize(MapAccessDeserializer::new(access)).map(Matrix::Sparse)
    }
}
