"""A slider for the stiffness with which the reference of the controller yields."""

import time
from typing import Any

from viser import GuiEvent

from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.forms import NodeForms

_SPACE, _NAME = "compliance.space", "compliance.stiffness"
_LEAST, _MOST, _STEP = 50.0, 3000.0, 10.0
"""N/m."""
_RESTS = 0.3
"""Time after which a slider that was moved rests, s; its value is then set."""


class Stiffness:
    """Sets the stiffness of the tool along x, y and z; that about them, and the limits, are in the form."""

    def __init__(self, desk: Desk, forms: NodeForms) -> None:
        """Add the slider to the current container; `forms`: of the controller, built later."""
        self._desk, self._forms = desk, forms
        hint = f"{_NAME} along x, y, z; it acts while {_SPACE} is tool"
        self._slider = desk.server.gui.add_slider("stiffness [N/m]", _LEAST, _MOST, _STEP, 1000.0, hint=hint)
        self._moved: tuple[float, Any] | None = None  # when (s), and by which browser

        @self._slider.on_update
        def _(event: GuiEvent[Any]) -> None:
            if event.client is not None:
                self._moved = time.monotonic(), event.client

    def show(self) -> None:
        """Set what was chosen, or show what is."""
        values = self._forms.values.get(_NAME)
        if self._slider.visible != (values is not None):
            self._slider.visible = values is not None
        if values is None:
            return
        if self._moved is None:
            known = min(max(float(values[0]), _LEAST), _MOST)
            if abs(known - self._slider.value) > 0.5 * _STEP:
                setattr(self._slider, "value", known)  # noqa: B010  viser's types do not know that it can be set.
        elif time.monotonic() - self._moved[0] > _RESTS:
            (_, client), self._moved = self._moved, None
            wanted = [float(self._slider.value)] * 3 + [float(value) for value in values[3:]]
            self._desk.run(self._forms.submit(client, {_NAME: wanted}))
