"""A client of a service, on the standard library alone."""

from __future__ import annotations

import json
import random
import time
import urllib.error
import urllib.parse
import urllib.request
import uuid
from collections.abc import Iterator
from email.utils import parsedate_to_datetime
from typing import Any, Optional, cast

from ._families import with_fit, with_period, with_rest, with_sensitivities, with_sweep
from ._result import Result
from ._searches import Fit, Orbit, Sensitivities, SteadyState
from ._specification import Source, SpecificationError, text_of
from ._sweep import Sweep

#: Seconds within which a service answers a solve before the solve becomes a job; and a margin for the transfer over
#: the network.
WAIT = 30
MARGIN = 30.0
#: HTTP statuses after which a request is repeated later.
LATER = (429, 503)
#: The longest pause between two attempts, in seconds, if the service names none.
LONGEST_PAUSE = 10.0
ENDED = ("successful", "failed", "dismissed")


class ServiceError(RuntimeError):
    """A service that refused, or did not answer. `status` is that of HTTP, or None where there was no answer; `problem` is what
    the service said (RFC 9457)."""

    def __init__(self, message: str, status: Optional[int] = None, problem: Optional[dict[str, Any]] = None) -> None:
        super().__init__(message)
        self.status = status
        self.problem = problem or {}


class Job:
    """A solve that a service has accepted. It goes on there whether or not someone waits."""

    def __init__(self, client: Client, status: dict[str, Any]) -> None:
        self._client = client
        #: The last status of the job that the service has sent.
        self.info = status
        self.id: str = status["id"]

    @property
    def status(self) -> str:
        """`accepted`, `running`, `successful`, `failed` or `dismissed`, as last seen; `refresh` looks again."""
        status: str = self.info["status"]
        return status

    @property
    def ended(self) -> bool:
        """Whether it had ended when last seen."""
        return self.status in ENDED

    def refresh(self) -> Job:
        """Looks again."""
        self.info = self._client._json("GET", f"/jobs/{self.id}")
        return self

    def cancel(self) -> Job:
        """Stops it; what it has so far stays."""
        self._client._send("POST", f"/jobs/{self.id}/cancel")
        return self.refresh()

    def delete(self) -> None:
        """Stops and forgets it."""
        self._client._send("DELETE", f"/jobs/{self.id}")

    def events(self) -> Iterator[tuple[str, Any]]:
        """What happens, as it happens: pairs of a word (`progress`, `switch`, `done`) and its data. A broken connection is
        taken up where it ended."""
        last: Optional[str] = None
        failures = 0
        while True:
            headers = {"Accept": "text/event-stream", **({"Last-Event-ID": last} if last is not None else {})}
            try:
                with self._client._open(self._client._request("GET", f"/jobs/{self.id}/events", headers=headers)) as stream:
                    for name, number, data in _events(stream):
                        last, failures = number or last, 0
                        yield name, data
                        if name == "done":
                            return
            except (OSError, urllib.error.URLError) as error:
                failures += 1
                if failures > self._client.retries:
                    raise ServiceError(f"the events of job {self.id} broke off: {error}") from error
            time.sleep(_pause(failures))

    def wait(self, timeout: Optional[float] = None, progress: Any = None) -> Job:
        """Waits until it has ended; `progress` is called with the fraction done and the steps."""
        until = None if timeout is None else time.monotonic() + timeout
        pause = 0.05
        while not self.refresh().ended:
            if callable(progress):
                progress(self.info.get("progress", 0) / 100, self.info.get("steps", 0))
            if until is not None and time.monotonic() + pause > until:
                raise TimeoutError(f"job {self.id} has not ended after {timeout} s")
            time.sleep(pause)
            pause = min(2 * pause, 1.0)
        return self

    def result(self, timeout: Optional[float] = None) -> Result:
        """Waits for the end and fetches the answer; raises `SolveError` with what there is where the end was not reached."""
        self.wait(timeout)
        return self._client._result(f"/jobs/{self.id}/results", self.info.get("label")).completed()

    def __repr__(self) -> str:
        return f"<dvi.Job {self.id} {self.status}>"


