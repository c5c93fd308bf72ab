"""Friction that sticks, judged by the LuGre model with its published parameters, and its dependences."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.testarms import PENDULUM, Arm, dotted

from pidtsm_core.arrays import Array
from pidtsm_core.robots.tree.layout import GRAVITY
from pidtsm_core.simulation.plant import Plant, plant_schema

DT = 0.001
ENGINES = ("rigid_body", "mujoco")
BLOCK = Arm(
    '<robot name="block"><link name="base"/><link name="mass"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="slide" type="prismatic">'
    '<parent link="base"/><child link="mass"/><axis xyz="1 0 0"/>'
    '<limit lower="-50" upper="50" effort="100" velocity="10"/></joint></robot>',
    (0.0,),
)
"""1 kg that slides horizontally."""
ELASTIC = {"elasticity__stiffness": 1e4, "elasticity__damping": 1.0, "robot__armature": 0.5}


def block(**changes: object) -> Plant:
    return Plant(BLOCK.values(plant_schema, {"initial_position": 0.0, **dotted(changes)}))


def pushed(plant: Plant, effort: float, steps: int, start: int = 0) -> Array:
    """Positions of the motor under a constant force."""
    positions = []
    for k in range(start, start + steps):
        plant.step(np.full(1, effort), k * DT, DT)
        positions.append(plant.state.drivetrain.motor[0])
    return np.array(positions)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("elastic", [{}, ELASTIC], ids=["rigid", "elastic"])
def test_a_joint_sticks_below_its_breakaway_and_slides_above(engine: str, elastic: dict[str, float]) -> None:
    friction = {"friction__coulomb": 4.0, "friction__static": 5.0, "friction__bristle_stiffness": 1e7}
    held = pushed(block(engine=engine, **friction, **elastic), 0.8 * 5.0, 10_000)
    assert np.abs(held).max() < 1e-6
    assert np.ptp(held[1000:]) < 1e-9
    assert pushed(block(engine=engine, **friction, **elastic), 1.2 * 5.0, 500)[-1] > 0.01


def test_a_joint_does_not_creep_under_a_vibrating_load() -> None:
    """LuGre's does (Dupont et al., 2002, section I)."""
    plant, places = block(friction__coulomb=1.0, friction__static=1.5, friction__bristle_stiffness=1e5), []
    for k in range(10_000):
        plant.step(np.full(1, 0.8 + 0.3 * math.sin(50.0 * k * DT)), k * DT, DT)
        places.append(plant.state.position[0])
    assert np.ptp([np.mean(places[i : i + 1257]) for i in (1000, 8000)]) < 1e-9


_LUGRE = {"s0": 1e5, "s1": math.sqrt(1e5), "s2": 0.4, "fc": 1.0, "fs": 1.5, "vs": 0.001}
_SPRING, _PULL = 2.0, 0.1
"""N/m and m/s."""


def lugre() -> tuple[Array, Array]:
    """Times and positions of the stick-slip of C. Canudas de Wit et al., IEEE Trans. Automat. Contr. 40 (1995), III.B,
    by SciPy."""
    s0, s1, s2, fc, fs, vs = _LUGRE.values()

    def rate(t: float, y: Array) -> list[float]:
        x, v, z = y
        dz = v - s0 * abs(v) * z / (fc + (fs - fc) * math.exp(-((v / vs) ** 2)))
        return [v, _SPRING * (_PULL * t - x) - s0 * z - s1 * dz - s2 * v, dz]

    found = solve_ivp(rate, (0.0, 22.0), [0.0] * 3, method="Radau", rtol=1e-7, atol=1e-10, t_eval=np.arange(0, 22, DT))
    return found.t, found.y[0]


def slips(t: Array, x: Array) -> tuple[float, float]:
    """Period (s) and length (m) of the slips of a pulled mass."""
    moves = np.gradient(x, t) > 0.01
    begin, end = np.flatnonzero(np.diff(moves.astype(int)) == 1), np.flatnonzero(np.diff(moves.astype(int)) == -1)
    return float(t[begin[1]] - t[begin[0]]), float(x[end[0]] - x[begin[0]])


@pytest.mark.parametrize("engine", ENGINES)
def test_a_pulled_mass_sticks_and_slips_as_published(engine: str) -> None:
    plant = block(
        engine=engine,
        friction__coulomb=1.0,
        friction__static=1.5,
        friction__stribeck_velocity=0.001,
        friction__viscous=0.4,
        friction__bristle_stiffness=1e5,
        friction__bristle_damping=math.sqrt(1e5),
    )
    t, x = np.linspace(0.0, 22.0, 22_000, endpoint=False), []
    for k in range(22_000):
        x.append(plant.state.position[0])
        plant.step(np.full(1, _SPRING * (_PULL * (k + 0.5) * DT - x[-1])), k * DT, DT)
    period, length = slips(t, np.array(x))
    published = slips(*lugre())
    assert period == pytest.approx(published[0], rel=0.05)
    assert length == pytest.approx(published[1], rel=0.05)
    # A spring that pulls at a constant velocity covers what slips.
    assert length == pytest.approx(period * _PULL, rel=0.01)


