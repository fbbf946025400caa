"""The page on loopback: what a browser may ask, and of whom nothing is taken.

Another site's page in the same browser can send requests to this machine too. So a request has to name this server as
its host (a name that another's DNS points here does not), what changes something has to come from this very page with
the secret that only it was given, and the pages of logs are shown in a sandbox without an origin.
"""

from __future__ import annotations

import hmac
import json
import re
import secrets
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from sinan.experiments.report.made import sinan_version
from sinan.experiments.serve.jobs import DONE, Job, Queue, Refused

LOOPBACK = "127.0.0.1"
_BLOCK = 1 << 20
#: A connection on which nothing comes for so long is closed [s].
_PATIENCE = 30.0
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src 'self'; form-action 'none'; "
    "frame-ancestors 'none'; base-uri 'none'"
)
#: Of a log's own page, beside the policy that is in it.
_SANDBOX = "sandbox allow-scripts; frame-ancestors 'none'"
_LONGEST_NAME = 200
_SITE = {"/serve.js": "text/javascript", "/serve.css": "text/css"}
_JOB = re.compile(r"/jobs/([0-9a-f]{16})(?:/(page|report\.json))?")


class Server(ThreadingHTTPServer):
    """On loopback only.

    Parameters
    ----------
    port : 0: any that is free
    queue : of the logs

    Raises
    ------
    OSError : the port is taken
    """

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True

    def __init__(self, port: int, queue: Queue) -> None:
        super().__init__((LOOPBACK, port), _Handler)
        self.queue, self.secret = queue, secrets.token_urlsafe(24)

    @property
    def port(self) -> int:
        """On which it listens."""
        return int(self.server_address[1])

    @property
    def url(self) -> str:
        """What a browser opens."""
        return f"http://{LOOPBACK}:{self.port}/"

    @property
    def hosts(self) -> tuple[str, str]:
        """How a request may call it."""
        return f"{LOOPBACK}:{self.port}", f"localhost:{self.port}"

    def handle_error(self, request: object, client_address: object) -> None:
        """A connection that breaks off is nothing to tell."""


class _Handler(BaseHTTPRequestHandler):
    server: Server
    protocol_version = "HTTP/1.1"
    timeout = _PATIENCE

    def version_string(self) -> str:
        return "sinan"

    def log_message(self, format: str, *args: object) -> None:
        """Nothing: what is asked is the user's own affair."""

    # ---- what is asked

    def do_GET(self) -> None:
        """The page, its script, the list, a job's page and numbers."""
        path = urlsplit(self.path).path
        if not self._is_ours(path == "/"):
            return
        if path == "/":
            html = _site("serve.html").replace("SECRET", self.server.secret).replace("VERSION", sinan_version())
            limit = self.server.queue.limits.size
            self._send(html.replace("LIMIT", str(limit)).encode(), "text/html", _POLICY)
        elif path in _SITE:
            self._send(_site(path[1:]).encode(), _SITE[path])
        elif path == "/jobs":
            self._json({"jobs": [job.as_table() for job in self.server.queue]})
        elif (found := _JOB.fullmatch(path)) and found[2] and (job := self.server.queue.get(found[1])):
            self._result(job, found[2])
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "nothing of that name")

    do_HEAD = do_GET

    def do_POST(self) -> None:
        """A log, as it is, in the body; its name in the query."""
        parts = urlsplit(self.path)
        if not self._is_ours() or not self._is_from_our_page():
            return
        if parts.path != "/jobs":
            self._refuse(HTTPStatus.NOT_FOUND, "nothing of that name")
            return
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or "Transfer-Encoding" in self.headers:
            self._refuse(HTTPStatus.LENGTH_REQUIRED, "a log whose size is not said")
            return
        try:
            job = self.server.queue.new(_name_in(parts.query), int(length))
        except Refused as error:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, str(error))
            return
        if not self._take(job):
            self.server.queue.discard(job)
            self.close_connection = True
            return
        self.server.queue.add(job)
        self._json({"id": job.number}, HTTPStatus.CREATED)

    def do_DELETE(self) -> None:
        """End a job and forget it."""
        if not self._is_ours() or not self._is_from_our_page():
            return
        found = _JOB.fullmatch(urlsplit(self.path).path)
        if found and not found[2] and self.server.queue.remove(found[1]):
            self._json({})
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "nothing of that name")

    # ---- who asks

    def _is_ours(self, from_elsewhere: bool = False) -> bool:
        """Whether a request is meant for this server; a link from elsewhere may lead to its front page."""
        site = self.headers.get("Sec-Fetch-Site", "none")
        if self.headers.get("Host", "") in self.server.hosts and (from_elsewhere or site in ("same-origin", "none")):
            return True
        self._refuse(HTTPStatus.FORBIDDEN, "a request for another host, or from another site")
        return False

    def _is_from_our_page(self) -> bool:
        """Whether it was sent by the page that this server gave out."""
        origin = self.headers.get("Origin")
        same = origin is None or origin in {f"http://{host}" for host in self.server.hosts}
        given = self.headers.get("X-Sinan", "")
        if same and hmac.compare_digest(given.encode(), self.server.secret.encode()):
            return True
        self._refuse(HTTPStatus.FORBIDDEN, "a request from another page")
        return False

    # ---- answers

    def _take(self, job: Job) -> bool:
        """The body into the log's file; False: it broke off."""
        left = job.size
        try:
            with job.log.open("wb") as file:
                while left > 0 and (block := self.rfile.read(min(left, _BLOCK))):
                    file.write(block)
                    left -= len(block)
        except OSError:
            return False
        return left == 0

    def _result(self, job: Job, what: str) -> None:
        path, kind, policy = (
            (job.page, "text/html", _SANDBOX) if what == "page" else (job.report, "application/json", "")
        )
        content = _bytes(path) if job.state == DONE else None
        if content is None:
            self._refuse(HTTPStatus.NOT_FOUND, "not there yet")
        else:
            self._send(content, kind, policy)

    def _json(self, document: dict[str, Any], status: HTTPStatus = HTTPStatus.OK) -> None:
        self._send(json.dumps(document).encode(), "application/json", status=status)

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self.close_connection = True  # what was sent with it is not read
        self._json({"why": why}, status)

    def _send(self, content: bytes, kind: str, policy: str = "", status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Content-Security-Policy", policy or "default-src 'none'; frame-ancestors 'none'")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("Cross-Origin-Opener-Policy", "same-origin")
        self.send_header("Cache-Control", "no-store")
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)


def _name_in(query: str) -> str:
    """How a log is called: the last part of what may be a path, in letters that print."""
    said = parse_qs(query).get("name", [""])[0].replace("\\", "/").rsplit("/", 1)[-1]
    return "".join(c for c in said if c.isprintable())[-_LONGEST_NAME:] or "log"


def _site(name: str) -> str:
    return (files("sinan.experiments.serve") / "site" / name).read_text(encoding="utf-8")


def _bytes(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None
