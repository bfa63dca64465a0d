"""The ways in which live inputs go wrong: what is done to good ones, and which words tell a person where to look."""
import math
import random
from dataclasses import dataclass, field
from typing import Callable, Optional

S = 1_000_000_000
MS = 1_000_000
TAXELS, JOINTS = "/glove/taxels", "/hand/joint_states"


@dataclass
class Case:
    """One way. `taxels` and `joints` change a message before it is sent, and may give several or none in its place.

    `since_start`: the fault is there before the node is; otherwise it begins when estimates are good."""

    name: str
    group: str
    says: list = field(default_factory=list)  # one of these words is in diagnostics or on stderr
    taxels: Optional[Callable] = None
    joints: Optional[Callable] = None
    since_start: bool = False
    rates: tuple = (100.0, 100.0)  # Hz of taxels and joints once the fault is there
    params: str = ""  # lines of the node's parameters
    publish: str = "both"  # both, taxels, joints, none
    topics: tuple = (TAXELS, JOINTS)
    types: tuple = (None, None)  # other types than TaxelArray and JointState
    qos: dict = field(default_factory=dict)  # of the publishers
    domain: int = 0  # of the publishers, beyond the node's
    clock: str = ""  # what /clock does
    act: str = ""  # what happens to processes when the fault begins
    fine: bool = False  # nothing is wrong: nobody is to be told anything
    calibrated: bool = True
    seconds: float = 6.0  # after the fault
    why: str = ""


def shifted(ns):
    def change(m):
        m.stamp += ns
    return change


def stamp(value):
    def change(m):
        m.stamp = value(m) if callable(value) else value
    return change


def scaled(key, factor):
    def change(m):
        setattr(m, key, [factor * value for value in getattr(m, key)])
    return change


def put(**values):
    def change(m):
        for key, value in values.items():
            setattr(m, key, value(m) if callable(value) else value)
    return change


def silent(m):
    return []


def held(m, memory={}):
    """A driver that repeats its last sample, with stamps of now."""
    key = (m.kind, m.case)
    memory.setdefault(key, (list(m.values), list(m.positions)))
    m.values, m.positions = (list(part) for part in memory[key])


def keep(memory, value, m):
    return memory.setdefault((m.kind, m.case), value)


def frozen_stamp(m, memory={}):
    m.stamp = keep(memory, m.stamp, m)


def falling(m, memory={}):
    m.stamp = 2 * keep(memory, m.stamp, m) - m.stamp


def one(key, idx, value):
    def change(m):
        values = list(getattr(m, key))
        values[idx] = value(m) if callable(value) else value
        setattr(m, key, values)
    return change


def stuck(m, memory={}):
    m.values[2] = keep(memory, m.values[2], m)


def burst(n):
    """Samples come n at a time."""
    def change(m, waiting={}):
        queue = waiting.setdefault((m.kind, m.case), [])
        queue.append(m)
        if len(queue) < n:
            return []
        out = list(queue)
        queue.clear()
        return out
    return change


def link(hold_s):
    """A link that stalls and then delivers all that it held."""
    def change(m, waiting={}):
        queue = waiting.setdefault((m.kind, m.case), [])
        queue.append(m)
        if m.since % (hold_s + 0.5) < hold_s:
            return []
        out = list(queue)
        queue.clear()
        return out
    return change


def delayed(seconds):
    def change(m, waiting={}):
        queue = waiting.setdefault((m.kind, m.case), [])
        queue.append(m)
        due = [old for old in queue if m.since - old.since >= seconds]
        del queue[: len(due)]
        return due
    return change


def lossy(share):
    def change(m):
        return [] if random.random() < share else [m]
    return change


def renamed(m):
    m.names = [f"joint_{idx}" for idx in range(len(m.names))]


def boot(m):
    m.stamp = int((12_345.0 + m.since) * S)


def long(m):
    m.values = m.values + m.values


