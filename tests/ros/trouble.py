"""What soak.py does to a node and its link on purpose, and what must hold all the same."""
import signal
import time

LATE = 128  # of ContactState.flags
LIMIT_MS = 100.0  # the default of timing.max_age_ms
TOLERANCE_MS = 20.0  # between the age that the node knew and the message on its way, on a busy machine
GO_ON_S = 2.0
STOP_EVERY_S, STALL_EVERY_S, STALL_AT_S, STALL_S = 30.0, 60.0, 45.0, 1.5
STOPS_S = [0.05, 1.0, 10.0, 0.2, 5.0]
# Once in ten stops nearly as long as it may be: after 40 s the node leaves with an error, because peers forget it.
LONG_STOP_S, LONG_AT = 35.0, 9


class Link:
    """Between a feeder and the node: what is sent while it stalls arrives at once when it goes on."""

    def __init__(self, stalls):
        self.stalls, self.start, self.held, self.n_stalls = stalls, time.monotonic(), [], 0

    def send(self, writer, message):
        at = (time.monotonic() - self.start) % STALL_EVERY_S
        if self.stalls and STALL_AT_S <= at < STALL_AT_S + STALL_S:
            self.n_stalls += not self.held
            self.held.append((writer, message))
            return
        for one, old in self.held:
            one.write(old)
        self.held = []
        writer.write(message)


class Stops:
    """Stops a process every half minute, each time for another while."""

    def __init__(self, process):
        self.process, self.done, self.next_s = process, [], STOP_EVERY_S

    def step(self, at_s, end_s):
        if at_s < self.next_s or self.process.poll() is not None:
            return
        n = len(self.done)
        length = LONG_STOP_S if n % 10 == LONG_AT else STOPS_S[n % len(STOPS_S)]
        self.next_s = at_s + max(STOP_EVERY_S, length + 15.0)
        if at_s + length + 2 * GO_ON_S > end_s:
            return
        begin = time.time()
        self.process.send_signal(signal.SIGSTOP)
        time.sleep(length)
        self.process.send_signal(signal.SIGCONT)
        self.done.append((begin, time.time()))


def judge(path, stops, n_regions):
    """What does not hold of the contacts that a listener wrote down, a line each."""
    rows = [tuple(int(part) for part in line.split()) for line in open(path) if line.count(" ") == 4 and line.endswith("\n")]
    found = []
    old = [(published - stamp) / 1e6 for stamp, _, _, published, n_fresh in rows
           if n_fresh and (published - stamp) / 1e6 > LIMIT_MS + TOLERANCE_MS]
    if old:
        found.append(f"{len(old)} of {len(rows)} arrays held an estimate without LATE that was up to {max(old):.0f} ms old")
    if not any(n_estimates > n_fresh for _, _, n_estimates, _, n_fresh in rows):
        found.append("nothing was ever flagged LATE, though the link stalled")
    back = sum(b[0] < a[0] for a, b in zip(rows, rows[1:]))
    if back:
        found.append(f"stamps ran backwards {back} times")
    for begin, end in stops:
        fresh = [row[3] / 1e9 for row in rows if row[4] == n_regions and row[0] / 1e9 > end]
        if not fresh or fresh[0] - end > GO_ON_S:
            took = f"after {fresh[0] - end:.1f} s" if fresh else "never"
            found.append(f"after a stop of {end - begin:.2f} s contacts went on {took}, within {GO_ON_S:g} s they should")
    if not stops:
        found.append("the node was never stopped: run it for longer")
    return found
