//! `tpf diff`: the estimates of two bags, region by region and field by field.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::checks::CheckArgs;
use super::{Failure, Outcome, print, say};
use crate::bag::{BagReader, ContactReader};
use crate::eval::{DiffConfig, EstimateRecord, diff};
use crate::fusion::{Adaptation, ContactEvent, Flags};
use crate::msg::{ContactArray, ContactState, Time, WireType, WrenchStamped, from_cdr};
use crate::report::comparison;
use crate::units::{Newton, Stamp};

/// Compares the estimates of two bags; leaves with 1 where they differ.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Bag with estimates: the golden run
    a: PathBuf,
    /// Bag with estimates: the run to judge
    b: PathBuf,
    /// Largest difference of a force, in N, that is none; 0 compares bit by bit
    #[arg(long, value_name = "N", default_value_t = 0.0)]
    tolerance_n: f64,
    #[command(flatten)]
    checks: CheckArgs,
    /// Print the comparison as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let default = DiffConfig::default();
    let cfg = default.with_tolerance(Newton(args.tolerance_n))?;
    let (mut a, mut b) = (Records::open(&args.a)?, Records::open(&args.b)?);
    let found = diff(&mut a, &mut b, cfg)?;
    for records in [&a, &b] {
        records.check()?;
    }
    let losses: Vec<String> =
        [&a, &b].iter().flat_map(|records| records.reader.losses()).map(ToString::to_string).collect();
    losses.iter().for_each(|loss| say(&format!("input lost: {loss}")));
    let names = [&args.a, &args.b].map(|path| path.display().to_string());
    let names = names.each_ref().map(String::as_str);
    if args.checks.are_wanted() {
        args.checks.write("tpf diff", &comparison::checks(&found, names, args.tolerance_n))?;
    }
    let text = match args.json {
        true => serde_json::to_string_pretty(&found)? + "\n",
        false => comparison::text(&found, names, args.tolerance_n),
    };
    print(&text)?;
    Ok(match (found.is_same(), losses.is_empty()) {
        (false, _) => Outcome::NotMet,
        (true, true) => Outcome::Done,
        (true, false) => Outcome::InputLost,
    })
}

/// The estimates of a bag, one a region and frame: what `ContactArray` says, with the wrench of the same stamp.
struct Records {
    path: PathBuf,
    reader: BagReader,
    contacts: ContactReader,
    wrenches: BTreeMap<String, (Time, [f64; 6])>,
    waiting: std::vec::IntoIter<EstimateRecord>,
    n_arrays: u64,
}

impl Records {
    fn open(path: &Path) -> Result<Self, Failure> {
        let reader = super::sessions::open(&[path.to_path_buf()])?;
        let (wrenches, waiting) = (BTreeMap::new(), Vec::new().into_iter());
        let contacts = ContactReader::default();
        Ok(Records { path: path.to_path_buf(), reader, contacts, wrenches, waiting, n_arrays: 0 })
    }

    fn check(&self) -> Result<(), Failure> {
        if self.n_arrays > 0 {
            return Ok(());
        }
        let there: Vec<&str> = self.reader.channels().iter().map(|channel| channel.topic.as_str()).collect();
        Err(Failure(format!(
            "{}: holds no {}; `tpf replay` writes them; its topics are {}",
            self.path.display(),
            ContactArray::TYPE_NAME,
            there.join(", ")
        )))
    }

    fn advance(&mut self) -> Result<Option<EstimateRecord>, Failure> {
        loop {
            if let Some(record) = self.waiting.next() {
                return Ok(Some(record));
            }
            let Some(message) = self.reader.next_message()? else { return Ok(None) };
            let malformed =
                |error: String| Failure(format!("{}: {}: {error}", self.path.display(), message.channel.topic));
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

impl Iterator for &mut Records {
    type Item = Result<EstimateRecord, Failure>;

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
