"""Parts joined, detail cut down, ingests that were stopped, folders that are watched."""

import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import time
import unittest

import numpy as np
import support


def data_files(store):
    """Every file of a dataset by path, but for the lock."""
    root = pathlib.Path(store)
    return {str(path.relative_to(root)): path.read_bytes()
            for path in root.rglob("*") if path.is_file() and path.name != ".fovea.lock"}


class Life(support.FoveaTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.single = cls.folder / "single.zarr"
        cls.fovea(cls(), "ingest", support.PLUME_SEQUENCE, "-o", cls.single)

    def setUp(self):
        self.room = self.folder / self.id().rsplit(".", 1)[-1]
        self.room.mkdir()

    def ingest(self, name, *flags):
        store = self.room / name
        return store, self.fovea_json("ingest", support.PLUME_SEQUENCE, "-o", store, *flags)


class Parts(Life):
    def plan(self, *flags):
        plan = self.room / "plan.json"
        self.fovea("ingest", support.PLUME_SEQUENCE, "--plan", plan, *flags)
        return plan

    def test_merged_parts_are_the_files_of_a_single_ingest(self):
        plan = self.plan()
        described = json.loads(plan.read_text())
        self.assertEqual(described["steps"], len(support.PLUME_NUMBERS))
        self.assertEqual(len(described["files"]), len(support.PLUME_NUMBERS))
        merged = self.room / "a.zarr"
        for i in (2, 0, 1):
            report = self.fovea_json("ingest", "--from-plan", plan, "--shard", f"{i}/3", "-o", merged)
            self.assertEqual(report["steps"], 5)
            inputs = [support.PLUME / f"plume_{number:04d}.vdb"
                      for number in support.PLUME_NUMBERS[5 * i:5 * i + 5]]
            self.assertEqual(report["input_bytes"], sum(file.stat().st_size for file in inputs))
        part = self.room / "a.part-1-of-3.zarr"
        source = self.fovea_json("info", part)["source"]
        self.assertEqual((source["part"], source["parts"], source["complete"]), (1, 3, True))
        self.assertIn("part 1 of 3", self.fovea("info", part).stdout)
        # Given again, a part is complete already.
        report = self.fovea_json("ingest", "--from-plan", plan, "--shard", "1/3", "-o", merged)
        self.assertEqual((report["steps"], report["steps_before"]), (0, 5))
        report = self.fovea_json("merge", merged, "--remove-parts")
        self.assertEqual((report["steps"], report["parts"], report["parts_removed"]), (15, 3, 3))
        self.assertEqual(sorted(path.name for path in self.room.iterdir()), ["a.zarr", "plan.json"])
        self.assertEqual(data_files(merged), data_files(self.single))
        self.fovea("verify", merged)
        self.assertTrue(self.fovea_json("merge", merged)["was_merged"])

    def test_missing_and_incomplete_parts_are_named(self):
        plan = self.plan()
        merged = self.room / "a.zarr"
        self.fovea("ingest", "--from-plan", plan, "--shard", "0/3", "-o", merged)
        self.refused(1, "merge", merged,
                     says=["a.part-1-of-3.zarr is missing", "a.part-2-of-3.zarr is missing"])
        self.assertFalse(merged.exists())

    def test_parts_of_different_plans_are_refused(self):
        merged = self.room / "a.zarr"
        self.fovea("ingest", "--from-plan", self.plan(), "--shard", "0/2", "-o", merged)
        self.fovea("ingest", "--from-plan", self.plan("--fps", "12"), "--shard", "1/2", "-o", merged)
        self.refused(1, "merge", merged, says=["differ in the series or plan"])

    def test_a_plan_keeps_the_flags_it_was_made_with(self):
        flags = ["--grid", "density", "--wavelet", "cdf53", "--retain", "10,10,10:8"]
        plan = self.plan(*flags)
        merged = self.room / "a.zarr"
        self.fovea("ingest", "--from-plan", plan, "-o", merged)  # all of it
        single, _ = self.ingest("b.zarr", *flags)
        self.assertEqual(data_files(merged), data_files(single))

    def test_what_cannot_be_is_refused(self):
        plan = self.plan()
        out = self.room / "a.zarr"
        self.refused(2, "ingest", "--from-plan", plan, "--shard", "3/3", "-o", out, says=["--shard"])
        self.refused(2, "ingest", "--from-plan", plan, support.PLUME_SEQUENCE, "-o", out,
                     says=["--from-plan", "not with input"])
        self.refused(2, "ingest", "--from-plan", plan, "--fps", "5", "-o", out,
                     says=["not with --fps"])
        self.refused(2, "ingest", support.PLUME_SEQUENCE, "--shard", "0/3", "-o", out,
                     says=["--from-plan"])
        self.refused(2, "ingest", support.PLUME_SEQUENCE, says=["--output"])
        self.refused(1, "ingest", "--from-plan", self.room / "none.json", "-o", out,
                     says=["none.json"])
        plan.write_text(plan.read_text().replace('"steps": 15', '"steps": 16'))
        self.refused(1, "ingest", "--from-plan", plan, "-o", out, says=["was edited"])
        plan.write_text("[")
        self.refused(1, "ingest", "--from-plan", plan, "-o", out, says=["damaged"])
        plan.write_text("{}")
        self.refused(1, "ingest", "--from-plan", plan, "-o", out, says=["is no plan"])
        self.refused(1, "merge", self.room / "b.zarr", says=["there is no part"])


class Retain(Life):
    def test_ingest_copy_and_in_place_agree(self):
        flags = ["--retain", "10,10,10:8", "--retain", "25,12,30:4"]
        ingested, _ = self.ingest("ingested.zarr", *flags)
        copy = self.room / "copy.zarr"
        report = self.fovea_json("retain", self.single, *flags, "-o", copy)
        self.assertGreater(report["chunks_dropped"], 0)
        place = self.room / "place.zarr"
        shutil.copytree(self.single, place)
        self.fovea("retain", place, *flags, "--in-place")
        self.assertEqual(data_files(copy), data_files(ingested))
        self.assertEqual(data_files(place), data_files(ingested))
        self.fovea("verify", place)
        self.assertEqual(len(self.fovea_json("info", place)["retention"]), 2)
        self.assertIn("retained  10,10,10:8", self.fovea("info", place).stdout)

    def test_the_window_is_exact_and_others_are_warned_of(self):
        small = self.room / "small.zarr"
        self.fovea("retain", self.single, "--retain", "12,12,12:8", "-o", small)
        picture = ["--step", "7", "--rate", "8", "--size", "64x64", "--transfer",
                   "0:0,0,0:0;1:1,1,1:1", "--json"]
        inside = ["--fovea", "12,12,12", *picture]
        first = self.fovea("render", self.single, *inside, "-o", self.room / "a.npy")
        second = self.fovea("render", small, *inside, "-o", self.room / "b.npy")
        self.assertEqual(json.loads(second.stdout)["warnings"], [])
        self.assertTrue(np.array_equal(np.load(self.room / "a.npy"), np.load(self.room / "b.npy")))
        outside = self.fovea_json("render", small, "--step", "7", "--rate", "40", "-o",
                                  self.room / "c.png")
        self.assertEqual([w["code"] for w in outside["warnings"]], ["NOT_RETAINED"])
        plan = self.fovea("plan", small, "--rate", "40")
        self.assertIn("retain", plan.stderr)

    def test_what_cannot_be_is_refused(self):
        out = self.room / "a.zarr"
        self.refused(2, "retain", self.single, "-o", out, says=["--retain"])
        self.refused(2, "retain", self.single, "--retain", "1,2,3", "-o", out,
                     says=["'1,2,3' is not X,Y,Z:RATE"])
        self.refused(2, "retain", self.single, "--retain", "1,2,3:4", says=["--in-place"])
        self.refused(1, "retain", self.single, "--retain", "999,2,3:4", "-o", out, says=["999"])
        self.assertFalse(out.exists())


class Resume(Life):
    def setUp(self):
        super().setUp()
        self.raw = self.room / "many.raw"
        with open(self.raw, "wb") as file:
            for i in range(40):
                part = self.room / "one"
                support.write_raw_ball(part, dims=(40, 40, 40), phase=i / 40)
                file.write(part.read_bytes())
        self.command = ["ingest", self.raw, "--raw", "40x40x40x40:uint8"]

    def test_after_kill_9_at_random_moments_the_same_command_goes_on(self):
        whole = self.room / "whole.zarr"
        start = time.monotonic()
        self.fovea(*self.command, "-o", whole)
        seconds = time.monotonic() - start
        store = self.room / "killed.zarr"
        chance = random.Random(5)
        seen = [0]
        for _ in range(12):
            process = subprocess.Popen([support.FOVEA, *map(str, self.command), "-o", str(store)],
                                       stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            try:
                _, errors = process.communicate(timeout=chance.uniform(0.02, 0.6) * seconds)
                self.assertEqual(process.returncode, 0, errors)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
            if (store / "zarr.json").exists():
                seen.append(self.fovea_json("info", store)["committed_steps"])
                self.assertGreaterEqual(seen[-1], seen[-2])
        report = self.fovea_json(*self.command, "-o", store)
        self.assertEqual(report["steps"] + report["steps_before"], 40)
        self.assertEqual(data_files(store), data_files(whole))
        again = self.fovea(*self.command, "-o", store)
        self.assertIn("40 steps were there already", again.stdout)
        self.assertNotIn("0 steps of", again.stdout)

    def test_another_series_is_not_mixed_in(self):
        store = self.room / "a.zarr"
        self.fovea(*self.command, "-o", store)
        self.refused(1, *self.command, "--fps", "5", "-o", store,
                     says=["a.zarr", "is there already", "--append"])
        self.refused(1, *self.command, "--wavelet", "cdf53", "-o", store, says=["wavelet"])
        with open(self.raw, "ab") as file:
            file.write(bytes(40 ** 3))
        self.refused(1, "ingest", self.raw, "--raw", "40x40x40x41:uint8", "-o", store,
                     says=["is there already"])


class OfFormat1(support.FoveaTest):
    """A store that was made before signs were folded (tests/data/README.md)."""

    def voxels(self, step):
        z, y, x = np.meshgrid(np.arange(17), np.arange(20), np.arange(24), indexing="ij")
        far = ((x - 12) ** 2 + (y - 10) ** 2 + (z - 8) ** 2 + 7 * step) // 3
        return (far * (x > 4) % 251).astype(np.uint8)

    def test_is_read_verified_and_appended_to_as_it_is(self):
        store, raw, out = (self.folder / name for name in ("a.zarr", "2.raw", "out.npy"))
        shutil.copytree(support.PLUME.parent / "format1.zarr", store)
        self.voxels(2).tofile(raw)
        self.fovea("ingest", raw, "--raw", "24x20x17:uint8", "--lossless", "--append", "--fps", 1,
                   "-o", store)
        group = json.loads((store / "zarr.json").read_text())["attributes"]["fovea"]
        self.assertEqual(group["format_version"], 1)
        array = json.loads((store / "density/detail_2/zarr.json").read_text())
        self.assertEqual(array["data_type"], "int16")
        self.assertEqual(self.fovea_json("verify", store)["problems"], [])
        for step in range(3):
            self.fovea("extract", store, "--step", step, "-o", out)
            np.testing.assert_array_equal(np.load(out), self.voxels(step))


class Watch(Life):
    def start(self, pattern, store, *flags):
        return subprocess.Popen(
            [support.FOVEA, "ingest", str(pattern), "-o", str(store), "--watch", "--poll-seconds",
             "0.1", "--json", *map(str, flags)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def finish(self, process, status=0):
        output, errors = process.communicate(timeout=60)
        self.assertEqual(process.returncode, status, errors)
        return json.loads(output) if status == 0 else errors

    def wait_for(self, store, steps):
        deadline = time.monotonic() + 30
        while True:
            result = support.run("info", store, "--json")
            if result.returncode == 0 and json.loads(result.stdout)["committed_steps"] >= steps:
                return
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.05)

    def plume(self, number):
        return support.PLUME / f"plume_{number:04d}.vdb"

    def extent_flag(self):
        info = self.fovea_json("ingest", support.PLUME_SEQUENCE, "-o", self.room / "x.zarr")
        low = info["origin"]
        high = [low[0] + info["nx"], low[1] + info["ny"], low[2] + info["nz"]]
        return ["--extent", ",".join(map(str, low + high))]

    def test_files_are_taken_as_they_are_finished(self):
        incoming, store = self.room / "in", self.room / "a.zarr"
        incoming.mkdir()
        numbers = support.PLUME_NUMBERS[:6]
        shutil.copy(self.plume(numbers[0]), incoming)
        process = self.start(incoming / "plume_####.vdb", store, *self.extent_flag())
        self.wait_for(store, 1)
        # One in two halves: it is not taken before it is closed.
        data = self.plume(numbers[1]).read_bytes()
        with open(incoming / self.plume(numbers[1]).name, "wb") as file:
            file.write(data[:len(data) // 2])
            file.flush()
            time.sleep(0.4)
            self.assertEqual(self.fovea_json("info", store)["committed_steps"], 1)
            file.write(data[len(data) // 2:])
        self.wait_for(store, 2)
        # The later one first; it waits for the earlier one, which is moved there.
        shutil.copy(self.plume(numbers[3]), incoming)
        shutil.copy(self.plume(numbers[2]), self.room / "moved")
        os.rename(self.room / "moved", incoming / self.plume(numbers[2]).name)
        self.wait_for(store, 4)
        process.send_signal(signal.SIGINT)
        report = self.finish(process)
        self.assertEqual(report["steps"], 4)
        # It goes on behind the last.
        process = self.start(incoming / "plume_####.vdb", store, "--watch-seconds", "2")
        for number in numbers[4:]:
            shutil.copy(self.plume(number), incoming)
        report = self.finish(process)
        self.assertEqual(report["steps"], 2)
        self.fovea("verify", store)
        for step, number in enumerate(numbers):
            for name, source, at in (("a", store, step), ("b", self.single, step)):
                self.fovea("extract", source, "--step", at, "-o", self.room / f"{name}.npy")
            self.assertTrue(np.array_equal(np.load(self.room / "a.npy"),
                                           np.load(self.room / "b.npy")), number)

    def test_a_file_outside_names_extent(self):
        incoming, store = self.room / "in", self.room / "a.zarr"
        incoming.mkdir()
        for number in support.PLUME_NUMBERS[:4]:
            shutil.copy(self.plume(number), incoming)
        process = self.start(incoming / "plume_####.vdb", store)
        self.assertIn("--extent", self.finish(process, status=1))
        self.assertEqual(self.fovea_json("info", store)["committed_steps"], 1)

    def test_a_bad_file_does_not_keep_back_the_good_ones_before_it(self):
        incoming, store = self.room / "incoming", self.room / "some.zarr"
        incoming.mkdir()
        for number in (1, 5):
            shutil.copy(self.plume(number), incoming)
        whole = pathlib.Path(self.plume(9)).read_bytes()
        (incoming / "plume_0009.vdb").write_bytes(whole[:len(whole) // 3])
        process = self.start(incoming / "plume_####.vdb", store, "--watch-seconds", "1.5",
                             *(["--extent", "-40,-40,-40,80,80,120"]))
        self.assertIn("plume_0009.vdb", self.finish(process, status=1))
        self.assertEqual(self.fovea_json("info", store)["committed_steps"], 2)

    def test_a_file_that_comes_after_its_stand_in_is_left_out_and_said(self):
        incoming, store = self.room / "incoming", self.room / "held.zarr"
        incoming.mkdir()
        for number in (1, 5, 13):
            shutil.copy(self.plume(number), incoming)
        process = self.start(incoming / "plume_####.vdb", store, "--on-missing", "hold",
                             "--gap-seconds", "0.2", "--watch-seconds", "3",
                             *(["--extent", "-40,-40,-40,80,80,120"]))
        self.wait_for(store, 4)
        shutil.copy(self.plume(9), incoming)
        self.assertIn("plume_0009.vdb", str(self.finish(process)["warnings"]))

    def test_a_gap_is_an_error_or_left_out(self):
        for on_missing, steps in (("error", 2), ("skip", 3), ("hold", 4)):
            incoming, store = self.room / on_missing, self.room / f"{on_missing}.zarr"
            incoming.mkdir()
            for number in (1, 5, 13):
                shutil.copy(self.plume(number), incoming)
            process = self.start(incoming / "plume_####.vdb", store, "--on-missing", on_missing,
                                 "--gap-seconds", "0.5", "--watch-seconds", "1.5",
                                 *(["--extent", "-40,-40,-40,80,80,120"]))
            result = self.finish(process, status=1 if on_missing == "error" else 0)
            if on_missing == "error":
                self.assertIn("number 9", result)
            else:
                self.assertEqual((result["steps_held"], result["steps_skipped"]),
                                 (1, 0) if on_missing == "hold" else (0, 1))
                self.assertIn("numbers 9 to 9", str(result["warnings"]))
            self.assertEqual(self.fovea_json("info", store)["committed_steps"], steps)

    def test_what_cannot_be_watched_is_refused(self):
        out = self.room / "a.zarr"
        self.refused(1, "ingest", "none.vdb", "-o", out, "--watch", says=["####"])
        self.refused(1, "ingest", self.room / "none/a_####.vdb", "-o", out, "--watch",
                     says=["no folder"])
        self.refused(2, "ingest", "a_####.vdb", "-o", out, "--watch-seconds", "1", says=["--watch"])
        self.refused(1, "ingest", self.room / "a_####.vdb", "-o", self.single, "--watch",
                     says=["is there already"])


class Extent(Life):
    def test_it_holds_more_or_is_refused(self):
        single = self.fovea_json("info", self.single)
        store, report = self.ingest("a.zarr", "--extent", "-40,-40,-40,80,80,120")
        self.assertEqual((report["nx"], report["ny"], report["nz"]), (120, 120, 160))
        self.assertEqual(report["origin"], [-40, -40, -40])
        self.assertEqual(self.fovea_json("info", store)["fields"], single["fields"])
        self.refused(1, "ingest", support.PLUME_SEQUENCE, "-o", self.room / "b.zarr", "--extent",
                     "0,0,0,4,4,4", says=["--extent", "plume_"])
        self.refused(2, "ingest", support.PLUME_SEQUENCE, "-o", self.room / "b.zarr", "--extent",
                     "0,0,0", says=["--extent"])


if __name__ == "__main__":
    unittest.main()
