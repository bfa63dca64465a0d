//! Estimates as columns: for NumPy in place, for Arrow as batches of the same memory.

use std::sync::Arc;

use arrow_array::types::{Float64Type, TimestampNanosecondType, UInt8Type, UInt32Type};
use arrow_array::{
    ArrayRef, ArrowPrimitiveType, BooleanArray, PrimitiveArray, RecordBatch, StringArray, StructArray,
    TimestampNanosecondArray,
};
use arrow_buffer::{Buffer, NullBuffer, ScalarBuffer};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef, TimeUnit};
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyDict, PyTuple};
use pyo3_arrow::error::PyArrowResult;
use pyo3_arrow::ffi::{ArrayIterator, to_schema_pycapsule, to_stream_pycapsule};
use tactile_pose_fusion::fusion::{Adaptation, ContactEvent, Estimate, Tick};
use tactile_pose_fusion::units::Newton;

use crate::error::{Kind, exception};

/// The estimates of one region while they come.
///
/// # Shapes
/// `[frames]` each.
#[derive(Debug, Default, Clone)]
pub(crate) struct Track {
    stamp_ns: Vec<i64>,
    force_n: Vec<f64>,
    tangential_n: [Vec<f64>; 3],
    base_n: Vec<f64>,
    artifact_n: Vec<f64>,
    touch: Vec<f64>,
    contact: Vec<u8>,
    contact_raw: Vec<u8>,
    event: Vec<u8>,
    since_ns: Vec<i64>,
    pose_age_ms: Vec<f64>,
    adaptation: Vec<u8>,
    artifact_change: Vec<f64>,
    flags: Vec<u32>,
}

/// `[regions]`: tracks that take what the core says of a frame.
pub(crate) fn take(tracks: &mut [Track], tick: &Tick) {
    for estimate in &tick.estimates {
        tracks[estimate.region.position()].handle(tick.stamp.0, estimate);
    }
}

impl Track {
    fn handle(&mut self, stamp_ns: i64, estimate: &Estimate) {
        let newtons = |force: Option<Newton>| force.map_or(f64::NAN, |force| force.0);
        self.stamp_ns.push(stamp_ns);
        self.force_n.push(newtons(estimate.force));
        for (axis, column) in self.tangential_n.iter_mut().enumerate() {
            column.push(newtons(estimate.tangential.map(|force| force[axis])));
        }
        self.base_n.push(newtons(estimate.force_base));
        self.artifact_n.push(newtons(estimate.artifact()));
        self.touch.push(estimate.touch.unwrap_or(f64::NAN));
        self.contact.push(estimate.contact.state.into());
        self.contact_raw.push(estimate.contact.raw.into());
        self.event.push(match estimate.contact.event {
            ContactEvent::None => 0,
            ContactEvent::Onset => 1,
            ContactEvent::Offset => 2,
        });
        self.since_ns.push(estimate.contact.since.0);
        self.pose_age_ms.push(estimate.pose_age_ns.map_or(f64::NAN, |age| age as f64 / 1e6));
        self.adaptation.push(match estimate.adaptation {
            Adaptation::Off => 0,
            Adaptation::Frozen => 1,
            Adaptation::Learning => 2,
            Adaptation::Waiting => 3,
            Adaptation::Capped => 4,
            Adaptation::Noisy => 5,
        });
        self.artifact_change.push(estimate.artifact_change.unwrap_or(f64::NAN));
        self.flags.push(estimate.flags.bits());
    }

