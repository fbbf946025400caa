"""Documents and files fit their schemas, and pages name every key of them. `conftest.py` asks the former everywhere."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from typer.testing import CliRunner

from sinan.calibration.cameras.views import write_corners
from sinan.experiments.autopilots.parameter_set import ParameterSet
from sinan.experiments.blind.benchmark import REPORTS, refused
from sinan.experiments.blind.maker.make import make
from sinan.experiments.commands.cli import app
from sinan.experiments.monte_carlo.study import run
from sinan.experiments.schemas import schema, titles
from sinan.experiments.student_labs.files import Kind, begin
from sinan.sensors.errors import InputError
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.recording import ACCEL, GYRO, Recording, Stream
from tests.calibration.test_camera import SIZE, simulated
from tests.experiments.conftest import require_fit
from tests.experiments.test_camera import BENT
from tests.experiments.test_monte_carlo import short
from tests.experiments.test_student_labs import solve

DOCS = Path(__file__).parents[2] / "docs"


COMMANDS = {
    "trace": ["trace", "{poses}"],
    "estimate": ["estimate", "{flight}", "--smooth", "--to", "20"],
    "calibrate": ["calibrate", "mag", "{poses}"],
    "montecarlo": ["montecarlo", "hover", "--runs", "2"],
    "observability": ["observability", "{flight}"],
    "info": ["info", "{flight}"],
    "ranges": ["ranges", "{ranges}"],
    "allan": ["allan", "{rest}"],
    "heights": ["heights", "{low}"],
    "camera": ["camera", "{corners}"],
}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("json_keys")
    made = {"flight": "hover", "poses": "mag_poses", "low": "low_pass"}
    for name, scenario in made.items():
        effect = ["--effect", "mag.cross_axis=0.03,0,-0.02"]
        result = CliRunner().invoke(app, ["simulate", scenario, str(folder / name), *effect, "--seed", "7"])
        assert result.exit_code == 0, result.output
    short = folder / "short.toml"
    short.write_text('like = "static_p"\nseconds = 90\n[[fault]]\nsatellite = "G01"\noffset = 3.0\n', encoding="utf-8")
    t = np.arange(0.0, 60.0, 0.02)
    still = np.random.default_rng(1).normal([0.0, 0.0, -9.81, 0.0, 0.0, 0.0], 1e-3, (len(t), 6))
    imu = Stream(t, dict(zip((*ACCEL, *GYRO), still.T, strict=True)))
    write_recording(Recording("rest", "flight", {"imu": imu}), folder / "rest")
    corners = folder / "corners.csv"
    write_corners(corners, simulated(BENT, 8, 2, 0.15), SIZE)
    places = {name: folder / name for name in (*made, "rest")} | {"ranges": short, "corners": corners}
    return {name: str(place) for name, place in places.items()}


@pytest.mark.parametrize("command", COMMANDS)
def test_what_a_command_writes_fits_its_schema(command: str, recordings: dict[str, str], tmp_path: Path) -> None:
    words = [word.format(**recordings) for word in COMMANDS[command]]
    result = CliRunner().invoke(app, [*words, "--json", str(tmp_path / "out.json")])
    assert result.exit_code == 0, result.output
    written = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    require_fit(command, written)
    with pytest.raises(AssertionError, match="of_no_page"):
        require_fit(command, written | {"of_no_page": 1})
    with pytest.raises(AssertionError, match="format"):
        require_fit(command, written | {"format": 0.5})


def test_a_fleet_and_its_reports_fit_their_schemas(recordings: dict[str, str], tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.csv"
    damaged.write_text("nothing\n")
    words = ["batch", recordings["poses"], str(damaged), "--out", str(tmp_path / "out"), "--workers", "1"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    document = json.loads((tmp_path / "out" / "fleet.json").read_text(encoding="utf-8"))
    assert len(document["failed"]) == 1
    require_fit("batch", document)
    reports = [json.loads(path.read_text(encoding="utf-8")) for path in (tmp_path / "out" / "reports").glob("*.json")]
    own = {"log", "sha256", "vehicle", "sinan", "why_not"}
    traced = [{key: value for key, value in one.items() if key not in own} for one in reports if not one["why_not"]]
    assert len(traced) == 1
    require_fit("trace", traced[0])
    for one in reports:
        require_fit("batch-reports", one)
    with pytest.raises(AssertionError, match="limit"):
        require_fit("batch-reports", {**reports[0], "stopped_by": {"limit": "weight", "most": 1}})


def test_what_a_simulation_hides_fits_its_schema(recordings: dict[str, str]) -> None:
    for name in ("flight", "poses", "low"):
        require_fit("simulate", json.loads(Path(recordings[name] + ".answer.json").read_text(encoding="utf-8")))


def test_what_blind_recordings_hide_and_how_they_were_graded_fit_their_schemas(tmp_path: Path) -> None:
    assert CliRunner().invoke(app, ["blind", str(tmp_path), "--runs", "1", "--seed", "2"]).exit_code == 0
    make(tmp_path / "more", 4, 8, ["mag_poses", "gyro_turns"], "mixed", ["outside", "several"])
    for folder in ("recordings", "more"):
        require_fit("blind-index", json.loads((tmp_path / folder / "index.json").read_text(encoding="utf-8")))
    answers = [*tmp_path.glob("*.answers/*/answer.json")]
    assert len(answers) == 9
    for path in answers:
        require_fit("blind-answer", json.loads(path.read_text(encoding="utf-8")))
    require_fit("blind", json.loads((tmp_path / "rates.json").read_text(encoding="utf-8")))
    (report,) = (tmp_path / REPORTS).glob("*.json")
    kept = json.loads(report.read_text(encoding="utf-8"))
    require_fit("blind-reports", kept)
    assert set(kept["report"]) <= {"cpu_seconds", *schema("trace")["properties"]}
    require_fit("blind-reports", kept | {"report": refused("no readings")})


def test_runs_that_are_kept_fit_their_schemas(tmp_path: Path) -> None:
    run(short(), 2, workers=1, resume=tmp_path, relinearise=True)
    plan = json.loads((tmp_path / "plan.json").read_text(encoding="utf-8"))
    require_fit("montecarlo-plan", plan)
    kept = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(tmp_path.glob("run-*.json"))]
    assert len(kept) == 2
    for one in kept:
        require_fit("montecarlo-run", one)
    with pytest.raises(AssertionError, match="seed"):
        require_fit("montecarlo-plan", {**plan, "seed": "7"})
    with pytest.raises(AssertionError, match="more"):
        require_fit("montecarlo-run", {**kept[0], "more": 1})


def test_files_of_a_lab_fit_their_schemas(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begin("gps", "1", tmp_path / "own", Kind(solved=True), key=tmp_path / "key.json")
    solve("gps", tmp_path / "own", monkeypatch)
    for name, path in (("answer.json", "own/answer.json"), ("lab-seals", "own/seals.json"), ("lab-key", "key.json")):
        require_fit(name, json.loads((tmp_path / path).read_text(encoding="utf-8")))


def keys_of(part: dict[str, Any], path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every key of a schema, by its path; `*` for the entries of a list and for any name."""
    for key, inner in (part.get("properties", {}) | part.get("patternProperties", {})).items():
        yield f"{path}{key}", inner
        yield from keys_of(inner, f"{path}{key}.")
    for inner in part.get("anyOf", ()):
        yield from keys_of(inner, path)
    for inner in (part.get("items"), part.get("additionalProperties")):
        if isinstance(inner, dict):
            yield from keys_of(inner, f"{path}*.")


