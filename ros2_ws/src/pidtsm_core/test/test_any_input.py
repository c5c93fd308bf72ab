"""Whatever parameters, descriptions or tables contain: it is used or refused in one line, soon, and in little memory.

The corpus is made here, the same one every time. Scenarios, parameter files and bags have their own, see the tests of
pidtsm_experiments.
"""

import json
import math
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from random import Random
from xml.etree import ElementTree

import numpy as np
import pytest
from support.hostile import Judge, little_memory

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.node_parameters import NODE_SCHEMAS, SCHEMAS
from pidtsm_core.parameters import resolve
from pidtsm_core.references import ReferenceMotion, reference_schema
from pidtsm_core.robots import find_robot
from pidtsm_core.robots.source import read_source
from pidtsm_core.rollouts.closed_loop import DivergedError, rollout

NUMBERS = (
    math.nan,
    math.inf,
    -math.inf,
    0.0,
    -0.0,
    -1.0,
    5e-324,
    1e-320,
    1e-9,
    1e300,
    1.8e308,
    10**400,
    -(2**63),
    2**63,
    7,
)
OTHERS: tuple[object, ...] = (
    True,
    None,
    "",
    "\0",
    "x" * 10_000,
    "\ud800",
    "{",
    [],
    [math.nan, 1.0],
    [1.0] * 1000,
    [[1.0, 2.0], [3.0]],
    ["a", 1],
    {"a": 1},
    b"x",
)
VALUES = (*NUMBERS, *OTHERS)
TEXTS = ("", "nan", "inf", "-1", "0", "1e300", "1e-320", "9" * 400, "x", "1 2", "1 2 3 4", "\u00fc", "${9**9}", "../..")
DESCRIPTIONS, TABLES = 400, 1000
"""Number of each."""
TABLE = "time,q_joint1,q_joint2\n" + "".join(f"{t / 10},{math.sin(t)},{math.cos(t)}\n" for t in range(20))
MJCF = """<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"/><default><joint damping="0.1"/></default>
<asset><hfield name="ground" nrow="3" ncol="3" size="1 1 1 1"/><texture name="t" type="2d" builtin="flat" width="4"
height="4"/><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset><worldbody><body name="a"><joint name="joint1"
axis="0 1 0" range="-1 1" limited="true"/><inertial pos="0 0 -0.1" mass="1" diaginertia="0.1 0.1 0.1"/><geom type="mesh"
mesh="m"/><body name="b" pos="0 0 -1"><joint name="joint2" type="slide"/><inertial pos="0 0 0" mass="1"
diaginertia="1 1 1"/><replicate count="2" offset="0 0 1"><geom size="0.1"/></replicate><site name="tip"/></body></body>
</worldbody><actuator><motor joint="joint1" ctrlrange="-1 1" gear="2"/></actuator>
<custom><numeric name="n" data="1"/></custom></mujoco>"""


@pytest.fixture(scope="module")
def _compiled() -> None:
    """What is compiled and imported takes time and memory of its own."""
    rollout(duration=0.01)
    find_robot({"robot.description": "panda"})


