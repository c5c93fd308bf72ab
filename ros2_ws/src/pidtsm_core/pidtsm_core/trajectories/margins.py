"""How far what plans a motion stays inside what stops the arm: the one definition for planners and the controller."""

PLANNED_SHARE = 0.95
"""Share of ``limits.velocity`` that a planned or accepted motion may use: goals, trajectories, streams, `retime`.

Beyond the whole limit the controller stops. Between both is room for what the estimate of the velocity adds to the
motion, noise of the encoders and transients of the law: at most 1 % of the limit, see docs/trajectories.md.
"""

PLANNED_EFFORT = 0.9
"""Share of ``limits.effort``, after friction, that a motion planned here may need; the rest is for the law."""
