#!/usr/bin/python3
"""The experiments of Yu, Chang, Huang and Zheng (2005) on public volumes: docs/paper-figures.md.

    FOVEA_TEST_DATA=... tests/bench/paper_figures.py --bin build/release/bin --docs docs [--only pictures]

writes docs/paper-figures.md and docs/images/paper/: the pictures of Figures 4 to 6 (`fovea render`),
Figure 7 as SVG and Table 1 (`frame_bench`, `volpack_bench`; times on one thread). With
`--only pictures` the tables and plots of the page stay as they are; with `--only times` the
pictures do. Needs nothing beyond Debian's python3.
"""

import argparse
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

BONSAI = {"raw": "bonsai_ct_256x256x256_u8.raw", "dims": "256x256x256",
          "transfer": "30:0.10,0.05,0.02:0;42:0.16,0.42,0.08:0.05;75:0.45,0.55,0.12:0.03;"
                      "110:0.75,0.35,0.10:0.12;170:1,0.85,0.6:0.3",
          "framing": ["--span", "290", "--center", "128,128,122"]}
COLIN = {"raw": "colin27_mri_181x217x181_u8.raw", "dims": "181x217x181",
         "transfer": "36:0.25,0.10,0.06:0;55:0.80,0.52,0.38:0.12;80:0.80,0.45,0.35:0.10;"
                     "110:0.95,0.85,0.75:0.30;200:1,1,1:0.6",
         "framing": ["--span", "235"]}
TRUNK, CROWN = "136,124,105", "100,150,190"
SIZE = "320x320"

# name: (volume, fovea or None for full resolution, rate, azimuth, what differs)
PICTURES = {
    "4": (BONSAI, None, 256, 30, ["--smoothing", "none"]),
    **{f"5{letter}": (BONSAI, TRUNK, rate, 30, ["--smoothing", smoothing])
       for letter, rate, smoothing in zip("abcdef", [100, 50, 25] * 2, ["none"] * 3 + ["full"] * 3)},
    **{f"5{letter}": (BONSAI, CROWN, rate, 30, ["--smoothing", smoothing])
       for letter, rate, smoothing in zip("ghijkl", [100, 50, 25] * 2, ["none"] * 3 + ["full"] * 3)},
    **{f"6{letter}": (BONSAI, TRUNK, rate, 30,
                      ["--smoothing", smoothing, "--weighting", f"falloff:{a}"])
       for letter, rate, a, smoothing in zip("abcdef", [50, 50, 25] * 2, [0.02, 0.1, 0.1] * 2,
                                             ["none"] * 3 + ["full"] * 3)},
    "6g": (COLIN, "70,108,80", 40, 0, ["--weighting", "chop"]),
    "6h": (COLIN, "70,108,80", 40, 30, ["--weighting", "chop"]),
}


def run(*command):
    """The stdout of a program that must succeed."""
    result = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    if result.returncode != 0:
        sys.exit(f"paper_figures: {' '.join(map(str, command))}\n{result.stderr}")
    return result.stdout


def make_pictures(fovea, data, images):
    """Renders every picture; {name: m}."""
    coefficients = {}
    with tempfile.TemporaryDirectory(prefix="fovea-figures-") as folder:
        for volume in (BONSAI, COLIN):
            store = pathlib.Path(folder) / (volume["raw"] + ".zarr")
            run(fovea, "ingest", data / "volumes" / volume["raw"], "--raw",
                volume["dims"] + ":uint8", "-o", store, "-q")
            volume["store"] = store
        for name, (volume, at, rate, azimuth, flags) in PICTURES.items():
            where = ["--fovea", at] if at else []
            marker = ["--fovea-marker"] if at else []
            out = run(fovea, "render", volume["store"], "--rate", rate, "--view", f"{azimuth},0",
                      "--size", SIZE, "--transfer", volume["transfer"], *volume["framing"], *where,
                      *marker, *flags, "--quality", 85, "--json", "-q",
                      "-o", images / f"figure{name}.jpg")
            coefficients[name] = int(json.loads(out)["stats"]["coefficients"])
    return coefficients


def rows_of(text):
    """The rows of numbers of a benchmark's table."""
    rows = []
    for line in text.splitlines():
        words = line.split()
        if words and re.fullmatch(r"[\d.]+", words[0]):
            rows.append([float(word) for word in words])
    return rows


def nice_step(top, marks=5):
    """A round step that divides 0 to `top` into about so many parts."""
    raw = top / marks
    power = 10.0 ** len(str(int(raw))) / 10 if raw >= 1 else 0.1
    return next(power * k for k in (1, 2, 5, 10, 20) if power * k >= raw)


