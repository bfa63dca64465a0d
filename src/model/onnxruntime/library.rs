//! Finds the shared library of ONNX Runtime, and loads it once per process.
//!
//! Search order: `ORT_DYLIB_PATH`; the folder of the executable, its `onnxruntime/` and `lib/`, and `../onnxruntime`;
//! `onnxruntime/` in the cargo `target` folder of the executable; the system's loader. If the environment variable is
//! set, only that library is tried, and no other replaces it.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use ort::environment::Environment;

use super::super::error::one_line;

/// Environment variable with the path of the library.
const ENV: &str = "ORT_DYLIB_PATH";

/// A loaded library.
#[derive(Debug)]
pub(super) struct Library {
    /// Kept until the process ends, because ort can't create a second environment.
    pub(super) environment: Environment,
    /// Path of the library, if it is known.
    pub(super) path: PathBuf,
    /// Its version, or `unknown`.
    pub(super) version: String,
}

/// The library of this process. The first call searches for it.
pub(super) fn loaded() -> Result<&'static Library, String> {
    static LIBRARY: OnceLock<Result<Library, String>> = OnceLock::new();
    LIBRARY.get_or_init(|| find(std::env::var_os(ENV), std::env::current_exe().ok())).as_ref().map_err(Clone::clone)
}

fn find(named: Option<OsString>, executable: Option<PathBuf>) -> Result<Library, String> {
    if let Some(named) = named.filter(|named| !named.is_empty()) {
        let path = PathBuf::from(named);
        let file = fs::canonicalize(&path).map_err(|e| format!("{ENV} is {}: {e}", path.display()))?;
        return load(&file).map_err(|said| format!("{ENV} is {}: {said}", path.display()));
    }
    let mut failed = Vec::new();
    let found = executable.iter().flat_map(|executable| folders(executable)).flat_map(|folder| libraries_in(&folder));
    for path in found {
        match load(&path) {
            Ok(library) => return Ok(library),
            Err(said) => failed.push(format!("{}: {said}", path.display())),
        }
    }
    for name in system_names() {
        match load(Path::new(&name)) {
            Ok(library) => return Ok(library),
            // A name that the loader doesn't find is normal. A library that it finds but can't load is an error to
            // report.
            Err(said) if said.contains("cannot open shared object") || said.contains("no such file") => {}
            Err(said) => failed.push(said),
        }
    }
    match failed.first() {
        Some(first) => Err(one_line(first)),
        None => Err(format!("{ENV} is not set, and no library lies beside the executable or where the system looks")),
    }
}

/// Folders near an executable that may contain the library.
fn folders(executable: &Path) -> Vec<PathBuf> {
    let mut folders = Vec::new();
    if let Some(beside) = executable.parent() {
        folders.extend([beside.to_path_buf(), beside.join("onnxruntime"), beside.join("lib")]);
        folders.extend(beside.parent().map(|above| above.join("onnxruntime")));
    }
    let targets = executable.ancestors().filter(|folder| folder.file_name().is_some_and(|name| name == "target"));
    folders.extend(targets.map(|target| target.join("onnxruntime")));
    folders
}

/// Libraries in a folder: the plain name first, then newer versions before older ones, by file name.
fn libraries_in(folder: &Path) -> Vec<PathBuf> {
    let stem = format!("{DLL_PREFIX}onnxruntime.");
    let plain = format!("{DLL_PREFIX}onnxruntime{DLL_SUFFIX}");
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .filter(|name| name.starts_with(&stem) && name.contains(DLL_SUFFIX))
        .filter(|name| folder.join(name).is_file())
        .collect();
    let numbers = |name: &str| -> Vec<u32> { name.split('.').filter_map(|part| part.parse().ok()).collect() };
    names.sort_by(|a, b| (*b == plain).cmp(&(*a == plain)).then_with(|| numbers(b).cmp(&numbers(a))).then(a.cmp(b)));
    names.into_iter().map(|name| folder.join(name)).collect()
}

fn system_names() -> Vec<String> {
    let plain = format!("{DLL_PREFIX}onnxruntime{DLL_SUFFIX}");
    // Debian and ROS packages install the versioned name. The plain name comes with the development package.
    if cfg!(target_os = "linux") { vec![format!("{plain}.1"), plain] } else { vec![plain] }
}

fn load(path: &Path) -> Result<Library, String> {
    // Silenced, because the library writes to stderr, and all that matters is also returned as an error.
    let silent: ort::logging::LoggerFunction = Arc::new(|_, _, _, _, _| {});
    let builder = ort::init_from(path).map_err(|e| in_full(&e))?;
    let environment = builder
        .with_name(env!("CARGO_PKG_NAME"))
        .with_telemetry(false)
        .with_logger(silent)
        .build()
        .map_err(|e| e.to_string())?;
    environment.set_log_level(ort::logging::LogLevel::Fatal);
    let path = if path.is_absolute() { path.to_path_buf() } else { mapped().unwrap_or_else(|| path.to_path_buf()) };
    let version = version_of(&path).unwrap_or_else(|| "unknown".to_string());
    Ok(Library { environment, path, version })
}

