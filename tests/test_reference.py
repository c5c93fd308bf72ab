"""docs/reference.md matches the declarations of the nodes."""

import sys
from pathlib import Path

import pytest

from pidtsm_core.experiment.node_parameters import NODE_SCHEMAS

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

import reference  # noqa: E402


def test_page_is_up_to_date() -> None:
    assert reference.PAGE.read_text(encoding="utf-8") == reference.page(), (
        'regenerate it: ./pidtsm shell -c "python scripts/reference.py"'
    )


@pytest.mark.parametrize("node", NODE_SCHEMAS)
def test_every_parameter_of_a_node_is_there(node: str) -> None:
    section = reference.page().split(f"## Parameters of the {node}\n")[1].split("\n## ")[0]
    for parameter in NODE_SCHEMAS[node]({}):
        assert section.count(f"| `{parameter.name}` |") >= 1, parameter.name


def test_a_law_made_of_parts_shows_the_parameters_of_every_part() -> None:
    page = reference.page()
    for choice in ("law.surface: terminal", "law.reaching: super_twisting", "law.manifold: pid"):
        assert page.count(f"### `law.name: sliding_mode`, `{choice}`\n") == 1
