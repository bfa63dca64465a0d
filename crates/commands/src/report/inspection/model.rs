//! A model's report for a person.

use std::fmt::Write as _;

use tactile_pose_fusion::fusion::{ForceAxes, TouchOutput};
use tactile_pose_fusion::model::{Batch, ModelInfo, Origin, unit_name};
use tactile_pose_fusion::units::GramForce;

use super::format::{bytes, number, printable, shortened, table};

/// Longest metadata value that is shown whole.
const MAX_VALUE: usize = 70;

/// The contract and the metadata, as a person reads them at a terminal.
pub fn text(model: &ModelInfo) -> String {
    let contract = &model.contract;
    let mut text = format!("{}\n", printable(&model.path.to_string_lossy()));
    let mut line = |name: &str, value: &str| {
        let _ = writeln!(text, "  {name:<9} {}", printable(value)); // a String takes every write
    };
    line("model", &format!("{}, ONNX opset {}, IR version {}", bytes(model.size_bytes), model.opset, model.ir_version));
    line("producer", if model.producer.is_empty() { "-" } else { &model.producer });
    line("sha256", &model.sha256);
    model.inputs.iter().for_each(|input| line("input", &input.to_string()));
    model.outputs.iter().for_each(|output| line("output", &output.to_string()));
    line(
        "batch",
        match model.batch {
            Batch::Dynamic => "any",
            Batch::One => "one window",
        },
    );
    line("window", &format!("{} frames", contract.window));
    line("taxels", &contract.n_taxels.to_string());
    for (name, terms) in &contract.regions {
        line(&format!("region {}", printable(name)), &format!("its joints: {}", terms.joints.join(", ")));
    }
    line(
        "joints",
        &match (&contract.joints, contract.n_region_joints()) {
            _ if !contract.regions.is_empty() => "of each region, as above".to_owned(),
            (_, 0) => "none: a model without pose".to_owned(),
            (Some(joints), n) => format!("{n}: {}", joints.join(", ")),
            (None, n) => format!("{n}, which the model doesn't name"),
        },
    );
    if contract.has_artifact() {
        let more = match contract.n_columns() > contract.n_taxels {
            true => "; the network also gets how far they can be trusted",
            false => "",
        };
        line(
            "artifact",
            &format!("told: what these joints make of the taxels is taken out of them, and followed{more}"),
        );
    }
    line("rate", &format!("{} Hz, {}", number(contract.rate_hz), origin(model.rate_from)));
    line("unit", &format!("{}, {}", unit_name(contract.unit), origin(model.unit_from)));
    if contract.axes == ForceAxes::Patch {
        line("force", "three axes: x, y, z in the frame of the patch; contact is decided on the part along its normal");
    }
    let base = match (contract.has_base, contract.n_joints) {
        (false, 0) if contract.has_artifact() => {
            "not given: where pose is missing, the artifact of the last angles is used"
        }
        (true, _) => "given: force of the tactile branch alone, used where pose is missing",
        (false, 0) => "not needed without pose",
        (false, _) => "not given: no estimate where pose is missing",
    };
    line("base", base);
    if let Some(TouchOutput { levels, false_per_min }) = contract.touch {
        let rate =
            false_per_min.map_or(String::new(), |rate| format!("; {} false touches/min when trained", number(rate)));
        line(
            "touch",
            &format!(
                "given: contact from a probability of {}, ends below {}{rate}",
                number(levels.on),
                number(levels.off)
            ),
        );
    }
    line(
        "run by",
        &match &model.not_builtin {
            None => "built-in code, unless parameters ask for a runtime: it is a network that tpf trains".to_owned(),
            Some(reason) => format!("ONNX Runtime or RTen: {reason}"),
        },
    );
    line(
        "mdf",
        &match contract.mdf {
            Some(mdf) => {
                format!("{} N ({} gF), minimum detectable force", number(mdf.0), number(GramForce::from(mdf).0))
            }
            None => "-".to_owned(),
        },
    );
    text += &pose_range(model);
    if !model.metadata.is_empty() {
        text += "\n  Metadata\n";
        for (key, value) in &model.metadata {
            let _ = writeln!(text, "    {}: {}", shortened(key, MAX_VALUE), shortened(value, MAX_VALUE));
        }
    }
    if !model.notes.is_empty() {
        text += "\n  Notes\n";
        model.notes.iter().for_each(|note| {
            let _ = writeln!(text, "    {}", printable(note));
        });
    }
    text
}

fn origin(origin: Origin) -> &'static str {
    match origin {
        Origin::Metadata => "as its metadata says",
        Origin::Parameters => "as the parameters say",
        Origin::Default => "assumed: the model doesn't say",
    }
}

/// The pose range of the training data, a row a joint.
fn pose_range(model: &ModelInfo) -> String {
    let Some(ranges) = &model.contract.pose_range else { return String::new() };
    let mut table = table(&["joint", "min rad", "max rad", "min deg", "max deg"]);
    for (idx, range) in ranges.iter().enumerate() {
        let name = model.contract.joints.as_ref().and_then(|joints| joints.get(idx));
        let name = name.map_or_else(|| format!("[{idx}]"), |name| printable(name));
        let rad = |angle: f64| format!("{angle:.3}");
        let deg = |angle: f64| format!("{:.1}", angle.to_degrees());
        table.add_row(vec![name, rad(range.min), rad(range.max), deg(range.min), deg(range.max)]);
    }
    format!("\n  Pose range of the training data\n\n{}\n", table.trim_fmt())
}
