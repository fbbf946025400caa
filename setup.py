"""Which folders are installed as what: the four at the top as parts of the one package `sinan`."""

from setuptools import find_packages, setup

PARTS = ("sensors", "estimator", "calibration", "experiments")

FACE = find_packages(include=["sinan", "sinan.*"])
FOUND = find_packages(include=[f"{part}*" for part in PARTS])

setup(
    packages=[*FACE, *(f"sinan.{name}" for name in FOUND)],
    package_dir={"sinan": "sinan"} | {f"sinan.{part}": part for part in PARTS},
)
