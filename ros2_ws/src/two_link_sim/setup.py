from pathlib import Path

from setuptools import find_packages, setup

NAME = "two_link_sim"

setup(
    name=NAME,
    version="0.2.0",
    packages=find_packages(exclude=["test"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(map(str, Path("config").glob("*.yaml")))),
        (f"share/{NAME}/urdf", sorted(map(str, Path("urdf").iterdir()))),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": [
            "simulator = pidtsm_ros.main:main",
            "visualization = pidtsm_ros.main:main",
        ],
        "pidtsm_ros.executables": [
            "simulator = two_link_sim.simulator_node:run",
            "visualization = two_link_sim.visualization_node:run",
        ],
        "pidtsm_ros.nodes": [
            "simulator = two_link_sim.simulator_node:SimulatorNode",
        ],
    },
    zip_safe=True,
    maintainer="pidtsm maintainers",
    description="Simulated two-link arm as a ROS 2 node.",
    license="Apache-2.0",
)
