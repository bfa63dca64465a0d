"""The live node for a long time: 1 kHz taxels, five regions, and peers that come, hang, are killed and go. `just soak`
runs it; it writes summary.md and summary.json, and leaves with 1 where memory grew, frames were lost or latency drifted.
With --trouble (`just trouble`) the node is stopped every 30 s and its link stalls every minute; it leaves with 1 where an
estimate was published that is older than it may be and isn't flagged LATE, or where contacts didn't go on (trouble.py).

soak.py run BINARIES MODEL [--minutes M] [--rate HZ] [--clock tactile|grid] [--backend B] [--reliable] [--trouble] [--out DIR]
The other forms are the processes that it starts: feed RATE SECONDS RELIABLE STALLS OUT, listen SECONDS OUT, peer."""
import argparse
import glob
import json
import math
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time

import trouble

N_REGIONS, N_TAXELS = 5, 6
JOINTS = ["index_dip", "index_pip", "index_mcp_flex", "index_mcp_abd"]
CONTACTS = "rt/tactile_pose_fusion/contacts"
SAMPLE_EVERY_S, PEER_EVERY_S, MAX_PEERS, MAX_MINUTES = 5.0, 7.0, 4, 24 * 60
MAX_LATE_S = 0.02  # what a feeder makes up for
# What a run may do and still be steady. A peer that was killed is remembered for its lease, and the allocator keeps what
# it had: the same 200 restarts that `node_faults` allows 10 MB. Half a run must stay below half of that.
MAX_GROWTH_MB, MAX_MORE_THREADS, MAX_MORE_FDS = 5.0, 2, 16
MAX_DRIFT, MAX_DRIFT_MS = 1.5, 0.5  # of the median between the first and the last quarter: both must be passed


def qos(depth, reliable=False):
    from cyclonedds.core import Policy, Qos
    from cyclonedds.util import duration
    reliability = Policy.Reliability.Reliable(duration(seconds=1)) if reliable else Policy.Reliability.BestEffort
    return Qos(reliability, Policy.History.KeepLast(depth))


