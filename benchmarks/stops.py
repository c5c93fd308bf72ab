"""A random search for bad stops: is a stop of the controller ever worse than what it stops?

    ./pidtsm shell -c "python benchmarks/stops.py --stops 20000"
    ./pidtsm shell -c "python benchmarks/stops.py --case 23"
    ./pidtsm shell -c "python benchmarks/stops.py --alarms 2000"
    ./pidtsm shell -c "python benchmarks/stops.py --rotors 1000"

Each case is a random arm, law, set of parameters, hardware and cause of a stop, and follows from --seed and its index
alone (tests/support/stopcases.py). A stop is judged by the true motion of the arm (tests/support/stopjudge.py says
how). Results are appended to a file, one for each seed and version of pidtsm_core, so that a second call continues.
Ctrl-C ends a search; what was found is kept.

The table has a row for each cause: how many cases, how many of them stopped, and for each criterion the number of
violations and the largest value relative to what is allowed. Blind cases, in which an encoder lies or no joint state
comes back, have a table of their own. Every exception is explained by what must be taken away to make the stop good
(tests/support/stopwhy.py).
"""

import argparse
import hashlib
import json
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

import pidtsm_core

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))

from support.stopcases import (  # In the folder of the tests, as the next ones.
    Case,
    case_of,
    case_with_unknown_rotors_of,
    ordinary_case_of,
)
from support.stopjudge import CRITERIA, Allowed, Outcome, energy, judge
from support.stoprun import Run
from support.stopwhy import CHOICES, CONDITIONS, OTHERS, explain

ROOT = Path(__file__).resolve().parents[1]
_CHUNK = 10
"""Cases that a process judges before it reports."""
_SHOWN = 40
"""Exceptions that are printed without --all."""
_MAKERS: dict[str, Callable[[int, int], Case]] = {
    "stops": case_of,
    "rotors": case_with_unknown_rotors_of,
    "alarms": ordinary_case_of,
}


def judged(search: str, seed: int, indices: Iterable[int]) -> list[dict[str, Any]]:
    """Outcomes of cases, see `Outcome`; bad stops are explained."""
    outcomes = []
    for index in indices:
        run = Run(_MAKERS[search](seed, index))
        outcome = judge(run)
        if outcome.stopped and outcome.why and search != "alarms":
            outcome = replace(outcome, explanation=explain(run))
        outcomes.append(outcome.as_dict)
    return outcomes


def _judged_in_a_process(search: str, seed: int, indices: Iterable[int]) -> list[dict[str, Any]]:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # The main process ends the search.
    return judged(search, seed, indices)


def version() -> str:
    """A digest of the sources of pidtsm_core and of the search, because results of others do not count."""
    core = Path(str(pidtsm_core.__file__)).parent
    files = [*sorted(core.rglob("*.py")), *sorted((ROOT / "tests" / "support").glob("stop*.py"))]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:8]


def load(file: Path) -> dict[int, Outcome]:
    """Outcomes in a file by index; a line that an interruption has cut short is ignored."""
    found = {}
    if file.exists():
        for line in file.read_text(encoding="utf-8").splitlines():
            with suppress(json.JSONDecodeError):
                outcome = Outcome(**json.loads(line))
                found[outcome.index] = outcome
    return found


