"""Foreign files given to render and export: ingested into a cache first, once."""

import os
import shutil
import signal
import subprocess
import time
import unittest

import support


class ForeignFiles(support.FoveaTest):
    def setUp(self):
        self.cache = self.folder / self.id() / "cache"
        self.out = self.folder / self.id()
        self.out.mkdir()

    def test_a_sequence_becomes_a_movie_with_nothing_else_typed(self):
        environment = {**os.environ, "XDG_CACHE_HOME": str(self.cache)}
        movie = self.out / "plume.mp4"
        result = self.fovea("export", support.PLUME_SEQUENCE, "-o", movie, env=environment)
        self.assertIn("ingesting into the cache", result.stderr)
        self.assertIn("pinned by: --field density --fovea ", result.stdout)
        self.assertEqual(support.probe(movie, "nb_read_frames"), "15")
        self.assertEqual(len(list((self.cache / "fovea").glob("plume-*.zarr"))), 1)

    def test_the_cache_is_used_until_a_file_changes(self):
        raw = [self.out / f"ball_{i}.raw" for i in (1, 2)]
        for i, path in enumerate(raw):
            support.write_raw_ball(path, phase=i)

        def render(name):
            result = self.fovea("render", *raw, "--raw", "24x20x18:uint8", "--cache", self.cache,
                                "--step", 1, "--view", "90,0", "--size", "48x48",
                                "-o", self.out / name)
            return result.stderr, (self.out / name).read_bytes()

        first, picture = render("a.png")
        self.assertIn("ingesting", first)
        second, same = render("b.png")
        self.assertIn("using the ingested copy", second)
        self.assertEqual(picture, same)
        support.write_raw_ball(raw[1], phase=-1)
        third, changed = render("c.png")
        self.assertIn("ingesting", third)
        self.assertNotEqual(picture, changed)

    def test_single_vdb_file_of_one_grid(self):
        report = self.fovea_json("render", support.PLUME / "plume_0041.vdb", "--grid",
                                 "temperature", "--cache", self.cache, "-o", self.out / "t.png")
        self.assertEqual(report["used"]["field"], "temperature")
        self.assertEqual(report["frame_number"], 41)

    def test_a_killed_ingest_leaves_no_half_cache(self):
        for i in range(40):
            support.write_raw_ball(self.out / f"k_{i:02}.raw", dims=(64, 64, 64), phase=i / 40)
        command = ["export", str(self.out / "k_##.raw"), "--raw", "64x64x64:uint8", "--cache",
                   str(self.cache), "--size", "32x32", "-o", str(self.out / "k.##.png")]
        process = subprocess.Popen([support.FOVEA, *command], stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 30
        while not list(self.cache.glob(".k-*.partial.zarr/zarr.json")):
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.005)
        process.kill()
        process.communicate()
        self.assertEqual(list(self.cache.glob("k-*.zarr")), [])
        self.assertEqual(len(list(self.cache.glob(".k-*.partial.zarr"))), 1)
        self.fovea(*command)
        self.assertEqual(list(self.cache.glob(".*")), [])
        self.assertEqual(len(list(self.cache.glob("k-*.zarr"))), 1)
        self.assertEqual(len(list(self.out.glob("k.*.png"))), 40)

    def test_ctrl_c_while_ingesting_leaves_no_half_cache(self):
        for i in range(40):
            support.write_raw_ball(self.out / f"c_{i:02}.raw", dims=(64, 64, 64), phase=i / 40)
        process = subprocess.Popen(
            [support.FOVEA, "render", str(self.out / "c_##.raw"), "--raw", "64x64x64:uint8",
             "--cache", str(self.cache), "-o", str(self.out / "c.png")],
            stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 30
        while not list(self.cache.glob(".c-*.partial.zarr/zarr.json")):
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.005)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=30)
        self.assertEqual(process.returncode, 1, errors)
        self.assertEqual(list(self.cache.iterdir()), [])

    def test_files_that_are_not_there(self):
        self.refused(1, "render", self.out / "no_####.vdb", "--cache", self.cache, "-o",
                     self.out / "n.png", says=["no_####.vdb"])
        self.refused(1, "render", self.out / "no.zarr", "-o", self.out / "n.png",
                     says=["no.zarr"])
        shutil.copy(support.PLUME / "plume_0001.vdb", self.out / "one.vdb")
        self.refused(1, "render", self.out / "one.vdb", "--grid", "flame", "--cache", self.cache,
                     "-o", self.out / "n.png", says=["flame", "density"])
        self.assertEqual([path for path in self.cache.glob("*")], [])


if __name__ == "__main__":
    unittest.main()
