"""A sliding-mode law of one's own: any surface with any reaching law, and its path in the plane of e and e'.

docs/own-law.md shows how to write a surface or a reaching law that does not exist yet.
"""

import matplotlib.pyplot as plt

import pidtsm_core as pidtsm

PARTS = {
    "linear": {"law.k1": 3.0},
    "fast_terminal": {},
    "nonsingular_terminal": {},
}
REACHING = {"law.manifold": "none", "law.reaching": "boundary_layer"}

figure, (plane, surface) = plt.subplots(1, 2, figsize=(10.0, 4.0), layout="constrained")
for name, gains in PARTS.items():
    controller = {"law.surface": name, **REACHING, **gains}
    run = pidtsm.rollout("case1", law="sliding_mode", controller=controller, duration=5.0)
    print(f"{name}: {run}")
    plane.plot(run.error[:, 0], run.estimated_velocity_error[:, 0], label=name)
    surface.plot(run.time, run.sliding_variable[:, 0])
plane.set(xlabel="e of joint 1 [rad]", ylabel="e' [rad/s]")
surface.set(xlabel="time [s]", ylabel="sliding variable of joint 1")
plane.legend()
figure.savefig("own_surface.png")
