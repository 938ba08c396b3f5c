"""A reader in another language, written from the format's page, draws the pictures of `fovea`."""

import pathlib
import sys
import unittest

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "cli"))
import foveated_frame
import support

EXACT = {
    "as it comes": [],
    "oblique": ["--view", "213,-27", "--smoothing", "image"],
    "from above, splines": ["--view", "10,80", "--basis", "bspline"],
    "unsmoothed": ["--view", "-40,25", "--smoothing", "none"],
    "zoomed": ["--view", "30,20", "--span", 14],
    "marked, on a colour": ["--view", "30,20", "--fovea-marker", "--background", "0.2,0.5,0.9"],
    "everything": ["--rate", 64],
}
PERSPECTIVE = {
    "outside": ["--eye", "-30,12,60", "--fov", 50],
    "inside": ["--eye", "18,17,20", "--target", "18,20,50", "--fov", 90],
    "unsmoothed": ["--eye", "-30,12,60", "--fov", 50, "--smoothing", "none"],
    "splines": ["--eye", "60,60,10", "--fov", 40, "--basis", "bspline"],
}


class FoveatedFrame(support.FoveaTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.store = cls.folder / "plume.zarr"
        cls.fovea(cls(), "ingest", support.PLUME_SEQUENCE, "--grid", "density", "-o", cls.store)

    def both(self, flags):
        """The picture by the reader, and by `fovea`: R, G, B."""
        common = ["render", self.store, "--step", 10, "--rate", 8, "--size", "83x61", *flags, "-o"]
        if "--rate" in flags:
            common[4:6] = []
        self.fovea(*common, self.folder / "f.fvf")
        self.fovea(*common, self.folder / "f.png")
        data = (self.folder / "f.fvf").read_bytes()
        return (foveated_frame.expand(data)[..., :3],
                support.pixels_of(self.folder / "f.png", 83, 61))

    def test_orthographic_pictures_are_the_same_byte_for_byte(self):
        for name, flags in EXACT.items():
            with self.subTest(name):
                read, expected = self.both(flags)
                self.assertGreater(expected.max(), 50)
                self.assertEqual(np.count_nonzero(read != expected), 0)

    def test_perspective_pictures_differ_by_one_at_most(self):
        for name, flags in PERSPECTIVE.items():
            with self.subTest(name):
                read, expected = self.both(flags)
                self.assertGreater(expected.max(), 50)
                difference = np.abs(read.astype(int) - expected)
                self.assertLessEqual(difference.max(), 1)
                self.assertLess(np.count_nonzero(difference), 0.002 * difference.size)

    def test_expand_gives_the_picture_that_render_gives(self):
        frame, picture, again = (self.folder / name for name in ("g.fvf", "g.png", "h.png"))
        common = ["render", self.store, "--step", 9, "--view", "20,40", "--fovea-marker", "-o"]
        self.fovea(*common, frame)
        self.fovea(*common, picture)
        self.fovea("expand", frame, "-o", again)
        self.assertEqual(picture.read_bytes(), again.read_bytes())
        told = self.fovea_json("expand", frame, "-o", self.folder / "h.npy")
        self.assertEqual(told["frame_bytes"], frame.stat().st_size)
        self.assertLess(told["frame_bytes"], picture.stat().st_size)
        floats = np.load(self.folder / "h.npy")
        self.assertEqual(floats.shape, (told["height_px"], told["width_px"], 4))

    def test_expand_refuses_what_is_no_frame(self):
        self.refused(1, "expand", support.PLUME / "plume_0001.vdb", "-o", self.folder / "x.png",
                     says=["plume_0001.vdb", "FOVEATED"])
        self.refused(2, "expand", "nothing.fvf", "-o", self.folder / "x.png", says=["nothing.fvf"])


if __name__ == "__main__":
    unittest.main()