class Client:
    """A service that solves: `Client("http://localhost:8080").solve(spec)` is `solve(spec)` there.

    `retries` is how often a request is made again after a lost connection, 429 or 503, as late as `Retry-After` asks for. Requests
    that begin a solve have an `Idempotency-Key`, so that none is made twice.
    """

    def __init__(self, url: str, token: Optional[str] = None, *, timeout: float = 60.0, retries: int = 5) -> None:
        parts = urllib.parse.urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.netloc:
            raise ValueError(f"{url!r} is no address of a service, such as http://localhost:8080")
        if token and parts.scheme == "http" and parts.hostname not in ("localhost", "127.0.0.1", "::1"):
            import warnings

            warnings.warn(f"the token goes to {parts.hostname} in plain text: use https", stacklevel=2)
        self.url = url.rstrip("/")
        self.timeout = timeout
        self.retries = retries
        self._token = token

    def solve(self, spec: Source, *, progress: Any = None) -> Result:
        """Has the service solve a specification, and waits for the answer; the arguments are those of `dvi.solve`."""
        text = text_of(spec)
        headers = {"Prefer": f"wait={WAIT}", "Accept": "application/json", "Idempotency-Key": str(uuid.uuid4())}
        with self._send("POST", "/solve", text, headers, timeout=WAIT + MARGIN) as answer:
            body = answer.read()
            if answer.status == 200:
                return Result.from_json(body, _label(text)).completed()
        job = Job(self, json.loads(body))
        try:
            job.wait(progress=progress)
        except KeyboardInterrupt:
            job.cancel()
            raise
        return job.result()

    def sweep(self, spec: Source, *arguments: Any, progress: Any = None, **asked: Any) -> Sweep:
        """Has the service solve for many values; the arguments are those of `dvi.sweep`, but `threads`, of which it has its own."""
        return cast(Sweep, self.solve(with_sweep(spec, *arguments, **asked), progress=progress))

    def fit(self, spec: Source, *arguments: Any, progress: Any = None, **asked: Any) -> Fit:
        """Has the service fit parameters to data; the arguments are those of `dvi.fit`."""
        document = with_fit(spec, *arguments, **asked)
        found = cast(Fit, self.solve(document, progress=progress))
        found.data = document["fit"]["data"]
        return found

    def sensitivities(self, spec: Source, to: Any, of: Any = None, *, progress: Any = None) -> Sensitivities:
        """Has the service solve with derivatives; the arguments are those of `dvi.sensitivities`."""
        return cast(Sensitivities, self.solve(with_sensitivities(spec, to, of), progress=progress))

    def periodic(self, spec: Source, period: Any, *, progress: Any = None) -> Orbit:
        """Has the service find an orbit; the arguments are those of `dvi.periodic`."""
        return cast(Orbit, self.solve(with_period(spec, period), progress=progress))

    def steady_state(self, spec: Source, *, progress: Any = None) -> SteadyState:
        """Has the service find a state of rest."""
        return cast(SteadyState, self.solve(with_rest(spec), progress=progress))

    def submit(self, spec: Source) -> Job:
        """Hands a specification over without waiting."""
        headers = {"Prefer": "respond-async", "Idempotency-Key": str(uuid.uuid4())}
        with self._send("POST", "/solve", text_of(spec), headers) as answer:
            return Job(self, json.loads(answer.read()))

    def check(self, spec: Source) -> dict[str, Any]:
        """What a specification comes to, without a solve."""
        with self._send("POST", "/check", text_of(spec)) as answer:
            found: dict[str, Any] = json.loads(answer.read())
            return found

    def job(self, id: str) -> Job:
        """A job by its name."""
        return Job(self, self._json("GET", f"/jobs/{urllib.parse.quote(id, safe='')}"))

    def jobs(self, status: Optional[str] = None, label: Optional[str] = None) -> Iterator[Job]:
        """One's own jobs, newest first."""
        query = {key: value for key, value in (("status", status), ("label", label)) if value is not None}
        path: Optional[str] = "/jobs" + (f"?{urllib.parse.urlencode(query)}" if query else "")
        while path is not None:
            with self._send("GET", path) as answer:
                page, link = json.loads(answer.read()), answer.headers.get("Link", "")
            for job in page["jobs"]:
                yield Job(self, job)
            query_of_next = link.partition("<")[2].partition(">")[0].partition("?")[2] if 'rel="next"' in link else ""
            path = f"/jobs?{query_of_next}" if query_of_next else None

    def cancel(self, job: Any) -> Job:
        """Stops a job, given itself or its name."""
        return (job if isinstance(job, Job) else self.job(job)).cancel()

    def version(self) -> dict[str, Any]:
        """The version of the service."""
        return self._json("GET", "/version")

    # --- requests

    def _result(self, path: str, label: Optional[str]) -> Result:
        with self._send("GET", path, headers={"Accept": "application/json"}) as answer:
            return Result.from_json(answer.read(), label)

    def _json(self, method: str, path: str) -> dict[str, Any]:
        with self._send(method, path) as answer:
            read: dict[str, Any] = json.loads(answer.read())
            return read

    def _request(
        self, method: str, path: str, body: Optional[bytes] = None, headers: Optional[dict[str, str]] = None
    ) -> urllib.request.Request:
        sent = {"Accept": "application/json", **(headers or {})}
        if body is not None or method == "POST":
            sent["Content-Type"] = "application/json"
            body = body or b""
        if self._token:
            sent["Authorization"] = f"Bearer {self._token}"
        return urllib.request.Request(self.url + path, data=body, headers=sent, method=method)

    def _open(self, request: urllib.request.Request, timeout: Optional[float] = None) -> Any:
        return urllib.request.urlopen(request, timeout=timeout or self.timeout)

    def _send(
        self,
        method: str,
        path: str,
        body: Optional[bytes] = None,
        headers: Optional[dict[str, str]] = None,
        timeout: Optional[float] = None,
    ) -> Any:
        """Sends a request, and sends it again where that may help."""
        request = self._request(method, path, body, headers)
        attempt = 0
        while True:
            attempt += 1
            try:
                return self._open(request, timeout)
            except urllib.error.HTTPError as error:
                with error:
                    refusal = _refusal(error)
                if error.code not in LATER or attempt > self.retries:
                    raise refusal from None
                time.sleep(_asked(error.headers.get("Retry-After"), attempt))
            except (urllib.error.URLError, ConnectionError, TimeoutError) as error:
                if attempt > self.retries:
                    reason = getattr(error, "reason", error)
                    raise ServiceError(f"{self.url} does not answer: {reason}") from error
                time.sleep(_pause(attempt))

    def __repr__(self) -> str:
        return f"<dvi.Client {self.url}>"


