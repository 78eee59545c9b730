"""The whole chain, perceptions per second, beside the paper's way in the same run.

A perception is an instant in which all cameras were fused. Ours: `encircle run` on hexagon.toml,
real processes, lockstep. The paper's: at each instant one camera moves and its cloud is inserted
into an octree by pyoctomap, so N instants make one map; we charge it for rendering and inserting
alone (no transport). It is measured three ways: the whole cloud, as it comes; only what lies in our
map's box, cut out before it casts a ray; and that with `discretize`, its faster mode.

    python benchmarks/pipeline.py [--duration 20] [--cameras 1 3 6 12 24]
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from machine import describe
from numpy.typing import NDArray

from schemas.camera import Intrinsics
from schemas.geometry import Pose, Twist
from schemas.sim import CameraBody, SceneSpec, SimState
from services.camera.sources.simulated import SimulatedSettings, SimulatedSource
from services.kernels.rigid import look_at

ROOT = Path(__file__).parents[1]
HEXAGON = ROOT / "scenarios" / "hexagon.toml"
VOXEL_M, RADIUS_M, ELEVATION_RAD, HEIGHT_M = 0.01, 1.1, np.radians(20), 0.4
BOX_MIN_M, BOX_MAX_M = np.array([-0.6, -0.6, -0.1]), np.array([0.6, 0.6, 0.7])
OPTICS = Intrinsics.from_vertical_fov(640, 480, np.radians(45))


def run(duration_s: float, *flags: str) -> dict:
    """Run the chain in its processes and return its report."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [str(Path(sys.executable).with_name("encircle")), "run", "--headless"]
        command += ["--scenario", str(HEXAGON), "--duration", str(duration_s), *flags]
        command += ["--report", str(report), "--runs", folder]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{' '.join(command)}\n{done.stdout}{done.stderr}")
        return json.loads(report.read_text())


def paper_way(
    num_cameras: int, rounds: int, *, crop: bool, discretize: bool
) -> tuple[float, float, float]:
    """Return seconds per map for rendering and inserting, and the mean points per cloud."""
    import pyoctomap

    centre = np.array([0.0, 0.0, HEIGHT_M / 2])
    scene = SceneSpec(object="bunny", height_m=HEIGHT_M, subdivide=2, deformations=(), seed=0)
    still = Twist(linear=(0, 0, 0), angular=(0, 0, 0))
    ground = Pose(position=(0, 0, 0), orientation=(0, 0, 0, 1))
    sources, states, poses = [], [], []
    for i in range(num_cameras):
        angle = 2 * np.pi * i / num_cameras
        ray = [np.cos(angle), np.sin(angle), np.tan(ELEVATION_RAD)]
        pose = look_at(centre + RADIUS_M * np.cos(ELEVATION_RAD) * np.array(ray), centre)
        body = CameraBody(camera=i, pose=Pose.from_matrix(pose), twist=still)
        poses.append(pose)
        settings = SimulatedSettings(
            noise="nguyen", camera=i, seed=0, intrinsics=OPTICS, color=False
        )
        sources.append(SimulatedSource(settings))
        states.append(
            SimState(
                t_ns=0,
                tick=0,
                frame_id="world",
                dt_ns=1,
                mode="lockstep",
                target=ground,
                twist=still,
                scene=scene,
                cameras=(body,),
            )
        )
    octree = pyoctomap.OcTree(VOXEL_M)
    render_s, insert_s, points = [], [], []
    for instant in range(-num_cameras, rounds * num_cameras):
        i = instant % num_cameras
        start_s = time.perf_counter()
        depth = sources[i].capture(states[i], color=False).depth
        rendered_s = time.perf_counter()
        cloud = points_world(depth, poses[i], crop=crop)
        inside_s = time.perf_counter()
        octree.insertPointCloud(cloud, poses[i][:3, 3].copy(), discretize=discretize)
        if instant >= 0:  # The first round warms up, and fills the tree.
            render_s.append(rendered_s - start_s)
            insert_s.append(time.perf_counter() - inside_s)
            points.append(len(cloud))
    return sum(render_s) / rounds, sum(insert_s) / rounds, float(np.mean(points))