def plot(path, title, x_label, series, log=False):
    """series: {label: [(x, y), ...]}; y in milliseconds. An SVG that reads on light and dark."""
    width, height, left, right, top, bottom = 460, 320, 62, 14, 30, 48
    colors = ["#0b6fb8", "#c8502a", "#3f8f4f", "#8a5ab0"]
    xs = sorted({x for points in series.values() for x, _ in points})
    highest = max(y for points in series.values() for _, y in points)
    step = nice_step(highest)
    y_top = step * -(-highest // step)

    def at(x, y):
        share = xs.index(x) / (len(xs) - 1) if log else (x - xs[0]) / (xs[-1] - xs[0])
        return (left + share * (width - left - right),
                height - bottom - y / y_top * (height - top - bottom))

    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
           f'width="{width}" height="{height}" font-family="sans-serif" font-size="12">',
           f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
           f'<text x="{width / 2}" y="18" text-anchor="middle" font-size="13">{title}</text>']
    for i in range(round(y_top / step) + 1):
        _, y = at(xs[0], i * step)
        out.append(f'<line x1="{left}" y1="{y:.1f}" x2="{width - right}" y2="{y:.1f}" '
                   f'stroke="#dddddd"/><text x="{left - 6}" y="{y + 4:.1f}" '
                   f'text-anchor="end">{i * step:g}</text>')
    for x in xs if len(xs) <= 10 else xs[::2]:
        out.append(f'<text x="{at(x, 0)[0]:.1f}" y="{height - bottom + 16}" '
                   f'text-anchor="middle">{x:g}</text>')
    out.append(f'<text x="{(left + width - right) / 2}" y="{height - 12}" '
               f'text-anchor="middle">{x_label}</text>'
               f'<text x="14" y="{height / 2}" text-anchor="middle" '
               f'transform="rotate(-90 14 {height / 2})">milliseconds a frame</text>')
    for i, (label, points) in enumerate(series.items()):
        color = colors[i % len(colors)]
        line = " ".join(f"{px:.1f},{py:.1f}" for px, py in (at(x, y) for x, y in points))
        out.append(f'<polyline points="{line}" fill="none" stroke="{color}" stroke-width="2"/>')
        out += [f'<circle cx="{px:.1f}" cy="{py:.1f}" r="3" fill="{color}"/>'
                for px, py in (at(x, y) for x, y in points)]
        out.append(f'<text x="{left + 10}" y="{top + 14 + 16 * i}" fill="{color}">{label}</text>')
    path.write_text("\n".join(out) + "\n</svg>\n")


def make_plots(frame_bench, images, rounds):
    """Figure 7; the text beside it."""
    def measure(workload):
        return rows_of(run(frame_bench, "--workload", workload, "--rounds", rounds))

    rates = measure("rates")
    angles = measure("angles")
    widths = measure("widths")
    plot(images / "figure7a.svg", "(a) bonsai, 512 voxels a side", "rate",
         {f"{angle:g} degrees": [(r, ms) for r, _, a, ms in rates if a == angle]
          for angle in (0, 45)})
    plot(images / "figure7b.svg", "(b) the same, rate 40", "viewing angle, degrees",
         {"rate 40": [(a, ms) for _, _, a, ms in angles]})
    plot(images / "figure7c.svg", "(c) rate 40", "data width n",
         {f"picture {size}, {angle:g} degrees": [(row[0], row[column]) for row in widths
                                                 if row[2] == angle]
          for column, size in ((3, "n x n"), (4, "512 x 512")) for angle in (0, 45)}, log=True)

    def growth(column, angle=45):
        ms = {row[0]: row[column] for row in widths if row[2] == angle}
        return ms[4096] / ms[1024]

    return (f"From n = 1024 to 4096 at 45 degrees a frame with a picture of n x n takes "
            f"{growth(3):.1f} times as long (the paper: 6.86), with one of 512 x 512 "
            f"{growth(4):.2f} times; m grows {growth(1):.2f} times and the data 64 times.")


def make_table1(volpack_bench, rounds):
    if not volpack_bench.exists():
        return "VolPack is not installed where this page was made."
    lines = ["| data | transfer function | direct, along x (Hz) | VolPack (Hz) | MV (s) | MO (s) | "
             "CV (s) | ours (Hz) |", "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |"]
    for line in run(volpack_bench, "--report", "table1", "--rounds", rounds).splitlines()[1:]:
        name, look, *numbers = line.split()
        look = {"semi": "semi-transparent"}.get(look, look)
        lines.append("| " + " | ".join([name, look, *numbers]) + " |")
    return "\n".join(lines)


