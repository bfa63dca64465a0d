//! The parameter file as text.

use super::ask::{Ask, Chooser, InitError};
use super::fingers::FINGERS;
use super::force;
use super::joints;
use super::plan::{JointSource, ModelFile, Region, TaxelSource, TruthSource};
use super::regions;
use super::taxels;
use super::yaml::{Yaml, list};
use crate::inspect::{BagReport, Likelihood, SourceLine, number, yaml_text};

/// How far from the model's rate a source still counts as being at it.
const RATE_TOLERANCE: f64 = 0.2;

/// A parameter file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Document {
    /// Its text.
    pub text: String,
    /// Guesses that no finding supports, one line each.
    pub guesses: Vec<String>,
    /// Topics that it reads: taxels, joint angles, true force.
    pub topics: Vec<String>,
    /// Names of its patches.
    pub regions: Vec<String>,
    /// Whether a true force is there to train on.
    pub has_truth: bool,
    /// Whether annotations tell when nothing is touched.
    pub has_annotations: bool,
}

/// The parameter file for what is in `bags`, to be used with `model` where there is one.
///
/// # Errors
/// [`InitError`] when no array is taxels, the model doesn't fit them, or a question stays without an answer.
pub fn document(bags: &[BagReport], model: Option<&ModelFile>, ask: &mut dyn Ask) -> Result<Document, InitError> {
    let mut chooser = Chooser::new(ask);
    let mut taxels = taxels::sources(bags, model, &mut chooser)?;
    let (joints, left_joints) = joints::sources(bags, &taxels, model, &mut chooser)?;
    let (mut truths, left_truths) = force::sources(bags, model, &mut chooser)?;
    let topic_of = |source: &TruthSource| source.lines.first().map(|(_, topic, _)| topic.clone());
    let taxel_topics: Vec<String> = taxels.iter().map(|source| yaml_text(&source.found.topic)).collect();
    truths.retain(|source| topic_of(source).is_none_or(|topic| !taxel_topics.contains(&topic)));
    for source in taxels.iter().filter(|source| source.found.likelihood != Likelihood::Likely) {
        chooser.guesses.push(format!(
            "nothing looks more like taxels than {}, which may be another sensor; look at it in the file",
            source.found.topic
        ));
    }
    let mut regions = regions::regions(&taxels, &joints, &truths, model, &mut chooser)?;
    // What a model leaves out needs no source either.
    taxels.retain(|source| regions.iter().any(|region| region.source == source.name));
    force::for_other_fingers(&mut truths, &mut regions);
    let guesses = chooser.guesses;
    let mut yaml = Yaml::default();
    opening(&mut yaml, bags, &guesses);
    let names = |all: Vec<&str>| list(&all);
    yaml.entry(4, "regions", &names(regions.iter().map(|one| one.name.as_str()).collect()), "");
    yaml.entry(4, "tactile_sources", &names(taxels.iter().map(|one| one.name.as_str()).collect()), "");
    yaml.entry(4, "joint_sources", &names(joints.iter().map(|one| one.name.as_str()).collect()), "");
    yaml.entry(4, "truth_sources", &names(truths.iter().map(|one| one.name.as_str()).collect()), "");
    yaml.empty();
    yaml.section(4, "tactile");
    taxels.iter().for_each(|source| tactile(&mut yaml, source, model));
    if !joints.is_empty() {
        yaml.empty();
        yaml.section(4, "joint");
        joints.iter().for_each(|source| joint(&mut yaml, source));
    }
    left_out(&mut yaml, "Not taken as joint angles", &left_joints);
    if !truths.is_empty() {
        yaml.empty();
        yaml.comment(4, "For training and evaluation; the live node and replay don't need it.");
        yaml.section(4, "truth");
        truths.iter().for_each(|source| truth(&mut yaml, source));
    }
    left_out(&mut yaml, "Not taken as true force", &left_truths);
    yaml.empty();
    models(&mut yaml, &regions, &taxels, model, !truths.is_empty());
    yaml.empty();
    yaml.section(4, "region");
    let several = taxels.len() > 1;
    regions.iter().for_each(|one| region(&mut yaml, one, several));
    stages(&mut yaml, bags);
    yaml.empty();
    yaml.entry(4, "glove", "\"\"", "serial number of this glove, kept with calibrations and recordings");
    yaml.entry(4, "user", "\"\"", "who wears it");
    let joint_topics = bags.iter().flat_map(|bag| &bag.topics).map(|topic| topic.stats.topic.clone());
    let is_read = |topic: &String| {
        let line = format!("        topic: {}\n", yaml_text(topic));
        yaml.contains(&line)
    };
    let mut topics: Vec<String> = joint_topics.filter(is_read).collect();
    topics.sort();
    topics.dedup();
    Ok(Document {
        guesses,
        topics,
        regions: regions.into_iter().map(|one| one.name).collect(),
        has_truth: !truths.is_empty(),
        has_annotations: bags.iter().any(|bag| !bag.candidates.stages.is_empty()),
        text: yaml.finish(),
    })
}

fn opening(yaml: &mut Yaml, bags: &[BagReport], guesses: &[String]) {
    let names = bags.iter().map(|bag| bag.path.as_str()).collect::<Vec<_>>().join(", ");
    yaml.comment(0, &format!("Parameters of tactile_pose_fusion, made by `tpf init` from {names}."));
    yaml.comment(
        0,
        "Beside each choice is its reason. What is not here has its default; params/example.yaml explains every key.",
    );
    if !guesses.is_empty() {
        yaml.comment(0, "");
        yaml.comment(0, "Nothing in the bags tells these; correct what is wrong:");
        guesses.iter().for_each(|guess| yaml.comment(0, &format!("- {guess}")));
    }
    yaml.empty();
    yaml.section(0, "/**");
    yaml.section(2, "ros__parameters");
}

