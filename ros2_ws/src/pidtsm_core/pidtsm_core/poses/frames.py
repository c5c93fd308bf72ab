"""Frames that are given relative to each other, as on the topics tf and tf_static."""

from collections.abc import Callable

from pidtsm_core.poses.pose import NOWHERE_ELSE, Pose
from pidtsm_core.trajectories.errors import TrajectoryError

_DEEPEST = 200
"""Largest number of frames on the way to the root; more are a loop."""


class Frames:
    """A tree of frames, each given in its parent. Of a frame that moves, the newest pose counts.

    Attributes:
        names: of the frames.
    """

    def __init__(self, prefix: str = "") -> None:
        """Args: prefix: that frames of the arm have outside, and not in the description."""
        self._prefix = prefix
        self._parents: dict[str, tuple[str, Pose]] = {}

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._parents)

    def place(self, child: str, parent: str, pose: Pose) -> None:
        """Set the pose of a frame in its parent."""
        self._parents[self._bare(child)] = self._bare(parent), pose

    def find(self, frame: str, base: str, link: Callable[[str], Pose | None]) -> Pose:
        """A frame in the base frame.

        Args:
            frame: its name; empty: the base frame.
            base: name of the base frame.
            link: pose of a frame of the arm in the base frame; None: it has none of this name.

        Raises:
            TrajectoryError: nothing leads from the frame to the base frame.
        """
        if not frame.lstrip("/"):
            return NOWHERE_ELSE
        frame, given = self._bare(frame), frame.lstrip("/")
        from_root, pose = {}, NOWHERE_ELSE
        for name, placed in self._way(frame):
            pose = placed @ pose
            if (of_arm := link(name)) is not None:
                return of_arm @ pose
            from_root[name] = pose
        below = NOWHERE_ELSE
        for name, placed in self._way(base):
            below = placed @ below
            if name in from_root:
                return below.inverse @ from_root[name]
        raise TrajectoryError(f"frame_id {given}: the arm has no such link, and tf has no way from it to {base}")

    def _bare(self, frame: str) -> str:
        """The name in the description; that of a frame which is not of the arm begins with / if there is a prefix."""
        name = frame.lstrip("/")
        return name.removeprefix(self._prefix) if name.startswith(self._prefix) else f"/{name}"

    def _way(self, frame: str) -> list[tuple[str, Pose]]:
        """The frame and those that carry it, up to the root, each with the pose of the one before in it."""
        way = [(frame, NOWHERE_ELSE)]
        while way[-1][0] in self._parents and len(way) < _DEEPEST:
            way.append(self._parents[way[-1][0]])
        return way
