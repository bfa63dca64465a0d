//! The least that ros2-client does between a message in and a message out: what the node's latency is held against.
//!
//! Reads `/taxels` (`sensor_msgs/msg/JointState`) and answers each with a `geometry_msgs/msg/WrenchStamped` of its stamp.

use futures::StreamExt;
use ros2_client::qos::History;
use ros2_client::{Context, MessageTypeName, Name, NodeName, NodeOptions, QosProfile};
use tactile_pose_fusion::msg::{JointState, Wrench, WrenchStamped};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let context = Context::new()?;
    let mut node = context.new_node(NodeName::new("/", "ros2_echo")?, NodeOptions::new())?;
    let qos = QosProfile::subscription_default().history(History::KeepLast { depth: 10 });
    let taxels =
        node.create_topic(&Name::new("/", "taxels")?, MessageTypeName::new("sensor_msgs", "JointState"), &qos)?;
    let wrench = Name::new("/ros2_echo/index", "wrench")?;
    let wrench = node.create_topic(&wrench, MessageTypeName::new("geometry_msgs", "WrenchStamped"), &qos)?;
    let subscription = node.create_subscription::<JointState>(&taxels, Some(qos.clone()))?;
    let publisher = node.create_publisher::<WrenchStamped>(&wrench, Some(qos))?;
    let answer = subscription.async_stream().for_each(|message| {
        if let Ok((message, _)) = message {
            let answer = WrenchStamped { header: message.header, wrench: Wrench::default() };
            let _ = publisher.publish(answer); // a subscriber that is gone
        }
        std::future::ready(())
    });
    futures::executor::block_on(answer);
    Ok(())
}
