//! Changes of ONNX graphs: such as people make in `forward`, and others at random.

use tactile_pose_fusion::model::onnx::{
    AttributeProto, GraphProto, Message as _, ModelProto, NodeProto, TensorProto, data_type,
};

/// The model in a file.
pub fn read(path: &std::path::Path) -> ModelProto {
    ModelProto::decode(std::fs::read(path).unwrap().as_slice()).unwrap()
}

/// Puts nodes between a tensor and all that read it. `make` is given the names of what it reads and of what it must give.
pub fn behind(graph: &mut GraphProto, tensor: &str, make: impl FnOnce(&mut GraphProto, &str, &str)) {
    let changed = format!("{tensor}.changed");
    for input in graph.node.iter_mut().flat_map(|node| &mut node.input).filter(|input| *input == tensor) {
        input.clone_from(&changed);
    }
    let at = 1 + graph
        .node
        .iter()
        .rposition(|node| node.output.iter().any(|output| output == tensor))
        .map_or(-1, |at| at as isize);
    let rest = graph.node.split_off(at as usize);
    make(graph, tensor, &changed);
    graph.node.extend(rest);
}

/// Appends a node of a standard operator.
pub fn node(graph: &mut GraphProto, op: &str, inputs: &[&str], output: &str, attributes: Vec<AttributeProto>) {
    graph.node.push(NodeProto::standard(op, inputs, &[output], attributes));
}

/// Adds a float constant and gives its name.
pub fn floats(graph: &mut GraphProto, dims: &[i64], values: &[f32]) -> String {
    let name = format!("constant_{}", graph.initializer.len());
    graph.initializer.push(TensorProto::float32(&name, dims, values));
    name
}

/// Adds a list of integers and gives its name.
pub fn integers(graph: &mut GraphProto, values: &[i64]) -> String {
    let name = format!("constant_{}", graph.initializer.len());
    graph.initializer.push(TensorProto::int64(&name, &[values.len() as i64], values));
    name
}

/// Values of a float tensor.
pub fn values_of(tensor: &TensorProto) -> Vec<f32> {
    match &tensor.raw_data {
        Some(raw) => raw.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect(),
        None => tensor.float_data.clone(),
    }
}

/// Where numbers less than the one that is given come from.
pub type Below<'r> = &'r mut dyn FnMut(usize) -> usize;

/// Changes one thing in a graph; what it was, in words. The graph may be one that no runtime takes any more.
pub fn change(below: Below<'_>, graph: &mut GraphProto) -> String {
    if graph.node.is_empty() || graph.output.is_empty() {
        return "nothing".to_owned();
    }
    let at = below(graph.node.len());
    let label = format!("{} {}", graph.node[at].op_type, graph.node[at].output.first().cloned().unwrap_or_default());
    match below(8) {
        0 | 1 => format!("{} before {label}", insert(below, graph, at)),
        2 => format!("attribute of {label}: {}", change_attribute(below, &mut graph.node[at])),
        3 => change_constant(below, graph),
        4 => format!("connection of {label}: {}", reconnect(below, graph, at)),
        5 => format!("{label} is {}", change_operator(below, &mut graph.node[at])),
        6 => {
            let node = graph.node.remove(at);
            let (Some(from), Some(to)) = (node.input.first(), node.output.first()) else {
                return format!("no {label}");
            };
            let readers = graph.node.iter_mut().flat_map(|node| &mut node.input).filter(|input| *input == to);
            readers.for_each(|input| input.clone_from(from));
            if graph.output.iter().any(|output| output.name == *to) {
                graph.node.push(NodeProto::standard("Identity", &[from], &[to], vec![]));
            }
            format!("{label} left out")
        }
        _ => {
            let (a, b) = (below(graph.output.len()), below(graph.output.len()));
            let names = [a, b].map(|at| graph.output[at].name.clone());
            graph.output[a].name.clone_from(&names[1]);
            graph.output[b].name.clone_from(&names[0]);
            for name in graph.node.iter_mut().flat_map(|node| node.input.iter_mut().chain(&mut node.output)) {
                if let Some(at) = names.iter().position(|other| other == name) {
                    name.clone_from(&names[1 - at]);
                }
            }
            format!("outputs {names:?} exchanged")
        }
    }
}

