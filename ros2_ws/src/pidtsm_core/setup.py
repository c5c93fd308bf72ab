from setuptools import find_packages, setup

NAME = "pidtsm_core"

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy", "numba", "joblib", "scipy"],
    extras_require={"dask": ["dask[distributed]"], "test": ["pytest"]},
    zip_safe=True,
    maintainer="pidtsm maintainers",
    maintainer_email="maintainers@pidtsm.example",
    description="ROS-free heart of pidtsm: robots, laws, estimators, references, plant, rollout, metrics.",
    license="Apache-2.0",
)