@pytest.mark.parametrize("name", titles())
def test_every_key_says_what_it_means(name: str) -> None:
    found = dict(keys_of(schema(name)))
    assert len(found) > (name == "blind-index")  # whose one table has any names
    assert not [path for path, inner in found.items() if not inner.get("description")]


def test_an_autopilots_parameters_fit_the_schema_of_a_trace() -> None:
    params = ParameterSet("px4", {})
    params.put("EKF2_MAG_DELAY", 100.7, "mag.time_offset")
    params.refuse("gyro.scale", "none")
    part = schema("trace")["properties"]["autopilot"]
    jsonschema.validate(params.as_table() | {"call": None}, part)
    assert part["additionalProperties"] is False


@pytest.mark.parametrize(
    ("name", "pattern"),
    [
        ("map.toml", "experiments/datasets/*/*.toml"),
        ("dataset.toml", "experiments/datasets/*/dataset.toml"),
        ("scenario.toml", "experiments/scenarios/*.toml"),
        ("scenario.toml", "experiments/mapping/*.toml"),
        ("ranges.toml", "experiments/gnss/scenarios/*.toml"),
    ],
)
def test_files_that_are_shipped_fit_their_schemas(name: str, pattern: str) -> None:
    files = [path for path in DOCS.parent.glob(pattern) if (path.name == "dataset.toml") == (name == "dataset.toml")]
    assert files
    for path in files:
        require_fit(name, as_json(path.read_text(encoding="utf-8")))


