//! Wherever the command line takes a path, a URI is used, or refused in one line.

use std::fs;
use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::common::doors::{self, DOORS};
use crate::common::tpf::Run;
use crate::common::{files, scored};
use crate::server::Cloud;

/// What is refused at once takes seconds, and some doors are reached after a short evaluation.
const LIMIT: Duration = Duration::from_secs(120);

#[test]
fn a_uri_of_what_is_not_there_is_refused_in_a_line_wherever_a_path_is_given() {
    let Some(cloud) = Cloud::start() else { return };
    let prepared = scored::folder();
    for (name, bytes) in files(prepared.path()) {
        let path = cloud.folder().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
    doors::write_gates(cloud.folder());
    let before = doors::names(cloud.folder());
    #[cfg(feature = "ros")]
    let all = DOORS.iter().chain(doors::LIVE_DOORS);
    #[cfg(not(feature = "ros"))]
    let all = DOORS.iter();
    for door in all {
        let words = doors::words(door);
        let mut command = cloud.command(&words.iter().map(String::as_str).collect::<Vec<_>>());
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let began = Instant::now();
        while child.try_wait().unwrap().is_none() {
            if began.elapsed() > LIMIT {
                child.kill().unwrap();
                panic!("{door}: {:?}", Run::from(child.wait_with_output().unwrap()));
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let run = Run::from(child.wait_with_output().unwrap());
        doors::check_refused(
            door,
            &run,
            &["there is no bucket \"none\"", "not found", "own machine only", "on this machine only"],
        );
        for entry in doors::names(cloud.folder()).difference(&before) {
            assert_eq!(entry, "new", "{door}"); // the folder of --each, as for any bag that can't be read
        }
        assert_eq!(cloud.n_temporary(), 0, "{door}");
    }
}
