//! Clients of services and of our action.

use std::rc::Rc;

use futures::stream::{StreamExt, unfold};
use ros2_client::action::{ActionClientQosPolicies, FeedbackMessage, GetResultRequest};
use ros2_client::builtin_interfaces::Time;
use ros2_client::dds::rustdds::RTPSEntity;
use ros2_client::{
    ActionClient as WireActionClient, ActionTypeName, Client as WireClient, Message, QosProfile, ServiceTypeName,
};

use super::super::{ActionClient, ActionQos, Ask, Client, Servers};
use super::{Participant, ends, wire};
use crate::msg::{CalibrateFeedback, CalibrateGoal, CalibrateResult};
use crate::ros::wire::error::{NodeError, create};

type Calibrate = WireActionClient<CalibrateGoal, CalibrateResult, CalibrateFeedback>;

impl Participant {
    pub(in crate::ros::wire::middleware) fn client<Q, A>(
        &mut self,
        service: &str,
        type_name: &str,
        qos: &QosProfile,
    ) -> Result<Client<Q, A>, NodeError>
    where
        Q: Message + Clone + 'static,
        A: Message + 'static,
    {
        let (package, kind) = ends(type_name);
        let client = self.node.create_client::<Q, A>(
            self.mapping,
            &wire(service)?,
            &ServiceTypeName::new(package, kind),
            qos.clone(),
            qos.clone(),
        );
        let client = Rc::new(client.map_err(|error| create(service, &error))?);
        let ask: Ask<Q, A> = Box::new(move |question| {
            let client: Rc<WireClient<Q, A>> = Rc::clone(&client);
            Box::pin(async move { client.async_call_service(question).await.map_err(|error| error.to_string()) })
        });
        Ok(Client { n_servers: self.servers(service), ask })
    }

    pub(in crate::ros::wire::middleware) fn action_client(
        &mut self,
        action: &str,
        qos: &ActionQos,
    ) -> Result<ActionClient, NodeError> {
        let policies = ActionClientQosPolicies {
            goal_service: qos.services.clone(),
            result_service: qos.services.clone(),
            cancel_service: qos.services.clone(),
            feedback_subscription: qos.feedback.clone(),
            status_subscription: qos.status.clone(),
        };
        let kind = ActionTypeName::new("tactile_pose_fusion", "Calibrate");
        let client = self.node.create_action_client(self.mapping, &wire(action)?, &kind, policies);
        let client: Rc<Calibrate> = Rc::new(client.map_err(|error| create(action, &error))?);
        let (goals, cancels, results, feedback) = (Rc::clone(&client), Rc::clone(&client), Rc::clone(&client), client);
        let goals = Client {
            n_servers: self.servers(&format!("{action}/_action/send_goal")),
            ask: Box::new(move |goal| {
                let client = Rc::clone(&goals);
                Box::pin(async move {
                    client.goal_client().async_call_service(goal).await.map_err(|error| error.to_string())
                })
            }),
        };
        // A message that can't be read is followed by the next one.
        let feedback = unfold(feedback, |client| async {
            loop {
                if let Ok((message, _)) = client.feedback_subscription().async_take().await {
                    let message: FeedbackMessage<CalibrateFeedback> = message;
                    return Some((message, client));
                }
            }
        });
        Ok(ActionClient {
            goals,
            cancels: Box::new(move |goal| {
                let client = Rc::clone(&cancels);
                Box::pin(
                    async move { client.async_cancel_goal(goal, Time::ZERO).await.map_err(|error| error.to_string()) },
                )
            }),
            results: Box::new(move |goal_id| {
                let client = Rc::clone(&results);
                Box::pin(async move {
                    let asked = client.result_client().async_call_service(GetResultRequest { goal_id });
                    asked.await.map_err(|error| error.to_string())
                })
            }),
            feedback: feedback.boxed_local(),
        })
    }

    /// The servers that our requests reach, and whose responses are announced.
    fn servers(&self, service: &str) -> Servers {
        let participant = self.context.domain_participant();
        let own = participant.guid().prefix;
        let (requests, responses) = (format!("rq{service}Request"), format!("rr{service}Reply"));
        Box::new(move || {
            let writers = participant.discovered_writers();
            let readers = participant.discovered_readers();
            let answering = writers.iter().map(|writer| &writer.publication_topic_data);
            let answering = answering.filter(|topic| topic.topic_name == responses);
            let servers = readers.iter().map(|reader| &reader.subscription_topic_data);
            let servers = servers.filter(|topic| *topic.topic_name() == requests).map(|topic| topic.key());
            let is_ready = |server: &ros2_client::dds::rustdds::GUID| {
                server.prefix != own
                    && answering.clone().any(|topic| topic.key.prefix == server.prefix)
                    && participant.sends_to(&requests, |reader| reader == server)
            };
            servers.filter(is_ready).count()
        })
    }
}
