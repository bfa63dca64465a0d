"""Our messages as Cyclone DDS reads and writes them: an implementation of CDR that has nothing to do with ours.

The fields are those of msg/*.msg, msg/standard/*.msg and action/Calibrate.action."""
from dataclasses import dataclass, field
from typing import List

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int8, int32, int64, sequence, uint8, uint32, uint64


@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Duration(IdlStruct, typename="builtin_interfaces.msg.dds_.Duration_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time
    frame_id: str


@dataclass
class TaxelArray(IdlStruct, typename="tactile_pose_fusion.msg.dds_.TaxelArray_"):
    header: Header
    sequence: uint32
    rows: uint32
    row_period: Duration
    values: sequence[float32]


@dataclass
class JointState(IdlStruct, typename="sensor_msgs.msg.dds_.JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs.msg.dds_.Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Transform(IdlStruct, typename="geometry_msgs.msg.dds_.Transform_"):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs.msg.dds_.TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs.msg.dds_.TFMessage_"):
    transforms: sequence[TransformStamped]


@dataclass
class ContactState(IdlStruct, typename="tactile_pose_fusion.msg.dds_.ContactState_"):
    region: str
    frame_id: str
    contact_raw: bool
    contact: bool
    event: uint8
    since: Time
    force: float64
    force_base: float64
    artifact: float64
    on_threshold: float64
    off_threshold: float64
    mdf: float64
    pose_age: float64
    age: float64
    flags: uint32
    adaptation: uint8
    artifact_change: float64
    touch: float64
    touch_on: float64
    touch_off: float64


@dataclass
class ContactArray(IdlStruct, typename="tactile_pose_fusion.msg.dds_.ContactArray_"):
    header: Header
    contacts: sequence[ContactState]


# The action, as services with no header in the payload: how Fast DDS has them.
@dataclass
class SendGoalRequest(IdlStruct, typename="tactile_pose_fusion.action.dds_.Calibrate_SendGoal_Request_"):
    goal_id: array[uint8, 16]
    duration: Duration


@dataclass
class SendGoalResponse(IdlStruct, typename="tactile_pose_fusion.action.dds_.Calibrate_SendGoal_Response_"):
    accepted: bool
    stamp: Time


@dataclass
class GetResultRequest(IdlStruct, typename="tactile_pose_fusion.action.dds_.Calibrate_GetResult_Request_"):
    goal_id: array[uint8, 16]


@dataclass
class GetResultResponse(IdlStruct, typename="tactile_pose_fusion.action.dds_.Calibrate_GetResult_Response_"):
    status: int8
    success: bool
    message: str
    file: str
    frames: uint32
    joints: sequence[str]
    joint_span: sequence[float64]
    sources: sequence[str]
    source_taxels: sequence[uint32]
    noise: sequence[float32]
    faulty_taxels: sequence[uint32]


@dataclass
class GoalInfo(IdlStruct, typename="action_msgs.msg.dds_.GoalInfo_"):
    goal_id: array[uint8, 16]
    stamp: Time


@dataclass
class CancelRequest(IdlStruct, typename="action_msgs.srv.dds_.CancelGoal_Request_"):
    goal_id: array[uint8, 16]
    stamp: Time


@dataclass
class CancelResponse(IdlStruct, typename="action_msgs.srv.dds_.CancelGoal_Response_"):
    return_code: int8
    goals: sequence[GoalInfo]


@dataclass
class FeedbackMessage(IdlStruct, typename="tactile_pose_fusion.action.dds_.Calibrate_FeedbackMessage_"):
    goal_id: array[uint8, 16]
    instruction: str
    time_left: Duration
    joints: sequence[str]
    joint_span: sequence[float64]
    sources: sequence[str]
    source_taxels: sequence[uint32]
    noise: sequence[float32]


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs.msg.dds_.KeyValue_"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticStatus_"):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticArray_"):
    header: Header
    status: sequence[DiagnosticStatus]


@dataclass
class Clock(IdlStruct, typename="rosgraph_msgs.msg.dds_.Clock_"):
    clock: Time


def nanos(stamp):
    return stamp.sec * 1_000_000_000 + stamp.nanosec
