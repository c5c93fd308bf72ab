"""Six laws on the same task, which picks up half a kilogram after 15 s: one table, and the curves over each other."""

import pidtsm_core as pidtsm

LAWS = ("piddtsm", "pidnftsm", "dtsm", "super_twisting", "computed_torque", "pid")

figure = None
print(f"{'law':>16} {'RMSE [rad]':>20} {'mean |effort| [N m]':>22} {'recovery [s]':>16}")
for law in LAWS:
    run = pidtsm.rollout("case2", law=law)
    metrics = run.metrics()
    rmse = ", ".join(f"{value:.4f}" for value in metrics["rmse"])
    effort = ", ".join(f"{value:.2f}" for value in metrics["eci"])
    recovery = ", ".join("never" if value is None else f"{value:.2f}" for value in metrics["recovery_time"])
    print(f"{law:>16} {rmse:>20} {effort:>22} {recovery:>16}")
    figure = run.plot(figure)

assert figure is not None
figure.savefig("compare_laws.png")
