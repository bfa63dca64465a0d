"""Drives a real node through the ways in which live inputs go wrong (wrong_cases.py), and tells what the user was told.

wrong_inputs.py run BINARIES [--short] [--only TEXT] [--jobs N] [--out FILE.md] [--keep FOLDER]
Leaves with 1 where somebody was told nothing, or too late, or something that doesn't say where to look. The other form,
`case NAME DOMAIN FOLDER BINARIES`, is one of the processes that it starts. Run it within tests/ros/isolated."""
import argparse
import functools
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

from wrong_cases import CASES, JOINTS, SHORT, TAXELS

S = 1_000_000_000
WITHIN_S = 5.0  # within so long the user is told
READY_S = 25.0  # a node of a debug build on a busy machine
MODEL = os.path.join(os.path.dirname(__file__), "../../models/glove1_pose_aware.onnx")
NODE = "tactile_pose_fusion"
LEVELS = ["OK", "WARN", "ERROR", "STALE"]

PARAMS = """/**:
  ros__parameters:
    regions: [index]
    tactile_sources: [glove]
    joint_sources: [hand]
    tactile.glove: {topic: /glove/taxels, n_taxels: 6}
    joint.hand: {topic: /hand/joint_states}
    model.tip: {path: %s, backend: rten}
    region.index: {model: tip, frame_id: tip, joints: [index_dip, index_pip, index_mcp_flex, index_mcp_abd]}
    calibration.max_force: 1000.0
    calibration.max_loaded_fraction: 1.0
    diagnostics: {max_jitter_ms: 20.0, max_latency_ms: 300.0}  # of a busy machine: what is wrong here is worse
    tactile_timeout_ms: 200.0
    timing.max_age_ms: 500.0
%s"""


def flag_names():
    """The flags of ContactState as its file has them."""
    path = os.path.join(os.path.dirname(__file__), "../../msg/ContactState.msg")
    names = {}
    for line in open(path):
        if line.startswith("uint32 ") and "=" in line:
            name, value = line.split()[1].split("=")
            names[int(value)] = name
    return names


@dataclass
class Message:
    kind: str
    case: str
    n: int
    since: float  # the fault, s
    stamp: int
    values: list = field(default_factory=list)
    names: list = field(default_factory=list)
    positions: list = field(default_factory=list)
    rows: int = 1


