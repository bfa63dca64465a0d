//! A page of `tpf view` that is served, asked as a browser or another program would, and looked at in a browser.
#![allow(dead_code, unreachable_pub)]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::browser::chromium;

/// A `tpf view` that runs until it is stopped, or dropped.
pub struct View {
    child: Child,
    stderr: ChildStderr,
    /// The address that it printed.
    pub url: String,
}

/// What a server answered.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    /// In small letters.
    pub head: String,
    pub body: String,
}

impl View {
    /// Starts `tpf view` and waits until it has printed an address, without opening a browser.
    pub fn start(folder: &Path, args: &[&str]) -> View {
        View::start_with(folder, &[args, &["--no-open"]].concat(), &std::env::var("PATH").unwrap())
    }

    /// Starts `tpf view` with this PATH, in which it may find a browser.
    pub fn start_with(folder: &Path, args: &[&str], path: &str) -> View {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        command.current_dir(folder).arg("view").args(args).env("PATH", path);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut url = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut url).unwrap();
        let mut stderr = child.stderr.take().unwrap();
        if !url.starts_with("http://127.0.0.1:") {
            let mut said = String::new();
            let _ = child.kill();
            stderr.read_to_string(&mut said).unwrap();
            panic!("no address but {url:?}: {said}");
        }
        View { child, stderr, url: url.trim_end().to_owned() }
    }

    /// Its port.
    pub fn port(&self) -> u16 {
        self.url.split(['/', ':']).nth(4).unwrap().parse().unwrap()
    }

    /// What it answers below the page's address.
    pub fn get(&self, path: &str) -> Answer {
        let at = self.url.splitn(4, '/').nth(3).unwrap();
        self.ask("127.0.0.1", &format!("/{at}{path}"), &format!("127.0.0.1:{}", self.port()))
    }

    /// What it answers to a request for any path and any host.
    pub fn ask(&self, address: &str, path: &str, host: &str) -> Answer {
        let mut stream = TcpStream::connect((address, self.port())).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        Answer { status, head: head.to_lowercase(), body: body.to_owned() }
    }

    /// What it tells as JSON.
    pub fn json(&self, path: &str) -> Value {
        let answer = self.get(path);
        assert_eq!(answer.status, 200, "{path}: {answer:?}");
        serde_json::from_str(&answer.body).unwrap_or_else(|error| panic!("{path}: {error}: {answer:?}"))
    }

    /// What it tells of a node, from now on.
    pub fn events(&self) -> Events {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port())).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let at = self.url.splitn(4, '/').nth(3).unwrap();
        // HTTP/1.0 has no chunks.
        write!(stream, "GET /{at}updates HTTP/1.0\r\nHost: 127.0.0.1:{}\r\n\r\n", self.port()).unwrap();
        Events(BufReader::new(stream).lines())
    }

    /// Process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Ends it as Ctrl-C does: how it ended, and what it said. It must end within two seconds.
    pub fn interrupt(mut self) -> (ExitStatus, String) {
        assert!(Command::new("kill").args(["-INT", &self.pid().to_string()]).status().unwrap().success());
        let deadline = Instant::now() + Duration::from_secs(2);
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(Instant::now() < deadline, "it is still there");
            std::thread::sleep(Duration::from_millis(10));
        };
        let mut said = String::new();
        self.stderr.read_to_string(&mut said).unwrap();
        (status, said)
    }

    /// What a browser shows of it: see `look_at_view.py`. Where there is no browser the test is skipped.
    pub fn look(&self, args: &[&str]) -> Option<Value> {
        let mut command = chromium("look_at_view.py")?;
        let output = command.arg(&self.url).args(args).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let seen: Value = serde_json::from_slice(&output.stdout).unwrap();
        for (view, seen) in seen.as_object().unwrap() {
            let width = if view == "phone" { 390.0 } else { 1440.0 };
            assert_eq!(seen["complaints"], Value::Array(Vec::new()), "{view}: the console is silent");
            assert_eq!(seen["elsewhere"], Value::Array(Vec::new()), "{view}: nothing is asked but this server");
            assert!(seen["page_width"].as_f64().unwrap() <= width, "{view}: {}", seen["page_width"]);
            assert_eq!(seen["background"] != "rgb(255, 255, 255)", view == "dark", "{view}: {}", seen["background"]);
        }
        Some(seen)
    }
}

/// Updates of a page of a node.
pub struct Events(std::io::Lines<BufReader<TcpStream>>);

impl Events {
    /// The next one.
    pub fn next_update(&mut self) -> Value {
        loop {
            let line = self.0.next().expect("updates end").unwrap();
            if let Some(update) = line.strip_prefix("data: ") {
                return serde_json::from_str(update).unwrap();
            }
        }
    }

    /// The states of the node until it is in this one, which it must be within 20 s.
    pub fn states_until(&mut self, state: &str) -> Vec<String> {
        let deadline = Instant::now() + Duration::from_secs(20);
        let mut states = Vec::new();
        while states.last().is_none_or(|last| last != state) {
            assert!(Instant::now() < deadline, "never {state}: {states:?}");
            let now = self.next_update()["state"].as_str().unwrap().to_owned();
            if states.last() != Some(&now) {
                states.push(now);
            }
        }
        states
    }
}

impl Drop for View {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
