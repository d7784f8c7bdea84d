//! Subscriptions over NATS: keys of the bucket of states, first the latest value of each and then each change; and
//! core subjects.

use super::servers::Exchange;
use super::worker::PAUSE;
use async_nats::Subscriber;
use async_nats::jetstream::consumer::{DeliverPolicy, push};
use async_nats::jetstream::kv;
use futures_util::StreamExt;
use std::fmt::Display;
use tokio::time::sleep;

impl Exchange {
    /// Subscribes to the core NATS subject `NAME.kind.of`, where `NAME` is the name that gateways and workers share,
    /// with retries until the servers accept the subscription.
    pub async fn hear(&self, kind: &str, of: impl Display) -> Subscriber {
        let subject = self.subject(kind, of);
        loop {
            match self.client.subscribe(subject.clone()).await {
                Ok(messages) => return messages,
                Err(error) => {
                    tracing::warn!(%error, "{subject} cannot be heard yet");
                    sleep(PAUSE).await;
                }
            }
        }
    }

    /// Calls `came` for each key of the bucket of states that matches `filter`, with its latest value and then with
    /// each change; the value is `None` if the key was deleted. Purged keys are not reported.
    pub async fn follow(&self, filter: &str, came: impl Fn(&str, Option<&[u8]>)) {
        let kv::Store { stream, prefix, .. } = &self.state;
        loop {
            let config = push::OrderedConfig {
                deliver_subject: self.client.new_inbox(),
                filter_subject: format!("{prefix}{filter}"),
                deliver_policy: DeliverPolicy::LastPerSubject,
                ..push::OrderedConfig::default()
            };
            let messages = match stream.create_consumer(config).await {
                Ok(consumer) => consumer.messages().await.map_err(async_nats::Error::from),
                Err(error) => Err(error.into()),
            };
            match messages {
                Ok(mut messages) => {
                    while let Some(message) = messages.next().await {
                        let Ok(message) = message else { continue };
                        let operation = message.headers.as_ref().and_then(|headers| headers.get("KV-Operation"));
                        let is = operation.is_none_or(|what| what.as_str() == "PUT");
                        if let Some(key) = message.subject.strip_prefix(prefix.as_str()) {
                            came(key, is.then_some(&*message.payload));
                        }
                    }
                }
                Err(error) => tracing::warn!(%error, "{filter} cannot be followed yet"),
            }
            sleep(PAUSE).await;
        }
    }
}
