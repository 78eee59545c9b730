"""From a map, the true states and the cameras' optics to the message that says how good it is."""

import threading
from collections import OrderedDict
from collections.abc import Mapping

from schemas.camera import CameraInfo
from schemas.map import MapChanges, MapFull
from schemas.metrics import Quality
from schemas.sim import SceneSpec, SimState
from services.evaluator.assessment import Assessment, assess
from services.evaluator.metrics import FloatArray
from services.evaluator.truth import Truth
from services.evaluator.views import View
from services.kernels.rigid import apply, inverse
from services.world.scene import Scene

_KEPT = 4
"""Scenes: the map's instant may have the one before, and the next may be made ready."""


class Judge:
    """Knows the truth of the scene at hand, of the next and of the last.

    Args:
        radius_m: distance of admissible views from the target's centre.
        num_samples: on the surface.
        seed: of the samples.
    """

    def __init__(self, radius_m: float, num_samples: int, seed: int) -> None:
        self._radius_m = radius_m
        self._num_samples = num_samples
        self._seed = seed
        self._truths: OrderedDict[SceneSpec, Truth] = OrderedDict()
        """The last used is the last."""
        self._lock = threading.Lock()

    def truth(self, spec: SceneSpec) -> Truth:
        """Return the truth of a scene; the last few are kept. From any thread.

        Raises:
            WorldError: If the scene cannot be built.
        """
        with self._lock:
            if spec in self._truths:
                self._truths.move_to_end(spec)
                return self._truths[spec]
            others = dict(self._truths)
        built = self._built(spec, others)  # Takes seconds: whoever scores does not wait for it.
        with self._lock:
            known = self._truths.setdefault(spec, built)
            self._truths.move_to_end(spec)
            while len(self._truths) > _KEPT:
                self._truths.popitem(last=False)
        return known

    def _built(self, spec: SceneSpec, others: Mapping[SceneSpec, Truth]) -> Truth:
        scene = Scene.from_spec(spec)
        deform = scene.mesh_at if spec.deformations else None
        for other, truth in others.items():
            if other.model_copy(update={"deformations": spec.deformations}) == spec:
                return truth.deforming(deform)
        return Truth(
            scene.rest.vertices_m,
            scene.faces,
            deform,
            self._radius_m,
            self._num_samples,
            self._seed,
        )

    def quality(
        self,
        held: MapChanges | MapFull,
        centres_m: FloatArray,
        stamp: SimState,
        newest: SimState,
        cameras: Mapping[int, CameraInfo],
        skipped: int,
    ) -> Quality:
        """Score one map against its own instant and against the newest.

        Args:
            held: what the map was taken from: its stamp, revision, resolution and pose.
            centres_m: (M, 3) centres of its occupied voxels, map frame.
            stamp: the true state at the map's tick.
            newest: the newest true state known when the map arrived. The map stays where its
                message put it, also when it is in the target's frame and the target went on.
            cameras: optics of the cameras that are known.
            skipped: instants that were not scored.
        """
        then = self._assess(held, centres_m, stamp, cameras)
        now = then
        if newest.tick != stamp.tick:
            now = self._assess(held, centres_m, newest, cameras)
        return Quality(
            t_ns=held.t_ns,
            tick=held.tick,
            frame_id="target",
            rev=held.rev,
            stamp_true=then.scores,
            latency_true=now.scores,
            lag_ticks=max(0, newest.tick - stamp.tick),
            missing=then.missing,
            accuracy_m=then.accuracy_m,
            completeness_m=then.completeness_m,
            chamfer_m=then.chamfer_m,
            num_samples=self._num_samples,
            num_voxels=then.num_voxels,
            skipped_instants=skipped,
        )

    def _assess(
        self,
        held: MapChanges | MapFull,
        centres_m: FloatArray,
        state: SimState,
        cameras: Mapping[int, CameraInfo],
    ) -> Assessment:
        truth = self.truth(state.scene)
        T_target_world = inverse(state.target.matrix())
        return assess(
            apply(T_target_world @ held.pose.matrix(), centres_m),
            held.resolution_m,
            truth.at(state.t_ns * 1e-9),
            truth.observable,
            views_of(state, cameras),
        )


def views_of(state: SimState, cameras: Mapping[int, CameraInfo]) -> list[View]:
    """Return how the cameras of a state look at the target; those of unknown optics do not."""
    T_target_world = inverse(state.target.matrix())
    return [
        View(
            T_target_world @ body.pose.matrix(),
            cameras[body.camera].intrinsics,
            cameras[body.camera].min_range_m,
            cameras[body.camera].max_range_m,
        )
        for body in state.cameras
        if body.camera in cameras
    ]
