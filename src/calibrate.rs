//! Makes a calibration from a recording of a donning, and checks it with the models that will use it.

use std::path::PathBuf;

use crate::bag::{BagError, BagReader, Input, InputError, Inputs, shown};
use crate::calibration::Calibration;
use crate::config::Config;
use crate::fusion::{Fusion, FusionError, SetupError};
use crate::glove::{Models, known};
use crate::model::ModelError;
use crate::observer::{Cancelled, Observer, check};
use crate::recording::input_topics;
use crate::sessions::{InAir, KnownForces, RegionTouches, SessionError, annotated, force_gains};
use crate::zero::{self, LoadCheck, Wanted, ZeroError, ZeroFrom};

/// Options of a calibration.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    /// MCAP or `.db3` files or bag folders of one recording. Several are merged by time.
    pub bags: &'a [PathBuf],
    /// Number of seconds at the beginning in which nothing touches the glove. They are used instead of annotated
    /// zero-load spans.
    pub first_s: Option<f64>,
    /// Times at which nothing touches the glove. They replace the annotations of the recording.
    pub in_air: Option<&'a InAir>,
    /// Touches of known force, from which force gains are fitted. `None` fits no gains.
    pub known_forces: Option<KnownForces>,
}

impl<'a> Request<'a> {
    /// Options for the annotated zero-load spans of a recording, without force gains.
    pub fn new(bags: &'a [PathBuf]) -> Self {
        Request { bags, first_s: None, in_air: None, known_forces: None }
    }
}

/// A calibration, with its sources.
#[derive(Debug)]
pub struct Calibrated {
    /// The calibration, to be written with [`Calibration::save`].
    pub calibration: Calibration,
    /// Source of the zero.
    pub from: ZeroFrom,
    /// Known touches and the gain from them, by region.
    pub touches: Vec<RegionTouches>,
}

/// A calibration that is not possible. Each message is one line.
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

/// Takes the zero of a recording, checks that the models estimate no force in it, and fits the gains from known
/// touches.
///
/// # Errors
/// [`CalibrateError`] if the recording can't be read, if a model can't be loaded, or if the zero is refused.
pub fn run(mut cfg: Config, request: &Request<'_>, observer: &dyn Observer) -> Result<Calibrated, CalibrateError> {
    if let Some(known) = &request.known_forces {
        let bag = request.bags.first().map_or_else(String::new, |bag| shown(bag));
        known.check(&cfg).map_err(|reason| SessionError::At { path: bag, reason })?;
    }
    cfg.calibration.file = None; // a new calibration doesn't start from the old one
    let models = Models::load(&cfg)?;
    models.tell(&cfg, observer);
    let known_models = known(&cfg, &models.infos);
    let wanted = request.first_s.map_or(Wanted::Any, Wanted::First);
    let cfg = annotated(&cfg, request.bags, request.in_air, observer)?;
    let mut zero = zero::find(wanted, &cfg, request.bags, &known_models)?;
    check(observer)?;
    zero.notes.iter().for_each(|note| observer.note(note));
    let mut fusion = Fusion::new(cfg.fusion().clone(), models.regressors)?;
    zero.install(&mut fusion)?;
    if let Some(rest) = zero.check.take() {
        judge(&cfg, request.bags, rest, &mut fusion, observer)?;
    }
    let mut touches = Vec::new();
    if let Some(known) = &request.known_forces {
        let mut core = Fusion::new(cfg.fusion().clone(), fusion.into_regressors())?;
        zero.install(&mut core)?;
        touches = force_gains(request.bags, &cfg, &zero, core, known, observer)?;
        zero.donning.force_gains = vec![None; cfg.fusion().regions().len()];
        touches.iter().for_each(|found| zero.donning.force_gains[found.region] = Some(found.gain));
    }
    Ok(Calibrated { calibration: zero.to_calibration(&cfg, &known_models.hashes), from: zero.from, touches })
}

/// Runs the rest of the recording through the core. Its forces show whether something touched the glove.
fn judge(
    cfg: &Config,
    bags: &[PathBuf],
    mut rest: LoadCheck,
    fusion: &mut Fusion,
    observer: &dyn Observer,
) -> Result<(), CalibrateError> {
    let mut reader = BagReader::open(bags)?;
    let mut inputs = Inputs::new(input_topics(cfg), &mut reader)?;
    inputs.read_only_these(&mut reader);
    'rest: while let Some(message) = reader.next_message()? {
        check(observer)?;
        for part in inputs.parts(message.channel)? {
            let Input::Event(event) = inputs.decode(&message, part) else { continue };
            fusion.handle(event)?;
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
