//! Measures how far the joints move during a live calibration.

use std::collections::BTreeMap;

use super::ZeroError;
use crate::config::Config;

/// No joint of a hand moves further than this, rad: one turn.
const MAX_SPAN: f64 = std::f64::consts::TAU;

/// Range of motion of each joint.
#[derive(Debug, Clone, Default)]
pub struct Movement {
    spans: BTreeMap<String, (f64, f64)>,
}

impl Movement {
    /// Adds joint angles, multiplied by `scale` to give rad. Those that are not finite are ignored.
    ///
    /// # Shapes
    /// `names`, `positions`: `[joints of the message]`.
    pub fn handle(&mut self, names: &[String], positions: &[f64], scale: f64) {
        for (name, position) in names.iter().zip(positions).filter(|(_, position)| position.is_finite()) {
            let angle = position * scale;
            match self.spans.get_mut(name) {
                Some((low, high)) => (*low, *high) = (low.min(angle), high.max(angle)),
                None => {
                    self.spans.insert(name.clone(), (angle, angle));
                }
            }
        }
    }

    /// Names of the joints and their range of motion, rad, sorted by name.
    pub fn spans(&self) -> (Vec<String>, Vec<f64>) {
        self.spans.iter().map(|(name, (low, high))| (name.clone(), high - low)).unzip()
    }

    /// Refuses joints that moved further than a joint can. It can be called at any time during a calibration.
    ///
    /// # Errors
    /// [`ZeroError::TooFar`].
    pub fn check_range(&self, cfg: &Config) -> Result<(), ZeroError> {
        for region in cfg.fusion().regions() {
            for joint in &region.joints {
                let span = self.spans.get(joint).map_or(0.0, |(low, high)| high - low);
                if span > MAX_SPAN {
                    let (region, joint) = (region.name.clone(), joint.clone());
                    return Err(ZeroError::TooFar { region, joint, degrees: span.to_degrees() });
                }
            }
        }
        Ok(())
    }

    /// Refuses a hand that hardly moved, whose baseline would be that of a single pose, and joints that moved too far.
    ///
    /// # Errors
    /// [`ZeroError::NoAngles`], [`ZeroError::Still`], [`ZeroError::TooFar`].
    pub fn check(&self, cfg: &Config) -> Result<(), ZeroError> {
        self.check_range(cfg)?;
        let needed_rad = cfg.calibration.min_joint_span;
        let span = |joint: &String| self.spans.get(joint).map(|(low, high)| high - low);
        for region in cfg.fusion().regions().iter().filter(|region| needed_rad > 0.0 && !region.joints.is_empty()) {
            if region.joints.iter().filter_map(span).next().is_none() {
                return Err(ZeroError::NoAngles { region: region.name.clone() });
            }
            let moved_rad = region.joints.iter().filter_map(span).fold(0.0, f64::max);
            if moved_rad < needed_rad {
                return Err(ZeroError::Still { region: region.name.clone(), moved_rad, needed_rad });
            }
        }
        Ok(())
    }
}
