"""A first rollout: thirty seconds of the article's Case 1, its metrics, and a figure of motion, error and effort."""

import pidtsm_core as pidtsm

run = pidtsm.rollout("case1", params="article")
print(run)
for joint, error in zip(run.joints, abs(run.error).T, strict=True):
    print(f"{joint}: |e| at the end {error[-1]:.2e} rad, largest after 5 s {error[run.time > 5.0].max():.2e} rad")

metrics = run.metrics()
print("settled after", metrics["settling_time"], "s; outcome:", metrics["outcome"])
run.plot().savefig("first_rollout.png")