class Search:
    """A search whose results are in a file.

    Attributes:
        outcomes: by index.
    """

    def __init__(self, name: str, seed: int, file: Path) -> None:
        self._name, self._seed, self._file = name, seed, file
        self.outcomes = load(file)

    @property
    def counted(self) -> int:
        """Stops, or runs in the search for false alarms."""
        return len(self.outcomes) if self._name == "alarms" else sum(o.stopped for o in self.outcomes.values())

    def case(self, index: int) -> Case:
        """The case of an index."""
        return _MAKERS[self._name](self._seed, index)

    def go_on(self, wanted: int, jobs: int) -> None:
        """Judge cases until as many count as wanted; Ctrl-C ends it."""
        if self.counted >= wanted:
            return
        self._file.parent.mkdir(parents=True, exist_ok=True)
        began, before, counted = time.monotonic(), len(self.outcomes), self.counted
        with self._file.open("a", encoding="utf-8") as results, suppress(KeyboardInterrupt):
            for rows in self._answers(jobs):
                for row in rows:
                    outcome = Outcome(**row)
                    self.outcomes[outcome.index] = outcome
                    counted += outcome.stopped or self._name == "alarms"
                    results.write(json.dumps(row) + "\n")
                results.flush()
                spent = time.monotonic() - began
                rate = (len(self.outcomes) - before) / spent
                text = f"\r{counted} of {wanted} {self._name}, {len(self.outcomes)} cases, {rate:.0f} cases/s "
                print(text, end="", file=sys.stderr, flush=True)
                if counted >= wanted:
                    break
        print(file=sys.stderr)

    def _answers(self, jobs: int) -> Iterator[list[dict[str, Any]]]:
        chunks = self._chunks()
        if jobs == 1:
            yield from (judged(self._name, self._seed, chunk) for chunk in chunks)
            return
        with Parallel(n_jobs=jobs, return_as="generator_unordered", pre_dispatch=2 * jobs, batch_size=1) as parallel:
            yield from parallel(delayed(_judged_in_a_process)(self._name, self._seed, chunk) for chunk in chunks)

    def _chunks(self) -> Iterator[list[int]]:
        first = 0
        while True:
            chunk = [index for index in range(first, first + _CHUNK) if index not in self.outcomes]
            if chunk:
                yield chunk
            first += _CHUNK


def table(outcomes: Iterable[Outcome]) -> dict[str, dict[str, Any]]:
    """For each cause, and for all: cases, stops, and for each criterion the violations and the worst value."""
    by_cause: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        by_cause.setdefault(outcome.cause, []).append(outcome)
    rows = dict(sorted(by_cause.items()))
    rows["all"] = [outcome for each in by_cause.values() for outcome in each]
    return {cause: _row(found) for cause, found in rows.items()}


def _row(outcomes: list[Outcome]) -> dict[str, Any]:
    stops = [outcome for outcome in outcomes if outcome.stopped]
    row: dict[str, Any] = {"cases": len(outcomes), "stops": len(stops), "bad": sum(bool(o.why) for o in outcomes)}
    for name in CRITERIA:
        values = [outcome.worst[name] for outcome in stops] or [0.0]
        row[name] = {"violations": int(np.sum(np.array(values) > 1.0)), "worst": max(values)}
    return row


def _print_table(title: str, rows: dict[str, dict[str, Any]]) -> None:
    print(f"\n{title}: violations, and the worst value relative to what is allowed")
    print(f"{'cause':22}{'cases':>7}{'stops':>7}{'bad':>6}" + "".join(f"{name:>15}" for name in CRITERIA))
    for cause, row in rows.items():
        cells = "".join(f"{row[name]['violations']:>7}{row[name]['worst']:>8.3g}" for name in CRITERIA)
        print(f"{cause:22}{row['cases']:>7}{row['stops']:>7}{row['bad']:>6}{cells}")


def exceptions(outcomes: Iterable[Outcome]) -> list[Outcome]:
    """Outcomes that violate a criterion, the worst first."""
    return sorted((o for o in outcomes if o.why), key=lambda o: (-o.worst_ratio, o.index))


def classes(found: Iterable[Outcome]) -> list[tuple[str, int]]:
    """How often there are exceptions of a class: cause, fault, and the violated criteria."""
    names = Counter(
        f"{o.cause}; {o.fault or 'no stop'}; {', '.join(dict.fromkeys(reason.split(':')[0] for reason in o.why))}"
        for o in found
    )
    return names.most_common()


def explanations(found: Iterable[Outcome]) -> dict[str, Counter[str]]:
    """By explanation, the most frequent first: how many exceptions have it, by cause."""
    by_name: dict[str, Counter[str]] = {}
    for outcome in found:
        by_name.setdefault(outcome.explanation, Counter())[outcome.cause] += 1
    return dict(sorted(by_name.items(), key=lambda item: -item[1].total()))


