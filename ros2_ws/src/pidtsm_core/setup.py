from pathlib import Path

from setuptools import find_packages, setup

NAME = "pidtsm_core"


def files(folder: str) -> list[str]:
    """Parameter files in a folder of the experiments."""
    return sorted(map(str, Path(NAME, "experiment", folder).glob("*.yaml")))


setup(
    name=NAME,
    version="0.2.0",
    packages=find_packages(exclude=["test"]),
    package_data={
        NAME: [
            "py.typed",
            "experiment/scenarios/*.yaml",
            "experiment/hardware/*.yaml",
            "experiment/params/**/*.yaml",
            "robots/arms/*.urdf",
            "robots/arms/*.yaml",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        # For `ros2 run ... --params-file`.
        *((f"share/{NAME}/{folder}", files(folder)) for folder in ("params", "params/tuned", "params/tuned/laws")),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=True,
    maintainer="pidtsm maintainers",
    description="ROS-free heart of pidtsm: robots, laws, estimators, references, plant, rollout, metrics.",
    license="Apache-2.0",
)
