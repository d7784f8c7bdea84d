"""Every fenced block of README and guide, run in a folder that has what the text says: `belt.json`, the examples under `api`, a service.

What a block names is put in the place of what it stands for, and nothing else is changed: the address of the service, the program for
`cargo run --release --`, the identifier of a job or a token, folders of a system. A block that nobody runs fails the test, unless
`ELSEWHERE` says which test has it. Usage: snippets.py PROGRAM
"""

import json
import os
import pathlib
import re
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "api/python/README.md", *sorted((ROOT / "api/guide").glob("*.md"))]

#: Fenced code blocks of the documentation that another test runs: the page, the language, a part of the
#: block, and the path of that test.
ELSEWHERE = [
    ("api/guide/", "json", "", "tests/specification/guide.rs"),
    ("api/guide/recipes.md", "rust", "", "src/lib.rs"),
    ("README.md", "python", "import dvi", "tests/python/test_readme.py"),
    ("api/python/README.md", "python", "", "tests/python/test_readme.py"),
    ("api/python/README.md", "sh", "pip install ./api/python", "tests/python/run"),
]


class LeftOut(Exception):
    """What a block needs is not installed."""


def blocks(path):
    """Line, language and text of the fenced blocks that have a language."""
    text = path.read_text()
    for found in re.finditer(r"^```(\w+)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        yield text.count("\n", 0, found.start()) + 1, found.group(1), found.group(2)


def needs(*commands):
    for command in commands:
        if shutil.which(command):
            return shutil.which(command)
    raise LeftOut(f"{' or '.join(commands)} is not installed")


class Encrypting:
    """A proxy that encrypts what a service says, with `cert.pem` and `key.pem` of a folder; its port."""

    def __init__(self, folder, address):
        host, port = address.rsplit(":", 1)
        self.service = host, int(port)
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.context.load_cert_chain(folder / "cert.pem", folder / "key.pem")

    def __enter__(self):
        self.listener = socket.create_server(("127.0.0.1", 0))
        threading.Thread(target=self.accept, daemon=True).start()
        return self.listener.getsockname()[1]

    def __exit__(self, *_):
        # The listening socket is shut down before it is closed: a thread that waits in accept()
        # would keep it open.
        self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()

    def accept(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            threading.Thread(target=self.meet, args=(client,), daemon=True).start()

    def meet(self, client):
        try:
            client = self.context.wrap_socket(client, server_side=True)
        except OSError:
            # A client that does not trust the certificate has disconnected during the TLS
            # handshake.
            return
        service = socket.create_connection(self.service)
        threading.Thread(target=self.copy, args=(client, service), daemon=True).start()
        self.copy(service, client)

    @staticmethod
    def copy(source, destination):
        try:
            while data := source.recv(65536):
                destination.sendall(data)
            destination.shutdown(socket.SHUT_WR)
        except OSError:
            pass


class Desk:
    """A folder, a service and the program on the path."""

    def __init__(self, program, folder):
        self.program, self.folder = program, pathlib.Path(folder)
        self.address = f"127.0.0.1:{os.environ.get('DVI_SNIPPETS_PORT', '18086')}"
        commands = self.folder / "bin"
        commands.mkdir()
        (commands / "dvi").symlink_to(program)
        (self.folder / "api").symlink_to(ROOT / "api")
        self.data = self.folder / "data"
        self.environment = {**os.environ, "PATH": f"{commands}:{os.environ['PATH']}", "DVI_DATA": str(self.data), "DVI_LISTEN": self.address}
        (json_block,) = [text for _, language, text in blocks(ROOT / "api/guide/start.md") if language == "json"]
        (self.folder / "belt.json").write_text(json_block)
        self.log = open(self.folder / "log", "w")
        self.service = subprocess.Popen([program, "serve"], env=self.environment, stderr=self.log, cwd=self.folder)
        self.until_alive(self.service)
        # A stand-in for systemctl: it reports the service as the main process of the
        # unit that the page on backups names.
        stand_in = commands / "systemctl"
        stand_in.write_text(f'#!/bin/sh\n[ "$*" = "show -P MainPID dvi" ] && echo {self.service.pid}\n')
        stand_in.chmod(0o755)

    def until_alive(self, service):
        for _ in range(200):
            if subprocess.run([self.program, "healthcheck", "--listen", self.address], capture_output=True).returncode == 0:
                return
            assert service.poll() is None, f"the service ended: {(self.folder / 'log').read_text()}"
            time.sleep(0.05)
        raise AssertionError("the service does not answer")

    def run(self, command, text=None, environment=None):
        done = subprocess.run(command, input=text, text=True, capture_output=True, cwd=self.folder, env=environment or self.environment, timeout=120)
        assert done.returncode == 0, f"exit code {done.returncode}\n{done.stdout}{done.stderr}"
        return done.stdout

    def here(self, text):
        """The text, with the address of this service."""
        return re.sub(r"\b(localhost|127\.0\.0\.1):8080\b", self.address, text)

    # --- languages

    def rust(self, text):
        """It stands in the documentation of the crate, whose programs are tests."""
        told = [line.removeprefix("//!").removeprefix(" ") for line in (ROOT / "src/lib.rs").read_text().splitlines()]
        if text.strip() not in "\n".join(told):
            raise AssertionError("it is not in the documentation of src/lib.rs")

    def shell(self, text):
        told = ""
        for line in text.splitlines():
            # Commands that do not end by themselves (a service) or that run all tests
            # are taken out of the block and run separately.
            if line.startswith("cargo run --release -- serve"):
                self.own_service()
                text = text.replace(line, "")
            if line.startswith("tests/run"):
                self.run(["bash", "-n", str(ROOT / "tests/run")])
                text = text.replace(line, "")
        text = self.here(text)
        if "jobs/ID" in text:
            text = text.replace("jobs/ID", f"jobs/{self.job()}")
        if "token revoke" in text:
            before, text = re.match(r"(.*)^(dvi token revoke.*)\Z", text, re.DOTALL | re.MULTILINE).groups()
            told += self.run(["bash", "-euo", "pipefail"], before)
            (token, *_) = re.findall(r"\b[0-9a-f]{16}\b", self.run(["dvi", "token", "list"]))
            text = text.replace("0123456789abcdef", token)
        if "/backup" in text:
            (self.folder / "backup").mkdir()
            text = text.replace("/var/lib/dvi", str(self.data)).replace("/backup", str(self.folder / "backup"))
        # With this option curl fails if the service refuses a request.
        told += self.run(["bash", "-euo", "pipefail"], 'curl() { command curl --fail-with-body "$@"; }\n' + text)
        if "openssl req" in text:
            self.encrypted(text)
        for line in text.splitlines():
            if re.match(r"(curl|dvi solve)\b", line) and ">" not in line:
                assert told.strip(), "nothing is answered"
        assert "problem+json" not in told, told
        return told

    def own_service(self):
        address = re.sub(r"\d+$", lambda port: str(int(port.group()) + 1), self.address)
        service = subprocess.Popen([self.program, "serve"], env={**self.environment, "DVI_LISTEN": address, "DVI_EPHEMERAL": "true"}, stderr=self.log)
        self.address, kept = address, self.address
        try:
            self.until_alive(service)
        finally:
            self.address = kept
            service.send_signal(signal.SIGTERM)
            assert service.wait(30) == 0

    def encrypted(self, text):
        """A proxy shows the service with the certificate that was made; one of an authority is refused, and it is said how to make another."""
        solve = ["dvi", "solve", "--format", "csv", "belt.json", "--server"]
        plain = self.run([*solve, f"http://{self.address}"])
        environment = {**self.environment, "SSL_CERT_FILE": "cert.pem"}
        with Encrypting(self.folder, self.address) as port:
            assert self.run([*solve, f"https://localhost:{port}"], environment=environment) == plain
            told = self.run(["curl", "-sS", "--cacert", "cert.pem", f"https://localhost:{port}/version"])
            assert json.loads(told)["name"] == "dvi"
        # Makes a certificate without the option CA:FALSE, whose necessity the text of the guide
        # explains.
        authority = text.replace(" -addext basicConstraints=critical,CA:FALSE", "")
        assert authority != text
        self.run(["bash", "-euo", "pipefail"], authority)
        with Encrypting(self.folder, self.address) as port:
            done = subprocess.run([*solve, f"https://localhost:{port}"], text=True, capture_output=True, cwd=self.folder, env=environment, timeout=60)
            assert done.returncode == 6 and "CA:FALSE" in done.stderr, done.stderr

    def job(self):
        request = urllib.request.Request(f"http://{self.address}/solve", (self.folder / "belt.json").read_bytes(), {"content-type": "application/json", "prefer": "respond-async"})
        with urllib.request.urlopen(request) as answer:
            job = json.load(answer)["id"]
        for _ in range(400):
            with urllib.request.urlopen(f"http://{self.address}/jobs/{job}") as answer:
                if json.load(answer)["status"] == "successful":
                    return job
            time.sleep(0.05)
        raise AssertionError("the job does not end")

    def json(self, text):
        if text.lstrip().startswith("{"):
            file = self.folder / "shown.json"
            file.write_text(text)
            self.run([self.program, "solve", str(file)])
            return
        # The block is an excerpt of a result in JSON: an actual result must have these
        # members, and these members must have the members in the block.
        answer = json.loads(self.run([self.program, "solve", "belt.json"]))
        part = json.loads("{" + text + "}")
        assert part.keys() <= answer.keys(), sorted(part.keys() - answer.keys())
        for name, value in part.items():
            if isinstance(value, dict):
                assert value.keys() <= answer[name].keys(), f"{name}: {sorted(value.keys() - answer[name].keys())}"

    def r(self, text):
        script = self.here(text) + "\nstopifnot(r$verdict$trusted, abs(tail(r$trajectory$t, 1) - 20) < 1e-12, is.numeric(r$trajectory$fields$x))\n"
        (self.folder / "shown.R").write_text(script)
        command = needs("Rscript")
        if subprocess.run([command, "-e", "library(jsonlite)"], capture_output=True).returncode != 0:
            raise LeftOut("the package jsonlite of R is not installed")
        self.run([command, "--vanilla", "shown.R"])
        assert (self.folder / "Rplots.pdf").stat().st_size > 1000, "nothing is drawn"

    def octave(self, text):
        command = needs("octave-cli", "octave")
        # A stand-in for `plot` checks its arguments, since a machine without a display has no graphics
        # toolkit.
        (self.folder / "drawn").mkdir(exist_ok=True)
        (self.folder / "drawn/plot.m").write_text("function plot(t, x)\n  assert(numel(t) > 100 && numel(t) == numel(x));\n  disp('drawn');\nend\n")
        script = "addpath('drawn');\n" + self.here(text) + "\nassert(answer.verdict.trusted && abs(answer.trajectory.t(end) - 20) < 1e-12);\n"
        (self.folder / "shown.m").write_text(script)
        assert "drawn" in self.run([command, "--quiet", "--no-init-file", "shown.m"])

    def matlab(self, text):
        # Octave can parse the MATLAB code, but its webwrite sends an empty body.
        needs("matlab")
        (self.folder / "shown.m").write_text(self.here(text))
        self.run(["matlab", "-batch", "run('shown.m')"])

    def julia(self, text):
        command = needs("julia")
        if subprocess.run([command, "-e", "import HTTP, JSON3"], capture_output=True).returncode != 0:
            raise LeftOut("the packages HTTP and JSON3 of Julia are not installed")
        (self.folder / "shown.jl").write_text(self.here(text) + "\n@assert answer.trajectory.t[end] == 20 && length(x) > 100\n")
        self.run([command, "shown.jl"])
        client = f'include("{ROOT}/api/julia/Dvi.jl"); r = Dvi.solve(read("belt.json", String); url="http://{self.address}"); @assert r.t[end] == 20 && length(r["x"]) == length(r.t)'
        self.run([command, "-e", client])

    def python(self, text):
        # The Python blocks of a page run one after the other, as a reader would type them.
        self.typed = getattr(self, "typed", "") + self.here(text)
        missing = [name for name in ("pandas", "pyarrow", "requests") if name in text and subprocess.run([sys.executable, "-c", f"import {name}"], capture_output=True).returncode != 0]
        if missing:
            raise LeftOut(f"{', '.join(missing)} cannot be imported")
        self.run([sys.executable, "-W", "error", "-"], self.typed)

    def nginx(self, text):
        needs("nginx")
        port = int(self.address.rsplit(":", 1)[1])
        folder = self.folder / "nginx"
        folder.mkdir()
        scratch = "".join(f"{kind}_temp_path {folder};\n" for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
        service = subprocess.Popen([self.program, "serve"], env={**self.environment, "DVI_LISTEN": f"127.0.0.1:{port + 2}", "DVI_EPHEMERAL": "true", "DVI_PATH_PREFIX": "/dvi"}, stderr=self.log)
        settings = folder / "settings"
        settings.write_text(
            f"pid {folder}/pid;\nerror_log {folder}/errors;\ndaemon off;\nevents {{}}\nhttp {{\naccess_log off;\n{scratch}"
            f"server {{\nlisten 127.0.0.1:{port + 3};\n{text.replace('127.0.0.1:8080', f'127.0.0.1:{port + 2}')}}}\n}}\n"
        )
        proxy = subprocess.Popen([needs("nginx"), "-c", str(settings)], stderr=subprocess.PIPE, text=True)
        try:
            for _ in range(100):
                try:
                    request = urllib.request.Request(f"http://127.0.0.1:{port + 3}/dvi/solve", (self.folder / "belt.json").read_bytes(), {"content-type": "application/json"})
                    with urllib.request.urlopen(request, timeout=30) as answer:
                        assert json.load(answer)["verdict"]["trusted"]
                        return
                except OSError as error:
                    assert proxy.poll() is None, proxy.stderr.read()
                    last = error
                    time.sleep(0.1)
            raise AssertionError(f"the proxy does not answer: {last}")
        finally:
            for process in (proxy, service):
                process.terminate()
                process.wait(30)


RUNNERS = {
    "sh": Desk.shell,
    "json": Desk.json,
    "r": Desk.r,
    "octave": Desk.octave,
    "matlab": Desk.matlab,
    "julia": Desk.julia,
    "python": Desk.python,
    "nginx": Desk.nginx,
    "rust": Desk.rust,
}


def main(program):
    failed, counts = [], {}
    with tempfile.TemporaryDirectory() as folder:
        desk = Desk(program, folder)
        try:
            for path in PAGES:
                page = str(path.relative_to(ROOT))
                for line, language, text in blocks(path):
                    place = f"{page}:{line} ({language})"
                    if any(page.startswith(where) and language == of and part in text for where, of, part, _ in ELSEWHERE):
                        state = "elsewhere"
                    else:
                        try:
                            RUNNERS[language](desk, text)
                            state = "ok"
                        except LeftOut as why:
                            print(f"left out: {place}: {why}")
                            state = "left out"
                        except Exception as error:
                            failed.append(f"{place}: {error!r}" if isinstance(error, KeyError) else f"{place}: {error}")
                            state = "failed"
                    counts[state] = counts.get(state, 0) + 1
                    if state == "ok":
                        print(f"ok  {place}")
        finally:
            desk.service.terminate()
            desk.service.wait(30)
    print(", ".join(f"{count} {state}" for state, count in sorted(counts.items())))
    if failed or counts.get("ok", 0) == 0:
        sys.exit("\n".join(["failed:", *failed]))


if __name__ == "__main__":
    main(str(pathlib.Path(sys.argv[1]).resolve()))
