"""Bad input: each case ends with the right status and says what, where, and which flag."""

import resource
import shutil
import unittest

import support


class BadInput(support.FoveaTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.store = cls.folder / "plume.zarr"
        cls.fovea(cls(), "ingest", support.PLUME_SEQUENCE, "-o", cls.store)
        cls.out = cls.folder / "out.png"

    def render_refused(self, status, *arguments, says):
        self.refused(status, "render", *arguments, "-o", self.out, says=says)
        self.assertFalse(self.out.exists())

    def ingest_refused(self, *arguments, says):
        store = self.folder / "bad.zarr"
        self.refused(1, "ingest", *arguments, "-o", store, says=says)
        shutil.rmtree(store, ignore_errors=True)

    def test_a_truncated_vdb(self):
        whole = (support.PLUME / "plume_0041.vdb").read_bytes()
        for part in (0.3, 0.9):
            cut = self.folder / "cut.vdb"
            cut.write_bytes(whole[:int(len(whole) * part)])
            self.ingest_refused(cut, says=["cut.vdb"])
            self.render_refused(1, cut, "--cache", self.folder / "cache", says=["cut.vdb"])

    def test_a_text_file_named_vdb(self):
        text = self.folder / "text.vdb"
        text.write_text("this is not a volume\n" * 20)
        self.ingest_refused(text, says=["text.vdb"])
        empty = self.folder / "empty.vdb"
        empty.write_bytes(b"")
        self.ingest_refused(empty, says=["empty.vdb"])

    def test_a_raw_file_of_the_wrong_size(self):
        raw = self.folder / "short.raw"
        raw.write_bytes(bytes(999))
        self.ingest_refused(raw, "--raw", "10x10x10:uint8", says=["short.raw", "999", "1000"])

    def test_a_missing_step_in_the_middle(self):
        sequence = self.folder / "sequence"
        sequence.mkdir()
        for number in support.PLUME_NUMBERS:
            if number != 21:
                shutil.copy(support.PLUME / f"plume_{number:04}.vdb", sequence)
        self.ingest_refused(sequence / "plume_####.vdb", says=["plume_0021.vdb", "--on-missing"])
        for what, steps in (("skip", 14), ("hold", 15)):
            report = self.fovea_json("ingest", sequence / "plume_####.vdb", "--on-missing", what,
                                     "-o", self.folder / f"{what}.zarr")
            self.assertEqual(report["steps"], steps)

    def test_a_flipped_byte_in_the_store(self):
        store = self.folder / "flipped.zarr"
        shutil.copytree(self.store, store)
        shard = max((path for path in store.glob("density/detail_2/c.8.*")),
                    key=lambda path: path.stat().st_size)
        content = bytearray(shard.read_bytes())
        content[len(content) // 3] ^= 0x40
        shard.write_bytes(content)
        self.refused(1, "verify", store, says=["damaged"])
        self.refused(1, "extract", store, "--step", 8, "--strict", "-o", self.folder / "x.npy",
                     says=["density", "8"])
        result = self.fovea("extract", store, "--step", 8, "-o", self.folder / "x.npy")
        self.assertIn("warning: 1 damaged chunk", result.stderr)
        self.refused(1, "render", store, "--step", 8, "--rate", 64, "--strict", "-o", self.out,
                     says=["density"])
        result = self.fovea("render", store, "--step", 8, "--rate", 64, "-o", self.out)
        self.assertIn("warning: 1 damaged chunk", result.stderr)
        self.out.unlink()
        # Damage in the metadata is found when the dataset is opened.
        (store / "zarr.json").write_text("{")
        self.render_refused(1, store, says=["zarr.json"])

    def test_a_full_disk(self):
        def small_files():
            resource.setrlimit(resource.RLIMIT_FSIZE, (8192, 8192))

        for verb, arguments in (
                ("render", [self.store, "-o", self.folder / "big.png"]),
                ("render", [self.store, "-o", self.folder / "big.exr"]),
                ("extract", [self.store, "-o", self.folder / "big.npy"]),
                ("export", [self.store, "-o", self.folder / "big.####.npy"]),
                ("export", [self.store, "-o", self.folder / "big.mp4"])):
            self.refused(1, verb, *arguments, says=["big"], preexec_fn=small_files)
        left = [path.name for path in self.folder.glob("big*") if path.suffix != ".zarr"]
        self.assertEqual(left, [])
        self.assertEqual(list(self.folder.glob(".big*.tmp")), [])

    def test_a_fovea_outside(self):
        self.render_refused(1, self.store, "--fovea", "300,10,10",
                            says=["--fovea", "300, 10, 10", "0 to 36"])
        self.render_refused(1, self.store, "--fovea", "300,10,10w", says=["--fovea", "world 300"])

    def test_numbers_out_of_range(self):
        for flags, says in (
                (["--rate", 0], ["--rate", "rate 0", "1 to 65536"]),
                (["--rate", "nan"], ["--rate", "nan"]),
                (["--size", "100000x100000"], ["--size", "100000", "16384"]),
                (["--size", "0x10"], ["--size", "0"]),
                (["--size", "99999999999999999999x1"], ["--size"]),
                (["--fovea", "nan,0,0"], ["--fovea", "nan"]),
                (["--fovea", "inf,0,0"], ["--fovea", "inf"]),
                (["--view", "0,inf"], ["--view", "inf"]),
                (["--span", 0], ["--span", "0"]),
                (["--span", "1e999"], ["--span"]),
                (["--transfer", "0:0,0,0:2"], ["--transfer", "2"]),
                (["--transfer", "1:0,0,0:0;0:0,0,0:0"], ["--transfer"]),
                (["--transfer", "nan:0,0,0:0"], ["--transfer"]),
                (["--weighting", "falloff:-1"], ["--weighting", "-1"]),
                (["--lighting", "0.5,0.5,-1"], ["--lighting", "specular -1"]),
                (["--clip-box", "0,0,0,9,9,0"], ["--clip-box", "its z runs from 0 to 0"]),
                (["--clip-plane", "0,0,0,1"], ["--clip-plane", "normal"]),
                (["--clip-plane", "1,0,0,1"] * 7, ["--clip-plane", "7 of them", "at most 6"]),
                (["--color-transfer", "0:0,0,0:0"], ["--color-transfer", "color_field"]),
                (["--step", -1], ["--step"]),
                (["--threads", 100000], ["--threads"])):
            self.render_refused(2, self.store, *flags, says=says)

    def test_what_is_not_there(self):
        self.render_refused(1, self.store, "--step", 15, says=["--step", "15"])
        self.refused(1, "export", self.store, "--steps", "3-99", "-o", self.folder / "n.####.png",
                     says=["--steps", "99", "0 to 14"])
        self.refused(1, "extract", self.store, "--step", 99, "-o", self.folder / "n.npy",
                     says=["99"])
        self.render_refused(1, self.store, "--field", "heat", says=["--field", "heat", "density"])
        self.render_refused(1, self.store, "--transfer", self.folder / "none.json",
                            says=["none.json"])
        self.render_refused(1, self.folder / "none.zarr", says=["none.zarr"])
        self.refused(1, "extract", self.store, "--box", "0,0,0,1,1,999", "-o",
                     self.folder / "n.npy", says=["--box"])
        plain = self.folder / "plain.zarr"
        plain.mkdir()
        self.render_refused(1, plain, says=["plain.zarr"])

    def test_outputs_that_cannot_be(self):
        file = self.folder / "file"
        file.write_text("x")
        self.refused(1, "render", self.store, "-o", file / "f.png", says=["file"])
        self.refused(1, "render", self.store, "-o", file / "f.exr", says=["file"])
        self.refused(1, "ingest", support.PLUME_SEQUENCE.replace("####", "0005"), "-o", self.store,
                     says=["plume.zarr"])
        precious = self.folder / "f.0001.png"
        precious.write_text("precious")
        self.refused(1, "export", self.store, "-o", self.folder / "f.####.png",
                     says=["f.0001.png", "--overwrite"])
        self.assertEqual(precious.read_text(), "precious")


if __name__ == "__main__":
    unittest.main()
