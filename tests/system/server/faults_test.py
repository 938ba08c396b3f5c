"""The server under faults from outside: no descriptors left, too many connections, bad files."""

import sys
import pathlib
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import fovead  # noqa: E402
from fovead import eventually, is_open  # noqa: E402

BOTH = ["ball", "lab/ball"]


class OutOfDescriptors(fovead.FoveadTest):
    FLAGS = ("--max-connections", 10000, "--max-connections-per-address", 10000)

    def exhaust(self, server):
        """200 connections that say nothing, to a server that may have 64 descriptors; then none."""
        idle = [server.connect() for _ in range(200)]
        eventually(lambda: "no file descriptor is free" in server.log())
        for connection in idle:
            connection.close()

    def attack(self, server, *flags):
        self.exhaust(server)
        for _ in range(20):
            self.assertEqual(self.names(server, *flags), BOTH)

    def test_plaintext_serves_again(self):
        with self.serve(*self.FLAGS, descriptors=64) as server:
            self.attack(server)

    def test_tls_serves_again(self):
        authority = fovead.make_authority(self.folder, "ca")
        certificate, key = fovead.make_certificate(self.folder, "server", authority)
        with self.serve(*self.FLAGS, "--tls-cert", certificate, "--tls-key", key,
                        descriptors=64) as server:
            self.attack(server, "--tls-ca", authority)


class Connections(fovead.FoveadTest):
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
