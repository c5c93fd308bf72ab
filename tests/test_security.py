"""The graph has the policy that is documented, nothing starts less secure than requested, and files name no code."""

import ast
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from support.handy import ARM
from support.testarms import TWO_LINK
from support.testbed import Testbed

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.parameters.files import load_ros_parameters
from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.runner import EXECUTABLES
from pidtsm_ros.security import ENCLAVES, SecurityError, require_security

ROOT = Path(__file__).parents[1]
POLICY = ROOT / "security" / "policies" / "pidtsm.policy.xml"
MANAGED = ("simulator", "controller", "trajectory")

KINDS = ("publish", "subscribe", "reply", "request")
ACTION = {
    "publish": ("/_action/feedback", "/_action/status"),
    "reply": ("/_action/send_goal", "/_action/cancel_goal", "/_action/get_result"),
}
"""What an action consists of."""
PAYLOAD = ("payload.observe:=true", "robot.description:=ur5")
"""The controller as it publishes and serves most."""
Rules = dict[str, set[str]]


def full_name(name: str, node: str) -> str:
    return f"/{node}{name[1:]}" if name.startswith("~") else f"/{name.lstrip('/')}"


def policy() -> dict[str, dict[str, Rules]]:
    """What the policy allows: names by kind, by node, by enclave."""
    enclaves: dict[str, dict[str, Rules]] = {}
    for enclave in ElementTree.parse(POLICY).iter("enclave"):
        profiles = enclaves[enclave.attrib["path"]] = {}
        for profile in enclave.iter("profile"):
            assert profile.attrib["ns"] == "/"
            node = profile.attrib["node"]
            rules: Rules = {kind: set() for kind in KINDS}
            for group in profile:
                assert set(group.attrib.values()) == {"ALLOW"}
                for kind in group.attrib:
                    named = {full_name((entry.text or "").strip(), node) for entry in group}
                    for part, names in ACTION.items() if kind == "execute" else ((kind, ("",)),):
                        rules[part] |= {name + end for name in named for end in names}
            profiles[node] = rules
    return enclaves


def graph(testbed: Testbed, node: str) -> Rules:
    """What a node has on the graph: names by kind."""
    if node not in testbed.node.get_node_names():
        return {}
    listings = {
        "publish": testbed.node.get_publisher_names_and_types_by_node,
        "subscribe": testbed.node.get_subscriber_names_and_types_by_node,
        "reply": testbed.node.get_service_names_and_types_by_node,
        "request": testbed.node.get_client_names_and_types_by_node,
    }
    return {kind: {name for name, _ in listing(node, "/")} for kind, listing in listings.items()}


def test_policy_is_exactly_what_the_nodes_use(testbed: Testbed) -> None:
    allowed = {node: rules for profiles in policy().values() for node, rules in profiles.items()}
    handy = testbed.folder / "handy.urdf"
    handy.write_text(ARM, encoding="utf-8")
    testbed.start(
        "simulator", "autostart:=false", "clock:=lockstep", f"robot.description:={handy}", "gripper.joints:=left"
    )
    options = ["stop.brakes:=true", "external_wrench.publish:=true", "payload.from_gripper:=true"]
    testbed.start("controller", "autostart:=false", *options, *PAYLOAD)
    testbed.start("trajectory", "autostart:=false", f"robot.description:={TWO_LINK.description}")
    testbed.start("visualization")
    testbed.start("recorder", f"output:={testbed.folder / 'bag'}")
    configure = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE))
    for node in MANAGED:
        assert testbed.call(ChangeState, f"{node}/change_state", configure).success

    def differences() -> list[str]:
        found = []
        for node, rules in allowed.items():
            has = graph(testbed, node)
            for kind in KINDS:
                used = has.get(kind, set())
                found += [f"{node} may not {kind} {name}" for name in used - rules[kind]]
                found += [f"{node} does not {kind} {name}" for name in rules[kind] - used]
        return found

    try:
        testbed.spin_until(lambda: not differences(), "the graph is that of the policy")
    except pytest.fail.Exception:
        assert differences() == []
        raise


def test_each_executable_has_an_enclave() -> None:
    assert set(policy()) == {f"{ENCLAVES}/{executable}" for _, executable in EXECUTABLES.values()}
    composed = policy()[f"{ENCLAVES}/composed"]
    assert composed == {node: policy()[f"{ENCLAVES}/{node}"][node] for node in MANAGED}


# Nothing starts where security is required and missing.


@pytest.fixture
def keystore(tmp_path: Path) -> Path:
    """A keystore with enclaves, and nothing that a middleware could use in them."""
    for name in EXECUTABLES:
        (tmp_path / "keystore" / "enclaves" / ENCLAVES.strip("/") / name).mkdir(parents=True)
    return tmp_path / "keystore"


