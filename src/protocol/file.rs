//! Loads a protocol from a YAML file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::{CheckMovement, Checks, ForceLevels, KnownTouches, Name, Protocol, Settings, Substage, Task};
use crate::units::Newton;

/// Size limit of the file; the paper's protocol takes a fiftieth of it.
pub const MAX_BYTES: u64 = 512 << 10;

/// Maximum number of items in a session; the paper's has 370.
const MAX_ITEMS: usize = 10_000;

/// Maximum duration of one item, s.
const MAX_SECONDS: f64 = 600.0;

/// A protocol that can't be loaded. Each message is one line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum ProtocolError {
    #[error("{path}: cannot read the protocol: {reason}")]
    Read { path: PathBuf, reason: String },
    #[error("not a protocol: {reason}; params/protocol.yaml explains every key")]
    Malformed { reason: String },
    #[error("{place}: {reason}")]
    Refused { place: String, reason: String },
    #[error("{path}: {error}")]
    InFile { path: PathBuf, error: Box<ProtocolError> },
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ProtocolFile {
    name: String,
    pose_seconds: f64,
    lead_seconds: f64,
    let_go_seconds: f64,
    force_levels: LevelsFile,
    poses: BTreeMap<String, String>,
    movements: BTreeMap<String, String>,
    substages: Vec<SubstageFile>,
    checks: ChecksFile,
    known_touches: Option<KnownTouchesFile>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct KnownTouchesFile {
    presses: u16,
    seconds: f64,
    hold_seconds: f64,
    at_least: f64,
    ask: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LevelsFile {
    light: (f64, f64),
    medium: (f64, f64),
    heavy: (f64, f64),
    most: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ChecksFile {
    still_seconds: f64,
    load_cell_zero: f64,
    rates: RatesFile,
    max_gap_seconds: f64,
    min_movement: f64,
    #[serde(default)]
    movements: Vec<CheckMovementFile>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct RatesFile {
    taxels: f64,
    joints: f64,
    force: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CheckMovementFile {
    ask: String,
    pose: String,
    seconds: f64,
    most_first: Vec<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SubstageFile {
    stage: u8,
    name: String,
    #[serde(rename = "do")]
    action: ActionFile,
    #[serde(default)]
    at: Vec<String>,
    #[serde(default)]
    moving: bool,
    #[serde(default)]
    fingers: Option<FingersFile>,
    #[serde(default)]
    repetitions: Option<u16>,
    seconds: f64,
    #[serde(default)]
    at_least: Option<f64>,
    #[serde(default)]
    ask: String,
    #[serde(default)]
    touch: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum ActionFile {
    Hold,
    Move,
    MoveFreely,
    Taps,
    Press,
    PressThrough,
    PressSequence,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum FingersFile {
    Index,
    All,
}

impl Protocol {
    /// Loads a protocol from a file.
    ///
    /// # Errors
    /// [`ProtocolError`] when it can't be read, or its content is refused.
    pub fn load(path: &Path) -> Result<Self, ProtocolError> {
        let failed = |reason: String| ProtocolError::Read { path: path.to_path_buf(), reason };
        let mut text = String::new();
        let file = File::open(path).map_err(|error| failed(error.to_string()))?;
        file.take(MAX_BYTES + 1).read_to_string(&mut text).map_err(|error| failed(error.to_string()))?;
        if text.len() as u64 > MAX_BYTES {
            return Err(failed(format!("it has more than {MAX_BYTES} bytes")));
        }
        Self::parse(&text).map_err(|error| ProtocolError::InFile { path: path.to_path_buf(), error: Box::new(error) })
    }

    /// Parses the text of a protocol file.
    ///
    /// # Errors
    /// [`ProtocolError`] when it is not a protocol, or its content is refused.
    pub fn parse(text: &str) -> Result<Self, ProtocolError> {
        let file: ProtocolFile = serde_saphyr::from_str(text).map_err(|error| {
            let text = error.to_string();
            ProtocolError::Malformed { reason: text.lines().next().unwrap_or_default().to_owned() }
        })?;
        let wording: BTreeMap<Name, String> = file
            .poses
            .iter()
            .chain(&file.movements)
            .map(|(name, text)| (Name::from(name.as_str()), text.clone()))
            .collect();
        for name in file.poses.keys().chain(file.movements.keys()) {
            word("poses and movements", name)?;
        }
        if let Some(twice) = file.poses.keys().find(|name| file.movements.contains_key(*name)) {
            return Err(refused("movements", format!("{twice} is a pose too; annotations could not tell them apart")));
        }
        let pose_s = seconds("pose_seconds", file.pose_seconds)?;
        let mut substages: Vec<Substage> = Vec::new();
        for read in &file.substages {
            let substage = substage(read, &file, pose_s)?;
            let same = |known: &&Substage| known.stage == substage.stage && known.name == substage.name;
            if substages.iter().find(same).is_some() {
                return Err(refused(
                    &read.name,
                    format!("is there twice in stage {}; give one another name", read.stage),
                ));
            }
            if substages.last().is_some_and(|last| last.stage > substage.stage) {
                return Err(refused(&read.name, format!("is of stage {}, after one of a later stage", read.stage)));
            }
            substages.push(substage);
        }
        let n_items: usize = substages.iter().map(Substage::n_items).sum();
        if !(1..=MAX_ITEMS).contains(&n_items) {
            return Err(refused("substages", format!("expected 1 to {MAX_ITEMS} items in all, got {n_items}")));
        }
        let levels = levels(&file.force_levels)?;
        let known_touches = file.known_touches.as_ref().map(|file| known_touches(file, levels.most)).transpose()?;
        Ok(Protocol {
            name: file.name.clone(),
            pose_s,
            lead_s: seconds("lead_seconds", file.lead_seconds)?,
            let_go_s: seconds("let_go_seconds", file.let_go_seconds)?,
            levels,
            checks: checks(&file.checks)?,
            known_touches,
            substages,
            wording,
            source: text.into(),
        })
    }
}

impl Substage {
    /// Number of items in a whole session.
    fn n_items(&self) -> usize {
        let each = match &self.task {
            Task::Hold(names) | Task::Move { movements: names, .. } => names.len(),
            Task::Taps(Settings::Poses(names) | Settings::Transitions(names))
            | Task::Press(Settings::Poses(names) | Settings::Transitions(names)) => names.len(),
            _ => 1,
        };
        each * usize::from(self.repetitions)
    }
}

fn refused(place: &str, reason: String) -> ProtocolError {
    ProtocolError::Refused { place: place.chars().filter(|letter| !letter.is_control()).collect(), reason }
}

/// A name that is valid in annotations, files and tables.
fn word(place: &str, name: &str) -> Result<Name, ProtocolError> {
    let fits = |letter: char| letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == '_';
    match !name.is_empty() && name.len() <= 64 && name.chars().all(fits) {
        true => Ok(name.into()),
        false => Err(refused(place, format!("expected a name in snake_case, got {name:?}"))),
    }
}

fn seconds(place: &str, seconds: f64) -> Result<f64, ProtocolError> {
    match seconds > 0.0 && seconds <= MAX_SECONDS {
        true => Ok(seconds),
        false => Err(refused(place, format!("expected more than 0 and at most {MAX_SECONDS} s, got {seconds}"))),
    }
}

fn levels(file: &LevelsFile) -> Result<ForceLevels, ProtocolError> {
    let taps = [file.light, file.medium, file.heavy];
    let rising = |pair: &(f64, f64)| pair.0 > 0.0 && pair.0 < pair.1 && pair.1 <= file.most;
    let in_order = taps.windows(2).all(|pair| pair[0].0 < pair[1].0 && pair[0].1 < pair[1].1);
    match taps.iter().all(rising) && in_order && file.most.is_finite() {
        true => Ok(ForceLevels { taps, most: file.most }),
        false => Err(refused(
            "force_levels",
            format!(
                "expected light below medium below heavy, each from less to more and up to most, got {taps:?} and {}",
                file.most
            ),
        )),
    }
}

fn checks(file: &ChecksFile) -> Result<Checks, ProtocolError> {
    let still_s = seconds("checks.still_seconds", file.still_seconds)?;
    let RatesFile { taxels, joints, force } = file.rates;
    let positive = [
        ("checks.load_cell_zero", file.load_cell_zero, "a force above 0 N"),
        ("checks.rates.taxels", taxels, "a rate above 0 Hz"),
        ("checks.rates.joints", joints, "a rate above 0 Hz"),
        ("checks.rates.force", force, "a rate above 0 Hz"),
        ("checks.min_movement", file.min_movement, "an angle above 0 rad"),
    ];
    for (place, value, expected) in positive {
        if !(value > 0.0 && value.is_finite()) {
            return Err(refused(place, format!("expected {expected}, got {value}")));
        }
    }
    let movement = |read: &CheckMovementFile| {
        Ok(CheckMovement {
            ask: read.ask.clone(),
            pose: word("checks.movements", &read.pose)?,
            seconds: seconds("checks.movements", read.seconds)?,
            most_first: read.most_first.clone(),
        })
    };
    let movements = file.movements.iter().map(movement).collect::<Result<_, _>>()?;
    Ok(Checks {
        still_s,
        load_cell_zero: file.load_cell_zero,
        rates_hz: [taxels, joints, force],
        max_gap_s: seconds("checks.max_gap_seconds", file.max_gap_seconds)?,
        min_movement: file.min_movement,
        movements,
    })
}

fn known_touches(file: &KnownTouchesFile, most: f64) -> Result<KnownTouches, ProtocolError> {
    let seconds_of = |key: &str, value: f64| seconds(&format!("known_touches.{key}"), value);
    let (seconds, hold_s) = (seconds_of("seconds", file.seconds)?, seconds_of("hold_seconds", file.hold_seconds)?);
    if hold_s >= seconds {
        let reason = format!("expected hold_seconds below seconds, got {hold_s} and {seconds}");
        return Err(refused("known_touches", reason));
    }
    if !(KnownTouches::FEWEST..=100).contains(&file.presses) {
        let reason = format!(
            "expected {} to 100 presses, because a gain needs three, got {}",
            KnownTouches::FEWEST,
            file.presses
        );
        return Err(refused("known_touches", reason));
    }
    let Newton(least) = KnownTouches::LIGHTEST.into();
    if !(file.at_least >= least && file.at_least <= most) {
        let reason = format!(
            "expected at_least from {least:.2} N, the smallest force that a gain is fitted to, to force_levels.most = {most} N, got {}",
            file.at_least
        );
        return Err(refused("known_touches", reason));
    }
    Ok(KnownTouches { presses: file.presses, seconds, hold_s, at_least: file.at_least, ask: file.ask.clone() })
}

fn substage(read: &SubstageFile, file: &ProtocolFile, pose_s: f64) -> Result<Substage, ProtocolError> {
    let name = word("substages", &read.name)?;
    let refuse = |reason: String| refused(&read.name, reason);
    if !(1..=3).contains(&read.stage) {
        return Err(refuse(format!("expected stage 1, 2 or 3, got {}", read.stage)));
    }
    let (known, kind) = match read.action {
        ActionFile::Move | ActionFile::PressSequence => (&file.movements, "movements"),
        _ => (&file.poses, "poses"),
    };
    if let Some(unknown) = read.at.iter().find(|at| !known.contains_key(*at)) {
        return Err(refuse(format!("{unknown:?} is not among the {kind} of this protocol")));
    }
    let at: Vec<Name> = read.at.iter().map(|at| at.as_str().into()).collect();
    let named = |what: &str| match at.is_empty() {
        true => Err(refuse(format!("expected {what} as `at`, got none"))),
        false => Ok(at.clone()),
    };
    let all_fingers = read.fingers == Some(FingersFile::All);
    let settings = || match (read.moving, at.is_empty()) {
        (true, true) => Err(refuse("moving wants poses as `at`, to go to".to_owned())),
        (true, false) => Ok(Settings::Transitions(at.clone())),
        (false, true) => Ok(Settings::Free),
        (false, false) => Ok(Settings::Poses(at.clone())),
    };
    let task = match read.action {
        ActionFile::Hold => Task::Hold(named("poses")?),
        ActionFile::Move => Task::Move { movements: named("movements")?, all_fingers },
        ActionFile::MoveFreely => Task::MoveFreely,
        ActionFile::Taps => Task::Taps(settings()?),
        ActionFile::Press => Task::Press(settings()?),
        ActionFile::PressThrough => Task::PressThrough(named("poses")?),
        ActionFile::PressSequence => Task::PressSequence { movements: named("movements")?, all_fingers },
    };
    let takes_pose = matches!(task, Task::Taps(_) | Task::Press(_));
    let touches = takes_pose || matches!(task, Task::PressThrough(_) | Task::PressSequence { .. });
    for (key, text, wanted) in [("ask", &read.ask, takes_pose || !touches), ("touch", &read.touch, touches)] {
        if text.trim().is_empty() == wanted {
            let expected = if wanted { "expected" } else { "has no use for" };
            return Err(refuse(format!("{expected} a text as `{key}`")));
        }
    }
    let seconds = seconds(&read.name, read.seconds)?;
    if takes_pose && seconds <= pose_s {
        return Err(refuse(format!("seconds = {seconds} must be above pose_seconds = {pose_s}")));
    }
    let repetitions = match (read.repetitions, &task) {
        (None, Task::MoveFreely) => 1,
        (Some(n), _) if (1..=1000).contains(&n) => n,
        (n, _) => return Err(refuse(format!("expected 1 to 1000 repetitions, got {}", n.unwrap_or(0)))),
    };
    let at_least = read.at_least.unwrap_or(match task {
        Task::MoveFreely => seconds,
        _ => 1.0,
    });
    if !(at_least > 0.0 && at_least <= f64::from(u16::MAX)) {
        return Err(refuse(format!("expected at_least above 0, got {at_least}")));
    }
    let (ask, touch) = (read.ask.clone(), read.touch.clone());
    Ok(Substage { stage: read.stage, name, task, repetitions, seconds, at_least, ask, touch })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changed(from: &str, to: &str) -> String {
        let text = include_str!("../../params/protocol.yaml");
        assert!(text.contains(from), "{from}");
        Protocol::parse(&text.replacen(from, to, 1)).unwrap_err().to_string()
    }

    #[test]
    fn what_can_not_be_done_is_refused_with_its_place() {
        let cases = [
            (
                "at: [bend, fold, roll]",
                "at: [bend, fold, rol]",
                "index_movements: \"rol\" is not among the movements of this protocol",
            ),
            ("seconds: 2\n", "seconds: -2\n", "terminal_poses: expected more than 0 and at most 600 s, got -2"),
            ("name: index_movements", "name: Index", "substages: expected a name in snake_case, got \"Index\""),
            ("  medium: [0.8, 4.0]", "  medium: [0.1, 4.0]", "force_levels: expected light below medium"),
            (
                "pose_seconds: 1.0",
                "pose_seconds: 4.0",
                "terminal_pose_taps: seconds = 4 must be above pose_seconds = 4",
            ),
            ("name: all_finger_movements", "name: index_movements", "index_movements: is there twice in stage 1"),
            (
                "    ask: \"In the air: {}\"",
                "    touch: \"In the air: {}\"",
                "terminal_poses: expected a text as `ask`",
            ),
            ("load_cell_zero: 0.25", "load_cell_zero: .nan", "checks.load_cell_zero: expected a force above 0 N"),
            ("presses: 5", "presses: 2", "known_touches: expected 3 to 100 presses, because a gain needs three, got 2"),
            ("at_least: 0.5", "at_least: 0.1", "known_touches: expected at_least from 0.29 N"),
            ("hold_seconds: 0.7", "hold_seconds: 9", "known_touches: expected hold_seconds below seconds, got 9 and 6"),
        ];
        for (from, to, expected) in cases {
            let error = changed(from, to);
            assert!(error.starts_with(expected), "{to}: {error}");
        }
        let error = changed("pose_seconds: 1.0", "pose_second: 1.0");
        assert!(error.contains("pose_second") && !error.contains('\n'), "{error}");
    }
}