def picture(name, caption):
    return f"![{caption}](images/paper/figure{name}.jpg)<br>({name[1:]}) {caption}"


def picture_table(rows):
    """rows of (name, caption), as a Markdown table without a heading."""
    columns = len(rows[0])
    lines = ["| " + " | ".join([""] * columns) + " |", "| " + " | ".join(["---"] * columns) + " |"]
    lines += ["| " + " | ".join(picture(*cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def pictures_text(m):
    millions = {name: f"{count / 1e6:.2f} million" for name, count in m.items()}
    full = m["4"]
    shares = ", ".join(f"{rate}: {millions['5' + letter]} ({100 * m['5' + letter] / full:.1f} %)"
                       for rate, letter in ((100, "a"), (50, "b"), (25, "c")))
    crown = ", ".join(f"{rate}: {millions['5' + letter]}"
                      for rate, letter in ((100, "g"), (50, "h"), (25, "i")))

    def rates(letters, extra=""):
        return [("5" + letter, f"rate {rate}{extra}") for letter, rate in zip(letters, (100, 50, 25))]

    def falloff(letters, extra=""):
        return [("6" + letter, f"rate {rate}, a = {a}{extra}")
                for letter, rate, a in zip(letters, (50, 50, 25), (0.02, 0.1, 0.1))]

    return f"""## Figure 4: full resolution
![bonsai at full resolution](images/paper/figure4.jpg)

The bonsai, 256 x 256 x 256 voxels, at 30 degrees.

## Figure 5: rate and location of the fovea
The fovea is the red dot. Coefficients kept at the trunk, by rate: {shares}; at the crown: {crown}.
Without smoothing, then smoothed (`full`); then the same with the fovea moved.

{picture_table([rates("abc"), rates("def", ", smoothed"), rates("ghi"), rates("jkl", ", smoothed")])}

## Figure 6: weighting
Falloff, 1/(1 + a distance), for two constants a; the same smoothed. Then chop: what lies before the fovea is hidden, here in the head of
Colin27 (181 x 217 x 181) at rate 40, at 0 and at 30 degrees.

{picture_table([falloff("abc"), falloff("def", ", smoothed")])}

{picture_table([[("6g", "chop, 0 degrees"), ("6h", "chop, 30 degrees")]])}
"""


def times_text(growth, table1, rounds):
    return f"""## Figure 7: time of a frame
One thread, reconstruction, thick rays, smoothing and warp together (the paper's two phases are one); medians of {rounds} rounds. (a) and (b): bonsai enlarged to 512
voxels a side, semi-transparent, picture 512 x 512. (c): blobs of all sizes around the fovea, whose coefficients are worked out on demand.

![time against rate](images/paper/figure7a.svg)
![time against angle](images/paper/figure7b.svg)
![time against width](images/paper/figure7c.svg)

{growth}

## Table 1
Frames a second on one thread. *Direct* is plain loops along x; VolPack renders its classified volume, and MV, MO and CV are the seconds it needs first for volume, octree and
classification (nothing is shaded here, so MV is only a copy); ours is at rate 25 and 45 degrees with reconstruction, which needs none of them.

{table1}
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bin", type=pathlib.Path, default="build/release/bin")
    parser.add_argument("--docs", type=pathlib.Path, default="docs")
    parser.add_argument("--only", choices=["pictures", "times"])
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    data = os.environ.get("FOVEA_TEST_DATA")
    if not data:
        sys.exit("paper_figures: set FOVEA_TEST_DATA to the folder that holds volumes/")
    images = options.docs / "images" / "paper"
    images.mkdir(parents=True, exist_ok=True)
    page = options.docs / "paper-figures.md"
    old = page.read_text() if page.exists() else ""
    split = old.find("## Figure 7")
    first = old.find("## Figure 4")
    pictures, times = (old[first:split], old[split:]) if split > first >= 0 else ("", "")
    if options.only != "times":
        coefficients = make_pictures(options.bin / "fovea", pathlib.Path(data), images)
        pictures = pictures_text(coefficients) + "\n"
    if options.only != "pictures":
        growth = make_plots(options.bin / "frame_bench", images, options.rounds)
        table1 = make_table1(options.bin / "volpack_bench", options.rounds)
        times = times_text(growth, table1, options.rounds)
    page.write_text(f"""# The paper's experiments on public volumes

Yu, Chang, Huang, Zheng, *Fast Rendering of Foveated Volumes in Wavelet-based Representation* (2005), Figures 4 to 7 and Table 1, on our data: the bonsai
and Colin27 stand in for the visible man's torso, the engine and the head. Made by `tests/bench/paper_figures.py`.

{pictures}{times}""")


if __name__ == "__main__":
    main()