/// The error with its cause. If a library doesn't load, this is the message of the loader.
fn in_full(error: &ort::LoadDynamicError) -> String {
    let ort::LoadDynamicError::Dlopen { error: refused, .. } = error else { return error.to_string() };
    match std::error::Error::source(refused) {
        Some(loader) => format!("it does not load: {loader}"),
        None => error.to_string(),
    }
}

/// Path of the file that the system's loader has mapped (Linux).
fn mapped() -> Option<PathBuf> {
    let maps = fs::read_to_string("/proc/self/maps").ok()?;
    let plain = format!("/{DLL_PREFIX}onnxruntime{DLL_SUFFIX}");
    let line = maps.lines().find(|line| line.contains(&plain))?;
    line.find('/').map(|start| PathBuf::from(&line[start..]))
}

/// Version of a library: from the name of the file behind its links, or else from its symbol version.
///
/// ONNX Runtime gives its version through a C function, but calling it needs unsafe code.
fn version_of(path: &Path) -> Option<String> {
    let file = fs::canonicalize(path).ok()?;
    let name = file.file_name()?.to_str()?;
    let stem = format!("{DLL_PREFIX}onnxruntime");
    let rest = name.strip_prefix(&stem)?.replace(DLL_SUFFIX, "");
    let version = rest.trim_matches('.');
    if version.split('.').count() == 3 && version.split('.').all(|part| part.parse::<u32>().is_ok()) {
        return Some(version.to_string());
    }
    version_in_symbols(BufReader::with_capacity(1 << 20, File::open(&file).ok()?))
}

/// Version in `VERS_1.31.1`, the symbol version that ONNX Runtime's linker script sets.
fn version_in_symbols(mut library: impl Read) -> Option<String> {
    const MARK: &[u8] = b"VERS_";
    const LONGEST: usize = 24;
    let mut kept = Vec::new();
    let mut block = vec![0; 1 << 20];
    loop {
        let n = library.read(&mut block).ok()?;
        kept.extend_from_slice(&block[..n]);
        for (start, _) in kept.windows(MARK.len()).enumerate().filter(|(_, bytes)| *bytes == MARK) {
            let tail = &kept[start + MARK.len()..];
            let end = tail.iter().take(LONGEST).position(|byte| !byte.is_ascii_digit() && *byte != b'.');
            let text = end.and_then(|end| std::str::from_utf8(&tail[..end]).ok());
            if let Some(version) = text.filter(|text| text.split('.').count() == 3 && text.len() >= 5) {
                return Some(version.to_string());
            }
        }
        if n == 0 {
            return None;
        }
        // Keep enough bytes to find a mark that lies across two blocks.
        let drop = kept.len().saturating_sub(MARK.len() + LONGEST);
        kept.drain(..drop);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unusable_environment_variable_is_an_error_and_nothing_else_is_tried() {
        let refused = find(Some("/nowhere/libonnxruntime.so".into()), None).unwrap_err();
        assert!(refused.starts_with("ORT_DYLIB_PATH is /nowhere/libonnxruntime.so: "), "{refused}");
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("libonnxruntime.so");
        fs::write(&file, "not a library").unwrap();
        let refused = find(Some(file.clone().into_os_string()), None).unwrap_err();
        assert!(refused.starts_with(&format!("ORT_DYLIB_PATH is {}: it does not load: ", file.display())), "{refused}");
    }

    #[test]
    fn a_cargo_target_folder_and_the_folders_beside_the_executable_are_searched() {
        let folders = folders(Path::new("/w/target/debug/deps/test"));
        let expected = ["/w/target/debug/deps", "/w/target/debug/deps/onnxruntime", "/w/target/debug/deps/lib"];
        assert_eq!(&folders[..3], expected.map(PathBuf::from));
        assert!(folders.contains(&PathBuf::from("/w/target/onnxruntime")));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn newer_versions_come_before_older_ones_and_providers_are_left_out() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["libonnxruntime.so.1.9.0", "libonnxruntime.so.1.31.1", "libonnxruntime_providers_shared.so"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        let names: Vec<_> =
            libraries_in(folder.path()).into_iter().map(|p| p.file_name().unwrap().to_owned()).collect();
        assert_eq!(names, ["libonnxruntime.so.1.31.1", "libonnxruntime.so.1.9.0"]);
    }

    #[test]
    fn a_version_on_the_border_of_two_blocks_is_found() {
        let mut library = vec![0; (1 << 20) - 3];
        library.extend_from_slice(b"VERS_1.31.1\0rest");
        assert_eq!(version_in_symbols(library.as_slice()).as_deref(), Some("1.31.1"));
        assert_eq!(version_in_symbols(&b"VERS_\0VERS_1.2"[..]), None);
    }
}
