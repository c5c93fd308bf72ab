"""Two hundred pairs of gains on all cores, with a noisy sensor: what does a small error cost in effort variation?"""

from itertools import product

import matplotlib.pyplot as plt
import numpy as np

import pidtsm_core as pidtsm

K1 = np.linspace(1.0, 8.0, 20)  # gain of the surface
BANDWIDTH = np.geomspace(10.0, 80.0, 10)  # of the observer, rad/s

CASE = {"scenario": "noise", "params": "practical"}

pairs = list(product(K1, BANDWIDTH))
result = pidtsm.batch(
    ({**CASE, "controller": {"law.k1": a, "estimator.bandwidth": b}} for a, b in pairs),
    duration=4.0,
    progress=lambda done: print(f"{done} of {len(pairs)} rollouts"),
)
for number, reason in result.failed.items():
    print(f"{pairs[number]} failed: {reason}")

figure, axes = plt.subplots(1, 2, figsize=(10.0, 4.0), layout="constrained")
for ax, metric, unit in zip(axes, ("rmse", "torque_variation"), ("rad", "N m"), strict=True):
    table = result.metrics[metric].max(axis=1).reshape(len(K1), len(BANDWIDTH))
    mesh = ax.pcolormesh(BANDWIDTH, K1, table, shading="nearest")
    ax.set(title=f"{metric} [{unit}], the worse joint", xlabel="estimator.bandwidth", ylabel="law.k1", xscale="log")
    figure.colorbar(mesh)
figure.savefig("sweep_gains.png")
