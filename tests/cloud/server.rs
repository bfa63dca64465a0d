//! The S3 server, and `tpf` as somebody with its credentials runs it.

use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crate::common;
use crate::common::tpf::Run;
use crate::proxy::Proxy;
use common::ROOT;

/// The server with an empty bucket `bags`, behind a proxy, and a folder for a test's own files.
pub struct Cloud {
    child: Child,
    folder: tempfile::TempDir,
    pub proxy: Proxy,
    n_put: AtomicUsize,
}

const KEY: &str = "AKIATEST";
/// No line that anybody sees may hold it.
pub const SECRET: &str = "topsecretkey";

impl Cloud {
    /// `None`, with the reason said, where it can't be started.
    pub fn start() -> Option<Cloud> {
        if !common::skip::isolated() {
            return None;
        }
        let program = PathBuf::from(format!("{ROOT}/target/s3-server/bin/s3s-fs"));
        if !program.exists() {
            assert!(
                std::env::var_os("TPF_REQUIRE_S3").is_none(),
                "target/s3-server is not here; run scripts/s3-server"
            );
            common::skipped("target/s3-server is not here; scripts/s3-server makes it");
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(folder.path().join("s3/bags")).unwrap();
        std::fs::create_dir_all(folder.path().join("home")).unwrap();
        std::fs::create_dir_all(folder.path().join("tmp")).unwrap();
        // A port that was free a moment ago; another test may take it first.
        for _ in 0..20 {
            let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
            let mut child = Command::new(&program)
                .args(["--host", "127.0.0.1", "--port", &port.to_string(), "--access-key", KEY, "--secret-key", SECRET])
                .arg(folder.path().join("s3"))
                .env("RUST_LOG", "error")
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            let began = Instant::now();
            while began.elapsed() < Duration::from_secs(20) {
                if TcpStream::connect(("127.0.0.1", port)).is_ok() {
                    return Some(Cloud { child, folder, proxy: Proxy::before(port), n_put: AtomicUsize::new(0) });
                }
                if child.try_wait().unwrap().is_some() {
                    break;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            let _ = child.kill();
            let _ = child.wait();
        }
        panic!("the S3 server doesn't start");
    }

    /// Where a test's own files are.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// The file of an object.
    pub fn object(&self, key: &str) -> PathBuf {
        self.folder.path().join("s3/bags").join(key)
    }

    /// Puts a file of this machine into the bucket, as another program would.
    pub fn put(&self, file: &str, key: &str) {
        let object = self.object(key);
        std::fs::create_dir_all(object.parent().unwrap()).unwrap();
        std::fs::copy(self.folder().join(file), object).unwrap();
        // As the server notes it of what is sent to it; without, it makes a sum of the whole file for each request.
        let n = self.n_put.fetch_add(1, Ordering::Relaxed);
        let note = format!(".bucket-{}.object-{}.internal.json", base64("bags"), base64(key));
        let text = format!("{{\"e_tag\": \"put{n}\"}}");
        std::fs::write(self.folder.path().join("s3").join(note), text).unwrap();
    }

    /// Names of all objects that somebody can see, in order.
    pub fn objects(&self) -> Vec<String> {
        let found = common::files(&self.folder.path().join("s3/bags"));
        found.into_keys().map(|path| path.to_str().unwrap().to_owned()).collect()
    }

    /// Parts of uploads that were neither completed nor taken back.
    pub fn n_unfinished(&self) -> usize {
        let names = std::fs::read_dir(self.folder.path().join("s3")).unwrap();
        let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name.starts_with(".upload")).count()
    }

    /// What is left in the folder for temporary files, but for the file that ONNX Runtime leaves there.
    pub fn n_temporary(&self) -> usize {
        let names = std::fs::read_dir(self.folder.path().join("tmp")).unwrap().map(|entry| entry.unwrap().file_name());
        names.filter(|name| name != ".ses").count()
    }

    /// A `tpf` that is about to run with the server's credentials, and no others.
    pub fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        let of_clouds = std::env::vars_os().map(|(name, _)| name).filter(|name| {
            let name = name.to_string_lossy().to_ascii_lowercase();
            ["aws_", "google_", "azure_"].iter().any(|of| name.starts_with(of)) || name.ends_with("_proxy")
        });
        for name in of_clouds {
            command.env_remove(name);
        }
        command
            .current_dir(self.folder())
            .env("HOME", self.folder().join("home"))
            .env("TMPDIR", self.folder().join("tmp"))
            .env("AWS_ENDPOINT_URL", format!("http://127.0.0.1:{}", self.proxy.port))
            .env("AWS_ACCESS_KEY_ID", KEY)
            .env("AWS_SECRET_ACCESS_KEY", SECRET)
            .args(args);
        command
    }

    pub fn tpf(&self, args: &[&str]) -> Run {
        let run = Run::from(self.command(args).output().unwrap());
        assert!(!run.stdout.contains(SECRET) && !run.stderr.contains(SECRET), "{run:?}");
        run
    }
}

/// As the server writes names of objects into names of files.
fn base64(text: &str) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
    let mut out = String::new();
    for three in text.as_bytes().chunks(3) {
        let number = (0..3).fold(0_u32, |number, at| number << 8 | u32::from(three.get(at).copied().unwrap_or(0)));
        let letters = (0..=three.len()).map(|at| LETTERS[(number >> (18 - 6 * at) & 63) as usize]);
        out.extend(letters.map(char::from));
    }
    out
}

impl Drop for Cloud {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
