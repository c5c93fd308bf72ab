"""FIGAROH on the data of `benchmarks/identification_peer.py`; runs in an environment of its own, see there.

    python benchmarks/figaroh_identify.py DATA.npz RESULT.npz

FIGAROH's documented way: its base class with a configuration, its filter (at the given cut-off), base parameters by QR,
weighted least squares, then bodies that can exist (`physical_fit`).
"""

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from figaroh.identification.base_identification import BaseIdentification
from figaroh.tools.regressor import build_regressor_basic
from figaroh.tools.robot import load_robot


class Peer(BaseIdentification):
    """Identification from arrays."""

    def __init__(self, robot: Any, config: str, data: Any) -> None:
        super().__init__(robot, config)
        self.measured = data
        joints = len(data["joints"])
        self.identif_config["act_idxq"] = self.identif_config["act_idxv"] = list(range(joints))

    def load_trajectory_data(self, data_source: str | None = None) -> dict[str, Any]:
        """See FIGAROH."""
        return {
            "timestamps": self.measured["time"],
            "positions": self.measured["position"],
            "velocities": None,
            "accelerations": None,
            "torques": self.measured["effort"],
        }

    def process_torque_data(self, **_choices: Any) -> Any:
        """The torques through the filter of the positions."""
        return self._apply_filters(self.raw_data["torques"], **self.filter_config["filter_params"])


def configuration(joints: list[str], rate: float, cutoff: float) -> dict[str, Any]:
    """Content of FIGAROH's configuration file; JSON is YAML."""
    zeros = [0.0] * len(joints)
    return {
        "robot": {
            "name": "arm",
            "properties": {
                "joints": {"active_joints": joints},
                "mechanics": {
                    "friction_coefficients": {"viscous": zeros, "static": zeros},
                    "actuator_inertias": zeros,
                    "joint_offsets": zeros,
                },
            },
        },
        "tasks": {
            "identification": {
                "enabled": True,
                "problem": {
                    "include_external_forces": False,
                    "use_joint_torques": True,
                    "model_components": {"friction": True, "actuator_inertia": True, "joint_offset": True},
                },
                "signal_processing": {"sampling_frequency": rate, "cutoff_frequency": cutoff},
                "reconstruction": {"enabled": True},
                "physical_fit": {"enabled": True},
            }
        },
    }


def main(source: Path, target: Path) -> None:
    """Identify, and predict the torques of the unseen motion."""
    data = np.load(source)
    joints = [str(name) for name in data["joints"]]
    with tempfile.TemporaryDirectory() as folder:
        urdf, config = Path(folder, "arm.urdf"), Path(folder, "config.yaml")
        urdf.write_text(str(data["urdf"]), encoding="utf-8")
        config.write_text(json.dumps(configuration(joints, float(data["rate"]), float(data["cutoff"]))))
        robot = load_robot(str(urdf), load_by_urdf=True)
        start = time.perf_counter()
        peer = Peer(robot, str(config), data)
        peer.initialize()
        peer.solve(decimate=True, plotting=False, wls=True)
        seconds = time.perf_counter() - start
    unseen = [data[f"unseen_{name}"] for name in ("position", "velocity", "acceleration")]
    regressor = build_regressor_basic(robot, *unseen, peer.identif_config)
    kept = np.delete(regressor, peer._idx_eliminated, axis=1)
    predicted = (kept[:, peer._base_indices] @ peer.phi_base).reshape(len(joints), -1).T
    fit = peer.result.get("physical_fit", {})
    reports = peer.result.get("physical consistency", {})
    np.savez(
        target,
        predicted=predicted,
        seconds=seconds,
        fit=json.dumps({"physical_fit": fit, "consistency": reports}, default=str),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
