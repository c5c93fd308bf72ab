"""A bag of the loop, from nodes or a real arm: its metrics, what happened, and a figure with the rollout over it.

Needs the workspace: ./pidtsm shell -c "python examples/analyse_bag.py results/nodes_from_python/bag"
"""

import sys
from pathlib import Path

import pidtsm_core as pidtsm
from pidtsm_core.recording.outcome import what_happened
from pidtsm_experiments.bags.reader import read_recording

recording = read_recording(Path(sys.argv[1]))
metrics = recording.metrics()
print(recording)
print("outcome:", metrics["outcome"], *what_happened(metrics), sep="\n  ")
print("time to compute a command, 99th percentile:", metrics["timing"]["compute_time"]["p99"], "s")

figure = recording.plot()
pidtsm.rollout(recording.scenario, law=recording.law, duration=recording.duration).plot(figure)
figure.savefig("analyse_bag.png")
