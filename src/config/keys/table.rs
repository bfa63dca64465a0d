//! The table of all parameters.

use super::{ParamDefault, ParamKey, ParamKind, ParamRange};
use crate::fusion::TOUCH_EVIDENCE;

use ParamDefault::{Depends, Double, Doubles, EmptyArray, Int, Required, Str};
use ParamKind as Kind;
use ParamRange::{Above, Closed, Int as Ints, OneOf};

const OFFSET_MS: ParamRange = Closed { min: -10_000.0, max: 10_000.0 };
const STAMP_UNIT: ParamRange = OneOf(&["", "s", "ms", "us", "ns"]);
const STAMP_SINCE: ParamRange = OneOf(&["epoch", "boot"]);
const CONTACT_FORCE: ParamRange = Above { min: 0.0, max: 1000.0 };
const CONTACT_FRAMES: ParamRange = Ints { min: 1, max: 1000 };
const CONTACT_BY: ParamRange = OneOf(&["model", "force"]);
const TOUCH_EVIDENCE_RANGE: ParamRange = Closed { min: 0.0, max: 1000.0 };
const TOUCH_LEVEL: ParamRange = Closed { min: 0.001, max: 0.999 };

/// All parameters, in the order of the documentation.
pub static KEYS: &[ParamKey] = &[
    ParamKey::new("regions", Kind::StrArray, Required, "Names of the patches to estimate, each with one force"),
    ParamKey::new("tactile_sources", Kind::StrArray, Required, "Names of the streams of taxels"),
    ParamKey::new("joint_sources", Kind::StrArray, EmptyArray, "Names of the streams of joint angles"),
    ParamKey::new(
        "truth_sources",
        Kind::StrArray,
        EmptyArray,
        "Names of the force sensors that measure the true force, for training and evaluation",
    ),
    // A stream of taxels.
    ParamKey::new("tactile.<source>.topic", Kind::Str, Required, "Topic of the taxels"),
    ParamKey::new(
        "tactile.<source>.type",
        Kind::Str,
        Str("tactile_pose_fusion/msg/TaxelArray"),
        "Message type; any type is possible, the fields below name the place of its numbers",
    ),
    ParamKey::new("tactile.<source>.n_taxels", Kind::Int, Required, "Taxels in a sample")
        .range(Ints { min: 1, max: 4096 }),
    ParamKey::new(
        "tactile.<source>.field",
        Kind::Str,
        Depends("values for TaxelArray, data for Float32MultiArray, else required"),
        "Path of the numbers: rows x taxels, row-major",
    ),
    ParamKey::new(
        "tactile.<source>.fields",
        Kind::StrArray,
        Depends("unset"),
        "Paths of the numbers, instead of field, if they are in several fields: all taxels of the first, then all of the second, ...",
    ),
    ParamKey::new(
        "tactile.<source>.stamp",
        Kind::Str,
        Depends("header.stamp; required for Float32MultiArray, which has no header"),
        "Path of the last row's stamp, or receipt: the time at which the message arrived",
    ),
    ParamKey::new(
        "tactile.<source>.stamp_unit",
        Kind::Str,
        Str(""),
        "Unit of a stamp that is a number; empty for a builtin_interfaces/msg/Time",
    )
    .range(STAMP_UNIT),
    ParamKey::new(
        "tactile.<source>.stamp_since",
        Kind::Str,
        Str("epoch"),
        "Start of the stamp's time: the Unix epoch, or the boot of the device, whose clock is then mapped to the time of receipt",
    )
    .range(STAMP_SINCE),
    ParamKey::new(
        "tactile.<source>.only",
        Kind::Str,
        Str(""),
        "A field and its value, such as side=Left: other messages of the topic are not for this source; empty: all are",
    ),
    ParamKey::new(
        "tactile.<source>.rows",
        Kind::IntOrField,
        Depends("rows for TaxelArray, what the layout says for Float32MultiArray, else 1"),
        "Consecutive samples in a message: a number, or the path of a field",
    )
    .range(Ints { min: 1, max: 65_536 }),
    ParamKey::new(
        "tactile.<source>.cols",
        Kind::IntOrField,
        Str(""),
        "Taxels in a row, checked against n_taxels: a number, the path of a field, or empty for no check",
    )
    .range(Ints { min: 1, max: 4096 }),
    ParamKey::new(
        "tactile.<source>.row_period",
        Kind::Str,
        Depends("row_period for TaxelArray unless row_period_ms is set, else empty"),
        "Path of the time between rows, a builtin_interfaces/msg/Duration; empty where there is one row",
    ),
    ParamKey::new(
        "tactile.<source>.row_period_ms",
        Kind::Double,
        Depends("unset"),
        "Time between rows, instead of row_period",
    )
    .range(Above { min: 0.0, max: 10_000.0 })
    .unit("ms"),
    ParamKey::new(
        "tactile.<source>.sequence",
        Kind::Str,
        Depends("sequence for TaxelArray, else empty"),
        "Path of the sender's message counter, which shows lost messages; empty if there is none",
    ),
    ParamKey::new("tactile.<source>.sign", Kind::Int, Int(1), "-1 if a lower reading means more pressure")
        .range(ParamRange::Ints(&[1, -1])),
    ParamKey::new(
        "tactile.<source>.no_reading",
        Kind::Double,
        Depends("unset"),
        "Reading that marks a taxel that does not exist, such as 3072; regions can't use such taxels. NaN always marks one",
    ),
    ParamKey::new(
        "tactile.<source>.frame_clock",
        Kind::Str,
        Str("tactile"),
        "tactile: each sample is a frame, for sources at the model's rate; grid: frames at the model's rate",
    )
    .range(OneOf(&["tactile", "grid"])),
    ParamKey::new("tactile.<source>.stamp_offset_ms", Kind::Double, Double(0.0), "Added to every stamp of this source")
        .range(OFFSET_MS)
        .unit("ms"),
    // A stream of joint angles.
    ParamKey::new("joint.<source>.topic", Kind::Str, Required, "Topic of the joint angles"),
    ParamKey::new(
        "joint.<source>.type",
        Kind::Str,
        Str("sensor_msgs/msg/JointState"),
        "Message type; any type is possible, the fields below name the place of its angles",
    ),
    ParamKey::new(
        "joint.<source>.field",
        Kind::Str,
        Depends("position for JointState, else required"),
        "Path of the angles",
    ),
    ParamKey::new(
        "joint.<source>.names_field",
        Kind::Str,
        Depends("name for JointState"),
        "Path of the angles' names; other types than JointState need this or names",
    ),
    ParamKey::new(
        "joint.<source>.names",
        Kind::StrArray,
        Depends("unset"),
        "Names of the angles, in order, for a type without names",
    ),
    ParamKey::new(
        "joint.<source>.stamp",
        Kind::Str,
        Str("header.stamp"),
        "Path of the stamp, or receipt: the time at which the message arrived",
    ),
    ParamKey::new(
        "joint.<source>.stamp_unit",
        Kind::Str,
        Str(""),
        "Unit of a stamp that is a number; empty for a builtin_interfaces/msg/Time",
    )
    .range(STAMP_UNIT),
    ParamKey::new(
        "joint.<source>.stamp_since",
        Kind::Str,
        Str("epoch"),
        "Start of the stamp's time: the Unix epoch, or the boot of the device, whose clock is then mapped to the time of receipt",
    )
    .range(STAMP_SINCE),
    ParamKey::new(
        "joint.<source>.only",
        Kind::Str,
        Str(""),
        "A field and its value, such as side=Left: other messages of the topic are not for this source; empty: all are",
    ),
    ParamKey::new("joint.<source>.degrees", Kind::Bool, ParamDefault::Bool(false), "Whether the source sends degrees"),
    ParamKey::new(
        "joint.<source>.scale",
        Kind::Double,
        Double(1.0),
        "Factor from the source's unit to rad, or to degrees if degrees is true; not 0",
    ),
    ParamKey::new("joint.<source>.stamp_offset_ms", Kind::Double, Double(0.0), "Added to every stamp of this source")
        .range(OFFSET_MS)
        .unit("ms"),
    // A stream of joint angles that are computed from the keypoints of a hand.
    ParamKey::new(
        "joint.<source>.hand.layout",
        Kind::Str,
        Str(""),
        "Layout of a hand's points, for messages that hold points and no angles: openxr (26), openxr25 (without the palm), mano21 or manus",
    )
    .range(OneOf(&["", "openxr", "openxr25", "mano21", "manus"])),
    ParamKey::new("joint.<source>.hand.side", Kind::Str, Str(""), "Left or right hand; the points alone don't show it")
        .range(OneOf(&["", "left", "right"])),
    ParamKey::new(
        "joint.<source>.hand.points",
        Kind::StrArray,
        Depends("the names of the layout"),
        "Names of the points: 21 in the order of mano21, or 25 in that of openxr25",
    ),
    ParamKey::new(
        "joint.<source>.hand.first",
        Kind::Int,
        Int(0),
        "Index of the hand's first point, if a message holds more than one hand",
    )
    .range(Ints { min: 0, max: 4096 }),
    ParamKey::new(
        "joint.<source>.hand.valid",
        Kind::Str,
        Str(""),
        "Path of whether each point is valid; \"\" where messages don't say",
    ),
    // A force sensor that measures the true force.
    ParamKey::new("truth.<source>.topic", Kind::Str, Required, "Topic of the true force"),
    ParamKey::new(
        "truth.<source>.type",
        Kind::Str,
        Str("geometry_msgs/msg/WrenchStamped"),
        "Message type; another one needs field",
    ),
    ParamKey::new(
        "truth.<source>.field",
        Kind::Str,
        Depends("wrench.force.z for WrenchStamped, else required"),
        "Path of the force: one number",
    ),
    ParamKey::new(
        "truth.<source>.fields",
        Kind::StrArray,
        EmptyArray,
        "For a force sensor with three axes, in place of field: paths of the numbers along x, y and z of the patch, in this order",
    ),
    ParamKey::new(
        "truth.<source>.signs",
        Kind::IntArray,
        Depends("1, 1, 1"),
        "For fields: -1 for each axis whose reading is the other way, so that all are of the force on the hand by the object",
    )
    .range(ParamRange::Ints(&[1, -1])),
    ParamKey::new(
        "truth.<source>.stamp",
        Kind::Str,
        Str("header.stamp"),
        "Path of the stamp, or receipt: the time at which the message arrived",
    ),
    ParamKey::new(
        "truth.<source>.stamp_unit",
        Kind::Str,
        Str(""),
        "Unit of a stamp that is a number; empty for a builtin_interfaces/msg/Time",
    )
    .range(STAMP_UNIT),
    ParamKey::new(
        "truth.<source>.stamp_since",
        Kind::Str,
        Str("epoch"),
        "Start of the stamp's time: the Unix epoch, or the boot of the device, whose clock is then mapped to the time of receipt",
    )
    .range(STAMP_SINCE),
    ParamKey::new(
        "truth.<source>.only",
        Kind::Str,
        Str(""),
        "A field and its value, such as side=Left: other messages of the topic are not for this source; empty: all are",
    ),
    ParamKey::new("truth.<source>.unit", Kind::Str, Str("N"), "Unit of the force")
        .range(OneOf(&["N", "gF", "kgf", "mN"])),
    ParamKey::new("truth.<source>.sign", Kind::Int, Int(1), "-1 if a lower reading means more pressure")
        .range(ParamRange::Ints(&[1, -1])),
    ParamKey::new("truth.<source>.stamp_offset_ms", Kind::Double, Double(0.0), "Added to every stamp of this source")
        .range(OFFSET_MS)
        .unit("ms"),
    // A model. Regions name it.
    ParamKey::new(
        "model.<name>.path",
        Kind::Str,
        Required,
        "The ONNX file, relative to the folder of this file (given with -p: to the working directory)",
    ),
    ParamKey::new(
        "model.<name>.backend",
        Kind::Str,
        Str("auto"),
        "What runs the model; auto: the built-in code for networks that tpf trains, else ONNX Runtime if it is found, else RTen",
    )
    .range(OneOf(&["auto", "builtin", "onnxruntime", "rten"])),
    ParamKey::new("model.<name>.unit", Kind::Str, Str(""), "Unit of the model's forces; empty: the unit in the file")
        .range(OneOf(&["", "gF", "N"])),
    ParamKey::new(
        "model.<name>.rate_hz",
        Kind::Double,
        Double(0.0),
        "Frames per second that the model was trained on; 0: the rate in the file",
    )
    .range(Closed { min: 0.0, max: 10_000.0 })
    .unit("Hz"),
    ParamKey::new(
        "model.<name>.glove",
        Kind::Str,
        Str(""),
        "Glove that the model was trained on, if it is another than `glove`; empty: the same glove",
    ),
    ParamKey::new("model.<name>.inputs.tactile", Kind::Str, Str("tactile"), "Name of the input [N, window, taxels]"),
    ParamKey::new("model.<name>.inputs.pose", Kind::Str, Str("pose"), "Name of the input [N, window, joints]"),
    ParamKey::new("model.<name>.outputs.force", Kind::Str, Str("force"), "Name of the force output"),
    ParamKey::new(
        "model.<name>.outputs.force_base",
        Kind::Str,
        Str("force_base"),
        "Name of the output of the tactile branch alone, if there is one",
    ),
    ParamKey::new(
        "model.<name>.outputs.force_residual",
        Kind::Str,
        Str("force_residual"),
        "Name of the output of the pose correction, if there is one",
    ),
    ParamKey::new(
        "model.<name>.outputs.touch",
        Kind::Str,
        Str("touch"),
        "Name of the output with the probability of touch, if there is one",
    ),
    // A region.
    ParamKey::new(
        "region.<name>.model",
        Kind::Str,
        Required,
        "Name of its model; regions that share one run as a batch",
    ),
    ParamKey::new(
        "region.<name>.tactile_source",
        Kind::Str,
        Depends("the only tactile source; required where there are several"),
        "The tactile source of its taxels",
    ),
    ParamKey::new(
        "region.<name>.taxels",
        Kind::IntArray,
        EmptyArray,
        "Its taxels as indices from 0 into a sample, in the order of the model's input; empty: all of them",
    )
    .range(Ints { min: 0, max: 4095 }),
    ParamKey::new(
        "region.<name>.joints",
        Kind::StrArray,
        EmptyArray,
        "Its joints by name, in the order of the model's input; empty for a model without pose",
    ),
    ParamKey::new(
        "region.<name>.model_joints",
        Kind::StrArray,
        EmptyArray,
        "Names of these joints in the model, in the same order, for a model that was trained on another finger; empty: the same names",
    ),
    ParamKey::new(
        "region.<name>.truth",
        Kind::Str,
        Depends("the only truth source; none where there are several"),
        "The force sensor that measures its true force",
    ),
    ParamKey::new("region.<name>.frame_id", Kind::Str, Required, "Frame of its wrench (frame_id of the messages), right-handed"),
    ParamKey::new(
        "region.<name>.normal",
        Kind::DoubleArray(3),
        Doubles(&[0.0, 0.0, 1.0]),
        "Direction of the force on the hand by the object, in the patch's own frame; any length but 0",
    ),
    ParamKey::new(
        "region.<name>.mount.translation",
        Kind::DoubleArray(3),
        Doubles(&[0.0, 0.0, 0.0]),
        "Position of the patch in frame_id",
    )
    .unit("m"),
    ParamKey::new(
        "region.<name>.mount.rotation",
        Kind::DoubleArray(4),
        Doubles(&[0.0, 0.0, 0.0, 1.0]),
        "Orientation of the patch in frame_id: a unit quaternion x, y, z, w",
    ),
    // The place of a region's taxels, for pictures.
    ParamKey::new(
        "region.<name>.layout.shape",
        Kind::IntArray,
        Depends("as square as possible"),
        "Rows and columns of its taxels, which are row by row: for pictures only",
    )
    .range(Ints { min: 1, max: 4096 }),
    ParamKey::new(
        "region.<name>.layout.pitch",
        Kind::Double,
        Double(0.004),
        "Distance between the centers of neighbouring taxels: for pictures only",
    )
    .range(Above { min: 0.0, max: 1.0 })
    .unit("m"),
    ParamKey::new(
        "region.<name>.layout.positions",
        Kind::Doubles,
        EmptyArray,
        "Centers of its taxels in the patch's own frame, x y z of each in turn, instead of a grid: for markers only",
    )
    .unit("m"),
    ParamKey::new("region.<name>.contact.force_on", Kind::Double, Depends("contact.force_on"), "For this region only")
        .range(CONTACT_FORCE)
        .unit("N")
        .at_run_time(),
    ParamKey::new(
        "region.<name>.contact.force_off",
        Kind::Double,
        Depends("contact.force_off"),
        "For this region only",
    )
    .range(CONTACT_FORCE)
    .unit("N")
    .at_run_time(),
    ParamKey::new("region.<name>.contact.on_frames", Kind::Int, Depends("contact.on_frames"), "For this region only")
        .range(CONTACT_FRAMES)
        .unit("frames")
        .at_run_time(),
    ParamKey::new("region.<name>.contact.off_frames", Kind::Int, Depends("contact.off_frames"), "For this region only")
        .range(CONTACT_FRAMES)
        .unit("frames")
        .at_run_time(),
    ParamKey::new("region.<name>.contact.by", Kind::Str, Depends("contact.by"), "For this region only")
        .range(CONTACT_BY)
        .at_run_time(),
    ParamKey::new("region.<name>.contact.touch_on", Kind::Double, Depends("contact.touch_on"), "For this region only")
        .range(TOUCH_LEVEL)
        .at_run_time(),
    ParamKey::new("region.<name>.contact.touch_off", Kind::Double, Depends("contact.touch_off"), "For this region only")
        .range(TOUCH_LEVEL)
        .at_run_time(),
    ParamKey::new(
        "region.<name>.contact.touch_evidence",
        Kind::Double,
        Depends("contact.touch_evidence"),
        "For this region only",
    )
    .range(TOUCH_EVIDENCE_RANGE)
    .at_run_time(),
    // Contact.
    ParamKey::new(
        "contact.by",
        Kind::Str,
        Str("model"),
        "Basis of contact: model is the probability of touch if the model gives one, else the force; force is the force of any model",
    )
    .range(CONTACT_BY)
    .at_run_time(),
    ParamKey::new(
        "contact.touch_on",
        Kind::Double,
        Depends("the model's own"),
        "At or above this probability of touch a contact may begin, for models that give one",
    )
    .range(TOUCH_LEVEL)
    .at_run_time(),
    ParamKey::new(
        "contact.touch_off",
        Kind::Double,
        Depends("the model's own; 0.7 x touch_on where that is set"),
        "Below this probability of touch a contact may end; must be less than touch_on, and be set together with it",
    )
    .range(TOUCH_LEVEL)
    .at_run_time(),
    ParamKey::new(
        "contact.touch_evidence",
        Kind::Double,
        Double(TOUCH_EVIDENCE),
        "What the log odds of touch above those of touch_off must add up to before a contact begins, each frame up to 1 less with a noisy hand tracker; 0 for none",
    )
    .range(TOUCH_EVIDENCE_RANGE)
    .at_run_time(),
    ParamKey::new(
        "contact.force_on",
        Kind::Double,
        Double(0.024_516_625), // 2.5 gF, the touch threshold of the paper, Sec. VI
        "At or above this force a contact may begin; the default is 2.5 gF",
    )
    .range(CONTACT_FORCE)
    .unit("N")
    .at_run_time(),
    ParamKey::new(
        "contact.force_off",
        Kind::Double,
        Double(0.014_709_975), // 1.5 gF
        "Below this force a contact may end; must be less than force_on; the default is 1.5 gF",
    )
    .range(CONTACT_FORCE)
    .unit("N")
    .at_run_time(),
    ParamKey::new(
        "contact.on_frames",
        Kind::Int,
        Int(2),
        "Consecutive frames at or above force_on that begin a contact",
    )
    .range(CONTACT_FRAMES)
    .unit("frames")
    .at_run_time(),
    ParamKey::new("contact.off_frames", Kind::Int, Int(3), "Consecutive frames below force_off that end a contact")
        .range(CONTACT_FRAMES)
        .unit("frames")
        .at_run_time(),
    // Artifacts.
    ParamKey::new(
        "adaptation",
        Kind::Str,
        Str("follow"),
        "For adaptive models: follow corrects the artifact of pose and follows its changes while the glove is worn; frozen keeps the artifact of the calibration; none does not correct it",
    )
    .range(OneOf(&["follow", "frozen", "none"])),
    // Time.
    ParamKey::new(
        "timing.max_gap_ms",
        Kind::Double,
        Double(50.0),
        "Missing taxels up to this long are interpolated; a longer gap starts the window anew",
    )
    .range(Closed { min: 0.0, max: 10_000.0 })
    .unit("ms"),
    ParamKey::new(
        "timing.joint_slack_ms",
        Kind::Double,
        Double(10.0),
        "Longest time, by stamps, that a frame waits for the next joint state; 0 for the lowest latency",
    )
    .range(Closed { min: 0.0, max: 1000.0 })
    .unit("ms"),
    ParamKey::new(
        "timing.max_pose_age_ms",
        Kind::Double,
        Depends("3 measured periods of the joint, at least 200, at most 500"),
        "Longest time that the last joint state is used; after that the estimate is tactile-only and flagged STALE_POSE",
    )
    .range(Closed { min: 0.0, max: 60_000.0 })
    .unit("ms"),
    ParamKey::new(
        "timing.time_jump_ms",
        Kind::Double,
        Double(200.0),
        "A stamp that goes back by this much or more is a jump of time, which resets the pipeline; by less it is a late sample",
    )
    .range(Closed { min: 1.0, max: 60_000.0 })
    .unit("ms"),
    ParamKey::new(
        "timing.max_age_ms",
        Kind::Double,
        Double(100.0),
        "In a live run, a frame whose stamp differs from the clock by more than this is flagged LATE; 0 for no limit, to play old data",
    )
    .range(Closed { min: 0.0, max: 60_000.0 })
    .unit("ms"),
    // Calibration, glove and user.
    ParamKey::new(
        "calibration.file",
        Kind::Str,
        Str(""),
        "File of the calibration, relative to the folder of this file; empty: the calibration is not kept. Set while the node runs, it must be a fitting calibration in the folder of the first one, and is put into use at once",
    )
    .at_run_time(),
    ParamKey::new(
        "calibration.worn_file",
        Kind::Str,
        Str(""),
        "File in which the node keeps the calibration in use, with the artifact as it is followed, every half minute and at the end, relative to the folder of this file; a start with --calibration FILE goes on from there while the glove stays on the hand; empty: not kept",
    ),
    ParamKey::new("calibration.duration_s", Kind::Double, Double(10.0), "Duration of a calibration in the air")
        .range(Above { min: 0.5, max: 600.0 })
        .unit("s")
        .at_run_time(),
    ParamKey::new(
        "calibration.min_s",
        Kind::Double,
        Double(2.0),
        "Least amount of unloaded data for a calibration; at most duration_s",
    )
    .range(Above { min: 0.0, max: 600.0 })
    .unit("s")
    .at_run_time(),
    ParamKey::new(
        "calibration.touch_s",
        Kind::Double,
        Double(0.0),
        "How long ~/calibrate waits for touches of the force sensors in truth_sources, after the zero, to fit the factor of the forces of this donning; 0: no touches, and the node does not subscribe to the force sensors",
    )
    .range(Closed { min: 0.0, max: 600.0 })
    .unit("s"),
    ParamKey::new(
        "calibration.max_force",
        Kind::Double,
        Double(0.5),
        "An estimate above this force means that the hand touches something",
    )
    .range(Above { min: 0.0, max: 1000.0 })
    .unit("N")
    .at_run_time(),
    ParamKey::new(
        "calibration.max_loaded_fraction",
        Kind::Double,
        Double(0.1),
        "Largest part of the data that may be loaded; with more, the calibration fails",
    )
    .range(Closed { min: 0.0, max: 1.0 })
    .at_run_time(),
    ParamKey::new(
        "calibration.min_joint_span",
        Kind::Double,
        Double(0.2),
        "Least movement of some joint of each region during a live calibration; 0 accepts a hand that does not move",
    )
    .range(Closed { min: 0.0, max: 6.3 })
    .unit("rad")
    .at_run_time(),
    ParamKey::new(
        "calibration.insist",
        Kind::Bool,
        ParamDefault::Bool(false),
        "Use a zero that would be refused: of another glove, user or model, or one that looks loaded; a warning says so",
    )
    .at_run_time(),
    ParamKey::new("glove", Kind::Str, Str(""), "Serial number of the glove, kept with calibrations and recordings"),
    ParamKey::new("user", Kind::Str, Str(""), "Name of the wearer, kept with calibrations and recordings"),
    ParamKey::new(
        "stage_topic",
        Kind::Str,
        Str("/stage"),
        "Topic of the annotations of a recording, tactile_pose_fusion/msg/Stage",
    ),
    // Parameters of the live node only.
    ParamKey::new(
        "autostart",
        Kind::Bool,
        ParamDefault::Bool(true),
        "Whether the node configures and activates itself; false waits for a lifecycle manager",
    ),
    ParamKey::new(
        "tactile_timeout_ms",
        Kind::Double,
        Double(100.0),
        "Silence of a tactile source after which the node publishes STALE_TACTILE, and repeats it after each such time",
    )
    .range(Closed { min: 1.0, max: 60_000.0 })
    .unit("ms"),
    ParamKey::new(
        "message_definitions",
        Kind::Str,
        Str(""),
        "Folder with .msg files, relative to the folder of this file, searched before AMENT_PREFIX_PATH; empty: none",
    ),
    ParamKey::new(
        "diagnostics.max_latency_ms",
        Kind::Double,
        Double(50.0),
        "Limit of the 99th percentile of the time from the stamp of the data to its published estimate; above it there is a warning",
    )
    .range(Above { min: 0.0, max: 60_000.0 })
    .unit("ms"),
    ParamKey::new(
        "diagnostics.max_jitter_ms",
        Kind::Double,
        Double(5.0),
        "Limit of the standard deviation of the time between tactile messages; above it there is a warning",
    )
    .range(Above { min: 0.0, max: 60_000.0 })
    .unit("ms"),
    ParamKey::new(
        "diagnostics.min_estimates",
        Kind::Double,
        Double(0.9),
        "Least part of a second's frames with an estimate without a flag; below it there is a warning",
    )
    .range(Closed { min: 0.0, max: 1.0 }),
    ParamKey::new(
        "visualization.publish",
        Kind::Str,
        Str("auto"),
        "When the node publishes markers and images of the taxels: auto, while somebody subscribes to them; always; never, and without their topics",
    )
    .range(OneOf(&["auto", "always", "never"])),
    ParamKey::new(
        "visualization.rate_hz",
        Kind::Double,
        Double(20.0),
        "Most markers and images of a region in a second",
    )
    .range(Above { min: 0.0, max: 1000.0 })
    .unit("Hz"),
    ParamKey::new("visualization.arrow_m_per_n", Kind::Double, Double(0.02), "Length of a force arrow for each newton")
        .range(Above { min: 0.0, max: 100.0 })
        .unit("m/N"),
    ParamKey::new(
        "visualization.taxel_range",
        Kind::Double,
        Double(0.0),
        "Taxel reading above the zero that has the strongest colour, in the sensor's unit; 0: the largest of the last seconds",
    )
    .range(Closed { min: 0.0, max: 1e9 }),
    ParamKey::new(
        "visualization.tf",
        Kind::Bool,
        ParamDefault::Bool(false),
        "Publish the pose of each patch in its region's frame on /tf_static, as the frame REGION_patch",
    ),
    ParamKey::new("diagnostics.sustained_s", Kind::Double, Double(5.0), "A warning that lasts this long becomes an error")
        .range(Closed { min: 0.0, max: 3600.0 })
        .unit("s"),
    // Parameters of every ROS 2 node.
    ParamKey::new(
        "use_sim_time",
        Kind::Bool,
        ParamDefault::Bool(false),
        "Use the time of /clock, as any ROS 2 node does",
    ),
    ParamKey::new(
        "start_type_description_service",
        Kind::Bool,
        ParamDefault::Bool(true),
        "A parameter of every ROS 2 node; it has no effect here",
    ),
];
