"""The main job through the front door: ingest, info, stats, verify, render, extract."""

import shlex
import struct
import unittest

import numpy as np

import support


class Pipeline(support.FoveaTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.store = cls.folder / "plume.zarr"
        cls.report = cls.fovea_json(cls(), "ingest", support.PLUME_SEQUENCE, "-o", cls.store)

    def test_ingest_reports_what_it_made(self):
        self.assertEqual(self.report["steps"], 15)
        self.assertEqual(self.report["fields"], ["density", "temperature"])

    def test_info_knows_the_dataset_and_its_defaults(self):
        info = self.fovea_json("info", self.store)
        self.assertEqual([info["nx"], info["ny"], info["nz"]],
                         [self.report["nx"], self.report["ny"], self.report["nz"]])
        self.assertEqual(info["committed_steps"], 15)
        self.assertEqual(info["default_field"], "density")
        self.assertEqual(len(info["index_to_world"]), 16)
        self.assertAlmostEqual(info["index_to_world"][0], 0.0625)
        self.assertEqual(info["first_time_ns"], round(1e9 / 24))
        self.assertIn("rate", info["default_spec"])
        self.assertIn("--fovea", self.fovea("info", self.store).stdout)

    def test_stats_count_every_voxel(self):
        steps = self.fovea_json("stats", self.store)["steps"]
        self.assertEqual([step["frame_number"] for step in steps], support.PLUME_NUMBERS)
        voxels = self.report["nx"] * self.report["ny"] * self.report["nz"]
        for step in steps:
            for field in step["fields"]:
                self.assertEqual(sum(field["histogram"]), voxels)
        some = self.fovea_json("stats", self.store, "--steps", "2-8x3", "--field", "temperature")
        self.assertEqual([step["step"] for step in some["steps"]], [2, 5, 8])

    def test_verify_finds_nothing(self):
        report = self.fovea_json("verify", self.store)
        self.assertEqual(report["problems"], [])
        self.assertGreater(report["chunks"], 100)

    def test_extract_gives_boxes_and_the_foveated_volume(self):
        whole, box, foveated = (self.folder / name for name in ("w.npy", "b.raw", "v.npy"))
        self.fovea("extract", self.store, "--step", 8, "-o", whole)
        voxels = np.load(whole)
        self.assertEqual(voxels.shape, (self.report["nz"], self.report["ny"], self.report["nx"]))
        self.assertEqual(voxels.dtype, np.float32)
        self.assertGreater(voxels.max(), 0.5)
        self.fovea("extract", self.store, "--step", 8, "--box", "10,5,3,20,30,40", "-o", box)
        np.testing.assert_array_equal(np.fromfile(box, np.float32).reshape(37, 25, 10),
                                      voxels[3:40, 5:30, 10:20])
        self.fovea("extract", self.store, "--step", 8, "--fovea", "18,10,14", "--rate", 8,
                   "-o", foveated)
        kept = np.load(foveated)
        np.testing.assert_array_equal(kept[10:18, 6:14, 14:22], voxels[10:18, 6:14, 14:22])
        self.assertFalse(np.array_equal(kept, voxels))

    def test_what_went_in_comes_out(self):
        raw, store, out = (self.folder / name for name in ("i.raw", "i.zarr", "i.npy"))
        rng = np.random.default_rng(7)
        voxels = rng.integers(0, 65536, (13, 31, 22)).astype(">u2")
        raw.write_bytes(b"skip" + voxels.tobytes())
        self.fovea("ingest", raw, "--raw", "22x31x13:uint16:be", "--header-bytes", 4, "-o", store)
        self.fovea("extract", store, "-o", out)
        far = np.abs(np.load(out) - voxels.astype(np.float32)).max()
        self.assertLessEqual(far, 4 * np.spacing(np.float32(65535)))

    def test_every_wavelet_works_everywhere(self):
        whole = {}
        for wavelet in ("haar", "cdf53", "cdf97"):
            store, out = self.folder / f"{wavelet}.zarr", self.folder / f"{wavelet}.npy"
            self.fovea("ingest", support.PLUME / "plume_0041.vdb", "--wavelet", wavelet, "-o", store)
            self.assertEqual(self.fovea_json("info", store)["wavelet"], wavelet)
            self.assertEqual(self.fovea_json("verify", store)["problems"], [])
            self.fovea("extract", store, "-o", out)
            whole[wavelet] = np.load(out)
            np.testing.assert_allclose(whole[wavelet], whole["haar"], atol=1e-5)
            for rate in (8, 4096):
                self.fovea("render", store, "--fovea", "18,10,14", "--rate", rate, "--view", "30,20",
                           "--transfer", "0:1,1,1:0;1:1,0.5,0:0.3", "--size", "64x64",
                           "-o", self.folder / f"{wavelet}{rate}.npy")
            self.fovea("render", store, "--fovea", "18,10,14", "--rate", 8, "--size", "64x64", "--view",
                       "30,20", "--transfer", "0:1,1,1:0;1:1,0.5,0:0.3", "--reconstruction", "fast",
                       "-o", self.folder / f"{wavelet}fast.npy")
            fast = np.load(self.folder / f"{wavelet}fast.npy")
            far = np.abs(fast - np.load(self.folder / f"{wavelet}8.npy")).max()
            self.assertEqual(far == 0, wavelet == "haar")
            self.assertLess(far, 0.3)
        pictures = {(w, r): np.load(self.folder / f"{w}{r}.npy")
                    for w in whole for r in (8, 4096)}
        for wavelet in ("cdf53", "cdf97"):  # everything kept: the same voxels, the same picture
            full = np.abs(pictures[wavelet, 4096] - pictures["haar", 4096]).max()
            some = np.abs(pictures[wavelet, 8] - pictures["haar", 4096]).max()
            self.assertLess(full, 1e-4)
            self.assertTrue(1e-3 < some < 0.5, some)

    def test_a_picture_is_the_same_in_every_format(self):
        common = ["--step", 8, "--size", "96x64", "--view", "35,-20", "--rate", 16]
        for ending in ("png", "jpg", "exr", "tif", "npy"):
            self.fovea("render", self.store, *common, "-o", self.folder / f"p.{ending}")
        linear = np.load(self.folder / "p.npy")
        self.assertEqual(linear.shape, (64, 96, 4))
        self.assertGreater(linear[..., 3].max(), 0.5)
        self.assertEqual(linear[0, :, 3].max(), 0)
        expected = support.srgb_bytes(linear[..., :3])
        png = support.pixels_of(self.folder / "p.png", 96, 64)
        self.assertLessEqual(np.abs(png.astype(int) - expected).max(), 1)  # ties at one half
        jpeg = support.pixels_of(self.folder / "p.jpg", 96, 64)
        self.assertLess(np.abs(jpeg.astype(int) - expected).mean(), 3)
        self.assertEqual((self.folder / "p.exr").read_bytes()[:4], b"\x76\x2f\x31\x01")
        self.assertIn((self.folder / "p.tif").read_bytes()[:4], (b"II*\0", b"MM\0*"))

    def test_the_printed_flags_pin_the_picture(self):
        first, again = self.folder / "first.png", self.folder / "again.png"
        report = self.fovea_json("render", self.store, "--size", "80x60", "-o", first)
        self.assertEqual(report["used"]["field"], "density")
        self.assertEqual(report["stats"]["chunks_read"], report["stats"]["chunks_total"])
        self.assertIn(report["flags"], self.fovea("render", self.store, "--size", "80x60", "-o",
                                                  first).stdout)
        self.fovea("render", self.store, *shlex.split(report["flags"]), "--threads", 1,
                   "-o", again)
        self.assertEqual(first.read_bytes(), again.read_bytes())

    def test_the_marker_and_the_background_show(self):
        plain, marked = self.folder / "plain.png", self.folder / "marked.png"
        common = ["--size", "64x64", "--background", "0,0,1"]
        self.fovea("render", self.store, *common, "-o", plain)
        self.fovea("render", self.store, *common, "--fovea-marker", "-o", marked)
        blue = support.pixels_of(plain, 64, 64)
        self.assertEqual(blue[0, 0].tolist(), [0, 0, 255])
        red = (support.pixels_of(marked, 64, 64) == [255, 0, 0]).all(axis=2)
        self.assertTrue(5 < red.sum() < 60, red.sum())

    def test_the_picture_of_a_full_rate_differs_from_a_coarse_one(self):
        for rate in (4, 64):
            self.fovea("render", self.store, "--step", 10, "--rate", rate, "--size", "64x64", "-o",
                       self.folder / f"rate{rate}.npy")
        coarse = np.load(self.folder / "rate4.npy")
        full = np.load(self.folder / "rate64.npy")
        self.assertGreater(np.abs(full - coarse).max(), 0.02)
        self.assertLess(np.abs(full.mean() - coarse.mean()), 0.2 * full.mean())

    def test_a_jpegs_quality_matters(self):
        for quality in (10, 95):
            self.fovea("render", self.store, "--step", 10, "--quality", quality, "-o",
                       self.folder / f"q{quality}.jpg")
        sizes = [(self.folder / f"q{quality}.jpg").stat().st_size for quality in (10, 95)]
        self.assertLess(2 * sizes[0], sizes[1])
        header = (self.folder / "q95.jpg").read_bytes()[:2]
        self.assertEqual(struct.unpack(">H", header)[0], 0xFFD8)

    def test_version_names_the_instruction_set(self):
        self.assertRegex(self.fovea("--version").stdout, r"^fovea \d+\.\d+\.\d+ \(.*baseline\)\n$")


if __name__ == "__main__":
    unittest.main()
