"""`fovea plan`: what it says a frame costs is what the frame then costs."""

import unittest

import numpy as np

import support


class Plan(support.FoveaTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        raw = cls.folder / "noise.raw"
        rng = np.random.default_rng(3)
        voxels = rng.integers(0, 256, (90, 75, 110)).astype(np.uint8)
        voxels[:, :, 40:60] = 0  # chunks that are not stored lie between those that are
        voxels.tofile(raw)
        cls.store = cls.folder / "noise.zarr"
        cls.fovea(cls(), "ingest", raw, "--raw", "110x75x90:uint8", "--chunk", 8, "-o", cls.store)

    def plan(self, *flags):
        return self.fovea_json("plan", self.store, *flags)

    def test_counts_are_those_of_the_frame(self):
        for flags in (["--rate", 9], ["--rate", 25, "--fovea", "3,70,45", "--view", "40,20"],
                      ["--rate", "30,12,20", "--window", "sphere", "--view", "0,80"],
                      ["--rate", 110, "--window", "smooth"]):
            plan = self.plan(*flags)
            frame = self.fovea_json("render", self.store, *flags, "-o", self.folder / "f.png")
            for count in ("coefficients", "super_voxels", "samples", "chunks_read", "chunks_total",
                          "bytes_read"):
                self.assertEqual(plan[count], frame["stats"][count], (flags, count))
            self.assertEqual(plan["flags"], frame["flags"])
            self.assertGreater(plan["total_ms"], 0)
            self.assertGreater(plan["memory_bytes"], 4 * plan["super_voxels"])

    def test_a_budget_gives_the_largest_rate(self):
        fields = {"--budget-coefficients": ("coefficients", 50_000),
                  "--budget-memory": ("memory_bytes", 9 << 20),
                  "--budget-bytes": ("bytes_read", 200_000),
                  "--budget-ms": ("total_ms", 12)}
        rates = {}
        for flag, (key, limit) in fields.items():
            plan = self.plan(flag, limit)
            rate = plan["used"]["rate"]
            rates[flag] = rate
            self.assertLessEqual(plan[key], limit)
            self.assertEqual(self.plan("--rate", rate)[key], plan[key])
            self.assertTrue(1 < rate < 110, (flag, rate))
            self.assertGreater(self.plan("--rate", rate + 1)[key], limit)
        both = self.plan(*[text for flag, (_, limit) in fields.items() for text in (flag, limit)])
        self.assertEqual(both["used"]["rate"], min(rates.values()))
        self.assertEqual(self.plan("--budget-memory", "9MiB")["used"]["rate"],
                         rates["--budget-memory"])

    def test_the_ends_of_the_range(self):
        self.assertEqual(self.plan("--budget-coefficients", 10 ** 9)["used"]["rate"], 110)
        self.refused(1, "plan", self.store, "--budget-coefficients", 100,
                     says=["rate 1 already takes", "above 100"])
        self.refused(2, "plan", self.store, "--budget-ms", 16, "--rate", 3, says=["--rate", "budget"])
        self.refused(2, "plan", self.store, "--budget-ms", 0)
        self.refused(2, "plan", self.store, "--budget-bytes", -5)
        self.refused(2, "plan", self.store, "--budget-ms", "nan", says=["--budget-ms"])
        self.refused(1, "plan", self.store, "--step", 1, says=["step 1"])

    def test_people_can_read_it(self):
        text = self.fovea("plan", self.store, "--budget-coefficients", 50_000).stdout
        for part in ("the largest within the budget", "coefficients", "chunks to read", "about "):
            self.assertIn(part, text)


if __name__ == "__main__":
    unittest.main()
