"""Ctrl-C, progress on a terminal and elsewhere, and output nobody reads."""

import os
import pty
import signal
import subprocess
import time
import unittest

import support


class Interrupt(support.FoveaTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.raw = cls.folder / "many.raw"
        with open(cls.raw, "wb") as file:
            for i in range(60):
                part = cls.folder / "part"
                support.write_raw_ball(part, dims=(48, 48, 48), phase=i / 60)
                file.write(part.read_bytes())
        cls.store = cls.folder / "many.zarr"
        cls.fovea(cls(), "ingest", cls.raw, "--raw", "48x48x48x60:uint8", "-o", cls.store)

    def stop_when(self, ready, *arguments):
        """Starts `fovea`, sends SIGINT when ready() holds; its status and messages."""
        process = subprocess.Popen([support.FOVEA, *map(str, arguments)], stdout=subprocess.DEVNULL,
                                   stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 30
        while not ready():
            self.assertIsNone(process.poll(), "it ended before it could be stopped")
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.002)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=30)
        return process.returncode, errors

    def test_an_export_goes_on_after_ctrl_c(self):
        out = self.folder / "frames"
        command = ["export", self.store, "--size", "300x300", "-o", out / "f.####.png"]
        status, errors = self.stop_when(lambda: len(list(out.glob("f.*.png"))) >= 3, *command)
        self.assertEqual(status, 1)
        self.assertRegex(errors, r"fovea: stopped after \d+ of 60 frames")
        made = len(list(out.glob("f.*.png")))
        self.assertLess(made, 60)
        self.assertEqual([path.name for path in out.glob(".*.tmp")], [])
        report = self.fovea_json(*command)
        self.assertEqual(report["frames_skipped"], made)
        self.assertEqual(len(list(out.glob("f.*.png"))), 60)

    def test_an_unfinished_movie_is_not_left_behind(self):
        out = self.folder / "movie"
        status, errors = self.stop_when(lambda: list(out.glob(".m.mp4.*.tmp")), "export",
                                        self.store, "--size", "600x600", "-o", out / "m.mp4")
        self.assertEqual(status, 1)
        self.assertIn("not kept", errors)
        self.assertEqual([path.name for path in out.iterdir()], [".m.mp4.fovea-export.json"])

    def test_what_is_ingested_stays(self):
        store = self.folder / "stopped.zarr"
        status, errors = self.stop_when(lambda: (store / "zarr.json").exists(), "ingest", self.raw,
                                        "--raw", "48x48x48x60:uint8", "-o", store)
        self.assertEqual(status, 1, errors)
        self.assertLess(self.fovea_json("info", store)["committed_steps"], 60)
        self.fovea("verify", store)

    def test_progress_rewrites_its_line_on_a_terminal(self):
        try:
            master, slave = pty.openpty()
        except OSError as error:  # a bare chroot has no /dev/pts
            self.skipTest(f"no terminals here: {error}")
        process = subprocess.Popen([support.FOVEA, "verify", str(self.store)],
                                   stdout=subprocess.DEVNULL, stderr=slave)
        os.close(slave)
        seen = b""
        try:
            while chunk := os.read(master, 4096):
                seen += chunk
        except OSError:  # how Linux says that the other side is closed
            pass
        os.close(master)
        self.assertEqual(process.wait(timeout=30), 0)
        self.assertIn(b"\rverify: ", seen)
        self.assertIn(b"60 of 60 steps", seen)
        self.assertTrue(seen.endswith(b"\r\x1b[K"), seen[-40:])

    def test_progress_is_plain_lines_elsewhere_and_can_be_silenced(self):
        result = self.fovea("verify", self.store)
        self.assertIn("60 of 60 steps", result.stderr)
        self.assertNotIn("\r", result.stderr)
        self.assertEqual(self.fovea("verify", self.store, "-q").stderr, "")

    def test_output_that_cannot_be_written_is_an_error(self):
        with open("/dev/full", "w", encoding="utf-8") as full:
            result = subprocess.run([support.FOVEA, "info", str(self.store)], stdout=full,
                                    stderr=subprocess.PIPE, text=True, timeout=60)
        self.assertEqual(result.returncode, 1)
        self.assertIn("stdout", result.stderr)


if __name__ == "__main__":
    unittest.main()
