//! Views of the columns of a result without a copy: numpy arrays and Arrow tables that keep the result alive.
//!
//! Apart from foreign interfaces, this module has the only unsafe code of the project. The code relies on one
//! property: an [`Answer`] is frozen and its solution is behind an [`Arc`], so that a column neither moves nor
//! changes while a view of the column exists.
//!
//! [`Answer`]: super::answer::Answer

use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::{ArrayRef, Float64Array, RecordBatch, RecordBatchIterator};
use arrow_buffer::{BooleanBuffer, Buffer, NullBuffer, ScalarBuffer};
use arrow_schema::{ArrowError, DataType, Field, Schema};
use numpy::ndarray::{ArrayView, ArrayView1, ArrayView2, Dimension};
use numpy::{Element, PyArray, PyArray1, PyArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyCapsule;
use solution::encodings::{Arrow, array, schema_of_members};
use solution::{Solution, Table, Values};
use std::ptr::NonNull;
use std::sync::Arc;

/// Returns a read-only numpy array over `values`, which `owner` holds for as long as `owner` lives.
pub fn view<'py, T: Element>(values: &[T], owner: Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    over(&ArrayView1::from(values), owner)
}

/// Returns a read-only numpy array, with any number of axes, over `values`, which `owner` holds for as long as
/// `owner` lives.
fn over<'py, T: Element, D: Dimension>(
    values: &ArrayView<'_, T, D>,
    owner: Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    // SAFETY: `owner` is the answer that holds `values`, and the array holds `owner`.
    frozen(unsafe { PyArray::borrow_from_array(values, owner) })
}

/// Makes a numpy array read-only.
fn frozen<T: Element, D: Dimension>(array: Bound<'_, PyArray<T, D>>) -> PyResult<Bound<'_, PyAny>> {
    let writer = array.try_readwrite().map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    Ok(writer.make_nonwriteable().as_any().clone())
}

/// Returns a column of the table of a sweep. Numbers (NaN for missing ones), flags, and lists of numbers (one list
/// per row) are views; counts, which the table stores packed, are copied into an array (`0xFFFFFFFF` for missing
/// ones); words are a Python list (None for missing ones).
pub fn view_of_table<'py>(values: &Values, owner: Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    match values {
        Values::Numbers(numbers) => view(numbers, owner),
        Values::Counts(counts) => frozen(PyArray1::from_vec(owner.py(), counts.iter().collect())),
        Values::Flags(flags) => view(flags, owner),
        Values::Words(words) => {
            let words: Vec<Option<&str>> = (0..values.len()).map(|row| words.get(row)).collect();
            words.into_pyobject(owner.py())
        }
        Values::Lists(lists) => {
            let rows = ArrayView2::from_shape((lists.len(), lists.length()), lists.values());
            over(&rows.map_err(|error| PyRuntimeError::new_err(error.to_string()))?, owner)
        }
    }
}

/// Returns the trajectory, or the table of a sweep, as a capsule that holds an Arrow stream.
pub fn stream<'py>(py: Python<'py>, solution: &Arc<Solution>) -> PyResult<Bound<'py, PyCapsule>> {
    let (schema, columns) = match &solution.table {
        Some(table) => (schema_of_members(table, &solution.verdict), members(table, solution)),
        None => trajectory(solution),
    };
    let schema = Arc::new(schema);
    let broken = |error: ArrowError| PyRuntimeError::new_err(error.to_string());
    let batch = RecordBatch::try_new(Arc::clone(&schema), columns).map_err(broken)?;
    let batches = RecordBatchIterator::new([Ok(batch)], schema);
    PyCapsule::new_with_value(py, FFI_ArrowArrayStream::new(Box::new(batches)), c"arrow_array_stream")
}

fn trajectory(solution: &Arc<Solution>) -> (Schema, Vec<ArrayRef>) {
    let trajectory = &solution.trajectory;
    let named = trajectory.fields.iter().map(|field| (field.name.as_str(), &field.values));
    let (fields, columns): (Vec<Field>, Vec<ArrayRef>) = std::iter::once(("t", &trajectory.t))
        .chain(named)
        .map(|(name, values)| {
            let column: ArrayRef = Arc::new(column(values, None, solution));
            (Field::new(name, DataType::Float64, false), column)
        })
        .unzip();
    let metadata = Arrow::with(&solution.verdict).of(solution.provenance.as_ref());
    (Schema::new_with_metadata(fields, metadata.metadata().clone()), columns)
}

/// Returns the columns of a sweep: those of numbers without a copy, with a validity bit per row if any number is
/// missing; all others are copied, since Arrow stores them in another layout than the table.
fn members(table: &Table, solution: &Arc<Solution>) -> Vec<ArrayRef> {
    let of = |values: &Values| match values {
        Values::Numbers(numbers) => {
            let is_missing = |row: usize| values.is_missing(row);
            let missing = (0..values.len())
                .any(is_missing)
                .then(|| NullBuffer::new(BooleanBuffer::collect_bool(values.len(), |row| !is_missing(row))));
            Arc::new(column(numbers, missing, solution)) as ArrayRef
        }
        _ => array(values),
    };
    table.columns.iter().map(|column| of(&column.values)).collect()
}

/// Returns an Arrow column over `values`, which `solution` holds.
fn column(values: &[f64], missing: Option<NullBuffer>, solution: &Arc<Solution>) -> Float64Array {
    let start = NonNull::from(values).cast::<u8>();
    let owner = Arc::new(Arc::clone(solution));
    // SAFETY: `start` points to `size_of_val(values)` bytes that `solution` holds, and `owner` keeps `solution` alive and
    // unchanged.
    let buffer = unsafe { Buffer::from_custom_allocation(start, size_of_val(values), owner) };
    Float64Array::new(ScalarBuffer::new(buffer, 0, values.len()), missing)
}
