"""Generates docs/reference.md from the declarations of the nodes: every parameter and every message.

./pidtsm shell -c "python scripts/reference.py"
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.experiment.node_parameters import NODE_ONLY, NODE_SCHEMAS
from pidtsm_core.laws import LAWS
from pidtsm_core.laws.reaching import REACHING_LAWS
from pidtsm_core.laws.surfaces import SURFACES
from pidtsm_core.parameters import Parameter, ParameterError, Schema, Value
from pidtsm_core.parameters.family import Family
from pidtsm_core.references import REFERENCES
from pidtsm_core.simulation.disturbances import DISTURBANCES

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "reference.md"

_FAMILIES: dict[str, Family[Any]] = {
    "law.name": LAWS,
    "law.surface": SURFACES,
    "law.reaching": REACHING_LAWS,
    "estimator.name": ESTIMATORS,
    "reference.name": REFERENCES,
    "disturbance.name": DISTURBANCES,
}
_HEAD = """# Reference

`scripts/reference.py` generates this page from the declarations of the nodes; `ros2 param describe` shows the same
information. A parameter *per joint* takes one number for all joints, or one number per joint. A parameter marked
*start* is read when the node is configured; all others can be changed while the node runs. In `--set`, in scenarios
and in a launch, put the name of the node in front: `controller.law.k1=4.0`.

Units are those of joints that turn. For a joint that slides, rad is m, N m is N and kg m^2 is kg, except in bandwidths
and cutoffs.
"""
_LEFT_OUT = """## Parameters that a rollout does not have

A rollout accepts every parameter above that changes a torque. These exist only in nodes:
"""
_ESCAPED = "\\|"
_TABLE = "| parameter | default | unit | allowed | meaning |\n| --- | --- | --- | --- | --- |\n"


def page() -> str:
    """Content of the page."""
    parts = [_HEAD]
    for node, schema in NODE_SCHEMAS.items():
        parts.append(f"## Parameters of the {node}\n")
        parts += _parameters(schema, {})
    parts.append(_LEFT_OUT)
    parts += [f"* {node}: {', '.join(f'`{p.name}`' for p in some)}" for node, some in NODE_ONLY.items()]
    parts.append("\n## Messages and services\n")
    interfaces = ROOT / "ros2_ws" / "src" / "pidtsm_msgs"
    for file in sorted([*interfaces.glob("msg/*.msg"), *interfaces.glob("srv/*.srv")]):
        name = f"pidtsm_msgs/{file.parent.name}/{file.stem}"
        parts.append(f"### {name}\n\n```text\n{file.read_text(encoding='utf-8').strip()}\n```\n")
    return "\n".join(parts)


def _parameters(
    schema: Schema,
    settings: Mapping[str, object],
    path: tuple[str, ...] = (),
    elsewhere: frozenset[Parameter] = frozenset(),
    made: frozenset[str] = frozenset(),
) -> Iterator[str]:
    """Tables of the parameters that always exist with these settings, and of those added by each remaining choice.

    Args:
        schema: schema of the node.
        settings: choices made so far.
        path: the same as text.
        elsewhere: parameters in other tables.
        made: names of the choices covered by other tables.
    """
    declared = frozenset(schema(settings))
    choices = {p.name: _variants(schema, settings, p) for p in schema(settings) if p.choices and p.name not in made}
    shared = {name: frozenset.intersection(*variants.values()) for name, variants in choices.items()}
    always = declared.intersection(*shared.values())
    rows = [p for p in schema(settings) if p in always - elsewhere]
    if rows:
        yield _heading(path, settings) + _TABLE + "".join(map(_row, rows))
    for name, variants in choices.items():
        of_other_choices = always.union(*(declared - shared[other] for other in choices if other != name))
        for choice, variant in variants.items():
            if variant - of_other_choices:
                chosen = {**settings, name: choice}
                words = (*path, f"`{name}: {choice}`")
                yield from _parameters(schema, chosen, words, of_other_choices | elsewhere, made.union(choices))


def _variants(schema: Schema, settings: Mapping[str, object], choice: Parameter) -> dict[str, frozenset[Parameter]]:
    """Parameters by the value of a choice, without values that the node rejects."""
    found = {}
    for value in choice.choices:
        try:
            found[value] = frozenset(schema({**settings, choice.name: value}))
        except ParameterError:
            continue
    return found


def _heading(path: tuple[str, ...], settings: Mapping[str, object]) -> str:
    """Heading with the choices made, and a summary of the last one."""
    if not path:
        return ""
    name, choice = list(settings.items())[-1]
    summary = f"{_FAMILIES[name][str(choice)].summary}\n\n" if name in _FAMILIES else ""
    return f"### {', '.join(path)}\n\n{summary}"


def _row(p: Parameter) -> str:
    marks = [p.range_text()]
    marks += ["per joint"] * (p.per_joint and not isinstance(p.default, tuple)) + ["start"] * p.read_only
    allowed = "; ".join(m for m in marks if m)
    cells = (f"`{p.name}`", _text(p.default), p.unit, allowed, p.description)
    return f"| {' | '.join(cell.replace('|', _ESCAPED) for cell in cells)} |\n"


def _text(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (tuple, list)):
        return ", ".join(map(_text, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
