"""Goals of an action as bytes, although rclpy makes objects of them.

The objects of a goal with 10,000 points take rclpy 60 to 250 ms, in which no thread of the process runs. Its action
server gets two C functions from the type of the request: one makes the message, one makes an object of it. The type
here has the first one of the interfaces and another second one: it serializes the message again, in 2 ms. What it is
made of, the attributes that rclpy looks up on each type of message, is how rclpy and the generated interfaces find each
other. That it works is checked when the type is made.
"""

import ctypes
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.serialization import deserialize_message
from rclpy.type_support import check_for_type_support

from pidtsm_ros.cdr import STAMP_BEGIN
from pidtsm_ros.serialization import serialize

_ID = 16
"""Bytes of the goal's identifier, with which a request begins."""

_TO_PYTHON = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)
_FROM_PYTHON = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.py_object, ctypes.c_void_p)
_CREATE = ctypes.PYFUNCTYPE(ctypes.c_void_p)
_DESTROY = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)


class Request:
    """A request for a goal.

    Attributes:
        goal_id: its identifier, unique_identifier_msgs/UUID.
        goal: the goal, serialized; empty if that has failed.
    """

    def __init__(self, data: bytes, id_type: Any) -> None:
        """Args: data: the serialized request; id_type: type of the identifier."""
        self.goal_id = id_type(uuid=list(data[STAMP_BEGIN : STAMP_BEGIN + _ID].ljust(_ID, b"\0")))
        self.goal = data[:STAMP_BEGIN] + data[STAMP_BEGIN + _ID :]  # 16 bytes less change no padding.


def serialized_request(action_type: Any) -> Any:
    """A type to take requests of this action with; None if this rclpy does not work so."""
    try:
        check_for_type_support(action_type)
        original = action_type.Impl.SendGoalService.Request
        example = original()
        example.goal_id.uuid = list(range(_ID))
        made = _make(type(original), type(example.goal_id))
        found = deserialize_message(serialize(example), made)
        right = found.goal_id == example.goal_id and deserialize_message(found.goal, action_type.Goal) == example.goal
    except (AttributeError, TypeError, ValueError, RuntimeError):
        return None
    return made if right else None


def _make(original: Any, id_type: Any) -> Any:
    """The type, from the metaclass of the original one; id_type: of the goal's identifier."""
    place: list[int] = []

    def to_python(message: int) -> Request:
        place[:] = [message]
        try:
            return Request(rclpy_implementation.rclpy_serialize(there(), there), id_type)
        except Exception:  # Nothing may be raised into C.
            return Request(b"", id_type)

    # rclpy serializes objects: one that "becomes" the message in C that is there already.
    functions = (
        _TO_PYTHON(to_python),
        _CREATE(lambda: place[0]),
        _DESTROY(lambda _: None),
        _FROM_PYTHON(lambda _, __: True),
    )
    as_python, there_already, keep, unchanged = (_capsule(function) for function in functions)
    borrowing = {
        "_CREATE_ROS_MESSAGE": there_already,
        "_DESTROY_ROS_MESSAGE": keep,
        "_CONVERT_FROM_PY": unchanged,
        "_TYPE_SUPPORT": original._TYPE_SUPPORT,
    }
    there = type("Borrowing", (type,), borrowing)("Borrowed", (), {})
    taking = {
        "_CREATE_ROS_MESSAGE": original._CREATE_ROS_MESSAGE,
        "_DESTROY_ROS_MESSAGE": original._DESTROY_ROS_MESSAGE,
        "_CONVERT_TO_PY": as_python,
        "_TYPE_SUPPORT": original._TYPE_SUPPORT,
        "functions": functions,  # The capsules do not keep them alive.
    }
    return type("Taking", (type,), taking)("SerializedRequest", (), {})


def _capsule(function: Any) -> Any:
    new = ctypes.pythonapi.PyCapsule_New
    new.restype, new.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
    return new(ctypes.cast(function, ctypes.c_void_p), None, None)
