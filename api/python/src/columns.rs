//! Columns of an answer in the hands of others, without a copy: numpy arrays and Arrow tables that keep the answer alive.
//!
//! The only unsafe code of the project but for foreign interfaces stands here. Its one assumption: an [`Answer`] is frozen and
//! its solution behind an [`Arc`], so that a column neither moves nor changes while someone holds either.
//!
//! [`Answer`]: super::answer::Answer

use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::{ArrayRef, Float64Array, RecordBatch, RecordBatchIterator};
use arrow_buffer::{Buffer, ScalarBuffer};
use arrow_schema::{ArrowError, DataType, Field, Schema};
use numpy::ndarray::ArrayView1;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyCapsule;
use solution::Solution;
use solution::encodings::Arrow;
use std::ptr::NonNull;
use std::sync::Arc;

/// A numpy array over `values`, which belong to `owner` for as long as it lives. It cannot be written to.
pub fn view<'py>(values: &[f64], owner: Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let values = ArrayView1::from(values);
    // SAFETY: `owner` is the answer that holds `values`, and the array holds `owner`.
    let array = unsafe { PyArray1::borrow_from_array(&values, owner) };
    let writer = array.try_readwrite().map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    Ok(writer.make_nonwriteable().as_any().clone())
}

/// The trajectory as a capsule that holds an Arrow stream.
pub fn stream<'py>(py: Python<'py>, solution: &Arc<Solution>) -> PyResult<Bound<'py, PyCapsule>> {
    let broken = |error: ArrowError| PyRuntimeError::new_err(error.to_string());
    let trajectory = &solution.trajectory;
    let named = trajectory.fields.iter().map(|field| (field.name.as_str(), &field.values));
    let (fields, columns): (Vec<Field>, Vec<ArrayRef>) = std::iter::once(("t", &trajectory.t))
        .chain(named)
        .map(|(name, values)| (Field::new(name, DataType::Float64, false), column(values, solution)))
        .unzip();
    let metadata = Arrow::with(&solution.verdict).of(solution.provenance.as_ref());
    let schema = Arc::new(Schema::new_with_metadata(fields, metadata.metadata().clone()));
    let batch = RecordBatch::try_new(Arc::clone(&schema), columns).map_err(broken)?;
    let batches = RecordBatchIterator::new([Ok(batch)], schema);
    PyCapsule::new_with_value(py, FFI_ArrowArrayStream::new(Box::new(batches)), c"arrow_array_stream")
}

/// A column of Arrow over `values`, which belong to `solution`.
fn column(values: &[f64], solution: &Arc<Solution>) -> ArrayRef {
    let start = NonNull::from(values).cast::<u8>();
    let owner = Arc::new(Arc::clone(solution));
    // SAFETY: `start` points to `size_of_val(values)` bytes that `solution` holds, which `owner` keeps alive and unchanged.
    let buffer = unsafe { Buffer::from_custom_allocation(start, size_of_val(values), owner) };
    Arc::new(Float64Array::new(ScalarBuffer::new(buffer, 0, values.len()), None))
}
