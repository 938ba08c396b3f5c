"""Nothing happens without a word: flags that cannot apply are refused, and what was decided, left out
or held is said."""

import re
import shutil
import unittest

import numpy as np

import support

ONE = str(support.PLUME / "plume_0021.vdb")


class Told(support.FoveaTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.store = cls.folder / "plume.zarr"
        cls.fovea(cls(), "ingest", support.PLUME_SEQUENCE, "--grid", "density", "-o", cls.store)
        cls.raw = cls.folder / "ball.raw"
        support.write_raw_ball(cls.raw)
        cls.as_raw = [cls.raw, "--raw", "24x20x18:uint8"]

    def fovea_of(self, *arguments):
        """The fovea that render chose, as it prints it."""
        result = self.fovea("render", *arguments, "--size", "32x32", "-o", self.folder / "f.png")
        return [float(n) for n in re.search(r"--fovea (\S+)", result.stdout)[1].split(",")]

    # Flags.

    def test_a_flag_that_cannot_apply_is_wrong_usage(self):
        out = self.folder / "no.zarr"
        picture = ["-o", self.folder / "no.png"]
        for arguments, says in (
                (["ingest", ONE, "--field", "smoke", "-o", out], ["--field", "VDB", "--grid"]),
                (["ingest", ONE, "--spacing", "1,1,1", "-o", out], ["--spacing", "VDB"]),
                (["ingest", ONE, "--axes", "xyz", "-o", out], ["--axes", "NumPy"]),
                (["ingest", *self.as_raw, "--grid", "density", "-o", out], ["--grid", "VDB"]),
                (["ingest", *self.as_raw, "--slices", 4, "-o", out], ["--slices", "pictures"]),
                (["ingest", ONE, "--append", "--chunk", 8, "-o", self.store], ["--chunk"]),
                (["ingest", ONE, "--append", "--extent", "0,0,0,9,9,9", "-o", self.store],
                 ["--extent"]),
                (["ingest", ONE, "--append", "--retain", "9,9,9:8", "-o", self.store],
                 ["--retain"]),
                (["render", self.store, "--grid", "density", *picture], ["--grid", "plume.zarr"]),
                (["render", self.store, "--cache", self.folder, *picture], ["--cache"]),
                (["export", self.store, "--on-missing", "skip", "-o", self.folder / "n.mp4"],
                 ["--on-missing"]),
                (["render", "--server", "127.0.0.1:1", "plume", "--grid", "density", *picture],
                 ["--grid", "--server"]),
                (["render", *self.as_raw, "--grid", "density", *picture], ["--grid", "VDB"]),
                (["sensors", "-", "--append", "--clock", "noon", "-o", out], ["--clock"]),
                (["sensors", "-", "--append", "--chunk", 8, "-o", out], ["--chunk"])):
            with self.subTest(arguments=arguments):
                self.refused(2, *arguments, says=says)
        self.assertFalse(out.exists())
        self.assertFalse((self.folder / "no.png").exists())

    def test_an_error_names_its_flag(self):
        out = self.folder / "no.zarr"
        for status, flags, says in (
                (2, ["--lossless", "--wavelet", "cdf97"], ["--wavelet", "--lossless", "cdf53"]),
                (2, ["--tolerance", "0.5", "--lossless"], ["--tolerance", "--lossless"]),
                (2, ["--spacing", "1,1"], ["--spacing", "X,Y,Z"]),
                (2, ["--spacing", "1,1,1w"], ["--spacing", "X,Y,Z"]),
                (2, ["--spacing", "1,0,1"], ["--spacing", "above 0"]),
                (1, ["--tolerance", "1e-9"], ["--tolerance: 1e-09", "'density'"])):
            with self.subTest(flags=flags):
                said = self.refused(status, "ingest", *self.as_raw, *flags, "-o", out, says=says)
                self.assertNotIn("--field", said)

    def test_what_is_another_on_a_dataset_that_is_there(self):
        series = ["ingest", support.PLUME_SEQUENCE, "--grid", "density"]
        coarse = self.folder / "coarse.zarr"
        self.fovea("ingest", *self.as_raw, "--tolerance", "0.5", "-o", coarse)
        for arguments, says in (
                ([*series, "--grid", "temperature", "-o", self.store],
                 ["fields density, not density, temperature", "--grid"]),
                ([*series, "--fps", 30, "-o", self.store], ["--fps 24, not 30"]),
                ([*series, "--wavelet", "cdf53", "-o", self.store], ["--wavelet haar, not cdf53"]),
                ([*series, "--chunk", 8, "-o", self.store], ["--chunk 16, not 8"]),
                ([*series, "--retain", "9,9,9:8", "-o", self.store], ["--retain"]),
                ([*series, "--tolerance", "0.1", "-o", self.store], ["without --tolerance"]),
                (["ingest", *self.as_raw, "--tolerance", "0.25", "-o", coarse],
                 ["--tolerance 0.5, not 0.25"]),
                (["ingest", *self.as_raw, "-o", coarse], ["with --tolerance 0.5"]),
                (["ingest", ONE, "--grid", "density", "-o", self.store], ["step 0 is at"])):
            with self.subTest(arguments=arguments):
                self.refused(1, *arguments, says=["is there already", *says])

    # What was decided.

    def test_a_plan_of_a_tolerance_is_made_in_one_piece(self):
        plan, store = self.folder / "plan.json", self.folder / "planned.zarr"
        said = self.fovea("ingest", *self.as_raw, "--tolerance", "0.5", "--plan", plan).stdout
        self.assertNotIn("--shard", said)
        self.assertIn("in one piece", said)
        self.fovea("ingest", "--from-plan", plan, "-o", store)
        said = self.fovea("ingest", *self.as_raw, "--plan", self.folder / "parts.json").stdout
        self.assertIn("--shard i/n", said)

    def test_names_and_folders_of_new_datasets(self):
        result = self.fovea("ingest", *self.as_raw, "-o", self.folder / "new" / "deep" / "ball")
        self.assertIn("does not end in .zarr", result.stderr)
        self.assertIn("made the folder", result.stderr)
        result = self.fovea("ingest", *self.as_raw, "-o", self.folder / "new" / "deep" / "b.zarr")
        self.assertNotIn(".zarr:", result.stderr)
        self.assertNotIn("made the folder", result.stderr)
        result = self.fovea("retain", self.store, "--retain", "9,9,9:8", "-o",
                            self.folder / "kept" / "some", "-q")
        self.assertEqual(result.stderr, "")
        self.assertTrue((self.folder / "kept" / "some" / "zarr.json").exists())

    def test_steps_that_were_held_or_skipped_are_counted(self):
        series = self.folder / "gaps"
        series.mkdir()
        for number in support.PLUME_NUMBERS:
            if number not in (21, 25, 41):
                shutil.copy(support.PLUME / f"plume_{number:04}.vdb", series)
        for what, steps, other in (("held", 15, "skipped"), ("skipped", 12, "held")):
            flag = {"held": "hold", "skipped": "skip"}[what]
            command = ["ingest", series / "plume_####.vdb", "--on-missing", flag]
            result = self.fovea(*command, "-o", self.folder / f"{what}.zarr")
            self.assertIn(f"{what}: 3 steps", result.stdout)
            self.assertNotIn(f"{other}:", result.stdout)
            self.assertIn("no files of numbers 21 to 25, 41", result.stderr)
            report = self.fovea_json(*command, "-o", self.folder / f"{what}_json.zarr")
            self.assertEqual((report["steps"], report[f"steps_{what}"], report[f"steps_{other}"]),
                             (steps, 3, 0))

    def test_late_readings_name_the_flag_that_keeps_them(self):
        readings = self.folder / "late.csv"
        readings.write_text("x,y,z,t,v\n0,0,0,0,1\n9,9,9,30,2\n3,3,3,5,1\n")
        said = self.fovea("sensors", readings, "--step-seconds", 10, "-o",
                          self.folder / "late.zarr").stdout
        self.assertIn("1 late", said)
        self.assertIn("--watermark", said)

    def test_one_is_not_many(self):
        said = self.fovea("ingest", *self.as_raw, "-o", self.folder / "one.zarr").stdout
        self.assertIn(": 1 step of 24 x 20 x 18", said)
        self.assertIn("1 step was there already",
                      self.fovea("ingest", *self.as_raw, "-o", self.folder / "one.zarr").stdout)
        self.assertIn("a series of 1 step,", self.fovea("info", self.folder / "one.zarr").stdout)

    def test_extract_says_what_it_chose(self):
        voxels = self.folder / "v.npy"
        said = self.fovea("extract", self.store, "--step", 3, "--fovea", "19,19,20", "-o",
                          voxels).stdout
        chosen = re.search(r"--fovea 19,19,20 --rate (\d+)", said)
        self.assertTrue(chosen, said)
        report = self.fovea_json("extract", self.store, "--step", 3, "--fovea", "19,19,20", "-o",
                                 voxels)
        self.assertEqual(report["rate"], 3 * [float(chosen[1])])

    def test_what_is_wrong_with_a_server_is_not_below_its_datasets(self):
        none = self.folder / "none.pem"
        result = support.run("serve", self.folder, "--listen", "127.0.0.1:0", "--tls-cert", none,
                             "--tls-key", none)
        self.assertNotEqual(result.returncode, 0)
        self.assertIn("none.pem", result.stderr)
        self.assertNotIn("plume", result.stderr)

    # The fovea that nobody chose.

    def test_the_fovea_lies_in_what_is_shown(self):
        low = self.fovea_of(self.store, "--step", 8)
        size = self.fovea_json("info", self.store)
        dims = [size["nx"], size["ny"], size["nz"]]
        box = [0, 0, 0, *dims]
        box[2] = low[2] + 6  # above it
        at = self.fovea_of(self.store, "--step", 8, "--clip-box", ",".join(map(str, box)))
        for axis in range(3):
            self.assertTrue(box[axis] <= at[axis] <= box[axis + 3], (at, box))
        # A part of the picture in which no dense region lies.
        at = self.fovea_of(self.store, "--step", 8, "--center", "2,2,2", "--span", 3)
        self.assertLess(max(abs(x - 2) for x in at[1:]), 3)  # seen along x
        # From within, looking away.
        eye = ",".join(str(x) for x in low)
        at = self.fovea_of(self.store, "--step", 8, "--eye", eye, "--target",
                           f"{low[0]},{low[1]},{dims[2]}", "--fov", 40)
        self.assertGreater(at[2], low[2])

    def test_the_fovea_lies_where_detail_was_kept(self):
        kept = self.folder / "retained.zarr"
        self.fovea("retain", self.store, "--retain", "4,4,30:6", "--retain", "30,30,36:4", "-o",
                   kept)
        self.assertEqual(self.fovea_of(kept), [4, 4, 30])
        result = self.fovea("render", kept, "--size", "32x32", "-o", self.folder / "k.png")
        self.assertIn("--rate 6 ", result.stdout)
        self.assertNotIn("warning", result.stderr)

    def test_the_fovea_of_a_row_of_voxels_is_not_at_its_corner(self):
        row = self.folder / "row.raw"
        np.arange(31, dtype=np.uint8).tofile(row)
        store = self.folder / "row.zarr"
        self.fovea("ingest", row, "--raw", "31x1x1:uint8", "-o", store)
        spec = self.fovea_json("info", store)["default_spec"]["fovea"]["at"]
        self.assertEqual((spec["y"], spec["z"]), (0.5, 0.5))
        self.assertTrue(0 < spec["x"] < 31, spec)


if __name__ == "__main__":
    unittest.main()
