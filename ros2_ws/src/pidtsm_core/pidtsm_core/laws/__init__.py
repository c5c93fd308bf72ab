"""Control laws: from errors to acceleration. One law per file; `LAWS` contains the laws imported here."""

from pidtsm_core.laws.base import STATE_SLOTS, ArmSample, Demand, Integers, Law, LawConfig
from pidtsm_core.laws.calls import advance, advance_arm, command, command_arm, make_law
from pidtsm_core.laws.computed_torque import COMPUTED_TORQUE
from pidtsm_core.laws.disturbance_observer import DISTURBANCE_OBSERVER
from pidtsm_core.laws.dtsm import DTSM
from pidtsm_core.laws.impedance import IMPEDANCE
from pidtsm_core.laws.integral_sliding_mode import INTEGRAL_SLIDING_MODE
from pidtsm_core.laws.linear_quadratic import LINEAR_QUADRATIC
from pidtsm_core.laws.pid import PID
from pidtsm_core.laws.piddtsm import PIDDTSM
from pidtsm_core.laws.pidnftsm import PIDNFTSM
from pidtsm_core.laws.predictive import PREDICTIVE
from pidtsm_core.laws.reaching import Interval
from pidtsm_core.laws.sliding_mode import SLIDING_MODE
from pidtsm_core.laws.slotine_li import SLOTINE_LI
from pidtsm_core.laws.super_twisting import SUPER_TWISTING
from pidtsm_core.laws.time_delay import TIME_DELAY
from pidtsm_core.parameters.family import Family

__all__ = [
    "LAWS",
    "STATE_SLOTS",
    "ArmSample",
    "Demand",
    "Integers",
    "Interval",
    "Law",
    "LawConfig",
    "advance",
    "advance_arm",
    "command",
    "command_arm",
    "make_law",
]

LAWS: Family[Law] = Family.of(Law, "laws", globals(), "pidtsm_core.laws.trial")
