from setuptools import find_packages, setup

NAME = "pidtsm_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=find_packages(exclude=["test"]),
    package_data={NAME: ["py.typed", "*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": [
            "composed = pidtsm_ros.main:main",
        ],
        "pidtsm_ros.executables": [
            "composed = pidtsm_ros.composed:run",
        ],
    },
    zip_safe=False,
    maintainer="pidtsm maintainers",
    description="Shared code of the pidtsm nodes: parameters, joint order, quality of service, life cycle, main loop.",
    license="Apache-2.0",
)
