"""``./pidtsm nodes list, param, reset, freedrive, hold, record, stop``: operate the nodes that run."""

import argparse
import asyncio
import json
from collections.abc import Callable, Coroutine
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pidtsm_core.errors import UsageError
from pidtsm_experiments.commands.options import seconds
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.parameters import Described, shown, written
from pidtsm_experiments.live.system import System
from pidtsm_experiments.operate.attached import found, joined, place, run

if TYPE_CHECKING:
    from pidtsm_experiments.operate.listing import Row

_PARAM_EPILOG = """NODE is controller, trajectory or simulator. Values are written as in --set; those of several joints
are separated by commas. Parameters that are set together take effect together, or none of them does.

examples:
  ./pidtsm nodes param list controller
  ./pidtsm nodes param get controller law.k1
  ./pidtsm nodes param set controller law.k1 4.0
  ./pidtsm nodes param set controller law.k1=4.0,3.0 law.kd=0.5
"""
_SWITCHES = {
    "freedrive": "on: a person moves the arm by hand; off: the arm is held where it is, until `hold off`",
    "hold": "on: the arm comes to rest and is held; off: it follows the reference again, with a slow approach",
}


def add_arguments_of(parser: argparse.ArgumentParser, action: str) -> None:
    """Add the options of one action."""
    parser.add_argument("--namespace", default=None, metavar="NAME", help="namespace of the system")
    if action in ("list", "param"):
        parser.add_argument("--json", action="store_true", help="print JSON and nothing else")
    if action == "param":
        parser.epilog = _PARAM_EPILOG
        parser.add_argument("what", choices=("list", "get", "set"), help="what to do")
        parser.add_argument("node", metavar="NODE", help="the node")
        parser.add_argument(
            "words", nargs="*", metavar="NAME[=VALUE]", help="parameters; for list, what names begin with"
        )
    if action in _SWITCHES:
        parser.add_argument("on", choices=("on", "off"), help=_SWITCHES[action])
    if action == "record":
        parser.add_argument("--output", type=Path, metavar="DIR", help="new folder of the bag (default: bag-TIME)")
        parser.add_argument("--duration", type=seconds, metavar="S", help="end by itself after S seconds")
        parser.add_argument("--json", action="store_true", help="print one JSON object at the end: bag, samples, size")


def execute_action(options: argparse.Namespace) -> int:
    """Do it."""
    actions: dict[str, Callable[[argparse.Namespace], int]] = {
        "list": _list,
        "param": _param,
        "reset": _reset,
        "freedrive": _switch,
        "hold": _switch,
        "record": _record,
        "stop": _stop,
    }
    return actions[options.action](options)


def _request(options: argparse.Namespace, request: Callable[[System], Coroutine[Any, Any, Any]], node: str) -> Any:
    """Send a request to a node that must be there."""

    async def answer(system: System) -> Any:
        await found(system, node)
        return await request(system)

    with joined(options.namespace or "") as system:
        return run(system, answer(system))


def _list(options: argparse.Namespace) -> int:
    from pidtsm_experiments.operate.listing import rows

    with joined(options.namespace or "") as root:
        only = None if options.namespace is None else f"/{options.namespace.strip('/')}"
        listed = run(root, rows(root, only))
    if options.json:
        print(json.dumps([asdict(row) for row in listed]))
    elif listed:
        _print(listed)
    if not listed:
        raise RunError(f"no nodes of pidtsm {place(options.namespace or '')}; start some with ./pidtsm nodes start")
    return 0


