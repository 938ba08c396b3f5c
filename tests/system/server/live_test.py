"""Live readings through the real programs: kills of the server, a full disk, a client that goes."""

import json
import pathlib
import random
import resource
import signal
import subprocess
import sys
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "cli"))
import numpy as np  # noqa: E402
import support  # noqa: E402
from fovead import Fovead, eventually  # noqa: E402

READINGS = 40  # of a step


def lines_of_step(step, readings=READINGS, values=None):
    """CSV of one window of 0.1 s: its readings lie on a row and have the value step + 1."""
    values = values if values is not None else [step + 1] * readings
    return "".join(f"{i % 8 + 0.5},{i // 8 % 8 + 0.5},{i // 64 % 8 + 0.5},{step / 10 + 0.05},{v}\n"
                   for i, v in enumerate(values))


class Sender:
    """A `fovea sensors - --server` that takes lines as they are written."""

    def __init__(self, port, size=8):
        self.process = subprocess.Popen(
            [support.FOVEA, "sensors", "-", "--server", f"127.0.0.1:{port}", "-o", "live",
             "--step-seconds", "0.1", "--bounds", f"0,0,0,{size},{size},{size}", "--voxel", "1", "--format", "csv",
             "--json"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.write("x,y,z,t,value\n")

    def write(self, text):
        self.process.stdin.write(text)
        self.process.stdin.flush()

    def end(self):
        """The report, or None; and what was said."""
        self.process.stdin.close()
        self.process.stdin = None
        out, error = self.process.communicate(timeout=90)
        return (json.loads(out) if self.process.returncode == 0 else None), error


class Live(support.FoveaTest):
    def setUp(self):
        self.root = self.folder / self.id().rsplit(".", 1)[1]
        self.root.mkdir()

    def serve(self, port=0, **options):
        return Fovead(self.root, self.folder / "log", "--allow-ingest",
                      listen=f"127.0.0.1:{port}", **options)

    def steps(self, name="live"):
        store = self.root / f"{name}.zarr"
        if not (store / "zarr.json").exists():
            return 0
        return self.fovea_json("info", store)["committed_steps"]

    def values(self, step, name="live"):
        out = self.folder / "step.npy"
        self.fovea("extract", self.root / f"{name}.zarr", "--step", step, "--field", "value", "-o", out)
        return np.load(out)

    def test_kills_lose_nothing_and_sending_goes_on(self):
        random.seed(5)
        steps, kills = 120, 4
        server = self.serve()
        port = server.port
        sender = Sender(port)
        kill_at = sorted(random.sample(range(10, steps - 10), kills))
        for step in range(steps):
            sender.write(lines_of_step(step))
            time.sleep(random.uniform(0, 0.04))
            if step in kill_at:
                server.process.send_signal(signal.SIGKILL)
                server.process.wait()
                server.process.stdout.close()
                committed = self.steps()
                if committed:
                    self.fovea("verify", self.root / "live.zarr")
                server = self.serve(port)
                self.assertGreaterEqual(self.steps(), committed)
        report, error = sender.end()
        self.assertIsNotNone(report, error)
        self.assertGreaterEqual(report["resumed"], 1)
        self.assertEqual(report["acknowledged"], report["batches"])
        server.__exit__()
        self.assertEqual(self.steps(), steps)
        self.fovea("verify", self.root / "live.zarr")
        for step in range(0, steps, 7):
            values = self.values(step)
            self.assertEqual((values.min(), values.max()), (step + 1, step + 1))

    def test_a_disk_that_is_full_takes_nothing_of_what_was_acknowledged(self):
        with self.serve() as server:
            resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, (64 << 10, 64 << 10))
            sender = Sender(server.port, 64)
            for step in range(3):
                sender.write(lines_of_step(step))
            eventually(lambda: self.steps() >= 2, 30)
            generator = np.random.default_rng(1)
            places = generator.random((60_000, 3)) * 64
            noise = generator.random(60_000)
            sender.write("".join(f"{x:.2f},{y:.2f},{z:.2f},0.35,{v}\n"
                                 for (x, y, z), v in zip(places, noise)))
            sender.write(lines_of_step(5))
            report, error = sender.end()
            self.assertIsNone(report)
            self.assertIn("large", error)
        self.assertIn(self.steps(), (2, 3))
        self.fovea("verify", self.root / "live.zarr")
        with self.serve() as server:  # with room again it goes on
            sender = Sender(server.port, 64)
            sender.write(lines_of_step(2) + lines_of_step(5))  # what was not acknowledged
            report, error = sender.end()
            self.assertIsNotNone(report, error)
            self.assertEqual(self.steps(), 4)

    def test_a_client_that_is_killed_lets_go_of_its_dataset(self):
        with self.serve() as server:
            sender = Sender(server.port)
            sender.write(lines_of_step(0) + lines_of_step(1))
            eventually(lambda: self.steps() == 1, 30)
            sender.process.kill()
            sender.process.communicate()
            again = None

            def taken_over():
                nonlocal again
                again = Sender(server.port)
                again.write(lines_of_step(1) + lines_of_step(2))
                report, error = again.end()
                if report is None:
                    self.assertIn("being written", error)
                return report is not None
            eventually(taken_over, 30)
            self.assertEqual(self.steps(), 3)

    def test_a_server_takes_nothing_unless_it_is_told_to(self):
        with Fovead(self.root, self.folder / "log") as server:
            sender = Sender(server.port)
            sender.write(lines_of_step(0))
            report, error = sender.end()
            self.assertIsNone(report)
            self.assertIn("--allow-ingest", error)

    def test_a_watch_prints_each_step(self):
        with self.serve() as server:
            watch = subprocess.Popen([support.FOVEA, "info", "live", "--server", server.address,
                                      "--watch", "--json"], stdout=subprocess.PIPE, text=True)
            self.assertEqual(json.loads(watch.stdout.readline())["state"], "ABSENT")
            sender = Sender(server.port)
            sender.write(lines_of_step(0) + lines_of_step(1) + lines_of_step(2))
            steps = []
            while len(steps) < 2:
                steps += [s["step"] for s in json.loads(watch.stdout.readline())["steps"]]
            self.assertEqual(steps, [0, 1])
            watch.send_signal(signal.SIGINT)
            self.assertEqual(watch.wait(20), 0)
            watch.stdout.close()
            self.assertIsNotNone(sender.end()[0])

    def test_wrong_usage(self):
        self.refused(2, "info", "live", "--watch", says=["--server"])
        self.refused(2, "sensors", "-", "-o", "live", "--server", "127.0.0.1:1",
                     says=["--step-seconds"])


if __name__ == "__main__":
    unittest.main()
