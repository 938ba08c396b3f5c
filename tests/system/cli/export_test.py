"""Sequences: numbered frames, movies, going on where it stopped, shards, animations."""

import json
import unittest

import numpy as np

import support


class Export(support.FoveaTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.store = cls.folder / "plume.zarr"
        cls.fovea(cls(), "ingest", support.PLUME_SEQUENCE, "--grid", "density", "-o", cls.store)

    def export(self, *arguments, size="65x49"):
        return self.fovea_json("export", self.store, "--size", size, *arguments)

    def test_frames_have_the_numbers_of_their_files_and_are_made_once(self):
        out = self.folder / "frames"
        report = self.export("-o", out / "f.####.png")
        self.assertEqual(report["frames_made"], 15)
        names = sorted(path.name for path in out.glob("*.png"))
        self.assertEqual(names, [f"f.{number:04}.png" for number in support.PLUME_NUMBERS])
        before = {path: path.stat().st_mtime_ns for path in out.glob("*.png")}
        gone = out / "f.0021.png"
        content = gone.read_bytes()
        gone.unlink()
        report = self.export("-o", out / "f.####.png")
        self.assertEqual((report["frames_made"], report["frames_skipped"]), (1, 14))
        self.assertIn("14 of 15 frames were done already", report["notes"][0])
        self.assertEqual(gone.read_bytes(), content)
        after = {path: path.stat().st_mtime_ns for path in out.glob("*.png")}
        self.assertEqual({path for path in after if after[path] != before[path]}, {gone})
        self.assertEqual(self.export("-o", out / "f.####.png", "--rate", 8)["frames_made"], 15)
        self.assertEqual(self.export("-o", out / "f.####.png", "--rate", 8, "--overwrite")
                         ["frames_made"], 15)

    def test_a_frame_is_what_render_makes(self):
        out = self.folder / "same"
        self.export("--steps", "4-8x4", "-o", out / "%03d.npy")
        self.assertEqual(sorted(path.name for path in out.glob("*.npy")), ["017.npy", "033.npy"])
        self.fovea("render", self.store, "--size", "65x49", "--step", 8, "-o", out / "one.npy")
        np.testing.assert_array_equal(np.load(out / "one.npy"), np.load(out / "033.npy"))

    def test_movies_have_every_frame_in_real_time(self):
        for name, rate in (("m.mp4", "6/1"), ("m.webm", "6/1")):
            self.export("-o", self.folder / name)
            self.assertEqual(support.probe(self.folder / name,
                                           "width,height,r_frame_rate,nb_read_frames"),
                             f"66,50,{rate},15")
        self.export("-o", self.folder / "slow.mp4", "--fps", 12, "--steps", "0-3")
        self.assertEqual(support.probe(self.folder / "slow.mp4", "r_frame_rate,nb_read_frames"),
                         "12/1,4")

    def test_a_movie_shows_the_pictures(self):
        movie, frame = self.folder / "shown.mp4", self.folder / "shown.png"
        self.export("-o", movie, "--steps", 12, "--background", "0.2,0.2,0.2", size="64x48")
        self.fovea("render", self.store, "--step", 12, "--size", "64x48", "--background",
                   "0.2,0.2,0.2", "-o", frame)
        far = (support.pixels_of(movie, 64, 48).astype(int) -
               support.pixels_of(frame, 64, 48).astype(int))
        self.assertLess(np.abs(far).mean(), 4)
        self.assertLess(abs(far.mean()), 1.5)  # no shift of range or matrix

    def test_exr_and_tiff_frames(self):
        report = self.export("--steps", "0-1", "-o", self.folder / "e.#.exr")
        self.assertEqual(report["frames_made"], 2)
        self.assertTrue((self.folder / "e.1.exr").exists())
        self.export("--steps", "0-1", "-o", self.folder / "t.#.tif")
        self.assertTrue((self.folder / "t.5.tif").exists())

    def test_shards_make_each_frame_once(self):
        out = self.folder / "shards"
        made = [self.export("-o", out / "f.####.jpg", "--shard", f"{i}/4")["frames_made"]
                for i in range(4)]
        self.assertEqual(made, [4, 4, 4, 3])
        self.assertEqual(self.export("-o", out / "f.####.jpg")["frames_made"], 0)

    def test_animations_and_orbits(self):
        shot = self.folder / "shot.json"
        shot.write_text(json.dumps({"frames": 5, "keys": [
            {"frame": 0, "view": [0, 0], "fovea": [18, 18, 10], "rate": 8, "step": 0},
            {"frame": 4, "view": [90, 30], "fovea": [18, 18, 40], "rate": 16, "step": 14}]}))
        out = self.folder / "animated"
        self.assertEqual(self.export("--animation", shot, "-o", out / "a.#.npy")["frames_made"], 5)
        self.fovea("render", self.store, "--size", "65x49", "--step", 7, "--view", "45,15",
                   "--fovea", "18,18,25", "--rate", 12, "-o", out / "middle.npy")
        np.testing.assert_array_equal(np.load(out / "middle.npy"), np.load(out / "a.2.npy"))
        report = self.export("--orbit", 360, "--orbit-frames", 6, "--steps", 9, "-o",
                             out / "o.#.npy")
        self.assertEqual(report["frames_made"], 6)
        self.fovea("render", self.store, "--size", "65x49", "--step", 9, "--view", "60,0", "-o",
                   out / "turned.npy")
        np.testing.assert_array_equal(np.load(out / "turned.npy"), np.load(out / "o.1.npy"))

    def test_cameras_move_and_orbit(self):
        shot = self.folder / "flight.json"
        shot.write_text(json.dumps({"frames": 3, "keys": [
            {"frame": 0, "eye": [-60, 18, 30], "target": [18, 18, 30], "fov": 40},
            {"frame": 2, "eye": [10, 18, 40], "fov": 80}]}))
        out = self.folder / "flown"
        self.assertEqual(self.export("--animation", shot, "--steps", 9, "-o", out / "a.#.npy")
                         ["frames_made"], 3)
        self.fovea("render", self.store, "--size", "65x49", "--step", 9, "--eye", "-25,18,35",
                   "--target", "18,18,30", "--fov", 60, "-o", out / "middle.npy")
        middle = np.load(out / "middle.npy")
        self.assertGreater(middle.max(), 0)
        np.testing.assert_array_equal(middle, np.load(out / "a.1.npy"))
        report = self.export("--orbit", 360, "--orbit-frames", 2, "--steps", 9, "--eye",
                             "-60,18,30", "--target", "18,18,30", "-o", out / "o.#.npy")
        self.assertEqual(report["frames_made"], 2)
        self.fovea("render", self.store, "--size", "65x49", "--step", 9, "--eye", "96,18,30",
                   "--target", "18,18,30", "-o", out / "turned.npy")
        np.testing.assert_allclose(np.load(out / "turned.npy"), np.load(out / "o.1.npy"), atol=1e-4)

    def test_a_demo_needs_no_data(self):
        out = self.folder / "demo"
        report = self.fovea_json("demo", "--out", out, "--edge", 32, "--steps", 3)
        self.assertEqual(len(report["pictures"]), 4)
        for picture in report["pictures"]:
            self.assertGreater(support.pixels_of(picture["path"], 512, 512).max(), 100)
        self.assertEqual(support.probe(report["movie"], "nb_read_frames"), "3")
        self.fovea("verify", report["dataset"])


if __name__ == "__main__":
    unittest.main()