def now_as(kind):
    now = time.time_ns()
    return kind(now // 10**9, now % 10**9)


def feed(rate, seconds, reliable, stalls, out):
    """Publishes taxels and joints, and writes the stamp of each; prints how many."""
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.topic import Topic

    import messages

    participant = DomainParticipant(0)
    taxels = DataWriter(participant, Topic(participant, "rt/taxels", messages.TaxelArray), qos=qos(1000, reliable))
    joints = DataWriter(participant, Topic(participant, "rt/joints", messages.JointState), qos=qos(1000, reliable))
    while not (taxels.get_matched_subscriptions() and joints.get_matched_subscriptions()):
        time.sleep(0.01)
    link = trouble.Link(stalls)
    start, n, late_ms, stamps = time.monotonic(), 0, 0.0, []
    end = start + seconds
    while (due := start + n / rate) < end:
        wait = due - time.monotonic()
        if wait > 0:
            time.sleep(wait)
        late_ms = max(late_ms, -wait * 1e3)
        if -wait > MAX_LATE_S:
            start -= wait  # a machine that stood still is no burst of a sensor
        header = messages.Header(now_as(messages.Time), "")
        bend = 0.5 + 0.5 * math.sin(n * 2.0 / rate)
        link.send(joints, messages.JointState(header, JOINTS, [bend] * len(JOINTS), [], []))
        values = [10.0 + (n * 7 + k) % 3 for k in range(N_REGIONS * N_TAXELS)]
        link.send(taxels, messages.TaxelArray(header, n, 1, messages.Duration(0, 0), values))
        stamps.append(messages.nanos(header.stamp))
        n += 1
    time.sleep(1.0)
    open(out, "w").write("\n".join(map(str, stamps)))
    print(json.dumps({"sent": n, "latest_ms": round(late_ms, 1), "stalls": link.n_stalls}))


def listen(seconds, out):
    """Receives contacts and writes a line each: stamp, latency, regions with an estimate, when the node published it, and
    how many of those estimates are not flagged LATE."""
    from cyclonedds.core import ReadCondition, SampleState, ViewState, InstanceState, WaitSet
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    import messages

    participant = DomainParticipant(0)
    reader = DataReader(participant, Topic(participant, CONTACTS, messages.ContactArray), qos=qos(5000))
    unread = ReadCondition(reader, SampleState.NotRead | ViewState.Any | InstanceState.Alive)
    waiting = WaitSet(participant)
    waiting.attach(unread)
    end = time.monotonic() + seconds
    with open(out, "w") as lines:
        while time.monotonic() < end:
            waiting.wait(duration(milliseconds=100))
            for array in reader.take(1000):
                if not hasattr(array, "contacts"):
                    continue  # a sample that only says that its writer is gone
                stamp = messages.nanos(array.header.stamp)
                estimates = [state for state in array.contacts if state.force == state.force]
                n_fresh = sum(not state.flags & trouble.LATE for state in estimates)
                published = array.sample_info.source_timestamp
                lines.write(f"{stamp} {(time.time_ns() - stamp) // 1000} {len(estimates)} {published} {n_fresh}\n")


def peer():
    """A reader of contacts and a writer of joints nobody listens for, until it is stopped."""
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

    import messages

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    participant = DomainParticipant(0)
    reader = DataReader(participant, Topic(participant, CONTACTS, messages.ContactArray), qos=qos(10))
    writer = DataWriter(participant, Topic(participant, "rt/other_joints", messages.JointState), qos=qos(10))
    while True:
        reader.take(100)
        time.sleep(0.01)


class Peers:
    """Those that come and go, one event every few seconds, in an order that a seed gives."""

    def __init__(self, env):
        self.env, self.random, self.alive, self.stopped = env, random.Random(1), [], []
        self.counts = {"came": 0, "left": 0, "killed": 0, "hung": 0}

    def step(self):
        for hung in self.stopped:
            hung.kill()
            hung.wait()
        self.stopped = []
        if len(self.alive) < MAX_PEERS:
            self.alive.append(subprocess.Popen([sys.executable, __file__, "peer"], env=self.env))
            self.counts["came"] += 1
        if len(self.alive) < 2:
            return
        leaving = self.alive.pop(0)
        how = self.random.choice(["left", "killed", "hung"])
        self.counts[how] += 1
        if how == "left":
            leaving.terminate()
            leaving.wait()
        elif how == "killed":
            leaving.kill()
            leaving.wait()
        else:
            leaving.send_signal(signal.SIGSTOP)
            self.stopped.append(leaving)

    def end(self):
        for process in self.alive + self.stopped:
            process.kill()
            process.wait()


class Diagnostics:
    """The last values that the node told of itself."""

    def __init__(self):
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray

        rclpy.init()
        self.rclpy, self.values, self.n = rclpy, {}, 0
        self.node = rclpy.create_node("soak")
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self.handle, 10)

    def handle(self, array):
        self.n += 1
        for status in array.status:
            part = status.name.split(": ", 1)[-1]
            self.values.update({f"{part}/{pair.key}": pair.value for pair in status.values})

    def spin(self, until):
        while (left := until - time.monotonic()) > 0:
            self.rclpy.spin_once(self.node, timeout_sec=min(left, 0.2))

    def number(self, name):
        value = self.values.get(name)
        return float(value) if value not in (None, "unknown") else None


def sample(pid, start):
    """What the system says of a process."""
    status = dict(line.split(":", 1) for line in open(f"/proc/{pid}/status") if ":" in line)
    times = open(f"/proc/{pid}/stat").read().rsplit(")", 1)[1].split()
    cpu_s = (int(times[11]) + int(times[12])) / os.sysconf("SC_CLK_TCK")
    return {"at_s": round(time.monotonic() - start, 1), "rss_mb": int(status["VmRSS"].split()[0]) / 1024,
            "threads": int(status["Threads"]), "fds": len(os.listdir(f"/proc/{pid}/fd")), "cpu_s": cpu_s}


def slope(points):
    """Of the line through points, by least squares; 0 for fewer than two."""
    if len(points) < 2:
        return 0.0
    x, y = (statistics.mean(point[axis] for point in points) for axis in (0, 1))
    spread = sum((point[0] - x) ** 2 for point in points)
    return sum((point[0] - x) * (point[1] - y) for point in points) / spread if spread else 0.0


