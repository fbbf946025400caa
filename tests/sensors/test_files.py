"""Files and folders are whole or not there: killed at every write, without room, through links, to devices."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from sinan.sensors import files
from sinan.sensors.errors import InputError
from sinan.sensors.files import new_file, new_folder, together, write_bytes, write_text
from tests.killing import killed, no_file_beyond

OLD, NEW = "old\n" * 300, "new\n" * 300
NAMES = ("a.csv", "b.csv", "head.toml")


def visible(folder: Path) -> dict[str, str]:
    """What is in a folder, at any depth, but for hidden parts."""
    paths = [path for path in folder.rglob("*") if path.is_file()]
    names = {str(path.relative_to(folder)): path for path in paths}
    return {name: path.read_text() for name, path in names.items() if ".part" not in name}


def write_a_file(folder: Path) -> None:
    write_text(folder / "file", NEW)


def fill(folder: Path, text: str, names: tuple[str, ...] = NAMES) -> None:
    with new_folder(folder, NAMES) as beside:
        for name in names:
            (beside / name).write_text(text)


def write_a_folder(folder: Path) -> None:
    fill(folder / "out", NEW, NAMES[1:])


def write_two_together(folder: Path) -> None:
    with together():
        fill(folder / "out", NEW)
        write_text(folder / "file", NEW)


def test_a_file_killed_at_every_write_is_the_old_or_the_new_one(tmp_path: Path) -> None:
    (tmp_path / "before").mkdir()
    (tmp_path / "before" / "file").write_text(OLD)
    *dead, alive = killed(__file__, "write_a_file", tmp_path)
    assert len(dead) > 4
    assert all(visible(folder) in ({"file": OLD}, {"file": NEW}) for folder in dead)
    assert visible(alive) == {"file": NEW}
    assert os.listdir(alive) == ["file"]


@pytest.mark.parametrize("there", [True, False])
def test_a_folder_killed_at_every_write_is_the_old_or_the_new_one(tmp_path: Path, there: bool) -> None:
    (tmp_path / "before").mkdir()
    old = {}
    if there:
        fill(tmp_path / "before" / "out", OLD)
        (tmp_path / "before" / "out" / "notes").mkdir()
        (tmp_path / "before" / "out" / "notes" / "mine.txt").write_text("mine")
        old = {**{f"out/{name}": OLD for name in NAMES}, "out/notes/mine.txt": "mine"}
    new = {**{f"out/{name}": NEW for name in NAMES[1:]}, **{name: text for name, text in old.items() if text == "mine"}}
    *dead, alive = killed(__file__, "write_a_folder", tmp_path)
    assert len(dead) > 4
    assert all(visible(folder) in (old, new) for folder in dead)
    assert visible(alive) == new
    assert os.listdir(alive) == ["out"]


def test_of_two_that_are_written_together_neither_is_half(tmp_path: Path) -> None:
    (tmp_path / "before").mkdir()
    *dead, alive = killed(__file__, "write_two_together", tmp_path)
    folder = {f"out/{name}": NEW for name in NAMES}
    assert all(visible(one) in ({}, folder, {**folder, "file": NEW}) for one in dead)
    assert visible(alive) == {**folder, "file": NEW}


def test_without_room_the_old_file_stays_and_the_error_says_so(tmp_path: Path) -> None:
    write_text(tmp_path / "file", OLD)
    with no_file_beyond(1000), pytest.raises(InputError, match=r"file: File too large; expected more room on its disk"):
        write_text(tmp_path / "file", "long" * 1000)
    assert visible(tmp_path) == {"file": OLD}
    assert os.listdir(tmp_path) == ["file"]


def test_without_room_the_old_folder_stays_and_the_error_says_so(tmp_path: Path) -> None:
    fill(tmp_path / "out", OLD)
    with no_file_beyond(2000), pytest.raises(InputError, match="out: File too large; expected more room"):
        fill(tmp_path / "out", "long" * 1000)
    assert visible(tmp_path) == {f"out/{name}": OLD for name in NAMES}
    assert os.listdir(tmp_path) == ["out"]


def test_nothing_of_what_is_written_together_is_there_after_an_error(tmp_path: Path) -> None:
    def write_three() -> None:
        with together():
            write_text(tmp_path / "first", NEW)
            fill(tmp_path / "out", NEW)
            with no_file_beyond(100):
                write_text(tmp_path / "second", NEW)

    with pytest.raises(InputError, match="second"):
        write_three()
    assert os.listdir(tmp_path) == []


def test_what_failed_inside_is_not_moved_with_the_others(tmp_path: Path) -> None:
    with together():
        write_text(tmp_path / "first", NEW)
        with no_file_beyond(100), pytest.raises(InputError):
            write_text(tmp_path / "second", NEW)
        write_text(tmp_path / "third", OLD)
        write_text(tmp_path / "third", NEW)
    assert visible(tmp_path) == {"first": NEW, "third": NEW}


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_error_while_it_is_filled_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    def fail_in_a_file() -> None:
        with new_file(tmp_path / "file") as file:
            file.write(NEW)
            raise error

    def fail_in_a_folder() -> None:
        with new_folder(tmp_path / "out", NAMES) as beside:
            (beside / "a.csv").write_text(NEW)
            raise error

    for fail in (fail_in_a_file, fail_in_a_folder):
        with pytest.raises(error):
            fail()
    assert os.listdir(tmp_path) == []


def test_a_link_is_replaced_and_what_it_points_to_is_not_written(tmp_path: Path) -> None:
    (tmp_path / "kept").write_text(OLD)
    (tmp_path / "file").symlink_to("kept")
    write_text(tmp_path / "file", NEW)
    assert visible(tmp_path) == {"file": NEW, "kept": OLD}


def test_links_in_a_folder_that_is_replaced_are_not_followed(tmp_path: Path) -> None:
    fill(tmp_path / "out", OLD)
    for name in ("head.toml", "mine"):
        (tmp_path / f"{name}.kept").write_text(OLD)
        (tmp_path / "out" / name).unlink(missing_ok=True)
        (tmp_path / "out" / name).symlink_to(f"../{name}.kept")
    fill(tmp_path / "out", NEW)
    assert (tmp_path / "head.toml.kept").read_text() == OLD
    assert not (tmp_path / "out" / "head.toml").is_symlink()
    assert os.readlink(tmp_path / "out" / "mine") == "../mine.kept"


def test_a_link_to_a_folder_is_followed(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "out").symlink_to("there")
    fill(tmp_path / "out", NEW)
    assert (tmp_path / "out").is_symlink()
    assert set(os.listdir(tmp_path / "there")) == set(NAMES)


def test_a_full_device_is_an_error_and_stays_a_device() -> None:
    with pytest.raises(InputError, match="/dev/full: No space left on device; expected more room"):
        write_bytes(Path("/dev/full"), b"x")
    write_text(Path("/dev/null"), NEW)
    assert all(stat.S_ISCHR(os.stat(path).st_mode) for path in ("/dev/full", "/dev/null"))


def test_a_pipe_is_written_straight(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    write_text(tmp_path / "pipe", "through")
    assert os.read(reader, 100) == b"through"
    os.close(reader)
    assert os.listdir(tmp_path) == ["pipe"]


def test_the_mode_of_what_is_replaced_stays(tmp_path: Path) -> None:
    write_text(tmp_path / "file", OLD)
    fill(tmp_path / "out", OLD)
    (tmp_path / "file").chmod(0o600)
    (tmp_path / "out").chmod(0o700)
    write_text(tmp_path / "file", NEW)
    fill(tmp_path / "out", NEW)
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o600
    assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == 0o700


def test_the_longest_name_has_room_for_its_part(tmp_path: Path) -> None:
    write_text(tmp_path / ("ü" * 127), NEW)
    assert os.listdir(tmp_path) == ["ü" * 127]


def test_the_current_folder_is_filled_where_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder that is put in the place of the current one is not the one that a shell stands in."""
    monkeypatch.chdir(tmp_path)
    fill(Path("."), OLD)
    assert set(os.listdir(".")) == set(NAMES)
    with pytest.raises(InputError, match="the current folder"):
        fill(Path("."), NEW)
    assert visible(tmp_path) == dict.fromkeys(NAMES, OLD)


def test_without_a_swap_in_one_step_it_goes_by_a_third_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "_swapped_in_one_step", lambda one, other: False)
    fill(tmp_path / "out", OLD)
    fill(tmp_path / "out", NEW, NAMES[1:])
    assert visible(tmp_path) == {f"out/{name}": NEW for name in NAMES[1:]}
    assert os.listdir(tmp_path) == ["out"]


def test_by_a_third_name_the_old_folder_comes_back_after_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rename = Path.rename

    def failing(self: Path, target: Path) -> Path:
        if self.name.endswith(".part"):
            raise OSError(28, "No space left on device")
        return rename(self, target)

    fill(tmp_path / "out", OLD)
    monkeypatch.setattr(files, "_swapped_in_one_step", lambda one, other: False)
    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(InputError, match="No space left"):
        fill(tmp_path / "out", NEW)
    assert visible(tmp_path) == {f"out/{name}": OLD for name in NAMES}
    assert os.listdir(tmp_path) == ["out"]