@pytest.mark.parametrize("sticks", [0.0, 1e5])
def test_friction_differs_between_directions(sticks: float) -> None:
    for sign, level in ((1.0, 1.2), (-1.0, 0.8)):
        plant = block(friction__coulomb=1.0, friction__asymmetry=0.2, friction__bristle_stiffness=sticks)
        pushed(plant, sign * 3.0, 500)
        before = plant.state.derivatives[0, 0]
        pushed(plant, sign * 3.0, 100, 500)
        assert abs(plant.state.derivatives[0, 0] - before) / 0.1 == pytest.approx(3.0 - level, rel=1e-3)


@pytest.mark.parametrize("elastic", [{}, ELASTIC], ids=["rigid", "elastic"])
def test_friction_grows_with_the_load(elastic: dict[str, float]) -> None:
    """10 % of what the gear transmits."""
    plant = block(friction__load=0.1, friction__bristle_stiffness=1e5, **elastic)
    pushed(plant, 3.0, 2000)
    before = plant.state.derivatives[0, 0]
    pushed(plant, 3.0, 1000, 2000)
    mass = 1.0 + (elastic.get("robot__armature", 0.0))
    carried = (plant.state.derivatives[0, 0] - before) / 1.0
    # The link of 1 kg is accelerated by what is transmitted, so that (mass + 0.1) a = 3.
    assert carried == pytest.approx(3.0 / (mass + 0.1), rel=1e-2)


def test_friction_falls_while_the_joint_warms_up() -> None:
    levels = []
    for t in (0.0, 2.0, 20.0):
        plant = block(friction__coulomb=1.0, friction__cold=0.5, friction__warm_up=2.0, friction__bristle_stiffness=1e5)
        start = round(t / DT)
        pushed(plant, 3.0, 10, start)
        before = plant.state.derivatives[0, 0]
        pushed(plant, 3.0, 10, start + 10)
        levels.append(3.0 - (plant.state.derivatives[0, 0] - before) / 0.01)
    np.testing.assert_allclose(levels, [1.0 + 0.5 * math.exp(-t / 2.0) for t in (0.015, 2.015, 20.015)], rtol=1e-3)


def test_cogging_has_the_period_that_is_set() -> None:
    """The joint rests where the cogging carries it: A sin(n q) = force."""
    plant = block(friction__cogging=2.0, friction__cogging_periods=50, friction__viscous=20.0)
    pushed(plant, 1.0, 4000)
    assert plant.state.position[0] == pytest.approx(math.asin(0.5) / 50, rel=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_smooth_curve_stays_the_same_in_a_stiff_drive_train(engine: str) -> None:
    smooth = {"friction__coulomb": 2.0, "friction__static": 3.0, "friction__viscous": 0.5}
    ends = []
    for stiffness in (0.0, 1e5):
        plant = Plant(
            PENDULUM.values(
                plant_schema,
                dotted({**smooth, "engine": engine, "elasticity__stiffness": stiffness, "initial_position": 0.0}),
            )
        )
        for k in range(300):
            plant.step(np.full(1, 25.0), k * DT, DT)
        ends.append(plant.state.position[0])
    assert 0.3 < abs(ends[0]) < 1.9
    assert ends[1] == pytest.approx(ends[0], rel=2e-3)


def test_friction_without_gravity_keeps_a_joint_at_rest_bit_for_bit() -> None:
    plant = block(friction__coulomb=1.0, friction__bristle_stiffness=1e5)
    plant.config.model.parameters[:GRAVITY] = 0.0
    assert (pushed(plant, 0.0, 100) == 0.0).all()


@pytest.mark.parametrize("engine", ENGINES)
def test_friction_that_is_switched_on_holds_the_joint_where_it_is(engine: str) -> None:
    plant = block(engine=engine)
    pushed(plant, 5.0, 500)
    pushed(plant, -5.0, 500, 500)
    held = plant.state.position[0]
    assert held > 1.0
    sticking = {"friction.coulomb": 10.0, "friction.bristle_stiffness": 1e6, "engine": engine, "initial_position": 0.0}
    plant.set_parameters(BLOCK.values(plant_schema, sticking))
    for k in range(1000, 1500):
        plant.step(np.full(1, 5.0), k * DT, DT)
        assert abs(plant.state.position[0] - held) < 0.01