def setup(folder, model, clock, backend, reliable):
    regions = [f"r{k}" for k in range(1, N_REGIONS + 1)]
    n = N_REGIONS * N_TAXELS
    lines = [
        "/**:", "  ros__parameters:", f"    regions: [{', '.join(regions)}]", "    tactile_sources: [glove]",
        "    joint_sources: [hand]", f"    tactile.glove: {{topic: /taxels, n_taxels: {n}, frame_clock: {clock}}}",
        "    joint.hand: {topic: /joints}", f"    model.tip: {{path: {model}, backend: {backend}}}",
    ]
    if reliable:
        lines.append("    qos_overrides:")
        lines += [f"      {topic}: {{subscription: {{reliability: reliable, depth: 1000}}}}" for topic in ("/taxels", "/joints")]
    for k, region in enumerate(regions):
        taxels = list(range(k * N_TAXELS, (k + 1) * N_TAXELS))
        lines.append(f"    region.{region}: {{model: tip, taxels: {taxels}, joints: [{', '.join(JOINTS)}], frame_id: {region}}}")
    open(f"{folder}/soak.yaml", "w").write("\n".join(lines) + "\n")
    open(f"{folder}/calibration.yaml", "w").write(
        "format: tactile_pose_fusion/calibration/1\nglove: ''\nuser: ''\nmodels: {}\nrecorded: none\nsources:\n  glove:\n"
        f"    median: {[11.0] * n}\n    noise: {[1.0] * n}\n    faulty: [{', '.join(['false'] * n)}]\n")


def quantile(values, share):
    values = sorted(values)
    return values[max(0, math.ceil(share * len(values)) - 1)]


