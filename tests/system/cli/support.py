"""What the tests of the command line share: running `fovea`, and looking at what it made."""

import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

import numpy as np

FOVEA = os.environ["FOVEA_BIN"]
PLUME = pathlib.Path(os.environ["FOVEA_SOURCE_DIR"]) / "tests" / "data" / "plume"
PLUME_SEQUENCE = str(PLUME / "plume_####.vdb")
PLUME_NUMBERS = list(range(1, 58, 4))


def run(*arguments, **options):
    """The finished process; never raises, never waits more than a minute."""
    return subprocess.run([FOVEA, *map(str, arguments)], capture_output=True, text=True,
                          timeout=60, **options)


class FoveaTest(unittest.TestCase):
    """Each test class has a folder; `self.folder`."""

    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="fovea-system-"))

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder, ignore_errors=True)

    def fovea(self, *arguments, **options):
        """Runs to success; the process."""
        result = run(*arguments, **options)
        self.assertEqual(result.returncode, 0, f"{arguments}: {result.stderr}")
        return result

    def fovea_json(self, *arguments):
        return json.loads(self.fovea(*arguments, "--json").stdout)

    def refused(self, status, *arguments, says=(), **options):
        """Fails with this status and one message that says all this; the message."""
        result = run(*arguments, **options)
        self.assertEqual(result.returncode, status, f"{arguments}: {result.stderr}")
        self.assertIn("fovea: ", result.stderr)
        for text in says:
            self.assertIn(text, result.stderr)
        return result.stderr


def pixels_of(picture, width, height):
    """R, G, B bytes of a picture file, decoded by ffmpeg."""
    result = subprocess.run(["ffmpeg", "-v", "error", "-i", str(picture), "-f", "rawvideo",
                             "-pix_fmt", "rgb24", "-"], capture_output=True, check=True, timeout=60)
    return np.frombuffer(result.stdout, np.uint8).reshape(height, width, 3)


def probe(movie, entries):
    """What ffprobe says of the first video stream, its frames counted."""
    result = subprocess.run(["ffprobe", "-v", "error", "-count_frames", "-select_streams", "v:0",
                             "-show_entries", f"stream={entries}", "-of", "csv=p=0", str(movie)],
                            capture_output=True, text=True, check=True, timeout=60)
    return result.stdout.strip()


def srgb_bytes(linear):
    """8-bit sRGB of linear values, as INTERFACES says: floor(255 x + 1/2)."""
    clamped = np.clip(linear.astype(np.float64), 0, 1)
    encoded = np.where(clamped <= 0.0031308, 12.92 * clamped,
                       1.055 * clamped ** (1 / 2.4) - 0.055)
    return np.floor(255 * encoded + 0.5).astype(np.uint8)


def write_raw_ball(path, dims=(24, 20, 18), phase=0.0, dtype=np.uint8):
    """A soft ball in an otherwise empty raw volume; its voxels, (z, y, x)."""
    nx, ny, nz = dims
    z, y, x = np.mgrid[0:nz, 0:ny, 0:nx] + 0.5
    far = np.sqrt((x - nx / 2 - 4 * phase) ** 2 + (y - ny / 2) ** 2 + (z - nz / 2) ** 2)
    voxels = np.clip(200 * (1 - far / 8), 0, 255).astype(dtype)
    voxels.tofile(path)
    return voxels