def _label(text: bytes) -> Optional[str]:
    label = json.loads(text).get("label")
    return label if isinstance(label, str) else None


def _refusal(error: urllib.error.HTTPError) -> Exception:
    """What the service says, as an exception: errors of a specification as those of `dvi.solve`."""
    body = error.read()
    try:
        problem = json.loads(body)
    except ValueError:
        problem = {"detail": body.decode(errors="replace")[:200]}
    if not isinstance(problem, dict):
        problem = {"detail": str(problem)[:200]}
    if error.code == 400 and isinstance(problem.get("errors"), list):
        return SpecificationError.of_json(problem["errors"])
    told = problem.get("detail") or problem.get("title") or error.reason
    return ServiceError(f"{error.code}: {told}", error.code, problem)


def _pause(attempt: int) -> float:
    """Twice as long each time, and of random length, so that clients do not come back together."""
    return random.uniform(0.5, 1.0) * min(0.1 * 2.0**attempt, LONGEST_PAUSE)


def _asked(retry_after: Optional[str], attempt: int) -> float:
    """The seconds that `Retry-After` asks for, a number or a date."""
    if retry_after is None:
        return _pause(attempt)
    try:
        return max(0.0, float(retry_after))
    except ValueError:
        pass
    try:
        return max(0.0, parsedate_to_datetime(retry_after).timestamp() - time.time())
    except (TypeError, ValueError):
        return _pause(attempt)


def _events(stream: Any) -> Iterator[tuple[str, Optional[str], Any]]:
    """Server-sent events: names, numbers and data (WHATWG HTML, section 9.2)."""
    name = "message"
    number: Optional[str] = None
    data: list[str] = []
    for line in stream:
        text = line.decode().rstrip("\r\n")
        if not text:
            if data:
                yield name, number, json.loads("\n".join(data))
            name, data = "message", []
            continue
        key, _, value = text.partition(":")
        value = value[1:] if value.startswith(" ") else value
        if key == "event":
            name = value
        elif key == "id":
            number = value
        elif key == "data":
            data.append(value)
