"""A function killed at every write: `python tests/killing.py FILE FUNCTION FOLDER`.

FUNCTION of FILE is called with a copy of FOLDER/before. It is killed in the middle of a file, at ever more bytes of it
(SIGXFSZ), each time with another copy; then (SIGKILL) at its first write, its second, and so on until it ends itself.
The copies stay, as FOLDER/000, FOLDER/001, ...; the last is the one that was not killed. Writes are what the
interpreter's audit events say of them: nothing needs to know how the function writes.
"""

from __future__ import annotations

import importlib.util
import os
import resource
import shutil
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Events that change a disk; a file that is opened may be one that is only read.
CHANGES = ("os.rename", "os.mkdir", "os.remove", "os.rmdir", "os.link", "os.symlink", "os.chmod", "os.truncate")
MOST = 300
#: A file is cut off at so many bytes, four times as many, and so on.
FIRST_CUT, LAST_CUT = 64, 2**24
#: Python 3.11 takes a compiled module that was cut off in writing for a whole one: every later import of it fails.
FOR_FULL_DISKS = {"PYTHONDONTWRITEBYTECODE": "1"}


def killed(file: str, function: str, folder: Path) -> list[Path]:
    """The copies of `folder`/before in which the function was killed, and last the one in which it was not."""
    command = [sys.executable, __file__, file, function, str(folder)]
    environment = {**os.environ, **FOR_FULL_DISKS, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return sorted(path for path in folder.iterdir() if path.name.isdigit())


@contextmanager
def no_file_beyond(size: int) -> Iterator[None]:
    """As on a full disk: a write beyond so many bytes of a file fails."""
    before, compiled = resource.getrlimit(resource.RLIMIT_FSIZE), sys.dont_write_bytecode
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    sys.dont_write_bytecode = True
    try:
        yield
    finally:
        sys.dont_write_bytecode = compiled
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def is_write(event: str, arguments: tuple[object, ...]) -> bool:
    """Whether an audit event is one of something that is about to be written, moved or removed."""
    if event == "open":
        flags = arguments[2]
        return isinstance(flags, int) and bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
    # a call of the system that Python has no name for: it is looked up, then called
    return event in CHANGES or (event == "ctypes.dlsym" and str(arguments[1]).startswith("rename"))


def _die_at(write: int) -> None:
    count = 0

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal count
        if is_write(event, arguments):
            count += 1
            if count == write:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)


def _die_beyond(size: int) -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
    signal.signal(signal.SIGXFSZ, signal.SIG_DFL)


def _dies(act: Callable[[Path], object], folder: Path, number: int, arm: Callable[[], None]) -> bool:
    """Whether the function is killed in a copy of its own."""
    copy = folder / f"{number:03d}"
    shutil.copytree(folder / "before", copy, symlinks=True)
    child = os.fork()
    if child == 0:
        try:
            arm()
            act(copy)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    status = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGKILL, signal.SIGXFSZ):
        return True
    if status != 0:
        raise SystemExit(f"not killed, and failed: {status}")
    return False


def main(file: str, function: str, folder: Path) -> None:
    """Kill, and kill again."""
    sys.path.insert(0, str(ROOT))
    spec = importlib.util.spec_from_file_location("to_be_killed", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    act = getattr(module, function)
    act(Path(shutil.copytree(folder / "before", folder / "alive", symlinks=True)))  # all is imported and compiled
    number, size = 0, FIRST_CUT
    while size <= LAST_CUT and _dies(act, folder, number, partial(_die_beyond, size)):
        number, size = number + 1, 4 * size
    shutil.rmtree(folder / f"{number:03d}")  # the one that lived: it is tried again, write by write
    write = 1
    while _dies(act, folder, number, partial(_die_at, write)):
        number, write = number + 1, write + 1
        assert write < MOST


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], Path(sys.argv[3]))
