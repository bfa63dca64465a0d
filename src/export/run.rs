//! Bags in, a dataset or tables out.

use super::ExportError;
use super::loaded::Loader;
use super::outputs::Outputs;
use super::request::Request;
use super::summary::{Failed, Summary};
use crate::bag::shown;
use crate::config::Config;
use crate::observer::{Observer, check};

/// Exports bags. Those that can't be exported are in [`Summary::failed`], as long as one can.
///
/// # Errors
/// [`ExportError`] when an output can't be written, no bag can be exported, or the observer cancels; outputs are absent
/// then.
pub fn run(cfg: &Config, request: &Request<'_>, observer: &dyn Observer) -> Result<Summary, ExportError> {
    request.targets.check()?;
    let mut outputs = Outputs::create(request, cfg)?;
    let mut loader = Loader::new(request, cfg, observer);
    let (mut summary, mut first_error) = (Summary::default(), None);
    for (bag_idx, bag) in request.bags.iter().enumerate() {
        observer.progress(bag_idx as u64, request.bags.len() as u64);
        let made = loader.load(bag).and_then(|loaded| {
            let made = outputs.make(&loaded).map_err(|error| ExportError::in_bag(bag, &error))?;
            Ok((made, loaded))
        });
        check(observer)?;
        match made {
            Ok((made, loaded)) => summary.bags.push(outputs.write(bag, made, loaded)?),
            Err(error) => {
                summary.failed.push(Failed { bag: shown(bag), error: error.to_string() });
                first_error.get_or_insert(error);
            }
        }
    }
    if let (true, Some(error)) = (summary.bags.is_empty(), first_error) {
        summary.failed.iter().skip(1).for_each(|failed| observer.note(&format!("not exported: {}", failed.error)));
        return Err(error);
    }
    outputs.finish()?;
    summary.outputs = request.targets.paths().map(shown).collect();
    Ok(summary)
}