fn left_out(yaml: &mut Yaml, what: &str, topics: &[String]) {
    if let [first, rest @ ..] = topics {
        let more = if rest.is_empty() { String::new() } else { format!(" and {} more", rest.len()) };
        yaml.comment(4, &format!("{what}: {first}{more}."));
    }
}

fn tactile(yaml: &mut Yaml, source: &TaxelSource, model: Option<&ModelFile>) {
    yaml.section(6, &source.name);
    source.why.iter().for_each(|why| yaml.comment(8, why));
    let is_clock = |line: &&SourceLine| !matches!(line, SourceLine::Value { key: "frame_clock", .. });
    let rate = source.found.sample_rate_hz;
    let known = model.and_then(|model| Some((rate?, model.rate_hz)));
    match known {
        None => lines(yaml, source.found.parameters.lines.iter()),
        Some(_) => lines(yaml, source.found.parameters.lines.iter().filter(is_clock)),
    }
    if let Some((rate, model)) = known.filter(|(rate, model)| (rate / model - 1.0).abs() > RATE_TOLERANCE) {
        let why = format!("samples come at {} Hz, the model's frames at {} Hz", number(rate), number(model));
        yaml.entry(8, "frame_clock", "grid", &why);
    }
    source.more.iter().for_each(|(key, value, why)| yaml.entry(8, key, value, why));
    yaml.entry(8, "sign", &source.sign.0.to_string(), &source.sign.1);
}

fn lines<'l>(yaml: &mut Yaml, lines: impl Iterator<Item = &'l SourceLine>) {
    for line in lines {
        match line {
            SourceLine::Value { key, value, note } => yaml.entry(8, key, value, note.as_deref().unwrap_or_default()),
            SourceLine::Remark(words) => yaml.comment(8, words),
        }
    }
}

fn joint(yaml: &mut Yaml, source: &JointSource<'_>) {
    yaml.section(6, &source.name);
    source.why.iter().for_each(|why| yaml.comment(8, why));
    lines(yaml, source.lines.lines.iter());
    source.more.iter().for_each(|(key, value, why)| yaml.entry(8, key, value, why));
}

fn truth(yaml: &mut Yaml, source: &TruthSource) {
    yaml.section(6, &source.name);
    source.why.iter().for_each(|why| yaml.comment(8, why));
    source.lines.iter().for_each(|(key, value, why)| yaml.entry(8, key, value, why));
}

fn models(yaml: &mut Yaml, regions: &[Region], taxels: &[TaxelSource], model: Option<&ModelFile>, has_truth: bool) {
    let path = |name: &str| model.map_or_else(|| yaml_text(&format!("{name}.onnx")), |model| yaml_text(&model.path));
    if model.is_none() {
        let n_taxels = taxels.iter().map(|source| source.n_taxels.to_string()).collect::<Vec<_>>().join(", ");
        let how = match has_truth {
            true => "train it on recordings with a true force, by `tpf train BAG --params-file THIS -o MODEL.onnx`",
            false => "record sessions with a force sensor (`tpf collect`), and train it on them (`tpf train`)",
        };
        yaml.comment(4, &format!("No model was given (taxels: {n_taxels}). To get one, {how}; or give an ONNX file to `tpf init --model`."));
    }
    yaml.section(4, "model");
    let mut told: Vec<&str> = Vec::new();
    for region in regions.iter().filter(|region| !region.model.is_empty()) {
        if told.contains(&region.model.as_str()) {
            continue;
        }
        told.push(&region.model);
        yaml.section(6, &region.model);
        let why = model.map_or_else(String::new, |model| model.why.clone());
        yaml.entry(8, "path", &path(&region.model), &why);
    }
}

fn region(yaml: &mut Yaml, region: &Region, several_sources: bool) {
    yaml.section(6, &region.name);
    region.why.iter().for_each(|why| yaml.comment(8, why));
    yaml.entry(8, "model", &region.model, "");
    if several_sources {
        yaml.entry(8, "tactile_source", &region.source, "");
    }
    if let Some(taxels) = &region.taxels {
        let taxels = taxels.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
        yaml.entry(8, "taxels", &format!("[{taxels}]"), "");
    }
    if !region.joints.is_empty() {
        yaml.entry(8, "joints", &list(&region.joints), "");
    }
    if !region.model_joints.is_empty() {
        yaml.entry(8, "model_joints", &list(&region.model_joints), "the model was trained on another finger");
    }
    if let Some(truth) = &region.truth {
        yaml.entry(8, "truth", truth, "");
    }
    let is_tip = region.finger.is_some_and(|finger| FINGERS.contains(&finger));
    let frame_id = if is_tip { format!("{}_tip", region.name) } else { region.name.clone() };
    yaml.entry(8, "frame_id", &frame_id, "CHECK: the frame as your robot description names it");
}

fn stages(yaml: &mut Yaml, bags: &[BagReport]) {
    let mut stages = bags.iter().flat_map(|bag| &bag.candidates.stages);
    let Some(stage) = stages.find(|stage| !stage.parameters.is_empty()) else { return };
    yaml.empty();
    yaml.entry(4, "stage_topic", &yaml_text(&stage.topic), "annotations of the recording are there");
}
