"""`sinan.positions`: fixes from pseudoranges, and which effects these call for, with a table, a figure and a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sinan.estimator.evidence.alpha import ALPHA
from sinan.estimator.positioning.location import Location
from sinan.experiments.answers.asked import Answer
from sinan.experiments.gnss.study import solution_table, solved, write_solution

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class Positions(Answer):
    """Positions of a receiver from its pseudoranges.

    Attributes
    ----------
    location : fixes of the full model, with residuals, dilution of precision and integrity
    document : the numbers, as `sinan gnss --json` writes them
    """

    location: Location
    document: dict[str, Any]

    def fixes(self) -> pd.DataFrame:
        """A row an epoch: GPS week, time [s], ECEF [m], geodetic [deg, m], clocks [m], satellites, DOP, integrity."""
        import pandas as pd

        head, rows = solution_table(self.location)
        return pd.DataFrame(rows, columns=head)

    def summary(self) -> str:
        """What `sinan gnss` prints: verdict, residuals and errors stage by stage, satellites that were excluded."""
        from sinan.experiments.report.gnss_words import summary

        return summary(self.document)

    def to_html(self, path: str | Path) -> Path:
        """Write the page of `sinan gnss --html`. Returns its path."""
        from sinan.experiments.report.gnss_page import gnss_page

        gnss_page(Path(path), self.document)
        return Path(path)

    def to_csv(self, path: str | Path) -> Path:
        """Write the table of `fixes`. Returns its path.

        Parameters
        ----------
        path : of the CSV file; one that is there is replaced
        """
        write_solution(path, self.location)
        return Path(path)

    def plot_stages(self) -> list[Axes]:
        """Residual, and error where the position is known, from the plain model to the full one."""
        from sinan.experiments.report import figures, screen
        from sinan.experiments.report.words import shown_stages

        return screen.axes(lambda: figures.stage_bars(shown_stages(self.document)))


def positions(
    observation: str | Path,
    navigation: str | Path | Sequence[str | Path],
    *,
    systems: str = "G,E,J,C",
    mask: float = 10.0,
    position: Sequence[float] | None = None,
    reference: str | Path | None = None,
    base: str | Path | None = None,
    base_position: Sequence[float] | None = None,
    alpha: float = ALPHA,
    code: str = "ca",
    link: str | None = None,
) -> Positions:
    """Positions from the pseudoranges of RINEX files, effect by effect, with DGPS where there is a base.

    Parameters
    ----------
    observation : RINEX observation file of the receiver
    navigation : RINEX navigation file, or several
    systems : letters, with or without commas: G GPS, E Galileo, J QZSS, C BeiDou, R GLONASS
    mask : lowest elevation [deg]
    position : (3,) known ECEF position of a receiver at rest [m]
    reference : file of known positions of a moving one: rows `gps_week,tow_s,x,y,z`, ECEF [m], or of RTKLIB
    base, base_position : observation file and ECEF position [m] of a base receiver
    alpha : probability of any false alarm of the trace, over all candidates together
    code : `ca`, `p` of GPS and GLONASS, or `p_two` of both frequencies of GPS, without ionosphere
    link : the data link from the base, such as `delay=5,loss=0.1`; None: every correction is there at once

    Returns
    -------
    Positions

    Raises
    ------
    InputError : a file or an argument that cannot be used

    Examples
    --------
    >>> import sinan
    >>> found = sinan.positions("rover.obs", "broadcast.nav", systems="G")
    >>> list(found.fixes().columns[2:5])
    ['x_ecef_m', 'y_ecef_m', 'z_ecef_m']
    """
    files = [navigation] if isinstance(navigation, str | Path) else list(navigation)
    document, location = solved(
        observation, files, systems, mask, position, reference, base, base_position, alpha, code, link
    )
    return Positions(location, document)
