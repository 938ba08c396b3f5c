#!/usr/bin/python3
"""Whole ingests beside their rivals: docs/performance.md, section "Ingest".

    FOVEA_TEST_DATA=... tests/bench/ingest_bench.py --bin build/release/bin \\
        --folder /dev/shm --folder /var/tmp [--rounds 5] [--out-of-core]

Each row runs by turns with its rival, files in the page cache, once for each folder to write to (one
in memory, where flushing is free, and one on a disk tell what flushing costs: `fovea` flushes each
commit, `zstd` never does). Prints medians of wall-clock and processor time, sizes, and peak memory.

  bonsai    `fovea ingest --lossless` of one 256^3 uint8 volume; `zstd -3 -T2` of the file
  sequence  `fovea ingest` of four 256^3 float32 frames (dense_frames); `zstd -3 -T2` of them
  plume     `fovea ingest` of 60 OpenVDB files; a process that only reads the same grids
  1024^3    `fovea ingest` of one float32 volume (4 GB, made in the last folder): memory alone
"""

import argparse
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time


def measure(command):
    """Wall-clock seconds, processor seconds with those of its children, peak MB of a process."""
    start = time.monotonic()
    process = subprocess.Popen([str(word) for word in command], stdout=subprocess.DEVNULL,
                               stderr=subprocess.PIPE)
    errors = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        sys.exit(f"ingest_bench: {' '.join(map(str, command))}\n{errors.decode()}")
    return (time.monotonic() - start, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)


def size_of(path):
    path = pathlib.Path(path)
    files = [path] if path.is_file() else path.rglob("*")
    return sum(file.stat().st_size for file in files if file.is_file())


def remove(path):
    if os.path.isdir(path):
        shutil.rmtree(path)
    elif os.path.exists(path):
        os.remove(path)


class Row:
    """A command and its rival, and what each of them writes."""

    def __init__(self, name, ours, our_output, rival, rival_output):
        self.name = name
        self.sides = [(ours, our_output), (rival, rival_output)]

    def run(self, rounds):
        runs = [[], []]
        for _ in range(rounds):
            for side, (command, output) in enumerate(self.sides):
                remove(output)
                runs[side].append(measure(command))
        wall, cpu, peak = ([statistics.median(run[i] for run in side) for side in runs]
                           for i in range(3))
        ratio = statistics.median(a[0] / b[0] for a, b in zip(*runs))
        sizes = [size_of(output) if os.path.exists(output) else 0 for _, output in self.sides]
        print(f"{self.name:9} fovea {1000 * wall[0]:7.0f} ms, {1000 * cpu[0]:6.0f} ms of processor,"
              f" {peak[0]:4.0f} MB peak | rival {1000 * wall[1]:6.0f} ms, {1000 * cpu[1]:6.0f} |"
              f" {ratio:5.2f} x wall, {cpu[0] / cpu[1]:5.2f} x processor", end="")
        print(f" | {sizes[0] / 1e6:.2f} of {sizes[1] / 1e6:.2f} MB" if sizes[1] else "", flush=True)
        for _, output in self.sides:
            remove(output)


def rows(bin_folder, data, inputs, folder):
    fovea = bin_folder / "fovea"
    bonsai = data / "volumes/bonsai_ct_256x256x256_u8.raw"
    plume = sorted((data / "vdb/blender_plume_r64").glob("*.vdb"))
    store, packed, many = folder / "store.zarr", folder / "packed.zst", folder / "packed"
    many.mkdir()
    frames = [inputs / f"frame_{i}.raw" for i in range(4)]
    zstd = ["zstd", "-q", "-f", "-3", "-T2"]
    for path in [bonsai, *plume, *frames]:
        path.read_bytes()  # into the page cache
    yield Row("bonsai", [fovea, "ingest", bonsai, "--raw", "256x256x256:uint8", "--lossless", "-o",
                         store], store, [*zstd, bonsai, "-o", packed], packed)
    yield Row("sequence", [fovea, "ingest", inputs / "frame_#.raw", "--raw", "256x256x256:float32",
                           "-o", store], store,
              ["sh", "-c", f"mkdir -p {many} && {' '.join(zstd)} --output-dir-flat {many} "
               + " ".join(map(str, frames))], many)
    yield Row("plume", [fovea, "ingest", *plume, "-o", store], store,
              [bin_folder / "vdb_read_bench", "density,shadow,temperature,flame", 1, *plume],
              folder / "nothing")


def out_of_core(bin_folder, folder):
    volume, store = folder / "volume.raw", folder / "store.zarr"
    measure([bin_folder / "dense_frames", 1024, 0, volume])
    wall, cpu, peak = measure([bin_folder / "fovea", "ingest", volume, "--raw",
                               "1024x1024x1024:float32", "-o", store])
    print(f"1024^3    fovea {wall:.0f} s, {cpu:.0f} s of processor, {peak:.0f} MB peak |"
          f" {size_of(store) / 1e6:.0f} of {size_of(volume) / 1e6:.0f} MB", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True)
    parser.add_argument("--folder", type=pathlib.Path, action="append", required=True)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out-of-core", action="store_true")
    options = parser.parse_args()
    data = pathlib.Path(os.environ.get("FOVEA_TEST_DATA", ""))
    if not (data / "volumes").is_dir():
        sys.exit("ingest_bench: FOVEA_TEST_DATA must name the folder of the shared volumes"
                 " (it holds volumes/ and vdb/)")
    with tempfile.TemporaryDirectory(prefix="fovea-bench-", dir=options.folder[0]) as inputs:
        inputs = pathlib.Path(inputs)
        for frame in range(4):
            measure([options.bin / "dense_frames", 256, frame, inputs / f"frame_{frame}.raw"])
        for folder in options.folder:
            print(f"in {folder}:")
            with tempfile.TemporaryDirectory(prefix="fovea-bench-", dir=folder) as output:
                for row in rows(options.bin, data, inputs, pathlib.Path(output)):
                    row.run(options.rounds)
    if options.out_of_core:
        with tempfile.TemporaryDirectory(prefix="fovea-bench-", dir=options.folder[-1]) as output:
            out_of_core(options.bin, pathlib.Path(output))


if __name__ == "__main__":
    main()
