"""Pictures of a run; rendering needs packages and an OpenGL that not every machine has."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.parameters import Value
from pidtsm_core.recording import Recording
from pidtsm_core.robots import find_description
from pidtsm_core.robots.placement import link_placements
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies.replay import HEIGHT, RATE, WIDTH, Replay, check_video, check_viewer

SCENE = """<mujoco><worldbody><geom type="plane" size="2 2 0.1"/>
<body name="box" pos="2 0 1"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body></worldbody></mujoco>"""

LACKS_OPENGL = 77
PROGRAM = f"""
import sys
from pathlib import Path
from pidtsm_core.errors import UsageError
from pidtsm_studies.replay import check_video, write_video
try:
    check_video()
except UsageError as error:
    print(error)
    sys.exit({LACKS_OPENGL})
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.experiment import make_experiment
experiment = make_experiment(None, duration=0.5, robot="panda")
write_video(rollout(experiment), experiment.values["simulator"], Path(sys.argv[1]))
"""


def ran(robot: str, *overrides: str) -> tuple[Recording, dict[str, Value]]:
    """A short run, and the parameters of its simulator."""
    experiment = make_experiment(None, duration=0.5, overrides=overrides, robot=robot)
    return rollout(experiment), experiment.values["simulator"]


@pytest.mark.parametrize("robot", ["two_link", "panda"])
def test_a_replay_moves_the_arm_as_recorded(robot: str) -> None:
    recording, simulator = ran(robot)
    replay = Replay(recording, simulator)
    assert replay.model.ngeom > 1
    times = []
    for now in replay.frames(RATE):
        times.append(now)
        k = round(1000 * now)
        if robot == "panda":
            placed = link_placements(find_description({"robot.description": robot}), recording.position[k])[-1, :, 3]
            np.testing.assert_allclose(replay.data.body("tool").xpos, placed, atol=1e-9)
    np.testing.assert_allclose(times, np.arange(len(times)) / RATE, atol=1.1e-3)
    assert len(times) == round(0.5 * RATE)


def test_other_bodies_of_a_scene_move_in_a_replay(tmp_path: Path) -> None:
    file = tmp_path / "scene.xml"
    file.write_text(SCENE, encoding="utf-8")
    replay = Replay(*ran("panda", "simulator.engine=mujoco", f"simulator.scene={file}"))
    for _ in replay.frames(RATE):
        pass
    assert replay.data.body("box").xpos[2] < 0.2


def test_an_arm_without_shapes_has_a_skeleton() -> None:
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="{{0}}"><inertial><mass value="1"/>{inertia}</inertial></link>'
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="0.3 0 0"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="50" velocity="2"/></joint>'
    )
    links = (link.format("upper"), link.format("lower"))
    parts = (*links, joint.format("a", "base", "upper"), joint.format("b", "upper", "lower"))
    replay = Replay(*ran(f'<robot name="arm"><link name="base"/>{"".join(parts)}</robot>'))
    assert replay.model.ngeom >= 1


def test_a_video_shows_the_run(tmp_path: Path) -> None:
    """In another process, since MuJoCo chooses its OpenGL when it is imported."""
    av = pytest.importorskip("av")
    done = subprocess.run([sys.executable, "-c", PROGRAM, str(tmp_path)], capture_output=True, text=True)
    if done.returncode == LACKS_OPENGL:
        pytest.skip(done.stdout)
    assert done.returncode == 0, done.stderr
    with av.open(str(tmp_path / "video.mp4")) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(frames) == round(0.5 * RATE)
    assert frames[0].shape == (HEIGHT, WIDTH, 3)
    assert frames[0].std() > 5.0
    assert (tmp_path / "still.png").stat().st_size > 1000


def test_what_is_missing_for_pictures_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(UsageError, match="--video needs av: python -m pip install av pyopengl"):
        check_video()
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(UsageError, match="--viewer needs a display"):
        check_viewer()
