"""The server through the project's own client: the same pictures, clear refusals, a clean end."""

import json
import signal
import subprocess
import unittest

import support


class Serve(support.FoveaTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.root = cls.folder / "root"
        cls.store = cls.root / "lab" / "plume.zarr"
        cls.store.parent.mkdir(parents=True)
        cls.fovea(cls(), "ingest", support.PLUME_SEQUENCE, "-o", cls.store)
        readings = cls.folder / "readings.csv"
        readings.write_text("x,y,z,t,value\n1,2,3,0,1\n5,6,7,1,2\n")
        cls.fovea(cls(), "sensors", readings, "--step-seconds", 1, "--bounds", "0,0,0,8,8,8",
                  "--voxel", 1, "--clock", "noon", "-o", cls.root / "clocked.zarr")
        cls.log = open(cls.folder / "serve.log", "w", encoding="utf-8")
        cls.server = subprocess.Popen(
            [support.FOVEA, "serve", str(cls.root), "--listen", "127.0.0.1:0", "--log-level", "debug"],
            stdout=subprocess.PIPE, stderr=cls.log, text=True)
        line = cls.server.stdout.readline()
        assert line.startswith("fovead listening on grpc "), line
        cls.address = line.split()[-1]

    @classmethod
    def tearDownClass(cls):
        cls.server.kill()
        cls.server.wait()
        cls.server.stdout.close()
        cls.log.close()
        super().tearDownClass()

    def ask(self, verb, *arguments):
        return self.fovea_json(verb, "--server", self.address, *arguments)

    def test_info_is_the_same_from_both_sides(self):
        listed = self.ask("info")["datasets"]
        self.assertEqual([dataset["name"] for dataset in listed], ["clocked", "lab/plume"])
        served, local = self.ask("info", "lab/plume"), self.fovea_json("info", self.store)
        served.pop("name")
        local.pop("name")
        local.pop("source", None)  # what the dataset was made of is for those who have its files
        self.assertEqual(served, local)

    def test_numbers_that_are_wrong_are_told_in_a_few_words(self):
        for flag, value, says in (
                ("--jobs", "9" * 309, "is not a whole number from 1 to 64"),
                ("--threads", -1, "is not a whole number from 0 to 1024"),
                ("--render-queue", 0.5, "is not a whole number from 1 to 100000"),
                ("--drain-seconds", "nan", "is not a whole number from 0 to 86400")):
            result = support.run("serve", self.root, flag, value)
            self.assertEqual(result.returncode, 2, result.stderr)
            self.assertTrue(result.stderr.startswith(f"fovead: {flag}: '{value}' {says}\n"),
                            result.stderr)

    def test_info_tells_of_the_clock(self):
        self.assertEqual(self.ask("info", "clocked")["clock"], "noon")
        said = self.fovea("info", "--server", self.address, "clocked").stdout
        self.assertIn("(0 is: noon)", said)

    def test_a_plan_is_the_same_from_both_sides(self):
        for flags in (["--step", 9, "--rate", 12, "--view", "30,20"], ["--budget-ms", 5],
                      ["--budget-memory", "6MiB", "--budget-bytes", "40KiB"],
                      ["--fovea", "0.5,0.5,0.5w", "--budget-coefficients", 5000]):
            served, local = self.ask("plan", "lab/plume", *flags), self.fovea_json("plan", self.store, *flags)
            self.assertEqual(served.pop("dataset"), "lab/plume")
            local.pop("dataset")
            self.assertEqual(served, local)
        served = self.fovea("plan", "--server", self.address, "lab/plume", "--budget-ms", 5).stdout
        local = self.fovea("plan", self.store, "--budget-ms", 5).stdout
        self.assertEqual(served.replace("lab/plume", str(self.store)), local)
        self.refused(2, "plan", "--server", self.address, "lab/plume", "--threads", 2,
                     says=["--threads", "--server"])
        self.refused(1, "plan", "--server", self.address, "lab/plume", "--budget-coefficients", 1,
                     says=[self.address, "rate 1 already takes"])
        self.refused(1, "plan", "--server", self.address, "nothing", says=["nothing"])

    def test_a_shot_is_one_stream_and_the_same_files(self):
        views = [{"frame": 0, "view": [0, 10], "fovea": [18, 18, 10], "rate": 8, "step": 0},
                 {"frame": 6, "view": [90, 30], "fovea": [18, 18, 40], "rate": 16, "step": 14}]
        flight = [{"frame": 0, "eye": [-60, 18, 30], "target": [18, 18, 30]},
                  {"frame": 6, "eye": [10, 18, 90], "fov": 70}]
        for name, keys in (("views", views), ("flight", flight)):
            shot = self.folder / f"{name}.json"
            shot.write_text(json.dumps({"frames": 7, "keys": keys}))
            flags = ("--animation", shot, "--size", "48x40", "--steps", "1-13x3", "-o")
            self.fovea("export", self.store, *flags, self.folder / f"local_{name}.#.png")
            for how in ((), ("--foveated",), ("--local",)):
                out = self.folder / f"served_{name}{''.join(how)}"
                before = self.logged("RenderSequence")
                self.ask("export", "lab/plume", *how, *flags, out / "f.#.png")
                if "--local" not in how:  # one for the times of the steps, one for the frames
                    self.assertEqual(self.logged("RenderSequence") - before, 2)
                for frame in range(7):
                    self.assertEqual((out / f"f.{frame}.png").read_bytes(),
                                     (self.folder / f"local_{name}.{frame}.png").read_bytes())
            # What is there already is left out: two frames in the middle, of a path that goes on.
            for frame in (3, 4):
                (out / f"f.{frame}.png").unlink()
            report = self.ask("export", "lab/plume", *how, *flags, out / "f.#.png")
            self.assertEqual(report["frames_made"], 2)
            self.assertEqual((out / "f.4.png").read_bytes(),
                             (self.folder / f"local_{name}.4.png").read_bytes())

    def test_refine_ends_with_the_same_file(self):
        flags = ("lab/plume", "--step", 9, "--size", "400x300", "--rate", 60, "-o")
        out = self.folder / "refined.png"
        report = self.fovea("render", "--server", self.address, "--refine", *flags, out).stdout
        self.assertIn("pinned by: ", report.splitlines()[-3])
        self.ask("render", *flags, self.folder / "whole.png")
        self.assertEqual(out.read_bytes(), (self.folder / "whole.png").read_bytes())
        last = self.fovea("render", "--server", self.address, "--refine", "--json", *flags,
                          out).stdout.splitlines()[-1]
        self.assertEqual(json.loads(last)["used"]["rate"], 60)
        self.refused(1, "render", "--server", self.address, "--refine", "nothing", "-o", out,
                     says=["nothing"])
        self.refused(2, "render", self.store, "--refine", "-o", out, says=["--server"])

    def logged(self, method):
        return (self.folder / "serve.log").read_text(encoding="utf-8").count(method)

    def test_render_gives_the_same_bytes(self):
        for name, flags in (("a.png", []), ("b.jpg", ["--quality", 70, "--fovea-marker"]),
                            ("c.npy", ["--field", "temperature", "--smoothing", "none"]),
                            ("d.png", ["--fovea", "0.5,0.5,0.5w", "--weighting", "falloff:0.1"]),
                            ("p.npy", ["--eye", "-30,12,60", "--fov", 60, "--up", "0,1,0"]),
                            ("q.png", ["--eye", "0.5,0.5,0.5w", "--target", "0,0,9",
                                       "--fovea-marker"]),
                            ("e.png", ["--lighting", "0.2,0.8,0.4,32", "--light", "0,1,1"]),
                            ("f.npy", ["--compositing", "maximum", "--clip-plane", "-1,0,0.5,-16"]),
                            ("g.png", ["--clip-box", "0.2,0.2,0,1.4,1.9,4w", "--view", "30,20"]),
                            ("h.npy", ["--color-field", "temperature", "--mode", "fused"]),
                            ("i.png", ["--color-field", "temperature", "--mode", "auto",
                                       "--color-transfer", "0:0,0,1:0;1:1,0,0:0"])):
            flags += ["--step", 9, "--size", "64x48"]
            served, local = self.folder / f"served_{name}", self.folder / f"local_{name}"
            report = self.ask("render", "lab/plume", *flags, "-o", served)
            self.assertEqual(report["frame_number"], 37)
            self.assertEqual(report["flags"],
                             self.fovea_json("render", self.store, *flags, "-o", local)["flags"])
            self.assertEqual(served.read_bytes(), local.read_bytes(), name)
            foveated = self.folder / f"foveated_{name}"
            self.assertEqual(self.ask("render", "lab/plume", "--foveated", *flags, "-o", foveated)
                             ["flags"], report["flags"])
            self.assertEqual(foveated.read_bytes(), local.read_bytes(), name)
            here = self.folder / f"here_{name}"
            drawn = self.ask("render", "lab/plume", "--local", *flags, "-o", here)
            self.assertEqual(drawn["flags"], report["flags"])
            self.assertGreater(drawn["stats"]["bytes_read"], 0)
            self.assertEqual(here.read_bytes(), local.read_bytes(), name)

    def test_export_streams_the_same_frames(self):
        flags = ["--size", "64x48", "--steps", "1-13x3", "--field", "temperature", "--strict",
                 "--mode", "auto"]
        served, local = self.folder / "served", self.folder / "local"
        report = self.ask("export", "lab/plume", *flags, "-o", served / "f.####.png")
        self.assertEqual(report["frames_made"], 5)
        self.fovea("export", self.store, *flags, "-o", local / "f.####.png")
        names = sorted(path.name for path in local.glob("*.png"))
        self.assertEqual(names, ["f.0005.png", "f.0017.png", "f.0029.png", "f.0041.png",
                                 "f.0053.png"])
        for name in names:
            self.assertEqual((served / name).read_bytes(), (local / name).read_bytes(), name)
        foveated = self.folder / "foveated"
        self.ask("export", "lab/plume", "--foveated", *flags, "-o", foveated / "f.####.png")
        for name in names:
            self.assertEqual((foveated / name).read_bytes(), (local / name).read_bytes(), name)
        here = self.folder / "here"
        self.ask("export", "lab/plume", "--local", *flags, "-o", here / "f.####.png")
        for name in names:
            self.assertEqual((here / name).read_bytes(), (local / name).read_bytes(), name)
        (served / "f.0029.png").unlink()
        self.assertEqual(self.ask("export", "lab/plume", *flags, "-o", served / "f.####.png")
                         ["frames_made"], 1)

    def test_refusals_say_what_and_which_flag(self):
        out = self.folder / "no.png"

        def refused(*arguments, says):
            self.refused(1, "render", "--server", self.address, *arguments, "-o", out,
                         says=[self.address, *says])
            self.assertFalse(out.exists())

        refused("../root/lab/plume", says=["no dataset"])
        refused("lab/plume", "--eye", "9,9,9", "--target", "9,9,9", says=["--target", "itself"])
        refused("lab/../lab/plume", says=["no dataset"])
        refused("plum", says=["plum"])
        refused("lab/plume", "--step", 15, says=["--step", "step 15", "0 to 14"])
        refused("lab/plume", "--fovea", "99,0,0", says=["--fovea", "outside"])
        refused("lab/plume", "--field", "heat", says=["--field", "heat", "temperature"])
        refused("lab/plume", "--color-field", "heat", says=["--color-field", "heat", "temperature"])

    def test_foveated_needs_a_server(self):
        self.refused(2, "render", self.store, "--foveated", "-o", self.folder / "no.png",
                     says=["--foveated", "--server"])

    def test_a_server_that_is_not_there(self):
        self.refused(1, "info", "--server", "127.0.0.1:1", says=["127.0.0.1:1", "serve"])
        self.refused(1, "info", "--server", "nonsense", says=["nonsense"])


class Stopping(support.FoveaTest):
    def test_sigterm_ends_it_cleanly(self):
        for stop in (signal.SIGTERM, signal.SIGINT):
            with subprocess.Popen([support.FOVEA, "serve", str(self.folder), "--listen",
                                   "127.0.0.1:0"], stdout=subprocess.PIPE,
                                  stderr=subprocess.DEVNULL, text=True) as server:
                self.assertIn("listening", server.stdout.readline())
                server.send_signal(stop)
                self.assertEqual(server.wait(timeout=20), 0)

    def test_a_root_that_is_not_there(self):
        result = support.run("serve", self.folder / "none", "--listen", "127.0.0.1:0")
        self.assertEqual(result.returncode, 1)
        self.assertIn("none", result.stderr)


if __name__ == "__main__":
    unittest.main()
