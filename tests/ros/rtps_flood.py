"""Sends malformed RTPS to every node on RustDDS, in the namespace of tests/ros/isolated only.

rtps_flood.py SECONDS [--rate PACKETS_PER_S] [--kinds KIND,...] [--seed N] [--watch PID]

It listens to the loopback first, learns who is there, which writers and readers they have and how far these have come, and
then speaks in their names: one generator for every kind of submessage, for what discovery says, and captured packets sent
again, changed. At the end it prints what it sent as JSON. With --watch it says each ten seconds what the process PID takes
and how many samples a second come from the nodes.
"""
import argparse
import json
import os
import random
import socket
import struct
import sys
import time
from collections import Counter

PAD, ACKNACK, HEARTBEAT, GAP, INFO_TS, INFO_SRC, INFO_REPLY_IP4 = 0x01, 0x06, 0x07, 0x08, 0x09, 0x0C, 0x0D
INFO_DST, INFO_REPLY, NACK_FRAG, HEARTBEAT_FRAG, DATA, DATA_FRAG = 0x0E, 0x0F, 0x12, 0x13, 0x15, 0x16
SECURE = (0x30, 0x31, 0x32, 0x33, 0x34)  # SEC_BODY, SEC_PREFIX, SEC_POSTFIX, SRTPS_PREFIX, SRTPS_POSTFIX
RUSTDDS = b"\x01\x12"
OURS = b"\x01\x0f"  # the vendor that our packets claim: OpenDDS, which nobody here is

SPDP_WRITER, SPDP_READER = bytes.fromhex("000100c2"), bytes.fromhex("000100c7")
PUBLICATIONS_WRITER, PUBLICATIONS_READER = bytes.fromhex("000003c2"), bytes.fromhex("000003c7")
SUBSCRIPTIONS_WRITER, SUBSCRIPTIONS_READER = bytes.fromhex("000004c2"), bytes.fromhex("000004c7")
MESSAGE_WRITER, MESSAGE_READER = bytes.fromhex("000200c2"), bytes.fromhex("000200c7")
TYPE_LOOKUP_WRITER, TYPE_LOOKUP_READER = bytes.fromhex("000300c3"), bytes.fromhex("000300c4")
UNKNOWN = bytes(4)

# Numbers that are at the edge of something.
NUMBERS = (-(2**63), -1, 0, 1, 2, 255, 256, 257, 2**16, 2**31 - 1, 2**31, 2**32, 2**48, 2**60, 2**62, 2**63 - 1)
SMALL_NUMBERS = (0, 1, 2, 255, 256, 257, 65535, 65536, 2**24, 2**31, 2**32 - 1)


def submessage(kind, body, flags=0x01, length=None):
    return struct.pack("<BBH", kind, flags, (len(body) if length is None else length) & 0xFFFF) + body


def sequence_number(number):
    number &= 2**64 - 1
    return struct.pack("<II", number >> 32, number & 0xFFFFFFFF)


def number_set(base, n_bits, words):
    return base + struct.pack(f"<I{len(words)}I", n_bits, *words)


def parameter(pid, value):
    return struct.pack("<HH", pid, len(value) & 0xFFFF) + value


def locator(kind, port, address):
    return struct.pack("<iI", kind, port) + bytes(12) + bytes(address)


def text(value):
    value = value.encode() + b"\0"
    return struct.pack("<I", len(value)) + value + bytes(-len(value) % 4)


class Peer:
    """What was heard of a participant: where it listens, its writers with the last number of each, and its readers."""

    def __init__(self, prefix, vendor):
        self.prefix, self.vendor = prefix, vendor
        self.addresses, self.writers, self.readers = set(), {}, set()
        self.n_samples = 0


