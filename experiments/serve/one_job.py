"""`python -m sinan.experiments.serve.one_job LOG NAME FOLDER BYTES`: trace one log; a line of JSON a stage and the end.

It may ask for so many bytes of memory. It ends when whoever started it does: its standard input is open until then.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from threading import Thread
from typing import Any

from sinan.experiments.workers.alone import Limits, limit_memory

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")


def main() -> None:
    """Read, trace, draw; what goes wrong is an answer, too."""
    log, name, folder = sys.argv[1:4]
    limits = Limits(memory=int(sys.argv[4]))
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a library prints is no answer
    Thread(target=_end_with_parent, daemon=True).start()

    def tell(**said: Any) -> None:
        out.write(json.dumps(said) + "\n")
        out.flush()

    tell(stage="loading")
    sys.argv = ["sinan", "trace", name]  # which does the same: the page says so
    from sinan.experiments.fleet.logs import Log
    from sinan.experiments.fleet.one_log import answer
    from sinan.experiments.report.files import write_json
    from sinan.experiments.report.made import digest_of
    from sinan.sensors.files import write_text

    limit_memory(limits.memory)
    found = answer(Log(name, digest_of(Path(log))), log, limits, lambda what: tell(stage=what))
    if found.document["why_not"] is not None:
        tell(answer="failed", why=str(found.document["why_not"]).replace(log, name))
        return
    write_json(Path(folder) / "report.json", found.document)
    write_text(Path(folder) / "page.html", found.page)
    tell(answer="done", verdict=found.document["verdict"], headline=found.document["headline"])


def _end_with_parent() -> None:
    """Wait for the end of the input."""
    while os.read(0, 4096):
        pass
    os._exit(1)


if __name__ == "__main__":
    main()