def _print_explanations(title: str, found: list[Outcome]) -> None:
    print(f"\n{title}: without what the {len(found)} exceptions would be good, and how many of each cause")
    texts = {name: text for name, (_, text) in (CONDITIONS | CHOICES).items()} | OTHERS
    for name, causes in explanations(found).items():
        print(f"{causes.total():6}  {name}" + (f": {texts[name]}" if name in texts else ""))
        print(f"{'':8}" + ", ".join(f"{cause} {count}" for cause, count in causes.most_common()))


def _write_list(found: list[Outcome], file: Path) -> None:
    """Write a row of comma-separated values for each exception."""
    rows = ["index,arm,cause,blind,fault,criteria,ratio,explanation"]
    for o in sorted(found, key=lambda o: o.index):
        criteria = "+".join(dict.fromkeys(reason.split(":")[0] for reason in o.why))
        ratio = f"{max(value for name, value in o.worst.items() if value > 1.0):.3g}"
        cells = (str(o.index), o.arm, o.cause, str(int(o.blind)), o.fault, criteria, ratio, o.explanation)
        rows.append(",".join(cells))
    file.write_text("\n".join(rows) + "\n", encoding="utf-8")


def _print_exceptions(found: list[Outcome], everything: bool) -> None:
    print(f"\n{len(found)} exceptions, by class (cause; fault; criteria):")
    for name, count in classes(found):
        print(f"{count:6}  {name}")
    shown = found if everything else found[:_SHOWN]
    print(f"\nthe {'' if everything else 'worst '}exceptions" + ("" if everything else " (--all: every one)"))
    for o in shown:
        sort = " (blind)" if o.blind else ""
        kind = ", ".join(str(value) for value in o.kind.values())
        print(f"{o.index:7} {o.arm}: {o.cause}{sort}, {o.fault or 'no stop'} at {o.time} s; {kind}")
        for reason in o.why:
            print(f"{'':10}{reason}")


def _report_stops(search: Search, options: argparse.Namespace) -> bool:
    """Print what was found; return whether a stop of an arm that can be seen is bad."""
    outcomes = list(search.outcomes.values())
    seen, blind = ([o for o in outcomes if o.blind == sort] for sort in (False, True))
    found = exceptions(outcomes)
    if options.worst:
        with options.worst_file.open("w", encoding="utf-8") as file:
            for outcome in [o for o in found if not o.blind][: options.worst]:
                file.write(search.case(outcome.index).text + "\n")
    if options.list:
        _write_list([outcome for outcome in found if outcome.stopped], options.list)
    if options.json:
        tables = {"seen": table(seen), "blind": table(blind)}
        rows = [outcome.as_dict for outcome in found]
        print(json.dumps({"tables": tables, "classes": dict(classes(found)), "exceptions": rows}, indent=1))
    else:
        _print_table("arms that can be seen", table(seen))
        _print_table("blind", table(blind))
        for title, sort in (("arms that can be seen", False), ("blind", True)):
            _print_explanations(title, [outcome for outcome in found if outcome.stopped and outcome.blind == sort])
        _print_exceptions(found, options.all)
    return any(not outcome.blind for outcome in found)


def _report_alarms(search: Search, options: argparse.Namespace) -> bool:
    """Print the false alarms; return whether there are any. It is no false one that a locked arm does not obey."""
    every = [outcome for outcome in search.outcomes.values() if outcome.stopped or outcome.why]
    stops = [outcome for outcome in every if (outcome.cause, outcome.fault) != ("locked", "NO_EFFECT")]
    faults = Counter(f"{o.cause}; {o.fault}; {o.kind['set']}; {o.kind['hardware']}" for o in stops)
    if options.json:
        rows = [o.as_dict for o in stops]
        print(json.dumps({"runs": len(search.outcomes), "alarms": len(stops), "stops": rows}, indent=1))
        return bool(stops)
    print(f"{len(search.outcomes)} ordinary runs, {len(stops)} false alarms (0 expected)")
    print(f"{len(every) - len(stops)} arms that were locked for 1.5 s were rightly found to have no effect")
    for name, count in faults.most_common():
        print(f"{count:6}  {name}")
    for o in sorted(stops, key=lambda o: o.index)[: None if options.all else _SHOWN]:
        print(f"{o.index:7} {o.arm}: {o.fault} at {o.time} s; {', '.join(str(value) for value in o.kind.values())}")
    return bool(stops)