class Ear:
    """Everything that goes over the loopback, as a raw socket hears it."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(0x0800))
        self.socket.bind(("lo", 0))
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        self.socket.setblocking(False)
        self.peers, self.captured = {}, []

    def hear(self, seconds):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            if not self.take():
                time.sleep(0.01)

    def take(self):
        """Takes what is there, at most so much; whether there was anything."""
        for n in range(500):
            try:
                packet, (_, _, direction, *_) = self.socket.recvfrom(65536)
            except BlockingIOError:
                return n > 0
            if direction == socket.PACKET_OUTGOING or packet[9] != 17:
                continue
            message = packet[(packet[0] & 0x0F) * 4 + 8 :]
            if message[:4] == b"RTPS" and message[6:8] != OURS:
                self.note(message)
        return True

    def note(self, message):
        prefix = message[8:20]
        peer = self.peers.setdefault(prefix, Peer(prefix, message[6:8]))
        if len(self.captured) < 2000:
            self.captured.append(message)
        at = 20
        while at + 4 <= len(message):
            kind, flags, length = struct.unpack_from("<BBH", message, at)
            body = message[at + 4 : at + 4 + length] if length else message[at + 4 :]
            if flags & 1 and kind in (DATA, DATA_FRAG) and len(body) >= 20:
                high, low = struct.unpack_from("<iI", body, 12)
                peer.writers[body[8:12]] = max(peer.writers.get(body[8:12], 0), (high << 32) + low)
                peer.n_samples += kind == DATA and body[11] in (0x02, 0x03)
                if body[8:12] == SPDP_WRITER:
                    self.note_locators(peer, body)
            elif flags & 1 and kind == HEARTBEAT and len(body) >= 28:
                peer.writers.setdefault(body[4:8], struct.unpack_from("<I", body, 20)[0])
            elif flags & 1 and kind == ACKNACK and len(body) >= 8:
                peer.readers.add((body[:4], body[4:8]))
            at += 4 + (length or len(message))

    def note_locators(self, peer, body):
        at = 24  # behind the header of DATA and that of the parameter list
        while at + 4 <= len(body):
            pid, length = struct.unpack_from("<HH", body, at)
            if pid in (0x31, 0x32) and length == 24:
                kind, port = struct.unpack_from("<iI", body, at + 4)
                if kind == 1:
                    peer.addresses.add((socket.inet_ntoa(body[at + 24 : at + 28]), port))
            if pid == 1:
                break
            at += 4 + length


class Flood:
    def __init__(self, ear, rng):
        self.ear, self.rng, self.count = ear, rng, 0
        self.nodes = [peer for peer in ear.peers.values() if peer.vendor == RUSTDDS and peer.addresses]
        if not self.nodes:
            sys.exit("no node on RustDDS announced itself")
        self.others = [peer for peer in ear.peers.values() if peer not in self.nodes] or self.nodes
        self.kinds = {name[5:]: getattr(self, name) for name in dir(self) if name.startswith("send_")}

    def message(self, prefix, *submessages):
        return b"RTPS\x02\x03" + OURS + prefix + b"".join(submessages)

    def writer(self):
        """A writer of another participant, and how far it has come."""
        peer = self.rng.choice([peer for peer in self.others if peer.writers] or self.nodes)
        return (peer.prefix, *self.rng.choice(list(peer.writers.items()) or [(UNKNOWN, 0)]))

    def reader(self):
        peer = self.rng.choice([peer for peer in self.others if peer.readers] or self.others)
        return (peer.prefix, *self.rng.choice(list(peer.readers) or [(UNKNOWN, SPDP_WRITER)]))

    def number(self, near=0):
        choice = self.rng.random()
        if choice < 0.4:
            return near + self.rng.choice(NUMBERS[2:13])
        return self.rng.choice(NUMBERS) if choice < 0.8 else near + self.rng.randint(0, 5000)

    def next_count(self):
        self.count += 1
        return self.rng.choice((self.count, self.count, 2**31 - 1, -1)) & 0xFFFFFFFF

    def data(self, reader, writer, number, payload, flags=0x05, inline=b"", to_inline=16):
        head = struct.pack("<HH", 0, to_inline) + reader + writer + sequence_number(number)
        return submessage(DATA, head + inline + payload, flags)

    def send_data(self):
        prefix, writer, last = self.writer()
        inline = self.rng.choice((b"", parameter(0x70, bytes(16)) + parameter(1, b""), parameter(0x71, b"\0" * 4), b"\xff" * 8))
        flags = self.rng.choice((0x05, 0x01, 0x09, 0x0D, 0x0F)) | (0x02 if inline else 0)
        payload = b"\0\1\0\0" + self.rng.randbytes(self.rng.randint(0, 200))
        to_inline = self.rng.choice((16, 16, 16, 0, 20, 65535))
        return self.message(prefix, self.data(UNKNOWN, writer, self.number(last), payload, flags, inline, to_inline))

    def send_data_frag(self):
        prefix, writer, last = self.writer()
        size = self.rng.choice((960, 0, 1, 256, 65535))
        head = struct.pack("<HH", 0, 28) + UNKNOWN + writer + sequence_number(self.number(last))
        head += struct.pack(
            "<IHHI",
            self.rng.choice(SMALL_NUMBERS),
            self.rng.choice((1, 1, 0, 2, 65535)),
            size,
            self.rng.choice((2**32 - 1, 2**31, 128 << 20, 64 << 20, 1000, 961, 0)),
        )
        return self.message(prefix, submessage(DATA_FRAG, head + bytes(self.rng.choice((960, size % 1400, 0)))))

    def send_heartbeat(self):
        prefix, writer, last = self.writer()
        body = UNKNOWN + writer + sequence_number(self.rng.choice((1, self.number(last))))
        body += sequence_number(self.number(last)) + struct.pack("<I", self.next_count())
        return self.message(prefix, submessage(HEARTBEAT, body, self.rng.choice((0x01, 0x03, 0x05))))

    def send_heartbeat_frag(self):
        prefix, writer, last = self.writer()
        body = UNKNOWN + writer + sequence_number(self.number(last))
        return self.message(prefix, submessage(HEARTBEAT_FRAG, body + struct.pack("<II", self.rng.choice(SMALL_NUMBERS), self.next_count())))

    def send_gap(self):
        prefix, writer, last = self.writer()
        n_bits = self.rng.choice((0, 1, 32, 256, 257, 2**32 - 1))
        words = [self.rng.getrandbits(32) for _ in range(min(8, (n_bits + 31) // 32))]
        body = UNKNOWN + writer + sequence_number(self.rng.choice((1, last + 2, self.number(last))))
        return self.message(prefix, submessage(GAP, body + number_set(sequence_number(self.number(last)), n_bits, words)))

    def send_acknack(self):
        prefix, reader, writer = self.reader()
        base = self.rng.choice((0, 1, self.number()))
        n_bits = self.rng.choice((0, 256, 256, 257))
        body = reader + self.rng.choice((writer, writer, UNKNOWN)) + number_set(sequence_number(base), n_bits, [2**32 - 1] * 8)
        return self.message(prefix, submessage(ACKNACK, body + struct.pack("<I", self.next_count())))

    def send_nack_frag(self):
        prefix, reader, writer = self.reader()
        base = struct.pack("<I", self.rng.choice(SMALL_NUMBERS))
        body = reader + writer + sequence_number(self.rng.choice((1, 2, 3, self.number())))
        body += number_set(base, self.rng.choice((1, 256, 256, 2**31)), [2**32 - 1] * 8)
        return self.message(prefix, submessage(NACK_FRAG, body + struct.pack("<I", self.next_count())))

    def send_info(self):
        """Interpreter submessages, then something that they change the meaning of."""
        prefix, writer, last = self.writer()
        locators = b"".join(locator(1, 7400 + n, (127, 0, 1, n % 250)) for n in range(self.rng.choice((0, 4, 500))))
        infos = (
            submessage(INFO_TS, struct.pack("<II", self.rng.choice((0, 2**32 - 1, 2**31, 4294944000)), 2**32 - 1)),
            submessage(INFO_TS, b"", 0x03),
            submessage(INFO_DST, self.rng.choice((bytes(12), self.nodes[0].prefix, self.rng.randbytes(12)))),
            submessage(INFO_SRC, bytes(4) + b"\x02\x03" + OURS + self.rng.choice(self.others).prefix),
            submessage(INFO_REPLY, struct.pack("<I", len(locators) // 24) + locators),
            submessage(INFO_REPLY, struct.pack("<I", 2**32 - 1), 0x03),
            submessage(INFO_REPLY_IP4, bytes(12)),
            submessage(PAD, bytes(4 * self.rng.randint(0, 4))),
        )
        heartbeat = submessage(HEARTBEAT, UNKNOWN + writer + sequence_number(1) + sequence_number(last + 9) + struct.pack("<I", self.next_count()))
        return self.message(prefix, *self.rng.choices(infos, k=3), *[heartbeat] * self.rng.choice((1, 1, 100)))

    def send_other(self):
        """Kinds that are unknown, of vendors, of DDS security, or cut off."""
        prefix, _, _ = self.writer()
        kind = self.rng.choice((*SECURE, self.rng.randrange(256)))
        body = self.rng.randbytes(self.rng.randint(0, 300))
        parts = [submessage(kind, body, self.rng.randrange(256), self.rng.choice((None, None, 0, 65535)))]
        return self.message(prefix, *parts * self.rng.choice((1, 3)))[: self.rng.choice((4, 19, 22, 65000))]

    def send_many(self):
        """One datagram with as many submessages as go in."""
        prefix, writer, last = self.writer()
        kinds = (
            submessage(HEARTBEAT, UNKNOWN + writer + sequence_number(1) + sequence_number(2**40) + struct.pack("<I", self.next_count())),
            submessage(INFO_TS, b"", 0x03),
            self.data(UNKNOWN, writer, last + 10**6, b"\0\1\0\0"),
        )
        one = self.rng.choice(kinds)
        return self.message(prefix, one * (30000 // len(one)))

    def participant(self, prefix, address, lease):
        list_ = parameter(0x15, b"\x02\x03\0\0") + parameter(0x16, OURS + b"\0\0") + parameter(0x50, prefix + bytes.fromhex("000001c1"))
        for pid in (0x32, 0x31):
            list_ += parameter(pid, locator(1, 7410, address)) * self.rng.choice((1, 1, 100))
        list_ += parameter(0x02, struct.pack("<iI", *lease)) + parameter(0x58, struct.pack("<I", 0xFFFFFFFF))
        list_ += self.rng.choice((b"", parameter(0x62, text("x" * 2000)), parameter(0x62, struct.pack("<I", 2**30))))
        return list_ + self.rng.choice((parameter(1, b""), parameter(1, b""), b""))

    def announce(self, prefix, number=1):
        address = (127, 0, 1, self.rng.randrange(1, 250))
        lease = self.rng.choice(((10, 0), (0, 0), (0x7FFFFFFF, 0xFFFFFFFF), (-1, 0)))
        payload = b"\0\3\0\0" + self.participant(prefix, address, lease)
        return self.message(prefix, self.data(UNKNOWN, SPDP_WRITER, number, payload))

    def send_participant(self):
        """One that doesn't exist."""
        return self.announce(self.rng.randbytes(12))

    def send_same_participant(self):
        """One that is always the same and always elsewhere."""
        self.count += 1
        return self.announce(b"\x01\x0fflooding12"[:12], self.count)

    def send_endpoint(self):
        """A writer or reader of a participant that is there, on a topic of its own."""
        peer = self.rng.choice(self.others)
        kind = self.rng.choice(((PUBLICATIONS_WRITER, PUBLICATIONS_READER), (SUBSCRIPTIONS_WRITER, SUBSCRIPTIONS_READER)))
        self.count += 1
        guid = peer.prefix + struct.pack(">I", self.rng.randrange(2**24))[1:] + (b"\x03" if kind[0] == PUBLICATIONS_WRITER else b"\x04")
        name = self.rng.choice((f"rt/flood_{self.count}", "rt/tactile_pose_fusion/contacts", "x" * 30000))
        list_ = parameter(0x5A, guid) + parameter(0x05, text(name)) + parameter(0x07, text("std_msgs::msg::dds_::String_"))
        list_ += parameter(0x2F, locator(1, self.rng.randrange(65536), (127, 0, 1, 1))) + parameter(1, b"")
        number = peer.writers.get(kind[0], 0) + self.count
        return self.message(peer.prefix, self.data(kind[1], kind[0], number, b"\0\3\0\0" + list_))

    def send_liveliness(self):
        peer = self.rng.choice(self.others)
        self.count += 1
        payload = b"\0\1\0\0" + self.rng.randbytes(12) + struct.pack("<II", self.rng.choice((0, 1, 2**31)), self.rng.choice((0, 1, 2**32 - 1)))
        return self.message(peer.prefix, self.data(MESSAGE_READER, MESSAGE_WRITER, self.number(self.count), payload + bytes(4)))

    def send_type_lookup(self):
        peer = self.rng.choice(self.others)
        self.count += 1
        return self.message(peer.prefix, self.data(TYPE_LOOKUP_READER, TYPE_LOOKUP_WRITER, self.count, b"\0\1\0\0" + self.rng.randbytes(64)))

    def send_captured(self):
        """A packet that was captured, changed."""
        message = bytearray(self.rng.choice(self.ear.captured))
        message[6:8] = OURS
        for _ in range(self.rng.choice((0, 1, 2, 8))):
            if len(message) <= 20:
                break  # nothing but the header is left
            at = self.rng.randrange(20, len(message))
            how = self.rng.randrange(4)
            if how == 0:
                message[at] ^= 1 << self.rng.randrange(8)
            elif how == 1:
                message[at : at + 4] = self.rng.choice((b"\xff" * 4, bytes(4), b"\x80\0\0\0", b"\xff\xff\xff\x7f"))
            elif how == 2:
                del message[at : at + self.rng.randint(1, 16)]
            else:
                message[at:at] = message[20:at][: self.rng.randint(1, 600)]
        return bytes(message[:60000])