def alternating(m):
    if m.n % 2:
        m.values = m.values[:-1]


def to_and_fro(m):
    m.stamp += -S if (m.n // 20) % 2 else 0


def shuffled(m):
    m.stamp += random.randrange(-30, 31) * MS


def coarse(m):
    m.stamp -= m.stamp % (100 * MS)


NAN = float("nan")
GLOVE, HAND = "tactile.glove", "joint.hand"

CASES = [
    # Nothing is wrong: whoever says something here cries wolf.
    Case("nothing is wrong", "control", fine=True),
    Case("nothing is wrong, from the start", "control", fine=True, since_start=True, seconds=5.0),
    Case("joints in another order", "control", joints=put(names=lambda m: m.names[::-1], positions=lambda m: m.positions[::-1]), fine=True),
    Case("joints at 60 Hz", "control", rates=(100.0, 60.0), fine=True),
    # Who is there.
    Case("nobody publishes taxels", "absent", ["nobody publishes"], publish="joints", since_start=True),
    Case("nobody publishes joint angles", "absent", ["nobody publishes"], publish="taxels", since_start=True),
    Case("nobody publishes anything", "absent", ["nobody publishes"], publish="none", since_start=True),
    Case("taxels in another namespace", "absent", ["/left/glove/taxels"], topics=("/left/glove/taxels", JOINTS), since_start=True),
    Case("joint angles under another name", "absent", ["/hand/joints"], topics=(TAXELS, "/hand/joints"), since_start=True),
    Case("publishers in another domain", "absent", ["nobody publishes"], domain=100, since_start=True),
    Case("no calibration", "absent", ["calibrat"], calibrated=False, since_start=True),
    # Types.
    Case("taxels as another type", "types", ["JointState", "tactile.glove.type"], types=("JointState", None), since_start=True),
    Case("joint angles as another type", "types", ["TaxelArray", "joint.hand.type"], types=(None, "TaxelArray"), since_start=True),
    Case("taxels of the same type name with other fields", "types", ["/glove/taxels"], types=("Other", None), since_start=True),
    Case("joint angles of the same type name with another hash", "types", ["message_definitions"], qos={"joints": {"hash": "RIHS01_" + "ab" * 32}}, publish="both", since_start=True, types=(None, "OtherJoints")),
    # QoS.
    Case("reliable asked for, best effort offered", "QoS", ["qos_overrides./glove/taxels.subscription.reliability"], params="    qos_overrides./glove/taxels.subscription.reliability: reliable\n", qos={"taxels": {"reliable": False}}, since_start=True),
    Case("the same of joint angles", "QoS", ["qos_overrides./hand/joint_states.subscription.reliability"], params="    qos_overrides./hand/joint_states.subscription.reliability: reliable\n", qos={"joints": {"reliable": False}}, since_start=True),
    Case("transient local asked for, volatile offered", "QoS", ["subscription.durability"], params="    qos_overrides./glove/taxels.subscription.durability: transient_local\n", since_start=True),
    Case("a deadline asked for, none offered", "QoS", ["subscription.deadline"], params="    qos_overrides./glove/taxels.subscription.deadline: 5000000\n", since_start=True),
    Case("a liveliness lease asked for, none offered", "QoS", ["subscription.liveliness"], params="    qos_overrides./hand/joint_states.subscription.liveliness_lease_duration: 100000000\n", since_start=True),
    Case("a reader of contacts asks for reliable", "QoS", ["publisher.reliability"], act="reliable reader"),
    # Stamps of taxels.
    Case("taxel stamps of 0, from the start", "stamps", ["tactile.glove.stamp"], taxels=stamp(0), since_start=True),
    Case("taxel stamps become 0", "stamps", ["tactile.glove.stamp"], taxels=stamp(0)),
    Case("taxel stamps freeze", "stamps", ["tactile.glove.stamp"], taxels=frozen_stamp),
    Case("taxel stamps run backwards", "stamps", ["stamp"], taxels=falling),
    Case("taxel stamps 2 s old, from the start", "stamps", ["stamp_offset_ms"], taxels=shifted(-2 * S), since_start=True),
    Case("taxel stamps 2 s ahead, from the start", "stamps", ["stamp_offset_ms"], taxels=shifted(2 * S), since_start=True),
    Case("taxel stamps jump 2 s back", "stamps", ["stamp"], taxels=shifted(-2 * S)),
    Case("taxel stamps jump 2 s ahead", "stamps", ["stamp"], taxels=shifted(2 * S)),
    Case("taxel stamps since boot", "stamps", ["stamp"], taxels=boot, since_start=True),
    Case("taxel stamps to and fro by 1 s", "stamps", ["stamp"], taxels=to_and_fro),
    Case("taxel stamps out of order by 30 ms", "stamps", ["stamp"], taxels=shuffled),
    Case("taxel stamps of 100 ms resolution", "stamps", ["stamp"], taxels=coarse),
    Case("taxel stamps before 1970", "stamps", ["stamp"], taxels=stamp(lambda m: m.stamp - 3_000_000_000 * S), since_start=True),
    # Stamps of joint angles.
    Case("joint stamps of 0", "stamps", ["joint.hand.stamp"], joints=stamp(0), since_start=True),
    Case("joint stamps freeze", "stamps", ["joint.hand.stamp"], joints=frozen_stamp),
    Case("joint stamps 2 s old", "stamps", ["joint.hand.stamp"], joints=shifted(-2 * S), since_start=True),
    Case("joint stamps 2 s ahead", "stamps", ["joint.hand.stamp"], joints=shifted(2 * S), since_start=True),
    Case("joint stamps since boot", "stamps", ["joint.hand.stamp"], joints=boot, since_start=True),
    Case("joint stamps run backwards", "stamps", ["stamp"], joints=falling),
    # Both.
    Case("all stamps 2 s old", "stamps", ["stamp"], taxels=shifted(-2 * S), joints=shifted(-2 * S), since_start=True),
    Case("all stamps since boot", "stamps", ["stamp"], taxels=boot, joints=boot, since_start=True),
    Case("all stamps of 0", "stamps", ["stamp"], taxels=stamp(0), joints=stamp(0), since_start=True),
    # Rates.
    Case("taxels at 200 Hz", "rates", ["frame_clock"], rates=(200.0, 100.0), since_start=True),
    Case("taxels at 500 Hz", "rates", ["frame_clock"], rates=(500.0, 100.0), since_start=True),
    Case("taxels at 50 Hz", "rates", ["frame_clock"], rates=(50.0, 100.0), since_start=True),
    Case("taxels become twice as fast", "rates", ["frame_clock"], rates=(200.0, 100.0)),
    Case("taxels 10 at a time", "rates", ["evenly"], taxels=burst(10)),
    Case("half of the taxels lost", "rates", ["lost", "evenly", "Hz"], taxels=lossy(0.5)),
    Case("joint angles at 2 Hz", "rates", ["joint.hand"], rates=(100.0, 2.0)),
    # Lengths.
    Case("5 taxels in place of 6", "lengths", ["n_taxels"], taxels=put(values=lambda m: m.values[:5]), since_start=True),
    Case("12 taxels in place of 6", "lengths", ["n_taxels"], taxels=long, since_start=True),
    Case("no taxels in the message", "lengths", ["without values"], taxels=put(values=[]), since_start=True),
    Case("5 and 6 taxels in turn", "lengths", ["n_taxels"], taxels=alternating),
    Case("rows that don't divide the taxels", "lengths", ["rows"], taxels=put(rows=4), since_start=True),
    Case("fewer angles than names", "lengths", ["joint.hand"], joints=put(positions=lambda m: m.positions[:3])),
    Case("no angles at all", "lengths", ["joint.hand"], joints=put(positions=[], names=[])),
    # Names.
    Case("joints of other names", "names", ["index_dip"], joints=renamed, since_start=True),
    Case("joints renamed midway", "names", ["index_dip"], joints=renamed),
    Case("one joint missing", "names", ["index_dip"], joints=put(names=lambda m: ["x" if name == "index_dip" else name for name in m.names]), since_start=True),
    Case("a joint's name given twice", "names", ["index_dip"], joints=put(names=lambda m: ["index_pip" if name == "index_dip" else name for name in m.names]), since_start=True),
    # Units.
    Case("joint angles in degrees", "units", ["degrees"], joints=scaled("positions", 180 / math.pi), since_start=True),
    Case("joint angles become degrees", "units", ["degrees"], joints=scaled("positions", 180 / math.pi)),
    Case("taxels a thousand times larger", "units", ["calibrate"], taxels=scaled("values", 1000.0)),
    Case("taxels from 0 to 1", "units", ["calibrate"], taxels=scaled("values", 1 / 4095), since_start=True),
    # Values.
    Case("one taxel NaN", "values", ["NON_FINITE"], taxels=one("values", 2, NAN)),
    Case("all taxels NaN", "values", ["NON_FINITE"], taxels=put(values=[NAN] * 6)),
    Case("a taxel infinite now and then", "values", ["NON_FINITE"], taxels=lambda m: one("values", 1, float("inf"))(m) if m.n % 10 == 0 else None),
    Case("one joint angle NaN", "values", ["joint.hand"], joints=put(positions=lambda m: [NAN if name == "index_dip" else angle for name, angle in zip(m.names, m.positions)])),
    Case("all joint angles NaN", "values", ["joint.hand"], joints=put(positions=lambda m: [NAN] * len(m.positions))),
    # Freezes.
    Case("taxels stop", "freezes", ["nothing", "no longer"], taxels=silent),
    Case("joint angles stop", "freezes", ["nothing", "no longer"], joints=silent),
    Case("everything stops", "freezes", ["nothing", "no longer"], taxels=silent, joints=silent),
    Case("the driver repeats its last taxels", "freezes", ["FROZEN"], taxels=held),
    Case("a taxel sticks", "freezes", ["FROZEN", "FAULTY"], taxels=stuck),
    Case("a taxel dies", "freezes", ["FROZEN", "FAULTY"], taxels=one("values", 2, 0.0)),
    # Several, and restarts.
    Case("two drivers on the taxels", "several", ["publish"], act="second taxels"),
    Case("two drivers on the joint angles", "several", ["publish"], act="second joints"),
    Case("another node of the same name", "several", ["publish"], act="second node", seconds=8.0),
    Case("the driver is killed and comes back after 2 s", "restarts", ["nothing"], act="restart driver"),
    # Links.
    Case("a link that stalls for 1 s and then delivers", "links", ["LATE", "evenly", "nothing"], taxels=link(1.0), joints=link(1.0)),
    Case("a link with a delay of 2 s", "links", ["stamp"], taxels=delayed(2.0), joints=delayed(2.0), since_start=True, seconds=8.0),
    # Clocks.
    Case("use_sim_time without /clock", "clocks", ["/clock"], params="    use_sim_time: true\n", since_start=True),
    Case("/clock pauses", "clocks", ["/clock"], params="    use_sim_time: true\n", clock="pauses"),
    Case("/clock is not the time of the stamps", "clocks", ["stamp"], params="    use_sim_time: true\n", clock="other", since_start=True),
]

# What `tests/ros/test` runs: one of each kind.
SHORT = [
    "nothing is wrong", "nobody publishes taxels", "joint angles as another type",
    "reliable asked for, best effort offered", "taxel stamps freeze", "joint stamps 2 s ahead", "taxels at 200 Hz",
    "12 taxels in place of 6", "joints of other names", "joint angles in degrees", "one taxel NaN", "joint angles stop",
]