def test_no_node_starts_insecure(testbed: Testbed, keystore: Path) -> None:
    # In these enclaves no middleware makes a secure node, and one without security never does.
    testbed.environment |= {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_KEYSTORE": str(keystore)}
    output = testbed.folder / "bag"
    started = [testbed.start(name, *([f"output:={output}"] if name == "recorder" else [])) for name in EXECUTABLES]
    for process in started:
        assert process.wait() == 2, process.name
        log = process.log.read_text()
        assert "cannot start: ROS_SECURITY_ENABLE is true, but" in log
        assert "cannot start a secure node" in log
        assert "Traceback" not in log
    assert not output.exists()


@pytest.mark.parametrize(
    ("environment", "cause"),
    [
        ({"ROS_SECURITY_ENABLE": "1"}, "ROS_SECURITY_ENABLE is '1'; it must be true or false"),
        ({"ROS_SECURITY_ENABLE": "true"}, "ROS_SECURITY_KEYSTORE names no keystore"),
        ({"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_KEYSTORE": "/nowhere"}, "enclave /pidtsm/.* is missing"),
        (
            {
                "ROS_SECURITY_ENABLE": "true",
                "ROS_SECURITY_KEYSTORE": "/nowhere",
                "ROS_SECURITY_STRATEGY": "Permissive",
                "ROS_SECURITY_ENCLAVE_OVERRIDE": "/mine",
            },
            "enclave /mine is missing: no /nowhere/enclaves/mine",
        ),
    ],
)
def test_a_run_that_cannot_be_secure_does_not_start(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    environment: dict[str, str],
    cause: str,
) -> None:
    for name in ("ROS_SECURITY_KEYSTORE", "ROS_SECURITY_STRATEGY", "ROS_SECURITY_ENCLAVE_OVERRIDE"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert main(["run", "--duration", "0.1", "--out", str(tmp_path / "out")]) == 2
    assert re.search(cause, capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


def test_the_graph_runs_under_its_policy(testbed: Testbed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keystore = tmp_path / "keystore"
    if not shutil.which("ros2"):
        (keystore / "enclaves" / "any").mkdir(parents=True)
        monkeypatch.setenv("ROS_SECURITY_KEYSTORE", str(keystore))
        monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
        monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
        with pytest.raises(SecurityError) as refused:
            require_security("/any")
        pytest.skip(f"needs sros2 (ros2 security) to make keys, and a middleware with security; here: {refused.value}")
    subprocess.run(["ros2", "security", "create_keystore", str(keystore)], check=True)
    subprocess.run(["ros2", "security", "generate_artifacts", "-k", str(keystore), "-p", str(POLICY)], check=True)
    testbed.environment |= {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_KEYSTORE": str(keystore)}
    testbed.start("simulator", "clock:=lockstep", "duration:=0.1")
    testbed.start("controller", "reference.match:=stamp")
    testbed.start("trajectory", "clock:=lockstep")
    assert testbed.processes.running["simulator"].wait() == 0


# Files name no code.


@pytest.mark.parametrize("text", ["!!python/object/apply:os.system ['true']", "!!python/name:os.system ''"])
def test_no_file_and_no_option_names_code(tmp_path: Path, text: str) -> None:
    scenario, parameters = tmp_path / "scenario.yaml", tmp_path / "parameters.yaml"
    scenario.write_text(f"description: x\nduration: 1.0\nsimulator: {{clock: {text}}}\n")
    parameters.write_text(f"simulator: {{ros__parameters: {{clock: {text}}}}}\n")
    with pytest.raises(UsageError, match=r"not YAML.*could not determine a constructor"):
        make_experiment(str(scenario))
    with pytest.raises(UsageError, match=r"not YAML.*could not determine a constructor"):
        load_ros_parameters(parameters)
    with pytest.raises(UsageError, match="is not a valid value"):
        make_experiment("case1", overrides=[f"simulator.clock={text}"])


def sources() -> list[Path]:
    """Everything that is Python and not a test."""
    folders = (ROOT / "ros2_ws" / "src", ROOT / "scripts", ROOT / "benchmarks")
    return [file for folder in folders for file in sorted(folder.rglob("*.py")) if "test" not in file.parts]


def calls(file: Path) -> Iterator[tuple[str, ast.Call]]:
    """Every call in a file, with the name of what is called."""
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node


FORBIDDEN = {
    "eval", "exec", "compile", "__import__", "os.system", "os.popen", "yaml.unsafe_load",
    "yaml.full_load", "yaml.add_constructor", "subprocess.getoutput", "subprocess.getstatusoutput",
}  # fmt: skip
CONFINED = {
    "confined.py": ["compile(expression.strip(), '<expression>', 'eval')"],
    # Between a process and the workers of its batch, which exchange tasks in this way anyway.
    "shipment.py": ["cloudpickle", "cloudpickle"],
}
"""What the process that expands xacro files does with the expressions in them: it lists their names, to refuse some."""
UNSAFE_MODULES = {"pickle", "marshal", "shelve", "dill", "cloudpickle"}


def builds_mappings(call: ast.Call, safe: set[str]) -> bool:
    """Whether a safe loader gets a constructor for nothing but mappings, to find keys that are given twice."""
    (tag, *_), loader = [*map(ast.unparse, call.args)], ast.unparse(call.func).partition(".")[0]
    return loader in safe and tag == "'tag:yaml.org,2002:map'"


def unsafe_uses(source: str) -> list[str]:
    """What in a source could run what it reads."""
    tree = ast.parse(source)
    nodes = list(ast.walk(tree))
    imported = [a.name for node in nodes if isinstance(node, ast.Import) for a in node.names]
    imported += [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    found = [name for name in imported if name.partition(".")[0] in UNSAFE_MODULES]
    # A subclass of the safe loader may recognize more texts as numbers, but construct nothing more.
    safe = {
        n.name for n in nodes if isinstance(n, ast.ClassDef) and [*map(ast.unparse, n.bases)] == ["yaml.SafeLoader"]
    }
    for call in [node for node in nodes if isinstance(node, ast.Call)]:
        name, text = ast.unparse(call.func), ast.unparse(call)
        keywords = {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}
        loader = [*map(ast.unparse, call.args[1:2]), keywords.get("Loader", "")][0]
        if (
            name in FORBIDDEN
            or (name.endswith((".add_constructor", ".add_multi_constructor")) and not builds_mappings(call, safe))
            or (name in ("yaml.load", "yaml.load_all") and loader not in safe)
            or keywords.get("shell", "False") != "False"
            or keywords.get("allow_pickle", "False") != "False"
        ):
            found.append(text)
    return found


def test_no_source_runs_what_it_reads() -> None:
    found = {str(file.relative_to(ROOT)): unsafe_uses(file.read_text("utf-8")) for file in sources()}
    assert len(found) > 400
    assert {file: uses for file, uses in found.items() if uses != CONFINED.get(Path(file).name, [])} == {}


@pytest.mark.parametrize(
    "source",
    [
        "eval(x)",
        "import pickle",
        "from marshal import loads",
        "os.system(x)",
        "subprocess.run(x, shell=True)",
        "numpy.load(x, allow_pickle=True)",
        "yaml.load(x)",
        "yaml.load(x, yaml.Loader)",
        "yaml.load(x, Loader=yaml.UnsafeLoader)",
        "class L(yaml.UnsafeLoader): pass\nyaml.load(x, L)",
        "class L(yaml.SafeLoader): pass\nL.add_constructor(t, f)\nyaml.load(x, L)",
    ],
)
def test_unsafe_sources_would_be_found(source: str) -> None:
    assert unsafe_uses(source)


def test_every_process_of_ours_is_guarded() -> None:
    starts = [
        (file.name, ast.unparse(call))
        for package in ("pidtsm_ros", "pidtsm_controller", "two_link_sim", "pidtsm_experiments")
        for file in sorted((ROOT / "ros2_ws" / "src" / package / package).rglob("*.py"))
        for name, call in calls(file)
        if name == "rclpy.init" and file.name != "security.py"
    ]
    assert [file for file, _ in starts] == ["client.py", "startup.py", "port.py", "judge.py", "attached.py"]
    assert all("args=prepare_process(" in call for _, call in starts), starts


# What is installed is what was locked.


@pytest.mark.parametrize("lock", sorted((ROOT / "requirements").glob("*.lock")), ids=lambda lock: lock.name)
def test_every_locked_package_has_a_version_and_hashes(lock: Path) -> None:
    text = re.sub(r"\\\n\s*", "", re.sub(r"(?m)^\s*#.*\n", "", lock.read_text("utf-8")))
    lines = [line for line in text.splitlines() if line.strip()]
    assert lines
    for line in lines:
        assert re.match(r"[A-Za-z0-9._-]+(\[[\w,-]+\])?==\S+", line), line
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", line), line


@pytest.mark.parametrize("file", ["scripts/launcher/install.py", ".ci/run"])
def test_packages_are_installed_with_their_hashes_only(file: str) -> None:
    installs = [line for line in (ROOT / file).read_text("utf-8").splitlines() if re.search(r"pip\W+install", line)]
    assert installs
    assert all("--require-hashes" in line for line in installs)