def points_world(
    depth: NDArray[np.uint16], T: NDArray[np.float64], *, crop: bool
) -> NDArray[np.float64]:
    """Lift an image to the world and, if asked, keep what lies in the map's box (untimed)."""
    v, u = np.nonzero((depth > 0) & (depth < 65535))
    z = depth[v, u] * 0.001
    k = OPTICS
    points = np.stack([(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z], 1) @ T[:3, :3].T
    points += T[:3, 3]
    if not crop:
        return points
    return points[((points >= BOX_MIN_M) & (points < BOX_MAX_M)).all(axis=1)]


def shares(report: dict) -> str:
    """Return where the processor's time went, service by service, stage by stage."""
    services = report["time"]
    total_s = sum(row["cpu_s"] for row in services.values())
    parts = []
    for name, row in sorted(services.items(), key=lambda item: -item[1]["cpu_s"]):
        stages = ", ".join(
            f"{stage} {seconds / report['ticks'] * 1e3:.1f}"
            for stage, seconds in sorted(row["stages_s"].items(), key=lambda item: -item[1])
        )
        cpu_ms = row["cpu_s"] / report["ticks"] * 1e3
        parts.append(
            f"    {name:<10} {row['cpu_s'] / total_s:4.0%}  {cpu_ms:5.1f} ms CPU per instant"
            + (f"  (wall: {stages})" if stages else "")
        )
    return "\n".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=20.0, help="simulated seconds a run")
    parser.add_argument("--cameras", type=int, nargs="+", default=[1, 3, 6, 12, 24])
    args = parser.parse_args()
    print(describe("encircle", "numpy", "numba", "eclipse-zenoh", "pyoctomap"))

    scored = run(args.duration)
    bare = run(args.duration, "--no-evaluator")
    ours_hz = bare["perceptions_per_s"]
    print(f"\nhexagon, 640x480, nguyen noise, {VOXEL_M * 100:g} cm, lockstep")
    print(
        f"  ours {ours_hz:.1f} perceptions/s; {scored['perceptions_per_s']:.1f} when every one "
        f"is scored; shutter to map p50 {bare['latency_ms']['p50']:.0f} ms, "
        f"fusing p50 {bare['fuse_ms']['p50']:.1f} ms, first map after {bare['startup_s']:.1f} s"
    )
    for what, crop, discretize in (
        ("whole clouds", False, False),
        ("inside our box", True, False),
        ("inside our box, discretize", True, True),
    ):
        render_s, insert_s, points = paper_way(
            6, 2 if crop else 1, crop=crop, discretize=discretize
        )
        theirs_hz = 1.0 / (render_s + insert_s)
        print(
            f"  {ours_hz / theirs_hz:4.0f} x the paper's way, {what}: {theirs_hz:.3f} maps/s (six "
            f"renderings {render_s * 1e3:.0f} ms, six insertions {insert_s * 1e3:.0f} ms, "
            f"{points:.0f} points each)"
        )
    print(f"  where the time goes, unscored:\n{shares(bare)}")
    print(f"  where the time goes, scored:\n{shares(scored)}")

    print("\ncost per camera")
    costs_ms = {}
    for cameras in args.cameras:
        row = (
            bare
            if cameras == 6
            else run(args.duration, "--cameras", str(cameras), "--no-evaluator")
        )
        costs_ms[cameras] = 1e3 / row["perceptions_per_s"] / cameras
        print(
            f"  N = {cameras:<2}  {row['perceptions_per_s']:5.1f} perceptions/s  "
            f"{costs_ms[cameras]:.2f} ms per camera, missed clouds {row['missed_clouds']}"
        )
    if 6 in costs_ms:
        growth = {n: cost / costs_ms[6] - 1 for n, cost in costs_ms.items() if n > 6}
        print("  beyond N = 6: " + ", ".join(f"{n}: {g:+.0%}" for n, g in growth.items()))


if __name__ == "__main__":
    main()
