"""How the metrics of a run are named and shown: the one definition for terminal, pages and figures.

`pidtsm_core.recording.metrics` computes them. A table chooses its own order of columns.
"""

from dataclasses import dataclass

from pidtsm_core.units import JointUnits


@dataclass(frozen=True)
class Metric:
    """A metric of each joint.

    Attributes:
        key: in metrics.json.
        name: in texts and in the first column of a table.
        about: what it is, in a few words; {position} and {effort} are the units of all joints.
        heading: of a narrow column.
        unit: SI unit, in which {position} and {effort} are those of a joint.
        factor: of the value, if the unit is another one than in metrics.json.
        judged: whether the largest value is the worst.
        only_if_any: whether a table of the terminal leaves it out if it is 0 for every joint.
    """

    key: str
    name: str
    about: str
    heading: str
    unit: str = ""
    factor: float = 1.0
    judged: bool = True
    only_if_any: bool = False

    def unit_of(self, units: JointUnits) -> str:
        """SI unit for a joint."""
        return self.unit.format(**units._asdict())


RMSE = Metric("rmse", "RMSE", "root of the mean of e²", "RMSE", "{position}")
LARGEST_ERROR = Metric("max_error", "largest error", "max |e|", "largest error", "{position}")
STEADY_STATE_ERROR = Metric(
    "steady_state_error", "steady-state error", "max |e| over the last 40 % of the run", "steady error", "{position}"
)
SETTLING_TIME = Metric("settling_time", "settling time", "until |e| stays below 2 % of its start", "settling", "s")
RECOVERY_TIME = Metric(
    "recovery_time", "recovery time", "from the event until |e| stays below 10⁻³ {position}", "recovery", "s"
)
SATURATION = Metric(
    "saturation", "at a limit", "of the effort or its rate, share of the samples", "at limit", "%", factor=100.0
)
MEAN_EFFORT = Metric("eci", "mean effort (ECI)", "mean |τ|", "mean effort", "{effort}", judged=False)
EFFORT_VARIATION = Metric(
    "torque_variation", "effort variation", "mean change from sample to sample", "effort variation", "{effort}"
)
EFFORT_VARIATION_RATE = Metric(
    "torque_variation_rate", "effort variation rate", "the same per second", "variation rate", "{effort}/s"
)
EFFORT_JUMPS = Metric(
    "torque_jumps", "effort jumps", "samples at which it changes by more than 5 {effort}", "effort jumps"
)
TIME_AT_EFFORT_LIMIT = Metric(
    "time_at_effort_limit", "at the effort limit", "time", "effort limit", "s", only_if_any=True
)
TIME_AT_RATE_LIMIT = Metric("time_at_rate_limit", "at the rate limit", "time", "rate limit", "s", only_if_any=True)
ADAPTIVE_GAIN = Metric("adaptive_gain", "adaptive gain Υ", "at the end", "adaptive gain", judged=False)

METRICS = (
    LARGEST_ERROR,
    RMSE,
    STEADY_STATE_ERROR,
    MEAN_EFFORT,
    SATURATION,
    RECOVERY_TIME,
    SETTLING_TIME,
    EFFORT_VARIATION,
    EFFORT_VARIATION_RATE,
    EFFORT_JUMPS,
    TIME_AT_EFFORT_LIMIT,
    TIME_AT_RATE_LIMIT,
    ADAPTIVE_GAIN,
)
"""Every metric, in the order of tables; where not all of them fit, the last ones are left out."""
