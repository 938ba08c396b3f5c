"""`fovea bench`: what it measures is there, consistent, and about the dataset that was named."""

import unittest

import support


class Bench(support.FoveaTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        raw = cls.folder / "ball.raw"
        support.write_raw_ball(raw, dims=(48, 40, 36))
        cls.dataset = cls.folder / "ball.zarr"
        support.run("ingest", raw, "--raw", "48x40x36:uint8", "-o", cls.dataset, "-q")

    def test_every_phase_on_one_thread_and_on_two(self):
        result = self.fovea_json("bench", self.dataset, "--rate", "12", "--size", "64x48",
                                 "--threads", "2", "--rounds", "2", "-q")
        self.assertEqual(result["dims_xyz"], [48, 40, 36])
        self.assertEqual(result["spec"]["width_px"], 64)
        self.assertEqual([run["threads"] for run in result["runs"]], [1, 2])
        for run in result["runs"]:
            for phase in ("read", "fused_playback", "two_phase", "reconstruct", "rays_combine", "smooth_warp", "encode", "full",
                          "plain_loops"):
                self.assertGreater(run[f"{phase}_ms"], 0, phase)
            self.assertGreaterEqual(run["frame_ms"], run["rays_combine_ms"])
        frame = self.fovea_json("render", self.dataset, "--rate", "12", "--size", "64x48",
                                "-o", self.folder / "f.png")
        self.assertEqual(result["coefficients"], int(frame["stats"]["coefficients"]))
        self.assertGreater(result["frame_peak_bytes"], 1 << 20)

    def test_a_weighting_leaves_the_plain_loops_out_and_says_so(self):
        result = self.fovea_json("bench", self.dataset, "--weighting", "chop", "--rounds", "1")
        self.assertNotIn("plain_loops_ms", result["runs"][0])
        self.assertIn("full_ms", result["runs"][0])
        self.assertIn("weighting", result["notes"][0])

    def test_the_table_names_every_phase(self):
        table = self.fovea("bench", self.dataset, "--rounds", "1", "--threads", "1").stdout
        for words in ("1 thread", "reconstruct", "thick rays", "plain loops", "ns a sample"):
            self.assertIn(words, table)

    def test_wrong_input(self):
        self.refused(2, "bench", self.dataset, "--rounds", "0", says=["--rounds"])
        self.refused(1, "bench", self.dataset, "--step", "7", says=["step 7"])
        self.refused(1, "bench", self.folder / "nix.zarr", says=["nix.zarr"])


if __name__ == "__main__":
    unittest.main()
