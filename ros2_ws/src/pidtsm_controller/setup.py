from pathlib import Path

from setuptools import find_packages, setup

NAME = "pidtsm_controller"

setup(
    name=NAME,
    version="0.2.0",
    packages=find_packages(exclude=["test"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(map(str, Path("config").glob("*.yaml")))),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": [
            "controller = pidtsm_ros.main:main",
            "trajectory = pidtsm_ros.main:main",
        ],
        "pidtsm_ros.executables": [
            "controller = pidtsm_controller.controller_node:run",
            "trajectory = pidtsm_controller.trajectory_node:run",
        ],
        "pidtsm_ros.nodes": [
            "controller = pidtsm_controller.controller_node:ControllerNode",
            "trajectory = pidtsm_controller.trajectory_node:TrajectoryNode",
        ],
    },
    zip_safe=True,
    maintainer="pidtsm maintainers",
    description="Robust joint-space effort controller for robot arms, and its reference, as ROS 2 nodes.",
    license="Apache-2.0",
)