def as_json(text: str) -> Any:
    """Of a TOML file; dates are texts."""
    return json.loads(json.dumps(tomllib.loads(text), default=str))


def test_recordings_and_the_examples_of_the_manual_fit_their_schemas(recordings: dict[str, str]) -> None:
    for name in ("flight", "poses", "low", "rest"):
        require_fit("recording.toml", as_json((Path(recordings[name]) / "recording.toml").read_text(encoding="utf-8")))
    blocks = [as_json(text) for text in re.findall(r"```toml\n(.*?)```", (DOCS / "formats.md").read_text(), re.DOTALL)]
    recording = [one for one in blocks if one.get("format") == 1]
    maps = [one for one in blocks if "streams" in one and "format" not in one]
    assert len(recording) == 1
    assert len(maps) >= 4
    require_fit("recording.toml", recording[0])
    for one in maps:
        require_fit("map.toml", one)


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("recording.toml", {"format": 1, "kind": "flight", "sensors": {"baro": {"noise": 1.0}}}),
        ("recording.toml", {"format": 1, "kind": "flight", "environment": {"gravity": -9.8}}),
        ("map.toml", {"kind": "flight", "streams": {"baro": {"time": "t", "heigth": "h"}}}),
        ("map.toml", {"kind": "flight", "streams": {"baro": {"time": {"column": "t", "unit": "min"}}}}),
        ("scenario.toml", {"like": "hover", "manoeuvre": [{"kind": "loop", "duration": 1.0}]}),
        ("ranges.toml", {"like": "static_p", "fault": [{"satelite": "G01"}]}),
        ("dataset.toml", {"title": "a", "files": {"a.csv": {"byte": 3}}}),
        ("answer.json", {"K": "large", "clock": [1.0, 2.0]}),
    ],
)
def test_what_a_reader_refuses_does_not_fit(name: str, wrong: dict[str, Any]) -> None:
    with pytest.raises(AssertionError, match=name):
        require_fit(name, wrong)


def names_in(part: Any) -> set[str]:
    """All keys that a schema of a file names, but those of effects."""
    if not isinstance(part, dict):
        return set()
    inner = part.get("properties", {})
    below = [value for key, value in inner.items() if key != "effects"]
    more = [part.get("items"), part.get("additionalProperties"), *part.get("anyOf", ())]
    return set(inner).union(*map(names_in, [*below, *more]))


@pytest.mark.parametrize(
    ("name", "page"),
    [("recording.toml", "formats"), ("map.toml", "formats"), ("scenario.toml", "scenarios"), ("ranges.toml", "gnss")],
)
def test_the_manual_names_every_key_of_a_file(name: str, page: str) -> None:
    text = "".join((DOCS / f"{one}.md").read_text(encoding="utf-8") for one in {page, "formats"})
    assert not {key for key in names_in(schema(name)) if not re.search(rf"\b{key}\b", text)}


def test_a_schema_is_printed_by_its_name_and_all_are_listed() -> None:
    listed = CliRunner().invoke(app, ["schema"]).output
    assert [line.split()[0] for line in listed.splitlines()] == list(titles())
    assert json.loads(CliRunner().invoke(app, ["schema", "trace"]).output) == schema("trace")
    with pytest.raises(InputError, match=r"expected one of trace, estimate"):
        schema("tracer")