/// Puts an operator into one connection.
fn insert(below: Below<'_>, graph: &mut GraphProto, at: usize) -> String {
    let slots = graph.node[at].input.len();
    if slots == 0 {
        return "nothing".to_owned();
    }
    let slot = below(slots);
    let (from, to) = (graph.node[at].input[slot].clone(), format!("inserted_{}", graph.node.len()));
    let factor = [0.0, 0.5, 1.0, -1.0, 2.0, 1.000_1, 20.0][below(7)];
    let number = floats(graph, &[], &[factor]);
    let float = |name: &str| vec![AttributeProto::float(name, factor)];
    let permutation = AttributeProto::ints("perm", &[[0, 2, 1], [1, 0, 2], [0, 1, 2]][below(3)]);
    let (op, inputs, attributes) = match below(16) {
        0 => ("Identity", vec![from.as_str()], vec![]),
        1 => ("Relu", vec![from.as_str()], vec![]),
        2 => ("Neg", vec![from.as_str()], vec![]),
        3 => ("Abs", vec![from.as_str()], vec![]),
        4 => ("Tanh", vec![from.as_str()], vec![]),
        5 => ("LeakyRelu", vec![from.as_str()], float("alpha")),
        6 => ("Elu", vec![from.as_str()], float("alpha")),
        7 => ("Clip", vec![from.as_str(), &number], vec![]),
        8 => ("Clip", vec![from.as_str(), "", &number], vec![]),
        9 => ("Mul", vec![from.as_str(), &number], vec![]),
        10 => ("Add", vec![&number, from.as_str()], vec![]),
        11 => ("Sub", vec![from.as_str(), &number], vec![]),
        12 => ("Max", vec![from.as_str(), &number], vec![]),
        13 => ("Transpose", vec![from.as_str()], vec![permutation]),
        14 => ("Floor", vec![from.as_str()], vec![]),
        _ => ("Sin", vec![from.as_str()], vec![]),
    };
    let inserted = NodeProto::standard(op, &inputs, &[&to], attributes);
    graph.node[at].input[slot].clone_from(&to);
    graph.node.insert(at, inserted);
    format!("{op} {factor} at {slot}")
}

fn change_attribute(below: Below<'_>, node: &mut NodeProto) -> String {
    if node.attribute.is_empty() || below(4) == 0 {
        let new = match below(9) {
            0 => AttributeProto::float("clip", 0.5),
            1 => AttributeProto::int("input_forget", 1),
            2 => AttributeProto::float("alpha", 0.5),
            3 => AttributeProto::int("axis", 1),
            4 => AttributeProto::string("auto_pad", "SAME_LOWER"),
            5 => AttributeProto::int("ceil_mode", 1),
            6 => AttributeProto::string("approximate", "tanh"),
            7 => AttributeProto::int("transA", 1),
            _ => AttributeProto::int("layout", 1),
        };
        let name = new.name.clone();
        node.attribute.retain(|attribute| attribute.name != name);
        node.attribute.push(new);
        return format!("{name} added");
    }
    let at = below(node.attribute.len());
    if below(5) == 0 {
        return format!("{} removed", node.attribute.remove(at).name);
    }
    let step = [1, -1, 2][below(3)];
    let text = ["tanh", "none", "forward", "reverse", "bidirectional", "SAME_UPPER", "VALID"][below(7)];
    let attribute = &mut node.attribute[at];
    match attribute.r#type {
        1 => attribute.f = attribute.f.map(|f| f * 1.5),
        2 => attribute.i = Some(attribute.i.unwrap_or_default() + step),
        3 => attribute.s = Some(text.as_bytes().to_vec()),
        4 => {
            if let Some(tensor) = &mut attribute.t {
                change_tensor(below, tensor);
            }
        }
        _ if !attribute.ints.is_empty() => {
            let at = below(attribute.ints.len());
            attribute.ints[at] += step;
        }
        _ => {}
    }
    format!("{} changed", attribute.name)
}

