"""The client of a service gives the answers of this process, and behaves as the service asks."""

import http.server
import json
import ssl
import threading
import time
import urllib.request

import pytest
from conftest import ROOT

import dvi


def test_a_service_gives_the_same_digits(service, belt):
    here, there = dvi.solve(belt), dvi.Client(service).solve(belt)
    assert there.names == here.names and there.events == here.events
    for name in here.names:
        assert there[name].tobytes() == here[name].tobytes()
    assert there.diagnostics["steps"] == here.diagnostics["steps"] and there.trusted


def test_a_job_is_submitted_followed_and_fetched(service, belt):
    client = dvi.Client(service)
    job = client.submit({**belt, "label": "followed"})
    told = list(job.events())
    assert told[-1][0] == "done" and {name for name, _ in told} <= {"progress", "switch", "done"}
    assert job.result()["x"].size and job.ended
    assert job.id in [found.id for found in client.jobs(label="followed")]
    job.delete()
    with pytest.raises(dvi.ServiceError) as raised:
        client.job(job.id)
    assert raised.value.status == 404


def test_a_job_is_cancelled(service, endless):
    endless["output"] = {"times": {"count": 2}}
    client = dvi.Client(service)
    job = client.submit(endless)
    while job.refresh().status == "accepted":
        time.sleep(0.01)
    client.cancel(job)
    assert job.wait(30).status == "dismissed"


def test_errors_are_those_of_this_process(service):
    spec = {"problem": {"dvi": {"states": {"x": {"inital": 1, "rate": "-x"}}}}, "time": {"end": 1}}
    with pytest.raises(dvi.SpecificationError) as there:
        dvi.Client(service).solve(spec)
    with pytest.raises(dvi.SpecificationError) as here:
        dvi.solve(spec)
    assert there.value.errors == here.value.errors
    blown = {"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "x^2"}}}}, "time": {"end": 2}}
    with pytest.raises(dvi.SolveError) as raised:
        dvi.Client(service).solve(blown)
    assert raised.value.result["x"].size > 1


def test_pages_of_jobs_are_walked(service, belt):
    client = dvi.Client(service)
    for k in range(3):
        client.submit({**belt, "label": "paged", "time": {"end": 1 + k}}).wait()
    assert len(list(client.jobs(label="paged"))) == 3


class Reluctant(http.server.BaseHTTPRequestHandler):
    """Says later twice, then answers with what was stored."""

    keys: list = []
    seen: list = []
    answer = b""

    def do_POST(self):
        self.rfile.read(int(self.headers["Content-Length"]))
        type(self).keys.append(self.headers["Idempotency-Key"])
        type(self).seen.append(time.monotonic())
        if len(self.keys) < 3:
            self.send_response(429 if len(self.keys) == 1 else 503)
            self.send_header("Retry-After", "1")
            self.send_header("Content-Length", "2")
            self.end_headers()
            self.wfile.write(b"{}")
            return
        self.send_response(200)
        self.send_header("Content-Length", str(len(self.answer)))
        self.end_headers()
        self.wfile.write(self.answer)

    def log_message(self, *_):
        pass


def test_what_is_asked_to_wait_waits_and_shows_the_same_key(belt):
    Reluctant.keys, Reluctant.seen, Reluctant.answer = [], [], dvi.solve(belt).to_json()
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Reluctant)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        answer = dvi.Client(f"http://127.0.0.1:{server.server_port}").solve(belt)
    finally:
        server.shutdown()
    assert answer["x"].size and len(set(Reluctant.keys)) == 1 and len(Reluctant.keys) == 3
    assert all(later - sooner >= 1.0 for sooner, later in zip(Reluctant.seen, Reluctant.seen[1:]))


def test_an_encrypted_service_is_asked_by_those_who_trust_it(service, belt, monkeypatch):
    certificates = ROOT / "tests/service/tls"
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificates / "localhost.pem", certificates / "localhost.key")

    class Encrypting(http.server.BaseHTTPRequestHandler):
        """Passes requests on to the service, and its answers back."""

        def do_POST(self):
            body = self.rfile.read(int(self.headers["Content-Length"]))
            headers = {name: self.headers[name] for name in ("Content-Type", "Accept", "Prefer")}
            with urllib.request.urlopen(urllib.request.Request(service + self.path, body, headers)) as answer:
                body = answer.read()
            self.send_response(answer.status)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Encrypting)
    server.socket = context.wrap_socket(server.socket, server_side=True)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    client = dvi.Client(f"https://localhost:{server.server_port}", retries=0)
    try:
        monkeypatch.setenv("SSL_CERT_FILE", str(certificates / "authority.pem"))
        assert client.solve(belt)["x"].tobytes() == dvi.solve(belt)["x"].tobytes()
        monkeypatch.delenv("SSL_CERT_FILE")
        with pytest.raises(dvi.ServiceError, match="does not answer.*certificate"):
            client.solve(belt)
    finally:
        server.shutdown()


def test_nobody_there_is_said_so():
    with pytest.raises(dvi.ServiceError, match="does not answer"):
        dvi.Client("http://127.0.0.1:9", retries=0).version()
    with pytest.raises(ValueError, match="no address"):
        dvi.Client("localhost:8080")
    with pytest.warns(UserWarning, match="plain text"):
        dvi.Client("http://lab.example", token="dvi_secret")


def test_every_json_answer_reads_back(belt):
    here = dvi.solve(belt)
    back = dvi.Result.from_json(here.to_json())
    assert back["x"].tobytes() == here["x"].tobytes() and back.evidence == here.evidence
    with pytest.raises(ValueError):
        dvi.Result.from_json(b"{}")
    with pytest.raises(RuntimeError, match="elsewhere"):
        back(1.0)
    assert json.loads((ROOT / "api/examples/relay.json").read_text())
