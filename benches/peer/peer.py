"""What `tpf replay` does, written with mcap-ros2-support, numpy and onnxruntime: the yardstick of docs/validation.

peer.py BAG MODEL OUT.mcap [BATCH]: a session of a synthetic glove, zeroed on its annotated stretches. Prints JSON: seconds
a stage, frames, estimates. Everything but the messages themselves is vectorized; the rules are those of README.md and
params/example.yaml, their defaults included."""
import json
import os
import sys
import time

import numpy as np
import onnxruntime
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer

import definitions

TAXELS, JOINT_STATES, STAGE = "/glove/taxels", "/hand/joint_states", "/stage"
MAX_GAP_NS, JOINT_SLACK_NS, MAX_POSE_AGE_NS = 50_000_000, 10_000_000, 50_000_000
FORCE_ON, FORCE_OFF, ON_FRAMES, OFF_FRAMES = 0.024516625, 0.014709975, 2, 3
MAX_BASELINE_ROWS = 1 << 15
NEWTON_OF_GF = 9.80665e-3
WARMUP, STALE_POSE, POSE_OUT_OF_RANGE = 1, 4, 16
NODE, REGION, FRAME_ID = "/tactile_pose_fusion", "index", "index_tip"


def nanos(stamp):
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def read(path, joints):
    """Of taxels and of joints: stamps, readings and places among all messages; and which readings are of zero load."""
    tactile_ns, received_ns, tactile, tactile_at, at_rest, pose_ns, pose, pose_at = [], [], [], [], [], [], [], []
    annotation = None
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        messages = reader.iter_decoded_messages(topics=[TAXELS, JOINT_STATES, STAGE], log_time_order=False)
        for at, (_, channel, message, decoded) in enumerate(messages):
            if channel.topic == TAXELS:
                stamp = nanos(decoded.header.stamp)
                tactile_ns.append(stamp)
                received_ns.append(message.log_time)
                tactile.append(decoded.values)
                tactile_at.append(at)
                at_rest.append(annotation is not None and annotation[1] and stamp >= annotation[0])
            elif channel.topic == JOINT_STATES:
                order = dict(zip(decoded.name, decoded.position))
                pose_ns.append(nanos(decoded.header.stamp))
                pose.append([order[name] for name in joints])
                pose_at.append(at)
            else:
                annotation = (nanos(decoded.header.stamp), decoded.zero_load)
    return (np.array(tactile_ns), np.array(received_ns), np.array(tactile, np.float32), np.array(tactile_at),
            np.array(at_rest), np.array(pose_ns), np.array(pose, np.float64), np.array(pose_at))


def in_order(stamps):
    """Which samples are neither late nor there twice."""
    newest = np.maximum.accumulate(stamps)
    return np.concatenate([[True], stamps[1:] > newest[:-1]])


