"""`sinan serve`: a page on loopback into which logs are dropped."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from sinan.experiments.serve.jobs import Limits, Queue
from sinan.experiments.serve.server import LOOPBACK, Server
from sinan.sensors.errors import InputError


def run(port: int, limits: Limits, open_page: bool, say: Callable[[str], None]) -> None:
    """Serve until somebody stops it; logs and pages are in a temporary folder that goes with it.

    Parameters
    ----------
    port : on 127.0.0.1; 0: any that is free
    open_page : in the user's browser
    say : told where the page is

    Raises
    ------
    InputError : the port is taken
    """
    with TemporaryDirectory(prefix="sinan-", ignore_cleanup_errors=True) as folder:
        queue = Queue(Path(folder), limits)
        try:
            try:
                server = Server(port, queue)
            except OSError as error:
                found = f"{LOOPBACK}:{port}: {error.strerror}"
                raise InputError("--port", found, "a port that is free; 0: any") from None
            with server:
                say(f"serving {server.url} (Ctrl-C ends it)")
                if open_page:
                    webbrowser.open(server.url)
                server.serve_forever(poll_interval=0.2)
        finally:
            queue.close()
