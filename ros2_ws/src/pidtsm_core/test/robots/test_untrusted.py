"""Descriptions of strangers: no xacro file does more than read, and no small text becomes a large model."""

import subprocess
import sys
from pathlib import Path

import pytest

from pidtsm_core.robots import confined
from pidtsm_core.robots.bounds import ELEMENTS, LONGEST
from pidtsm_core.robots.compiler import load_spec, parse
from pidtsm_core.robots.errors import DescriptionError
from pidtsm_core.robots.source import read_source

XACRO = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="{}"/></robot>'
SUBCLASSES = "[c for c in ().__class__.__base__.__subclasses__() if c.__name__ == '_wrap_close'][0]"
ATTEMPTS = {
    "a program": "import os; os.posix_spawn('/bin/true', ['true'], {})",
    "another process": "import os; os.fork()",
    "a socket": "import socket; socket.socket()",
    "a new file": "open('new', 'w')",
    "a change": "open('here', 'r+')",
    "a removal": "import os; os.unlink('here')",
    "another name": "import os; os.rename('here', 'there')",
    "a folder": "import os; os.mkdir('new')",
    "a signal": "import os; os.kill(os.getppid(), 0)",
    "other rights": "import os; os.chmod('here', 0o777)",
}
BODY = '<body><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
MANY = "".join(f'<link name="link{i}"/>' for i in range(1000))


def mjcf(world: str = BODY, assets: str = "", more: str = "") -> str:
    return f"<mujoco>{more}<asset>{assets}</asset><worldbody>{world}</worldbody></mujoco>"


LARGE = {
    "copies": (mjcf(f'<replicate count="1000000">{BODY}</replicate>'), "1e+06 copies of its replicate"),
    "copies of copies": (mjcf('<replicate count="99">' * 9 + BODY + "</replicate>" * 9), "copies of its replicate"),
    "cable": (mjcf('<composite type="cable" count="9999999 1 1"/>'), "copies of its composite"),
    "height field": (mjcf(assets='<hfield name="h" nrow="100000" ncol="100000"/>'), "hfield h has 100000 x 100000"),
    "picture": (mjcf(assets='<texture name="t" width="1e6" height="1e6"/>'), "texture t has 1e6 x 1e6"),
    "memory": (mjcf(more='<size memory="100G"/>'), "memory of size is '100G'"),
    "user's values": (mjcf(more='<size nuser_body="1000000000"/>'), "nuser_body of size is '1000000000'"),
    "numbers": (mjcf(more='<custom><numeric size="1000000000"/></custom>'), "size of numeric is '1000000000'"),
    "depth": (mjcf("<frame>" * 1000 + "</frame>" * 1000), "more than 200 elements are nested"),
    "links": (f'<robot name="arm">{MANY}</robot>', "has 1000 links"),
    "text": ("<robot>" + " " * LONGEST + "</robot>", "the description has 16 MB"),
    "elements": (mjcf("<site/>" * (ELEMENTS + 1)), f"more than {ELEMENTS} elements"),
}


@pytest.mark.parametrize("attempt", ATTEMPTS.values(), ids=ATTEMPTS)
def test_the_process_that_expands_files_can_only_read(attempt: str, tmp_path: Path) -> None:
    (tmp_path / "here").write_text("mine")
    program = f"import runpy; runpy.run_path({confined.__file__!r})['confine']()"
    program += f"\nassert open('here').read() == 'mine'\ntry:\n    {attempt}\nexcept PermissionError:\n    pass\n"
    program += "else:\n    raise SystemExit('possible')"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60.0
    )
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["here"]


@pytest.mark.parametrize(
    ("expression", "reason"),
    [
        (f"{SUBCLASSES}.__init__.__globals__['system']('touch pwned')", "may not be used in a description|invalid"),
        (f"(lambda: {SUBCLASSES}.__init__.__globals__['system']('touch pwned'))()", "may not be used in a description"),
        ("9**9**9", r"takes longer than \d+ s"),
        ("len('x' * 10**10)", "needs more than 1 GB of memory"),
        ("'x' * 10**8", "expands to more than 16 MB"),
        ("no_such_property", "no_such_property"),
    ],
)
def test_an_expression_that_goes_too_far_is_refused(
    expression: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.urdf.xacro").write_text(XACRO.format("${" + expression + "}"))
    with pytest.raises(DescriptionError, match=rf"arm\.urdf\.xacro: .*({reason})") as refusal:
        read_source("arm.urdf.xacro")
    assert "\n" not in str(refusal.value)
    assert not (tmp_path / "pwned").exists()


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ('<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>', "recursion|longer than"),
        ('<xacro:include filename="/dev/zero"/>', "not well-formed|memory|longer than"),
        ('<xacro:property name="a" value="${b}"/><xacro:property name="b" value="${a}"/>${a}', "circular"),
        ('<link name="$(arg nothing)"/>', "nothing"),
        ('<link name="$(find no_such_package)"/>', "no_such_package"),
        ('<link name="$(env NO_SUCH_VARIABLE)"/>', "NO_SUCH_VARIABLE"),
        ('<link name="${1 + "/>', "invalid expression"),
        ('<link name="${1/0}"/>', "division by zero"),
        ("<xacro:nothing/>", "unknown macro"),
        ("<link", "not well-formed"),
    ],
)
def test_a_xacro_file_with_a_mistake_is_refused_in_one_line(
    content: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    head = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    (tmp_path / "arm.urdf.xacro").write_text(f"{head}{content}</robot>")
    with pytest.raises(DescriptionError, match=rf"arm\.urdf\.xacro: .*({reason})") as refusal:
        read_source("arm.urdf.xacro")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("text", "reason"), LARGE.values(), ids=LARGE)
def test_a_description_that_would_become_too_large_is_refused_before_it_is_compiled(text: str, reason: str) -> None:
    with pytest.raises(DescriptionError) as refusal:
        parse(text)
    assert reason in str(refusal.value)


@pytest.mark.parametrize("read", [load_spec, lambda file: read_source(str(file))], ids=["scene", "robot"])
def test_included_files_count(read: object, tmp_path: Path) -> None:
    assert callable(read)
    for i in range(15):
        content = f'<include file="{i + 1}.xml"/>' * 3 if i < 14 else "<worldbody/>"
        (tmp_path / f"{i}.xml").write_text(f"<mujoco>{content}</mujoco>")
    with pytest.raises(DescriptionError, match=f"more than {ELEMENTS} elements"):
        read(tmp_path / "0.xml")
    (tmp_path / "0.xml").write_text('<mujoco><include file="0.xml"/></mujoco>')
    with pytest.raises(DescriptionError, match="includes itself"):
        read(tmp_path / "0.xml")


def test_what_is_no_file_of_a_description_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "large.urdf").open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(DescriptionError, match="at most 16 MB are read"):
        read_source(str(tmp_path / "large.urdf"))
    for source, reason in (("/dev/zero", "neither a file nor a folder"), ("a\0b", "null"), ("\ud800", "no path can")):
        with pytest.raises(DescriptionError, match=reason):
            read_source(source)
