"""A run once more, as a picture: the arm moves as recorded, and what surrounds it as MuJoCo computes."""

import math
import os
import time
from collections.abc import Iterator, Mapping
from copy import copy
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.errors import UsageError
from pidtsm_core.parameters import Value, as_float
from pidtsm_core.recording import Recording
from pidtsm_core.robots.rigid_bodies import PICTURE
from pidtsm_core.simulation.mujoco_model import with_engine
from pidtsm_core.simulation.mujoco_payload import Phase
from pidtsm_core.simulation.mujoco_plant import MujocoArm, drop
from pidtsm_core.timing import sum_of_times

WIDTH, HEIGHT = PICTURE
RATE = 30
"""Pictures per second."""
_OF_PHASE = ("geom_rgba", "geom_contype", "geom_conaffinity", "body_contype", "body_conaffinity", "body_gravcomp")
"""Arrays of a model that depend on where the payload is."""
_FACTORS = {"mass": 1.0, "inertia": 1.0, "length": 1.0}
_AZIMUTH, _ELEVATION, _DISTANCE = 60.0, -20.0, 3.0
"""Direction in which the camera looks, degrees, and its distance as a multiple of the size of the arm."""


class Replay:
    """The arm of a run in its scene.

    Attributes:
        model, data: of type ``mujoco.MjModel`` and ``mujoco.MjData``.
    """

    def __init__(self, recording: Recording, simulator: Mapping[str, Value]) -> None:
        """Args: recording: of the run; simulator: every parameter of its simulator.

        Raises:
            ParameterError: MuJoCo cannot show the arm.
        """
        import mujoco

        self._mujoco, self._recording = mujoco, recording
        values = with_engine(simulator)
        self._arm = MujocoArm(values, _FACTORS, np.zeros(len(recording.joints)), shown=True)
        models = self._arm.models
        self.model, self.data = copy(models.empty), self._arm.data
        self._picked_up, carried = as_float(values["payload.time"]), as_float(values["payload.duration"])
        self._dropped = sum_of_times(self._picked_up, carried) if carried else math.inf
        self._phase = Phase.ABSENT
        # A recording has the names of the simulator's joints, in its order.
        joints = list(models.joints)
        self._positions, self._velocities = self.model.jnt_qposadr[joints], self.model.jnt_dofadr[joints]
        self._bodies = list(models.bodies)
        self._moves = self.model.nv > len(joints)

    def frames(self, rate: float) -> Iterator[float]:
        """Move on, `rate` times in a second; yields the time, s."""
        times = self._recording.time
        shown = 0
        for k, now in enumerate(times):
            self._place(k)
            self._carry(float(now))
            if now >= times[0] + shown / rate:
                self._mujoco.mj_forward(self.model, self.data)
                yield float(now)
                shown += 1
            if self._moves and k + 1 < times.size:
                self.model.opt.timestep = times[k + 1] - now
                self._mujoco.mj_step(self.model, self.data)

    def _place(self, k: int) -> None:
        """Put the arm where it was at sample k."""
        self.data.qpos[self._positions] = self._recording.position[k]
        self.data.qvel[self._velocities] = self._recording.velocity[k]

    def _carry(self, now: float) -> None:
        """Show the payload where it is at the time, s."""
        phase = Phase.ABSENT if now < self._picked_up else Phase.CARRIED if now < self._dropped else Phase.DROPPED
        if phase == self._phase:
            return
        self._phase, models = phase, self._arm.models
        if phase == Phase.DROPPED and models.dropped:
            self._mujoco.mj_forward(self.model, self.data)
            drop(self._arm.config, self._arm.state)
        source = (models.empty, models.loaded, models.left)[phase]
        for name in _OF_PHASE:
            getattr(self.model, name)[:] = getattr(source, name)

    def camera(self) -> Any:
        """A camera of type ``mujoco.MjvCamera`` that looks at the arm where it starts."""
        self._place(0)
        self._mujoco.mj_forward(self.model, self.data)
        places = self.data.xpos[self._bodies]
        lower, upper = places.min(axis=0), places.max(axis=0)
        camera = self._mujoco.MjvCamera()
        camera.lookat = 0.5 * (lower + upper)
        camera.azimuth, camera.elevation = _AZIMUTH, _ELEVATION
        camera.distance = _DISTANCE * float(np.linalg.norm(upper - lower))
        return camera


def check_video() -> None:
    """Check that this machine can render and encode; call it before MuJoCo is imported.

    Raises:
        UsageError: a package or OpenGL is missing; the message shows the cure.
    """
    os.environ.setdefault("MUJOCO_GL", "egl")  # Without a display; Mesa renders on the processor without a GPU.
    missing = "python -m pip install av pyopengl"
    try:
        import av  # noqa: F401
        import OpenGL  # noqa: F401
    except ImportError as error:
        raise UsageError(f"--video needs {error.name}: {missing}") from None
    try:
        import mujoco

        mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 8, 8).close()
    except Exception as error:  # Each backend of OpenGL raises its own.
        reason = " ".join(str(error).split())
        raise UsageError(
            f"--video needs OpenGL without a display ({reason}); install Mesa's EGL (Debian, Ubuntu: libegl1 "
            "libgl1-mesa-dri), or choose another backend with MUJOCO_GL=osmesa"
        ) from None


def write_video(recording: Recording, simulator: Mapping[str, Value], folder: Path) -> list[Path]:
    """Render a run to ``video.mp4``, and its last picture to ``still.png``; returns the files.

    Args:
        recording: the run.
        simulator: every parameter of its simulator.
        folder: where the files go.

    Raises:
        ParameterError: MuJoCo cannot show the arm.
    """
    import av
    import mujoco
    from matplotlib.image import imsave

    replay, files = Replay(recording, simulator), [folder / "video.mp4", folder / "still.png"]
    camera, picture = replay.camera(), np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    with mujoco.Renderer(replay.model, HEIGHT, WIDTH) as renderer, av.open(str(files[0]), "w") as container:
        stream = container.add_stream("libx264", rate=RATE)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for _ in replay.frames(RATE):
            renderer.update_scene(replay.data, camera)
            picture = renderer.render()
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    imsave(files[1], picture)
    return files


def check_viewer() -> None:
    """Check that MuJoCo's viewer can open a window.

    Raises:
        UsageError: there is no display, or a package is missing.
    """
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UsageError("--viewer needs a display, and neither DISPLAY nor WAYLAND_DISPLAY is set; use --video")
    try:
        import glfw  # noqa: F401
        import OpenGL  # noqa: F401
    except ImportError as error:
        raise UsageError(f"--viewer needs {error.name}: python -m pip install glfw pyopengl") from None


def show(recording: Recording, simulator: Mapping[str, Value]) -> None:
    """Play a run in MuJoCo's viewer, again and again until its window is closed.

    Args:
        recording: the run.
        simulator: every parameter of its simulator.

    Raises:
        ParameterError: MuJoCo cannot show the arm.
    """
    from mujoco.viewer import launch_passive

    replay = Replay(recording, simulator)
    with launch_passive(replay.model, replay.data) as viewer:
        while viewer.is_running():
            began = time.monotonic() - float(recording.time[0])
            for now in replay.frames(RATE):
                viewer.sync()
                time.sleep(max(0.0, began + now - time.monotonic()))
                if not viewer.is_running():
                    break
