//! Exports bags to a dataset or tables.

use super::ExportError;
use super::lerobot::{ShardBag, ShardNotes};
use super::loaded::ExportLoader;
use super::outputs::Outputs;
use super::request::Request;
use super::summary::{Failed, Summary};
use crate::bag::shown;
use crate::config::Config;
use crate::observer::{Observer, check};
use crate::sessions::Shard;

/// Exports bags, or a shard of them. Bags that fail are in [`Summary::failed`]. Without a shard, at least one bag must
/// succeed.
///
/// # Errors
/// [`ExportError`] if an output can't be written, if no bag can be exported, or if the observer cancels. There are then
/// no outputs.
pub fn run(cfg: &Config, request: &Request<'_>, observer: &dyn Observer) -> Result<Summary, ExportError> {
    request.targets.check()?;
    let mut outputs = Outputs::create(request, cfg)?;
    let mut loader = ExportLoader::new(request, cfg, observer);
    let shard = request.shard.unwrap_or(Shard::WHOLE);
    let mut notes = request.shard.map(|shard| ShardNotes::new(shard, request.bags.len(), cfg, request)).transpose()?;
    let (mut summary, mut first_error) = (Summary::default(), None);
    for (bag_idx, bag) in request.bags.iter().enumerate() {
        observer.progress(bag_idx as u64, request.bags.len() as u64);
        let is_own = bag_idx % shard.of() == shard.index();
        if !is_own && outputs.has_layout() {
            continue;
        }
        let made = loader.load(bag).and_then(|loaded| {
            let made = outputs.make(&loaded).map_err(|error| ExportError::in_bag(bag, &error))?;
            Ok((made, loaded))
        });
        check(observer)?;
        if !is_own {
            continue; // this bag is in another shard, and only its layout is needed
        }
        if let Some(notes) = &mut notes {
            let synthetic = made.as_ref().is_ok_and(|(_, loaded)| loaded.synthetic);
            let error = made.as_ref().err().map(ToString::to_string);
            notes.bags.push(ShardBag { bag: shown(bag), synthetic, error });
        }
        match made {
            Ok((made, loaded)) => summary.bags.push(outputs.write(bag, made, loaded)?),
            Err(error) => {
                summary.failed.push(Failed { bag: shown(bag), error: error.to_string() });
                first_error.get_or_insert(error);
            }
        }
    }
    if let (true, Some(error), None) = (summary.bags.is_empty(), first_error, &notes) {
        summary.failed.iter().skip(1).for_each(|failed| observer.warn(&format!("not exported: {}", failed.error)));
        return Err(error);
    }
    outputs.finish(notes.as_ref())?;
    summary.outputs = request.targets.paths().map(shown).collect();
    Ok(summary)
}
