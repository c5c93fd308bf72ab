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
    install_requires=[
        "setuptools",
        "pidtsm_core",
        "numpy",
        "scipy",
        "matplotlib",
        "jinja2",
        "pyyaml",
        "joblib",
        "cma",
        "trimesh",
        "pycollada",
        "fast-simplification",
    ],
    extras_require={
        "test": ["pytest"],
        "limit": ["casadi"],
        "video": ["av", "pyopengl"],
        "viewer": ["glfw", "pyopengl"],
    },
    entry_points={"pidtsm_core.names": ["check_gains = pidtsm_studies.theory.check:check_gains"]},
    zip_safe=True,
    maintainer="pidtsm maintainers",
    maintainer_email="maintainers@pidtsm.example",
    description="Studies of pidtsm without ROS: the article's claims, score, tuning, figures and reports.",
    license="Apache-2.0",
)
