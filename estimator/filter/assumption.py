"""What a model assumes of a recording that does not declare it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Assumption:
    """One number of a model that its recording does not declare.

    Attributes
    ----------
    subject, quantity : of what, such as "gps" and "white noise of a reading"
    value, unit : SI; "" is no unit
    sigma : its 1-sigma; of a ratio that of the natural logarithm
    is_ratio : the value may be off by a factor, not by a sum: noise and other sizes
    source : where it is from: the log, the place, or what such instruments are known to do
    """

    subject: str
    quantity: str
    value: float
    unit: str
    sigma: float | None
    is_ratio: bool
    source: str