fn change_constant(below: Below<'_>, graph: &mut GraphProto) -> String {
    if graph.initializer.is_empty() {
        return "nothing".to_owned();
    }
    // Single numbers more often than weights, of which any may be another.
    let small: Vec<usize> = (0..graph.initializer.len()).filter(|at| graph.initializer[*at].dims.len() < 2).collect();
    let at = if small.is_empty() { below(graph.initializer.len()) } else { small[below(small.len())] };
    let tensor = &mut graph.initializer[at];
    change_tensor(below, tensor);
    format!("constant {}", tensor.name)
}

fn change_tensor(below: Below<'_>, tensor: &mut TensorProto) {
    let Some(raw) = &mut tensor.raw_data else { return };
    match tensor.data_type {
        data_type::FLOAT if raw.len() >= 4 => {
            let at = 4 * below(raw.len() / 4);
            let value = f32::from_le_bytes([raw[at], raw[at + 1], raw[at + 2], raw[at + 3]]);
            let other = [value * 1.01 + 0.01, -value, 0.0, value * 3.0][below(4)];
            raw[at..at + 4].copy_from_slice(&other.to_le_bytes());
        }
        data_type::INT64 if raw.len() >= 8 => {
            let at = 8 * below(raw.len() / 8);
            let mut bytes = [0; 8];
            bytes.copy_from_slice(&raw[at..at + 8]);
            let other = i64::from_le_bytes(bytes).wrapping_add([1, -1, 2, -2][below(4)]);
            raw[at..at + 8].copy_from_slice(&other.to_le_bytes());
        }
        _ => {}
    }
}

fn reconnect(below: Below<'_>, graph: &mut GraphProto, at: usize) -> String {
    let n = graph.node[at].input.len();
    if n == 0 {
        return "none".to_owned();
    }
    match below(4) {
        0 if n > 1 => {
            let (a, b) = (below(n), below(n));
            graph.node[at].input.swap(a, b);
            format!("{a} and {b} exchanged")
        }
        1 => {
            let gone = graph.node[at].input.pop();
            format!("without {gone:?}")
        }
        _ => {
            let made = graph.node[..at].iter().flat_map(|node| &node.output);
            let inputs = graph.input.iter().map(|input| &input.name);
            let choices: Vec<String> =
                made.chain(inputs).chain(graph.initializer.iter().map(|t| &t.name)).cloned().collect();
            if choices.is_empty() {
                return "none".to_owned();
            }
            let (slot, other) = (below(n), choices[below(choices.len())].clone());
            graph.node[at].input[slot].clone_from(&other);
            format!("{slot} is {other}")
        }
    }
}

fn change_operator(below: Below<'_>, node: &mut NodeProto) -> String {
    let others: &[&str] = match node.op_type.as_str() {
        "Sin" | "Cos" => &["Sin", "Cos", "Tan"],
        "Relu" => &["LeakyRelu", "Sigmoid", "Elu", "Softplus", "Identity"],
        "Erf" => &["Tanh", "Sigmoid"],
        "Gelu" => &["Relu", "Erf"],
        "Sub" | "Add" | "Mul" | "Div" => &["Sub", "Add", "Mul", "Div", "Max", "Min"],
        "MaxPool" => &["AveragePool", "LpPool"],
        "ReduceMax" => &["ReduceMean", "ReduceMin", "ReduceSum"],
        "Squeeze" => &["Unsqueeze", "Identity"],
        "Flatten" | "Reshape" | "Transpose" => &["Identity"],
        _ => &["Identity", "Relu"],
    };
    let other = others[below(others.len())];
    node.op_type = other.to_owned();
    other.to_owned()
}
