//! Clients of services and of our action, and the liveliness tokens of others.

use std::rc::Rc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use ::zenoh::query::{ConsolidationMode, QueryTarget};
use ::zenoh::{Session, Wait};
use futures::StreamExt;
use futures::stream::unfold;
use ros2_client::Message;
use ros2_client::action::{GetResultRequest, GoalInfo};
use ros2_client::builtin_interfaces::Time;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::Entity;
use super::keys::Attachment;
use crate::msg::{decode, encode};
use crate::ros::wire::clock::system_now;
use crate::ros::wire::middleware::{ActionClient, Ask, Client, Servers, Subscription};

/// How long an answer may take; who asks has a limit of its own.
const ANSWER: Duration = Duration::from_secs(3600);

/// How long other sessions may take to tell their tokens.
const TOKENS: Duration = Duration::from_millis(500);

/// Maximum number of tokens read: strangers can declare any number of them.
const MOST: usize = 16_384;

/// A client whose servers have tokens at a key expression.
pub(super) fn of_service<Q, A>(session: &Session, entity: Entity, servers: String) -> Client<Q, A>
where
    Q: Message + 'static,
    A: Message + 'static,
{
    Client { n_servers: counted(session, servers), ask: asking(session, entity) }
}

/// A client of the action with these entities; those of its goals with the key expression of their servers.
pub(super) fn of_action(
    session: &Session,
    (goals, servers): (Entity, String),
    cancels: Entity,
    results: Entity,
    feedback: Subscription,
) -> ActionClient {
    // A request to cancel has a `GoalInfo` and nothing else.
    let (cancels, results) = (asking::<GoalInfo, _>(session, cancels), asking::<GetResultRequest, _>(session, results));
    // A message that is lost or can't be read is followed by the next one.
    let feedback = unfold(feedback, |feedback| async {
        loop {
            let arrival = feedback.arrivals().next().await?;
            if let Ok(arrival) = arrival
                && let Ok(message) = decode(&arrival.cdr)
            {
                return Some((message, feedback));
            }
        }
    });
    ActionClient {
        goals: of_service(session, goals, servers),
        cancels: Box::new(move |goal_id| cancels(GoalInfo { goal_id, stamp: Time::ZERO })),
        results: Box::new(move |goal_id| results(GetResultRequest { goal_id })),
        feedback: feedback.boxed_local(),
    }
}

/// The tokens at a key expression that are alive.
pub(super) fn tokens(session: &Session, key: &str) -> Vec<String> {
    let Ok(replies) = session.liveliness().get(key).timeout(TOKENS).wait() else { return Vec::new() };
    let mut tokens = Vec::new();
    while let Ok(reply) = replies.recv()
        && tokens.len() < MOST
    {
        tokens.extend(reply.result().ok().map(|sample| sample.key_expr().as_str().to_owned()));
    }
    tokens
}

fn counted(session: &Session, servers: String) -> Servers {
    let session = session.clone();
    Box::new(move || tokens(&session, &servers).len())
}

/// Asks the servers of an entity, which stays in the graph meanwhile.
fn asking<Q, A>(session: &Session, entity: Entity) -> Ask<Q, A>
where
    Q: Serialize + 'static,
    A: DeserializeOwned + 'static,
{
    let (session, entity, sequence) = (session.clone(), Rc::new(entity), AtomicI64::new(1));
    Box::new(move |question| {
        let sequence = sequence.fetch_add(1, Ordering::Relaxed);
        let attachment = Attachment { sequence, sent: system_now().0, gid: entity.gid }.to_bytes();
        let sent = session
            .get(entity.key.as_str())
            .payload(encode(&question))
            .attachment(attachment)
            .target(QueryTarget::AllComplete)
            .consolidation(ConsolidationMode::None)
            .timeout(ANSWER)
            .wait();
        let entity = Rc::clone(&entity);
        Box::pin(async move {
            let _declared = entity;
            let replies = sent.map_err(|error| super::one_line(&error))?;
            let reply = replies.recv_async().await.map_err(|_| "the server has gone".to_owned())?;
            match reply.result() {
                Ok(sample) => decode(&sample.payload().to_bytes()),
                Err(error) => Err(String::from_utf8_lossy(&error.payload().to_bytes()).into_owned()),
            }
        })
    })
}
