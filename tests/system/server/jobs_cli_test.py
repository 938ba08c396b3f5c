"""`fovea jobs` against a real server: begin, follow, list, cancel; and what goes wrong."""

import json
import pathlib
import re
import signal
import subprocess
import sys
import unittest
import urllib.request

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "cli"))
import numpy as np  # noqa: E402
import support  # noqa: E402
from fovead import Fovead, eventually, make_authority, make_certificate  # noqa: E402

BALL = ("--raw", "24x20x18:uint8")
LONG = 80  # steps of an ingest that can be met while it runs


class Jobs(support.FoveaTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        for name in ("root", "in/lab", "out"):
            (cls.folder / name).mkdir(parents=True)
        for step in range(3):
            support.write_raw_ball(cls.folder / f"in/ball_{step}.raw", phase=step / 3)
        support.write_raw_ball(cls.folder / "in/lab/ball.raw")
        noise = np.random.default_rng(1).integers(0, 255, 128 ** 3, np.uint8)
        for step in range(LONG):
            noise.tofile(cls.folder / f"in/long_{step:02}.raw")
        cls.fovea(cls(), "ingest", cls.folder / "in/ball_#.raw", *BALL, "-o",
                  cls.folder / "root/ball.zarr")

    def serve(self, *flags, roots=True, **options):
        state = self.folder / f"state-{self.id().rsplit('.', 1)[1]}"
        keeps = ("--state", state, "--ingest-root", self.folder / "in", "--export-root",
                 self.folder / "out", "--allow-ingest") if roots else ()
        return Fovead(self.folder / "root", self.folder / "log", *keeps, *flags, **options)

    def begin_long(self, server, name, *flags):
        # A tolerance is verified, step by step: that takes long enough on any machine.
        return self.fovea_json("jobs", "ingest", "long_##.raw", "--raw", "128x128x128:uint8",
                               "--wavelet", "cdf97", "--tolerance", "1", "--dataset", name,
                               "--server", server.address, *flags)

    def state_of(self, job, server):
        return self.fovea_json("jobs", job["id"], "--server", server.address)

    def test_an_ingest_and_an_export_are_what_the_local_verbs_make(self):
        with self.serve() as server:
            to = ("--server", server.address)
            said = self.fovea("jobs", "ingest", "ball_#.raw", *BALL, "--dataset", "made", "--fps",
                              10, *to, "--watch").stdout
            self.assertRegex(said, r"^job-[0-9a-f]+: ingest to made, queued\n")
            self.assertIn("state     done, 3 of 3 steps", said)
            made = self.fovea_json("info", "made", *to)
            self.assertEqual(made["committed_steps"], 3)
            self.assertEqual(made["last_time_ns"], 200_000_000)
            picture = ("--view", "30,20", "--rate", 8, "--size", "64x48")
            lines = self.fovea("jobs", "export", "made", "-o", "a/f.##.png", "--steps", "0-2x2",
                               *picture, *to, "--watch", "--json").stdout.splitlines()
            last = json.loads(lines[-1])
            self.assertEqual((last["state"], last["kind"], last["done"], last["total"],
                              last["target"]), ("DONE", "EXPORT", 2, 2, "a/f.##.png"))
            self.fovea("export", self.folder / "root/made.zarr", "--steps", "0-2x2", *picture, "-o",
                       self.folder / "local.##.png")
            for step in (0, 2):
                self.assertEqual((self.folder / f"out/a/f.{step:02}.png").read_bytes(),
                                 (self.folder / f"local.{step:02}.png").read_bytes())
            listed = self.fovea_json("jobs", *to)["jobs"]
            self.assertEqual([job["kind"] for job in listed], ["EXPORT", "INGEST_FILES"])
            self.assertEqual(len(self.fovea_json("jobs", "--newest", 1, *to)["jobs"]), 1)
            text = self.fovea("jobs", *to).stdout
            self.assertRegex(text.splitlines()[0], r"done .* UTC  export of made to a/f\.##\.png, "
                                                   r"2 of 2 frames$")
            one = self.fovea("jobs", last["id"], *to).stdout
            self.assertRegex(one, r"ended     \d{4}-\d\d-\d\d \d\d:\d\d:\d\d UTC")

    def test_an_animation_goes_along(self):
        shot = self.folder / "shot.json"
        shot.write_text(json.dumps({"frames": 4, "keys": [{"frame": 0, "view": [0, 10]},
                                                          {"frame": 3, "view": [90, 10]}]}))
        with self.serve() as server:
            to = ("--server", server.address)
            flags = ("--animation", shot, "--size", "32x32")
            self.fovea("jobs", "export", "ball", "-o", "turn.#.png", *flags, *to, "--watch")
            self.fovea("export", self.folder / "root/ball.zarr", "-o", self.folder / "turn.#.png",
                       *flags)
            for frame in range(4):
                self.assertEqual((self.folder / f"out/turn.{frame}.png").read_bytes(),
                                 (self.folder / f"turn.{frame}.png").read_bytes())
            shot.write_text("{")
            self.refused(1, "jobs", "export", "ball", "-o", "turn.#.png", *flags, *to,
                         says=["--animation", "JSON"])
            self.refused(1, "jobs", "export", "ball", "-o", "turn.#.png", "--animation",
                         self.folder / "none", *to, says=["--animation", "none"])

    def test_an_orbit_goes_along(self):
        with self.serve() as server:
            to = ("--server", server.address)
            for name, flags in (("own", ("--orbit-frames", 3)), ("steps", ("--view", "20,10")),
                                ("eye", ("--eye", "-40,9,9", "--orbit-frames", 3))):
                flags = ("--orbit", 90, *flags, "--size", "32x32")
                self.fovea("jobs", "export", "ball", "-o", f"{name}.#.png", *flags, *to, "--watch")
                self.fovea("export", self.folder / "root/ball.zarr", "-o",
                           self.folder / f"{name}.#.png", *flags)
                for frame in range(3):
                    self.assertEqual((self.folder / f"out/{name}.{frame}.png").read_bytes(),
                                     (self.folder / f"{name}.{frame}.png").read_bytes())
            orbit = ("--orbit", 90, "-o", "no.#.png")
            self.refused(2, "jobs", "export", "ball", *orbit, "--animation", "shot.json", *to,
                         says=["--animation", "--orbit"])
            self.refused(2, "jobs", "export", "ball", "-o", "no.#.png", "--orbit-frames", 9, *to,
                         says=["--orbit"])
            self.refused(1, "jobs", "export", "ball", *orbit, "--eye", "-40,9,9", "--orbit-frames",
                         100_000, *to, says=["--orbit-frames", "512 KiB"])
            self.refused(1, "jobs", "export", "nothing", *orbit, *to, says=["nothing"])

    def test_a_job_is_cancelled_and_its_watch_says_so(self):
        with self.serve() as server:
            to = ("--server", server.address)
            job = self.begin_long(server, "cancelled")
            watch = subprocess.Popen([support.FOVEA, "jobs", job["id"], "--watch", *to],
                                     stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            eventually(lambda: self.state_of(job, server)["done"] >= 1, 30)
            lines = self.fovea("jobs", "--cancel", job["id"], "--watch", "--json", *to).stdout
            ended = json.loads(lines.splitlines()[-1])
            self.assertEqual(ended["state"], "CANCELLED")
            out, error = watch.communicate(timeout=20)
            self.assertEqual(watch.returncode, 1)
            self.assertIn("state     cancelled", out)
            self.assertIn(f"fovea: {job['id']} was cancelled", error)
            self.assertRegex(error, r"(queued|running): \d+ (of 80 )?steps")
            self.fovea("verify", self.folder / "root/cancelled.zarr")
            # It goes on where it was, as another job, and a Ctrl-C ends the watch alone.
            again = self.begin_long(server, "cancelled")
            watch = subprocess.Popen([support.FOVEA, "jobs", again["id"], "--watch", "-q", *to],
                                     stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            eventually(lambda: self.state_of(again, server)["done"] > ended["done"], 30)
            watch.send_signal(signal.SIGINT)
            out, error = watch.communicate(timeout=20)
            self.assertEqual(watch.returncode, 1, error)
            self.assertIn("goes on", error)
            self.assertEqual(self.state_of(again, server)["state"], "RUNNING")
            self.fovea("jobs", "--cancel", again["id"], *to)

    def test_a_watch_outlives_a_restart_of_the_server(self):
        with self.serve() as server:
            port = server.port
            job = self.begin_long(server, "restarted")
            watch = subprocess.Popen([support.FOVEA, "jobs", job["id"], "--watch", "--json",
                                      "--server", server.address], stdout=subprocess.PIPE,
                                     stderr=subprocess.PIPE, text=True)
            while json.loads(watch.stdout.readline())["done"] < 1:
                pass
        with self.serve(listen=f"127.0.0.1:{port}"):
            out, error = watch.communicate(timeout=60)
            self.assertEqual(watch.returncode, 0, error)
            self.assertEqual(json.loads(out.splitlines()[-1])["done"], LONG)

    def test_failures_are_told(self):
        with self.serve() as server:
            to = ("--server", server.address)
            (self.folder / "in/short_0.raw").write_bytes(b"x" * 10)
            failed = support.run("jobs", "ingest", "short_#.raw", *BALL, "--dataset", "short", *to,
                                 "--watch")
            self.assertEqual(failed.returncode, 1)
            self.assertIn("state     failed", failed.stdout)
            self.assertRegex(failed.stderr, r"fovea: job-[0-9a-f]+ failed: .*short_0\.raw")
            made = self.folder / "root/damaged.zarr"
            self.fovea("ingest", self.folder / "in/ball_#.raw", *BALL, "-o", made)
            for chunk in made.glob("density/detail_*/c.1.*"):
                chunk.write_bytes(b"garbage")
            partly = support.run("jobs", "export", "damaged", "-o", "d.#.png", "--strict", "--size",
                                 "32x32", *to, "--watch")
            self.assertEqual(partly.returncode, 1)
            self.assertIn("state     done, 2 of 3 frames, 1 failed", partly.stdout)
            self.assertIn("failed    d.1.png: ", partly.stdout)
            self.assertIn("1 of 3 frames could not be made", partly.stderr)
            # Without --strict they are made of what is left, and that is said.
            coarser = self.fovea("jobs", "export", "damaged", "-o", "w.#.png", "--size", "32x32", *to,
                                 "--watch").stdout
            self.assertIn("state     done, 3 of 3 frames, 1 warning\n", coarser)
            self.assertRegex(coarser, r"warning   \d+ damaged chunks of 'density' at step 1 were left")
            self.assertIn("3 of 3 frames, 1 warning\n", self.fovea("jobs", *to).stdout)
            newest = self.fovea_json("jobs", "--newest", 1, *to)["jobs"][0]
            self.assertEqual(newest["warning_count"], 1)
            self.assertNotIn("warnings", newest)
            self.assertEqual(len(self.state_of(newest, server)["warnings"]), 1)
            self.assertRegex(server.log(), rf"{newest['id']}: \d+ damaged chunks of 'density'")

    def test_metrics_count_jobs_by_state(self):
        with self.serve("--admin", "127.0.0.1:0") as server:
            admin = server.process.stdout.readline().rsplit(" ", 1)[1].strip()
            to = ("--server", server.address)
            one = ("ball_0.raw", *BALL, "--dataset", "counted", *to, "--watch")
            self.fovea("jobs", "ingest", *one)
            support.run("jobs", "ingest", *one, "--wavelet", "cdf53")  # it is there, and is haar
            self.begin_long(server, "counted2")
            with urllib.request.urlopen(f"http://{admin}/metrics", timeout=10) as reply:
                text = reply.read().decode()
            counts = dict(re.findall(r'^(fovea_jobs\S*) (\d+)', text, re.MULTILINE))
            self.assertEqual(int(counts['fovea_jobs{state="queued"}']) +
                             int(counts['fovea_jobs{state="running"}']), 1, text)
            self.assertEqual([counts[f'fovea_jobs_ended_total{{state="{state}"}}']
                              for state in ("done", "failed", "cancelled")], ["1", "1", "0"], text)

    def test_a_gap_is_met_as_the_flag_says(self):
        for step in (0, 1, 3):  # the smallest distance between two is that of the series
            support.write_raw_ball(self.folder / f"in/gap_{step}.raw")
        with self.serve() as server:
            for how, steps in ((("--on-missing", "skip"), 3), (("--on-missing", "hold"), 4), ((), 0)):
                result = support.run("jobs", "ingest", "gap_#.raw", *BALL, "--dataset", f"gap{steps}",
                                     "--wavelet", "cdf53", "--tolerance", 0.5, "--field", "heat", *how,
                                     "--server", server.address, "--watch")
                self.assertEqual(result.returncode, 0 if steps else 1, result.stderr)
                self.assertEqual("warning   there are no files of number 2" in result.stdout, bool(steps),
                                 result.stdout)
                if steps:
                    made = self.fovea_json("info", self.folder / f"root/gap{steps}.zarr")
                    self.assertEqual((made["committed_steps"], made["wavelet"],
                                      made["fields"][0]["name"], made["fields"][0]["tolerance"]),
                                     (steps, "cdf53", "heat", 0.5))

    def test_errors_name_what_is_wrong(self):
        with self.serve() as server:
            to = ("--server", server.address)
            for flags in ((), ("--cancel",), ("--watch",)):
                self.refused(1, "jobs", "job-0", *flags, *to, says=["job-0", "ListJobs"])
            ingest = ("jobs", "ingest", "ball_#.raw", "--dataset", "made2", *to)
            self.refused(1, *ingest, "--raw", "24x20", says=["--raw", "24x20"])
            self.refused(1, *ingest, *BALL, "--lossless", "--tolerance", 1, says=["tolerance"])
            self.refused(1, "jobs", "ingest", "../x", "--dataset", "made2", *to, says=["../x"])
            self.refused(1, "jobs", "ingest", "none_#.raw", *BALL, "--dataset", "../x", *to,
                         says=["dataset"])
            self.refused(1, "jobs", "export", "none", "-o", "f.#.png", *to, says=["none"])
            self.refused(1, "jobs", "export", "ball", "-o", "f.png", *to, says=["--output"])
            self.refused(1, "jobs", "export", "ball", "-o", "f.#.png", "--field", "x", *to,
                         says=["--field"])
            self.refused(1, "jobs", "export", "ball", "-o", "f.#.png", "--steps", "0-9", *to,
                         says=["9"])
            self.assertEqual(self.fovea_json("jobs", *to)["jobs"], [])
        self.refused(1, "jobs", *to, says=[server.address, "fovea serve"])
        with self.serve(roots=False) as server:
            to = ("--server", server.address)
            self.refused(1, "jobs", *to, says=["--state"])
            self.refused(1, "jobs", "x", "--watch", *to, says=["--state"])

    def test_wrong_usage(self):
        self.refused(2, "jobs", says=["--server"])
        to = ("--server", "127.0.0.1:1")
        self.refused(2, "jobs", "--watch", *to, says=["id is missing", "watch"])
        self.refused(2, "jobs", "--cancel", *to, says=["id is missing", "cancel"])
        self.refused(2, "jobs", "ingest", *to, says=["jobs ingest --help"])
        self.refused(2, "jobs", "ingest", "a.raw", "--dataset", "x", "--on-missing", "no", *to,
                     says=["--on-missing", "hold"])
        self.refused(2, "jobs", "export", "ball", "-o", "f.#.png", "--rate", 0, *to,
                     says=["--rate"])
        for verb in ((), ("ingest",), ("export",)):
            said = self.fovea("jobs", *verb, "--help").stdout
            self.assertIn("Examples:", said)
            self.assertIn("--token-file", said)

    def test_tokens_and_certificates(self):
        authority = make_authority(self.folder, "ca")
        certificate, key = make_certificate(self.folder, "server", authority)
        secrets = {}
        for name, rights in (("writer", "write"), ("reader", "read"), ("lab", "write")):
            prefix = ("--prefix", "lab") if name == "lab" else ()
            made = self.fovea("token", name, "--tokens", self.folder / "tokens.json", "--rights",
                              rights, *prefix).stdout
            secrets[name] = self.folder / f"{name}.token"
            secrets[name].write_text(made)
        with self.serve("--tokens", self.folder / "tokens.json", "--tls-cert", certificate,
                        "--tls-key", key) as server:
            def ask(name):
                return ("--server", server.address, "--tls-ca", authority, "--token-file",
                        secrets[name])
            job = self.fovea_json("jobs", "ingest", "lab/ball.raw", *BALL, "--dataset", "lab/one",
                                  *ask("lab"))
            self.fovea("jobs", job["id"], "--watch", *ask("lab"))
            self.refused(1, "jobs", "ingest", "ball_#.raw", *BALL, "--dataset", "x", *ask("reader"),
                         says=["reader", "may write"])
            self.refused(1, "jobs", "--cancel", job["id"], *ask("reader"),
                         says=["may write"])
            self.refused(1, "jobs", job["id"], *ask("writer"), says=["no job"])
            self.assertEqual(self.fovea_json("jobs", *ask("writer"))["jobs"], [])
            self.refused(1, "jobs", "--server", server.address, "--tls-ca", authority,
                         says=["--token-file"])


if __name__ == "__main__":
    unittest.main()
