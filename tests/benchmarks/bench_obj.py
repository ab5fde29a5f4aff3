"""Read a textured OBJ of a million triangles: kiribench against trimesh.

Run as a script: ``python tests/benchmarks/bench_obj.py [--triangles N] [--repeats K]``. It
makes its own file. Every reading is a fresh process, the two libraries take turns, and both
first read a tiny OBJ of the same kind, so that imports, numba's cache and lazy loading are
paid by neither. Printed are the medians of wall and CPU seconds and of the extra memory: the
process's peak during the reading (VmHWM, reset before it) less what it held before. Exit code
1 if the ratio of wall times is below 8 or trimesh's extra memory is less than three times
ours.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

LEAST_SPEED_RATIO = 8.0
LEAST_MEMORY_RATIO = 3.0

MEASURE = """
import json, sys, time
from pathlib import Path

def status(name):
    for line in open("/proc/self/status"):
        if line.startswith(name):
            return int(line.split()[1]) / 1024.0

which, tiny, big = sys.argv[1:]
if which == "kiribench":
    from kiribench.surface.read import read_mesh
    read = lambda name: read_mesh(Path(name))
else:
    import trimesh
    read = lambda name: trimesh.load_mesh(name, process=False)
read(tiny)
open("/proc/self/clear_refs", "w").write("5")
before = status("VmRSS")
wall, cpu = time.perf_counter(), time.process_time()
mesh = read(big)
wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
print(json.dumps({"wall": wall, "cpu": cpu, "extra": status("VmHWM") - before,
                  "peak": status("VmHWM"), "faces": len(mesh.faces)}))
"""


def write_textured_obj(folder: Path, name: str, triangles: int) -> Path:
    """A wavy knee-like sheet of about ``triangles`` faces, ``v/vt/vn`` corners, a texture."""
    from PIL import Image

    side = max(2, round((triangles / 2) ** 0.5) + 1)
    s, t = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side), indexing="ij")
    angle = 2.4 * (t - 0.5)
    radius = 57 + 4 * np.sin(7 * s) * np.cos(5 * t)
    xyz = np.stack([radius * np.sin(angle), radius * np.cos(angle), 240 * s], axis=-1)
    xyz = xyz.reshape(-1, 3)
    normal = np.stack([np.sin(angle), np.cos(angle), 0 * s], axis=-1).reshape(-1, 3)
    index = np.arange(side * side).reshape(side, side)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    faces = faces[np.argsort(faces[:, 0], kind="stable")]
    # The texture is an atlas of charts, as scanners write it: strips of 50 rows of faces, each
    # with its own copy of the texture coordinates on the seam.
    chart = faces.min(axis=1) // side // 50
    corner_chart = np.repeat(chart, 3)
    pairs, face_uv = np.unique(
        corner_chart * (side * side) + faces.reshape(-1), return_inverse=True
    )
    pairs_vertex, pairs_chart = pairs % (side * side), pairs // (side * side)
    uv = np.stack([s, t], -1).reshape(-1, 2)[pairs_vertex] * 0.98
    uv[:, 0] += 0.02 * pairs_chart / max(chart.max(), 1)
    faces, face_uv = faces + 1, face_uv.reshape(-1, 3) + 1
    Image.new("RGB", (64, 64), (200, 160, 140)).save(folder / f"{name}.png")
    (folder / f"{name}.mtl").write_text(f"newmtl skin\nKd 1 1 1\nmap_Kd {name}.png\n")
    path = folder / f"{name}.obj"
    with path.open("w") as out:
        out.write(f"# textured test scan\nmtllib {name}.mtl\n")
        np.savetxt(out, xyz, fmt="v %.6f %.6f %.6f")
        np.savetxt(out, uv, fmt="vt %.6f %.6f")
        np.savetxt(out, normal, fmt="vn %.4f %.4f %.4f")
        out.write("usemtl skin\n")
        corners = np.stack([faces, face_uv, faces], axis=-1).reshape(-1, 9)
        np.savetxt(out, corners, fmt="f %d/%d/%d %d/%d/%d %d/%d/%d")
    return path


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--triangles", type=int, default=1_000_000)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tiny = write_textured_obj(folder, "tiny", 200)
        big = write_textured_obj(folder, "big", options.triangles)
        print(f"{big.stat().st_size / 1e6:.0f} MB of OBJ, about {options.triangles} triangles")
        runs: dict[str, list[dict[str, float]]] = {"kiribench": [], "trimesh": []}
        for _ in range(options.repeats):
            for which, results in runs.items():
                done = subprocess.run(
                    [sys.executable, "-c", MEASURE, which, str(tiny), str(big)],
                    check=True,
                    capture_output=True,
                    text=True,
                )
                results.append(json.loads(done.stdout))
    table = {
        which: {key: statistics.median(run[key] for run in results) for key in results[0]}
        for which, results in runs.items()
    }
    print(f"{'':10} {'wall s':>8} {'CPU s':>8} {'extra MB':>9} {'peak MB':>8} {'faces':>9}")
    for which, row in table.items():
        print(
            f"{which:10} {row['wall']:8.2f} {row['cpu']:8.2f} {row['extra']:9.0f} "
            f"{row['peak']:8.0f} {row['faces']:9.0f}"
        )
    ours, theirs = table["kiribench"], table["trimesh"]
    speed = theirs["wall"] / ours["wall"]
    cpu = theirs["cpu"] / ours["cpu"]
    memory = theirs["extra"] / ours["extra"]
    print(f"ratio of medians: wall {speed:.1f} (at least {LEAST_SPEED_RATIO:g}), CPU {cpu:.1f}, ")
    print(f"extra memory {memory:.1f} (at least {LEAST_MEMORY_RATIO:g})")
    missed = speed < LEAST_SPEED_RATIO or memory < LEAST_MEMORY_RATIO
    print("MISSED" if missed else "met")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
