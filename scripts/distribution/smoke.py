"""Uses an installed wheel as its user would, in an empty folder; prints processor times, s, as JSON.

PYTHON smoke.py README [--short], with the interpreter of the environment; needs nothing but the wheel.
"""

import json
import os
import re
import resource
import subprocess
import sys
from pathlib import Path

ROLLOUT = "import pidtsm_core as pidtsm; pidtsm.rollout('case1')"
COMMANDS = ("demo", "report results/demo")
ALL_COMMANDS = (
    *COMMANDS,
    "rollout --law pid --out results/pid --bag",
    "analyze results/pid/bag",
    "replay results/pid",
    "compare results/demo results/pid --out results/compared",
    "export results/pid --csv pid.csv",
    "check panda",
    "gains --robot panda --out panda.yaml",
    "check-gains",
    "excite --robot panda --duration 4 --out motion.yaml",
    "rollout --scenario motion.yaml --out results/motion --bag",
    "identify results/motion/bag --robot panda --out results/identified",
    "new law my_law",
    "tune --budget 4 --out results/tuned",
    "score --quick --out results/score",
)
OF_ROS = ("run", "live", "reproduce", "nodes list", "move --to 0 0")


def main(readme: Path, short: bool) -> None:
    """Run the README's Python, and all commands or, `short`, the first ones.

    Raises:
        AssertionError: one of them fails.
    """
    blocks = re.findall(r"^```python\n(.*?)^```$", readme.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    times = {"first rollout": took(sys.executable, "-c", ROLLOUT), "later rollout": took(sys.executable, "-c", ROLLOUT)}
    times["ten lines"] = took(sys.executable, "-c", "\n".join(blocks))
    assert Path("laws.png").stat().st_size > 1000
    pidtsm = str(Path(sys.executable).with_name("pidtsm"))
    for command in COMMANDS if short else ALL_COMMANDS:
        times[command] = took(pidtsm, *command.split())
    assert "<html" in Path("results/demo/report.html").read_text("utf-8")
    for command in OF_ROS:
        done = subprocess.run([pidtsm, *command.split()], capture_output=True, text=True)
        assert done.returncode == 1, command
        assert "needs ROS 2 Jazzy" in done.stderr, done.stderr
        assert done.stderr.count("\n") == 1, done.stderr
    print(json.dumps(times))


def took(*words: str) -> float:
    """Processor time of a process, s.

    Raises:
        AssertionError: it fails.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert done.returncode == 0, f"{words}:\n{done.stdout[-3000:]}"
    return round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 2)


if __name__ == "__main__":
    os.environ["NUMBA_CACHE_DIR"] = str(Path("cache").resolve())  # Its first rollout is the first one.
    main(Path(sys.argv[1]), "--short" in sys.argv)
