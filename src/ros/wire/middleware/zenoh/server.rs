//! Services: a queryable that holds each request until it is answered.

use ::zenoh::query::Query;
use ::zenoh::{Result, Session, Wait};
use futures::stream::{StreamExt, unfold};
use ros2_client::Message;
use tokio::sync::mpsc;

use super::Entity;
use super::keys::Attachment;
use crate::msg::{decode, encode};
use crate::ros::wire::clock::system_now;
use crate::ros::wire::middleware::{Answer, Request, Requests};

/// Maximum number of waiting requests.
const CAPACITY: usize = 64;

/// Declares the queryable of an entity in the graph.
pub(super) fn declare<Q, A>(session: &Session, entity: Entity) -> Result<Requests<Q, A>>
where
    Q: Message + 'static,
    A: Message + 'static,
{
    let (sender, queries) = mpsc::channel(CAPACITY);
    let Entity { key, token, .. } = entity;
    let queryable = session.declare_queryable(key.clone()).complete(true).callback(move |query: Query| {
        if let Err(mpsc::error::TrySendError::Full(query)) = sender.try_send(query) {
            let _ = query.reply_err("too many requests wait").wait(); // the client gets no answer, as for a lost request
        }
    });
    let declared = (queryable.wait()?, token);
    let requests = unfold((queries, key, declared), |(mut queries, key, declared)| async move {
        let query = queries.recv().await?;
        Some((request(query, &key), (queries, key, declared)))
    });
    Ok(requests.boxed_local())
}

fn request<Q, A>(query: Query, key: &str) -> std::result::Result<Request<Q, A>, String>
where
    Q: Message,
    A: Message + 'static,
{
    let attachment = query.attachment().and_then(|bytes| Attachment::from_bytes(&bytes.to_bytes()));
    let asked = attachment.ok_or("it doesn't say who asks")?;
    let question = decode(&query.payload().ok_or("it is empty")?.to_bytes())?;
    let key = key.to_owned();
    let answer: Answer<A> = Box::new(move |response| {
        let attachment = Attachment { sent: system_now().0, ..asked }.to_bytes();
        let sent = query.reply(key, encode(&response)).attachment(attachment).wait();
        Box::pin(std::future::ready(sent.map_err(|error| error.to_string())))
    });
    Ok(Request { question, answer })
}
