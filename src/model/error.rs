//! Errors of models. Each message is one line.

use std::path::PathBuf;

/// Why a model file can't be used. The message names the file, what was expected, what was found, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The file can't be read.
    #[error("{path}: can't read the model: {reason}{}", of_absent(.reason))]
    Read {
        /// The model file.
        path: PathBuf,
        /// Message of the system.
        reason: std::io::Error,
    },
    /// The file is larger than any model that is expected.
    #[error("{path}: the file has more than {limit_mib} MiB, expected a model of a few MiB; is it the right file?")]
    TooLarge {
        /// The model file.
        path: PathBuf,
        /// The largest file that is read, MiB.
        limit_mib: u64,
    },
    /// The model has more nodes than runtimes load in reasonable time.
    #[error("{path}: has {n_nodes} nodes, expected at most {most}; simplify its graph, or export it with optimization")]
    TooManyNodes {
        /// The file.
        path: PathBuf,
        /// Its nodes.
        n_nodes: usize,
        /// The largest accepted number.
        most: usize,
    },
    /// The bytes are not a whole ONNX model.
    #[error("{path}: not a whole ONNX model: {reason}; export it again")]
    Malformed {
        /// The model file.
        path: PathBuf,
        /// The problem.
        reason: String,
    },
    /// The values of a tensor are in another file.
    #[error("{path}: tensor {tensor} keeps its values in another file; export the model into one file")]
    ExternalData {
        /// The model file.
        path: PathBuf,
        /// The tensor.
        tensor: String,
    },
    /// A weight is NaN or infinite.
    #[error(
        "{path}: tensor {tensor} holds {value} at element {element}, expected finite weights; train or export the model again"
    )]
    NonFiniteWeight {
        /// The model file.
        path: PathBuf,
        /// The tensor.
        tensor: String,
        /// Index of the first such element, row-major.
        element: usize,
        /// The element, as text.
        value: String,
    },
    /// A metadata entry can't be understood.
    #[error("{path}: metadata {key} is {value}, expected {expected}; correct metadata_props or remove the key")]
    Metadata {
        /// The model file.
        path: PathBuf,
        /// The key in `metadata_props`.
        key: String,
        /// Its value, shortened.
        value: String,
        /// The expected form.
        expected: String,
    },
    /// Two sources give different values.
    #[error("{path}: {first}, but {second}; {remedy}")]
    Conflict {
        /// The model file.
        path: PathBuf,
        /// The first source with its value.
        first: String,
        /// The second source with its value.
        second: String,
        /// The remedy.
        remedy: String,
    },
    /// A tensor of the contract is missing.
    #[error(
        "{path}: no {kind} named {name}; the model has {present}; if one of them is meant, name it in the parameter model.NAME.{parameter}"
    )]
    MissingTensor {
        /// The model file.
        path: PathBuf,
        /// `input` or `output`.
        kind: &'static str,
        /// The name in the contract or the parameters.
        name: String,
        /// The tensors that exist, with types and shapes.
        present: String,
        /// The parameter that maps the name.
        parameter: &'static str,
    },
    /// The model has an input that the contract doesn't know.
    #[error(
        "{path}: input {input} is neither the tactile nor the pose input; if it is the pose, name it in the parameter model.NAME.inputs.pose"
    )]
    UnknownInput {
        /// The model file.
        path: PathBuf,
        /// The input with its type and shape.
        input: String,
    },
    /// A tensor is not a float32 tensor.
    #[error("{path}: {kind} {name} is {got}, expected float32; export the model in float32")]
    ElementType {
        /// The model file.
        path: PathBuf,
        /// `input` or `output`.
        kind: &'static str,
        /// The tensor.
        name: String,
        /// Its element type.
        got: String,
    },
    /// A tensor has another shape than the contract requires.
    #[error("{path}: {kind} {name} has shape {got}, expected {expected}")]
    Shape {
        /// The model file.
        path: PathBuf,
        /// `input` or `output`.
        kind: &'static str,
        /// The tensor.
        name: String,
        /// Its shape.
        got: String,
        /// The expected shape, and what to do about it.
        expected: String,
    },
    /// The batch is fixed at a size other than 1.
    #[error(
        "{path}: input {name} has shape {got}, a batch fixed at {batch} windows; export it with a dynamic batch (or a batch of 1)"
    )]
    FixedBatch {
        /// The model file.
        path: PathBuf,
        /// The tensor.
        name: String,
        /// Its shape.
        got: String,
        /// The fixed size.
        batch: u64,
    },
    /// The touch output gave a value that is not a probability.
    #[error(
        "{path}: output {output} gave {value}, expected a probability of touch from 0 to 1; export it after its sigmoid, or name another output in the parameter model.NAME.outputs.touch"
    )]
    NoProbability {
        /// The model file.
        path: PathBuf,
        /// The output.
        output: String,
        /// The value that it gave.
        value: f32,
    },
    /// The runtime that the parameters ask for is missing.
    #[error("{path}: backend onnxruntime can't be used: {reason}; run scripts/fetch-onnxruntime or set backend: rten")]
    NoOnnxRuntime {
        /// The model file.
        path: PathBuf,
        /// Where it was searched for, and what was found.
        reason: String,
    },
    /// The model was trained for another glove than the parameters name.
    #[error(
        "{path}: was trained on glove {trained:?}, the parameters say {key}: {wanted:?}; take the model of this glove, correct `{key}`, or set model.NAME.glove to {trained:?} to use it all the same"
    )]
    OtherGlove {
        /// The model file.
        path: PathBuf,
        /// The glove in its metadata.
        trained: String,
        /// The parameter that names the other glove.
        key: &'static str,
        /// The glove that it names.
        wanted: String,
    },
    /// The parameters ask for the built-in code, which can't run the model.
    #[error("{path}: backend builtin can't run it: {reason}; set backend: auto, onnxruntime or rten")]
    NotBuiltin {
        /// The model file.
        path: PathBuf,
        /// The difference from our networks.
        reason: String,
    },
    /// The runtime refuses the model, or fails to run it.
    #[error("{path}: {reason}")]
    Runtime {
        /// The model file.
        path: PathBuf,
        /// The runtime and its message.
        reason: String,
    },
    /// The first run, in a separate process, failed or ended that process.
    #[error("{line}")]
    FirstRun {
        /// Message of that process, or how it ended.
        line: String,
    },
    /// A trial run gave a force that is not finite.
    #[error(
        "{path}: output {output} is {value} for {window}, expected a finite force; train or export the model again"
    )]
    NonFiniteOutput {
        /// The model file.
        path: PathBuf,
        /// The output.
        output: String,
        /// The value that it gave.
        value: f32,
        /// The trial window, in words.
        window: String,
    },
    /// The force of a window depends on the other windows of its batch.
    #[error(
        "{path}: output {output} mixes the windows of a batch: with {scale} readings a window gives {alone} alone and {batched} among three; export the model in evaluation mode, with the batch as its first dimension"
    )]
    MixesWindows {
        /// The model file.
        path: PathBuf,
        /// The output.
        output: String,
        /// Size of the trial's readings, in one word.
        scale: &'static str,
        /// The force of the window on its own.
        alone: f32,
        /// The force of the same window in a batch.
        batched: f32,
    },
    /// Base, residual and force disagree.
    #[error(
        "{path}: {force} is {got}, but {base} - {residual} is {expected}; the convention is {force} = {base} - {residual}{hint}"
    )]
    Convention {
        /// The model file.
        path: PathBuf,
        /// Name of the force output.
        force: String,
        /// Name of the base output.
        base: String,
        /// Name of the residual output.
        residual: String,
        /// The force of the model.
        got: f32,
        /// Base minus residual.
        expected: f32,
        /// The remedy, if it is known. Starts with `; `.
        hint: &'static str,
    },
}

/// Text from a file or a runtime as one line of limited length, so that it can't break the format of an error.
pub(super) fn one_line(text: &str) -> String {
    const MAX_CHARS: usize = 300;
    let mut line: String = text.split_whitespace().collect::<Vec<_>>().join(" ");
    line.retain(|c| !c.is_control());
    match line.char_indices().nth(MAX_CHARS) {
        Some((end, _)) => format!("{}...", &line[..end]),
        None => line,
    }
}

/// What to do about a file that isn't there.
fn of_absent(reason: &std::io::Error) -> &'static str {
    match reason.kind() {
        std::io::ErrorKind::NotFound => {
            "; name another model (--model, or model.NAME.path), or train one of this glove with tpf train"
        }
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_text_becomes_one_short_line() {
        assert_eq!(one_line("a\n  b\u{7}c"), "a bc");
        let long = one_line(&"é".repeat(5000));
        assert_eq!(long.chars().count(), 303);
    }
}
