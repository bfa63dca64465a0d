"""Prints a line for each message of ~/contacts: flags, force, force_base, stamp in ns, age in s. Reads as fast as they come."""
import sys
import time

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

import messages

qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(5000))
participant = DomainParticipant(0)
topic = Topic(participant, "rt/tactile_pose_fusion/contacts", messages.ContactArray)
reader = DataReader(participant, topic, qos=qos)
end = time.monotonic() + float(sys.argv[1])
while time.monotonic() < end:
    for array in reader.take(1000):
        if not hasattr(array, "contacts"):
            continue  # a sample that only says that its writer is gone
        state = array.contacts[0]
        stamp = messages.nanos(array.header.stamp)
        print(state.flags, repr(state.force), repr(state.force_base), stamp, repr(state.age), flush=True)
    time.sleep(0.001)
