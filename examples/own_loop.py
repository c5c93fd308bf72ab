"""A loop of one's own around the controller: here with MuJoCo as the simulator, and an arm that MuJoCo describes."""

from pathlib import Path

import mujoco
import numpy as np

import pidtsm_core as pidtsm

ARM = """
<mujoco>
  <option timestep="0.001" integrator="RK4"/>
  <worldbody>
    <body><joint name="shoulder" axis="0 1 0" range="-170 170"/>
      <geom type="capsule" size="0.03" fromto="0 0 0 0.4 0 0" mass="2"/>
      <body pos="0.4 0 0"><joint name="elbow" axis="0 1 0" range="-170 170"/>
        <geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder" ctrlrange="-50 50"/><motor joint="elbow" ctrlrange="-50 50"/></actuator>
</mujoco>"""
Path("arm.xml").write_text(ARM, encoding="utf-8")

controller = pidtsm.make_controller(robot="arm.xml", params="practical", controller={"limits.effort": 50.0})
model = mujoco.MjModel.from_xml_string(ARM)
state = mujoco.MjData(model)
error = np.zeros((3000, 2))
for k in range(len(error)):
    t = state.time
    controller.reference[:] = [0.5 * (1.0 - np.cos(t))] * 2, [0.5 * np.sin(t)] * 2, [0.5 * np.cos(t)] * 2
    controller.position[:] = state.qpos  # All that the controller measures.
    controller.step(k * 1_000_000, k * 1_000_000)  # Stamps of measurement and reference, ns.
    error[k] = controller.position - controller.reference[0]
    state.ctrl[:] = controller.effort
    mujoco.mj_step(model, state)
print(f"largest |e| after 1 s: {abs(error[1000:]).max(axis=0)} rad")
