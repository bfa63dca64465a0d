//! Compares the estimates of two recordings, frame by frame.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::SessionError;
use crate::bag::{BagChannel, BagReader, ContactReader};
use crate::eval::{Diff, DiffConfig, EstimateRecord, diff};
use crate::fusion::{Adaptation, ContactEvent, Flags};
use crate::msg::{ContactArray, ContactState, Time, WireType, WrenchStamped, from_cdr};
use crate::observer::{Observer, check};
use crate::units::Stamp;

/// Result of a comparison of two recordings.
#[derive(Debug)]
pub struct Compared {
    /// Differences between their estimates.
    pub diff: Diff,
    /// Data of the two that could not be read, one line each.
    pub losses: Vec<String>,
}

/// Compares the estimates of two recordings, region by region and field by field.
///
/// # Errors
/// [`SessionError`] if one can't be read or has no estimates.
pub fn compare(a: &Path, b: &Path, cfg: DiffConfig, observer: &dyn Observer) -> Result<Compared, SessionError> {
    let (mut a, mut b) = (Records::open(a, observer)?, Records::open(b, observer)?);
    let found = diff(&mut a, &mut b, cfg)?;
    for records in [&a, &b] {
        records.check()?;
    }
    let losses = [&a, &b].iter().flat_map(|records| records.reader.losses()).map(ToString::to_string).collect();
    Ok(Compared { diff: found, losses })
}

/// Estimates of a bag, one per region and frame: the contents of `ContactArray`, with the wrench of the same stamp.
struct Records<'o> {
    path: PathBuf,
    observer: &'o dyn Observer,
    reader: BagReader,
    contacts: ContactReader,
    wrenches: BTreeMap<String, (Time, [f64; 6])>,
    waiting: std::vec::IntoIter<EstimateRecord>,
    n_arrays: u64,
}

impl<'o> Records<'o> {
    fn open(path: &Path, observer: &'o dyn Observer) -> Result<Self, SessionError> {
        let mut reader = BagReader::open(&[path.to_path_buf()])?;
        let is_read = |channel: &&Arc<BagChannel>| {
            [WrenchStamped::TYPE_NAME, ContactArray::TYPE_NAME].contains(&channel.type_name())
        };
        let topics = reader.channels().iter().filter(is_read).map(|channel| channel.topic.clone()).collect();
        reader.read_only(&topics);
        reader.notes().iter().for_each(|note| observer.note(note));
        let (wrenches, waiting) = (BTreeMap::new(), Vec::new().into_iter());
        let contacts = ContactReader::default();
        Ok(Records { path: path.to_path_buf(), observer, reader, contacts, wrenches, waiting, n_arrays: 0 })
    }

    fn check(&self) -> Result<(), SessionError> {
        if self.n_arrays > 0 {
            return Ok(());
        }
        let there: Vec<&str> = self.reader.channels().iter().map(|channel| channel.topic.as_str()).collect();
        let reason = format!(
            "holds no {}; `tpf replay` writes them; its topics are {}",
            ContactArray::TYPE_NAME,
            there.join(", ")
        );
        Err(SessionError::at(&self.path, &reason))
    }

    fn advance(&mut self) -> Result<Option<EstimateRecord>, SessionError> {
        loop {
            if let Some(record) = self.waiting.next() {
                return Ok(Some(record));
            }
            check(self.observer)?;
            let Some(message) = self.reader.next_message()? else { return Ok(None) };
            let topic = &message.channel.topic;
            let malformed = |error: String| SessionError::at(&self.path, &format!("{topic}: {error}"));
            match message.channel.type_name() {
                WrenchStamped::TYPE_NAME => {
                    // `~/REGION/wrench` comes before the contacts of its frame.
                    let Some(region) = message.channel.topic.strip_suffix("/wrench") else { continue };
                    let region = region.rsplit('/').next().unwrap_or_default().to_owned();
                    let stamped: WrenchStamped =
                        from_cdr(message.data).map_err(|error| malformed(error.to_string()))?;
                    let (f, t) = (&stamped.wrench.force, &stamped.wrench.torque);
                    self.wrenches.insert(region, (stamped.header.stamp, [f.x, f.y, f.z, t.x, t.y, t.z]));
                }
                ContactArray::TYPE_NAME => {
                    let array = self.contacts.read(&message).map_err(malformed)?;
                    self.n_arrays += 1;
                    let wrenches = &self.wrenches;
                    let record = |state: &ContactState| {
                        let wrench = wrenches.get(&state.region).filter(|(stamp, _)| *stamp == array.header.stamp);
                        record_of(array.header.stamp, state, wrench.map(|(_, wrench)| *wrench))
                    };
                    self.waiting = array.contacts.iter().map(record).collect::<Vec<_>>().into_iter();
                }
                _ => {}
            }
        }
    }
}

impl Iterator for &mut Records<'_> {
    type Item = Result<EstimateRecord, SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.advance().transpose()
    }
}

fn record_of(stamp: Time, state: &ContactState, wrench: Option<[f64; 6]>) -> EstimateRecord {
    let value = |value: f64| Some(value).filter(|value| !value.is_nan());
    EstimateRecord {
        stamp: stamp_of(stamp),
        region: state.region.clone(),
        force: value(state.force),
        force_base: value(state.force_base),
        artifact: value(state.artifact),
        wrench,
        contact_raw: state.contact_raw,
        contact: state.contact,
        event: match state.event {
            ContactState::ONSET => ContactEvent::Onset,
            ContactState::OFFSET => ContactEvent::Offset,
            _ => ContactEvent::None,
        },
        since: stamp_of(state.since),
        flags: Flags::from_bits(state.flags),
        pose_age_ns: value(state.pose_age).map(|age_s| (age_s * 1e9).round() as i64),
        age_ns: value(state.age).map(|age_s| (age_s * 1e9).round() as i64),
        on_threshold: value(state.on_threshold),
        off_threshold: value(state.off_threshold),
        mdf: value(state.mdf),
        adaptation: match state.adaptation {
            ContactState::ADAPTATION_FROZEN => Adaptation::Frozen,
            ContactState::ADAPTATION_LEARNING => Adaptation::Learning,
            ContactState::ADAPTATION_WAITING => Adaptation::Waiting,
            ContactState::ADAPTATION_CAPPED => Adaptation::Capped,
            ContactState::ADAPTATION_NOISY => Adaptation::Noisy,
            _ => Adaptation::Off,
        },
        artifact_change: value(state.artifact_change),
        touch: value(state.touch),
        touch_on: value(state.touch_on),
        touch_off: value(state.touch_off),
    }
}

fn stamp_of(time: Time) -> Stamp {
    Stamp::from_sec_nanosec(time.sec, time.nanosec)
}
