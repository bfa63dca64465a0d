//! Arguments after `--ros-args`, by the rules of rcl.

use std::path::PathBuf;

use super::remap::Remap;
use super::security::Enclave;

/// All options of `--ros-args`.
#[derive(Debug, Clone, PartialEq)]
pub struct RosArgs {
    /// `-p`: overrides of parameters, as text.
    pub params: Vec<String>,
    /// `--params-file`, in order.
    pub params_files: Vec<PathBuf>,
    /// `-r`, in order: the first match wins.
    pub remaps: Vec<Remap>,
    /// `--log-level`: the lowest severity that is logged.
    pub log_level: Severity,
    /// True if logs go to `/rosout`.
    pub rosout: bool,
    /// True if logs go to stderr.
    pub stderr: bool,
    /// `--enclave`: the name of the enclave with this process's SROS2 keys.
    pub enclave: Enclave,
}

/// Severity of a log line. The numbers are those of `rcl_interfaces/msg/Log`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// For debugging.
    Debug = 10,
    /// Normal operation.
    Info = 20,
    /// Something is wrong, but the node goes on.
    Warn = 30,
    /// A request can't be carried out.
    Error = 40,
    /// The node can't go on.
    Fatal = 50,
}

/// Arguments that rcl would refuse, or that this node doesn't support.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum RosArgsError {
    #[error("{flag} of --ros-args needs {expected} after it")]
    NoValue { flag: String, expected: &'static str },
    #[error("{got:?} is not known after --ros-args; expected -p, -r, --params-file, --log-level or --enclave")]
    Unknown { got: String },
    #[error("{got:?} stands before --ros-args; expected an option of this command, or --ros-args")]
    NotRos { got: String },
    #[error("-r {rule}: {reason}")]
    Remap { rule: String, reason: String },
    #[error("--log-level {got}: expected debug, info, warn, error or fatal, with NODE:= in front or without")]
    LogLevel { got: String },
    #[error("--enclave {got}: {reason}; expected a name such as /lab/glove")]
    Enclave { got: String, reason: String },
}

impl Default for RosArgs {
    fn default() -> Self {
        RosArgs {
            params: Vec::new(),
            params_files: Vec::new(),
            remaps: Vec::new(),
            log_level: Severity::Info,
            rosout: true,
            stderr: true,
            enclave: Enclave::default(),
        }
    }
}

impl RosArgs {
    /// Reads arguments that begin with `--ros-args`. There may be several such groups, each ended by `--`.
    ///
    /// # Errors
    /// [`RosArgsError`] naming the argument that can't be read.
    pub fn parse(args: &[String]) -> Result<Self, RosArgsError> {
        let mut parsed = RosArgs::default();
        let mut args = args.iter().map(String::as_str);
        let mut inside = false;
        while let Some(arg) = args.next() {
            let mut value = |expected| {
                args.next().ok_or(RosArgsError::NoValue { flag: arg.to_owned(), expected }).map(str::to_owned)
            };
            match arg {
                "--ros-args" => inside = true,
                _ if !inside => return Err(RosArgsError::NotRos { got: arg.to_owned() }),
                "--" => inside = false,
                "-p" | "--param" => parsed.params.push(value("name:=value")?),
                "--params-file" => parsed.params_files.push(value("a file")?.into()),
                "-r" | "--remap" => {
                    let rule = value("from:=to")?;
                    let remap = Remap::parse(&rule).map_err(|reason| RosArgsError::Remap { rule, reason })?;
                    parsed.remaps.push(remap);
                }
                "--log-level" => parsed.log_level = log_level(&value("a level")?)?,
                "-e" | "--enclave" => {
                    let got = value("a name")?;
                    parsed.enclave = Enclave::parse(&got)
                        .map_err(|error| RosArgsError::Enclave { got, reason: error.reason().to_owned() })?;
                }
                "--enable-rosout-logs" => parsed.rosout = true,
                "--disable-rosout-logs" => parsed.rosout = false,
                "--enable-stdout-logs" => parsed.stderr = true,
                "--disable-stdout-logs" => parsed.stderr = false,
                // rcl can log to a file by an external library, which launch may switch on or off; this node has none.
                "--enable-external-lib-logs" | "--disable-external-lib-logs" => {}
                _ => return Err(RosArgsError::Unknown { got: arg.to_owned() }),
            }
        }
        Ok(parsed)
    }
}

/// `info`, or `node:=info`: this process has one logger, so both mean the same.
fn log_level(text: &str) -> Result<Severity, RosArgsError> {
    let level = text.rsplit_once(":=").map_or(text, |(_, level)| level);
    Ok(match level.to_ascii_lowercase().as_str() {
        "debug" => Severity::Debug,
        "info" => Severity::Info,
        "warn" => Severity::Warn,
        "error" => Severity::Error,
        "fatal" => Severity::Fatal,
        _ => return Err(RosArgsError::LogLevel { got: text.to_owned() }),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<RosArgs, String> {
        let args: Vec<String> = text.split_whitespace().map(str::to_owned).collect();
        RosArgs::parse(&args).map_err(|error| error.to_string())
    }

    #[test]
    fn every_flag_that_ros2_run_and_launch_write_is_read() {
        let args = parse(
            "--ros-args -r __node:=left --params-file a.yaml -p contact.on_frames:=3 --log-level rcl:=WARN -- --ros-args \
             --params-file b.yaml --disable-rosout-logs --enclave /left --disable-external-lib-logs",
        )
        .unwrap();
        assert_eq!(args.params, ["contact.on_frames:=3"]);
        assert_eq!(args.params_files, [PathBuf::from("a.yaml"), PathBuf::from("b.yaml")]);
        assert_eq!((args.log_level, args.rosout, args.stderr), (Severity::Warn, false, true));
        assert_eq!(args.enclave.to_string(), "/left");
        assert_eq!(args.remaps.len(), 1);
    }

    #[test]
    fn what_is_not_understood_is_refused_with_what_was_expected() {
        let refused = |text: &str| parse(text).unwrap_err();
        assert_eq!(refused("--ros-args -p"), "-p of --ros-args needs name:=value after it");
        assert!(
            refused("--ros-args --verbose").starts_with("\"--verbose\" is not known after --ros-args; expected -p")
        );
        assert!(refused("--ros-args -- --verbose").starts_with("\"--verbose\" stands before --ros-args"));
        assert!(refused("--ros-args --log-level loud").starts_with("--log-level loud: expected debug"));
        assert!(refused("--ros-args -e left").starts_with("--enclave left: "));
        assert!(refused("--ros-args -r a=b").starts_with("-r a=b: expected from:=to"));
    }
}
