"""The maker: draws recordings with sealed answers. It imports nothing of what it examines: constants, writer only."""

from sinan.experiments.blind.maker.make import make, make_one

__all__ = ["make", "make_one"]
