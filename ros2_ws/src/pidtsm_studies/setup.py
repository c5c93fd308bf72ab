from setuptools import find_packages, setup

NAME = "pidtsm_studies"

setup(
    name=NAME,
    version="0.2.0",
    packages=find_packages(exclude=["test"]),
    package_data={NAME: ["py.typed", "*.mplstyle", "*/*.yaml", "*/templates/*", "*/templates/*/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    entry_points={"pidtsm_core.names": ["check_gains = pidtsm_studies.theory.check:check_gains"]},
    zip_safe=True,
    maintainer="pidtsm maintainers",
    description="Studies of pidtsm without ROS: the article's claims, score, tuning, figures and reports.",
    license="Apache-2.0",
)
