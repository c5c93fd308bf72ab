from pathlib import Path

from setuptools import find_packages, setup

NAME = "pidtsm_experiments"
SHARED = ("launch", "rviz", "foxglove", "plotjuggler")


def files(folder: str) -> list[str]:
    """Files of a folder, without the dangling links that colcon leaves of renamed ones in its build folder."""
    return sorted(str(path) for path in Path(folder).iterdir() if path.is_file())


setup(
    name=NAME,
    version="0.2.0",
    packages=find_packages(exclude=["test"]),
    package_data={NAME: ["py.typed", "templates/*/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *((f"share/{NAME}/{folder}", files(folder)) for folder in SHARED),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": [
            "recorder = pidtsm_ros.main:main",
            "live = pidtsm_ros.main:main",
        ],
        "pidtsm_ros.executables": [
            "recorder = pidtsm_experiments.bags.recorder_node:run",
            "live = pidtsm_experiments.live.executable:run",
        ],
    },
    zip_safe=True,
    maintainer="pidtsm maintainers",
    description="Runs, bags and command line of pidtsm.",
    license="Apache-2.0",
)
