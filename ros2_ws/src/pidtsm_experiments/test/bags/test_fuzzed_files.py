"""Arbitrary input files (scenarios, parameters, bags) give a result or a single error that names the file."""

import resource
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeAlias

import pytest
import yaml
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.node_parameters import SCHEMAS
from pidtsm_core.parameters.files import NODES
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.bags.analysis import analyze
from pidtsm_experiments.bags.errors import RecordingError, UnfinishedBag

Bag: TypeAlias = dict[str, bytes]

METADATA = "metadata.yaml"


def fuzzed(examples: int) -> settings:
    return settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
    )


# Possible values: everything that YAML supports, and text that looks like it.

VALUES: st.SearchStrategy[Any] = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([10**400, -(10**400), 2**63, "piddtsm", "article", "realtime", "1e3", ""])
    | st.floats()
    | st.text(max_size=8)
    | st.binary(max_size=4)
    | st.dates()
    | st.sets(st.integers(), max_size=2),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4) | st.integers(), inner, max_size=3),
    max_leaves=5,
)
TAGS = (
    "!!python/object/apply:os.getcwd []",
    "!!python/name:os.system",
    "!!int x",
    "!!float x",
    "!!bool x",
    "!!timestamp x",
    "!!binary x",
    "!unknown x",
    "2001-02-30",
    "0x",
    "9" * 5000,
    "0x" + "9" * 5000,
    "[" * 3000,
    "{a: " * 3000,
    "&a {b: *a}",
    "&a [*a]",
    "{<<: 1}",
    "? {a: b}",
    "\N{NULL}",
)
PARAMETERS = {node: [p.name for p in SCHEMAS[node]({})] for node in NODES}
GOOD: dict[str, Any] = {
    "description": "a run",
    "duration": 2.0,
    "simulator": {"payload": {"mass": 0.5, "time": 1.0}, "encoder.bias": [0.1, 0.2]},
    "controller": {"law.name": "piddtsm", "law.k1": [3.0, 4.0], "joints": ["joint1", "joint2"]},
    "trajectory": {"reference.name": "sines"},
}
GOOD_TEXT = yaml.safe_dump(GOOD).encode()
WITH_PLACES = [
    yaml.safe_dump(GOOD | {place: "PLACE"}) for place in ("duration", "description", "simulator", "controller", "9")
]


@st.composite
def changed_scenarios(draw: st.DrawFn) -> str:
    """A valid scenario with one value changed, or one more parameter or key."""
    content = {key: dict(value) if isinstance(value, dict) else value for key, value in GOOD.items()}
    node = draw(st.sampled_from(NODES))
    group = draw(st.sampled_from([content, content[node]]))
    names = list(content) if group is content else PARAMETERS[node]
    group[draw(st.sampled_from(names) | st.text(max_size=5))] = draw(VALUES)
    return yaml.dump(content)


@st.composite
def tagged_scenarios(draw: st.DrawFn) -> str:
    """A valid scenario with text that has a special meaning in YAML in one place."""
    return draw(st.sampled_from(WITH_PLACES)).replace("PLACE", draw(st.sampled_from(TAGS)))


@st.composite
def damaged_scenarios(draw: st.DrawFn) -> bytes:
    """A valid scenario with some bytes changed."""
    text = bytearray(GOOD_TEXT)
    for place, byte in draw(st.lists(st.tuples(st.integers(0, len(text) - 1), st.integers(0, 255)), max_size=3)):
        text[place] = byte
    return bytes(text[: draw(st.integers(0, len(text)))])


CONTENTS: st.SearchStrategy[str | bytes] = (
    changed_scenarios() | tagged_scenarios() | damaged_scenarios() | st.binary(max_size=50) | VALUES.map(yaml.dump)
)


def as_parameters(content: str | bytes) -> str | bytes:
    """The content one level deeper, like the parameters in a ROS file."""
    text = content.decode("latin-1") if isinstance(content, bytes) else content
    lines = "\n".join(f"    {line}" for line in text.splitlines())
    return f"controller:\n  ros__parameters:\n{lines}\n"


FILES: dict[str, tuple[st.SearchStrategy[str | bytes], Callable[[str], Any]]] = {
    "scenario": (CONTENTS, make_experiment),
    "parameters": (CONTENTS | CONTENTS.map(as_parameters), lambda file: make_experiment("case1", params=[file])),
}


