//! Matrices, dense or sparse, with entries that are constant expressions.

use super::error::SpecificationError;
use super::expression::Expression;
use super::lowering::Lowering;
use super::place::Place;
use serde::Deserialize;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, MapAccess, SeqAccess, Visitor};
use std::fmt;
use utoipa::PartialSchema;
use utoipa::ToSchema;
use utoipa::openapi::schema::{ArrayBuilder, OneOfBuilder, Schema};
use utoipa::openapi::{Ref, RefOr};

/// A matrix.
#[derive(Clone, Debug)]
pub enum Matrix {
    /// Its rows.
    Dense(Vec<Vec<Expression>>),
    /// Its nonzeros.
    Sparse(SparseMatrix),
}

/// A matrix by its nonzeros.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SparseMatrix {
    /// Rows and columns.
    pub shape: (usize, usize),
    /// `[row, column, value]`, counted from 0; a repeated place adds.
    pub entries: Vec<(usize, usize, Expression)>,
}

impl Matrix {
    /// The number of rows, as written.
    pub(super) fn rows(&self) -> usize {
        match self {
            Matrix::Dense(rows) => rows.len(),
            Matrix::Sparse(sparse) => sparse.shape.0,
        }
    }

    /// The number of columns, as written in the shape or in the first row.
    pub(super) fn columns(&self) -> usize {
        match self {
            Matrix::Dense(rows) => rows.first().map_or(0, Vec::len),
            Matrix::Sparse(sparse) => sparse.shape.1,
        }
    }

    /// The nonzero entries as `(row, column, value)`, sorted, each place once.
    pub(super) fn entries(
        &self,
        (rows, columns): (usize, usize),
        place: &Place<'_>,
        lowering: &mut Lowering,
    ) -> Vec<(usize, usize, f64)> {
        match self {
            Matrix::Dense(lines) => dense_entries(lines, (rows, columns), place, lowering),
            Matrix::Sparse(sparse) => sparse_entries(sparse, (rows, columns), place, lowering),
        }
    }
}

fn dense_entries(
    lines: &[Vec<Expression>],
    (rows, columns): (usize, usize),
    place: &Place<'_>,
    lowering: &mut Lowering,
) -> Vec<(usize, usize, f64)> {
    if lines.len() != rows {
        wrong_shape(place, format!("expected {rows} rows, got {}", lines.len()), rows, columns, lowering);
    }
    let mut entries = Vec::new();
    for (i, line) in lines.iter().enumerate() {
        let place = place.index(i);
        if line.len() != columns {
            let detail = format!("expected {columns} entries in this row, got {}", line.len());
            wrong_shape(&place, detail, rows, columns, lowering);
        }
        for (j, value) in line.iter().enumerate() {
            let value = lowering.constant(value, &place.index(j)).unwrap_or(0.0);
            if value != 0.0 {
                entries.push((i, j, value));
            }
        }
    }
    entries
}

fn sparse_entries(
    sparse: &SparseMatrix,
    (rows, columns): (usize, usize),
    place: &Place<'_>,
    lowering: &mut Lowering,
) -> Vec<(usize, usize, f64)> {
    let (found_rows, found_columns) = sparse.shape;
    if sparse.shape != (rows, columns) {
        let detail = format!("expected {rows} x {columns}, got {found_rows} x {found_columns}");
        wrong_shape(&place.key("shape"), detail, rows, columns, lowering);
    }
    let place = place.key("entries");
    let mut entries: Vec<(usize, usize, f64)> = Vec::with_capacity(sparse.entries.len());
    for (k, &(i, j, ref value)) in sparse.entries.iter().enumerate() {
        let place = place.index(k);
        if i >= found_rows || j >= found_columns {
            let detail = format!("({i}, {j}) lies outside a matrix of {found_rows} x {found_columns}");
            lowering.errors.push(
                SpecificationError::new(place.to_string(), "index_out_of_range", detail)
                    .expected("rows and columns counted from 0"),
            );
        }
        let value = lowering.constant(value, &place.index(2)).unwrap_or(0.0);
        entries.push((i, j, value));
    }
    entries.sort_by_key(|&(i, j, _)| (i, j));
    entries.dedup_by(|next, kept| {
        let same = (next.0, next.1) == (kept.0, kept.1);
        if same {
            kept.2 += next.2;
        }
        same
    });
    entries.retain(|&(_, _, value)| value != 0.0);
    entries
}

fn wrong_shape(place: &Place<'_>, detail: String, rows: usize, columns: usize, lowering: &mut Lowering) {
    let error = SpecificationError::new(place.to_string(), "wrong_shape", detail);
    lowering.errors.push(error.expected(format!("{rows} x {columns}")));
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

impl<'de> Visitor<'de> for MatrixVisitor {
    type Value = Matrix;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a matrix: a list of rows, or {\"shape\": [r, c], \"entries\": [[i, j, value], ...]}")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, access: A) -> Result<Matrix, A::Error> {
        Vec::deserialize(SeqAccessDeserializer::new(access)).map(Matrix::Dense)
    }

    fn visit_map<A: MapAccess<'de>>(self, access: A) -> Result<Matrix, A::Error> {
        SparseMatrix::deserialize(MapAccessDeserializer::new(access)).map(Matrix::Sparse)
    }
}
