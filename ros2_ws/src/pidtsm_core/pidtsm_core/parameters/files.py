"""Parameter files: the YAML of ROS 2, read and written."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from pidtsm_core.errors import UsageError
from pidtsm_core.parameters import Value

Settings = dict[str, dict[str, Any]]
"""Parameter values by node and full name."""

NODES = ("simulator", "controller", "trajectory")
_ANY_NAMESPACE = "/**"
"""Prefix of a node name in ROS parameter files."""
_DEEPEST = 20
"""Maximum nesting depth of a file; with thousands of levels, PyYAML takes seconds and then fails to recurse further."""

_LONGEST = 100
"""Maximum number of digits; Python refuses to print integers with thousands of digits."""


class GivenTwiceError(yaml.YAMLError):
    """A key occurs twice in the same group; YAML would keep the last value and forget the other."""


class _Group(dict[Any, Any]):
    """A mapping of a file, with the line of each key, counted from 1."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: dict[Any, int] = {}


class _Loader(yaml.SafeLoader):
    """Reads 1e-3 as a number, as ROS does; in YAML 1.1 it is text.

    Rejects aliases, as ROS does: a few lines with aliases can expand to more than fits into memory, or endlessly.
    Rejects a key that is given twice. Mappings are of type `_Group`.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._level = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("aliases (*NAME) are not allowed")
        if self._level == _DEEPEST:
            raise yaml.YAMLError(f"more than {_DEEPEST} levels")
        self._level += 1
        node = super().compose_node(parent, index)
        self._level -= 1
        if isinstance(node, yaml.ScalarNode) and node.tag.endswith(":int") and len(node.value) > _LONGEST:
            raise yaml.YAMLError(f"an integer of more than {_LONGEST} digits")
        return node


def _construct_group(loader: _Loader, node: yaml.MappingNode) -> Iterator[_Group]:
    """A mapping, after all mappings around it, as PyYAML wants it."""
    group = _Group()
    yield group
    group.update(loader.construct_mapping(node))
    for key_node, _ in node.value:
        key, line = loader.construct_object(key_node, deep=True), key_node.start_mark.line + 1
        if key in group.lines:
            raise GivenTwiceError(f"{key} is given twice, in lines {group.lines[key]} and {line}")
        group.lines[key] = line


_Loader.add_constructor("tag:yaml.org,2002:map", _construct_group)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+$"), list("-+0123456789")
)


def load_ros_parameters(file: Path) -> Settings:
    """Parameters by node from a ROS parameter file (``NODE: ros__parameters: ...``).

    Raises:
        UsageError: the file is not readable or has another form.
    """
    content = load_mapping(file)
    settings: Settings = {}
    sections: dict[str, str] = {}
    for key, value in content.items():
        node = str(key).removeprefix(_ANY_NAMESPACE).lstrip("/")
        if node not in NODES:
            raise UsageError(f"{file}: unknown node {key}; known: {', '.join(NODES)}")
        section = f"{key} in line {content.lines[key]}"
        if node in settings:
            raise UsageError(f"{file}: {sections[node]} and {section} are both of {node}; join them")
        sections[node] = section
        if not isinstance(value, dict) or set(value) != {"ros__parameters"}:
            raise UsageError(f"{file}: {key} must contain ros__parameters and nothing else")
        settings[node] = flatten(value["ros__parameters"] or {}, f"{file}: {key}")
    return settings


def ros_parameters(node: str, values: Mapping[str, Value]) -> str:
    """Content of a ROS parameter file for one node, with parameters nested by the dots in their names.

    Args:
        node: name of the node in any namespace, or its full name.
        values: parameter values by name.
    """
    tree: dict[str, Any] = {}
    for name, value in values.items():
        *groups, leaf = name.split(".")
        branch = tree
        for group in groups:
            branch = branch.setdefault(group, {})
        branch[leaf] = list(value) if isinstance(value, tuple) else value
    place = node if node.startswith("/") else f"{_ANY_NAMESPACE}/{node}"
    return yaml.safe_dump({place: {"ros__parameters": tree}}, sort_keys=False)


def flatten(tree: object, where: str) -> dict[str, Any]:
    """Flatten nested groups to full names with dots.

    Raises:
        UsageError: `tree` is not a mapping with text keys, or gives a parameter twice, with dots and in a group.
    """
    flat: dict[str, Any] = {}
    lines: dict[str, int | None] = {}
    for name, value, line in _leaves(tree, where):
        if name in flat:
            lines_of_both = f", in lines {lines[name]} and {line}" if line else ""
            raise UsageError(f"{where}: {name} is given twice{lines_of_both}")
        flat[name], lines[name] = value, line
    return flat


def _leaves(tree: object, where: str) -> Iterator[tuple[str, Any, int | None]]:
    """Full name, value and, if it comes from a file, line of each parameter."""
    if not isinstance(tree, dict):
        raise UsageError(f"{where} must be a group of parameters, not {tree!r}")
    for key, value in tree.items():
        if not isinstance(key, str):
            raise UsageError(f"{where}: {key!r} is not a parameter name")
        if isinstance(value, dict):
            yield from ((f"{key}.{name}", v, line) for name, v, line in _leaves(value, f"{where}.{key}"))
        else:
            yield key, value, tree.lines[key] if isinstance(tree, _Group) else None


def read_yaml(text: str) -> Any:
    """The content of a YAML text.

    Raises:
        YAMLError: the text is not YAML, or a value does not match its tag.
    """
    try:
        return yaml.load(text, _Loader)  # noqa: S506  The loader is safe.
    except yaml.YAMLError:
        raise
    except Exception as error:  # For !!int x, !!bool x or 2001-02-30, PyYAML raises other exceptions.
        raise yaml.YAMLError(f"a value cannot be read: {error}") from None


def load_mapping(file: Path) -> _Group:
    """The mapping in a YAML file.

    Raises:
        UsageError: the file is not readable, not YAML, or contains something else.
    """
    try:
        content = read_yaml(file.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror}") from None
    except GivenTwiceError as error:
        raise UsageError(f"{file}: {error}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UsageError(f"{file} is not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(content, _Group):
        raise UsageError(f"{file} must contain keys and values")
    return content
