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
    python_requires=">=3.10",
    install_requires=[
        "numpy>=1.26",
        # Its internals are used; a new version is tried before it is allowed.
        "numba>=0.60,<0.69",
        "joblib>=1.3",
        "cloudpickle>=3",
        "scipy>=1.11",
        "ruckig>=0.15",
        "pyyaml>=6",
        "threadpoolctl>=3",
        # mujoco-core is mujoco without its viewer.
        "mujoco-core; python_version >= '3.11'",
        "mujoco<4; python_version < '3.11'",
    ],
    extras_require={
        "dask": ["dask[distributed]"],
        "plot": ["matplotlib"],
        "poses": ["mink>=1.3"],
        "tables": ["pandas", "xarray"],
        "xacro": ["xacro"],
        "test": ["pytest"],
    },
    zip_safe=True,
    maintainer="pidtsm maintainers",
    maintainer_email="maintainers@pidtsm.example",
    description="ROS-free heart of pidtsm: robots, laws, estimators, references, plant, rollout, metrics.",
    license="Apache-2.0",
)