def prepare(folder, tpf):
    """A session of a synthetic glove, its calibration and its samples as a list."""
    run = lambda *args: subprocess.run([tpf, *args], cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    run("simulate", "--glove", "1", "--users", "1", "--sessions", "1", "--seed", "3", "--minutes", "1.7", "-o", "sim")
    bag = "sim/glove1_user01_session1/glove1_user01_session1_0.mcap"
    open(f"{folder}/params.yaml", "w").write(PARAMS % (os.path.abspath(MODEL), ""))
    run("calibrate", bag, "--params-file", "params.yaml", "-o", "calibration.yaml")
    import bag as bags
    taxels, joints = [], []
    for topic, _, message in bags.samples(f"{folder}/{bag}", TAXELS, JOINTS):
        if topic == TAXELS:
            taxels.append(list(message.values))
        else:
            names, positions = list(message.name), list(message.position)
            joints.append(positions)
        if len(taxels) >= 1500 and len(joints) >= 1500:
            break
    json.dump({"taxels": taxels, "joints": joints, "names": names}, open(f"{folder}/samples.json", "w"))


class Peers:
    """Publishers of a glove and a hand, and readers of what the node says."""

    def __init__(self, case, domain):
        from cyclonedds.domain import DomainParticipant

        self.case, self.domain = case, domain
        self.of_inputs = DomainParticipant(domain + case.domain)
        self.participant = DomainParticipant(domain)

    def qos(self, key):
        from cyclonedds.core import Policy, Qos
        from cyclonedds.util import duration

        asked = self.case.qos.get(key, {})
        reliable = asked.get("reliable", True)
        policies = [
            Policy.Reliability.Reliable(duration(seconds=1)) if reliable else Policy.Reliability.BestEffort,
            Policy.History.KeepLast(1000),
        ]
        if "hash" in asked:
            policies.append(Policy.Userdata(f"typehash={asked['hash']};".encode()))
        return Qos(*policies)

    def writer(self, key, participant=None):
        from cyclonedds.pub import DataWriter
        from cyclonedds.topic import Topic

        idx = ["taxels", "joints"].index(key)
        of = self.case.types[idx] or ["TaxelArray", "JointState"][idx]
        participant = participant or self.of_inputs
        return DataWriter(participant, Topic(participant, "rt" + self.case.topics[idx], type_of(of)), qos=self.qos(key)), of

    def reader(self, name, ty, reliable=False):
        from cyclonedds.core import Policy, Qos
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration

        reliability = Policy.Reliability.Reliable(duration(seconds=1)) if reliable else Policy.Reliability.BestEffort
        return DataReader(self.participant, Topic(self.participant, "rt" + name, ty), qos=Qos(reliability, Policy.History.KeepLast(5000)))


def type_of(name):
    import messages
    from cyclonedds.idl import IdlStruct
    from cyclonedds.idl.types import sequence

    if name == "Other":  # the name is that of TaxelArray, and the fields are not
        return make_type("tactile_pose_fusion.msg.dds_.TaxelArray_", (("header", messages.Header), ("note", str)))
    if name == "OtherJoints":
        return messages.JointState
    return getattr(messages, name)


@functools.cache
def make_type(typename, fields):
    import types
    from dataclasses import dataclass as plain

    from cyclonedds.idl import IdlStruct

    namespace = {"__annotations__": dict(fields)}
    return plain(types.new_class("Other", (IdlStruct,), {"typename": typename}, lambda ns: ns.update(namespace)))


def wire(m, of):
    import messages

    stamp = messages.Time((m.stamp // S) if -(2**31) <= m.stamp // S < 2**31 else 0, m.stamp % S)
    header = messages.Header(stamp, "")
    if of == "TaxelArray":
        return messages.TaxelArray(header, m.n, m.rows, messages.Duration(0, 0), m.values)
    if of in ("JointState", "OtherJoints"):
        return messages.JointState(header, m.names, m.positions, [], [])
    return type_of(of)(header, "other")


class Feed(threading.Thread):
    """One stream: good until the fault begins."""

    def __init__(self, key, run, writer, of):
        super().__init__(daemon=True)
        self.key, self.run_of, self.writer, self.of, self.stop = key, run, writer, of, False

    def run(self):
        case, run = self.run_of.case, self.run_of
        idx = ["taxels", "joints"].index(self.key)
        change = [case.taxels, case.joints][idx]
        samples, names = run.samples[self.key], run.samples["names"]
        n, start = 0, time.monotonic()
        while not self.stop and not run.over:
            broken = run.broken
            rate = case.rates[idx] if broken else 100.0
            start = max(start, time.monotonic() - 0.05)  # a machine that stood still is no burst of a sensor
            wait = start + 1.0 / rate - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            start += 1.0 / rate
            turn = n % (2 * len(samples) - 2)
            sample = samples[turn if turn < len(samples) else 2 * len(samples) - 2 - turn]
            since = time.monotonic() - run.broken_at if broken else -1.0
            m = Message(self.key, case.name, n, since, run.stamp())
            if self.key == "taxels":
                m.values = list(sample)
            else:
                m.names, m.positions = list(names), list(sample)
            n += 1
            out = change(m) if change and broken else None
            for due in [m] if out is None else out:
                try:
                    self.writer.write(wire(due, self.of))
                except Exception as error:  # the writer was deleted: a driver that ends
                    if not self.stop:
                        run.problems.append(repr(error))
                    return


class Run:
    """A case from its start to what was told."""

    def __init__(self, case, domain, folder, tpf):
        self.case, self.domain, self.folder, self.tpf = case, domain, folder, tpf
        self.samples = json.load(open(f"{folder}/samples.json"))
        self.broken, self.broken_at, self.over, self.problems = case.since_start, time.monotonic(), False, []
        self.clock_at, self.feeds = None, []

    def stamp(self):
        if self.case.clock == "pauses":
            return self.sim_time()
        return time.time_ns()

    def sim_time(self):
        """As /clock has it."""
        if self.case.clock == "other":
            return 1_000 * S + int((time.monotonic() - self.started) * S)
        if self.broken:
            self.clock_at = self.clock_at or time.time_ns()
            return self.clock_at
        return time.time_ns()

    def clock(self):
        import messages
        from cyclonedds.pub import DataWriter
        from cyclonedds.topic import Topic

        writer = DataWriter(self.peers.of_inputs, Topic(self.peers.of_inputs, "rt/clock", messages.Clock), qos=self.peers.qos("clock"))
        while not self.over:
            now = self.sim_time()
            writer.write(messages.Clock(messages.Time(now // S, now % S)))
            time.sleep(0.01)

    def start_node(self, log):
        args = ["run", "--params-file", self.params]
        if self.case.calibrated:
            args += ["--calibration", f"{self.folder}/calibration.yaml"]
        prefix = os.path.abspath(os.path.join(os.path.dirname(sys.executable), ".."))
        environment = {**os.environ, "ROS_DOMAIN_ID": str(self.domain), "AMENT_PREFIX_PATH": prefix}
        return subprocess.Popen([self.tpf, *args], cwd=self.folder, stdout=subprocess.DEVNULL, stderr=log, env=environment)

    def start_feeds(self, keys):
        for key in keys:
            writer, of = self.peers.writer(key)
            feed = Feed(key, self, writer, of)
            feed.start()
            self.feeds.append(feed)

    def act(self):
        """What happens to processes when the fault begins."""
        act, keys = self.case.act, {"both": ["taxels", "joints"], "none": []}.get(self.case.publish, [self.case.publish])
        if act == "reliable reader":
            import messages
            self.kept = self.peers.reader(f"/{NODE}/contacts", messages.ContactArray, reliable=True)
        elif act.startswith("second") and act != "second node":
            from cyclonedds.domain import DomainParticipant
            self.kept = DomainParticipant(self.domain)
            writer, of = self.peers.writer(act.split()[1], self.kept)
            feed = Feed(act.split()[1], self, writer, of)
            feed.start()
            self.feeds.append(feed)
        elif act == "second node":
            self.second = self.start_node(subprocess.DEVNULL)
        elif act == "restart driver":
            for feed in self.feeds:
                feed.stop = True
            for feed in self.feeds:
                feed.join()
                feed.writer = None
            self.feeds.clear()
            time.sleep(2.0)
            self.start_feeds(keys)

    def go(self):
        import messages

        case = self.case
        self.started = time.monotonic()
        self.second = None
        self.params = f"{self.folder}/{self.domain}.yaml"
        open(self.params, "w").write(PARAMS % (os.path.abspath(MODEL), case.params))
        log_path = f"{self.folder}/{self.domain}.log"
        log = open(log_path, "w")
        self.peers = Peers(case, self.domain)
        contacts = self.peers.reader(f"/{NODE}/contacts", messages.ContactArray)
        diagnostics = self.peers.reader("/diagnostics", messages.DiagnosticArray)
        if case.clock:
            threading.Thread(target=self.clock, daemon=True).start()
        keys = {"both": ["taxels", "joints"], "none": []}.get(case.publish, [case.publish])
        self.start_feeds(keys)
        node = self.start_node(log)
        heard, said, lines, active_at = [], [], [], None
        n_good, position = 0, 0
        deadline = time.monotonic() + READY_S
        try:
            while True:
                now = time.monotonic()
                for array in contacts.take(1000):
                    if hasattr(array, "contacts") and array.contacts:
                        state = array.contacts[0]
                        heard.append((now, state.flags, math.isfinite(state.force)))
                        n_good = n_good + 1 if state.flags == 0 and math.isfinite(state.force) else 0
                for array in diagnostics.take(1000):
                    if hasattr(array, "status"):
                        said.append((now, [(s.name.split(": ", 1)[-1], s.level, s.message) for s in array.status]))
                with open(log_path) as text:
                    text.seek(position)
                    new = text.readlines()
                    position = text.tell()
                lines += [(now, line.strip()) for line in new]
                if active_at is None and any("[INFO] active" in line for _, line in lines):
                    active_at = now
                    if case.since_start:
                        self.broken_at = now
                        deadline = now + case.seconds
                # Good for a second, diagnostics too, before it goes wrong: what is said then is of the fault.
                calm = said and all(level == 0 for _, level, _ in said[-1][1])
                if not self.broken and n_good > 100 and calm:
                    self.broken_at, self.broken = now, True
                    deadline = now + case.seconds
                    if case.act:
                        threading.Thread(target=self.act, daemon=True).start()
                if node.poll() is not None:
                    self.problems.append(f"the node ended with {node.returncode}")
                    break
                if now > deadline:
                    break
                time.sleep(0.01)
        finally:
            self.over = True
            for process in [node, self.second]:
                if process and process.poll() is None:
                    process.send_signal(signal.SIGINT)
            for process in [node, self.second]:
                if process:
                    try:
                        process.wait(5)
                    except subprocess.TimeoutExpired:
                        process.kill()
                        self.problems.append("the node didn't end within 5 s of SIGINT")
        if not self.broken or (case.since_start and active_at is None):
            tail = [line for _, line in lines][-3:]
            raise SystemExit(f"{case.name}: never got as far as its fault: {tail} {said[-1:]} {len(heard)} contacts")
        print(json.dumps(self.told(heard, said, lines)))

    def told(self, heard, said, lines):
        """What was told since the fault, and after how many seconds."""
        names, since = flag_names(), lambda at: round(at - self.broken_at, 1)
        after = [(at, flags, force) for at, flags, force in heard if at > self.broken_at]
        flagged = [(since(at), flags) for at, flags, _ in after if flags]
        bits = 0
        for _, flags in flagged:
            bits |= flags
        bad = [(since(at), name, level, message) for at, statuses in said if at > self.broken_at for name, level, message in statuses if level > 0]
        last = [(name, level, message) for at, statuses in said[-1:] for name, level, message in statuses]
        words = [(max(0.0, since(at)), line) for at, line in lines if at > self.broken_at - (30.0 if self.case.since_start else 0.0)]
        words = [(at, line) for at, line in words if line.startswith(("[WARN]", "[ERROR]", "tpf:"))]
        own = [(at, line) for at, line in words if "calibration.file" not in line]
        return {
            "contacts": len(after),
            "clean": sum(1 for _, flags, force in after if not flags and force),
            "flags": [name for bit, name in sorted(names.items()) if bits & bit],
            "flags_s": flagged[0][0] if flagged else None,
            "diagnostics": [f"{LEVELS[min(level, 3)]} {name}: {message}" for name, level, message in last if level > 0],
            "diagnostics_s": max(0.0, bad[0][0]) if bad else None,
            "everything": [f"{LEVELS[min(level, 3)]} {name}: {message}" for _, name, level, message in bad],
            "stderr": [line for _, line in (own or words)],
            "stderr_s": (own or words)[0][0] if words else None,
            "problems": self.problems,
        }


def verdict(case, told):
    """Why what was told is not enough; none where it is."""
    wrong = list(told["problems"])
    if case.fine:
        starting = {"WARMUP", "STALE_POSE", "STALE_TACTILE"} if case.since_start else set()
        if told["diagnostics"] or told["stderr"] or set(told["flags"]) - starting:
            wrong.append("something was told although nothing is wrong")
        return wrong
    if told["diagnostics_s"] is None or told["diagnostics_s"] > WITHIN_S:
        wrong.append("diagnostics said OK")
    if told["stderr_s"] is None or told["stderr_s"] > WITHIN_S:
        wrong.append("stderr said nothing")
    everything = " ".join(told["everything"] + told["stderr"] + told["flags"])
    if case.says and not any(word in everything for word in case.says):
        wrong.append(f"nothing names {' or '.join(case.says)}")
    return wrong


def table(results, wrong, command):
    lines = [
        "| | what is wrong | contacts | flags | diagnostics | stderr |", "|---|---|---|---|---|---|",
    ]
    cell = lambda text: text.replace("|", "\\|").replace("\n", " ")
    seconds = lambda at: "" if at is None else f" ({at:.1f} s)"
    for number, (case, told) in enumerate(results, 1):
        failed = "".join(f" **{text}**" for text in wrong.get(case.name, []))
        contacts = f"{told['contacts']}, {told['clean']} good"
        flags = ", ".join(told["flags"]) + seconds(told["flags_s"]) if told["flags"] else "none"
        diagnostics = told["diagnostics"] or told["everything"][:2]
        diagnostics = "; ".join(diagnostics[:2]) + seconds(told["diagnostics_s"]) if diagnostics else "OK"
        stderr = told["stderr"][0] + seconds(told["stderr_s"]) if told["stderr"] else "nothing"
        lines.append(f"| {number} | {cell(case.group)}: {cell(case.name)}{cell(failed)} | {contacts} | {flags} | {cell(diagnostics)} | {cell(stderr)} |")
    return "\n".join(lines) + "\n"


def run(args):
    assert os.environ.get("TPF_ISOLATED") == "1", "a node must not reach the network: run this within tests/ros/isolated"
    cases = [case for case in CASES if (not args.short or case.name in SHORT) and (args.only is None or args.only in case.name)]
    tpf = os.path.abspath(os.path.join(args.binaries, "tpf"))
    with tempfile.TemporaryDirectory() as folder:
        folder = args.keep or folder
        os.makedirs(folder, exist_ok=True)
        prepare(folder, tpf)

        def one(number):
            case = cases[number]
            command = [sys.executable, __file__, "case", case.name, str(1 + number), folder, tpf]
            ran = subprocess.run(command, capture_output=True, text=True, timeout=120)
            if ran.returncode:
                return case, None, (ran.stderr or ran.stdout).strip().splitlines()[-1:]
            return case, json.loads(ran.stdout.strip().splitlines()[-1]), []

        with ThreadPoolExecutor(args.jobs) as pool:
            done = list(pool.map(one, range(len(cases))))
    wrong = {}
    for case, told, failed in done:
        why = failed or verdict(case, told)
        if why:
            wrong[case.name] = why
            print(f"{case.name}: {'; '.join(why)}\n    {json.dumps(told)[:1500]}")
    results = [(case, told) for case, told, _ in done if told]
    if args.out:
        with open(args.out, "w") as out:
            out.write(table(results, wrong, sys.argv))
    print(f"{len(done) - len(wrong)} of {len(done)} ways in which inputs go wrong were told within {WITHIN_S:.0f} s")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    if sys.argv[1] == "case":
        name, domain, folder, tpf = sys.argv[2:6]
        case = next(case for case in CASES if case.name == name)
        Run(case, int(domain), folder, tpf).go()
    else:
        parser = argparse.ArgumentParser(description=__doc__)
        parser.add_argument("form", choices=["run"])
        parser.add_argument("binaries")
        parser.add_argument("--short", action="store_true")
        parser.add_argument("--only")
        parser.add_argument("--jobs", type=int, default=3)
        parser.add_argument("--out")
        parser.add_argument("--keep")
        run(parser.parse_args())
