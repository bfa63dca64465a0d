//! The network interfaces that DDS uses, and whether multicast works on them: a datagram is really sent.

use std::io;
use std::mem::MaybeUninit;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::time::{Duration, Instant};

use socket2::{Domain, Protocol, Socket, Type};

use super::{Finding, Level};

/// The group by which participants find each other: RTPS 2.5, 9.6.2.4.1. The probe goes to a port of its own, where no
/// participant listens.
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);

/// How long a datagram may take to come back.
const LIMIT: Duration = Duration::from_millis(500);

/// Advice for when multicast doesn't work.
const ADVICE: &str = "participants find each other by multicast: allow UDP to 239.255.0.1 and ports 7400 and above in the firewall, switch multicast on for the interface (ip link set NAME multicast on), or stay on this host (ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST)";

/// An IPv4 address of an interface.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Interface {
    name: String,
    address: Ipv4Addr,
    is_loopback: bool,
    is_multicast: bool,
}

/// Tries the interfaces that a participant uses.
pub(super) fn examine(localhost_only: bool) -> Vec<Finding> {
    let all = netdev::get_interfaces().into_iter().filter(netdev::Interface::is_up).flat_map(|interface| {
        let of = |address| Interface {
            name: interface.name.clone(),
            address,
            is_loopback: interface.is_loopback(),
            is_multicast: interface.is_multicast(),
        };
        interface.ipv4.iter().map(|net| of(net.addr())).collect::<Vec<_>>()
    });
    judge(&all.collect::<Vec<_>>(), localhost_only, &echo)
}

fn judge(all: &[Interface], localhost_only: bool, echo: &dyn Fn(Ipv4Addr) -> io::Result<Duration>) -> Vec<Finding> {
    let used = |interface: &&Interface| match localhost_only {
        true => interface.is_loopback,
        false => interface.is_multicast || interface.is_loopback,
    };
    let (used, unused): (Vec<&Interface>, Vec<&Interface>) = all.iter().partition(used);
    let mut findings = Vec::new();
    let mut n_working = 0;
    let mut failed = Vec::new();
    for interface in used {
        let Interface { name, address, .. } = interface;
        match echo(*address) {
            Ok(took) => {
                n_working += 1;
                let ms = took.as_secs_f64() * 1e3;
                let text =
                    format!("{name} ({address}): multicast works here: a datagram to {GROUP} came back in {ms:.1} ms");
                findings.push(Finding::new("network", Level::Ok, text));
            }
            Err(error) => failed.push((interface, error)),
        }
    }
    for (Interface { name, address, is_loopback, .. }, error) in failed {
        // The loopback of most systems has no multicast, and needs none beside another interface that has it.
        if *is_loopback && n_working > 0 {
            continue;
        }
        let level = if n_working == 0 { Level::Problem } else { Level::Warning };
        findings.push(Finding::new("network", level, format!("{name} ({address}): no multicast: {error}; {ADVICE}")));
    }
    if n_working == 0 && findings.is_empty() {
        let text = format!("no interface with an IPv4 address that participants use; {ADVICE}");
        findings.push(Finding::new("network", Level::Problem, text));
    }
    if !localhost_only {
        let others = all.iter().filter(|interface| !interface.is_loopback);
        if others.clone().count() == 0 {
            let text = "there is no interface but loopback: nodes on other machines are out of reach; connect the network, or run everything on this host";
            findings.push(Finding::new("network", Level::Warning, text));
        }
        findings.extend(unused.iter().map(|Interface { name, address, .. }| {
            let text =
                format!("{name} ({address}) is not used, because multicast is off: ip link set {name} multicast on");
            Finding::new("network", Level::Warning, text)
        }));
    }
    findings
}

/// Sends a datagram to the group through an interface, and waits until it comes back to a member of the group there.
fn echo(address: Ipv4Addr) -> io::Result<Duration> {
    let receiver = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    receiver.bind(&SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0).into())?;
    receiver.join_multicast_v4(&GROUP, &address)?;
    let port = receiver.local_addr()?.as_socket().map_or(0, |bound| bound.port());
    let sender = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    sender.bind(&SocketAddrV4::new(address, 0).into())?;
    sender.set_multicast_if_v4(&address)?;
    sender.set_multicast_loop_v4(true)?;
    sender.set_multicast_ttl_v4(0)?; // it stays on this host
    let probe = format!("tpf doctor {} {:?}", std::process::id(), Instant::now());
    let began = Instant::now();
    sender.send_to(probe.as_bytes(), &SocketAddr::from((GROUP, port)).into())?;
    let mut buffer = [MaybeUninit::<u8>::uninit(); 256];
    while began.elapsed() < LIMIT {
        receiver.set_read_timeout(Some(LIMIT.saturating_sub(began.elapsed()).max(Duration::from_millis(1))))?;
        match receiver.recv_from(&mut buffer) {
            // Only the probe has this length and comes from this address; its text would need unsafe code to be read.
            Ok((n, from)) => {
                let from = from.as_socket_ipv4().map(|from| *from.ip());
                if n == probe.len() && from == Some(address) {
                    return Ok(began.elapsed());
                }
            }
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => break,
            Err(error) => return Err(error),
        }
    }
    Err(io::Error::new(io::ErrorKind::TimedOut, format!("a datagram to {GROUP} did not come back within {LIMIT:?}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn interface(name: &str, last: u8, is_multicast: bool) -> Interface {
        let is_loopback = name == "lo";
        let address = if is_loopback { Ipv4Addr::LOCALHOST } else { Ipv4Addr::new(10, 0, 0, last) };
        Interface { name: name.to_owned(), address, is_loopback, is_multicast }
    }

    fn levels(all: &[Interface], localhost_only: bool, works: &[&str]) -> Vec<(Level, String)> {
        let address_works =
            |address| all.iter().any(|one| one.address == address && works.contains(&one.name.as_str()));
        let echo = |address| match address_works(address) {
            true => Ok(Duration::from_millis(1)),
            false => Err(io::Error::from(io::ErrorKind::TimedOut)),
        };
        judge(all, localhost_only, &echo).into_iter().map(|found| (found.level, found.text)).collect()
    }

    #[test]
    fn what_works_is_ok_and_what_does_not_is_told_with_what_to_do() {
        let (lo, eth0, wlan0) = (interface("lo", 1, false), interface("eth0", 2, true), interface("wlan0", 3, true));
        let found = levels(&[lo.clone(), eth0.clone()], false, &["eth0"]);
        assert_eq!(
            found.iter().map(|(level, _)| *level).collect::<Vec<_>>(),
            [Level::Ok],
            "loopback needs none: {found:?}"
        );
        let found = levels(&[lo.clone(), eth0.clone(), wlan0], false, &["lo", "eth0"]);
        assert!(found.iter().any(|(level, text)| *level == Level::Warning && text.starts_with("wlan0 (10.0.0.3): no")));
        let found = levels(&[lo.clone(), eth0], false, &[]);
        assert_eq!(found.iter().filter(|(level, _)| *level == Level::Problem).count(), 2, "{found:?}");
        let found = levels(std::slice::from_ref(&lo), false, &["lo"]);
        assert_eq!((found[0].0, found[1].0), (Level::Ok, Level::Warning), "{found:?}");
        assert_eq!(levels(&[lo], true, &["lo"]).len(), 1);
        assert_eq!(levels(&[], true, &[])[0].0, Level::Problem);
        let off = levels(&[interface("lo", 1, true), interface("eth0", 2, false)], false, &["lo"]);
        assert!(off.iter().any(|(_, text)| text.contains("ip link set eth0 multicast on")), "{off:?}");
    }
}
