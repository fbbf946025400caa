"""What `sinan serve` takes, of whom, and that nothing of it is left."""

from __future__ import annotations

import http.client
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Thread

import pytest

from sinan.experiments.serve import jobs
from sinan.experiments.serve.jobs import DONE, FAILED, WAITING, Job, Limits, Queue, Refused
from sinan.experiments.serve.server import Server
from tests.experiments.conftest import require_fit

ROOT = Path(__file__).resolve().parents[2]
LIMIT = 20.0  # s, of what takes one
#: What the process of a job does in place of a trace.
SLEEPS = 'import time; print(\'{"stage": "sleeping"}\', flush=True); time.sleep(600)'
DIES = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"


@pytest.fixture
def short_jobs(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Lets every job run a text of Python in place of the trace."""
    whole = subprocess.Popen

    def instead(text: str) -> None:
        monkeypatch.setattr(jobs.subprocess, "Popen", lambda words, **more: whole([sys.executable, "-c", text], **more))

    return instead


@pytest.fixture
def queue(tmp_path: Path) -> Iterator[Queue]:
    """One with room for little."""
    found = Queue(tmp_path / "jobs", Limits(size=1000, seconds=0.6, waiting=2))
    yield found
    found.close()


def add(queue: Queue, name: str = "log.bin") -> Job:
    job = queue.new(name, 4)
    job.log.write_bytes(b"none")
    queue.add(job)
    return job


def waited(ready: Callable[[], object]) -> None:
    end = time.monotonic() + LIMIT
    while not ready():
        assert time.monotonic() < end
        time.sleep(0.02)


def is_gone(process: int) -> bool:
    try:
        os.kill(process, 0)
    except OSError:
        return True
    return False


def test_job_that_takes_too_long_is_ended(
    queue: Queue, short_jobs: Callable[[str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a disk that takes its time: whoever sees the end of a job finds its log gone."""
    unlink = Path.unlink

    def slow(path: Path, missing_ok: bool = False) -> None:
        time.sleep(0.3)
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", slow)
    short_jobs(SLEEPS)
    job = add(queue)
    waited(lambda: job.state == FAILED)
    assert "longest that a log may take" in job.said["why"]
    assert job.process is not None
    assert is_gone(job.process.pid)
    assert not job.log.exists()


def test_job_that_takes_too_much_memory_is_ended_and_the_next_goes_on(tmp_path: Path) -> None:
    """By the very process that traces: a table of 57 MB of text, under a limit that its columns alone nearly reach."""
    queue = Queue(tmp_path / "jobs", Limits(seconds=LIMIT, memory=192 * 2**20))
    try:
        head, row = b"t,ax,ay,az,gx,gy,gz\n", b"%.2f,0.1,0.2,-9.8,0.01,0.0,0.1\n"
        large, small = queue.new("large.csv", 1), queue.new("small.csv", 1)
        with large.log.open("wb") as file:
            file.write(head)
            for k in range(0, 1_500_000, 10_000):
                file.write(b"".join(row % (0.01 * j) for j in range(k, k + 10_000)))
        small.log.write_bytes(head + row % 0.0)
        queue.add(large)
        queue.add(small)
        waited(lambda: large.state == small.state == FAILED)
    finally:
        queue.close()
    assert large.said["why"] == "it needs more than 192 MB of memory, the most that a log may take (--memory)"
    assert "1 row; expected at least 2 IMU samples" in small.said["why"]
    assert large.process is not None
    assert is_gone(large.process.pid)
    assert not large.log.exists()


def test_job_that_is_killed_is_told_and_the_next_goes_on(queue: Queue, short_jobs: Callable[[str], None]) -> None:
    short_jobs(DIES)
    first = add(queue)
    waited(lambda: first.state == FAILED)
    assert "without an answer" in first.said["why"]
    second = add(queue)
    waited(lambda: second.state == FAILED)


def test_removed_job_is_ended_and_leaves_nothing(queue: Queue, short_jobs: Callable[[str], None]) -> None:
    short_jobs(SLEEPS)
    job = add(queue)
    waited(lambda: job.stage == "sleeping")
    assert queue.remove(job.number)
    assert job.process is not None
    assert is_gone(job.process.pid)
    waited(lambda: not job.folder.exists())
    assert not queue.remove(job.number)


def test_queue_has_limits(queue: Queue, short_jobs: Callable[[str], None]) -> None:
    short_jobs(SLEEPS)
    first = add(queue)
    waited(lambda: first.state != WAITING)
    add(queue)
    add(queue)
    with pytest.raises(Refused, match="2 logs wait"):
        queue.new("fourth", 4)
    with pytest.raises(Refused, match="at most"):
        queue.new("large", 1001)
    with pytest.raises(Refused, match="empty"):
        queue.new("empty", 0)


@pytest.mark.parametrize("name", ["../../etc/passwd", "<img src=x>", ".hidden", "..", "a" * 300, "\u202elog"])
def test_log_stays_in_its_folder_whatever_its_name(queue: Queue, name: str) -> None:
    job = queue.new(name, 4)
    assert job.log.parent == job.folder
    job.log.write_bytes(b"none")
    assert job.log.resolve().is_relative_to(job.folder.resolve())


@pytest.fixture
def server(queue: Queue) -> Iterator[Server]:
    with Server(0, queue) as found:
        Thread(target=found.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()
        yield found
        found.shutdown()


def asked(
    server: Server, method: str, path: str, body: bytes | None = None, **headers: str
) -> tuple[int, str, dict[str, str]]:
    """Status, body and headers of an answer; a header's name has _ for -."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=LIMIT)
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path, body, {"Host": server.hosts[0], **named})
    answer = connection.getresponse()
    found = answer.status, answer.read().decode(), dict(answer.getheaders())
    connection.close()
    return found


def test_only_loopback_is_listened_on(server: Server) -> None:
    assert server.server_address[0] == "127.0.0.1"


@pytest.mark.parametrize(
    "headers",
    [{"Host": "evil.example"}, {"Host": "evil.example:80"}, {"Host": ""}, {"Sec_Fetch_Site": "cross-site"}],
)
def test_request_for_another_host_or_from_another_site_is_refused(server: Server, headers: dict[str, str]) -> None:
    status, body, _ = asked(server, "GET", "/jobs", **headers)
    assert status == 403
    assert "jobs" not in body


@pytest.mark.parametrize(
    "change",
    [{"X_Sinan": "guessed"}, {"X_Sinan": ""}, {"Origin": "http://evil.example"}, {"Origin": "null"},
     {"Sec_Fetch_Site": "cross-site"}, {"Host": "evil.example"}],
)  # fmt: skip
@pytest.mark.parametrize("method", ["POST", "DELETE"])
def test_what_changes_something_comes_from_our_own_page(server: Server, method: str, change: dict[str, str]) -> None:
    path = "/jobs?name=log" if method == "POST" else f"/jobs/{'0' * 16}"
    whole = {"X_Sinan": server.secret, "Origin": f"http://{server.hosts[0]}"}
    status, _, _ = asked(server, method, path, b"none", **{**whole, **change})
    assert status == 403
    assert list(server.queue) == []


def test_upload_is_taken_or_refused_by_its_size(server: Server, short_jobs: Callable[[str], None]) -> None:
    short_jobs(DIES)
    assert asked(server, "POST", "/jobs?name=a%2Fb.bin", b"none", X_Sinan=server.secret)[0] == 201
    assert [job.name for job in server.queue] == ["b.bin"]
    status, body, _ = asked(server, "POST", "/jobs?name=large", b"x" * 1001, X_Sinan=server.secret)
    assert status == 413
    assert "at most" in body


def test_list_of_jobs_fits_its_schema(server: Server, short_jobs: Callable[[str], None]) -> None:
    short_jobs(DIES)
    job = add(server.queue)
    waited(lambda: job.state == FAILED)
    require_fit("serve-jobs", json.loads(asked(server, "GET", "/jobs")[1]))
    job.state, job.said = DONE, {"verdict": "no_effect", "headline": "No effect."}
    require_fit("serve-jobs", json.loads(asked(server, "GET", "/jobs")[1]))


def test_page_of_a_log_has_no_origin_and_nothing_else_is_served(
    server: Server, short_jobs: Callable[[str], None]
) -> None:
    short_jobs(DIES)
    job = add(server.queue)
    waited(lambda: job.state == FAILED)
    assert asked(server, "GET", f"/jobs/{job.number}/page")[0] == 404
    job.page.write_text("<h1>a page</h1>")
    job.state = DONE
    status, body, headers = asked(server, "GET", f"/jobs/{job.number}/page")
    assert (status, body) == (200, "<h1>a page</h1>")
    assert headers["Content-Security-Policy"].startswith("sandbox allow-scripts;")
    for path in ("/../../etc/passwd", "/jobs/../page", f"/jobs/{job.number}/log", "/serve.html", "/jobs/1/page"):
        assert asked(server, "GET", path)[0] == 404


def test_ctrl_c_ends_the_command_and_its_folder(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)}
    process = subprocess.Popen(
        [sys.executable, "-m", "sinan", "serve", "--port", "0"], env=environment, text=True, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        port = re.search(r"127\.0\.0\.1:(\d+)", process.stdout.readline())
        assert port is not None
        connection = http.client.HTTPConnection("127.0.0.1", int(port[1]), timeout=LIMIT)
        connection.request("GET", "/")
        secret = re.search(r'name="sinan" content="([^"]+)"', connection.getresponse().read().decode())
        assert secret is not None
        connection.request("POST", "/jobs?name=log", b"x" * 100, {"X-Sinan": secret[1]})
        assert connection.getresponse().status == 201
        connection.close()
        assert len(list(tmp_path.glob("sinan-*/*"))) == 1
        began = time.monotonic()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=LIMIT)
    finally:
        process.kill()
    assert process.returncode == 130
    assert said == "sinan: stopped\n"
    assert time.monotonic() - began < 3.0  # alone on a machine a tenth of it
    assert list(tmp_path.glob("sinan-*")) == []
