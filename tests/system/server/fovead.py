"""What the tests of the server share: a running one, idle connections to it, certificates."""

import pathlib
import resource
import socket
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "cli"))
import support  # noqa: E402


class Fovead:
    """A `fovea serve` on a free port; killed at the end of the `with`."""

    def __init__(self, root, log, *flags, listen="127.0.0.1:0", descriptors=None):
        def limit():
            if descriptors:
                resource.setrlimit(resource.RLIMIT_NOFILE, (descriptors, descriptors))
        self.log_path = log
        self.connections = []
        with open(log, "w", encoding="utf-8") as stderr:
            self.process = subprocess.Popen(
                [support.FOVEA, "serve", str(root), "--listen", listen, *map(str, flags)],
                stdout=subprocess.PIPE, stderr=stderr, text=True, preexec_fn=limit)
        line = self.process.stdout.readline()
        assert line.startswith("fovead listening on grpc "), self.log()
        self.address = line.split()[-1]
        self.port = int(self.address.split(":")[-1])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for connection in self.connections:
            connection.close()
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    def log(self):
        return pathlib.Path(self.log_path).read_text(encoding="utf-8")

    def connect(self, source="127.0.0.1"):
        """An idle connection from `source`."""
        connection = socket.socket()
        self.connections.append(connection)
        connection.settimeout(10)
        connection.bind((source, 0))
        connection.connect(("127.0.0.1", self.port))
        return connection


def eventually(condition, seconds=10):
    """Waits until `condition()` holds: other processes take their time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"not within {seconds} s")
        time.sleep(0.02)


def is_open(connection):
    """Whether the server talks to it: it sends its settings first, or closes."""
    try:
        return connection.recv(1) != b""
    except ConnectionError:
        return False


def make_authority(folder, name):
    """A certificate authority in `folder`; its certificate's path."""
    openssl("req", "-x509", *KEY, "-days", 2, "-subj", f"/CN={name}", "-keyout",
            folder / f"{name}.key", "-out", folder / f"{name}.crt")
    return folder / f"{name}.crt"


def make_certificate(folder, name, authority, days=2):
    """A certificate for 127.0.0.1 by an authority, and its key; their paths."""
    key, request, certificate = (folder / f"{name}.{end}" for end in ("key", "csr", "crt"))
    openssl("req", "-new", *KEY, "-subj", f"/CN={name}", "-addext",
            "subjectAltName=IP:127.0.0.1,IP:::1", "-keyout", key, "-out", request)
    openssl("x509", "-req", "-in", request, "-CA", authority, "-CAkey",
            authority.with_suffix(".key"), "-CAcreateserial", "-copy_extensions", "copy", "-days",
            days, "-out", certificate)
    return certificate, key


KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")


def openssl(*arguments):
    subprocess.run(["openssl", *map(str, arguments)], check=True, capture_output=True, timeout=60)


class FoveadTest(support.FoveaTest):
    """With a dataset "ball" and one "lab/ball" to serve."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.root = cls.folder / "root"
        (cls.root / "lab").mkdir(parents=True)
        support.write_raw_ball(cls.folder / "ball.raw")
        for name in ("ball", "lab/ball"):
            cls.fovea(cls(), "ingest", cls.folder / "ball.raw", "--raw", "24x20x18:uint8",
                      "-o", cls.root / f"{name}.zarr")

    def serve(self, *flags, **options):
        return Fovead(self.root, self.folder / "serve.log", *flags, **options)

    def names(self, server, *flags):
        listed = self.fovea_json("info", "--server", server.address, *flags)["datasets"]
        return [dataset["name"] for dataset in listed]
