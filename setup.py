"""Which folders are installed as what: the four at the top as parts of the one package `sinan`."""

from setuptools import find_packages, setup

PARTS = ("sensors", "estimator", "calibration", "experiments")

FACE = find_packages(include=["sinan", "sinan.*"])
#: How the labs for students are solved is for who has a clone.
KEPT_BACK = "experiments.student_labs.solutions"
FOUND = find_packages(include=[f"{part}*" for part in PARTS], exclude=[KEPT_BACK])

setup(
    packages=[*FACE, *(f"sinan.{name}" for name in FOUND)],
    exclude_package_data={"sinan.experiments": ["student_labs/solutions/*"]},
    package_dir={"sinan": "sinan"} | {f"sinan.{part}": part for part in PARTS},
)
