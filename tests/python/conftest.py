"""What the tests share: the examples, the program (`DVI_PROGRAM`), a running service."""

import json
import os
import pathlib
import signal
import socket
import subprocess
import time
import urllib.request

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "api/examples").glob("*.json"))


def pytest_configure(config):
    # A shell starts background jobs with SIGINT ignored, which child processes inherit; but the tests
    # send SIGINT to themselves.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    config.addinivalue_line("markers", "slow: takes more than some seconds")


@pytest.fixture(scope="session")
def program():
    """The program, to compare with."""
    path = os.environ.get("DVI_PROGRAM")
    if not path:
        pytest.skip("DVI_PROGRAM names no program")
    return path


@pytest.fixture(scope="session")
def service(program, tmp_path_factory):
    """The address of a service that lives as long as the tests."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    log = open(tmp_path_factory.mktemp("service") / "log", "w")
    server = subprocess.Popen([program, "serve", "--ephemeral", "--listen", address], stderr=log)
    url = f"http://{address}"
    for _ in range(200):
        try:
            urllib.request.urlopen(url + "/healthz", timeout=1)
            break
        except OSError:
            assert server.poll() is None, "the service ended"
            time.sleep(0.05)
    yield url
    server.terminate()
    server.wait(20)


@pytest.fixture
def belt():
    """A block on a belt, whose friction sticks and slips."""
    return json.loads((ROOT / "api/examples/friction_belt.json").read_text())


@pytest.fixture
def endless():
    """A solve that ends long after anybody waits for it."""
    states = {"x": {"initial": 1, "rate": "v"}, "v": {"initial": 0, "rate": "-x"}}
    return {"problem": {"dvi": {"states": states}}, "time": {"end": 1e9}, "method": {"rtol": 1e-10}}