@pytest.fixture(autouse=True)
def _little_memory(_compiled: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """In a folder of its own."""
    monkeypatch.chdir(tmp_path)
    with little_memory():
        yield


@pytest.mark.parametrize("node", SCHEMAS)
def test_any_value_of_a_parameter_is_used_or_refused(node: str) -> None:
    judge, schema = Judge(UsageError, DivergedError), SCHEMAS[node]({})
    for parameter in schema:
        for value in VALUES:

            def use(given: dict[str, object]) -> None:
                experiment = make_experiment("case1", overrides={node: given}, duration=0.005)
                if not isinstance(next(iter(given.values())), str):  # Another law would be compiled.
                    json.dumps(rollout(experiment).metrics(), allow_nan=False)

            judge.use(f"{parameter.name} = {value!r:.50}", partial(use, {parameter.name: value}))
    judge.conclude(10, len(schema) * len(VALUES))


def choices(node: str) -> dict[str, dict[str, object]]:
    """Parameters of a node that its default choices lack, each with the choices that have it."""
    known = {parameter.name for parameter in SCHEMAS[node]({})}
    found: dict[str, dict[str, object]] = {}
    waiting: list[dict[str, object]] = [{}]
    while waiting:
        made = waiting.pop()
        with suppress(UsageError):  # Some are for rollouts only.
            for parameter in NODE_SCHEMAS[node](made):
                if parameter.name not in {*known, *found} or not made:
                    found |= {parameter.name: made} if parameter.name not in known else {}
                    waiting += [made | {parameter.name: choice} for choice in parameter.choices or ()]
    return found


@pytest.mark.parametrize("node", NODE_SCHEMAS)
def test_any_value_of_a_parameter_of_any_choice_is_taken_or_refused(node: str) -> None:
    """Also of those that only nodes have; nothing is simulated."""
    judge, tried = Judge(UsageError), 0
    for name, choice in choices(node).items():
        for value in VALUES:

            def use(given: dict[str, object]) -> None:
                make_experiment("case1", overrides={node: given}).node_values({})

            judge.use(f"{name} = {value!r:.50}", partial(use, choice | {name: value}))
            tried += 1
    judge.conclude(10, tried)


def test_the_corpus_is_large() -> None:
    parameters = sum(len(schema({})) for schema in SCHEMAS.values()) + sum(len(choices(node)) for node in NODE_SCHEMAS)
    assert parameters * len(VALUES) >= 5207


def changed(root: ElementTree.Element, random: Random) -> str:
    """A description with a few changes: values, elements that are missing, doubled, elsewhere or of another name."""
    for _ in range(random.choice((1, 1, 1, 2, 5))):
        elements = list(root.iter())
        parent = random.choice([element for element in elements if len(element)])
        child = random.choice(list(parent))
        match random.choice(("value", "value", "value", "value", "missing", "doubled", "moved", "name", "attribute")):
            case "value" if values := [(e, name) for e in elements for name in e.attrib]:
                element, name = random.choice(values)
                element.set(name, random.choice([*TEXTS, random.choice(values)[0].get(name, "1")]))
            case "missing":
                parent.remove(child)
            case "doubled":
                parent.append(child)
            case "moved":
                root.append(child)
            case "name":
                child.tag = random.choice(elements).tag
            case "attribute":
                child.set(
                    random.choice(("count", "size", "type", "file", "name", "nrow", "euler")), random.choice(TEXTS)
                )
    return ElementTree.tostring(root, encoding="unicode")


def damaged(text: str, random: Random) -> str:
    """A text with characters that are missing or changed."""
    start = random.randrange(len(text))
    some = "".join(random.choice("<>&\"'/=\0\n ,;x1\u00fc\ufeff") for _ in range(random.randrange(3)))
    return text[:start] + some + text[start + random.choice((0, 1, 5, len(text))) :]


@pytest.mark.parametrize("source", ["panda", "scara", "mjcf"])
def test_any_description_is_used_or_refused(source: str) -> None:
    text = MJCF if source == "mjcf" else read_source(source)[1]
    judge = Judge(UsageError, DivergedError)
    for seed in range(DESCRIPTIONS):
        random = Random(seed)
        content = changed(ElementTree.fromstring(text), random) if seed % 4 else damaged(text, random)
        content = content if content.lstrip().startswith("<") else f"<{content}"
        judge.use(f"seed {seed}", partial(find_robot, {"robot.description": content}), "robot.description")
    judge.conclude(DESCRIPTIONS // 10, DESCRIPTIONS)


def test_any_table_is_used_or_refused() -> None:
    judge, given = Judge(UsageError, DivergedError), {"reference.name": "csv", "reference.file": "table.csv"}

    def use() -> None:
        ReferenceMotion(resolve(reference_schema, given, 2)).evaluate(0.35, np.empty((3, 2)))

    for seed in range(TABLES):
        random = Random(seed)
        lines = [line.split(",") for line in TABLE.splitlines()]
        if seed % 2:
            random.choice(lines)[random.randrange(3)] = random.choice(TEXTS)
        separator, end = random.choice((",", ",", ";", "\t")), random.choice((0, 1, 20, 21, 21, 21))
        text = "\n".join(separator.join(line) for line in lines[:end])
        content = damaged(text + "\n", random) if seed % 3 == 0 else text
        encoding = random.choice(("utf-8", "utf-8", "utf-8", "utf-8-sig", "utf-16", "latin-1"))
        Path("table.csv").write_bytes(content.encode(encoding, "replace"))
        judge.use(f"seed {seed}", use, "table.csv")
    judge.conclude(TABLES // 10, TABLES)
