//! ROS 2 topics and services over DDS, only on the configured network interfaces.

use std::net::IpAddr;
use std::thread;

use ros2_client::dds::rustdds::{DomainParticipant, DomainParticipantBuilder, RTPSEntity};
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{
    Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile, Server,
    ServiceMapping, ServiceTypeName, Subscription,
};

use crate::clock::Clock;
use crate::config::{Network, Reliability, Services};
use crate::error::{Error, Result};
use crate::messages::{Message, TriggerRequest, TriggerResponse};
use crate::security::{Protection, protected};
use crate::watch::Moment;

/// Queue length of a subscription: one second at a kilohertz.
const KEPT: usize = 1000;

/// A node on the network.
pub struct Link {
    participant: DomainParticipant,
    /// Who may take part.
    pub protection: Protection,
    node: Node,
    services: Services,
}

/// A service of this node.
pub struct Trigger(Server<TriggerRequest, TriggerResponse>);

/// A client of another node's service.
pub struct Caller(ros2_client::Client<TriggerRequest, TriggerResponse>);

/// A subscription.
pub struct Inbox<M> {
    /// The topic.
    pub topic: String,
    subscription: Subscription<M>,
}

/// A publisher.
pub struct Outlet<M: Message> {
    /// The topic.
    pub topic: String,
    publisher: Publisher<M>,
}

fn broken(what: &str, error: &dyn std::fmt::Debug) -> Error {
    Error::refused(format!("{what}: {error:?}"))
}

/// Quality of service of services, as in ROS 2.
pub fn service_qos() -> QosProfile {
    QosProfile::publisher_default()
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: 10 })
}

fn topic_qos(reliability: Reliability, depth: usize) -> QosProfile {
    let qos = QosProfile::subscription_default().history(History::KeepLast { depth });
    match reliability {
        Reliability::BestEffort => qos,
        // A full window of a reliable publisher must not block the loop.
        Reliability::Reliable => qos.reliability_reliable(WhenFull::Fail),
    }
}

impl Link {
    /// A node with this name.
    ///
    /// # Errors
    /// [`Error::Refused`] if an interface is not there or the network cannot be used.
    pub fn open(network: &Network, name: &str) -> Result<Self> {
        let shown = || {
            let all: Vec<String> = network.interfaces.iter().map(IpAddr::to_string).collect();
            all.join(", ")
        };
        let there = addresses();
        if let Some(missing) = network.interfaces.iter().find(|one| !there.contains(one)) {
            let there: Vec<String> = there.iter().map(IpAddr::to_string).collect();
            return Err(Error::refused(format!(
                "network.interfaces: this machine has no {missing}; it has {}",
                there.join(", ")
            )));
        }
        let protection = Protection::of_environment(name)?;
        let builder = DomainParticipantBuilder::new(network.domain)
            .with_only_networks(network.interfaces.iter().copied());
        let participant = protected(builder, &protection)
            .build()
            .map_err(|error| broken(&format!("DDS cannot start on {}", shown()), &error))?;
        let context = Context::from_domain_participant(participant.clone())
            .map_err(|error| broken("DDS cannot start", &error))?;
        let name = NodeName::new("/", name).map_err(|error| broken("the node's name", &error))?;
        let options = NodeOptions::new()
            .enable_rosout(false)
            .start_parameter_services(false);
        let mut node = context
            .new_node(name, options)
            .map_err(|error| broken("the node cannot start", &error))?;
        let spinner = node
            .spinner()
            .map_err(|error| broken("the node cannot start", &error))?;
        thread::Builder::new()
            .name("discovery".to_owned())
            .spawn(move || futures::executor::block_on(spinner.spin()))
            .map_err(|error| broken("the node cannot start", &error))?;
        Ok(Self {
            participant,
            protection,
            node,
            services: network.services,
        })
    }

    fn topic<M: Message>(
        &self,
        name: &str,
        qos: &QosProfile,
    ) -> Result<ros2_client::dds::rustdds::Topic> {
        let parsed = Name::parse(name).map_err(|error| broken(name, &error))?;
        self.node
            .create_topic(&parsed, MessageTypeName::new(M::PACKAGE, M::NAME), qos)
            .map_err(|error| broken(name, &error))
    }

    /// Subscribes to a topic.
    ///
    /// # Errors
    /// [`Error::Refused`] if DDS does not allow it.
    pub fn subscribe<M: Message>(
        &mut self,
        topic: &str,
        reliability: Reliability,
    ) -> Result<Inbox<M>> {
        let qos = topic_qos(reliability, KEPT);
        let dds = self.topic::<M>(topic, &qos)?;
        let subscription = self
            .node
            .create_subscription(&dds, Some(qos))
            .map_err(|error| broken(topic, &error))?;
        Ok(Inbox {
            topic: topic.to_owned(),
            subscription,
        })
    }

