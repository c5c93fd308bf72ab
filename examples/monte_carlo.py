"""Monte Carlo: a hundred arms whose masses, payloads and noise are drawn at random, with intervals of the metrics."""

import numpy as np

import pidtsm_core as pidtsm

RUNS = 100
random = np.random.default_rng(1)
mass, payload = random.normal(0.0, 0.1, RUNS), random.uniform(0.0, 0.5, RUNS)

result = pidtsm.batch(
    (
        {
            "scenario": "encoder_17",
            "params": "practical",
            "simulator": {"seed": seed, "model_error.mass": m, "payload.mass": load, "payload.time": 1.0},
        }
        for seed, (m, load) in enumerate(zip(mass, payload, strict=True))
    ),
    duration=4.0,
)
print(f"{RUNS - len(result.failed)} of {RUNS} runs are finite")

# The interval of the median comes from resampling the runs.
for metric in ("rmse", "steady_state_error", "torque_variation"):
    values = result.metrics[metric]
    median = np.median(values[random.integers(0, RUNS, (1000, RUNS))], axis=1)
    for joint in range(values.shape[1]):
        low, high = np.percentile(values[:, joint], (2.5, 97.5))
        first, last = np.percentile(median[:, joint], (2.5, 97.5))
        print(
            f"{metric:>20} of joint {joint + 1}: median {np.median(values[:, joint]):.4g} [{first:.4g}, {last:.4g}], "
            f"95 % of the arms within [{low:.4g}, {high:.4g}]"
        )