    fn into_region(self, name: String) -> Region {
        let n_frames = self.stamp_ns.len();
        let column = |name: &'static str, typestr: &'static str, buffer: Buffer| {
            (name, Column { buffer, typestr, len: n_frames })
        };
        let numbers = |name, values: Vec<f64>| column(name, "<f8", Buffer::from_vec(values));
        let bytes = |name, typestr, values: Vec<u8>| column(name, typestr, Buffer::from_vec(values));
        let [tangential_x_n, tangential_y_n, tangential_z_n] = self.tangential_n;
        let columns = vec![
            column("stamp_ns", "<i8", Buffer::from_vec(self.stamp_ns)),
            numbers("force_n", self.force_n),
            numbers("tangential_x_n", tangential_x_n),
            numbers("tangential_y_n", tangential_y_n),
            numbers("tangential_z_n", tangential_z_n),
            numbers("base_n", self.base_n),
            numbers("artifact_n", self.artifact_n),
            numbers("touch", self.touch),
            bytes("contact", "|b1", self.contact),
            bytes("contact_raw", "|b1", self.contact_raw),
            bytes("event", "|u1", self.event),
            column("since_ns", "<i8", Buffer::from_vec(self.since_ns)),
            numbers("pose_age_ms", self.pose_age_ms),
            bytes("adaptation", "|u1", self.adaptation),
            numbers("artifact_change", self.artifact_change),
            column("flags", "<u4", Buffer::from_vec(self.flags)),
        ];
        Region { name, n_frames, columns }
    }
}

/// One column of one region, whose memory NumPy reads in place.
#[pyclass(frozen, module = "tactile_pose_fusion._core")]
#[derive(Debug, Clone)]
pub(crate) struct Column {
    buffer: Buffer,
    typestr: &'static str,
    len: usize,
}

#[pymethods]
impl Column {
    /// NumPy's array interface, version 3: read-only memory that lives as long as this object.
    #[getter]
    fn __array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let interface = PyDict::new(py);
        interface.set_item("version", 3)?;
        interface.set_item("shape", (self.len,))?;
        interface.set_item("typestr", self.typestr)?;
        interface.set_item("data", (self.buffer.as_ptr() as usize, true))?;
        Ok(interface)
    }
}

impl Column {
    fn values<T: ArrowPrimitiveType>(&self) -> ScalarBuffer<T::Native> {
        ScalarBuffer::new(self.buffer.clone(), 0, self.len)
    }

    fn primitive<T: ArrowPrimitiveType>(&self) -> PrimitiveArray<T> {
        PrimitiveArray::new(self.values::<T>(), None)
    }

    /// The column for Arrow: of the same memory, where there is no value null, but flags, which Arrow packs.
    fn to_arrow(&self) -> ArrayRef {
        match self.typestr {
            "<f8" => {
                let values = self.values::<Float64Type>();
                let is_known: Vec<bool> = values.iter().map(|value| !value.is_nan()).collect();
                let nulls = is_known.contains(&false).then(|| NullBuffer::from(is_known));
                Arc::new(PrimitiveArray::<Float64Type>::new(values, nulls))
            }
            "<i8" => Arc::new(stamps(self.primitive::<TimestampNanosecondType>())),
            "<u4" => Arc::new(self.primitive::<UInt32Type>()),
            "|b1" => Arc::new(BooleanArray::from_iter(self.buffer.iter().map(|byte| Some(*byte != 0)))),
            _ => Arc::new(self.primitive::<UInt8Type>()),
        }
    }
}

fn stamps(nanoseconds: TimestampNanosecondArray) -> TimestampNanosecondArray {
    nanoseconds.with_timezone("UTC")
}

