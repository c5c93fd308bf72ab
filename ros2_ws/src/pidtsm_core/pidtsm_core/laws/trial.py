"""Whether a law from outside can be used."""

import math
from collections.abc import Mapping
from itertools import product

import numpy as np

from pidtsm_core.compiling.trial import check_finite, compiles
from pidtsm_core.errors import MemberError
from pidtsm_core.laws.base import STATE_SLOTS, ArmSample, Demand, Law
from pidtsm_core.laws.calls import advance, advance_arm_unchecked, command, command_arm_unchecked, make_law
from pidtsm_core.laws.reaching import Interval
from pidtsm_core.parameters import Value
from pidtsm_core.parameters.family import SLOTS, check_parameters
from pidtsm_core.robots import NO_TOOL, ROBOTS, make_model
from pidtsm_core.signals import Adaptation

_ERRORS = (0.0, 0.1, -0.3)
_DT = 0.001


def try_member(law: Law) -> None:
    """Compile a law with its default parameters, and see what it commands for some errors.

    Raises:
        MemberError: its parameters do not fit, it does not compile, or it returns what is not finite.
    """
    what = f"law {law.name}"
    try:
        parameters = law.parameters({})
    except KeyError as missing:
        raise MemberError(f"{what} consists of {missing}, which is not known; register that first") from None
    check_parameters(what, parameters, most=3 * SLOTS)
    values = {f"law.{p.name}": p.default for p in parameters}
    if law.of_arm:
        _try_on_arm(what, law, values)
        return
    with compiles(what):
        made = make_law(law, values, 1)
    for e, de, dde in product(_ERRORS, repeat=3):
        x = np.zeros(STATE_SLOTS)
        for dt in (0.0, _DT):
            given = f"e = {e:g}, e' = {de:g}, e'' = {dde:g}"
            result = command(made, 0, e, de, dde, 0.5, x, dt)
            check_finite(what, result, given)
            advance(made, 0, e, result[2], result[3], x, Interval(_DT, False, Adaptation.NORMAL.value))
            if not np.isfinite(x).all():
                raise MemberError(f"{what}: its state becomes {x[x != 0.0].tolist()} for {given}")
    far = command(made, 0, 1e3, 1e3, 0.0, 0.0, np.zeros(STATE_SLOTS), _DT)
    if any(map(math.isnan, far)):
        raise MemberError(f"{what} returns {far} for errors of 1000")


def _try_on_arm(what: str, law: Law, values: Mapping[str, Value]) -> None:
    """The same for a law of the whole arm, on the arm of the article.

    Raises:
        MemberError: see `try_member`.
    """
    robot = ROBOTS.own[0]
    packed = robot.pack_model({f"robot.{p.name}": p.default for p in robot.parameters})
    joints = len(robot.joints)
    assert law.memory is not None
    assert robot.tool is not None
    with compiles(what):
        made = make_law(law, values, joints, robot.tool(packed) if law.needs_tree else NO_TOOL)
    x, demand = np.zeros(law.memory(joints)), np.zeros((len(Demand), joints))
    still, model, limits = np.zeros(joints), make_model(robot, packed), np.array(robot.effort_limit)
    for e, de, dde in product(_ERRORS, repeat=3):
        motion = np.array([still + e, still + de, still + dde])
        for dt in (0.0, _DT):
            desired, tool = np.zeros((3, joints)), (made.tree, made.tool_row, made.tool_point)
            arm = ArmSample(motion, desired, still, still, limits, model, *tool, dt)
            given = f"e = {e:g}, e' = {de:g}, e'' = {dde:g}"
            command_arm_unchecked(made, arm, x, demand)
            check_finite(what, demand, given)
            advance_arm_unchecked(made, x, still, dt, Adaptation.NORMAL.value)
            if not np.isfinite(x).all():
                raise MemberError(f"{what}: its memory becomes {x[~np.isfinite(x)].tolist()} for {given}")
