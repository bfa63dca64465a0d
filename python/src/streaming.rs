//! The core for samples of one's own.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use tactile_pose_fusion::config::Config;
use tactile_pose_fusion::fusion::{
    Baseline, Event, Fusion, FusionError, JointSample, JointSourceIdx, SetupError, TactileBlock, TactileSourceIdx,
};
use tactile_pose_fusion::glove::{self, GloveError, known};
use tactile_pose_fusion::model::ModelInfo;
use tactile_pose_fusion::units::Stamp;
use tactile_pose_fusion::zero::from_file;

use crate::error::{Kind, exception, raise};
use crate::estimates::{Estimates, Track, take};
use crate::parameters::Parameters;
use crate::work;

/// A glove: parameters, and models that can be loaded.
#[pyclass(frozen, module = "tactile_pose_fusion._core")]
pub(crate) struct Glove {
    cfg: Config,
    notes: Vec<String>,
}

#[pymethods]
impl Glove {
    #[new]
    fn new(py: Python<'_>, parameters: &Parameters) -> PyResult<Self> {
        let cfg = parameters.config();
        let models = work::quietly(py, || glove::Models::load(&cfg).map_err(GloveError::from))?;
        let notes = models.runtimes(&cfg).into_iter().chain(models.notes(&cfg)).collect();
        Ok(Glove { cfg, notes })
    }

    /// What a person should know of its models, a line each.
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    /// Names of its tactile sources, each with its number of taxels.
    fn tactile_sources(&self) -> Vec<(String, usize)> {
        self.cfg.fusion().tactile_sources().iter().map(|source| (source.name.clone(), source.n_taxels)).collect()
    }

    /// Names of its joint sources.
    fn joint_sources(&self) -> Vec<String> {
        self.cfg.fusion().joint_sources().iter().map(|source| source.name.clone()).collect()
    }

    /// Names of its regions, each with its joints.
    fn regions(&self) -> Vec<(String, Vec<String>)> {
        self.cfg.fusion().regions().iter().map(|region| (region.name.clone(), region.joints.clone())).collect()
    }

    /// A core that has seen nothing yet.
    fn core(&self, py: Python<'_>, batch: usize) -> PyResult<Core> {
        let mut cfg = self.cfg.clone();
        let batch = NonZeroUsize::new(batch.min(4096)).unwrap_or(NonZeroUsize::MIN);
        cfg.set_batch(batch);
        let (fusion, infos) = work::quietly(py, || {
            let models = glove::Models::load(&cfg)?;
            let fusion = Fusion::new(cfg.fusion().clone(), models.regressors)?;
            Ok::<_, GloveError>((fusion, models.infos))
        })?;
        let tracks = vec![Track::default(); cfg.fusion().regions().len()];
        Ok(Core { state: Mutex::new(State { fusion, tracks }), cfg, infos })
    }
}

/// What turns samples into estimates.
#[pyclass(frozen, module = "tactile_pose_fusion._core")]
pub(crate) struct Core {
    state: Mutex<State>,
    cfg: Config,
    infos: Vec<ModelInfo>,
}

struct State {
    fusion: Fusion,
    /// `[regions]`: estimates that nobody has taken yet.
    tracks: Vec<Track>,
}

/// Taxels as they were sent.
struct Taxels {
    source: TactileSourceIdx,
    stamps: Vec<i64>,
    /// `[stamps, taxels]`, row-major.
    values: Vec<f32>,
}

/// Joint angles as they were sent.
struct Joints {
    source: JointSourceIdx,
    stamps: Vec<i64>,
    names: Vec<String>,
    /// `[stamps, names]`, row-major.
    positions: Vec<f64>,
}

impl State {
    /// Takes samples in the order of their stamps; joint angles go before taxels of the same time.
    fn feed(&mut self, cfg: &Config, taxels: Option<&Taxels>, joints: Option<&Joints>) -> Result<(), FusionError> {
        let taxel_at = |idx: usize| {
            let taxels = taxels.filter(|taxels| idx < taxels.stamps.len())?;
            Some(
                taxels.stamps[idx]
                    .saturating_add(cfg.fusion().tactile_sources()[taxels.source.position()].stamp_offset_ns),
            )
        };
        let joint_at = |idx: usize| {
            let joints = joints.filter(|joints| idx < joints.stamps.len())?;
            Some(
                joints.stamps[idx]
                    .saturating_add(cfg.fusion().joint_sources()[joints.source.position()].stamp_offset_ns),
            )
        };
        let (mut taxel_idx, mut joint_idx) = (0, 0);
        loop {
            match (taxel_at(taxel_idx), joint_at(joint_idx)) {
                (None, None) => return Ok(()),
                (Some(taxel), joint) if joint.is_none_or(|joint| taxel < joint) => {
                    self.handle_taxels(cfg, taxels, taxel_idx)?;
                    taxel_idx += 1;
                }
                _ => {
                    self.handle_joints(joints, joint_idx)?;
                    joint_idx += 1;
                }
            }
            self.drain()?;
        }
    }

    fn handle_taxels(&mut self, cfg: &Config, taxels: Option<&Taxels>, idx: usize) -> Result<(), FusionError> {
        let Some(taxels) = taxels else { return Ok(()) };
        let n_taxels = cfg.fusion().tactile_sources()[taxels.source.position()].n_taxels;
        let stamp = Stamp(taxels.stamps[idx]);
        let values = &taxels.values[idx * n_taxels..(idx + 1) * n_taxels];
        let (rows, row_period_ns, sequence) = (1, 0, None);
        let block =
            TactileBlock { source: taxels.source, stamp, rows, row_period_ns, sequence, values, received: stamp };
        self.fusion.handle(Event::Tactile(block))
    }