def median(rows):
    """The median of each taxel, of every so manieth row where there are very many."""
    stride = 1
    while -(-len(rows) // stride) > MAX_BASELINE_ROWS:
        stride *= 2
    return np.median(rows[::stride].astype(np.float64), axis=0).astype(np.float32)


def frame_numbers(stamps, period_ns):
    """The number of each frame in its epoch, missing ones left out, and the epoch: what follows a gap is a new one."""
    numbers, epochs = np.zeros(len(stamps), np.int64), np.zeros(len(stamps), np.int64)
    number, epoch, nominal, last = 0, 0, None, None
    for idx, stamp in enumerate(stamps.tolist()):
        missing = 0
        if last is not None and stamp - last > MAX_GAP_NS:
            epoch, nominal = epoch + 1, None
        if nominal is None:
            nominal = stamp
        else:
            expected = nominal + period_ns
            missing = round((stamp - expected) / period_ns) if stamp - expected > 0.75 * period_ns else 0
            expected += missing * period_ns
            nominal = expected + (stamp - expected) / 10
        number += 1 + missing
        numbers[idx], epochs[idx], last = number, epoch, stamp
    return numbers, epochs


def poses_at(stamps, pose_ns, pose, n_known):
    """Angles at stamps: interpolated, or held where the later state is too far or came too late; their ages, and whether
    they are fresh. `n_known`: how many states were there when the frame could wait no longer."""
    after = np.searchsorted(pose_ns, stamps, side="right")
    before = np.minimum(after, n_known) - 1
    later = np.minimum(after, len(pose_ns) - 1)
    known, before = before >= 0, np.maximum(before, 0)
    age, span = stamps - pose_ns[before], pose_ns[later] - pose_ns[before]
    between = ((after < n_known) & known & (pose_ns[later] - stamps <= JOINT_SLACK_NS) & (span <= MAX_POSE_AGE_NS) & (age > 0))
    part = np.where(between, age / np.maximum(span, 1), 0.0)[:, None]
    angles = pose[before] + (pose[later] - pose[before]) * part
    age = np.where(between, 0, age)
    return angles.astype(np.float32), np.where(known, age, np.nan), known & (age <= MAX_POSE_AGE_NS)


def states_in_time(stamps, places, pose_places):
    """How many joint states came before the first frame that is a slack later, which ends the waiting of a frame."""
    over = np.searchsorted(stamps, stamps + JOINT_SLACK_NS)
    ends = np.append(places, np.iinfo(np.int64).max)[over]
    return np.searchsorted(pose_places, ends)


def rows(stamps, features, numbers, epochs, pose_ns, pose, n_known):
    """Model frames with the missing ones filled in: taxels, angles, freshness, stretch, and the place of each real frame."""
    steps = np.diff(numbers, prepend=numbers[0] - 1)
    steps[np.flatnonzero(np.diff(epochs, prepend=epochs[0]))] = 1
    places = np.cumsum(steps) - 1
    n = places[-1] + 1
    real = np.zeros(n, bool)
    real[places] = True
    owner = np.searchsorted(places, np.arange(n))  # the real frame at or after each
    part = np.where(real, 1.0, 1 - (places[owner] - np.arange(n)) / steps[owner])
    earlier = np.where(real, owner, owner - 1)
    filled = features[earlier].astype(np.float64) + (features[owner].astype(np.float64) - features[earlier]) * part[:, None]
    at = stamps[earlier] + np.where(real, 0, (stamps[owner] - stamps[earlier]) * part).astype(np.int64)
    tactile = np.where(real[:, None], features[owner], filled.astype(np.float32))
    angles, age, fresh = poses_at(at, pose_ns, pose, n_known[owner])
    return tactile, angles, fresh, epochs[owner], places, age[places]


def windows_of(values, window, ends, batch):
    """Batches of windows that end at `ends`, contiguous in memory."""
    view = np.lib.stride_tricks.sliding_window_view(values, window, axis=0).transpose(0, 2, 1)
    for first in range(0, len(ends), batch):
        yield np.ascontiguousarray(view[ends[first:first + batch] - window + 1])


def infer(session, tactile, angles, ends, window, batch):
    """Force and base force of the windows that end at `ends`, in the model's unit."""
    forces, bases = [], []
    for taxels, pose in zip(windows_of(tactile, window, ends, batch), windows_of(angles, window, ends, batch)):
        force, base = session.run(["force", "force_base"], {"tactile": taxels, "pose": pose})
        forces.append(force.reshape(-1))
        bases.append(base.reshape(-1))
    return np.concatenate(forces), np.concatenate(bases)


def contacts(forces, epochs):
    """Contact with hysteresis and debounce: state, event and the frame since when, a frame. A gap ends it."""
    state, run, run_start, since, out = False, 0, 0, None, []
    for idx, force in enumerate(forces):
        event = 0
        if idx and epochs[idx] != epochs[idx - 1]:
            if state:
                state, since, event = False, idx, 2
            run = 0
        if force == force:
            opposes, needed = (force < FORCE_OFF, OFF_FRAMES) if state else (force >= FORCE_ON, ON_FRAMES)
            if opposes:
                run_start = idx if run == 0 else run_start
                run += 1
            else:
                run = 0
            if run >= needed:
                state, since, run = not state, run_start, 0
                event = 1 if state else 2
        since = idx if since is None else since
        out.append((state, event, since))
    return out


def write(path, stamps, received, epochs, force, base, flags, age, mdf):
    """A wrench where there is a force, and contacts at every frame."""
    time_of = [{"sec": stamp // 1_000_000_000, "nanosec": stamp % 1_000_000_000} for stamp in stamps.tolist()]
    nan = float("nan")
    with open(path, "wb") as file:
        writer = Writer(file)
        wrench_schema = writer.register_msgdef("geometry_msgs/msg/WrenchStamped", definitions.WRENCH_STAMPED)
        contact_schema = writer.register_msgdef("tactile_pose_fusion/msg/ContactArray", definitions.CONTACT_ARRAY)
        states = contacts(force.tolist(), epochs.tolist())
        n_wrenches = 0
        columns = zip(received.tolist(), time_of, force.tolist(), base.tolist(), flags.tolist(), age.tolist(), states)
        for idx, (log_time, stamp, force, base, flag, age, (state, event, since)) in enumerate(columns):
            if force == force:
                zero = {"x": 0.0, "y": 0.0, "z": 0.0}
                wrench = {"header": {"stamp": stamp, "frame_id": FRAME_ID},
                          "wrench": {"force": {"x": 0.0, "y": 0.0, "z": force}, "torque": zero}}
                writer.write_message(f"{NODE}/{REGION}/wrench", wrench_schema, wrench, log_time, log_time, n_wrenches)
                n_wrenches += 1
            contact = {
                "region": REGION, "frame_id": FRAME_ID, "contact_raw": force >= FORCE_ON, "contact": state, "event": event,
                "since": time_of[since], "force": force, "force_base": base,
                "artifact": nan if flag & STALE_POSE else base - force, "on_threshold": FORCE_ON,
                "off_threshold": FORCE_OFF, "mdf": mdf, "pose_age": age * 1e-9, "age": nan,
                "flags": flag, "adaptation": 0, "artifact_change": nan, "touch": nan, "touch_on": nan, "touch_off": nan,
            }
            array = {"header": {"stamp": stamp, "frame_id": ""}, "contacts": [contact]}
            writer.write_message(f"{NODE}/contacts", contact_schema, array, log_time, log_time, idx)
        writer.finish()


def open_model(path):
    """The model on as many threads as this process has cores, and what its metadata say."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = len(os.sched_getaffinity(0))
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    notes = session.get_modelmeta().custom_metadata_map
    return session, notes, json.loads(notes["joints"])


def main():
    path, model, out = sys.argv[1:4]
    batch = int(sys.argv[4]) if len(sys.argv) > 4 else 32
    marks = [time.perf_counter()]
    session, notes, joints = open_model(model)
    window = session.get_inputs()[0].shape[1]
    rate_hz = float(notes.get("rate_hz", 100.0))
    marks.append(time.perf_counter())
    tactile_ns, received_ns, tactile, tactile_at, at_rest, pose_ns, pose, pose_at = read(path, joints)
    marks.append(time.perf_counter())
    baseline = median(tactile[at_rest])
    kept, known = in_order(tactile_ns), in_order(pose_ns)
    stamps, received_ns, features = tactile_ns[kept], received_ns[kept], tactile[kept] - baseline
    numbers, epochs = frame_numbers(stamps, round(1e9 / rate_hz))
    in_time = states_in_time(stamps, tactile_at[kept], pose_at[known])
    frames = rows(stamps, features, numbers, epochs, pose_ns[known], pose[known], in_time)
    taxels, angles, fresh, stretch, places, age = frames
    full = (places >= window - 1) & (stretch[places] == stretch[np.maximum(places - window + 1, 0)])
    stale = np.convolve(~fresh, np.ones(window), "full")[places] > 0
    marks.append(time.perf_counter())
    raw, raw_base = infer(session, taxels, angles, places[full], window, batch)
    marks.append(time.perf_counter())
    unit = NEWTON_OF_GF if notes.get("unit", "gF") == "gF" else 1.0
    force, base = np.full(len(places), np.nan), np.full(len(places), np.nan)
    base[full] = raw_base.astype(np.float64) * unit
    force[full] = np.where(stale[full], base[full], raw.astype(np.float64) * unit)
    ranges = np.array(json.loads(notes["pose_range"]), np.float64).reshape(-1, 2)
    outside = ((angles[places] < ranges[:, 0]) | (angles[places] > ranges[:, 1])).any(axis=1)
    flags = np.where(full, np.where(stale, STALE_POSE, np.where(outside, POSE_OUT_OF_RANGE, 0)), WARMUP)
    mdf = json.loads(notes["metrics"])["mdf_gf"] * NEWTON_OF_GF
    write(out, stamps, received_ns, epochs, force, base, flags, age, mdf)
    marks.append(time.perf_counter())
    stages = dict(zip(["load_s", "decode_s", "align_s", "infer_s", "write_s"], np.diff(marks).round(4).tolist()))
    print(json.dumps({"frames": len(stamps), "estimates": int(full.sum()), "wall_s": marks[-1] - marks[0], **stages}))


if __name__ == "__main__":
    main()
