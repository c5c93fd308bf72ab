"""How far what plans a motion stays inside what stops the arm: the one definition for planners and the controller."""

PLANNED_SHARE = 0.95
"""Share of ``limits.velocity`` that a planned or accepted motion may use: goals, trajectories, streams, `retime`.

Beyond the whole limit the controller stops. Between both is room for what the estimate of the velocity adds to the
motion: noise of the encoders and the law's transients, together at most 1 % of the limit with 12 to 14 bits, as the
page on trajectories shows.
"""
