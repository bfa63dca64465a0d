//! The statistics of a bag as rows of a table, and back.

use sha2::{Digest, Sha256};

use super::hex;
use crate::columns::{Cells, Kind};
use crate::eval::{Evaluation, Origin, RowError, Scoring, StatRow};
use crate::evaluate::Stretch;
use crate::evaluate::scored::{BagPart, ScoredBag};
use crate::evaluate::stretches::BestAndWorst;

/// The columns of a row: its kind, its origin and its statistics.
pub(super) const COLUMNS: [(&str, Kind); 24] = [
    ("bag", Kind::Text),
    ("of", Kind::Text),
    ("name", Kind::Text),
    ("series", Kind::Whole),
    ("status", Kind::Text),
    ("sha256", Kind::Text),
    ("json", Kind::Text),
    ("glove", Kind::Text),
    ("user", Kind::Text),
    ("session", Kind::Text),
    ("stage", Kind::Text),
    ("substage", Kind::Text),
    ("pose", Kind::Text),
    ("bin", Kind::Whole),
    ("n", Kind::Whole),
    ("n_detected", Kind::Whole),
    ("n_missing", Kind::Whole),
    ("abs_error_gf", Kind::Number),
    ("error_gf", Kind::Number),
    ("truth_gf", Kind::Number),
    ("estimate_gf", Kind::Number),
    ("truth_mean_gf", Kind::Number),
    ("truth_m2", Kind::Number),
    ("squared_error", Kind::Number),
];

/// The last column.
pub(super) const SAMPLES: (&str, Kind) = ("samples", Kind::Numbers);

/// Status of a bag that was scored.
const OK: &str = "ok";

/// Rows that are not those of an evaluation.
const BAG: &str = "bag";
const WARNING: &str = "warning";
const STRETCH: &str = "stretch";

/// A row of the table.
#[derive(Debug, Default)]
struct Row {
    series: Option<i64>,
    status: Option<String>,
    sha256: Option<String>,
    json: Option<String>,
    stat: StatRow,
}

/// All columns.
pub(super) fn columns() -> Vec<(&'static str, Kind)> {
    COLUMNS.into_iter().chain([SAMPLES]).collect()
}

/// The result of a bag, as cells.
pub(super) fn cells(part: &BagPart) -> Result<Vec<Cells>, serde_json::Error> {
    let of = |name: &str| StatRow { of: name.to_owned(), ..StatRow::default() };
    let mut rows = Vec::new();
    let bag = Row { sha256: part.sha256.clone(), stat: of(BAG), ..Row::default() };
    match &part.outcome {
        Err(error) => rows.push(Row { status: Some(error.clone()), ..bag }),
        Ok(ScoredBag { summary, evaluations, stretches }) => {
            let json = serde_json::to_string(summary)?;
            rows.push(Row { status: Some(OK.to_owned()), json: Some(json), ..bag });
            let warnings = summary.warnings.iter();
            rows.extend(warnings.map(|text| Row { json: Some(text.clone()), stat: of(WARNING), ..Row::default() }));
            for (series, evaluation) in evaluations.iter().enumerate() {
                let series = i64::try_from(series).ok();
                rows.extend(evaluation.rows().into_iter().map(|stat| Row { series, stat, ..Row::default() }));
            }
            for (region, found) in stretches.iter().enumerate() {
                let kinds = [("best", &found.best), ("median", &found.median), ("worst", &found.worst)];
                for (kind, stretch) in kinds {
                    rows.extend(of_stretch(region, kind, stretch).map(|stat| Row { stat, ..Row::default() }));
                }
            }
        }
    }
    Ok(into_cells(&part.bag, rows))
}

fn of_stretch(region: usize, kind: &str, stretch: &Stretch) -> [StatRow; 7] {
    let flags = |flags: &[bool]| flags.iter().map(|flag| f64::from(u8::from(*flag))).collect();
    [
        ("", vec![stretch.mae_gf, stretch.from_s]),
        (".seconds", stretch.seconds.clone()),
        (".truth_gf", stretch.truth_gf.clone()),
        (".base_gf", stretch.base_gf.clone()),
        (".force_gf", stretch.force_gf.clone()),
        (".is_touch", flags(&stretch.is_touch)),
        (".contact", flags(&stretch.contact)),
    ]
    .map(|(name, samples)| StatRow {
        of: STRETCH.to_owned(),
        name: format!("{kind}{name}"),
        origin: Origin {
            glove: stretch.glove.clone(),
            session: stretch.session.clone(),
            stage: stretch.stage.clone(),
            ..Origin::default()
        },
        bin: i64::try_from(region).ok(),
        samples: Some(samples),
        ..StatRow::default()
    })
}

