//! Bags on plain web servers, one that has ranges and one that has not.

use std::io::{Read, Write};
use std::net::TcpListener;

use crate::common::bags::write_session;
use crate::server::Cloud;

/// Serves one file under any name that ends in `.mcap`.
pub fn serve(bytes: Vec<u8>, has_ranges: bool) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    std::thread::spawn(move || {
        for mut client in listener.incoming().flatten() {
            let (mut head, mut buffer) = (Vec::new(), [0; 4096]);
            while !head.ends_with(b"\r\n\r\n") {
                match client.read(&mut buffer) {
                    Ok(0) | Err(_) => break,
                    Ok(n) => head.extend_from_slice(&buffer[..n]),
                }
            }
            let head = String::from_utf8(head).unwrap().to_ascii_lowercase();
            let range = head.lines().find_map(|line| {
                let (first, last) = line.strip_prefix("range: bytes=")?.split_once('-')?;
                Some((first.parse::<usize>().ok()?, last.parse::<usize>().ok()?))
            });
            let fields = "connection: close\r\netag: \"one\"\r\nlast-modified: Tue, 01 Oct 2024 00:00:00 GMT";
            let (status, range, body) = match range.filter(|_| has_ranges) {
                _ if !head.contains(".mcap") => ("404 Not Found", String::new(), &b"nothing here"[..]),
                Some((first, last)) => {
                    let range = format!("content-range: bytes {first}-{last}/{}\r\n", bytes.len());
                    ("206 Partial Content", range, &bytes[first..=last])
                }
                None => ("200 OK", String::new(), &bytes[..]),
            };
            let answer = format!("HTTP/1.1 {status}\r\n{fields}\r\n{range}content-length: {}\r\n\r\n", body.len());
            let _ = client.write_all(answer.as_bytes());
            if !head.starts_with("head") {
                let _ = client.write_all(body);
            }
        }
    });
    port
}

#[test]
fn a_bag_on_a_web_server_is_read_where_it_sends_ranges_and_refused_in_a_line_where_not() {
    let Some(cloud) = Cloud::start() else { return };
    write_session(&cloud.folder().join("bag.mcap"), 8);
    let bytes = std::fs::read(cloud.folder().join("bag.mcap")).unwrap();
    let (with, without) = (serve(bytes.clone(), true), serve(bytes, false));
    let here = cloud.tpf(&["inspect", "bag.mcap", "--json"]).ok();
    let uri = format!("http://127.0.0.1:{with}/a%20folder/bag.mcap");
    let there = cloud.tpf(&["inspect", &uri, "--json"]).ok();
    assert_eq!(there.stdout.replace(&uri, "bag.mcap"), here.stdout);
    let run = cloud.tpf(&["inspect", &format!("http://127.0.0.1:{without}/bag.mcap")]);
    assert!(run.failure().contains("sends whole files only and no ranges"), "{run:?}");
    let run = cloud.tpf(&["inspect", &format!("http://127.0.0.1:{with}/other")]);
    assert!(run.failure().contains("not found"), "{run:?}");
    let run = cloud.tpf(&["init", "bag.mcap", "-o", &format!("http://127.0.0.1:{with}/params.yaml")]);
    assert!(run.failure().contains("a web server takes no outputs"), "{run:?}");
}
