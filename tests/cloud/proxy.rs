//! A proxy in front of the server, which counts what goes through it and makes faults.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// What goes wrong with an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The connection ends after so many bytes of the answer.
    Cut(usize),
    /// 503 SlowDown, and the server never hears of the request.
    Busy,
    /// The answer begins after a while.
    Late(Duration),
    /// The answer tells of another range than was asked for.
    OtherRange,
    /// The server does what it is asked for, and its answer is lost.
    Lost,
    /// Nothing ever comes.
    Silent,
}

/// What a request is to match for a fault, the fault, and how often.
type Rule = (fn(&Request) -> bool, Fault, usize);

/// A request that came through.
#[derive(Debug, Clone)]
pub struct Request {
    pub method: String,
    pub target: String,
    pub range: Option<(u64, u64)>,
    /// Bytes of the answer's body.
    pub sent: u64,
    head: String,
}

#[derive(Default)]
struct State {
    rules: Vec<Rule>,
    seen: Vec<Request>,
}

pub struct Proxy {
    pub port: u16,
    state: Arc<Mutex<State>>,
    is_over: Arc<AtomicBool>,
}

impl Proxy {
    /// In front of the server at `upstream`.
    pub fn before(upstream: u16) -> Proxy {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let (state, is_over) = (Arc::<Mutex<State>>::default(), Arc::<AtomicBool>::default());
        let (shared, over) = (Arc::clone(&state), Arc::clone(&is_over));
        std::thread::spawn(move || {
            for client in listener.incoming().flatten() {
                if over.load(Ordering::Relaxed) {
                    break;
                }
                let (shared, over) = (Arc::clone(&shared), Arc::clone(&over));
                std::thread::spawn(move || drop(serve(client, upstream, &shared, &over)));
            }
        });
        Proxy { port, state, is_over }
    }

    /// From now on the next `times` requests that match go wrong.
    pub fn fail(&self, matches: fn(&Request) -> bool, fault: Fault, times: usize) {
        self.state.lock().unwrap().rules.push((matches, fault, times));
    }

    /// From now on nothing goes wrong.
    pub fn forget(&self) {
        self.state.lock().unwrap().rules.clear();
    }

    /// How many of the faults that were asked for have not been made.
    pub fn n_left(&self) -> usize {
        self.state.lock().unwrap().rules.iter().map(|(.., times)| times).sum()
    }

    /// What came through since this was last asked.
    pub fn take_seen(&self) -> Vec<Request> {
        std::mem::take(&mut self.state.lock().unwrap().seen)
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        let _ = TcpStream::connect(("127.0.0.1", self.port)); // the listener looks up
    }
}

/// One request a connection, which is all that a client can't see.
fn serve(mut client: TcpStream, upstream: u16, state: &Mutex<State>, is_over: &AtomicBool) -> std::io::Result<()> {
    let Some((mut request, body)) = read_request(&mut client)? else { return Ok(()) };
    let fault = {
        let mut state = state.lock().unwrap();
        let rule = state.rules.iter_mut().find(|(matches, _, times)| *times > 0 && matches(&request));
        rule.map(|(_, fault, times)| {
            *times -= 1;
            *fault
        })
    };
    let answer = match fault {
        Some(Fault::Busy) => busy(),
        Some(Fault::Silent) => {
            state.lock().unwrap().seen.push(request);
            for _ in 0..1200 {
                std::thread::sleep(Duration::from_millis(50));
                if is_over.load(Ordering::Relaxed) {
                    break;
                }
            }
            return Ok(());
        }
        _ => ask(upstream, &request.head, &body)?,
    };
    let head_len = answer.windows(4).position(|bytes| bytes == b"\r\n\r\n").map_or(answer.len(), |at| at + 4);
    let answer = match fault {
        Some(Fault::Cut(n)) => answer[..answer.len().min(head_len + n)].to_vec(),
        Some(Fault::Lost) => Vec::new(),
        Some(Fault::OtherRange) => other_range(&answer, head_len),
        Some(Fault::Late(by)) => {
            std::thread::sleep(by);
            answer
        }
        _ => answer,
    };
    request.sent = answer.len().saturating_sub(head_len) as u64;
    state.lock().unwrap().seen.push(request);
    client.write_all(&answer)?;
    client.shutdown(Shutdown::Write)
}

fn read_request(client: &mut TcpStream) -> std::io::Result<Option<(Request, Vec<u8>)>> {
    let mut bytes = Vec::new();
    let mut buffer = [0; 64 << 10];
    let head_len = loop {
        if let Some(at) = bytes.windows(4).position(|bytes| bytes == b"\r\n\r\n") {
            break at + 4;
        }
        match client.read(&mut buffer)? {
            0 => return Ok(None),
            n => bytes.extend_from_slice(&buffer[..n]),
        }
    };
    let mut body = bytes.split_off(head_len);
    let head = String::from_utf8(bytes).unwrap();
    let field = |name: &str| {
        head.lines().find_map(|line| {
            let (key, value) = line.split_once(':')?;
            key.eq_ignore_ascii_case(name).then(|| value.trim().to_owned())
        })
    };
    let len: usize = field("content-length").map_or(0, |len| len.parse().unwrap());
    while body.len() < len {
        match client.read(&mut buffer)? {
            0 => return Ok(None), // a client that was killed
            n => body.extend_from_slice(&buffer[..n]),
        }
    }
    let mut words = head.split_whitespace();
    let (method, target) = (words.next().unwrap().to_owned(), words.next().unwrap().to_owned());
    let range = field("range").map(|range| {
        let (first, last) = range.strip_prefix("bytes=").unwrap().split_once('-').unwrap();
        (first.parse().unwrap(), last.parse().unwrap())
    });
    Ok(Some((Request { method, target, range, sent: 0, head }, body)))
}

/// The server's whole answer.
fn ask(upstream: u16, head: &str, body: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut server = TcpStream::connect(("127.0.0.1", upstream))?;
    let (line, fields) = head.split_once("\r\n").unwrap();
    let fields: Vec<&str> =
        fields.split("\r\n").filter(|field| !field.to_ascii_lowercase().starts_with("connection:")).collect();
    server.write_all(format!("{line}\r\nconnection: close\r\n{}", fields.join("\r\n")).as_bytes())?;
    server.write_all(body)?;
    let mut answer = Vec::new();
    server.read_to_end(&mut answer)?;
    Ok(answer)
}

fn busy() -> Vec<u8> {
    let body = "<?xml version=\"1.0\"?><Error><Code>SlowDown</Code><Message>Please reduce your request rate.</Message></Error>";
    format!(
        "HTTP/1.1 503 Service Unavailable\r\nconnection: close\r\ncontent-type: application/xml\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    )
    .into_bytes()
}

fn other_range(answer: &[u8], head_len: usize) -> Vec<u8> {
    let head = String::from_utf8(answer[..head_len].to_vec()).unwrap();
    let moved = head.replace("content-range: bytes ", "content-range: bytes 1");
    assert_ne!(head, moved, "no range was answered: {head}");
    [moved.as_bytes(), &answer[head_len..]].concat()
}
