//! What is read from ONNX files, and what the built-in code computes for graphs that it takes for the paper's network.
//!
//! A runtime is asked for the same forces only where the built-in code has taken the graph: every operator in it is known then,
//! and none makes tensors of a size that a file claims.

use tactile_pose_fusion::fusion::{ForceUnit, Fusion};
use tactile_pose_fusion::model::onnx::{
    DimensionProto, GraphProto, Message as _, ModelProto, TensorProto, ValueInfoProto, data_type,
};
use tactile_pose_fusion::model::{self, BackendChoice, ModelSpec};

use super::common::compared::is_close;
use super::common::fake::{self, Sum};
use super::common::graphs;
use super::common::onnx::LinearModel;
use super::driver::{Answer, Target, file_of};
use super::mutate::{self, Random};

pub const TARGET: Target = Target { name: "model", seeds, mutate: other, run, min_understood: 0.2 };

const KEYS: [&str; 9] =
    ["tpf.contract", "unit", "rate_hz", "window", "taxels", "joints", "pose_range", "metrics", "glove"];
const VALUES: [&str; 24] = [
    "1",
    "2",
    "gF",
    "N",
    "100",
    "1e300",
    "1e-300",
    "NaN",
    "-0",
    "4",
    "3",
    "mcp,pip",
    "[\"mcp\", \"pip\"]",
    "[[0, 1], [0, 1]]",
    "[[-1e308, 1e308], [0, 1]]",
    "[[1e999, 0]]",
    "{\"mdf_gf\": 10}",
    "{\"mdf_gf\": null}",
    "{\"mdf_gf\": 1e308}",
    "{}",
    "",
    "\u{0}\n",
    "99999999999999999999",
    "[[[[[[[[[[",
];

fn seeds() -> Vec<Vec<u8>> {
    let told = |model: LinearModel| {
        model
            .metadata("unit", "gF")
            .metadata("joints", "mcp,pip")
            .metadata("rate_hz", "100")
            .metadata("window", "4")
            .metadata("taxels", "3")
            .metadata("pose_range", "[[0, 1], [0, 1]]")
            .metadata("metrics", "{\"mdf_gf\": 10}")
    };
    let models = [
        told(LinearModel::new(4, 3, 2)),
        LinearModel::new(4, 3, 0).force_only(),
        LinearModel::new(4, 3, 2)
            .flaw(super::common::onnx::Flaw::DynamicFrames)
            .metadata("window", "4")
            .metadata("taxels", "3"),
    ];
    let mut seeds: Vec<Vec<u8>> = models.iter().map(LinearModel::bytes).collect();
    seeds.push(LinearModel::new(4, 3, 2).metadata("rate_hz", "1e12").bytes());
    let exported = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/pytorch");
    let mut exported: Vec<_> = std::fs::read_dir(exported).unwrap().map(|entry| entry.unwrap().path()).collect();
    exported.sort(); // the same inputs on every machine
    seeds.extend(
        exported
            .into_iter()
            .filter_map(|path| path.extension().is_some_and(|end| end == "onnx").then(|| std::fs::read(path).unwrap())),
    );
    seeds
}

fn other(random: &mut Random, seed: &[u8], other: &[u8]) -> Vec<u8> {
    let decoded = ModelProto::decode(seed);
    let (Ok(mut model), false) = (decoded, random.percent(25)) else {
        let mut input = seed.to_vec();
        mutate::bytes(random, &mut input, other);
        return input;
    };
    for _ in 0..if random.percent(60) { 1 } else { 3 } {
        change(random, &mut model);
    }
    model.encode_to_vec()
}

fn change(random: &mut Random, model: &mut ModelProto) {
    match random.below(8) {
        0 => model.push_metadata(random.pick::<&str>(&KEYS), random.pick::<&str>(&VALUES)),
        1 | 2 if !model.metadata_props.is_empty() => {
            let at = random.below(model.metadata_props.len());
            match random.below(3) {
                0 => drop(model.metadata_props.remove(at)),
                1 => model.metadata_props[at].value = (*random.pick(&VALUES)).to_owned(),
                _ => model.metadata_props[at].value = random.number().to_string(),
            }
        }
        3 if random.percent(10) => model.graph = None,
        4 | 5 => {
            if let Some(graph) = &mut model.graph {
                graphs::change(&mut |n| random.below(n.max(1)), graph);
            }
        }
        _ => {
            if let Some(graph) = &mut model.graph {
                change_graph(random, graph);
            }
        }
    }
}

fn change_graph(random: &mut Random, graph: &mut GraphProto) {
    match random.below(6) {
        0 | 1 => {
            let list = if random.percent(60) { &mut graph.input } else { &mut graph.output };
            change_list(random, list);
        }
        2 | 3 if !graph.initializer.is_empty() => {
            let at = random.below(graph.initializer.len());
            change_tensor(random, &mut graph.initializer[at]);
        }
        4 if !graph.node.is_empty() => {
            let at = random.below(graph.node.len());
            if random.percent(50) {
                graph.node.remove(at);
            } else {
                let again = graph.clone();
                let node = &mut graph.node[at];
                node.attribute
                    .push(tactile_pose_fusion::model::onnx::AttributeProto { g: Some(again), ..Default::default() });
            }
        }
        _ => {
            let name = (*random.pick(&["tactile", "pose", "force", "force_base", "x", ""])).to_owned();
            let tensor = TensorProto { name, dims: vec![random.number() as i64], ..Default::default() };
            graph.initializer.push(tensor);
        }
    }
}