def show(case: Case) -> None:
    """Print a case, its time line, and the verdict."""
    print(json.dumps(json.loads(case.text), indent=1))
    run = Run(case)
    outcome, trace = judge(run), run.trace
    begin = max(run.stopped - round(0.05 / run.dt), 0) if run.stopped >= 0 else 0
    rows = np.unique(np.linspace(begin, len(trace.fault) - 1, 41).astype(int))
    if run.stopped >= 0:
        held = trace.position[run.stopped]
        for stretch in run.stretches():
            allowed, energies = Allowed.of(run, stretch, held), energy(run, stretch)
            held = trace.position[stretch.stop - 1]
            print(f"from {run.dt * stretch.start:.4f} s: allowed travel {allowed.travel.round(4)}, ", end="")
            print(f"speed {allowed.speed.round(3)} + {allowed.faster.round(3)}; ", end="")
            print(f"energy {energies[0]:.4g} J at first, {energies.max():.4g} J at most")
    print("time s | true q | true q' | command, share of the limit")
    for k in rows:
        marks = ("STOP " if k >= run.stopped >= 0 else "") + ("push" if trace.push[k].any() else "")
        cells = (trace.position[k].round(4), trace.velocity[k].round(3), (trace.command[k] / run.limit).round(3))
        print(f"{run.dt * k:8.4f} | " + " | ".join(" ".join(f"{v:9.4g}" for v in row) for row in cells) + f" {marks}")
    print(f"{outcome.fault or 'no stop'} at {outcome.time} s; relative to what is allowed: {outcome.worst}")
    print("\n".join(outcome.why) or "nothing violated")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stops", type=int, default=20_000, metavar="N", help="search until there are N stops")
    parser.add_argument("--alarms", type=int, metavar="N", help="instead: N ordinary runs, in which nothing may stop")
    parser.add_argument("--rotors", type=int, metavar="N", help="instead: N stops of arms with unknown rotors")
    parser.add_argument("--seed", type=int, default=1, help="another seed has other cases")
    parser.add_argument("--jobs", type=int, default=2, help="processes; -1: one per core")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "stops", help="folder of the files of results")
    parser.add_argument("--case", type=int, metavar="INDEX", help="show one case: parameters, time line, verdict")
    parser.add_argument("--replay", type=Path, metavar="FILE", help="judge the cases in a file written by --worst")
    parser.add_argument("--worst", type=int, default=0, metavar="N", help="write the N worst cases that are not blind")
    parser.add_argument("--worst-file", type=Path, default=Path("worst_stops.jsonl"), help="file for --worst")
    parser.add_argument("--list", type=Path, metavar="FILE", help="write every exception with its explanation as CSV")
    parser.add_argument("--all", action="store_true", help="print every exception")
    parser.add_argument("--json", action="store_true", help="print the tables and exceptions as JSON")
    return parser.parse_args()


def main() -> None:
    """Search, and print what was found; exit code 1 if a stop is bad."""
    options = _options()
    name = next((name for name in ("alarms", "rotors") if getattr(options, name) is not None), "stops")
    if options.case is not None:
        show(_MAKERS[name](options.seed, options.case))
        return
    if options.replay:
        cases = [Case.from_text(line) for line in options.replay.read_text(encoding="utf-8").splitlines()]
        outcomes = [judge(Run(case)) for case in cases]
        _print_table("replayed", table(outcomes))
        _print_exceptions(exceptions(outcomes), options.all)
        sys.exit(any(outcome.why for outcome in outcomes))
    search = Search(name, options.seed, options.out / f"{name}-{options.seed}-{version()}.jsonl")
    search.go_on(getattr(options, name), options.jobs)
    bad = (_report_alarms if name == "alarms" else _report_stops)(search, options)
    sys.exit(bad)


if __name__ == "__main__":
    main()
