"""The server under faults from outside: no descriptors left, too many connections."""

import pathlib
import resource
import socket
import subprocess
import sys
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "cli"))
import support  # noqa: E402


class Fovead:
    """A `fovea serve` on a free port; killed at the end of the `with`."""

    def __init__(self, root, log, *flags, descriptors=None):
        def limit():
            if descriptors:
                resource.setrlimit(resource.RLIMIT_NOFILE, (descriptors, descriptors))
        self.log_path = log
        self.connections = []
        with open(log, "w", encoding="utf-8") as stderr:
            self.process = subprocess.Popen(
                [support.FOVEA, "serve", str(root), "--listen", "127.0.0.1:0", *map(str, flags)],
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


class Faults(support.FoveaTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.root = cls.folder / "root"
        cls.root.mkdir()
        support.write_raw_ball(cls.folder / "ball.raw")
        cls.fovea(cls(), "ingest", cls.folder / "ball.raw", "--raw", "24x20x18:uint8",
                  "-o", cls.root / "ball.zarr")

    def serve(self, *flags, **options):
        return Fovead(self.root, self.folder / "serve.log", *flags, **options)

    def names(self, server, *flags):
        listed = self.fovea_json("info", "--server", server.address, *flags)["datasets"]
        return [dataset["name"] for dataset in listed]

    def exhaust(self, server):
        """200 connections that say nothing, to a server that may have 64 descriptors; then none."""
        idle = [server.connect() for _ in range(200)]
        eventually(lambda: "no file descriptor is free" in server.log())
        for connection in idle:
            connection.close()


class OutOfDescriptors(Faults):
    FLAGS = ("--max-connections", 10000, "--max-connections-per-address", 10000)

    def test_plaintext_serves_again(self):
        with self.serve(*self.FLAGS, descriptors=64) as server:
            self.exhaust(server)
            for _ in range(20):
                self.assertEqual(self.names(server), ["ball"])


class Connections(Faults):
    def test_an_address_has_its_share(self):
        with self.serve("--max-connections-per-address", 3) as server:
            mine = [server.connect() for _ in range(3)]
            self.assertTrue(all(map(is_open, mine)))
            self.assertFalse(is_open(server.connect()))
            self.assertTrue(is_open(server.connect("127.0.0.2")))
            eventually(lambda: "over --max-connections-per-address" in server.log())
            mine.pop().close()
            eventually(lambda: is_open(server.connect()))

    def test_all_together_have_a_limit(self):
        with self.serve("--max-connections", 2) as server:
            mine = [server.connect(f"127.0.0.{i}") for i in (1, 2)]
            self.assertTrue(all(map(is_open, mine)))
            self.assertFalse(is_open(server.connect("127.0.0.3")))

    def test_half_of_the_descriptors_are_for_files(self):
        with self.serve(descriptors=64) as server:
            connections = [server.connect() for _ in range(60)]
            self.assertEqual(sum(map(is_open, connections)), 32)


if __name__ == "__main__":
    unittest.main()
