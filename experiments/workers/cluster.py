"""A running Dask cluster, whose scheduler gives tasks of a worker that dies to another."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from sinan.sensors.errors import InputError, with_extra


@contextmanager
def cluster(address: str) -> Iterator[Any]:
    """A client of the scheduler at an address.

    Raises
    ------
    InputError : Dask is not installed, or nobody answers
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--dask", "distributed is not installed", with_extra("dask")) from None
    try:
        client = Client(address, timeout="5s", set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        said = str(error) or "no answer"
    else:
        with client, client.as_current():
            yield client
        return
    gc.collect()  # of the client that failed: collected while the next starts its loop, it would wait for that lock
    raise InputError(f"--dask {address}", said, "the address of a Dask scheduler")
