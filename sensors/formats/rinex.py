"""RINEX: measurements and broadcast messages of satellite receivers, versions 2.10 to 4.

What is read, what is left out and how fast: docs/notes/rinex_readers.md. The observation reader is in
`rinex_observation`, the navigation reader in `rinex_navigation`, what both share in `rinex_text`.
"""

from __future__ import annotations

from sinan.sensors.formats.rinex_navigation import GLONASS, KEPLER, Navigation, read_navigation
from sinan.sensors.formats.rinex_observation import Observations, read_observations

__all__ = ["GLONASS", "KEPLER", "Navigation", "Observations", "read_navigation", "read_observations"]
