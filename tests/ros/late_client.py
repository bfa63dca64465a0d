"""A client as rmw_cyclonedds has it, whose response reader comes half a second after its request. Prints the state of the node."""
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, int32, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

SERVICE = "/tactile_pose_fusion/get_state"


@dataclass
class Request(IdlStruct, typename="lifecycle_msgs.srv.dds_.GetState_Request_"):
    client: array[uint8, 8]
    sequence_high: int32
    sequence_low: uint32
    structure_needs_at_least_one_member: uint8


@dataclass
class Response(IdlStruct, typename="lifecycle_msgs.srv.dds_.GetState_Response_"):
    client: array[uint8, 8]
    sequence_high: int32
    sequence_low: uint32
    id: uint8
    label: str


qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))
participant = DomainParticipant(0)
writer = DataWriter(participant, Topic(participant, f"rq{SERVICE}Request", Request), qos=qos)
deadline = time.monotonic() + 15
while not writer.get_matched_subscriptions():
    assert time.monotonic() < deadline, "the service never came"
    time.sleep(0.01)
client = [1, 2, 3, 4, 5, 6, 7, 8]
writer.write(Request(client, 0, 1, 0))
time.sleep(0.5)
reader = DataReader(participant, Topic(participant, f"rr{SERVICE}Reply", Response), qos=qos)
deadline = time.monotonic() + 5
while not (responses := reader.take(10)):
    assert time.monotonic() < deadline, "no response"
    time.sleep(0.01)
assert [(list(r.client), r.sequence_low) for r in responses] == [(client, 1)], responses
print(responses[0].label)
