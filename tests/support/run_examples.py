"""Runs examples one after the other in this process, each in a folder of its own; prints what came of them as JSON.

python run_examples.py [--without-ros] FOLDER FILE ...
"""

import io
import json
import os
import re
import runpy
import sys
import traceback
from contextlib import redirect_stdout
from pathlib import Path


def execute(file: Path) -> None:
    """Run a script, the code cells of a notebook, or the Python blocks of a document."""
    if file.suffix == ".py":
        runpy.run_path(str(file), run_name="__main__")
        return
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".ipynb":
        cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
        # What nbclient leaves out, too: a cell that installs something.
        run = [cell for cell in cells if "skip-execution" not in cell["metadata"].get("tags", [])]
        blocks = ["".join(cell["source"]) for cell in run]
    else:
        blocks = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    names: dict[str, object] = {"__name__": "__main__"}
    for block in blocks:
        exec(compile(block, str(file), "exec"), names)


def outcome(file: Path, folder: Path) -> dict[str, str]:
    """Output and traceback, which is empty if the example ran to its end."""
    folder.mkdir()
    os.chdir(folder)
    failure, output = "", io.StringIO()
    try:
        with redirect_stdout(output):
            execute(file)
    except Exception:
        failure = traceback.format_exc()
    return {"output": output.getvalue(), "failure": failure}


ROS = ("rclpy", "ament_index_python", "rosidl_parser", "sensor_msgs", "std_msgs", "builtin_interfaces", "rosbags")

if __name__ == "__main__":
    if sys.argv[1] == "--without-ros":
        sys.modules.update(dict.fromkeys(ROS))  # To import one is an error.
        del sys.argv[1]
    root, *files = (Path(word).resolve() for word in sys.argv[1:])
    print(json.dumps({file.name: outcome(file, root / file.stem) for file in files}))
