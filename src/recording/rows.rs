//! Model input frame by frame, from the windows that the fusion core passes to a model.

use std::collections::{BTreeMap, VecDeque};
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

use crate::fusion::{
    ArtifactModel, Contract, ForceAxes, ForceUnit, Forces, Fusion, FusionConfig, RegionIdx, RegressError, Regressor,
    SetupError, SharedWindows, Tick,
};
use crate::units::Stamp;

/// Model input of one region, one row per model frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Rows {
    /// `[n]`
    pub stamp: Vec<Stamp>,
    /// `[n, columns]` row-major: taxels with the baseline subtracted, and what the artifact filter knows of touch if the artifact
    /// model says that networks get it.
    pub tactile: Vec<f32>,
    /// `[n, P]` row-major, rad.
    pub pose: Vec<f32>,
    /// `[n]`: index that changes where frames are missing or unusable.
    pub stretch: Vec<u32>,
}

/// Takes the place of a model and records the windows that it gets.
///
/// # Invariant
/// Rows come from exactly the windows that a model with the same shape gets, with missing frames interpolated in the
/// same way.
#[derive(Debug)]
pub struct RowCollector {
    window: usize,
    n_columns: usize,
    n_joints: usize,
    windows: Receiver<(Vec<f32>, Vec<f32>)>,
    recent: VecDeque<(i64, Stamp)>,
    epoch: Option<u64>,
    last: Option<i64>,
    n_stretches: u32,
    rows: Rows,
}

#[derive(Debug)]
struct Tap {
    contract: Contract,
    windows: Sender<(Vec<f32>, Vec<f32>)>,
}

impl Regressor for Tap {
    fn contract(&self) -> &Contract {
        &self.contract
    }

    fn run(&mut self, windows: SharedWindows<'_>, out: &mut Forces) -> Result<(), RegressError> {
        let (window, n_columns, n_joints) =
            (self.contract.window.get(), self.contract.n_columns(), self.contract.n_joints);
        for &start in windows.starts {
            let of_window = |values: &[f32], width: usize| values[start * width..(start + window) * width].to_vec();
            let sent = self.windows.send((of_window(windows.tactile, n_columns), of_window(windows.pose, n_joints)));
            sent.map_err(|_| RegressError("the collector of model input is gone".to_owned()))?;
        }
        out.clear();
        out.force.resize(windows.starts.len(), 0.0);
        Ok(())
    }
}

impl RowCollector {
    /// A collector for the first region of a configuration, and the core that feeds it. The core still needs its
    /// baseline. With an artifact, the rows have corrected taxels and no pose.
    ///
    /// # Errors
    /// [`SetupError`] if there is no region, or if it doesn't fit its sources.
    pub fn new(
        cfg: FusionConfig,
        window: NonZeroUsize,
        rate_hz: f64,
        artifact: Option<Arc<ArtifactModel>>,
    ) -> Result<(Self, Fusion), SetupError> {
        let (got, n_regions) = (RegionIdx::at(0), cfg.regions().len());
        let cfg = cfg.only(got).ok_or(SetupError::UnknownRegion { got, n_regions })?;
        let cfg = cfg.with_one_model().with_batch(NonZeroUsize::MIN);
        let region = &cfg.regions()[0];
        let (n_taxels, n_joints) = (region.taxels.len(), if artifact.is_some() { 0 } else { region.joints.len() });
        let contract = Contract {
            window,
            n_taxels,
            n_joints,
            rate_hz,
            axes: ForceAxes::Normal,
            unit: ForceUnit::GramForce,
            has_base: false,
            touch: None,
            artifact,
            joints: None,
            pose_range: None,
            mdf: None,
            regions: BTreeMap::new(),
        };
        let n_columns = contract.n_columns();
        let (sender, windows) = channel();
        let fusion = Fusion::new(cfg, vec![Box::new(Tap { contract, windows: sender })])?;
        let collector = RowCollector {
            window: window.get(),
            n_columns,
            n_joints,
            windows,
            recent: VecDeque::new(),
            epoch: None,
            last: None,
            n_stretches: 0,
            rows: Rows::default(),
        };
        Ok((collector, fusion))
    }

    /// Processes a frame of the core.
    pub fn handle_tick(&mut self, tick: &Tick) {
        let Some(estimate) = tick.estimates.first() else { return };
        if self.epoch != Some(tick.epoch) {
            self.recent.clear();
            (self.epoch, self.last) = (Some(tick.epoch), None);
        }
        while self.recent.front().is_some_and(|(number, _)| tick.number - number > self.window as i64) {
            self.recent.pop_front();
        }
        self.recent.push_back((tick.number, tick.stamp));
        if estimate.force.is_none() {
            return;
        }
        let Ok((tactile, pose)) = self.windows.try_recv() else { return };
        let known = self.last.map(|last| tick.number - last).filter(|new| *new < self.window as i64);
        if known.is_none() {
            self.n_stretches += 1;
        }
        let n_new = known.map_or(self.window, |new| new.max(0) as usize);
        self.last = Some(tick.number);
        let skip = self.window - n_new;
        self.rows.tactile.extend_from_slice(&tactile[skip * self.n_columns..]);
        self.rows.pose.extend_from_slice(&pose[skip * self.n_joints..]);
        for back in (0..n_new as i64).rev() {
            self.rows.stamp.push(self.stamp_of(tick.number - back).unwrap_or(tick.stamp));
            self.rows.stretch.push(self.n_stretches);
        }
    }

    /// Stamp of a frame. If the frame was missing, its stamp is interpolated.
    fn stamp_of(&self, number: i64) -> Option<Stamp> {
        let after = self.recent.partition_point(|(known, _)| *known < number);
        let &(next, to) = self.recent.get(after)?;
        let Some(&(before, from)) = after.checked_sub(1).and_then(|idx| self.recent.get(idx)) else { return Some(to) };
        let share = (number - before) as f64 / (next - before) as f64;
        Some(from.offset((to.nanos_since(from) as f64 * share).round() as i64))
    }

    /// Returns the rows.
    pub fn finish(self) -> Rows {
        self.rows
    }
}
