#!/usr/bin/env python3
"""Checks that includes go one way only, and that heavy or foreign headers stay where they belong.

Reads every .h and .cc below engine, ingest and service; run by ctest. Exit status 1 lists what
breaks the rules of ARCHITECTURE.md.
"""
import pathlib
import re
import sys

# Module folder -> our folders it may include, besides itself.
ALLOWED = {
    "engine/base": [],
    "engine/volume": ["engine/base"],
    "engine/wavelet": ["engine/base", "engine/volume"],
    "engine/sensors": ["engine/base", "engine/volume"],
    "engine/fovea": ["engine/base", "engine/volume", "engine/wavelet"],
    "engine/store": ["engine/base", "engine/volume", "engine/fovea"],
    "engine/render": ["engine/base", "engine/volume", "engine/wavelet", "engine/fovea"],
    "ingest": ["engine/base", "engine/volume", "engine/wavelet", "engine/fovea", "engine/sensors",
               "engine/store"],
    "service/frames": ["engine"],
    "service/coefficients": ["engine", "service/frames"],
    "service/wire": ["engine", "service/frames", "service/coefficients", "proto"],
    "service/access": ["engine", "service/wire"],
    "service/server": ["engine", "ingest", "service/frames", "service/coefficients",
                       "service/wire", "service/access", "service/jobs", "service/export", "proto"],
    "service/client": ["engine", "service/frames", "service/coefficients", "service/wire",
                       "proto"],
    "service/export": ["engine", "ingest", "service/frames", "service/client"],
    "service/jobs": ["engine", "ingest", "service/frames", "service/wire", "service/export", "proto"],
    "service/cli": ["engine", "ingest", "service"],
}
# Third-party prefix -> folders that may include it.
FOREIGN = {
    "openvdb/": ["ingest"],
    "OpenImageIO/": ["ingest"],
    "oneapi/": ["engine/base"],
    "tbb/": ["engine/base"],
    "grpcpp/": ["service/server", "service/client", "service/wire"],
    "grpc/": ["service/server", "service/client", "service/wire"],
    "google/protobuf": ["service/server", "service/client", "service/wire"],
    "sqlite3.h": ["service/jobs"],
    "CLI/": ["service/cli", "ingest/worker"],
    "spdlog/": ["service", "ingest"],
    "prometheus/": ["service/server"],
    "httplib.h": ["service/server"],
    "openssl/": ["service/access", "service/server"],
    "hwy/": ["engine/wavelet", "engine/store", "engine/render"],
}
# Too slow to compile to stand in a header of ours, even where they are allowed.
HEAVY = ("OpenImageIO/", "CLI/", "httplib.h")


def module_of(path):
    matches = [m for m in ALLOWED if path == m or path.startswith(m + "/")]
    return max(matches, key=len) if matches else None


def check(root):
    problems = []
    files = [f for top in ("engine", "ingest", "service") for f in sorted((root / top).rglob("*"))]
    for file in files:
        if file.suffix not in (".h", ".cc"):
            continue
        name = file.relative_to(root).as_posix()
        module = module_of(name)
        if module is None:
            problems.append(f"{name}: its folder is in no module (cmake/check_layers.py)")
            continue
        text = re.sub(r"//[^\n]*", "", file.read_text(encoding="utf-8"))
        for quote, target in re.findall(r'^\s*#\s*include\s+(["<])([^">]+)[">]', text, re.M):
            if target.endswith(".pb.h"):
                target = "proto/" + target.removeprefix("proto/")
            own = target.split("/")[0] in ("engine", "ingest", "service", "proto")
            if own and not target.startswith(module + "/"):
                if not any(target.startswith(a + "/") for a in ALLOWED[module]):
                    problems.append(f"{name}: {module} may not include {target}")
            for prefix, places in FOREIGN.items():
                if quote == "<" and target.startswith(prefix):
                    if not any(name.startswith(p + "/") for p in places):
                        problems.append(f"{name}: <{target}> belongs in {', '.join(places)} only")
            if file.suffix == ".h" and target.startswith(HEAVY):
                problems.append(f"{name}: <{target}> is too slow to compile to stand in a header")
        if module.startswith("engine/") and re.search(
                r"\bstd::(cout|cerr|clog)\b|\b(printf|fprintf|puts|abort|exit)\s*\(", text):
            problems.append(f"{name}: the engine never prints or aborts")
    return problems


def main():
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    problems = check(root)
    for problem in problems:
        print(problem)
    sys.exit(1 if problems else 0)


if __name__ == "__main__":
    main()
