//! The two peers between which latency is measured: `ros2_latency send RATE SECONDS`, `ros2_latency receive TOPIC SECONDS`.
//!
//! The stamp of a message is the time just before it is sent; the latency is the time at which the answer with that
//! stamp is in the hands of the receiver, less that stamp. `tests/ros/latency.py` runs both.

use std::error::Error;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use ros2_client::qos::History;
use ros2_client::{Context, MessageTypeName, Name, Node, NodeName, NodeOptions, QosProfile};
use tactile_pose_fusion::msg::{Header, JointState, WrenchStamped};
use tactile_pose_fusion::units::Stamp;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let context = Context::new()?;
    match args.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        ["send", rate, seconds] => send(&context, rate.parse()?, seconds.parse()?),
        ["receive", topic, seconds] => receive(&context, topic, seconds.parse()?),
        _ => Err("usage: ros2_latency send RATE SECONDS | receive TOPIC SECONDS".into()),
    }
}

fn node(context: &Context, name: &str) -> Result<Node, Box<dyn Error>> {
    Ok(context.new_node(NodeName::new("/", name)?, NodeOptions::new().enable_rosout(false))?)
}

fn qos() -> QosProfile {
    QosProfile::subscription_default().history(History::KeepLast { depth: 1000 })
}

fn now() -> Stamp {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Stamp(since.as_nanos() as i64)
}

fn send(context: &Context, rate: f64, seconds: f64) -> Result<(), Box<dyn Error>> {
    let mut node = node(context, "latency_sender")?;
    let kind = MessageTypeName::new("sensor_msgs", "JointState");
    let taxels = node.create_topic(&Name::new("/", "taxels")?, kind.clone(), &qos())?;
    let joints = node.create_topic(&Name::new("/", "joints")?, kind, &qos())?;
    let taxels = node.create_publisher::<JointState>(&taxels, None)?;
    let joints = node.create_publisher::<JointState>(&joints, None)?;
    std::thread::sleep(Duration::from_secs(2)); // for discovery
    let message = |stamp: Stamp, names: &[&str], position: Vec<f64>| JointState {
        header: Header { stamp: stamp.into(), frame_id: String::new() },
        name: names.iter().map(|name| (*name).to_owned()).collect(),
        position,
        ..JointState::default()
    };
    let start = Instant::now();
    for n in 0..(rate * seconds) as u32 {
        let due = start + Duration::from_secs_f64(f64::from(n) / rate);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let stamp = now();
        let names = ["index_dip", "index_pip", "index_mcp_flex", "index_mcp_abd"];
        let angles = message(stamp, &names, vec![0.5; 4]);
        let readings = (0..6).map(|k| 10.0 + f64::from((n + k) % 3)).collect();
        let readings = message(stamp, &["t0", "t1", "t2", "t3", "t4", "t5"], readings);
        joints.publish(angles).map_err(|error| error.to_string())?;
        taxels.publish(readings).map_err(|error| error.to_string())?;
    }
    std::thread::sleep(Duration::from_millis(500));
    Ok(())
}

fn receive(context: &Context, topic: &str, seconds: f64) -> Result<(), Box<dyn Error>> {
    let mut node = node(context, "latency_receiver")?;
    let kind = MessageTypeName::new("geometry_msgs", "WrenchStamped");
    let topic = node.create_topic(&Name::parse(topic)?, kind, &qos())?;
    let subscription = node.create_subscription::<WrenchStamped>(&topic, None)?;
    let mut latencies_us: Vec<i64> = Vec::new();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build()?;
    let end = Instant::now() + Duration::from_secs_f64(seconds);
    runtime.block_on(async {
        while let Ok(taken) = tokio::time::timeout_at(end.into(), subscription.async_take()).await {
            if let Ok((message, _)) = taken {
                latencies_us.push(now().nanos_since(message.header.stamp.into()) / 1000);
            }
        }
    });
    latencies_us.sort_unstable();
    let rank = |share: f64| {
        let idx = ((share * latencies_us.len() as f64).ceil() as usize).saturating_sub(1);
        latencies_us.get(idx).copied()
    };
    let report = serde_json::json!({
        "n": latencies_us.len(), "p50": rank(0.5), "p99": rank(0.99), "max": rank(1.0),
    });
    let mut stdout = std::io::stdout();
    std::io::Write::write_all(&mut stdout, format!("{report}\n").as_bytes())?;
    Ok(())
}
