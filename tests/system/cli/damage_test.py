"""Damage through the front door: every picture says that something is left out, --strict refuses,
verify lists it, repair saves the rest and says what was lost."""

import shutil
import subprocess
import unittest

import numpy as np

import support

SIZE = ["--size", "48x48", "--rate", "65536", "--step", 4]


def flip(path, part):
    """Changes one byte at `part` (0 to 1) of a file."""
    data = bytearray(path.read_bytes())
    data[int(part * (len(data) - 1))] ^= 0x10
    path.write_bytes(data)


class Damage(support.FoveaTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.sound = cls.folder / "sound.zarr"
        cls.fovea(cls(), "ingest", support.PLUME_SEQUENCE, "--grid", "density", "-o", cls.sound)

    def damaged(self, name, *harms):
        """A copy of the store in which the first file like each pattern had a byte changed."""
        store = self.folder / "root" / f"{name}.zarr"
        shutil.copytree(self.sound, store)
        for pattern, part in harms:
            flip(sorted(store.glob(pattern))[0], part)
        return store

    def warned(self, result):
        self.assertIn("damaged", result.stderr)
        self.assertIn("coarser values", result.stderr)

    def test_every_way_to_a_picture_says_it(self):
        harms = {"chunk": [("density/detail_2/c.4.*", 0.1)],
                 "index": [("density/detail_2/c.4.*", 1.0)],
                 "table": [("density/chunk_max_2/c.4.*", 0.5), ("density/detail_2/c.4.*", 0.1)],
                 "all": [("density/chunk_max_2/c.4.*", 0.5), ("density/detail_2/c.4.*", 1.0)]}
        for name, harm in harms.items():
            store = self.damaged(name, *harm)
            picture, movie, voxels = (self.folder / f"{name}{end}" for end in
                                      (".npy", ".mp4", "_voxels.npy"))
            counts = set()
            for mode in ("two-phase", "fused"):
                with self.subTest(harm=name, mode=mode):
                    flags = [*SIZE, "--mode", mode, "-o", picture]
                    self.warned(self.fovea("render", store, *flags))
                    report = self.fovea_json("render", store, *flags)
                    self.assertEqual(len(report["warnings"]), 1)
                    counts.add(report["warnings"][0]["count"])
                    self.assertTrue(np.isfinite(np.load(picture)).all())
                    self.refused(1, "render", store, *flags, "--strict",
                                 says=["detail_2", "step 4"])
            self.assertEqual(len(counts), 1, f"{name}: fused and two-phase count alike: {counts}")
            with self.subTest(harm=name):
                self.warned(self.fovea("export", store, "--steps", "3-5", "--size", "48x48",
                                       "--rate", "65536", "-o", movie))
                self.warned(self.fovea("extract", store, "--step", 4, "-o", voxels))
                self.assertEqual(self.fovea_json("extract", store, "--step", 4, "-o",
                                                 voxels)["chunks_damaged"], counts.pop())
                self.refused(1, "extract", store, "--step", 4, "-o", voxels, "--strict",
                             says=["detail_2", "step 4"])
                self.fovea("render", store, "--size", "48x48", "--step", 5, "-o", picture,
                           "--strict")
                self.fovea("plan", store, "--step", 4, "--rate", "65536")

    def test_a_server_says_it_too(self):
        self.damaged("served", ("density/detail_2/c.4.*", 0.1))
        store = self.damaged("lost", ("density/coarse/c.8.*", 0.5))
        support.run("repair", store, "--in-place")
        server = subprocess.Popen(
            [support.FOVEA, "serve", str(self.folder / "root"), "--listen", "127.0.0.1:0",
             "--log-level", "off"], stdout=subprocess.PIPE, text=True)
        try:
            address = server.stdout.readline().split()[-1]
            flags = ["--server", address, "served", *SIZE, "-o", self.folder / "served.npy"]
            self.warned(self.fovea("render", *flags))
            self.refused(1, "render", *flags, "--strict", says=["detail_2", "step 4"])
            served = self.fovea_json("info", "--server", address, "lost")
            local = self.fovea_json("info", store)
            self.assertEqual(served["fields"], local["fields"])
            self.assertEqual(served["fields"][0]["lost_steps"], [8])
            self.assertIn("lost      step 8 of field 'density'",
                          self.fovea("info", "--server", address, "lost").stdout)
        finally:
            server.kill()
            server.wait()
            server.stdout.close()

    def test_repair_saves_the_rest(self):
        store = self.damaged("mend", ("density/detail_2/c.4.*", 0.1),
                             ("density/detail_2/c.6.*", 1.0), ("density/coarse/c.8.*", 0.5),
                             ("density/histogram/c.0*", 0.5))
        self.refused(1, "verify", store)
        for arguments, mended in (["-o", self.folder / "new.zarr"], self.folder / "new.zarr"), \
                (["--in-place"], store):
            result = support.run("repair", store, *arguments)
            self.assertEqual(result.returncode, 1)
            lost = [line for line in result.stdout.splitlines() if line.startswith("  lost: ")]
            self.assertEqual(len(lost), 2, result.stdout)
            self.assertTrue(any("of step 4" in line for line in lost))
            self.assertTrue(any("step 8 of 'density'" in line for line in lost))
            self.assertIn("  rebuilt: density/histogram", result.stdout)
            self.assertIn("lost: step 8 of field 'density'", self.fovea("verify", mended).stdout)
            self.assertEqual(self.fovea_json("verify", mended)["lost_steps"], {"density": [8]})
            self.assertIn("lost      step 8 of field 'density'", self.fovea("info", mended).stdout)
            self.assertEqual(self.fovea_json("info", mended)["fields"][0]["lost_steps"], [8])
            self.assertIn("| lost", self.fovea("stats", mended, "--steps", "8").stdout)
            for step in (0, 6, 14):  # the index of 6 was found again
                before, after = self.folder / "before.npy", self.folder / "after.npy"
                self.fovea("extract", self.sound, "--step", step, "-o", before)
                self.fovea("extract", mended, "--step", step, "-o", after, "--strict")
                self.assertEqual(before.read_bytes(), after.read_bytes())
            self.warned(self.fovea("render", mended, "--step", 8, "--size", "48x48", "-o",
                                   self.folder / "lost.npy"))
            stats = [self.fovea_json("stats", which)["steps"] for which in (self.sound, mended)]
            for was, now in zip(*stats):
                self.assertEqual(now["time_ns"], was["time_ns"])
                self.assertEqual(now["fields"][0]["lost"], now["step"] == 8)
                if now["step"] not in (4, 8):  # values are made anew, but for their last digit
                    self.assertEqual(now["fields"][0]["maximum"], was["fields"][0]["maximum"])
                    bins = [np.array(x["fields"][0]["histogram"]) for x in (was, now)]
                    self.assertEqual(bins[0].sum(), bins[1].sum())
                    self.assertLess(np.abs(bins[0] - bins[1]).sum(), 0.001 * bins[0].sum())
        again = self.fovea_json("repair", store, "--in-place")
        self.assertEqual((again["lost"], again["rebuilt"]), ([], []))

    def test_repair_is_told_where_to(self):
        self.refused(2, "repair", self.sound, says=["--in-place"])
        self.refused(2, "repair", self.sound, "--in-place", "-o", self.folder / "x.zarr")
        self.refused(1, "repair", self.sound, "-o", self.sound, says=["exists"])
        self.refused(1, "repair", self.folder / "none.zarr", "--in-place", says=["none.zarr"])


if __name__ == "__main__":
    unittest.main()
