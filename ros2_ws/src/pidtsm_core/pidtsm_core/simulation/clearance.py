"""Whether postures of an arm keep clear of the arm itself and of its surroundings, by their shapes in MuJoCo."""

from collections.abc import Mapping

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import resolve
from pidtsm_core.robots import find_robot
from pidtsm_core.robots.compiler import compile_spec, load_mujoco
from pidtsm_core.robots.rigid_bodies import PAYLOAD
from pidtsm_core.simulation.mujoco_model import ENGINE, MUJOCO, SCENE, of_arm, shapes_in_scene
from pidtsm_core.simulation.mujoco_payload import DROPPED
from pidtsm_core.simulation.plant import plant_schema

_ARM, _SCENE = 1, 2
"""Bits of what collides with what."""
_POSTURES = 512
_HALVINGS = 5
"""How often an interval is halved: a box is then known to 3 % of the largest one."""


class Clearance:
    """An arm with its shapes, alone or in a scene, which rests.

    The shapes of a URDF are its collision elements, else its visual ones. Parts of the arm with at most two joints
    between them, and those that are near each other at home, are not judged: shapes overlap at joints, and the limits
    of joints keep neighbours apart. Nor is the first moving link against shapes of the scene that it is near at home:
    it is mounted there.

    Attributes:
        scene: path of the MJCF file of the surroundings; empty: there are none.
        home: posture from which the arm sets out, shape (joints,), rad or m.
    """

    def __init__(self, arm: Mapping[str, object], scene: str, home: Array, distance: float) -> None:
        """Compile the shapes.

        Args:
            arm: parameters that choose the arm.
            scene: path of an MJCF file, as the simulator's parameter ``scene``; empty: nothing is around the arm.
            home: see the class.
            distance: nearest that parts may be to each other, m.

        Raises:
            ParameterError: MuJoCo cannot read the arm or the scene, or the arm has no shapes.
        """
        self.scene, self.home = scene, home
        robot = find_robot(arm)
        chosen = {**arm, ENGINE.name: MUJOCO, SCENE.name: scene}
        known = {parameter.name for parameter in plant_schema(chosen)}
        values = resolve(
            plant_schema, {name: each for name, each in chosen.items() if name in known}, len(robot.joints)
        )
        spec, prefix = shapes_in_scene(values), of_arm(scene)
        for geom in spec.geoms:
            body = geom.parent.name
            own = body.startswith(prefix)
            touches = (geom.contype or geom.conaffinity) and body not in (prefix + PAYLOAD, DROPPED)
            geom.contype, geom.conaffinity = (_ARM, _ARM | _SCENE) if own else (_SCENE, _ARM)
            if not touches:
                geom.contype = geom.conaffinity = 0
            geom.margin = distance if own else 0.0
        self._mujoco, self._model, self._distance = load_mujoco(), compile_spec(spec), distance
        self._data = self._mujoco.MjData(self._model)
        self._places = [int(self._model.joint(prefix + name).qposadr[0]) for name in robot.joints]
        bodies = range(self._model.nbody)
        # Without a scene, even what stands still is the arm's.
        self._own = [not scene or (body > 0 and self._model.body(body).name.startswith(prefix)) for body in bodies]
        self._beside: set[tuple[int, int]] = set()
        self._mounted: set[tuple[int, int]] = set()
        parents = self._model.body_parentid
        near = self._near(home, distance)
        # A pair of a body and what stands still would leave out all of the scene.
        of_two_joints = [(int(parents[parents[body]]), body) for body in bodies]
        self._beside |= {(a, b) for a, b in of_two_joints if self._own[a] and self._own[b]}
        for pair in near:
            a, b = self._bodies(pair)
            if self._own[a] and self._own[b]:
                self._beside.add((a, b))
            elif any(self._own[body] and self._model.body_weldid[parents[body]] == 0 for body in (a, b)):
                self._mounted.add(pair)

    def _near(self, q: Array, distance: float) -> list[tuple[int, int]]:
        """Shapes that are nearer to each other at q than a distance (m), except of bodies beside each other."""
        model, data = self._model, self._data
        data.qpos[self._places] = q
        self._mujoco.mj_kinematics(model, data)
        self._mujoco.mj_collision(model, data)
        pairs = [(int(min(each)), int(max(each))) for each in data.contact.geom[data.contact.dist < distance]]
        return [pair for pair in pairs if pair not in self._mounted and self._bodies(pair) not in self._beside]

    def _bodies(self, geoms: tuple[int, int]) -> tuple[int, int]:
        """Those of two shapes, the smaller index first."""
        a, b = (int(self._model.geom_bodyid[geom]) for geom in geoms)
        return min(a, b), max(a, b)

    def is_clear(self, q: Array) -> bool:
        """Whether nothing is too near to anything at q, shape (joints,), rad or m."""
        return not self._near(q, self._distance)

    def too_near(self, q: Array, distance: float) -> str:
        """What is nearer to each other at q than a distance, as text; empty: nothing.

        Args:
            q: posture, shape (joints,), rad or m.
            distance: at most that of the arm, m.
        """
        pairs = {tuple(sorted(self._name(geom) for geom in pair)) for pair in self._near(q, distance)}
        return ", ".join(f"{a} and {b}" for a, b in sorted(pairs))

    def _name(self, geom: int) -> str:
        """Of the body of a shape; of the shape itself, if it is not of the arm and has one."""
        body = int(self._model.geom_bodyid[geom])
        own = self._model.body(body).name.removeprefix(of_arm(self.scene))
        return own if self._own[body] else self._model.geom(geom).name or own


def free_box(clearance: Clearance, most: Array) -> Array:
    """How far each joint may be from home, whatever the others do within theirs, so that the arm keeps clear.

    First all are allowed the same share of `most`; then each in turn more, from the last joint on. This is judged in
    hundreds of postures, half of them corners of the box, so it is likely, not certain.

    Args:
        clearance: the arm.
        most: largest distances of interest, shape (joints,), rad or m.

    Returns:
        Distances, shape (joints,), at most `most`; all 0 if the arm is not clear at home.
    """
    from scipy.stats import qmc  # Takes long to import.

    inside = qmc.Sobol(most.size, scramble=False).random(_POSTURES // 2)
    corners = np.random.default_rng(1).choice([-1.0, 1.0], size=(_POSTURES // 2, most.size))
    postures = [np.zeros(most.size), *corners, *(2.0 * inside - 1.0)]

    def is_free(box: Array) -> bool:
        for k, each in enumerate(postures):
            if not clearance.is_clear(clearance.home + box * each):
                postures.insert(0, postures.pop(k))  # It is likely to be the first one that is not clear again.
                return False
        return True

    def widest(narrow: Array, wide: Array) -> Array:
        if is_free(wide):
            return wide
        for _ in range(_HALVINGS):
            middle = 0.5 * (narrow + wide)
            narrow, wide = (middle, wide) if is_free(middle) else (narrow, middle)
        return narrow

    found = widest(np.zeros(most.size), most)
    for j in reversed(range(most.size)):
        found = widest(found, np.where(np.arange(most.size) == j, most, found))
    return found
