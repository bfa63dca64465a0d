//! From command line and parameter file to models, topics and the core: what replay and calibrate have in common.

use std::path::{Path, PathBuf};

use clap::ValueEnum;

use super::{Failure, tell};
#[cfg(feature = "ros")]
use crate::report::progress::Said;
pub(super) use tactile_pose_fusion::bag::shown;
#[cfg(feature = "ros")]
use tactile_pose_fusion::bag::{quoted, quoted_path};
use tactile_pose_fusion::config::{Config, DEFAULT_NODE, Origin, Param, ParamTree, ParamValue, load_tree};
use tactile_pose_fusion::glove;
#[cfg(feature = "ros")]
use tactile_pose_fusion::glove::Models;
use tactile_pose_fusion::model::BackendChoice;

/// Where the parameters come from.
#[derive(Debug, clap::Args)]
pub(super) struct ParamArgs {
    /// ROS 2 parameter file: topics, taxels, joints, models, thresholds (params/example.yaml explains every key)
    #[arg(long, value_name = "FILE", required = true)]
    params_file: Vec<PathBuf>,
    /// Set one parameter over the file's, as in --ros-args -p
    #[arg(short, long = "param", value_name = "KEY:=VALUE")]
    param: Vec<String>,
    /// Full name of the node whose parameters are meant and whose topics are written
    #[arg(long, value_name = "NAME", default_value = DEFAULT_NODE)]
    node: String,
}

impl ParamArgs {
    /// The parameters as they were given, to be given again.
    #[cfg(feature = "ros")]
    pub(super) fn as_given(&self) -> String {
        let files = self.params_file.iter().map(|file| format!(" --params-file {}", quoted_path(file)));
        let node = (self.node != DEFAULT_NODE).then(|| format!(" --node {}", quoted(&self.node)));
        files.chain(self.param.iter().map(|param| format!(" -p {}", quoted(param)))).chain(node).collect()
    }
}

/// Which models run, and in what.
#[derive(Debug, clap::Args)]
pub(super) struct ModelArgs {
    /// Model to use instead of the one in the parameters
    #[arg(long, value_name = "ONNX")]
    model: Option<PathBuf>,
    #[command(flatten)]
    backend: BackendArgs,
}

/// In what models run.
#[derive(Debug, clap::Args)]
pub(super) struct BackendArgs {
    /// What runs the models; auto: the built-in code for the networks that tpf trains, else ONNX Runtime where it is found, else RTen
    #[arg(long, value_enum)]
    backend: Option<Backend>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Backend {
    Auto,
    Builtin,
    Onnxruntime,
    Rten,
}

impl ParamArgs {
    /// The configuration that the parameters make.
    pub(super) fn load(&self) -> Result<Config, Failure> {
        self.load_with_truth(None)
    }

    /// The configuration that the parameters make, with the true force on another topic than theirs: that of the only
    /// force sensor, or of one that they don't have.
    pub(super) fn load_with_truth(&self, truth: Option<&str>) -> Result<Config, Failure> {
        let mut tree = load_tree(&self.params_file, &self.node)?;
        for rule in &self.param {
            if !tree.set_override(rule)? {
                return Err(Failure(format!("-p {rule} is for another node than {}; correct it or --node", self.node)));
            }
        }
        let Some(topic) = truth else { return config(&tree) };
        let absolute = topic.trim_start_matches('/');
        let is_taken = |(key, param): &(&str, &Param)| {
            let is_topic = key.starts_with("tactile.") && key.ends_with(".topic");
            is_topic && matches!(&param.value, ParamValue::Str(name) if name.trim_start_matches('/') == absolute)
        };
        if let Some((key, _)) = tree.iter().find(is_taken) {
            return Err(Failure(format!(
                "--truth {topic}: {key} names it as the topic of taxels, and taxels can't be their own true force; name the topic of a force sensor"
            )));
        }
        let sources = match tree.get("truth_sources").map(|param| &param.value) {
            Some(ParamValue::StrArray(sources)) => sources.clone(),
            _ => Vec::new(),
        };
        let source = match sources.as_slice() {
            [] => "truth",
            [only] => only,
            several => {
                let several = several.join(", ");
                return Err(Failure(format!(
                    "--truth stands for one force sensor, the parameters have {several}; set -p truth.NAME.topic:=TOPIC"
                )));
            }
        };
        tree.set("truth_sources", ParamValue::StrArray(vec![source.to_owned()]), Origin::CommandLine);
        tree.set(&format!("truth.{source}.topic"), ParamValue::Str(topic.to_owned()), Origin::CommandLine);
        config(&tree)
    }
}

/// The configuration that parameters make. Says which of their keys are of other nodes.
pub(super) fn config(tree: &ParamTree) -> Result<Config, Failure> {
    let cfg = Config::from_tree(tree)?;
    cfg.note_on_others().iter().for_each(|note| tell(note));
    Ok(cfg)
}

impl ModelArgs {
    /// The model that the command line names instead of that of the parameters.
    pub(super) fn path(&self) -> Option<&Path> {
        self.model.as_deref()
    }

    /// The backend that the command line names.
    pub(super) fn choice(&self) -> Option<BackendChoice> {
        self.backend.choice()
    }

    /// Whether the command line names another model than the parameters.
    pub(super) fn replaces(&self) -> bool {
        self.model.is_some()
    }

    /// Puts what the command line says about models into the configuration.
    pub(super) fn apply(&self, cfg: &mut Config) -> Result<(), Failure> {
        if let Some(path) = &self.model {
            glove::replace_model(cfg, path.clone())?.iter().for_each(|note| tell(note));
        }
        self.backend.apply(cfg);
        Ok(())
    }
}

impl BackendArgs {
    /// The backend that the command line names.
    pub(super) fn choice(&self) -> Option<BackendChoice> {
        self.backend.map(|backend| match backend {
            Backend::Auto => BackendChoice::Auto,
            Backend::Builtin => BackendChoice::Builtin,
            Backend::Onnxruntime => BackendChoice::OnnxRuntime,
            Backend::Rten => BackendChoice::Rten,
        })
    }

    /// Puts what the command line says about runtimes into the configuration.
    fn apply(&self, cfg: &mut Config) {
        let Some(backend) = self.choice() else { return };
        cfg.models_mut().iter_mut().for_each(|model| model.spec.backend = backend);
    }
}

/// Loads the models of a configuration and says in which runtime each runs.
#[cfg(feature = "ros")]
pub(super) fn load_models(cfg: &Config) -> Result<Models, Failure> {
    let models = Models::load(cfg)?;
    models.tell(cfg, &Said);
    Ok(models)
}

#[cfg(all(test, feature = "ros"))]
mod tests {
    use super::*;

    #[test]
    fn arguments_are_given_again_as_a_shell_takes_them() {
        let params = |param: &str, node: &str| ParamArgs {
            params_file: vec!["params/glove 1.yaml".into()],
            param: vec![param.to_owned()],
            node: node.to_owned(),
        };
        let usual = params("regions:=[index, thumb]", DEFAULT_NODE).as_given();
        assert_eq!(usual, " --params-file 'params/glove 1.yaml' -p 'regions:=[index, thumb]'");
        assert_eq!(
            params("user:=o'hara", "/left").as_given().split_once(" -p ").unwrap().1,
            r"'user:=o'\''hara' --node /left"
        );
    }
}
