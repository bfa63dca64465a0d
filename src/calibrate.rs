//! The zero of a donning from its recording: bags in, a calibration out, judged by the models that will use it.

use std::path::PathBuf;

use crate::bag::{BagError, BagReader, Input, InputError, Inputs};
use crate::calibration::Calibration;
use crate::config::Config;
use crate::fusion::{Fusion, FusionError, SetupError};
use crate::glove::{Models, known};
use crate::model::ModelError;
use crate::observer::{Cancelled, Observer, check};
use crate::recording::input_topics;
use crate::sessions::{InAir, KnownForces, RegionTouches, SessionError, annotated, force_gains};
use crate::zero::{self, LoadCheck, Wanted, ZeroError, ZeroFrom};

/// What a calibration is taken from.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    /// MCAP or `.db3` files or bag folders: one recording; several are parts of one, merged by time.
    pub bags: &'a [PathBuf],
    /// The first seconds, in which nothing touches the glove, instead of annotated zero-load stretches.
    pub first_s: Option<f64>,
    /// What tells when nothing touches the glove, in place of the annotations of the recording.
    pub in_air: Option<&'a InAir>,
    /// Touches of a known force, which fit what forces are multiplied by; `None` for no such gain.
    pub known_forces: Option<KnownForces>,
}

impl<'a> Request<'a> {
    /// The annotated zero-load stretches of a recording, and no gain.
    pub fn new(bags: &'a [PathBuf]) -> Self {
        Request { bags, first_s: None, in_air: None, known_forces: None }
    }
}

/// A calibration and where it is from.
#[derive(Debug)]
pub struct Calibrated {
    /// What is kept in a file: [`Calibration::save`].
    pub calibration: Calibration,
    /// Where the zero is from.
    pub from: ZeroFrom,
    /// What touches of a known force told, by region.
    pub touches: Vec<RegionTouches>,
}

/// Why there is no calibration. Each text is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum CalibrateError {
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Model(#[from] ModelError),
    #[error(transparent)]
    Setup(#[from] SetupError),
    #[error(transparent)]
    Fusion(#[from] FusionError),
    #[error(transparent)]
    Zero(#[from] ZeroError),
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Takes the zero of a recording, checks that the models read no force in it, and fits the gain of known touches.
///
/// # Errors
/// [`CalibrateError`] when the recording can't be read, a model can't be loaded, or the zero is refused.
pub fn run(mut cfg: Config, request: &Request<'_>, observer: &dyn Observer) -> Result<Calibrated, CalibrateError> {
    cfg.calibration.file = None; // a new calibration doesn't start from the old one
    let models = Models::load(&cfg)?;
    models.tell(&cfg, observer);
    let known_models = known(&cfg, &models.infos);
    let wanted = request.first_s.map_or(Wanted::Any, Wanted::First);
    let cfg = annotated(&cfg, request.bags, request.in_air, observer)?;
    let mut zero = zero::find(wanted, &cfg, request.bags, &known_models)?;
    zero.notes.iter().for_each(|note| observer.note(note));
    let mut fusion = Fusion::new(cfg.fusion.clone(), models.regressors)?;
    zero.install(&mut fusion)?;
    if let Some(rest) = zero.check.take() {
        judge(&cfg, request.bags, rest, &mut fusion, observer)?;
    }
    let mut touches = Vec::new();
    if let Some(known) = &request.known_forces {
        let mut core = Fusion::new(cfg.fusion.clone(), fusion.into_regressors())?;
        zero.install(&mut core)?;
        touches = force_gains(request.bags, &cfg, &zero, core, known, observer)?;
        zero.donning.force_gains = vec![None; cfg.fusion.regions.len()];
        touches.iter().for_each(|found| zero.donning.force_gains[found.region] = Some(found.gain));
    }
    Ok(Calibrated { calibration: zero.to_calibration(&cfg, &known_models.hashes), from: zero.from, touches })
}

/// Takes the rest through the core, whose forces tell whether something touched the glove.
fn judge(
    cfg: &Config,
    bags: &[PathBuf],
    mut rest: LoadCheck,
    fusion: &mut Fusion,
    observer: &dyn Observer,
) -> Result<(), CalibrateError> {
    let mut reader = BagReader::open(bags)?;
    let mut inputs = Inputs::new(input_topics(cfg), &mut reader)?;
    'rest: while let Some(message) = reader.next_message()? {
        check(observer)?;
        for part in inputs.parts(message.channel)? {
            let Input::Event(event) = inputs.decode(&message, part) else { continue };
            fusion.handle(event);
            while let Some(tick) = fusion.poll()? {
                if !rest.takes(tick) {
                    break 'rest;
                }
            }
        }
    }
    rest.judge(cfg)?.iter().for_each(|note| observer.warn(note));
    Ok(())
}
