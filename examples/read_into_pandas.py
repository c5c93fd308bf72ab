"""A run as a table: all signals of all joints with pandas and xarray, for analyses beyond the metrics."""

import pidtsm_core as pidtsm

run = pidtsm.rollout(robot="scara", params="practical", duration=3.0)

table = run.to_pandas()
print(table[["error", "effort"]].describe().to_string(float_format="{:.3g}".format))
print("largest effort per second:")
print(table["effort"].abs().groupby(table.index.astype(int)).max().to_string(float_format="{:.3g}".format))

data = run.to_xarray()
slides = data.position_unit == "m"
print("joints that slide:", data.joint[slides].values)
print("power [W] at 1 s:", (data.effort * data.velocity).sel(time=1.0).values.round(3))
table.to_csv("run.csv")
