//! The same in a container of Azurite, Microsoft's emulator of Azure's blob store. It runs where `scripts/azure-server` made it.

use std::fs;
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::ROOT;
use crate::common::onnx::LinearModel;
use crate::common::tpf::{Run, write_params};
use crate::common::{self, bags};
use crate::same::with_camera;

/// The account that every emulator has, and its key, which is no secret.
const ACCOUNT: &str = "devstoreaccount1";
const KEY: &str = "Eby8vdM02xNOcqFlqUwJPLlmEtlCDXJ1OUzFT50uSRZ6IFsuFq2UVErCz4I6tq/K1SZFPTOtr/KBHBeksoGMGw==";

struct Emulator {
    child: Child,
    folder: tempfile::TempDir,
    port: u16,
}

impl Emulator {
    fn start() -> Option<Emulator> {
        if !common::skip::isolated() {
            return None;
        }
        let program = PathBuf::from(format!("{ROOT}/target/azurite/node_modules/.bin/azurite-blob"));
        if !program.exists() {
            common::skipped("target/azurite is not here; scripts/azure-server makes it");
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("tmp")).unwrap();
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let mut child = Command::new(program)
            .args(["--silent", "--disableTelemetry", "--skipApiVersionCheck", "--blobHost", "127.0.0.1", "--blobPort"])
            .args([&port.to_string(), "--location"])
            .arg(folder.path().join("server"))
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let began = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(child.try_wait().unwrap().is_none() && began.elapsed() < Duration::from_secs(60), "no emulator");
            std::thread::sleep(Duration::from_millis(50));
        }
        let emulator = Emulator { child, folder, port };
        emulator.make_container();
        Some(emulator)
    }

    /// Makes the container `bags`, which we never do ourselves.
    fn make_container(&self) {
        let script = format!(
            "const date = new Date().toUTCString(), version = '2021-12-02';
             const signed = 'PUT' + '\\n'.repeat(12) + `x-ms-date:${{date}}\\nx-ms-version:${{version}}\\n`
                 + '/{ACCOUNT}/{ACCOUNT}/bags\\nrestype:container';
             const hmac = require('crypto').createHmac('sha256', Buffer.from('{KEY}', 'base64'));
             const Authorization = 'SharedKey {ACCOUNT}:' + hmac.update(signed, 'utf8').digest('base64');
             const headers = {{ 'x-ms-date': date, 'x-ms-version': version, Authorization }};
             fetch('http://127.0.0.1:{}/{ACCOUNT}/bags?restype=container', {{ method: 'PUT', headers }})
                 .then(async answer => {{ if (answer.status !== 201) throw new Error(await answer.text()); }});",
            self.port
        );
        assert!(Command::new("node").args(["-e", &script]).status().unwrap().success());
    }

    fn tpf(&self, args: &[&str]) -> Run {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_string_lossy().starts_with("AZURE_")) {
            command.env_remove(name);
        }
        let run = command
            .current_dir(self.folder.path())
            .env("TMPDIR", self.folder.path().join("tmp"))
            .env("AZURE_STORAGE_USE_EMULATOR", "true")
            .env("AZURITE_BLOB_STORAGE_URL", format!("http://127.0.0.1:{}", self.port))
            .args(args)
            .output()
            .unwrap();
        let run = Run::from(run);
        assert!(!run.stderr.contains(KEY), "{run:?}");
        run
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn bags_and_outputs_in_a_container_of_azure_are_those_of_this_machine() {
    let Some(azure) = Emulator::start() else { return };
    let folder = azure.folder.path();
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(folder, "model.onnx");
    write_params(folder, 2, &["dip"], "");
    with_camera(&folder.join("camera.mcap"));
    bags::write_session(&folder.join("session.mcap"), 8);
    let replay = |bag: &str, out: &str, more: &[&str]| {
        let options = ["--params-file", "params.yaml", "--calibrate-first", "3.13", "-o", out];
        azure.tpf(&[&["replay", bag], &options[..], more].concat())
    };
    // 20 MiB, in parts, and what is sent in one request; back again by a replay of the copy.
    replay("camera.mcap", "merged.mcap", &["--merge"]).ok();
    replay("camera.mcap", "az://bags/folder/merged.mcap", &["--merge"]).ok();
    azure.tpf(&["diff", "merged.mcap", "az://bags/folder/merged.mcap"]).ok();
    let listed = |bag: &str| azure.tpf(&["inspect", bag, "--json"]).ok().stdout.replace("az://bags/folder/", "");
    assert_eq!(listed("merged.mcap"), listed("az://bags/folder/merged.mcap"));
    replay("az://bags/folder", "again.mcap", &[]).ok();
    replay("merged.mcap", "here.mcap", &[]).ok();
    assert!(fs::read(folder.join("again.mcap")).unwrap() == fs::read(folder.join("here.mcap")).unwrap());
    replay("session.mcap", "az://bags/small", &[]).ok();
    replay("session.mcap", "small", &[]).ok();
    azure.tpf(&["diff", "small", "az://bags/small"]).ok();

    let there = replay("session.mcap", "az://bags/folder/merged.mcap", &[]);
    assert!(there.failure().starts_with("az://bags/folder/merged.mcap: is there already"), "{there:?}");
    replay("session.mcap", "az://bags/folder/merged.mcap", &["--overwrite"]).ok();
    azure.tpf(&["diff", "small", "az://bags/folder/merged.mcap"]).ok();
    let absent = azure.tpf(&["inspect", "az://bags/absent.mcap"]);
    assert!(absent.failure().contains("not found"), "{absent:?}");
    let nowhere = azure.tpf(&["inspect", "az://nowhere/bag.mcap"]);
    assert!(nowhere.failure().contains("there is no container \"nowhere\""), "{nowhere:?}");
    let nowhere = replay("session.mcap", "az://nowhere/out.mcap", &[]);
    assert!(nowhere.failure().contains("there is no container \"nowhere\""), "{nowhere:?}");
}
