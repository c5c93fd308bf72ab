"""The real ROS nodes from Python: one second in lockstep, recorded, and equal to the rollout to the last bit.

Needs the workspace: ./pidtsm shell -c "python examples/nodes_from_python.py"
"""

from pathlib import Path

import numpy as np

import pidtsm_core as pidtsm
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.runs.results import result_folder
from pidtsm_experiments.runs.runner import run

experiment = pidtsm.make_experiment("case1", params="article", duration=1.0)
out = Path("results", "nodes_from_python")
with result_folder(out) as folder:  # It replaces what an earlier call has left.
    run(experiment, "lockstep", folder, progress=lambda _: None)
recording = read_recording(out / "bag")
print(recording)
print(f"recorded in {out}/bag")
print("same bits as the rollout:", np.array_equal(recording.effort, pidtsm.rollout(experiment).effort))