    /// Opens a publisher on a topic.
    ///
    /// # Errors
    /// [`Error::Refused`] if DDS does not allow it.
    pub fn publish<M: Message>(
        &mut self,
        topic: &str,
        reliability: Reliability,
    ) -> Result<Outlet<M>> {
        let qos = topic_qos(reliability, 10);
        let dds = self.topic::<M>(topic, &qos)?;
        let publisher = self
            .node
            .create_publisher(&dds, Some(qos))
            .map_err(|error| broken(topic, &error))?;
        Ok(Outlet {
            topic: topic.to_owned(),
            publisher,
        })
    }

    /// Offers a service of `std_srvs/Trigger`.
    ///
    /// # Errors
    /// [`Error::Refused`] if DDS does not allow it.
    pub fn serve(&mut self, name: &str) -> Result<Trigger> {
        self.offer(name, &ServiceTypeName::new("std_srvs", "Trigger"))
            .map(Trigger)
    }

    /// Offers a service of any type.
    ///
    /// # Errors
    /// [`Error::Refused`] if DDS does not allow it.
    pub fn offer<Q, R>(&mut self, name: &str, kind: &ServiceTypeName) -> Result<Server<Q, R>>
    where
        Q: ros2_client::Message + Clone + 'static,
        R: ros2_client::Message + Clone + 'static,
    {
        let parsed = Name::parse(name).map_err(|error| broken(name, &error))?;
        let mapping = self.mapping();
        self.node
            .create_server(mapping, &parsed, kind, service_qos(), service_qos())
            .map_err(|error| broken(name, &error))
    }

    /// Calls a service of `std_srvs/Trigger`.
    ///
    /// # Errors
    /// [`Error::Refused`] if DDS does not allow it.
    pub fn caller(&mut self, name: &str) -> Result<Caller> {
        let parsed = Name::parse(name).map_err(|error| broken(name, &error))?;
        self.node
            .create_client(
                self.mapping(),
                &parsed,
                &ServiceTypeName::new("std_srvs", "Trigger"),
                service_qos(),
                service_qos(),
            )
            .map(Caller)
            .map_err(|error| broken(name, &error))
    }

    /// Mapping of services to DDS topics.
    pub fn mapping(&self) -> ServiceMapping {
        match self.services {
            Services::Enhanced => ServiceMapping::Enhanced,
            Services::Cyclone => ServiceMapping::Cyclone,
        }
    }

    /// The node itself, for actions.
    pub fn node(&mut self) -> &mut Node {
        &mut self.node
    }

    /// Number of other nodes' publishers on a topic, matching or not.
    pub fn publishers(&self, topic: &str) -> usize {
        let (name, own) = (format!("rt{topic}"), self.participant.guid().prefix);
        let writers = self.participant.discovered_writers();
        // This node's own announcements come back to it.
        let others = writers.iter().filter(|one| {
            one.publication_topic_data.topic_name == name
                && one.writer_proxy.remote_writer_guid.prefix != own
        });
        others.count()
    }

    /// Number of other nodes' subscriptions on a topic, matching or not.
    pub fn subscriptions(&self, topic: &str) -> usize {
        self.node.subscription_count(topic)
    }

    /// Number of matched publishers of a subscription.
    pub fn heard<M: Message>(&self, inbox: &Inbox<M>) -> usize {
        inbox.subscription.get_publisher_count(&self.node)
    }

    /// Number of matched subscriptions of a publisher.
    pub fn hearing<M: Message>(&self, outlet: &Outlet<M>) -> usize {
        outlet.publisher.get_subscription_count(&self.node)
    }
}

impl<M: Message> Inbox<M> {
    /// Takes all received messages, oldest first, each with its time of receipt.
    pub fn drain(&self, clock: Clock, mut take: impl FnMut(Moment, M)) {
        // Unreadable data is skipped; the next message may be readable.
        for _ in 0..2 * KEPT {
            match self.subscription.take() {
                Ok(Some((message, info))) => {
                    let now = clock.now();
                    let moment = info
                        .received_timestamp()
                        .map_or(now, |at| clock.at(at.to_nanos()));
                    take(moment, message);
                }
                Ok(None) => break,
                Err(_) => (),
            }
        }
    }
}

impl<M: Message> Outlet<M> {
    /// Sends a message.
    ///
    /// # Errors
    /// [`Error::Refused`] if DDS does not take it.
    pub fn send(&self, message: M) -> Result<()> {
        self.publisher
            .publish(message)
            .map_err(|error| Error::refused(format!("{}: {error:?}", self.topic)))
    }
}

impl Trigger {
    /// Whether a request has arrived; it is answered with success.
    pub fn asked(&self) -> bool {
        let mut asked = false;
        while let Ok(Some((id, _))) = self.0.receive_request() {
            asked = true;
            let answer = TriggerResponse {
                success: true,
                message: "stopping".to_owned(),
            };
            let _ = self.0.send_response(id, answer);
        }
        asked
    }
}

impl Caller {
    /// Sends a request and does not wait for the response.
    pub fn call(&self) {
        let _ = self.0.send_request(TriggerRequest::default());
    }
}

/// The addresses of this machine's interfaces.
fn addresses() -> Vec<IpAddr> {
    if_addrs::get_if_addrs()
        .map(|all| all.iter().map(if_addrs::Interface::ip).collect())
        .unwrap_or_default()
}
