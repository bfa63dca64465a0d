"""A ROS 2 node on Zenoh after docs/design.md of rmw_zenoh, by Zenoh's own Python binding, with the router that it needs.

rmw_zenoh_cpp itself is not on PyPI, so this stands in for it: keys, liveliness tokens, attachments and services are
written here from the document, apart from what the node under test has."""
import time
from typing import NamedTuple

import xxhash
import zenoh
import zenoh.ext
from type_hashes import type_hash
from zenoh.ext import Int64, z_deserialize, z_serialize

ROUTER = """{mode: "router", listen: {endpoints: ["tcp/localhost:7447"]},
  scouting: {multicast: {enabled: false}}, timestamping: {enabled: true}}"""
SESSION = """{mode: "peer", connect: {endpoints: ["tcp/localhost:7447"], exit_on_failure: true, timeout_ms: 10000},
  listen: {endpoints: ["tcp/localhost:0"]},
  scouting: {multicast: {enabled: false}, gossip: {target: {router: ["router", "peer"], peer: ["router"]},
    autoconnect_strategy: {peer: {to_router: "always", to_peer: "greater-zid"}}}},
  timestamping: {enabled: true}}"""
QOS = "::,1000:,:,:,,"
ALL = "@ros2_lv/0/**"


class Token(NamedTuple):
    key: str
    kind: str
    enclave: str
    namespace: str
    node: str
    name: str = ""
    type_name: str = ""
    type_hash: str = ""
    qos: str = ""


def parse(key):
    parts = key.split("/")
    assert len(parts) in (9, 13) and parts[0] == "@ros2_lv", key
    rest = [part.replace("%", "/") for part in parts[6:10]] + parts[10:]
    return Token(key, parts[5], *rest)


def wire_type(type_name):
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def canonical(wire):
    return wire.replace("::dds_::", "::").replace("::", "/").removesuffix("_")


def gid(token_key):
    return xxhash.xxh3_128_intdigest(token_key.encode()).to_bytes(16, "little")


class Node:
    def __init__(self, name):
        zenoh.init_log_from_env_or("error")
        self.router = zenoh.open(zenoh.Config.from_json5(ROUTER))
        self.session = zenoh.open(zenoh.Config.from_json5(SESSION))
        self.base = f"@ros2_lv/0/{self.session.zid()}/0"
        self.name = name
        self.n_entities = 0
        self.kept = [self.session.liveliness().declare_token(f"{self.base}/0/NN/%/%/{name}")]

    def entity(self, kind, name, type_name):
        """Puts an entity into the graph; its key and its gid."""
        self.n_entities += 1
        end = f"{wire_type(type_name)}/{type_hash(type_name)}"
        key = f"{self.base}/{self.n_entities}/{kind}/%/%/{self.name}/{name.replace('/', '%')}/{end}/{QOS}"
        self.kept.append(self.session.liveliness().declare_token(key))
        return f"0/{name.strip('/')}/{end}", gid(key)

    def publisher(self, topic, type_name):
        """A function that publishes a message in CDR."""
        key, own = self.entity("MP", topic, type_name)
        publisher = self.session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
        sent = 0

        def publish(cdr):
            nonlocal sent
            sent += 1
            publisher.put(cdr, attachment=attachment(sent, own))

        self.kept.append(publisher)
        return publish

    def listen(self, topic, type_name, late=False):
        """What comes, as (CDR, sequence number, gid), in a list that grows; `late` asks for what was kept, too."""
        heard = []

        def on_sample(sample):
            sequence, _, sender = read_attachment(sample.attachment)
            heard.append((sample.payload.to_bytes(), sequence, sender))

        key, _ = self.entity("MS", topic, type_name)
        if late:
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1000)
            declare = zenoh.ext.declare_advanced_subscriber
            self.kept.append(declare(self.session, key, on_sample, history=history, subscriber_detection=True))
        else:
            self.kept.append(self.session.declare_subscriber(key, on_sample))
        return heard

    def call(self, service, type_name, cdr, seconds=15.0):
        """The response in CDR to a request in CDR."""
        key, own = self.entity("SC", service, type_name)
        wait(lambda: self.tokens(lambda token: token.kind == "SS" and token.name == service), f"{service}")
        replies = self.session.get(
            key,
            payload=cdr,
            attachment=attachment(7, own),
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=seconds,
        )
        answers = list(replies)
        assert len(answers) == 1 and answers[0].ok is not None, f"{service} did not answer: {answers}"
        sequence, stamp, asked = read_attachment(answers[0].ok.attachment)
        assert (sequence, asked) == (7, own) and abs(stamp - time.time_ns()) < 60e9, "whose response it is"
        return answers[0].ok.payload.to_bytes()

    def tokens(self, wanted=lambda token: True):
        """The graph, but for this node."""
        replies = self.session.liveliness().get(ALL, timeout=5.0)
        found = [parse(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None]
        return [token for token in found if token.node != self.name and wanted(token)]

    def close(self):
        self.kept.clear()
        self.session.close()
        self.router.close()


def attachment(sequence, own):
    return z_serialize((Int64(sequence), Int64(time.time_ns()), own))


def read_attachment(data):
    return z_deserialize(tuple[Int64, Int64, bytes], data)


def wait(condition, what, seconds=20.0):
    deadline = time.monotonic() + seconds
    while True:
        found = condition()
        if found:
            return found
        assert time.monotonic() < deadline, f"never came: {what}"
        time.sleep(0.05)
