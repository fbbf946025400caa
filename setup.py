"""Which folders are installed as what: the four at the top as parts of the one package `sinan`."""

from setuptools import find_packages, setup

PARTS = ("sensors", "estimator", "calibration", "experiments")

setup(
    packages=["sinan", *(f"sinan.{name}" for name in find_packages(include=[f"{part}*" for part in PARTS]))],
    package_dir={"sinan": "sinan"} | {f"sinan.{part}": part for part in PARTS},
)
