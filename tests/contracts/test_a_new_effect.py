"""One file and one line: the example of docs/how_to_add_an_effect.md, run as it stands there."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import sinan.sensors.effects as effects
import sinan.sensors.effects.shipped as shipped
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.filter.flight import Flight
from sinan.experiments.commands.effects import run
from sinan.experiments.residual_loop.select import select
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.simulate import simulate

GUIDE = Path(__file__).parents[2] / "docs" / "how_to_add_an_effect.md"
NAME = "baro.suction"
BETA = 2.5  # m
THREE_SIGMA = 3.0


@pytest.fixture
def added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The guide's file in a folder of the package, and the guide's line in its registry."""
    code, line = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    file = re.search(r"`sensors/effects/(\w+\.py)`", GUIDE.read_text(encoding="utf-8"))
    assert file is not None
    (tmp_path / file[1]).write_text(code, encoding="utf-8")
    name, entry = re.fullmatch(r'\s*"([\w.]+)": \("(\w+)", None\),\s*', line).groups()  # type: ignore[union-attr]
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    monkeypatch.setitem(shipped.FILES, name, (entry, None))
    shipped.forget()
    yield
    sys.modules.pop(f"sinan.sensors.effects.{entry}", None)
    shipped.forget()


@pytest.mark.usefixtures("added")
def test_the_effect_of_the_guide_is_simulated_and_traced() -> None:
    present = [parse_effect(f"{NAME}={BETA}")]
    recording, _ = simulate(load_scenario("climb_descent"), np.random.default_rng(1), present)
    selection = select(FlightSource(Flight.of(recording)))
    assert selection.names == (NAME,)
    (finding,) = selection.findings
    assert abs(finding.beta[0] - BETA) < THREE_SIGMA * finding.std[0]


@pytest.mark.usefixtures("added")
def test_the_effect_of_the_guide_is_described() -> None:
    assert "enters        height += b x mean throttle" in run(NAME)


def test_it_is_gone_afterwards() -> None:
    assert NAME not in effects.CATALOGUE
