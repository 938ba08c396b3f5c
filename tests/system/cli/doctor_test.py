"""`fovea doctor`: what it says, and what it ends with."""

import os
import shutil
import subprocess
import unittest

from support import FOVEA, FoveaTest, run


class DoctorTest(FoveaTest):
    def test_this_machine_has_what_is_needed(self):
        text = self.fovea("doctor", self.folder).stdout
        for about in ("Landlock", "seccomp", "fovea-worker", "OpenVDB", "memory", "free space"):
            self.assertIn(about, text)
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_json(self):
        report = self.fovea_json("doctor", self.folder)
        self.assertEqual(report["missing"], 0)
        worker = [f for f in report["findings"] if f["about"] == "fovea-worker"]
        self.assertEqual([f["verdict"] for f in worker], ["good"])
        self.assertRegex(worker[0]["found"], "confined by (Landlock [0-9]+|no Landlock) and ")

    def test_a_folder_that_is_not_there(self):
        result = run("doctor", self.folder / "nowhere")
        self.assertEqual(result.returncode, 1)
        self.assertIn("! folder", result.stdout)

    def test_a_worker_that_is_not_there(self):
        alone = self.folder / "alone"
        alone.mkdir()
        shutil.copy(FOVEA, alone / "fovea")
        environment = {k: v for k, v in os.environ.items() if k != "FOVEA_LIBEXEC"}
        result = subprocess.run([alone / "fovea", "doctor"], capture_output=True,
                                text=True, timeout=60, env=environment)
        asking = subprocess.run([alone / "fovea", "info", "--server", "127.0.0.1:1"],
                                capture_output=True, text=True, timeout=60, env=environment)
        shutil.rmtree(alone)
        self.assertEqual(result.returncode, 1)
        for program in ("fovea-worker", "fovea-remote", "fovead"):
            self.assertIn("! " + program, result.stdout)
        self.assertIn("FOVEA_LIBEXEC", result.stdout)
        self.assertEqual(asking.returncode, 1)
        self.assertIn("fovea-remote", asking.stderr)


if __name__ == "__main__":
    unittest.main()