fn into_cells(bag: &str, rows: Vec<Row>) -> Vec<Cells> {
    let filled = |text: &String| Some(text.clone()).filter(|text| !text.is_empty());
    let text = |of: &dyn Fn(&Row) -> Option<String>| Cells::Text(rows.iter().map(of).collect());
    let whole = |of: fn(&Row) -> Option<i64>| Cells::Whole(rows.iter().map(of).collect());
    let number = |of: fn(&StatRow) -> Option<f64>| Cells::Number(rows.iter().map(|row| of(&row.stat)).collect());
    let origin = |of: fn(&Origin) -> &String| text(&|row| filled(of(&row.stat.origin)));
    vec![
        text(&|_| Some(bag.to_owned())),
        text(&|row| Some(row.stat.of.clone())),
        text(&|row| filled(&row.stat.name)),
        whole(|row| row.series),
        text(&|row| row.status.clone()),
        text(&|row| row.sha256.clone()),
        text(&|row| row.json.clone()),
        origin(|origin| &origin.glove),
        origin(|origin| &origin.user),
        origin(|origin| &origin.session),
        origin(|origin| &origin.stage),
        origin(|origin| &origin.substage),
        text(&|row| filled(&row.stat.pose)),
        whole(|row| row.stat.bin),
        whole(|row| row.stat.n),
        whole(|row| row.stat.n_detected),
        whole(|row| row.stat.n_missing),
        number(|stat| stat.abs_error_gf),
        number(|stat| stat.error_gf),
        number(|stat| stat.truth_gf),
        number(|stat| stat.estimate_gf),
        number(|stat| stat.truth_mean_gf),
        number(|stat| stat.truth_m2),
        number(|stat| stat.squared_error),
        Cells::Numbers(rows.iter().map(|row| row.stat.samples.clone()).collect()),
    ]
}

/// The result of a bag, from the cells of a table of these columns, with statistics of so many series.
///
/// # Errors
/// The reason, in words.
pub(super) fn part(cells: Vec<Cells>, n_series: usize) -> Result<BagPart, String> {
    let rows = from_cells(cells).ok_or("its columns are not those of a partial")?;
    let [(bag, first), rest @ ..] = rows.as_slice() else { return Err("a group of its rows is empty".to_owned()) };
    if first.stat.of != BAG || rest.iter().any(|(other, row)| other != bag || row.stat.of == BAG) {
        return Err("a group of its rows is not that of one bag".to_owned());
    }
    let (bag, sha256) = (bag.clone(), first.sha256.clone());
    let summary = match (first.status.as_deref(), &first.json) {
        (Some(OK), Some(json)) => json,
        (Some(error), None) => return Ok(BagPart { bag, sha256, outcome: Err(error.to_owned()) }),
        _ => return Err(format!("it does not tell what became of {bag}")),
    };
    let mut summary: super::super::SessionSummary =
        serde_json::from_str(summary).map_err(|error| format!("its summary of {bag}: {error}"))?;
    let mut of_series: Vec<Vec<StatRow>> = vec![Vec::new(); n_series];
    let mut stretches: Vec<StatRow> = Vec::new();
    for (_, row) in rows.into_iter().skip(1) {
        let series = row.series.and_then(|series| of_series.get_mut(usize::try_from(series).ok()?));
        match (row.stat.of.as_str(), series) {
            (WARNING, None) => summary.warnings.extend(row.json),
            (STRETCH, None) => stretches.push(row.stat),
            (_, Some(rows)) => rows.push(row.stat),
            (of, None) => return Err(format!("a row of {of} is of series {:?}, expected 0 to {n_series}", row.series)),
        }
    }
    let evaluations = of_series.iter().map(|rows| Evaluation::from_rows(Scoring::default(), rows));
    let evaluations = evaluations.collect::<Result<_, RowError>>().map_err(|error| error.to_string())?;
    let stretches = read_stretches(stretches).ok_or("its stretches of frames are not whole")?;
    Ok(BagPart { bag, sha256, outcome: Ok(ScoredBag { summary, evaluations, stretches }) })
}