def of_minutes(path, sent):
    """Latency by minute of what a listener wrote, and how many frames are missing between its first and its last: of those
    stamps, or of steps of 10 ms where there are none."""
    rows = [tuple(int(part) for part in line.split()) for line in open(path) if line.count(" ") == 4 and line.endswith("\n")]
    rows = [row for row in rows if row[2] == N_REGIONS]
    if not rows:
        return [], 0, 0
    minutes = {}
    for stamp, latency_us, *_ in rows:
        minutes.setdefault((stamp - rows[0][0]) // 60_000_000_000, []).append(latency_us / 1000)
    table = [{"minute": int(minute), "n": len(ms), "p50_ms": quantile(ms, 0.5), "p99_ms": quantile(ms, 0.99), "max_ms": max(ms)}
             for minute, ms in sorted(minutes.items())]
    received = {row[0] for row in rows}
    expected = sum(rows[0][0] <= stamp <= rows[-1][0] for stamp in sent) if sent else round((rows[-1][0] - rows[0][0]) / 1e7) + 1
    return table, len(rows), expected - len(received)


def verdict(samples, table, diagnostics, running, troubled):
    """Everything that is not as it should be, a line each. What is `troubled` may lose frames and be late, and say so."""
    found = [] if running else ["the node ended before it was told to"]
    half = [(s["at_s"] / 60, s["rss_mb"]) for s in samples[len(samples) // 2:]]
    growth_mb = slope(half) * (half[-1][0] - half[0][0]) if half else 0.0
    if growth_mb > MAX_GROWTH_MB:
        found.append(f"memory grew by {growth_mb:.1f} MB over the second half, {MAX_GROWTH_MB} MB may be")
    quarter = max(1, len(samples) // 4)
    for what, limit in (("threads", MAX_MORE_THREADS), ("fds", MAX_MORE_FDS)):
        more = max(s[what] for s in samples[-quarter:]) - max(s[what] for s in samples[:quarter])
        if more > limit:
            found.append(f"{more} more {what} at the end than at the begin, {limit} may be")
    for name, value in diagnostics.items():
        if value is None:
            found.append(f"the node never told {name}")
        elif value > 0 and not troubled:
            found.append(f"{name} is {value:.0f}, not 0")
    if not table:
        return found + ["no contacts with an estimate of every region were received"], growth_mb
    quarter = max(1, len(table) // 4)
    first, last = (statistics.median(row["p50_ms"] for row in rows) for rows in (table[:quarter], table[-quarter:]))
    if not troubled and last > MAX_DRIFT * first and last - first > MAX_DRIFT_MS:
        found.append(f"median latency drifted from {first:.2f} to {last:.2f} ms")
    return found, growth_mb


def run():
    parser = argparse.ArgumentParser()
    parser.add_argument("run")
    parser.add_argument("binaries")
    parser.add_argument("model")
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--clock", choices=["tactile", "grid"], default="tactile")
    parser.add_argument("--backend", choices=["auto", "builtin", "onnxruntime", "rten"], default="auto")
    parser.add_argument("--reliable", action="store_true", help="inputs that wait for a node that is late")
    parser.add_argument("--trouble", action="store_true", help="stop the node every 30 s, stall its link every minute")
    parser.add_argument("--out", default="target/soak")
    args = parser.parse_args()
    if not 0.0 < args.minutes <= MAX_MINUTES:
        sys.exit(f"--minutes: expected more than 0 and at most {MAX_MINUTES}, got {args.minutes}")
    assert os.environ.get("TPF_ISOLATED") == "1", "run it by tests/ros/isolated"
    seconds = args.minutes * 60
    os.makedirs(args.out, exist_ok=True)
    scratch = tempfile.TemporaryDirectory()
    folder = scratch.name
    library = glob.glob(f"{sys.prefix}/lib/python*/site-packages/onnxruntime/capi/libonnxruntime.so.*")
    env = dict(os.environ, AMENT_PREFIX_PATH=sys.prefix, ROS_LOG_DIR=folder)
    env.setdefault("ORT_DYLIB_PATH", library[0] if library else "")
    setup(folder, os.path.abspath(args.model), args.clock, args.backend, args.reliable)
    this = [sys.executable, os.path.abspath(__file__)]
    log = open(f"{args.out}/node.log", "w")
    command = [f"{os.path.abspath(args.binaries)}/tpf", "run", "--params-file", f"{folder}/soak.yaml", "--calibration",
               f"{folder}/calibration.yaml"]
    node = subprocess.Popen(command, env=env, stdout=log, stderr=log)
    others, peers, samples = [], Peers(env), []
    stops = trouble.Stops(node) if args.trouble else None
    try:
        diagnostics = Diagnostics()
        diagnostics.spin(time.monotonic() + 3)
        received, sent_at = f"{folder}/received", f"{folder}/sent"
        others.append(subprocess.Popen([*this, "listen", str(seconds + 5), received], env=env))
        time.sleep(1.5)
        feeder = subprocess.Popen([*this, "feed", str(args.rate), str(seconds), str(int(args.reliable)), str(int(args.trouble)), sent_at], env=env, stdout=subprocess.PIPE, text=True)
        others.append(feeder)
        start = time.monotonic()
        next_peer = start + PEER_EVERY_S
        while time.monotonic() < start + seconds and node.poll() is None:
            diagnostics.spin(min(time.monotonic() + SAMPLE_EVERY_S, start + seconds))
            if stops:
                stops.step(time.monotonic() - start, seconds)
            if node.poll() is None:
                samples.append(sample(node.pid, start))
            if time.monotonic() >= next_peer:
                peers.step()
                next_peer = time.monotonic() + PEER_EVERY_S
        sent = json.loads(feeder.communicate(timeout=30)[0].splitlines()[-1])
        diagnostics.spin(time.monotonic() + 2)
        running = node.poll() is None
        others[0].wait(timeout=30)
    finally:
        peers.end()
        for process in [*others, node]:
            if process.poll() is None:
                process.terminate()
                try:
                    process.wait(5)
                except subprocess.TimeoutExpired:
                    process.kill()
        log.close()
    stamps = [int(line) for line in open(sent_at)] if args.clock == "tactile" else []
    table, n_received, n_missing = of_minutes(received, stamps)
    lost = {f"{place}": diagnostics.number(place) for place in
            ("estimates/tactile.glove.lost_messages", "latency/dropped.queue_full", "latency/dropped.not_sent")}
    failures, growth_mb = verdict(samples, table, lost, running, args.trouble)
    if stops:
        failures += trouble.judge(received, stops.done, N_REGIONS)
    summary = {
        "synthetic": True, "minutes": args.minutes, "rate_hz": args.rate, "regions": N_REGIONS, "clock": args.clock,
        "backend": diagnostics.values.get("estimates/model.tip"), "load_average": os.getloadavg(), "feeder": sent,
        "received": n_received, "missing_at_the_listener": n_missing, "lost_by_the_node": lost, "peers": peers.counts,
        "stops_s": [round(end - begin, 2) for begin, end in stops.done] if stops else [],
        "growth_second_half_mb": round(growth_mb, 2), "failures": failures, "minutes_table": table, "samples": samples,
    }
    json.dump(summary, open(f"{args.out}/summary.json", "w"), indent=1)
    text = markdown(summary)
    open(f"{args.out}/summary.md", "w").write(text)
    print(text)
    sys.exit(1 if failures else 0)


def markdown(s):
    first, last = s["samples"][0], s["samples"][-1]
    rss = [sample["rss_mb"] for sample in s["samples"]]
    busy = (last["cpu_s"] - first["cpu_s"]) / max(last["at_s"] - first["at_s"], 1e-9)
    lines = [
        f"# Soak of the live node, {s['minutes']:g} minutes", "",
        f"Made-up taxels and joints at {s['rate_hz']:g} Hz, {s['regions']} regions, frame clock `{s['clock']}`, model in "
        f"{s['backend']}; load average at the end {s['load_average'][0]:.1f}. Peers: " +
        ", ".join(f"{n} {what}" for what, n in s["peers"].items()) + ".", "",
        "| what | first | last | least | most |", "|---|---|---|---|---|",
        f"| memory, MB | {rss[0]:.1f} | {rss[-1]:.1f} | {min(rss):.1f} | {max(rss):.1f} |",
    ]
    for what in ("threads", "fds"):
        values = [sample[what] for sample in s["samples"]]
        lines.append(f"| {what} | {values[0]} | {values[-1]} | {min(values)} | {max(values)} |")
    lines += ["", f"Memory over the second half: {s['growth_second_half_mb']:+.2f} MB. Processor: {100 * busy:.0f} % of a core.", "",
              f"Sent {s['feeder']['sent']} (the feeder was at most {s['feeder']['latest_ms']} ms late), received "
              f"{s['received']} with an estimate of every region; {s['missing_at_the_listener']} missing in between, of which "
              "the node lost: " + ", ".join(f"{name} {value}" for name, value in s["lost_by_the_node"].items()) + ".", "",
              "| minute | received | p50 ms | p99 ms | max ms |", "|---|---|---|---|---|"]
    lines += [f"| {row['minute']} | {row['n']} | {row['p50_ms']:.2f} | {row['p99_ms']:.2f} | {row['max_ms']:.2f} |"
              for row in s["minutes_table"]]
    if s["stops_s"]:
        lines += ["", f"The node was stopped {len(s['stops_s'])} times, for {min(s['stops_s']):g} to {max(s['stops_s']):g} s, and its "
                  f"link stalled {s['feeder']['stalls']} times for {trouble.STALL_S:g} s. Held against it: no estimate older than "
                  f"{trouble.LIMIT_MS:g} ms when it was published without LATE, no stamp before one that was published, estimates "
                  f"that are not late within {trouble.GO_ON_S:g} s after every stop."]
    lines += ["", "Latency is from the stamp of the data to its contacts in the hands of another process, in Python.", ""]
    lines += ["Not steady:" if s["failures"] else "Steady: " + ("nothing grew, and nothing old was said to be new." if s["stops_s"] else "nothing grew, drifted or was lost."), *[f"- {f}" for f in s["failures"]]]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    what, rest = (sys.argv[1], sys.argv[2:]) if len(sys.argv) > 1 else ("", [])
    if what == "feed":
        feed(float(rest[0]), float(rest[1]), rest[2] == "1", rest[3] == "1", rest[4])
    elif what == "listen":
        listen(float(rest[0]), rest[1])
    elif what == "peer":
        peer()
    elif what == "run":
        run()
    else:
        sys.exit(__doc__)
