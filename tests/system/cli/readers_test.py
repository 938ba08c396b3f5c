"""Files of every dense format, made here byte by byte, through the front door and back."""

import gzip
import os
import pathlib
import struct
import subprocess
import unittest
import zlib

import numpy as np

import support

DIMS = (5, 4, 3)  # x, y, z


def values(dtype, steps=1):
    """Different everywhere; (step, z, y, x)."""
    nx, ny, nz = DIMS
    return (np.arange(steps * nz * ny * nx) * 3 % 120).reshape(steps, nz, ny, nx).astype(dtype)


def nifti(voxels, pixdim=(1, 1, 1, 1, 1), slope=0, inter=0, sform=None, toffset=0.0, units=0,
          order="<", magic=b"n+1\0", offset=352):
    """A NIfTI-1 header, and for n+1 the voxels (t, z, y, x)."""
    codes = {"u1": 2, "i2": 4, "i4": 8, "f4": 16, "f8": 64, "i1": 256, "u2": 512}
    code = codes[voxels.dtype.str[1:]]
    steps, nz, ny, nx = voxels.shape
    header = bytearray(348)
    struct.pack_into(order + "i", header, 0, 348)
    struct.pack_into(order + "8h", header, 40, 4, nx, ny, nz, steps, 1, 1, 1)
    struct.pack_into(order + "2h", header, 70, code, 8 * voxels.itemsize)
    struct.pack_into(order + "8f", header, 76, *pixdim, 0, 0, 0)
    struct.pack_into(order + "3f", header, 108, offset, slope, inter)
    struct.pack_into("B", header, 123, units)
    struct.pack_into(order + "f", header, 136, toffset)
    if sform is not None:
        struct.pack_into(order + "h", header, 254, 1)
        struct.pack_into(order + "12f", header, 280, *np.asarray(sform).ravel())
    header[344:348] = magic
    data = voxels.astype(voxels.dtype.newbyteorder(order)).tobytes()
    return bytes(header) + (bytes(offset - 348) + data if magic == b"n+1\0" else b"")


def tiff(pages, description=None, resolution=None):
    """A little-endian TIFF of grey 8- or 16-bit or float pages, one strip each."""
    out = bytearray(b"II*\0\0\0\0\0")
    link = 4
    for page in pages:
        height, width = page.shape
        texts = bytearray()
        data = len(out)
        out += page.tobytes()
        if len(out) % 2:
            out += b"\0"
        entries = [(256, 3, 1, width), (257, 3, 1, height), (258, 3, 1, 8 * page.itemsize),
                   (259, 3, 1, 1), (262, 3, 1, 1), (273, 4, 1, data), (277, 3, 1, 1),
                   (278, 3, 1, height), (279, 4, 1, page.nbytes),
                   (339, 3, 1, 3 if page.dtype.kind == "f" else 1)]
        if description:
            entries.append((270, 2, len(description) + 1, len(out)))
            texts += description.encode() + b"\0"
            texts += b"\0" * (len(texts) % 2)
        if resolution:
            entries.append((282, 5, 1, len(out) + len(texts)))
            entries.append((283, 5, 1, len(out) + len(texts)))
            texts += struct.pack("<2I", *resolution)
        out += texts
        struct.pack_into("<I", out, link, len(out))
        out += struct.pack("<H", len(entries))
        for tag, kind, count, value in sorted(entries):
            out += struct.pack("<2HI", tag, kind, count)
            out += struct.pack("<2H", value, 0) if kind == 3 else struct.pack("<I", value)
        link = len(out)
        out += struct.pack("<I", 0)
    return bytes(out)