/// The estimates of one region.
#[derive(Debug)]
struct Region {
    name: String,
    n_frames: usize,
    columns: Vec<(&'static str, Column)>,
}

impl Region {
    fn to_batch(&self) -> Result<RecordBatch, ArrowError> {
        let names: ArrayRef = Arc::new(StringArray::from_iter_values(std::iter::repeat_n(&self.name, self.n_frames)));
        let columns = self.columns.iter().map(|(_, column)| column.to_arrow());
        RecordBatch::try_new(schema(), std::iter::once(names).chain(columns).collect())
    }
}

/// The table of every region.
fn schema() -> SchemaRef {
    let stamp = || DataType::Timestamp(TimeUnit::Nanosecond, Some("UTC".into()));
    let fields = [
        ("region", DataType::Utf8),
        ("stamp", stamp()),
        ("force_n", DataType::Float64),
        ("tangential_x_n", DataType::Float64),
        ("tangential_y_n", DataType::Float64),
        ("tangential_z_n", DataType::Float64),
        ("base_n", DataType::Float64),
        ("artifact_n", DataType::Float64),
        ("touch", DataType::Float64),
        ("contact", DataType::Boolean),
        ("contact_raw", DataType::Boolean),
        ("event", DataType::UInt8),
        ("since", stamp()),
        ("pose_age_ms", DataType::Float64),
        ("adaptation", DataType::UInt8),
        ("artifact_change", DataType::Float64),
        ("flags", DataType::UInt32),
    ];
    let fields = fields.map(|(name, kind)| {
        let may_lack = kind == DataType::Float64;
        Field::new(name, kind, may_lack)
    });
    Arc::new(Schema::new(fields.to_vec()))
}

/// Estimates of all regions.
#[pyclass(frozen, module = "tactile_pose_fusion._core")]
#[derive(Debug)]
pub(crate) struct Estimates {
    regions: Vec<Arc<Region>>,
}

impl Estimates {
    /// Those of tracks; `names`: `[regions]`.
    pub(crate) fn new(tracks: Vec<Track>, names: impl IntoIterator<Item = String>) -> Self {
        let regions = tracks.into_iter().zip(names).map(|(track, name)| Arc::new(track.into_region(name)));
        Estimates { regions: regions.collect() }
    }

    fn region(&self, idx: usize) -> PyResult<&Region> {
        let n = self.regions.len();
        let region = self.regions.get(idx).map(Arc::as_ref);
        region.ok_or_else(|| exception(Kind::Parameter, format!("region {idx}: there are {n}")))
    }
}

#[pymethods]
impl Estimates {
    /// Names of the regions, in the order of the parameters.
    fn regions(&self) -> Vec<String> {
        self.regions.iter().map(|region| region.name.clone()).collect()
    }

    /// Frames of a region.
    fn n_frames(&self, region_idx: usize) -> PyResult<usize> {
        Ok(self.region(region_idx)?.n_frames)
    }

    /// A column of a region, for `numpy.asarray`.
    fn column(&self, region_idx: usize, name: &str) -> PyResult<Column> {
        let found = self.region(region_idx)?.columns.iter().find(|(known, _)| *known == name);
        let column = found.map(|(_, column)| column.clone());
        column.ok_or_else(|| exception(Kind::Parameter, format!("there is no column {name}")))
    }

    /// The estimates of one region alone.
    fn of_region(&self, region_idx: usize) -> PyResult<Self> {
        self.region(region_idx)?;
        Ok(Estimates { regions: vec![self.regions[region_idx].clone()] })
    }

    fn __arrow_c_schema__<'py>(&self, py: Python<'py>) -> PyArrowResult<Bound<'py, PyCapsule>> {
        to_schema_pycapsule(py, schema().as_ref())
    }

    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyCapsule>>,
    ) -> PyArrowResult<Bound<'py, PyCapsule>> {
        let regions = self.regions.clone();
        let batches = regions.into_iter().map(|region| Ok(Arc::new(StructArray::from(region.to_batch()?)) as ArrayRef));
        let field = Arc::new(Field::new_struct("", schema().fields().clone(), false));
        to_stream_pycapsule(py, Box::new(ArrayIterator::new(batches, field)), requested_schema)
    }

    /// The only region as one array of structs.
    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_array__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyCapsule>>,
    ) -> PyArrowResult<Bound<'py, PyTuple>> {
        let batches = self.regions.iter().map(|region| region.to_batch()).collect::<Result<Vec<_>, _>>()?;
        let [batch] = batches.as_slice() else {
            let line = "estimates of several regions are a stream of arrays, not one".to_owned();
            return Err(exception(Kind::Parameter, line).into());
        };
        let field = Arc::new(Field::new_struct("", schema().fields().clone(), false));
        pyo3_arrow::ffi::to_array_pycapsules(py, field, &StructArray::from(batch.clone()), requested_schema)
    }
}
