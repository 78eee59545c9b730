"""What is simulated and how its clock runs."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator
from pydantic_settings import SettingsConfigDict

from services.runtime.settings import ServiceSettings
from services.simulator.actuator import Actuator, DriveKind
from services.simulator.changeable import Changeable
from services.simulator.tracker import Tracker
from services.world.path import Motion, PathKind, open_motion
from services.world.scene import Scene

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class SimulatorSettings(ServiceSettings, Changeable):
    """The simulated world: a target that moves and deforms, and the cameras' bodies."""

    model_config = SettingsConfigDict(env_prefix="ENCIRCLE_SIMULATOR_")

    path: PathKind = "ellipse"
    """How the target moves."""
    semi_axes_m: tuple[Positive, Positive] = (1.6, 1.2)
    """Half lengths of the path along x and y, m."""
    lap_s: Positive = 40.0
    """Duration of one lap of the path, s."""
    target_noise_m: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Standard deviation of x and of y of the target as the tracker sees it, m."""
    target_noise_rad: Annotated[float, Field(ge=0, le=3)] = 0.0
    """The same of its heading, rad."""
    target_delay_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Time from the tracker's shutter to its word, s."""
    target_dropout: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Probability that the tracker sees nothing."""
    dt_s: Annotated[float, Field(ge=1e-3, le=1.0)] = 1 / 15
    """Simulated time between two ticks, s."""
    mode: Literal["lockstep", "realtime"] = "lockstep"
    """lockstep waits for everybody at each tick; realtime follows the wall clock."""
    wait_for: tuple[str, ...] = ("planner", "mapper")
    """Which other services tick 0 waits for."""
    timeout_s: Positive = 2.0
    """How long a tick waits before it goes on without those who are missing, s (lockstep)."""
    start_timeout_s: Positive = 10.0
    """The same at tick 0, when links are made and meshes are loaded, s."""
    command_timeout_s: Positive = 0.5
    """After this time without a new command a camera stands still, s (realtime)."""
    max_ticks: Annotated[int, Field(ge=0)] = 0
    """Finish after so many ticks; 0 goes on for ever."""
    duration_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """Finish after so much simulated time, s; 0 goes on for ever."""
    max_speed_m_s: Positive = 3.0
    """Greatest speed of a camera, m/s."""
    max_turn_rad_s: Positive = 4.0
    """Greatest turn rate of a camera, rad/s."""
    drive: DriveKind = "flying"
    """flying: six degrees of freedom; unicycle: on wheels, the camera fixed on the robot; planned:
    as each camera's commands say."""
    actuator_lag_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Time constant with which a camera's velocity follows its command, s."""
    actuator_noise_m_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Standard deviation of what slip or wind adds to a camera's speed, per axis and tick, m/s."""
    actuator_noise_rad_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """The same for its turn rate, rad/s."""
    max_height_m: Annotated[float, Field(gt=0, le=100)] = 100.0
    """Greatest height that a request may give the object, m: the map's box has an end."""
    clearance_m: Positive = 0.05
    """Cameras nearer than this to anything are counted as too close, m."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Where all randomness of the simulation comes from."""

    @model_validator(mode="after")
    def _world_can_be_built(self) -> Self:
        Scene.from_spec(self.scene(self.seed))
        self.motion()
        return self

    def changeable(self) -> Changeable:
        """Return the part that may change while running."""
        return Changeable(**{name: getattr(self, name) for name in Changeable.model_fields})

    def motion(self) -> Motion:
        """Return how the target moves."""
        return open_motion(self.path, self.semi_axes_m, self.lap_s)

    def tracker(self) -> Tracker:
        """Return who watches the target."""
        return Tracker(
            noise_m=self.target_noise_m,
            noise_rad=self.target_noise_rad,
            delay_ns=round(self.target_delay_s * 1e9),
            dropout=self.target_dropout,
            seed=self.seed,
        )

    def actuator(self) -> Actuator:
        """Return what the cameras' robots can do."""
        return Actuator(
            speed_m_s=self.max_speed_m_s,
            turn_rad_s=self.max_turn_rad_s,
            drive=self.drive,
            lag_s=self.actuator_lag_s,
            noise_m_s=self.actuator_noise_m_s,
            noise_rad_s=self.actuator_noise_rad_s,
            seed=self.seed,
        )

    @property
    def dt_ns(self) -> int:
        """Duration of a tick in whole nanoseconds, so that time never drifts."""
        return round(self.dt_s * 1e9)

    @property
    def num_ticks(self) -> int | None:
        """How many ticks are run; None for no end."""
        by_time = max(1, round(self.duration_s / self.dt_s)) if self.duration_s else 0
        limits = [n for n in (self.max_ticks, by_time) if n > 0]
        return min(limits, default=None)

    def patience_s(self, tick: int) -> float:
        """Return how long a tick may take in lockstep, s."""
        return self.timeout_s if tick else max(self.timeout_s, self.start_timeout_s)
