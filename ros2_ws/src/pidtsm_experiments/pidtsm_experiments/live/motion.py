"""Controls of the reference."""

import math
from collections.abc import Sequence

from pidtsm_core.arrays import Array
from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.parameters import shown, written

_LASTS = 3.0
_LONGEST = 600.0  # s


class Moving:
    """Starts the built-in motion, brings the reference to rest, or moves it to the arm or to positions."""

    def __init__(self, desk: Desk, joints: Sequence[str], position: Array) -> None:
        """Add the controls to the current container; `position`: to start from, shape (joints,), rad or m."""
        self._desk, self._joints, gui = desk, list(joints), desk.server.gui
        begin = "start the built-in motion of the trajectory node again (~/begin)"
        desk.button("Start the motion again", self.begin, begin, moves=True)
        go = "move the reference to where the arm is, as an activation demands (~/go_to_arm)"
        desk.button("Go to the arm", self._go_to_arm, go, moves=True)
        desk.button("Rest", self._rest, "bring the reference to rest (a trajectory without points)")
        with gui.add_folder("Go to"):
            hint = f"positions of {', '.join(joints)} (rad or m)"
            self._target = gui.add_text("positions", shown(position), hint=hint)
            self._lasts = gui.add_number("in [s]", _LASTS, min=0.1, max=_LONGEST, step=0.1, hint="duration")
            desk.button("Go", self._go, "move the reference there, at rest at the end (joint_trajectory)", moves=True)

    async def begin(self) -> None:
        """Start the built-in motion.

        Raises:
            RefusedError: the trajectory node refuses.
        """
        await self._desk.system.trigger("trajectory/begin")
        self._desk.system.note("built-in motion started")

    async def _go_to_arm(self) -> None:
        await self._desk.system.trigger("trajectory/go_to_arm")
        self._desk.system.note("reference moves to the arm")

    async def _rest(self) -> None:
        self._desk.system.rest()
        self._desk.system.note("reference comes to rest")

    async def _go(self) -> None:
        target = written(str(self._target.value))
        values = target if isinstance(target, list) else [target]
        if len(values) != len(self._joints) or not all(
            isinstance(value, (int, float)) and math.isfinite(value) for value in values
        ):
            raise RefusedError(f"positions: {self._target.value!r} must be {len(self._joints)} finite numbers")
        lasts = min(max(float(self._lasts.value), 0.1), _LONGEST)
        if math.isnan(lasts):
            raise RefusedError("in: the duration must be a number")
        self._desk.system.move(self._joints, [float(value) for value in values], lasts)
        self._desk.system.note(f"reference moves to {shown(values)} in {lasts:g} s")