fn from_cells(cells: Vec<Cells>) -> Option<Vec<(String, Row)>> {
    let mut rows: Vec<(String, Row)> = Vec::new();
    rows.resize_with(cells.first()?.n_rows(), Default::default);
    for ((name, _), cells) in columns().into_iter().zip(cells) {
        if cells.n_rows() != rows.len() {
            return None;
        }
        let into = rows.iter_mut();
        match cells {
            Cells::Text(cells) => into.zip(cells).try_for_each(|((bag, row), cell)| {
                let origin = &mut row.stat.origin;
                match name {
                    "bag" => *bag = cell?,
                    "of" => row.stat.of = cell?,
                    "name" => row.stat.name = cell.unwrap_or_default(),
                    "status" => row.status = cell,
                    "sha256" => row.sha256 = cell,
                    "json" => row.json = cell,
                    "glove" => origin.glove = cell.unwrap_or_default(),
                    "user" => origin.user = cell.unwrap_or_default(),
                    "session" => origin.session = cell.unwrap_or_default(),
                    "stage" => origin.stage = cell.unwrap_or_default(),
                    "substage" => origin.substage = cell.unwrap_or_default(),
                    _ => row.stat.pose = cell.unwrap_or_default(),
                }
                Some(())
            })?,
            Cells::Whole(cells) => into.zip(cells).for_each(|((_, row), cell)| match name {
                "series" => row.series = cell,
                "bin" => row.stat.bin = cell,
                "n" => row.stat.n = cell,
                "n_detected" => row.stat.n_detected = cell,
                _ => row.stat.n_missing = cell,
            }),
            Cells::Number(cells) => into.zip(cells).for_each(|((_, row), cell)| match name {
                "abs_error_gf" => row.stat.abs_error_gf = cell,
                "error_gf" => row.stat.error_gf = cell,
                "truth_gf" => row.stat.truth_gf = cell,
                "estimate_gf" => row.stat.estimate_gf = cell,
                "truth_mean_gf" => row.stat.truth_mean_gf = cell,
                "truth_m2" => row.stat.truth_m2 = cell,
                _ => row.stat.squared_error = cell,
            }),
            Cells::Numbers(cells) => into.zip(cells).for_each(|((_, row), cell)| row.stat.samples = cell),
            _ => return None,
        }
    }
    Some(rows)
}

/// The stretches, seven rows each, three a region.
fn read_stretches(rows: Vec<StatRow>) -> Option<Vec<BestAndWorst>> {
    let mut found = Vec::new();
    for (idx, of_region) in rows.chunks(21).enumerate() {
        let stretch = |from: usize| {
            let rows = of_region.get(from..from + 7)?;
            let samples = |idx: usize| rows[idx].samples.clone();
            let flags = |idx: usize| Some(samples(idx)?.into_iter().map(|flag| flag != 0.0).collect::<Vec<bool>>());
            let origin = &rows[0].origin;
            let &[mae_gf, from_s] = rows[0].samples.as_deref()? else { return None };
            let stretch = Stretch {
                kind: "",
                session: origin.session.clone(),
                glove: origin.glove.clone(),
                stage: origin.stage.clone(),
                mae_gf,
                from_s,
                seconds: samples(1)?,
                truth_gf: samples(2)?,
                base_gf: samples(3)?,
                force_gf: samples(4)?,
                is_touch: flags(5)?,
                contact: flags(6)?,
            };
            let n = stretch.seconds.len();
            let lengths =
                [stretch.truth_gf.len(), stretch.force_gf.len(), stretch.is_touch.len(), stretch.contact.len()];
            let has_base = [0, n].contains(&stretch.base_gf.len());
            (lengths == [n; 4] && has_base && rows.iter().all(|row| row.bin == i64::try_from(idx).ok()))
                .then_some(stretch)
        };
        found.push(BestAndWorst { best: stretch(0)?, median: stretch(7)?, worst: stretch(14)? });
    }
    Some(found)
}

/// SHA-256 of cells: a partial that was changed after it was written is refused.
pub(super) fn checksum(cells: &[Cells]) -> String {
    let mut hash = Sha256::new();
    let mut text = |text: Option<&str>| {
        hash.update(text.map_or(u64::MAX, |text| text.len() as u64).to_le_bytes());
        hash.update(text.unwrap_or_default());
    };
    let mut numbers: Vec<u64> = Vec::new();
    for cells in cells {
        match cells {
            Cells::Text(cells) => cells.iter().for_each(|cell| text(cell.as_deref())),
            Cells::Whole(cells) => cells.iter().for_each(|cell| {
                numbers.extend([u64::from(cell.is_some()), cell.unwrap_or_default().cast_unsigned()]);
            }),
            Cells::Number(cells) => cells.iter().for_each(|cell| {
                numbers.extend([u64::from(cell.is_some()), cell.unwrap_or_default().to_bits()]);
            }),
            Cells::Numbers(cells) => cells.iter().for_each(|cell| {
                numbers.push(cell.as_ref().map_or(u64::MAX, |list| list.len() as u64));
                numbers.extend(cell.iter().flatten().map(|value| value.to_bits()));
            }),
            _ => {}
        }
    }
    for number in numbers {
        hash.update(number.to_le_bytes());
    }
    hex(hash.finalize())
}