    fn handle_joints(&mut self, joints: Option<&Joints>, idx: usize) -> Result<(), FusionError> {
        let Some(Joints { source, stamps, names, positions }) = joints else { return Ok(()) };
        let (stamp, n_joints) = (Stamp(stamps[idx]), names.len());
        let positions = &positions[idx * n_joints..(idx + 1) * n_joints];
        self.fusion.handle(Event::Joints(JointSample { source: *source, stamp, names, positions, received: stamp }))
    }

    fn drain(&mut self) -> Result<(), FusionError> {
        while let Some(tick) = self.fusion.poll()? {
            take(&mut self.tracks, tick);
        }
        Ok(())
    }
}

#[pymethods]
impl Core {
    /// Takes what the taxels of a source read at rest.
    fn set_baseline(&self, py: Python<'_>, median: PyReadonlyArray1<'_, f32>, source: Option<&str>) -> PyResult<()> {
        let source = self.tactile_source(source)?;
        let baseline = Baseline::from_median(median.as_array().iter().copied().collect());
        let set = py.detach(|| self.state().fusion.handle_baseline(source, baseline));
        set.map_err(|error: SetupError| raise(&error))
    }

    /// Takes the zero of a calibration file; returns what a person should know, a line each.
    fn load_calibration(&self, py: Python<'_>, path: PathBuf) -> PyResult<Vec<String>> {
        let zero = work::quietly(py, || from_file(&path, &self.cfg, &known(&self.cfg, &self.infos)))?;
        let installed = py.detach(|| zero.install(&mut self.state().fusion));
        installed.map_err(|error| raise(&error))?;
        Ok(zero.notes)
    }

    /// Takes taxels, joint angles or both.
    #[pyo3(signature = (taxel_stamps, taxels, tactile_source, joint_stamps, positions, joint_names, joint_source))]
    #[allow(clippy::too_many_arguments)] // called by our own Python half alone
    fn feed(
        &self,
        py: Python<'_>,
        taxel_stamps: Option<PyReadonlyArray1<'_, i64>>,
        taxels: Option<PyReadonlyArray2<'_, f32>>,
        tactile_source: Option<&str>,
        joint_stamps: Option<PyReadonlyArray1<'_, i64>>,
        positions: Option<PyReadonlyArray2<'_, f64>>,
        joint_names: Vec<String>,
        joint_source: Option<&str>,
    ) -> PyResult<Estimates> {
        let taxels = taxel_stamps.zip(taxels).map(|(stamps, values)| {
            let source = self.tactile_source(tactile_source)?;
            let n_taxels = self.cfg.fusion().tactile_sources()[source.position()].n_taxels;
            shape("taxels", values.shape(), [stamps.len(), n_taxels])?;
            let stamps = stamps.as_array().iter().copied().collect();
            Ok::<_, PyErr>(Taxels { source, stamps, values: values.as_array().iter().copied().collect() })
        });
        let joints = joint_stamps.zip(positions).map(|(stamps, positions)| {
            let source = self.joint_source(joint_source)?;
            shape("joint angles", positions.shape(), [stamps.len(), joint_names.len()])?;
            let stamps = stamps.as_array().iter().copied().collect();
            let positions = positions.as_array().iter().copied().collect();
            Ok::<_, PyErr>(Joints { source, stamps, names: joint_names, positions })
        });
        let (taxels, joints) = (taxels.transpose()?, joints.transpose()?);
        self.told(py, |state| state.feed(&self.cfg, taxels.as_ref(), joints.as_ref()))
    }

    /// Estimates of all frames that are left, as no more samples come.
    fn finish(&self, py: Python<'_>) -> PyResult<Estimates> {
        self.told(py, |state| {
            state.fusion.handle_end();
            state.drain()
        })
    }
}

impl Core {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state and takes the estimates that came of it.
    fn told(
        &self,
        py: Python<'_>,
        change: impl FnOnce(&mut State) -> Result<(), FusionError> + Send,
    ) -> PyResult<Estimates> {
        let taken = py.detach(|| {
            let mut state = self.state();
            change(&mut state)?;
            Ok::<_, FusionError>(state.tracks.iter_mut().map(std::mem::take).collect::<Vec<_>>())
        });
        let names = self.cfg.fusion().regions().iter().map(|region| region.name.clone());
        Ok(Estimates::new(taken.map_err(|error| raise(&error))?, names))
    }

    fn tactile_source(&self, name: Option<&str>) -> PyResult<TactileSourceIdx> {
        let names = self.cfg.fusion().tactile_sources().iter().map(|source| source.name.as_str());
        source_idx("tactile", names.collect(), name).map(TactileSourceIdx::at)
    }

    fn joint_source(&self, name: Option<&str>) -> PyResult<JointSourceIdx> {
        let names = self.cfg.fusion().joint_sources().iter().map(|source| source.name.as_str());
        source_idx("joint", names.collect(), name).map(JointSourceIdx::at)
    }
}

/// The source of a name; without one, the only source.
fn source_idx(kind: &str, names: Vec<&str>, name: Option<&str>) -> PyResult<usize> {
    let known = names.join(", ");
    match name {
        None if names.len() == 1 => Ok(0),
        None => Err(exception(Kind::Parameter, format!("name one of the {kind} sources: {known}"))),
        Some(name) => names.iter().position(|known| *known == name).ok_or_else(|| {
            exception(Kind::Parameter, format!("there is no {kind} source {name}, expected one of: {known}"))
        }),
    }
}

fn shape(what: &str, got: &[usize], expected: [usize; 2]) -> PyResult<()> {
    if got == expected {
        return Ok(());
    }
    Err(exception(Kind::Parameter, format!("{what}: got the shape {got:?}, expected {expected:?}")))
}