def _print(rows: "list[Row]") -> None:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in ("node", "state", "what it does", "last message"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        received = "none yet" if row.age is None else f"{row.age:.1f} s ago"
        table.add_row(*(Text(cell) for cell in (row.node, row.lifecycle or "no answer", row.status, received)))
    Console().print(table)


def _param(options: argparse.Namespace) -> int:
    node = options.node.strip("/")
    space, _, name = node.rpartition("/")
    if space:
        if options.namespace is not None:
            raise UsageError(f"{options.node} has a namespace; --namespace {options.namespace} is another one")
        options.namespace = space
    if options.what == "set":
        values = _values(options.words)
        _request(options, lambda system: system.set(name, values), name)
        if not options.json:
            print(f"{name}: {', '.join(f'{each} = {shown(value)}' for each, value in values.items())}")
            return 0
        options.what, options.words = "get", list(values)
    described = _request(options, lambda system: system.described(name), name)
    chosen = _chosen(described, options.words, whole=options.what == "get")
    if options.json:
        print(json.dumps({each.name: each.value for each in chosen}))
    else:
        for each in chosen:
            print(shown(each.value) if options.what == "get" and len(chosen) == 1 else _line(each))
    return 0


def _line(parameter: Described) -> str:
    return f"{parameter.name} = {shown(parameter.value)}" + (f"    # {parameter.hint}" if parameter.hint else "")


def _chosen(described: list[Described], words: list[str], whole: bool) -> list[Described]:
    """The parameters of these names, or whose names begin like that; none: all."""
    if whole and not words:
        raise UsageError("param get: name a parameter, such as law.k1")
    known = {each.name: each for each in described}
    if unknown := [word for word in words if whole and word not in known]:
        import difflib

        like = difflib.get_close_matches(unknown[0], known, 3)
        hint = f"; did you mean {' or '.join(like)}?" if like else "; ./pidtsm nodes param list NODE shows all"
        raise RunError(f"there is no parameter {unknown[0]}{hint}")
    if whole:
        return [known[word] for word in words]
    return [each for each in described if not words or each.name.startswith(tuple(words))]


def _values(words: list[str]) -> dict[str, Any]:
    """What ``param set`` gives: NAME VALUE, or NAME=VALUE for each."""
    if len(words) == 2 and "=" not in words[0]:
        words = ["=".join(words)]
    pairs = [word.partition("=") for word in words]
    if not pairs or not all(name and separator for name, separator, _ in pairs):
        raise UsageError("param set: give NAME VALUE, or NAME=VALUE for each parameter, such as law.k1=4.0")
    try:
        return {name: written(text) for name, _, text in pairs}
    except RefusedError as error:
        raise UsageError(str(error)) from None


def _reset(options: argparse.Namespace) -> int:
    _request(options, lambda system: system.trigger("controller/reset_fault"), "controller")
    print("fault reset")
    return 0


def _switch(options: argparse.Namespace) -> int:
    on = options.on == "on"
    _request(options, lambda system: system.switch(f"controller/{options.action}", on), "controller")
    done = {
        ("freedrive", True): "the arm can be moved by hand; ./pidtsm nodes freedrive off holds it where it is",
        ("freedrive", False): "the arm is held where it is; ./pidtsm nodes hold off lets it follow the reference",
        ("hold", True): "the arm comes to rest and is held; ./pidtsm nodes hold off lets it follow the reference",
        ("hold", False): "the arm follows the reference",
    }
    print(done[options.action, on])
    return 0


def _record(options: argparse.Namespace) -> int:
    from pidtsm_experiments.operate.recording import record

    with joined(options.namespace or "") as system:
        kept = run(system, record(system, options.output, options.duration))
    if options.json:
        print(json.dumps({"bag": str(kept.bag), "samples": kept.samples, "size": kept.size}))
    else:
        print(f"recorded {kept.samples} samples, {kept.size / 1e6:.1f} MB: {kept.bag}")
    return 0


def _stop(options: argparse.Namespace) -> int:
    from pidtsm_experiments.operate.claim import end_claimed

    if end_claimed(options.namespace or ""):
        print(f"ended the nodes {place(options.namespace or '')}")
        return 0
    stopped = _request(options, _deactivated, "controller")
    print(f"deactivated {', '.join(stopped)}; their processes, which others have started, go on")
    return 0


async def _deactivated(system: System) -> list[str]:
    """Deactivate controller and trajectory node; returns which were active."""
    stopped = []
    for node in ("controller", "trajectory"):
        if system.has(node):
            try:
                await system.deactivate(node)
                stopped.append(node)
            except RefusedError as error:
                if "is not active" not in str(error):
                    raise
        await asyncio.sleep(0)
    if not stopped:
        raise RefusedError("controller and trajectory node are not active")
    return stopped
