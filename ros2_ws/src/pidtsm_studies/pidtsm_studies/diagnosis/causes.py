"""What may be wrong with a loop: the causes that are looked for, in words, with what a user can do about each."""

from enum import Enum


class Cause(str, Enum):
    """Something that is wrong with an arm, its description, its drives, its sensors or its gains."""

    LOST_SAMPLES = "lost_samples"
    NOISY_ENCODER = "noisy_encoder"
    COMMAND_JITTER = "command_jitter"
    SATURATION = "saturation"
    LATE_DRIVE = "late_drive"
    RINGING = "ringing"
    STICK_SLIP = "stick_slip"
    WRONG_SIGN = "wrong_sign"
    WRONG_ORDER = "wrong_order"
    OTHER_ARM = "other_arm"
    WRONG_GRAVITY = "wrong_gravity"
    UNKNOWN_PAYLOAD = "unknown_payload"


NAMES = {
    Cause.LOST_SAMPLES: "lost samples",
    Cause.NOISY_ENCODER: "noisy encoder",
    Cause.COMMAND_JITTER: "the reference jitters",
    Cause.SATURATION: "saturated drive",
    Cause.LATE_DRIVE: "late drive",
    Cause.RINGING: "the controller rings",
    Cause.STICK_SLIP: "stick-slip",
    Cause.WRONG_SIGN: "wrong sign of a joint",
    Cause.WRONG_ORDER: "wrong order of the joints",
    Cause.OTHER_ARM: "description of another arm",
    Cause.WRONG_GRAVITY: "wrong masses or centres of mass",
    Cause.UNKNOWN_PAYLOAD: "payload that is not in the model",
}
"""Short names for tables."""