@pytest.mark.parametrize("kind", FILES)
def test_any_file_is_an_experiment_or_refused_by_name(kind: str) -> None:
    contents, load = FILES[kind]
    accepted = []

    @fuzzed(300)
    @given(contents)
    def try_files(content: str | bytes) -> None:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "file.yaml")
            file.write_bytes(content if isinstance(content, bytes) else content.encode(errors="replace"))
            try:
                experiment = load(str(file))
            except UsageError as error:
                message = str(error)
                assert str(file) in message
                return
        assert experiment.duration > 0.0
        assert experiment.event_time is None or experiment.event_time > 0.0
        accepted.append(content)

    try_files()
    assert 5 < len(accepted) < 270


@fuzzed(300)
@given(
    st.text(max_size=10) | st.sampled_from(["case1", "x" * 5000, "/", "."]),
    st.none() | st.sampled_from(["piddtsm", "sliding_mode"]) | st.text(max_size=5),
    st.lists(
        st.tuples(
            st.sampled_from(NODES) | st.text(max_size=3),
            st.sampled_from([name for node in NODES for name in PARAMETERS[node]]) | st.text(max_size=5),
            st.text(max_size=8) | st.sampled_from(TAGS) | VALUES.map(str),
        ).map(lambda words: f"{words[0]}.{words[1]}={words[2]}")
        | st.text(max_size=10),
        max_size=2,
    ),
    st.lists(st.sampled_from(["article", "practical", "x" * 5000, "/"]), max_size=1),
)
def test_any_command_line_is_an_experiment_or_refused(
    scenario: str, law: str | None, overrides: list[str], params: list[str]
) -> None:
    with suppress(UsageError):
        make_experiment(scenario, law, overrides=overrides, params=params)


@pytest.fixture(scope="module", params=StoragePlugin)
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, write_bag: Any) -> Bag:
    """The files of a short bag, by name."""
    path = write_bag(tmp_path_factory.mktemp("good") / "bag", rollout(duration=0.02), plugin=request.param)
    return {file.name: file.read_bytes() for file in path.iterdir()}


@pytest.fixture
def little_memory() -> Iterator[None]:
    """Limit the memory to 1 GB more than now."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + 2**30, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@st.composite
def changed(draw: st.DrawFn, tree: dict[str, Any]) -> dict[str, Any]:
    """The same content with one value changed or added."""
    branch = tree
    while inner := [value for value in branch.values() if isinstance(value, dict) and value]:
        if branch is not tree and draw(st.booleans()):
            break
        branch = draw(st.sampled_from(inner))
    branch[draw(st.sampled_from(sorted(branch)) | st.text(max_size=5))] = draw(VALUES)
    return tree


@st.composite
def damages(draw: st.DrawFn, bag: Bag) -> Bag:
    """The files of a damaged bag: some are missing, truncated, or have changed bytes."""
    files = dict(bag)
    name = draw(st.sampled_from(sorted(files)))
    content = bytearray(files[name])
    places = st.integers(0, len(content) - 1)
    match draw(st.sampled_from(["lost", "cut", "bytes", "hole", "value"])):
        case "lost":
            del files[name]
            return files
        case "cut":
            content = content[: draw(places)]
        case "bytes":
            for place in draw(st.lists(places, min_size=1, max_size=20)):
                content[place] ^= draw(st.integers(1, 255))
        case "hole":
            place, length = draw(places), draw(st.integers(1, 5000))
            content[place : place + length] = bytes(len(content[place : place + length]))
        case "value":
            name, content = METADATA, bytearray(yaml.dump(draw(changed(yaml.safe_load(files[METADATA])))).encode())
    files[name] = bytes(content)
    return files


@pytest.mark.usefixtures("little_memory")
def test_any_bag_is_read_or_refused_by_name(bag: Bag) -> None:
    read = []

    @fuzzed(120)
    @given(damages(bag))
    def try_bags(files: Bag) -> None:
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore", UnfinishedBag)
            path = Path(folder, "bag")
            path.mkdir()
            for name, content in files.items():
                (path / name).write_bytes(content)
            try:
                result = analyze(path)
            except RecordingError as error:
                message = str(error)
                assert str(path) in message
                return
        assert result["samples"] > 0
        read.append(files)

    try_bags()
    assert 20 < len(read) < 108
