"""The result of an identification as plain data."""

from typing import Any

import numpy as np

from pidtsm_core.identification.carriers import mass_and_center
from pidtsm_core.identification.identification import Identification
from pidtsm_core.identification.regressor import OF_JOINT, parameter_names
from pidtsm_core.robots.tree.unit_forces import LINK


def as_json(found: Identification) -> dict[str, Any]:
    """The result, in SI units; lists are in the order of the joints.

    ``as_written`` are the errors of the files that were written and read back, null if there are none; ``notes`` say
    what no motion can tell apart. ``combinations`` are the base parameters: what each consists of, its estimate, half
    of its interval of 95 %, its value by the description, and whether the data say more about it than the description.
    """
    check, fit, names = found.check, found.fit, parameter_names(found.arm.joints)
    described = found.base.mapping @ found.described
    joints = len(found.arm.joints)
    of_joints = found.parameters[LINK * joints :].reshape(len(OF_JOINT), joints)
    return {
        "joints": list(found.arm.joints),
        "warnings": list(found.warnings),
        "notes": list(found.notes),
        "torque_error": {
            "before": check.error(check.before).tolist(),
            "after": check.error(check.after).tolist(),
            "of_training": fit.residual.tolist(),
            "as_written": None if found.as_written is None else found.as_written.tolist(),
        },
        "delay": {"value": fit.delay, "deviation": fit.delay_deviation},
        "bandwidth": found.cutoff,
        "condition": fit.condition,
        "combinations": [
            {
                "name": names[column],
                "combination": text,
                "value": float(value),
                "interval": float(half),
                "described": float(before),
                "determined": i not in found.undetermined,
            }
            for i, (column, text, value, half, before) in enumerate(
                zip(found.base.columns, found.base.texts(names), fit.beta, fit.half_interval, described, strict=True)
            )
        ],
        "without_effect": list(found.base.without_effect(names)),
        "only_combined": list(found.base.only_combined(names)),
        **{name: values.tolist() for name, values in zip(OF_JOINT, of_joints, strict=True)},
        "links": [
            {"joint": joint, "described": _link(before), "identified": _link(after)}
            for joint, before, after in zip(
                found.arm.joints,
                found.described[: LINK * joints].reshape(joints, LINK),
                found.parameters[: LINK * joints].reshape(joints, LINK),
                strict=True,
            )
        ],
    }


def _link(parameters: Any) -> dict[str, Any]:
    """Mass, centre of mass and principal inertias of what moves with a joint."""
    mass, center, about = mass_and_center(parameters)
    return {"mass": mass, "center_of_mass": center.tolist(), "principal": np.linalg.eigvalsh(about).tolist()}