class Watch:
    """What a process takes, and what the nodes send."""

    def __init__(self, pid, ear, nodes):
        self.pid, self.ear, self.nodes = pid, ear, nodes
        self.start = self.last = time.monotonic()
        self.last_cpu, self.last_samples = self.cpu(), self.samples()

    def cpu(self):
        fields = open(f"/proc/{self.pid}/stat").read().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def samples(self):
        return sum(node.n_samples for node in self.nodes)

    def say(self, n_sent):
        now, cpu, samples = time.monotonic(), self.cpu(), self.samples()
        rss = next(line for line in open(f"/proc/{self.pid}/status") if line.startswith("VmRSS"))
        took = now - self.last
        print(
            f"{now - self.start:6.0f} s  {int(rss.split()[1]) / 1024:7.1f} MB  {100 * (cpu - self.last_cpu) / took:5.1f} % of a core"
            f"  {(samples - self.last_samples) / took:6.1f} samples/s out  {n_sent:8d} packets in",
            flush=True,
        )
        self.last, self.last_cpu, self.last_samples = now, cpu, samples


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("seconds", type=float)
    arguments.add_argument("--rate", type=float, default=2000)
    arguments.add_argument("--kinds", default="")
    arguments.add_argument("--seed", type=int, default=1)
    arguments.add_argument("--watch", type=int)
    arguments.add_argument("--listen", type=float, default=4)
    options = arguments.parse_args()
    if os.environ.get("TPF_ISOLATED") != "1":
        sys.exit("this floods a network: run it within tests/ros/isolated only")

    speaker = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    ear, rng = Ear(), random.Random(options.seed)
    until = time.monotonic() + max(15, options.listen)
    ear.hear(options.listen)
    while not any(peer.vendor == RUSTDDS and peer.addresses for peer in ear.peers.values()) and time.monotonic() < until:
        ear.hear(0.5)
    flood, sent, n_sent = Flood(ear, rng), Counter(), 0
    kinds = options.kinds.split(",") if options.kinds else list(flood.kinds)
    # Not to the group: Cyclone DDS ends by a segmentation fault of some of this, and with it what listens to the node.
    targets = sorted({address for node in flood.nodes for address in node.addresses})
    print(f"{len(flood.nodes)} nodes, {len(flood.others)} others, {len(ear.captured)} packets captured, to {targets}", flush=True)
    watch = Watch(options.watch, ear, flood.nodes) if options.watch else None

    start = said = time.monotonic()
    while (now := time.monotonic()) - start < options.seconds:
        for _ in range(min(200, int((now - start) * options.rate) - n_sent)):
            kind = rng.choice(kinds)
            try:
                speaker.sendto(flood.kinds[kind](), rng.choice(targets))
                sent[kind] += 1
            except OSError:
                sent[f"{kind}: not sent"] += 1
            n_sent += 1
        ear.take()
        if watch and now - said >= 10:
            watch.say(n_sent)
            said = now
        time.sleep(0.002)
    print(json.dumps(dict(sorted(sent.items()))))


if __name__ == "__main__":
    main()