class Readers(support.FoveaTest):
    def setUp(self):
        self.out = self.folder / self.id()
        self.out.mkdir()
        self.count = 0

    def write(self, name, data):
        path = self.out / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
        return path

    def ingest(self, *inputs):
        """The dataset's info, and all of its voxels (step, z, y, x)."""
        self.count += 1
        store = self.out / f"{self.count}.zarr"
        self.report = self.fovea_json("ingest", *inputs, "-o", store)
        info = self.fovea_json("info", store)
        steps = []
        for step in range(info["committed_steps"]):
            self.fovea("extract", store, "--step", step, "-o", self.out / "x.npy")
            steps.append(np.load(self.out / "x.npy"))
        return info, np.array(steps)

    def check(self, voxels, expected):
        np.testing.assert_allclose(voxels, np.asarray(expected, np.float64), rtol=0,
                                   atol=4 * 2.0 ** -23 * max(1, np.abs(expected).max()))

    def fails(self, *arguments, says):
        self.refused(1, "ingest", *arguments, "-o", self.out / "no.zarr", says=says)
        self.assertFalse((self.out / "no.zarr").exists())

    def matrix(self, info):
        return np.array(info["index_to_world"]).reshape(4, 4)

    # NumPy

    def test_npy_of_every_type_and_order(self):
        for dtype in ("u1", "i1", "?", "<u2", ">u2", "<i2", ">i2", "<u4", ">i4", "<u8", ">i8",
                      "<f2", ">f4", "<f8", ">f8"):
            for order in (np.ascontiguousarray, np.asfortranarray):
                voxels = order(values(dtype)[0])
                np.save(self.out / "a.npy", voxels)
                self.check(self.ingest(self.out / "a.npy")[1][0], voxels)

    def test_npy_steps_axes_and_channels(self):
        voxels = values("i2", 3)
        np.save(self.out / "t.npy", voxels)
        self.check(self.ingest(self.out / "t.npy")[1], voxels)
        np.save(self.out / "x.npy", np.ascontiguousarray(voxels.transpose(3, 0, 2, 1)))
        self.check(self.ingest(self.out / "x.npy", "--axes", "xtyz")[1],
                   voxels)
        np.save(self.out / "c.npy", np.stack([voxels, voxels + 1], axis=-1))
        self.check(self.ingest(self.out / "c.npy", "--axes", "tzyxc", "--channel", 1)[1],
                   voxels + 1)
        self.fails(self.out / "c.npy", "--axes", "tzyxc", says=["c.npy", "--channel 0 to 1"])
        self.fails(self.out / "c.npy", says=["5 axes", "--axes"])

    def test_npy_is_lossless_where_it_is_integer(self):
        voxels = values("i2", 2) * 250
        np.save(self.out / "a.npy", voxels)
        info, back = self.ingest(self.out / "a.npy", "--lossless")
        self.assertEqual(info["fields"][0]["type"], "int32")
        np.testing.assert_array_equal(back, voxels)

    # NRRD

    HEADER = ("NRRD0004\n# a comment\ntype: short\ndimension: 3\nsizes: 5 4 3\nendian: {endian}\n"
              "encoding: {encoding}\nkey:=value\n{more}")

    def test_nrrd_encodings_and_places(self):
        voxels = values("<i2")
        data = voxels.tobytes()
        for endian, encoding, more, body in (
                ("little", "raw", "\n", data),
                ("big", "raw", "\n", voxels.astype(">i2").tobytes()),
                ("little", "gzip", "\n", gzip.compress(data)),
                ("little", "gzip", "\n", gzip.compress(data[:50]) + gzip.compress(data[50:])),
                ("little", "gz", "\n", zlib.compress(data)),
                ("little", "raw", "byte skip: -1\n\n", b"anything" + data)):
            path = self.write("a.nrrd", self.HEADER.format(
                endian=endian, encoding=encoding, more=more).encode() + body)
            self.check(self.ingest(path)[1], voxels)
        self.write("d/b.dat", b"line\nabc" + data)
        path = self.write("b.nhdr", self.HEADER.format(
            endian="little", encoding="raw",
            more="line skip: 1\nbyte skip: 3\ndata file: d/b.dat\n").encode())
        self.check(self.ingest(path)[1], voxels)
        slices = [voxels[0, i].tobytes() for i in range(3)]
        for i, piece in enumerate(slices):
            self.write(f"s{i:02}.raw", piece)
        for more in ("data file: LIST 2\ns00.raw\ns01.raw\ns02.raw\n",
                     "data file: s%02d.raw 0 2 1\n"):
            path = self.write("l.nhdr", self.HEADER.format(
                endian="little", encoding="raw", more=more).encode())
            self.check(self.ingest(path)[1], voxels)

    def test_nrrd_space_time_and_units(self):
        voxels = values("u1", 2)
        text = ("NRRD0005\ntype: uchar\ndimension: 4\nspace: left-posterior-superior\n"
                "sizes: 5 4 3 2\nspace directions: (0,2,0) (-1,0,0) (0,0,4) none\n"
                "space origin: (10,20,30)\nkinds: domain domain domain time\n"
                "spacings: nan nan nan 500\nunits: \"\" \"\" \"\" \"ms\"\n"
                "space units: \"mm\" \"mm\" \"mm\"\nsample units: \"K\"\nencoding: raw\n\n")
        info, back = self.ingest(self.write("a.nrrd", text.encode() + voxels.tobytes()))
        self.check(back, voxels)
        expected = np.array([[0, -1, 0, 10], [2, 0, 0, 20], [0, 0, 4, 30], [0, 0, 0, 1.0]])
        expected[:3, 3] -= expected[:3, :3] @ [0.5, 0.5, 0.5]
        np.testing.assert_allclose(self.matrix(info), expected)
        self.assertEqual(info["world_unit"], "mm")
        self.assertEqual(info["fields"][0]["value_unit"], "K")
        self.assertEqual(info["last_time_ns"], 500_000_000)
        # The list is the fastest axis, as some programs write series.
        fast = np.ascontiguousarray(voxels.transpose(1, 2, 3, 0))
        text = ("NRRD0004\ntype: uint8\ndimension: 4\nsizes: 2 5 4 3\n"
                "kinds: list domain domain domain\nencoding: raw\n\n")
        self.check(self.ingest(self.write("f.nrrd", text.encode() + fast.tobytes()))[1], voxels)

    def test_nrrd_errors(self):
        good = self.HEADER.format(endian="little", encoding="raw", more="\n")
        data = values("<i2").tobytes()
        for text, body, says in (
                (good, data[:-1], "its header asks for"),
                (good.replace("5 4 3", "50000 40000 30000"), data, "cut short"),
                (good.replace("5 4 3", "99999999999999999999 4 3"), data, "is not a number"),
                (good.replace("5 4 3", "70000 4 3"), data, "1 to 65536"),
                (good.replace("5 4 3", "5 4"), data, "dimension 3 with 2 sizes"),
                (good.replace("raw", "hex"), data, "only raw and gzip"),
                (good.replace("short", "block"), data, "only integers and floats"),
                (good.replace("little", "odd"), data, "endian"),
                (good[:-1], b"", "cut short"),
                (good.replace("raw", "gzip").replace("5 4 3", "65536 65536 3"),
                 gzip.compress(data), "compressed bytes cannot"),
                (good.replace("raw", "gzip"), gzip.compress(data)[:-20], "cut short"),
                (good.replace("raw", "gzip"), gzip.compress(data[:60]), "fewer voxels"),
                (good.replace("raw", "gzip"), gzip.compress(data)[:-8] + b"01234567", "damaged")):
            self.fails(self.write("bad.nrrd", text.encode() + body), says=["bad.nrrd", says])

    def test_detached_data_stay_beside_their_header(self):
        self.write("a.raw", values("<i2").tobytes())
        for name, says in (("/etc/passwd", "beside the header"), ("../a.raw", "beside the header"),
                           ("d/../../a.raw", "beside the header"), ("none.raw", "is not there")):
            path = self.write("h.nhdr", self.HEADER.format(
                endian="little", encoding="raw", more=f"data file: {name}\n").encode())
            self.fails(path, says=["h.nhdr", says])
            path = self.write("h.mhd", (
                f"NDims = 3\nDimSize = 5 4 3\nElementType = MET_SHORT\n"
                f"ElementDataFile = {name}\n").encode())
            self.fails(path, says=["h.mhd", says])

    # MetaImage

    def test_metaimage(self):
        voxels = values(">i2", 2)
        text = ("ObjectType = Image\nNDims = 4\nDimSize = 5 4 3 2\nElementType = MET_SHORT\n"
                "BinaryData = True\nBinaryDataByteOrderMSB = True\nCompressedData = {packed}\n"
                "TransformMatrix = 0 1 0 0  1 0 0 0  0 0 -1 0  0 0 0 1\nOffset = 1 2 3 0\n"
                "ElementSpacing = 2 4 8 0.25\nElementDataFile = {file}\n")
        expected = np.array([[0, 4, 0, 1], [2, 0, 0, 2], [0, 0, -8, 3], [0, 0, 0, 1.0]])
        expected[:3, 3] -= expected[:3, :3] @ [0.5, 0.5, 0.5]
        packed = zlib.compress(voxels.tobytes())
        self.write("m.zraw", packed)
        self.write("m.raw", voxels.tobytes())
        for name, file, compressed, body in (("a.mha", "LOCAL", "False", voxels.tobytes()),
                                             ("b.mha", "LOCAL", "True", packed),
                                             ("c.mhd", "m.zraw", "True", b""),
                                             ("d.mhd", "m.raw", "False", b"")):
            path = self.write(name, text.format(packed=compressed, file=file).encode() + body)
            info, back = self.ingest(path)
            self.check(back, voxels)
            np.testing.assert_allclose(self.matrix(info), expected)
            self.assertEqual(info["last_time_ns"], 250_000_000)
        self.fails(self.write("e.mha", text.format(packed="False", file="LOCAL").encode() + b"x"),
                   says=["e.mha", "its header asks for"])
        self.fails(self.write("f.mha", b"NDims = 3\nDimSize = 5 4 3\n"),
                   says=["f.mha", "no ElementDataFile"])

    # NIfTI

    def test_nifti(self):
        sform = [[0, -2, 0, 7], [3, 0, 0, 8], [0, 0, 4, 9]]
        expected = np.vstack([sform, [0, 0, 0, 1.0]])
        expected[:3, 3] -= expected[:3, :3] @ [0.5, 0.5, 0.5]
        for dtype in ("u1", "i2", "f4", "f8"):
            voxels = values(dtype, 3)
            for order in "<>":
                data = nifti(voxels, (1, 1, 1, 1, 1500), sform=sform, units=2 | 16, toffset=500,
                             order=order)
                for name, body in (("a.nii", data), ("a.nii.gz", gzip.compress(data))):
                    info, back = self.ingest(self.write(name, body))
                    self.check(back, voxels)
                    np.testing.assert_allclose(self.matrix(info), expected, atol=1e-6)
                    self.assertEqual(info["world_unit"], "mm")
                    self.assertEqual(info["first_time_ns"], 500_000_000)
                    self.assertEqual(info["last_time_ns"], 3_500_000_000)

    def test_nifti_slope_pairs_and_errors(self):
        voxels = values("i2", 1)
        info, back = self.ingest(self.write("s.nii", nifti(voxels, (1, 2, 3, 4, 0), slope=0.5,
                                                           inter=-10)))
        self.check(back, voxels * 0.5 - 10)
        np.testing.assert_allclose(np.diag(self.matrix(info)), [2, 3, 4, 1])
        self.write("p.img", voxels.tobytes())
        header = nifti(voxels, magic=b"ni1\0", offset=0)
        self.check(self.ingest(self.write("p.hdr", header))[1], voxels)
        self.fails(self.out / "p.img", says=["p.img", "'p.hdr'"])
        whole = nifti(voxels)
        self.fails(self.write("b.nii", whole[:-1]), says=["b.nii", "its header asks for"])
        self.fails(self.write("b.nii", whole[:200]), says=["b.nii", "cut short"])
        self.fails(self.write("b.nii.gz", gzip.compress(whole)[:-30]), says=["b.nii.gz"])
        huge = bytearray(whole)
        struct.pack_into("<8h", huge, 40, 4, 30000, 30000, 30000, 1, 1, 1, 1)
        self.fails(self.write("h.nii", bytes(huge)), says=["h.nii", "cut short"])
        self.fails(self.write("h.nii.gz", gzip.compress(bytes(huge))),
                   says=["h.nii.gz", "compressed bytes cannot"])

    # Slices

    def test_slices_by_pattern_folder_and_page(self):
        for dtype in ("u1", "<u2", "<f4"):
            voxels = values(dtype)[0]
            for i, page in enumerate(voxels):
                self.write(f"p{dtype[-2:]}/s{i + 9}.tif", tiff([page]))
            folder = self.out / f"p{dtype[-2:]}"
            for inputs in ([folder], [f"{folder}/"], [folder / "s#.tif"], [f"{folder}/s*.tif"],
                           sorted(folder.iterdir(), key=lambda p: int(p.stem[1:]))):
                self.check(self.ingest(*inputs)[1], [voxels])
            self.check(self.ingest(self.write("m.tif", tiff(voxels)))[1], [voxels])

    def test_series_of_slices(self):
        voxels = values("u1", 4)
        for step in range(4):
            self.write(f"m{step}.tif", tiff(voxels[step]))
            for i, page in enumerate(voxels[step]):
                self.write(f"f{step}/s{i}.tif", tiff([page]))
                self.write(f"run/s{3 * step + i:03}.tif", tiff([page]))
        self.check(self.ingest(self.out / "m#.tif")[1], voxels)
        self.check(self.ingest(*(self.out / f"f{i}" for i in range(4)))[1], voxels)
        self.check(self.ingest(self.out / "run", "--slices", 3)[1], voxels)
        _, back = self.ingest(self.out / "run" / "s###.tif", "--slices", 3, "--times", "0,1,5,9")
        self.check(back, voxels)
        self.fails(self.out / "run", "--slices", 5, says=["--slices 5"])
        (self.out / "run" / "s004.tif").unlink()
        self.fails(self.out / "run" / "s###.tif", says=["s004.tif"])
        self.fails(self.out / "run", self.out / "m0.tif", says=["a folder"])

    def test_slices_that_do_not_fit(self):
        self.write("a/1.tif", tiff([np.zeros((4, 5), np.uint8)]))
        self.write("a/2.tif", tiff([np.zeros((4, 6), np.uint8)]))
        self.fails(self.out / "a", says=["2.tif", "has 6 x 4 pixels"])
        self.write("b/1.tif", tiff([np.zeros((4, 5), np.uint8)]))
        self.write("b/2.tif", tiff([np.zeros((4, 5), np.uint16)]))
        self.fails(self.out / "b", says=["2.tif", "of one kind"])
        self.fails(self.write("c.tif", b"II*\0garbage and more"), says=["c.tif", "OpenImageIO"])
        self.fails(self.write("d.png", b"\x89PNG\r\n\x1a\n" + bytes(50)), says=["d.png"])
        (self.out / "e").mkdir()
        self.fails(self.out / "e", says=["is a folder without pictures"])
        self.fails(self.out / "a" / "1.tif", "--raw", "5x4x1:uint8", says=["--raw is for"])

    def test_imagej_spacing_and_colours(self):
        voxels = values("u1")[0]
        path = self.write("j.tif", tiff(
            voxels, "ImageJ=1.53\nimages=3\nslices=3\nunit=um\nspacing=2.5\n", (4, 1)))
        blank = self.write("blank.tif", tiff(voxels, "ImageJ=1.54f\nunit= \n", (1, 1)))
        self.assertEqual(self.ingest(blank)[0]["world_unit"], "")
        info, back = self.ingest(path)
        self.check(back, [voxels])
        np.testing.assert_allclose(np.diag(self.matrix(info)), [0.25, 0.25, 2.5, 1])
        self.assertEqual(info["world_unit"], "um")
        info, _ = self.ingest(path, "--spacing", "1,2,3")
        np.testing.assert_allclose(np.diag(self.matrix(info)), [1, 2, 3, 1])
        self.assertEqual(self.matrix(info)[0, 3], 0)
        rgb = np.zeros((4, 5, 3), np.uint8)
        rgb[..., 0], rgb[..., 1], rgb[..., 2] = voxels[0], voxels[1], voxels[2]
        self.write("c.ppm", b"P6\n5 4\n255\n" + rgb.tobytes())
        subprocess.run(["ffmpeg", "-v", "error", "-y", "-i", self.out / "c.ppm",
                        self.out / "c.png"], check=True, timeout=60)
        _, back = self.ingest(self.out / "c.png")
        self.assertIn("luminance", " ".join(self.report["warnings"]))
        self.check(back[0, 0], rgb @ [0.2126, 0.7152, 0.0722])
        for channel, index in (("G", 1), (2, 2)):
            self.check(self.ingest(self.out / "c.png", "--channel", channel)[1][0, 0],
                       rgb[..., index])
        self.fails(self.out / "c.png", "--channel", "Z", says=["no channel 'Z'"])

    # All

    def test_times_from_a_file_and_pictures_of_foreign_files(self):
        voxels = values("u1", 3)
        np.save(self.out / "a.npy", voxels)
        times = self.write("times.txt", b"0.5\n1.5\n\n4\n")
        info, _ = self.ingest(self.out / "a.npy", "--times", times)
        self.assertEqual((info["first_time_ns"], info["last_time_ns"]),
                         (500_000_000, 4_000_000_000))
        self.fails(self.out / "a.npy", "--times", "1,2", says=["2 times for 3 steps"])
        path = self.write("b.nii", nifti(voxels, (1, 1, 1, 1, 2)))
        info, _ = self.ingest(path, "--fps", 10)
        self.assertEqual(info["last_time_ns"], 200_000_000)
        self.fovea("render", path, "--step", 2, "--size", "32x32", "--cache", self.out / "cache",
                   "-o", self.out / "p.png")
        self.assertEqual(support.pixels_of(self.out / "p.png", 32, 32).shape, (32, 32, 3))

    @unittest.skipUnless("FOVEA_TEST_DATA" in os.environ, "the real volumes are not here: FOVEA_TEST_DATA is not set")
    def test_real_volumes(self):
        data = pathlib.Path(os.environ["FOVEA_TEST_DATA"])
        raw = {"tooth_ct_103x94x161_u16be": (">u2", "tooth.nhdr"),
               "colin27_mri_181x217x181_u8": ("u1", "colin27_mri.nii.gz")}
        for name, (dtype, other) in raw.items():
            _, a = self.ingest(data / "volumes" / f"{name}.raw", "--lossless")
            _, b = self.ingest(data / "volumes" / other, "--lossless")
            np.testing.assert_array_equal(a, b)
            np.testing.assert_array_equal(
                a.ravel(), np.fromfile(data / "volumes" / f"{name}.raw", dtype))
        _, steps = self.ingest(data / "fourd" / "fmri_fsl_64x64x21_t64.nii.gz")
        frames = [np.fromfile(data / "fourd" / "fmri_raw_i16" / f"t{i:03}.raw", "<i2")
                  for i in range(64)]
        np.testing.assert_array_equal(steps.reshape(64, -1), frames)
        _, slices = self.ingest(data / "slices" / "c_elegans_em_tiff")
        _, again = self.ingest(data / "slices" / "c_elegans_em_tiff" / "c_elegans_em_z####.tif")
        np.testing.assert_array_equal(slices, again)
        self.assertEqual(slices.shape, (1, 21, 256, 256))
        info, _ = self.ingest(data / "slices" / "mri_head_multipage.tif")
        self.assertEqual((info["nx"], info["ny"], info["nz"]), (186, 226, 27))

    def test_what_is_no_known_file(self):
        self.fails(self.write("a.xyz", b"what is this"), says=["a.xyz", "NIfTI", "--raw"])


if __name__ == "__main__":
    unittest.main()
