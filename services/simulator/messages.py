"""The world's state, put into messages."""

import time

from schemas.geometry import WORLD, Pose, Twist
from schemas.sim import CameraBody, SceneSpec, SimClock, SimState
from schemas.target import TargetPose
from services.simulator.clock import Clock
from services.simulator.world_state import World


def target_pose(world: World) -> TargetPose:
    """Tell where the target is."""
    target = world.target()
    linear, angular = target.twist()
    return TargetPose(
        t_ns=world.t_ns,
        tick=world.tick,
        frame_id=WORLD,
        pose=Pose.from_matrix(target.pose()),
        twist=Twist(linear=linear, angular=angular),
    )


def sim_state(world: World, clock: Clock, scene: SceneSpec) -> SimState:
    """Tell all that is true."""
    target = target_pose(world)
    return SimState(
        t_ns=world.t_ns,
        tick=world.tick,
        frame_id=WORLD,
        dt_ns=world.dt_ns,
        mode=clock.mode,
        target=target.pose,
        twist=target.twist,
        scene=scene,
        cameras=tuple(
            CameraBody(
                camera=camera,
                pose=Pose.from_matrix(body.T_world_camera),
                twist=Twist(linear=tuple(body.twist[:3]), angular=tuple(body.twist[3:])),
            )
            for camera, body in sorted(world.cameras.items())
        ),
    )


def sim_clock(world: World, clock: Clock, waiting_for: tuple[str, ...], overruns: int) -> SimClock:
    """Tell the time and who holds it up."""
    return SimClock(
        t_ns=world.t_ns,
        tick=world.tick,
        frame_id=WORLD,
        dt_ns=world.dt_ns,
        mode=clock.mode,
        state=clock.state,
        waiting_for=waiting_for,
        dropped=clock.dropped,
        overruns=overruns,
        t_wall_ns=time.time_ns(),
    )