fn change_list(random: &mut Random, list: &mut Vec<ValueInfoProto>) {
    if list.is_empty() {
        return list.push(ValueInfoProto::float32("tactile", vec![DimensionProto::named("N")]));
    }
    let at = random.below(list.len());
    match random.below(5) {
        0 => drop(list.remove(at)),
        1 => list.push(list[at].clone()),
        2 => list[at].name = (*random.pick(&["tactile", "pose", "force", "force_base", "x", "\n"])).to_owned(),
        _ => {
            let Some(tensor) = list[at].r#type.as_mut().and_then(|ty| ty.tensor_type.as_mut()) else { return };
            if random.percent(15) {
                tensor.elem_type = random.number() as i32;
            }
            let Some(shape) = &mut tensor.shape else { return };
            if shape.dim.is_empty() || random.percent(15) {
                return shape.dim.push(DimensionProto::fixed(random.number() as i64));
            }
            let dim = random.below(shape.dim.len());
            shape.dim[dim] = match random.below(3) {
                0 => DimensionProto::named("N"),
                1 => DimensionProto { value: None },
                _ => DimensionProto::fixed(random.number() as i64),
            };
        }
    }
}

fn change_tensor(random: &mut Random, tensor: &mut TensorProto) {
    match random.below(5) {
        0 => tensor.dims.push(random.number() as i64),
        1 => tensor.data_type = *random.pick(&[data_type::FLOAT, data_type::DOUBLE, data_type::INT64, 77, -1]),
        2 => {
            if let Some(raw) = &mut tensor.raw_data {
                mutate::bytes(random, raw, &[]);
            }
        }
        3 => tensor.raw_data = None,
        _ => tensor.data_location = random.number() as i32,
    }
}

fn run(input: &[u8]) -> Answer {
    let path = file_of("fuzzed.onnx", input);
    let info = match tactile_pose_fusion::model::inspect(&path) {
        Ok(info) => info,
        Err(error) => return super::one_line(&error),
    };
    for note in &info.notes {
        super::one_line(note);
    }
    let contract = info.contract;
    assert!(contract.window.get() * contract.n_columns().max(contract.n_joints) <= 1 << 22);
    assert!(contract.mdf.is_none_or(|mdf| mdf.0.is_finite()) && contract.rate_hz > 0.0);
    // Whatever a file says of itself, the core keeps up with it.
    if contract.window.get() * (contract.n_columns() + contract.n_joints) <= 1 << 12 {
        let joints: Vec<String> =
            contract.joints.clone().unwrap_or_else(|| (0..contract.n_joints).map(|idx| idx.to_string()).collect());
        let mut region = fake::region("index", &(0..contract.n_taxels).collect::<Vec<_>>(), &[]);
        region.joints = joints;
        let n_taxels = contract.n_taxels;
        for frame_clock in
            [tactile_pose_fusion::fusion::FrameClock::Tactile, tactile_pose_fusion::fusion::FrameClock::Grid]
        {
            let source = tactile_pose_fusion::fusion::TactileSource { frame_clock, ..fake::glove(n_taxels) };
            let cfg = fake::config_of(source, vec![region.clone()]);
            match Fusion::new(cfg, vec![Box::new(Sum { contract: contract.clone() })]) {
                Ok(mut core) => {
                    let samples: Vec<_> =
                        (0..4).map(|k| fake::Sample::tactile(f64::from(40 * k), &vec![1.0; n_taxels])).collect();
                    fake::run(&mut core, &samples);
                }
                Err(error) => {
                    super::one_line(&error);
                }
            }
        }
    }
    let own = run_by_own_code(&path);
    let unit = contract.unit == ForceUnit::Newton;
    Answer::understood(&(
        own,
        contract.window.get().min(8),
        contract.n_taxels.min(8),
        contract.n_joints,
        unit,
        info.notes.len(),
    ))
}

/// Largest weight of graphs whose forces are compared: sums of larger ones lose what is left when they cancel, in any
/// order.
const MAX_WEIGHT: f32 = 100.0;

/// Whether the built-in code takes the graph. What it computes then must be what a runtime computes.
fn run_by_own_code(path: &std::path::Path) -> bool {
    let load = |backend| model::load(&ModelSpec { backend, ..ModelSpec::new(path) });
    let mut own = match load(BackendChoice::Builtin) {
        Ok(own) => own,
        Err(refused) => {
            super::one_line(&refused);
            return false;
        }
    };
    let graph = graphs::read(path).graph.unwrap();
    let floats = graph.initializer.iter().filter(|tensor| tensor.data_type == data_type::FLOAT);
    if floats.flat_map(graphs::values_of).all(|value| value.abs() <= MAX_WEIGHT)
        && let Ok(mut runtime) = load(BackendChoice::Rten)
        && let Err(far) = is_close(&mut own, &mut runtime)
    {
        panic!("the built-in code takes this graph and gives other forces than a runtime: {far}");
    }
    true
}
